"""Corners of a section tell whether noise is alike in all directions, where the rays are not known.

Noise across both faces at once throws points out beyond a convex corner, off either face; noise along rays that strike one face each does not, or
hardly. Where far fewer points lie there, the law by which ends of faces are blurred is not known, and a face that is hardly longer than that blur
has no part that is clear of it: it stands where it was fitted to one noise only. Long faces are known by their middles.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.special import pdtr

from scan2fea.kernel.pinned import SEEN
from scan2fea.kernel.section_likelihood import face_lengths, faces, lines_of
from scan2fea.kernel.sections import PARAMETERS, edge_names, section
from scan2fea.types import FloatArray, Member

_CLEAR, _BESIDE, _REACH = 0.5, (0.5, 1.5), 4.0  # sigma off both faces; along a face, of the strip beside the corner; off the faces at most
_SHARE = 0.119  # of the points in both strips beyond the corner: (0.198 x 0.309) over (0.415 + 0.096), Gaussian; Laplace 0.086, uniform 0.15
_FEWER, _CHANCE = 1 / 3, 1e-4  # of that share; by chance, were it half (Laplace: 0.72)
_LEAST = 2.0  # sigma, length of a face that makes a corner
_BLUR = 6.0  # sigma: both ends of a face, up to which no part of it is clear


def doubted_for_corners(u: FloatArray, member: Member) -> Member:
    """The member with what a noise of unknown directions may have moved its short faces by added to its deviations; as it was where corners are full.

    u : (n, 2) points in the section, between the ends, metres.
    """
    values = np.array([member.values()[name] for name in PARAMETERS[member.family]])
    found, expected = beyond_corners(u, member)
    if found >= _FEWER * expected or pdtr(found, expected / 2) > _CHANCE:
        return member
    names = faces(member.family)
    seen = np.array([member.seen.get(name, 1.0) >= SEEN for name in names])
    blur = _BLUR * member.sigma_m / np.maximum(face_lengths(member.family, values), 1e-12)
    at = np.maximum(member.sigma_m * np.minimum(blur**2, 1.0), 1e-12)  # of each face, metres
    axis, line = lines_of(member.family)[:2]
    slope = np.column_stack([line, axis == 0, axis == 1])[seen] / at[seen, None]
    added = np.linalg.pinv(slope.T @ slope)[: len(values), : len(values)]
    covariance, parameters = np.array(member.covariance), list(member.parameters)
    for k, p in enumerate(parameters[: len(values)]):
        if p.source == "fitted" and p.observable and p.std_m is not None:
            covariance[k, k] = p.std_m**2 + added[k, k]
            parameters[k] = dataclasses.replace(p, std_m=math.sqrt(covariance[k, k]))
    return dataclasses.replace(member, parameters=tuple(parameters), covariance=covariance)


def beyond_corners(u: FloatArray, member: Member) -> tuple[int, float]:
    """Points (n, 2) beyond the convex corners of seen faces, and how many there would be, were noise alike in all directions."""
    shape, sigma = section(member.family, member.values()), member.sigma_m
    loop, names = shape.loops[0], edge_names(member.family)[0]
    step = np.roll(loop, -1, axis=0) - loop
    length = np.linalg.norm(step, axis=1)
    way = step / length[:, None]
    turn = math.copysign(1.0, float(loop[:, 0] @ np.roll(loop[:, 1], -1) - loop[:, 1] @ np.roll(loop[:, 0], -1)))
    out = turn * np.stack([way[:, 1], -way[:, 0]], 1)
    found, expected = 0, 0.0
    for i, corner in enumerate(loop):
        is_convex = turn * (way[i - 1, 0] * way[i, 1] - way[i - 1, 1] * way[i, 0]) > 0
        is_seen = min(member.seen.get(names[i - 1], 1.0), member.seen.get(names[i], 1.0)) >= SEEN
        if not (is_convex and is_seen and min(length[i - 1], length[i]) > _LEAST * sigma):
            continue
        off = (u - corner) @ np.stack([out[i - 1], out[i]], 1) / sigma
        off = off[(off < _REACH).all(axis=1)]
        found += int((off > _CLEAR).all(axis=1).sum())
        strips = [(off[:, k] > 0) & (-off[:, 1 - k] > _BESIDE[0]) & (-off[:, 1 - k] < _BESIDE[1]) for k in (0, 1)]
        expected += _SHARE * float(strips[0].sum() + strips[1].sum())
    return found, expected
