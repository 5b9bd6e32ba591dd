"""Toes tell whether noise acts along a wall as it does across it, where the rays are not known.

A toe hardly wider than the noise has no place clear of its ends, so that its own noise cannot be asked (`face_noise.py`), and it is told mostly by
where the faces beside it end. Noise along rays that strike these head on leaves their ends sharp, and a sharp end that is taken for a blurred one
comes out within itself. Ends of other blurs, beside toes of other noises, are held against those of the noise that was fitted; where one of them is
likelier beyond chance, a toe is known no better than by how far off all of them together put it.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from scan2fea.estimation.cut_toes import Law, box, gauss, hump_of, step_of
from scan2fea.estimation.straight import Face, ends_at, straight_faces
from scan2fea.kernel.counted_edge import counted_levels
from scan2fea.kernel.pinned import SEEN
from scan2fea.kernel.section_likelihood import faces, lines_of
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.types import FloatArray, Member

_NARROW = 6.0  # sigma across a toe: three from either end
_CELL, _WITHIN, _BEYOND, _LEAST_WITHIN = 0.1, 10.0, 6.0, 4.0  # sigma: cells, and what is looked at within and beyond the toe's place
_ASIDE = 4.0  # sigma beside the toe, and from the ends of the member
_PLACES = np.arange(-1.5, 1.55, 0.1)  # sigma, of the end
_BLURS, _ODDS = (1.0, 0.7, 0.5, 0.3), (1 / 2, 1 / 6, 1 / 6, 1 / 6)  # of the ends, over sigma: alike is as likely as all others
_HUMPS, _HUMP_ODDS = (1.0, 0.7, 0.4), (1 / 2, 1 / 4, 1 / 4)  # the toe's own noise over sigma
_SHARES = (0.25, 0.5, 0.75, 1.0, 1.4, 2.0)  # of the toe's points, over those of a toe as dense as the two faces beside it
_LEAST, _MOST = 60, 6_000  # points; more say no more, for no law of noise is quite true
_SURER = 7.0  # log units, of all toes together: under noise alike in all directions none of 60 members came to more than 5
_ROUNDS = 6
_FIRM = 20.0  # times as firm other faces stand


def doubted_for_toes(local: FloatArray, member: Member) -> Member:
    """The member with what a noise that is not alike in all directions may have moved its toes by added to its deviations; else as it was.

    local : (n, 3) points in the member's frame, metres.
    """
    loops = straight_faces(member)
    if len(loops) > 1 or not member.sigma_m > 0 or member.twist.any():
        return member
    off, surer = {}, 0.0
    for toe, counts, bounds in _profiles(local, loops[0], member):
        off[toe.name], more = _doubt(counts, bounds, 0.5 * (toe.high - toe.low) / member.sigma_m, box if member.noise == "uniform" else gauss)
        surer += more
    if surer < _SURER:
        return member
    names = faces(member.family)
    is_toe = np.array([name in off for name in names])
    seen = np.array([member.seen.get(name, 1.0) >= SEEN for name in names]) | is_toe
    axis, line = lines_of(member.family)[:2]
    firm = np.where(is_toe, 1.0, _FIRM)[seen]
    by_face = np.linalg.pinv(np.column_stack([line, axis == 0, axis == 1])[seen] * firm[:, None]) * firm
    moved = np.abs(by_face) @ (member.sigma_m * np.array([off.get(name, 0.0) for name in names])[seen])  # all toes outwards
    covariance, parameters = np.array(member.covariance), list(member.parameters)
    for k, p in enumerate(parameters[: len(PARAMETERS[member.family])]):
        if p.source == "fitted" and p.observable and p.std_m is not None:
            covariance[k, k] = p.std_m**2 + moved[k] ** 2
            parameters[k] = dataclasses.replace(p, std_m=math.sqrt(covariance[k, k]))
    return dataclasses.replace(member, parameters=tuple(parameters), covariance=covariance)


def _profiles(local: FloatArray, loop: list[Face], member: Member) -> list[tuple[Face, FloatArray, FloatArray]]:
    """Each narrow toe that was seen, the points near it counted in cells across it, and the bounds of these cells in sigma beyond its place."""
    sigma, found = member.sigma_m, []
    local = local[(local[:, 2] > _ASIDE * sigma) & (local[:, 2] < member.values()["length"] - _ASIDE * sigma)]
    for i, toe in enumerate(loop):
        beside, after = loop[i - 1], loop[(i + 1) % len(loop)]
        within = min(_WITHIN * sigma, 0.5 * (beside.high - beside.low), 0.5 * (after.high - after.low)) / sigma
        is_toe = toe.high - toe.low < _NARROW * sigma and ends_at(beside, toe) and ends_at(after, toe)
        if not is_toe or within < _LEAST_WITHIN or member.seen.get(toe.name, 1.0) < SEEN:
            continue
        across, out = local[:, 1 - toe.axis], toe.outward * (local[:, toe.axis] - toe.place) / sigma
        own = (across > toe.low - _ASIDE * sigma) & (across < toe.high + _ASIDE * sigma)
        counts, bounds = np.histogram(out[own], np.arange(-within, _BEYOND + _CELL, _CELL))
        if counts.sum() >= _LEAST:
            found.append((toe, counts * min(_MOST / counts.sum(), 1.0), bounds))
    return found


def _doubt(counts: FloatArray, bounds: FloatArray, hump: float, law: Law) -> tuple[float, float]:
    """How far off its place a toe may be, in sigma, and by how many log units the likeliest blur is likelier than that of noise alike.

    counts : (n,) of cells.   bounds : (n + 1,) of cells.   hump : points of a toe as dense as its neighbours over those of a sigma of both.
    """
    steps, humps = [step_of(bounds, _PLACES, law, blur) for blur in _BLURS], [hump_of(bounds, _PLACES, law, own) for own in _HUMPS]
    heights = [share * hump for share in _SHARES]
    level = np.array([[[counted_levels(step, bump, height, counts, _ROUNDS) for height in heights] for bump in humps] for step in steps])
    alike = level[0, 0] - level[0, 0].max()
    odds = np.log(_ODDS)[:, None, None, None] + np.log(_HUMP_ODDS)[:, None, None]
    before, after = _place(np.exp(alike).sum(axis=0)), _place(np.exp(level + odds - level.max()).sum(axis=(0, 1, 2)))
    return math.sqrt(after[0] ** 2 + max(after[1] - before[1], 0.0)), float(level.max() - level[0, 0].max())


def _place(weight: FloatArray) -> tuple[float, float]:
    """Mean and variance of the places by their weights."""
    share = weight / weight.sum()
    mean = float(share @ _PLACES)
    return mean, float(share @ (_PLACES - mean) ** 2)
