"""Toes that the fit of the section counts as seen and whose middle no point is on: a strip of the face beside each looks like one from afar.

Of a wall wider than the noise the middle of its toe is clear of both neighbours, and what the fit says of the toe's points can be counted there. A
shadow that leaves only the outer rim of a flange's inner face puts points just where the toe ends, and none between. Likewise inner faces of tubes:
the rounded corners of a tube seen from outside lie within its sharp outline, where the fit may find a thin wall.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import pdtr

from scan2fea.estimation.straight import ends_at, straight_faces
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.sections import ROUND
from scan2fea.types import FloatArray, Member

_POINTS = 60_000
_CLEAR = 2.5  # sigma from either neighbour: 6 in 1000 of their points lie deeper (Laplace 15)
_REACH, _EXACT = 3.0, 0.01  # sigma off the toe, and of its width: exact points are as far off as the fit rounds
_CHANCE = 1e-3  # of so few points, were half of them there
ROUNDED = 3.0  # walls: outer radius of the corners of cold formed hollow sections, EN 10219-2. Arcs of a wider one, taken for a wall, end there too


def bare_toes(points: FloatArray, member: Member, density: Mapping[str, float], seed: int = 0) -> frozenset[str]:
    """The toes between whose neighbours too few points lie.

    points : (n, 3) metres.   density : points per metre of each face as the section was fitted, relative.
    """
    sigma = member.sigma_m
    if member.family in ROUND or member.twist.any() or not sigma > 0 or len(straight_faces(member)) > 1:
        return frozenset()
    local = sweep_of_member(member).coordinates(points[sampled_rows(len(points), _POINTS, seed)])
    local = local[(local[:, 2] > _REACH * sigma) & (local[:, 2] < member.values()["length"] - _REACH * sigma)]
    loop = straight_faces(member)[0]
    per_m = len(local) / max(sum((face.high - face.low) * density[face.name] for face in loop), 1e-300)
    bare = set()
    for i, face in enumerate(loop):
        width, beside = face.high - face.low, (loop[i - 1], loop[(i + 1) % len(loop)])
        clear = width - 2 * _CLEAR * sigma
        if clear <= 0 or not all(ends_at(one, face) and one.high - one.low > width for one in beside):
            continue
        across, off = local[:, 1 - face.axis], np.abs(local[:, face.axis] - face.place)
        found = int(((np.abs(across - 0.5 * (face.low + face.high)) < 0.5 * clear) & (off < max(_REACH * sigma, _EXACT * width))).sum())
        if pdtr(found, 0.5 * per_m * density[face.name] * clear) < _CHANCE:
            bare.add(face.name)
    return frozenset(bare)


def bare_walls(points: FloatArray, member: Member, density: Mapping[str, float]) -> frozenset[str]:
    """The inner faces of a rectangular tube on which too few points lie clear of its corners. points, density : as in `bare_toes`."""
    sigma, values = member.sigma_m, member.values()
    if member.family != "RHS" or member.twist.any() or not sigma > 0:
        return frozenset()
    local = sweep_of_member(member).coordinates(points)
    local = local[(local[:, 2] > _REACH * sigma) & (local[:, 2] < values["length"] - _REACH * sigma)]
    outer, inner = straight_faces(member)
    per_m = len(local) / max(sum((face.high - face.low) * density[face.name] for face in (*outer, *inner)), 1e-300)
    bare = set()
    for face in inner:
        half = 0.5 * (face.high - face.low) - (ROUNDED - 1.0) * values["t"] - _CLEAR * sigma
        across, off = local[:, 1 - face.axis], np.abs(local[:, face.axis] - face.place)
        found = int(((np.abs(across - 0.5 * (face.low + face.high)) < half) & (off < _REACH * sigma)).sum())
        if half > 0 and pdtr(found, per_m * density[face.name] * half) < _CHANCE:
            bare.add(face.name)
    return frozenset(bare)
