"""Does something run along beside the member, as dense as its own faces? Then the section is only part of what was scanned.

A tee of which the web's end was seen and nothing else of the web is a flat with a strip beside it: too few points to be a second body, yet
clutter neither keeps to one line along the member nor lies there as close as on its faces. Only what lies outside the hull of the section counts:
fillets and roundings lie within.

Where that strip stands far off, segmentation has made it an object of its own (`segmentation.strips`): then it is known by ending where the member
does. So is all that lies beyond a face which nobody saw, thin or not: a flange, and the tee that is the rest of its I.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, cKDTree
from scipy.special import pdtrc

from scan2fea.estimation.explain import TOLERANCE
from scan2fea.estimation.outline import edge_lengths
from scan2fea.estimation.straight import straight_faces
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.pinned import SEEN
from scan2fea.kernel.sections import ROUND, section
from scan2fea.types import FloatArray, Member
from scan2fea.units import MILLIMETRES_PER_METRE

_SIGMAS = 4.0  # off the hull, and about a place: the points of one line along the member
_DENSITY = 0.25  # of the member's faces, where below it a face counts as not seen (`face_weights`)
_BY_CHANCE = 1e-3  # of all strays together
_LEAST = 60  # points
_SLICES, _IN_EACH = 6, 0.25  # along the member: most hold that part of their share, the first and the last among them
_NEAR = 2.0  # of the largest side of the section: no wall of the usual sections reaches farther beyond another
_ROWS = 4.0  # mean distances of a strip's points along the member: at an end chance leaves more once in 50
_MOST = 4  # of them: filters take thin strips out here and there
_FLAT, _THICK_SIGMAS = 0.25, 10.0  # of its width, a thin strip's thickness; of the noise, that it may be thick all the same
_BEYOND = 0.9  # of the points of what lies beyond a face


def beside(points: FloatArray, member: Member) -> str:
    """Why the section is only part of what was scanned; "" where nothing runs along beside it. points : (n, 3) metres."""
    shape, length = section(member.family, member.values()), member.values()["length"]
    outer = shape.loops[0]
    reach = _SIGMAS * member.sigma_m + TOLERANCE * float(np.linalg.norm(np.ptp(outer, axis=0)))
    local = sweep_of_member(member).coordinates(points)
    local = local[(local[:, 2] > 0) & (local[:, 2] < length)]
    away = _off_hull(member, local[:, :2])
    strays, away = local[away > reach], away[away > reach]
    if len(strays) < _LEAST:
        return ""
    tree = cKDTree(strays[:, :2])
    place = int(np.argmax(tree.query_ball_point(strays[:, :2], reach, return_length=True)))
    own = tree.query_ball_point(strays[place, :2], reach)
    outline = float(edge_lengths(shape).sum())
    share = math.pi * reach**2 / float(np.prod(np.ptp(local[:, :2], axis=0)))
    is_dense = len(own) / (2 * reach) > _DENSITY * (len(local) - len(strays)) / outline  # points a metre of section
    if not (is_dense and _is_crowd(len(own), len(strays), share) and _runs_along(strays[own, 2], length)):
        return ""
    return (
        f"{len(own)} points run along beside the {member.family} member, {MILLIMETRES_PER_METRE * float(np.median(away[own])):.3g} mm off it "
        "and as close as on its faces: it is only part of what was scanned, or something else lies beside it; scan the rest, or segment it"
    )


def strip_beside(member: Member, strips: Sequence[FloatArray]) -> str:
    """Why the section is only part of what was scanned: an object of its own (k, 3) runs along it and ends with it at both ends; else ""."""
    shape, length = section(member.family, member.values()), member.values()["length"]
    outer = shape.loops[0]
    size = float(np.ptp(outer, axis=0).max())
    sweep = sweep_of_member(member)
    for points in strips:
        local = sweep.coordinates(points)
        away = _off_hull(member, local[:, :2])
        reach = _SIGMAS * member.sigma_m + _ROWS * length / len(points)
        ends = float(local[:, 2].min()), float(local[:, 2].max()) - length
        widest = size if _is_thin(local[:, :2], member.sigma_m) else _NEAR * size if _is_hidden_by(member, local, reach) else 0.0
        is_along = float(np.ptp(local[:, :2], axis=0).max()) < widest and float(away.max()) < _NEAR * size
        if is_along and max(abs(end) for end in ends) < reach and _runs_along(np.clip(local[:, 2], 0, length), length):
            off = MILLIMETRES_PER_METRE * float(np.median(away))
            return (
                f"{len(points)} points, an object of their own, run along the {member.family} member {off:.3g} mm off it and end where it ends: "
                "it is only part of what was scanned, or something else lies beside it; scan the rest, or join them in labels.csv"
            )
    return ""


def _is_thin(xy: FloatArray, sigma_m: float) -> bool:
    """Whether points (n, 2) across the member lie on a strip."""
    thick, wide = np.sqrt(12 * np.maximum(np.linalg.eigvalsh(np.cov(xy.T)), 0.0))
    return bool(thick < max(_FLAT * wide, _THICK_SIGMAS * sigma_m))


def _is_hidden_by(member: Member, local: FloatArray, reach_m: float) -> bool:
    """Whether points (n, 3) in the member's frame lie beyond a face of it that nobody saw."""
    if member.family in ROUND:
        return False
    unseen = [face for face in straight_faces(member)[0] if member.seen.get(face.name, 1.0) < SEEN]
    beyond = [(face.outward * (local[:, face.axis] - face.place) > -reach_m).mean() for face in unseen]
    return max(beyond, default=0.0) > _BEYOND


def _off_hull(member: Member, xy: FloatArray) -> FloatArray:
    """(n,) how far points (n, 2) across the member lie beyond the hull of its section, negative within: to the farthest of its sides."""
    if member.family in ROUND:
        return np.hypot(xy[:, 0], xy[:, 1]) - member.values()["d"] / 2
    away = np.full(len(xy), -np.inf)
    for a, b, c in ConvexHull(section(member.family, member.values()).loops[0]).equations:
        np.maximum(away, xy[:, 0] * a + xy[:, 1] * b + c, out=away)
    return away


def _is_crowd(n: int, n_strays: int, share: float) -> bool:
    """Whether n strays about one place are more than chance brings there and twice their share, were all even over the box of the points."""
    expected = n_strays * min(share, 1.0)
    return n >= _LEAST and n > 2 * expected and float(pdtrc(n - 1, expected)) * n_strays < _BY_CHANCE


def _runs_along(z: FloatArray, length: float) -> bool:
    """Whether points at heights z (n,) are found at both ends of the member and in most stretches between."""
    counts = np.bincount(np.minimum((z / length * _SLICES).astype(int), _SLICES - 1), minlength=_SLICES)
    held = counts >= _IN_EACH * len(z) / _SLICES
    return bool(held[0] and held[-1] and held.sum() >= _MOST)
