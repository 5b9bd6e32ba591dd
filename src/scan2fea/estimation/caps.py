"""Solid or hollow: what is known of the inside of a bar or a tube.

From outside both are alike. The inner face tells, where it was seen; else the end planes do: a cap that was scanned is full or a ring.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.estimation.outline import outline_distance, section_distance
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.sections import drawn, section, section_area
from scan2fea.types import FloatArray, Member, Section

SOLID, HOLLOW, UNKNOWN = "solid", "hollow", "unknown"
FLATTEST_TUBE = 6.1  # h / b: the flattest tube of sections.csv has 6.004 (54 of 552 have more than 3, 15 more than 4); what is flatter is a plate
_DEEP = 4.0  # sigma below a face: one point of a side in 30,000 gets there
_THICKEST = 0.25  # of the smaller side: no wall is thicker (sections.csv: 0.18 at most), so the ring of a tube's cap stays out of the core
_NEAR = 0.002  # of the length: what an end plane is good to where the noise is less
_CAP, _LEAST = 1 / 3, 10.0  # a cap that was scanned is at least that dense against the sides, and shows that many points
_EMPTY = 0.1  # of a full cap
_SHORT = 3.0  # widths: shorter things that are hollow are as often pots as tubes


def inside_of(points: FloatArray, member: Member) -> str:
    """SOLID, HOLLOW or UNKNOWN. points : (n, 3) metres, of the member. Open sections show their walls, and a plate is no tube: solid.

    Of a short tube both ends must be seen to be open.
    """
    values = member.values()
    if member.family not in ("rect", "round", "RHS", "CHS"):
        return SOLID
    if member.family == "rect" and max(values["b"], values["t"]) > FLATTEST_TUBE * min(values["b"], values["t"]):
        return SOLID
    if any(p.name == "t" and p.observable for p in member.parameters) and member.family in ("RHS", "CHS"):
        is_short = values["length"] < _SHORT * float(np.ptp(section(member.family, values).loops[0], axis=0).max())
        return UNKNOWN if is_short and not _opens(points, member) else HOLLOW
    return ends_show(points, member)


def full_ends(points: FloatArray, member: Member) -> str:
    """Why a tube is none: the end of one whose wall nobody saw is full, or both ends of any. Empty otherwise. points : (n, 3) metres, of the member.

    A tube with lids looks so from outside, but nobody has seen that it is one. A pocket in a bar shows a piece of an inner face.
    """
    if member.family not in ("RHS", "CHS"):
        return ""
    ends = _ends(points, member)
    is_seen = any(p.name == "t" and p.observable for p in member.parameters)
    both = min(ends.full) > _CAP * ends.expected and sum(ends.full) > _LEAST
    if not (both if is_seen else max(ends.full) > ends.limit):
        return ""
    return (
        f"the end faces of the {member.family} member are full, and {'little' if is_seen else 'nothing'} of its inside was seen: a solid bar of "
        "another outline, or a tube with lids"
    )


def _opens(points: FloatArray, member: Member) -> bool:
    """Whether the inner face of a tube was seen up to both its ends, or the rings of these: what is short and closed below is a pot."""
    values = member.values()
    shape = section(member.family, values)
    local = sweep_of_member(member).coordinates(points)
    side, edge, _ = outline_distance(shape, local[:, :2])
    skin, n_outer = _DEEP * member.sigma_m, len(shape.loops[0])
    within = (edge >= n_outer) & (np.abs(side) < skin)
    perimeter = float(np.linalg.norm(np.roll(shape.loops[1], -1, axis=0) - shape.loops[1], axis=1).sum())
    outer = float(np.linalg.norm(np.roll(shape.loops[0], -1, axis=0) - shape.loops[0], axis=1).sum())
    density = float(((edge < n_outer) & (np.abs(side) < skin)).sum()) / (outer * values["length"])
    stretch = max(values["t"], _LEAST / (_CAP * density * perimeter)) if density > 0 else values["length"]
    for z, normal in zip((0.0, values["length"]), member.end_normals, strict=True):
        away = np.abs((local - np.array([0.0, 0.0, z])) @ normal)
        ring = (edge >= n_outer) & (side < -0.5 * skin) & (away < skin)  # nearer to the inner face: a dish has left the plane there
        if int(((within & (away < stretch)) | ring).sum()) < _CAP * density * perimeter * stretch:
            return False
    return True


def ends_show(points: FloatArray, member: Member) -> str:
    """What the points at the two end planes show: a full cap, a ring about an empty middle, or neither."""
    ends = _ends(points, member)
    if max(ends.full) > ends.limit:
        return SOLID
    best = int(np.argmax(ends.ring))
    is_ring = ends.ring[best] > _LEAST and _CAP * ends.expected > _LEAST and ends.full[best] < _EMPTY * ends.expected
    return HOLLOW if is_ring else UNKNOWN


@dataclass(frozen=True, kw_only=True)
class _Ends:
    """Points of each end plane in the core of the section, and off its outline, without clutter; those of a full cap's core as dense as the sides."""

    full: tuple[int, ...]
    ring: tuple[int, ...]
    expected: float

    @property
    def limit(self) -> float:
        """Points of a core of which more are a full cap."""
        return max(_LEAST, _CAP * self.expected)


def _ends(points: FloatArray, member: Member) -> _Ends:
    outline, length = drawn(member.family, member.values()).loops[0], member.values()["length"]  # the wall, where only guessed, may not go with it
    narrow = float(np.ptp(outline, axis=0).min())
    skin = _DEEP * member.sigma_m
    core = max(skin, _THICKEST * narrow)
    shape = Section(family=member.family, loops=(outline,), face_names=(("",) * len(outline),))
    local = sweep_of_member(member).coordinates(points)
    depth = -section_distance(member.family, member.values(), local[:, :2], filled=True)
    reach = max(skin, _NEAR * length)
    full, ring = [], []
    for z, normal in zip((0.0, length), member.end_normals, strict=True):
        away = np.abs((local - np.array([0.0, 0.0, z])) @ normal)
        here, beside = away < reach, np.abs(away - 2 * reach) < reach / 2  # as much space, beside the end plane: clutter
        full.append(int((here & (depth > core)).sum()) - int((beside & (depth > core)).sum()))
        ring.append(int((here & (depth > skin)).sum()) - int((beside & (depth > skin)).sum()))
    perimeter = float(np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1).sum())
    left = np.maximum(1 - 2 * core / np.ptp(outline, axis=0), 0.0)
    expected = float((np.abs(depth) < skin).sum()) / (perimeter * length) * section_area(shape) * float(np.prod(left))
    return _Ends(full=tuple(full), ring=tuple(ring), expected=expected)
