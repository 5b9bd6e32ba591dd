"""The slope of the inner faces of flanges, from the points: IPN have 14 %, UPN 8 and 5 % (EN 10365), American S, C and MC shapes 1 in 6 (ASTM A6).

A sloping flange is as thick as a parallel one in the middle of what stands out of the web, and as heavy; so the section that is fitted has parallel
flanges, to points that are moved as a scan of it would have them (`parallel`), and the solid slopes.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.outline import SLOPING, Slant, flange_span
from scan2fea.types import FloatArray, Member

LEAST = 0.03  # EN 10034 lets a flange lean by 2 % of its width: its inner faces then lean the same way, not against each other
_MOST = 0.25
_STEPS = 57  # slopes that are tried first, from -_MOST / 2: every 0.7 %
_ROOT, _TOE = 1.2, 0.6  # of the flange's thickness beside web and toe are round (UPN: root radii as large as it, toes half of it)
_DEEP = 0.6  # of the thickness about it: where the inner face is looked for
_POINTS, _FEWEST = 6_000, 60
_INLIERS = 3.0  # standard deviations
_ROUNDS = 5


def slope_of(points: FloatArray, member: Member, seed: int = 0) -> tuple[float, float]:
    """How much thinner flanges grow per length towards their toes, and its standard deviation; (0, 0) where they do not, or that is not told.

    points : (n, 3) metres. Two inner faces at least, and all that were seen, must agree: EN 10365 and ASTM A6 give a shape one slope, and the two of
    one flange that leans slope against each other.
    """
    nothing = 0.0, 0.0
    if member.family not in SLOPING or member.change is not None:
        return nothing
    faces = [face for face in _inner_faces(points, member, seed) if len(face) >= _FEWEST]
    told = np.array([_slope(face, member.sigma_m) for face in faces]).reshape(-1, 2)
    if len(told) < 2:
        return nothing
    weight = 1 / np.square(np.maximum(told[:, 1], LEAST / 10))
    slope, std = float(weight @ told[:, 0] / weight.sum()), float(1 / math.sqrt(weight.sum()))
    agree = (np.abs(told[:, 0] - slope) < np.maximum(_INLIERS * told[:, 1], LEAST)).all()
    return (slope, std) if agree and slope - _INLIERS * std > LEAST else nothing


def parallel(points: FloatArray, member: Member, slope: float) -> FloatArray:
    """(n, 3) the points as a scan of the same member with parallel flanges would have them: outer faces stay, inner faces turn about their middle.

    What lies between the faces of a flange moves with the nearer one, what lies beyond it on the web by less and less, down to the web's middle.
    """
    values, slant = member.values(), Slant.of(member.family, member.values(), slope)
    if slant is None:
        return points
    sweep = sweep_of_member(member)
    local = sweep.coordinates(points)
    depth, thick, deepest = values["h"] / 2 - np.abs(local[:, 1]), slant.thickness(local[:, 0]), values["h"] / 2
    share = np.clip(2 * depth / thick - 0.5, 0.0, 1.0) * np.clip((deepest - depth) / (deepest - thick), 0.0, 1.0)
    moved = np.zeros((len(points), 2))
    moved[:, 1] = np.sign(local[:, 1]) * share * (thick - values["tf"])
    return np.asarray(points + sweep.in_world(local[:, 2], moved))


def at_middle(member: Member, pivot: Member) -> Member:
    """The member with its flanges as thick as they are in their own middle; it was fitted to points turned about the middle of those of `pivot`."""
    if not member.root.slope:
        return member
    less = member.root.slope * (sum(flange_span(member.family, member.values())) - sum(flange_span(pivot.family, pivot.values()))) / 2
    return replace(member, parameters=tuple(replace(p, value_m=p.value_m - less) if p.name == "tf" else p for p in member.parameters))


def _inner_faces(points: FloatArray, member: Member, seed: int) -> list[FloatArray]:
    """Per inner face (k, 2): how far along the flange from the web, and how deep under its outer face."""
    local, values = sweep_of_member(member).coordinates(points), member.values()
    margin = 4 * member.sigma_m
    local = local[(local[:, 2] > margin) & (local[:, 2] < values["length"] - margin)]
    near, far = flange_span(member.family, values)
    out = []
    for flange in (-1, 1):
        for side in (-1, 1) if member.family == "I" else (1,):
            along, depth = side * local[:, 0], values["h"] / 2 - flange * local[:, 1]
            within = (along > near + _ROOT * values["tf"]) & (along < far - _TOE * values["tf"])
            rows = np.flatnonzero(within & (np.abs(depth - values["tf"]) < _DEEP * values["tf"]))
            rows = rows[sampled_rows(len(rows), _POINTS, seed)]
            out.append(np.stack([along[rows], depth[rows]], axis=1))
    return out


def _slope(face: FloatArray, sigma: float) -> tuple[float, float]:
    """(slope, its standard deviation) of a line through most of the points (k, 2); strays are left out."""
    x, y = face[:, 0] - face[:, 0].mean(), face[:, 1]
    tried = np.linspace(-_MOST / 2, _MOST, _STEPS)
    off = y + tried[:, None] * x
    off -= np.median(off, axis=1)[:, None]
    best = int(np.argmin(np.minimum(np.abs(off), _INLIERS * sigma).sum(axis=1)))
    slope, middle = float(tried[best]), float(np.median(y + tried[best] * x))
    for _ in range(_ROUNDS):
        left = y - middle + slope * x
        keep = np.abs(left) < _INLIERS * max(sigma, 1.4826 * float(np.median(np.abs(left))))
        line = np.polyfit(x[keep], y[keep], 1)
        slope, middle = -float(line[0]), float(line[1])
    left = (y - middle + slope * x)[keep]
    return slope, float(np.std(left) / math.sqrt(np.square(x[keep] - x[keep].mean()).sum()))
