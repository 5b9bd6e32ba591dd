"""Toes of thin walls at which the points stop more sharply than the noise lets any toe: there the points were cut, and the wall goes on.

Where noise joins both faces of a wall, its toe is told by where the points end: a step blurred by the noise, and a hump of the toe's own points.
Points that were cut off end in a step without blur and without hump, and the likeliest blurred step then lies a standard deviation farther out. Noise
along rays that cross the wall leaves a sharp step too, but then the toe's own points tell it; where nobody saw these, nobody knows a toe from a cut.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.special import ndtr

from scan2fea.estimation.straight import Face, ends_at, straight_faces
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.counted_edge import counted_levels
from scan2fea.kernel.sections import ROUND
from scan2fea.types import FloatArray, Member

Law = Callable[[FloatArray], FloatArray]  # share of the noise below, of unit variance

JOINED = 4.0  # sigma across a wall, over which noise joins its faces
_SHARP = 0.15  # of the noise: a step that is not blurred, in cells of a tenth
_TOES = ((2.0, 1.0, 0.0), (1.0, 1.0, 0.0), (0.5, 1.0, 0.0), (1.0, 1.0, 1.0), (0.5, 1.0, 1.0), (_SHARP, 1.0, 1.0), (_SHARP, 1.0, 0.5),
         (_SHARP, _SHARP, 1.0))  # blur of a toe's step and of its hump over the noise, and its hump over that of a toe seen  # fmt: skip
_OTHER_LAWS = ((1.0, 1.0, 0.0), (1.0, 1.0, 1.0), (_SHARP, 1.0, 1.0), (_SHARP, 1.0, 0.5))  # asked of noise with ends of its own too
_CELL, _WINDOW, _SHIFT = 0.1, 6.0, 4.0  # sigma: cells, what is looked at beyond every end that is tried, and how far off ends are tried
_ROUNDS = 12
_LEAST, _MOST = 60, 2_000  # points; more say no more, for no law of noise is quite true
_SURER = 7.0  # log units: one toe in a thousand looks so by chance


def cut_toes(points: FloatArray, member: Member) -> frozenset[str]:
    """The toes at which the points were cut. points : (n, 3) metres."""
    sigma = member.sigma_m
    if member.family in ROUND or member.twist.any() or not sigma > 0:
        return frozenset()
    loop = straight_faces(member)[0]
    toes = [
        (loop[i - 1], face)
        for i, face in enumerate(loop)
        if face.high - face.low < JOINED * sigma and ends_at(loop[i - 1], face) and ends_at(loop[(i + 1) % len(loop)], face)
    ]
    if not toes or len(straight_faces(member)) > 1:
        return frozenset()
    local = sweep_of_member(member).coordinates(points)
    local = local[(local[:, 2] > JOINED * sigma) & (local[:, 2] < member.values()["length"] - JOINED * sigma)]
    return frozenset(face.name for beside, face in toes if _is_cut(local, beside, face, sigma))


def _is_cut(local: FloatArray, beside: Face, face: Face, sigma: float) -> bool:
    reach = min((_WINDOW + _SHIFT) * sigma, 0.5 * (beside.high - beside.low))
    if reach < _WINDOW * sigma:
        return False
    across, out = local[:, 1 - face.axis], face.outward * (local[:, face.axis] - face.place) / sigma
    own = (across > face.low - JOINED * sigma) & (across < face.high + JOINED * sigma)
    low, high = -reach / sigma, _WINDOW + _SHIFT
    counts, bounds = np.histogram(out[own], np.arange(low, high + _CELL, _CELL))
    if counts.sum() < _LEAST:
        return False
    ends = np.arange(max(low + 2.0, -_SHIFT), _SHIFT, _CELL)
    hump = 0.5 * (face.high - face.low) / sigma  # of a toe as dense as the two faces beside it
    counts = counts * min(_MOST / counts.sum(), 1.0)
    tried = [(gauss, *toe) for toe in _TOES] + [(law, *toe) for law in (box, _ball) for toe in _OTHER_LAWS]
    steps = {key: step_of(bounds, ends, *key) for key in {(law, blur) for law, blur, _, _ in tried}}
    humps = {key: hump_of(bounds, ends, *key) for key in {(law, blur) for law, _, blur, _ in tried}}
    # greatest log likelihood of the counts over the place of the end and the share of strays
    toes = [
        counted_levels(steps[law, blur], humps[law, hump_blur], share * hump, counts, _ROUNDS).max() for law, blur, hump_blur, share in tried
    ]
    cut = counted_levels(steps[gauss, _SHARP], humps[gauss, 1.0], 0.0, counts, _ROUNDS).max()
    return bool(cut > max(toes) + _SURER)


def step_of(bounds: FloatArray, ends: FloatArray, law: Law, blur: float) -> FloatArray:
    """(p, n) points expected in each cell of a step at each of the places (p,), of one point a sigma. bounds : (n + 1,) of the cells."""
    return np.asarray(law((ends[:, None] - 0.5 * (bounds[1:] + bounds[:-1])) / blur) * np.diff(bounds))


def hump_of(bounds: FloatArray, ends: FloatArray, law: Law, blur: float) -> FloatArray:
    """(p, n) the same of a toe of one point."""
    return np.asarray(np.diff(law((bounds - ends[:, None]) / blur), axis=1))


def gauss(x: FloatArray) -> FloatArray:
    """Share of the noise below x, of unit variance."""
    return np.asarray(ndtr(x))


def box(x: FloatArray) -> FloatArray:
    """The same of noise that is even along a line."""
    return np.asarray(np.clip(0.5 + x / math.sqrt(12), 0.0, 1.0))


def _ball(x: FloatArray) -> FloatArray:
    """The same of noise that is even in a ball, along any line."""
    u = np.clip(x / math.sqrt(5), -1.0, 1.0)
    return np.asarray(0.5 + 0.75 * (u - u**3 / 3))
