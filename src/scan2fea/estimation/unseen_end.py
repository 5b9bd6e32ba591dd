"""Was the scan cut off at one end? Where the face of one end was scanned and that of the other was not, the member may go on there.

Nothing is said where the face could not be seen all the same: no known sensor looked at it, or the sides were not seen all round either, or it rests
on a plane. Where sight lines pass beyond the end, the member stops there. Else nobody can tell how long it is: what was scanned is a lower bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scan2fea.estimation.ends import Ends
from scan2fea.estimation.resting import stands_on
from scan2fea.estimation.solid import swept
from scan2fea.estimation.straight import straight_faces
from scan2fea.kernel.pinned import SEEN
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.kernel.sections import PARAMETERS, ROUND
from scan2fea.kernel.sweep import axis_at, sweep_of
from scan2fea.types import FloatArray, Footing, Member, Scan
from scan2fea.units import MILLIMETRES_PER_METRE

_LIKELY = 0.5  # belief that one face alone was scanned
_MOST = 0.5  # of the length of faces that look one way: of a flange the far side looks that way too, and is the shorter
_LOOKED = 0.26  # cosine of sight line and normal: beyond 75 degrees hardly a ray comes back from a face
_REACH = 6.0  # sigma beyond an end, and off a surface
_AIMED = 8  # sight lines that would have met it, had it gone on


def unseen_end(scan: Scan, ends: Ends, member: Member, footings: Sequence[Footing] = (), joined: tuple[bool, bool] = (False, False)) -> str:
    """Why the length is not told; "" where it is. scan : of the member, with every sight line that is known.   footings : planes beside it.

    joined : whether its low end and its high one lie on a neighbour that it was cut off.
    """
    high_is_bare, low_is_bare = (share > _LIKELY for share in ends.alone)
    if not (high_is_bare or low_is_bare) or joined[int(high_is_bare)] or not _seen_all_round(member):
        return ""
    sweep = sweep_of(member)
    z = sweep.length_m if high_is_bare else 0.0
    T, normal = sweep.T_world_member, sweep.end_normals[int(high_is_bare)]
    place = T[:3, :3] @ np.array([*axis_at(sweep, np.array([z]))[0][0], z]) + T[:3, 3]
    if any(on is not None and on[0] != high_is_bare for on in (stands_on(member, footing) for footing in footings)) or _rests(scan, member, z):
        return ""
    origins = _origins(scan)
    if len(origins):
        away = origins - place
        looked = away @ (T[:3, :3] @ normal) > _LOOKED * np.linalg.norm(away, axis=1)
        if not looked.any() or _passed(scan, member, z, place):
            return ""
    at = ", ".join(f"{x:.4g}" for x in place)
    return (
        f"the face of one end was scanned and nothing of the other's: the scan may have been cut off there, at ({at}) m, and "
        f"{MILLIMETRES_PER_METRE * sweep.length_m:.5g} mm is the least that the member can be long; scan that end too, or, "
        "where nothing was cut off, say so (whole = true, or its length as fixed)"
    )


def _seen_all_round(member: Member) -> bool:
    """Whether most of what looks to each of four sides was seen: then whoever scanned it went round it."""
    if member.family in ROUND:
        return member.seen.get("OUTER", 1.0) > _MOST
    for side in ((axis, outward) for axis in (0, 1) for outward in (-1.0, 1.0)):
        faces = [face for face in straight_faces(member)[0] if (face.axis, face.outward) == side]
        seen = sum(face.high - face.low for face in faces if member.seen.get(face.name, 1.0) >= SEEN)
        if seen <= _MOST * sum(face.high - face.low for face in faces):
            return False
    return True


def _rests(scan: Scan, member: Member, z: float) -> bool:
    """Whether points stand for a face on a plane near that end."""
    if scan.cloud.is_inferred is None:
        return False
    T = member.T_world_member
    heights = (scan.cloud.points[scan.cloud.is_inferred] - T[:3, 3]) @ T[:3, 2]
    return bool((np.abs(heights - z) < _reach(member)).any())


def _reach(member: Member) -> float:
    return max(_REACH * member.sigma_m, 0.1 * _size(member))


def _size(member: Member) -> float:
    return max(member.values()[name] for name in PARAMETERS[member.family])


def _origins(scan: Scan) -> FloatArray:
    """(k, 3) places that the member's points were seen from."""
    if scan.rays is None or not (scan.cloud.ray >= 0).any():
        return np.zeros((0, 3))
    return np.unique(scan.rays.origin[np.unique(scan.cloud.ray[scan.cloud.ray >= 0])], axis=0)


def _passed(scan: Scan, member: Member, z: float, place: FloatArray) -> bool:
    """Whether sight lines pass where the member would go on for as far as it is wide."""
    rays, size = scan.rays, _size(member)
    if rays is None:
        return False
    T = np.array(member.T_world_member)
    way = T[:3, 2] * (1.0 if z > 0 else -1.0)
    gap = _REACH * member.sigma_m
    T[:3, 3] = place + way * (gap if z > 0 else gap + size)
    n = len(member.parameters) - 1
    parameters = (*member.parameters[:n], replace(member.parameters[n], value_m=size))
    square = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    beyond = replace(
        member, parameters=parameters, T_world_member=T, bow=np.zeros((2, 0)), twist=np.zeros(0), end_normals=square, change=None, bends=()
    )
    entry, _ = first_hits(scene_of(swept(beyond)), rays.origin, rays.direction)
    reach = np.where(np.isnan(rays.range_m), np.inf, rays.range_m)
    aimed = np.isfinite(entry) & (reach > entry - gap)
    return bool(aimed.sum() >= _AIMED and (reach[aimed] > entry[aimed] + gap).mean() > 0.5)
