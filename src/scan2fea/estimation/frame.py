"""Members to a wireframe: axes that meet within their sections are joined in nodes (frame.json)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.kernel.outline import outline, outline_moments
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.kernel.sweep import Sweep, sweep_of, swept_points
from scan2fea.types import FloatArray, IntArray, Member, Value

SIGMAS = 3.0  # of the uncertainty of both lengths
PARALLEL_DEG = 10.0  # axes closer than that meet end to end only
SAME_SHARE = 0.5  # stations on one member nearer than that share of its section are one node


@dataclass(frozen=True, eq=False, kw_only=True)
class Wireframe(Value):
    """nodes : (n, 3) metres.   elements : (m, 2) nodes.   member : (m,) which member each element is part of.   sections : per member its index in
    `section_rows`.   section_rows : family and dimensions, equal ones (to their standard deviations) once.   up : (members, 3) the section's y axis.
    offset_m : (m, 2) distance of the node from the member's own axis at the two ends of each element.
    """

    nodes: FloatArray
    elements: IntArray
    member: IntArray
    sections: IntArray
    section_rows: tuple[Mapping[str, Any], ...]
    up: FloatArray
    offset_m: FloatArray


@dataclass(kw_only=True)
class _Station:
    """A place on the axis of a member, and where others would have it."""

    member: int
    at_m: float
    proposals: list[FloatArray]
    is_end: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class _Axis(Value):
    """The straight line through the centroids of the end sections. reach_m : radius of the section.   error_m : of its ends."""

    start: FloatArray
    along: FloatArray
    length_m: float
    reach_m: float
    error_m: float

    def at(self, at_m: float) -> FloatArray:
        return np.asarray(self.start + at_m * self.along)


def frame(members: Sequence[Member]) -> Wireframe:
    """The wireframe of members: every member from its first to its last end, cut where others meet it.

    Two members are joined where their axes come within both sections and three standard deviations of their lengths; the node lies where the axes,
    lengthened by as much, pass each other. Raises StageError where the dimensions of a member make no solid.
    """
    axes = [_axis_of(member) for member in members]
    stations = [[_Station(member=k, at_m=at, proposals=[], is_end=True) for at in (0.0, axis.length_m)] for k, axis in enumerate(axes)]
    joined: list[tuple[_Station, _Station]] = []
    for i, j in itertools.combinations(range(len(axes)), 2):
        for at_i, at_j in _meetings(axes[i], axes[j]):
            pair = _station(stations[i], axes[i], i, at_i, axes[j]), _station(stations[j], axes[j], j, at_j, axes[i])
            pair[0].proposals.append(axes[i].at(at_i))
            pair[1].proposals.append(axes[j].at(at_j))
            joined.append(pair)
    return _assembled(members, axes, stations, joined)


def frame_rows(wireframe: Wireframe, names: Sequence[str] | None = None) -> dict[str, Any]:
    """frame.json as plain values. names : of the members; 0, 1, ... without."""
    called = list(names) if names is not None else [str(k) for k in range(len(wireframe.sections))]
    members = []
    for k, name in enumerate(called):
        rows = np.flatnonzero(wireframe.member == k)
        members.append(
            {
                "name": name,
                "section": int(wireframe.sections[k]),
                "up": [float(x) for x in wireframe.up[k]],
                "elements": [[int(a), int(b)] for a, b in wireframe.elements[rows]],
                "offset_m": [[float(a), float(b)] for a, b in wireframe.offset_m[rows]],
            }
        )
    nodes = [[float(x) for x in node] for node in wireframe.nodes]
    return {"unit": "m", "nodes": nodes, "members": members, "sections": [dict(row) for row in wireframe.section_rows]}


def _axis_of(member: Member) -> _Axis:
    sweep: Sweep = sweep_of(member)
    shape = outline(member.family, member.values())
    area, moment = outline_moments(shape)
    centroid = moment / area
    start, end = swept_points(sweep, centroid[None], np.array([0.0, 1.0]))[:, 0]
    length = float(np.linalg.norm(end - start))
    reach = max(float(np.linalg.norm(edge.start - centroid)) for loop in shape.loops for edge in loop)
    error = next((p.std_m for p in member.parameters if p.name == "length"), None)
    return _Axis(start=start, along=(end - start) / length, length_m=length, reach_m=reach, error_m=error or 0.0)


def _meetings(a: _Axis, b: _Axis) -> list[tuple[float, float]]:
    """Places along both axes where they meet; none or one, but for parallel members that meet at both ends."""
    within = a.reach_m + b.reach_m + SIGMAS * math.hypot(a.error_m, b.error_m)
    cosine = float(a.along @ b.along)
    if abs(cosine) > math.cos(math.radians(PARALLEL_DEG)):
        ends = itertools.product((0.0, a.length_m), (0.0, b.length_m))
        return [(s, t) for s, t in ends if np.linalg.norm(a.at(s) - b.at(t)) <= within]
    between = b.start - a.start
    s = float((between @ a.along - cosine * (between @ b.along)) / (1 - cosine**2))
    t = s * cosine - float(between @ b.along)
    if _gap(a, b, s) > within:
        return []
    return [(min(max(s, -within), a.length_m + within), min(max(t, -within), b.length_m + within))]


def _gap(a: _Axis, b: _Axis, at_m: float) -> float:
    """Distance of two axes as they are, from the place on a's line that is nearest to b's (Ericson 2005, 5.1.9)."""
    on_a = a.at(min(max(at_m, 0.0), a.length_m))
    on_b = b.at(min(max(float((on_a - b.start) @ b.along), 0.0), b.length_m))
    on_a = a.at(min(max(float((on_b - a.start) @ a.along), 0.0), a.length_m))
    return float(np.linalg.norm(on_a - on_b))


def _station(of: list[_Station], axis: _Axis, number: int, at_m: float, other: _Axis) -> _Station:
    """The end of the member where the other one meets it there, a station that is there already, or a new one between."""
    near_end = axis.reach_m + other.reach_m + SIGMAS * math.hypot(axis.error_m, float(axis.along @ other.along) * other.error_m)
    for end in of[:2]:
        if abs(at_m - end.at_m) <= near_end or (at_m < 0 and end.at_m == 0) or (at_m > axis.length_m and end.at_m > 0):
            return end
    for station in of[2:]:
        if abs(at_m - station.at_m) <= SAME_SHARE * axis.reach_m:
            return station
    new = _Station(member=number, at_m=at_m, proposals=[], is_end=False)
    of.append(new)
    return new


def _assembled(members: Sequence[Member], axes: list[_Axis], stations: list[list[_Station]], joined: list[tuple[_Station, _Station]]) -> Wireframe:
    flat = [station for of in stations for station in of]
    number = {id(station): k for k, station in enumerate(flat)}
    root = list(range(len(flat)))

    def find(k: int) -> int:
        while root[k] != k:
            k = root[k]
        return k

    for a, b in joined:
        low, high = sorted((find(number[id(a)]), find(number[id(b)])))
        root[high] = low
    groups: dict[int, list[_Station]] = {}
    for k, station in enumerate(flat):
        groups.setdefault(find(k), []).append(station)
    node_of = {id(station): n for n, group in enumerate(groups.values()) for station in group}
    nodes = np.array([_node(group, axes) for group in groups.values()]).reshape(-1, 3)
    elements, member, offset = [], [], []
    for k, of in enumerate(stations):
        for a, b in itertools.pairwise(sorted(of, key=lambda station: station.at_m)):
            ends = [node_of[id(a)], node_of[id(b)]]
            if ends[0] != ends[1]:
                elements.append(ends)
                member.append(k)
                offset.append([_off_axis(nodes[n], axes[k]) for n in ends])
    sections, rows = _sections(members)
    return Wireframe(
        nodes=nodes,
        elements=np.array(elements, np.int64).reshape(-1, 2),
        member=np.array(member, np.int64),
        sections=sections,
        section_rows=rows,
        up=np.array([m.T_world_member[:3, 1] for m in members]).reshape(-1, 3),
        offset_m=np.array(offset).reshape(-1, 2),
    )


def _node(group: list[_Station], axes: list[_Axis]) -> FloatArray:
    """On the member that goes through where one does, else half-way between those that end there; a free end is where it is."""
    through = [station for station in group if not station.is_end]
    proposals = [p for station in through or group for p in station.proposals]
    if not proposals:
        return axes[group[0].member].at(group[0].at_m)
    return np.asarray(np.mean(proposals, axis=0))


def _off_axis(node: FloatArray, axis: _Axis) -> float:
    away = node - axis.start
    return float(np.linalg.norm(away - (away @ axis.along) * axis.along))


def _sections(members: Sequence[Member]) -> tuple[IntArray, tuple[Mapping[str, Any], ...]]:
    """Members of one family whose dimensions agree within three standard deviations share a section (the first one's)."""
    rows: list[dict[str, Any]] = []
    first: list[Member] = []
    index = []
    for member in members:
        k = next((k for k, other in enumerate(first) if _same_section(member, other)), len(first))
        if k == len(first):
            first.append(member)
            values = member.values()
            area, _ = outline_moments(outline(member.family, values))
            rows.append({"family": member.family, "parameters_m": {n: values[n] for n in PARAMETERS[member.family]}, "area_m2": area})
        index.append(k)
    return np.array(index, np.int64), tuple(rows)


def _same_section(a: Member, b: Member) -> bool:
    if a.family != b.family:
        return False
    other = {p.name: p for p in b.parameters}
    for p in a.parameters:
        if p.name in PARAMETERS[a.family]:
            q = other[p.name]
            if abs(p.value_m - q.value_m) > SIGMAS * math.hypot(p.std_m or 0.0, q.std_m or 0.0) + 1e-9:
                return False
    return True
