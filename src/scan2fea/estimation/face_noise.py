"""What noise along rays may have done to a section where the rays are not known.

Noise that is alike in all directions is as wide off every face. A scanner's acts along its rays: faces that it looked at head on are rougher than
those that it saw aslant, and where a face ends is blurred otherwise than it is rough (`ray_noise.py`). Where the faces' own noises differ beyond
chance, rays that would give each its own are made up in three ways, and the most that any would do to a dimension is how far it may be off.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.special import chdtrc

from scan2fea.estimation.corner_noise import doubted_for_corners
from scan2fea.estimation.outline import edge_lengths, outline_distance
from scan2fea.estimation.ray_noise import bias_of
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.estimation.toe_noise import doubted_for_toes
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.section_likelihood import lines_of
from scan2fea.kernel.sections import PARAMETERS, ROUND, section
from scan2fea.types import FloatArray, IntArray, Member

_POINTS = 20_000
_APART = 3.0  # standard deviations from a face's ends: what lies nearer may be of its neighbour
_REACH = 3.5  # standard deviations off a face: what lies farther is a stray
_LEAST = 50  # points of a face
_CHANCE = 1e-3
_FEET = 32
_WAYS = ((1.0, True), (1.0, False), (math.sqrt(0.5), True))  # cosine of the rays on the roughest face; whether they are aslant across the member


def doubted_for_rays(points: FloatArray, member: Member, face_weight: FloatArray | None, seed: int) -> Member:
    """The member with what rays that nobody told may have moved its dimensions by added to their standard deviations.

    points : (n, 3) of the member.   face_weight : (f,) points per metre of each face, relative; None: all alike.
    """
    if member.family in ROUND or member.change is not None:
        return member
    values = np.array([member.values()[name] for name in PARAMETERS[member.family]])
    local = sweep_of_member(member).coordinates(points[sampled_rows(len(points), _POINTS, seed)])
    member = doubted_for_corners(local[(local[:, 2] > 0) & (local[:, 2] < member.values()["length"]), :2], member)
    member = doubted_for_toes(local, member)
    noise = noise_of_faces(member.family, values, local[:, :2], member.sigma_m)
    if noise is None:
        return member
    weight = np.ones(len(noise)) if face_weight is None else face_weight
    found = [bias_of(member.family, values, member.sigma_m, member.noise, weight, *made_up_rays(member.family, noise, *way)) for way in _WAYS]
    told = [bias for bias in found if bias is not None and np.isfinite(bias).all()]
    if not told:
        return member
    bias = np.abs(told).max(axis=0)
    covariance, parameters = np.array(member.covariance), list(member.parameters)
    for k, p in enumerate(parameters[: len(values)]):
        if p.source == "fitted" and p.observable and p.std_m is not None:
            covariance[k, k] = p.std_m**2 + bias[k] ** 2
            parameters[k] = dataclasses.replace(p, std_m=math.sqrt(covariance[k, k]))
    return dataclasses.replace(member, parameters=tuple(parameters), covariance=covariance)


def noise_of_faces(family: str, values: FloatArray, u: FloatArray, sigma_m: float) -> FloatArray | None:
    """(f,) standard deviation of the points (n, 2) off each face, that of all where a face holds too few; None where they differ by chance only.

    Asked of the points outside, that are no other face's: those inside a wall may be its other face's.
    """
    shape = section(family, dict(zip(PARAMETERS[family], values.tolist(), strict=True)))
    start = np.concatenate(shape.loops)
    length = edge_lengths(shape)
    off, face, along = outline_distance(shape, u)
    clear = (off > 0) & (off < _REACH * sigma_m) & (along > _APART * sigma_m) & (along < length[face] - _APART * sigma_m)
    noise, level, weight = np.full(len(start), sigma_m), [], []
    for k in range(len(start)):
        own = off[clear & (face == k)]
        if len(own) < _LEAST:
            continue
        noise[k] = math.sqrt(float(np.mean(own**2)))
        level.append(math.log(noise[k]))
        weight.append(4 * len(own) / max(float(np.mean(own**4)) / noise[k] ** 4 - 1, 1.0))  # of the log's variance, by the fourth moment
    if len(level) < 2:
        return None
    logs, told = np.array(level), np.array(weight)
    scatter = float(told @ (logs - float(told @ logs) / told.sum()) ** 2)
    return noise if chdtrc(len(logs) - 1, scatter) < _CHANCE else None


def made_up_rays(family: str, noise: FloatArray, steepest: float, is_across: bool) -> tuple[FloatArray, IntArray]:
    """Directions (n, 2) of rays across the member that give each face its noise (f,), and the face that each hit.

    steepest : cosine between rays and normal of the roughest face.   is_across : they are aslant across the member, from both sides, else along it.
    """
    axis = lines_of(family)[0]
    face = np.repeat(np.arange(len(noise)), _FEET)
    cosine = steepest * noise[face] / float(noise.max())
    way = np.zeros((len(face), 2))
    way[np.arange(len(face)), axis[face]] = cosine
    if is_across:
        side = np.where(np.arange(len(face)) % 2, 1.0, -1.0)
        way[np.arange(len(face)), 1 - axis[face]] = side * np.sqrt(1 - cosine**2)
    return way, face
