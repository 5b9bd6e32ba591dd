"""Outer faces of which one part was seen and another is bare from end to end: the section is open there.

Nothing of the member itself can hide a part of a face that lies on the hull of its section: who sees one part of it sees all. A lipped channel looks
like a tube whose wall is bare between the lips, a zed like an I without half of each flange. `holes.py` and `cuts.py` ask what is enclosed, or was
seen beside on both sides of a wall; here the face is bare along the whole member. Where the other side of the wall was seen the wall is whole; a full
section has no other side. Within a tube nothing hides a part of a wall either, and lips may lie on its inner side. Another body that lies on the face
may hide it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import chdtrc

from scan2fea.estimation.anneal import walls
from scan2fea.estimation.attached import CORNER
from scan2fea.estimation.bare_toes import ROUNDED
from scan2fea.estimation.explain import TOLERANCE
from scan2fea.estimation.holes import VOID_POINTS, Covers, Hole, uncovered
from scan2fea.estimation.outline import edge_lengths, first_across, inward, outline_distance
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.sections import ROUND, section
from scan2fea.types import BoolArray, FloatArray, IntArray, Member, Section

_SIGMAS = 4.0
_A_BIN, _FEWEST, _MOST = 12.0, 4, 64  # points of the face on average, and bins
_BARE = 0.1  # of the points of the fullest bin
_WIDER = 3.0  # times any other bare run: gaps between the lines of a scanner are alike
_LINES = 2.0  # distances between points: of four rasters together, of which lines run along the member, none leaves a wider strip
_CHANCE = 1e-3
_PLACES = 8  # along the member, at which it is asked whether a body lies there


def open_face(points: FloatArray, member: Member, covers: Covers = ()) -> str:
    """Why an outer face shows that the section is open; "" where none does. points : (n, 3) metres.   covers : of each other body around."""
    if member.family in ROUND:
        return ""
    shape, values, sigma = section(member.family, member.values()), member.values(), member.sigma_m
    size = float(np.linalg.norm(np.ptp(shape.loops[0], axis=0)))
    local = sweep_of_member(member).coordinates(points)
    distance, edge, along = outline_distance(shape, local[:, :2])
    of_sides = (np.abs(distance) <= _SIGMAS * sigma + TOLERANCE * size) & (local[:, 2] > 0) & (local[:, 2] < values["length"])
    edge, along = edge[of_sides], along[of_sides]
    rounded = min((ROUNDED * values[name] for name in walls(member.family)), default=CORNER * float(np.ptp(shape.loops[0], axis=0).min()))
    clear = _SIGMAS * sigma + rounded  # of the corners, and of points of the faces beyond them
    names = [name for loop in shape.face_names for name in loop]
    closed = member.family == "RHS"
    if not closed and min((values[name] for name in walls(member.family)), default=math.inf) <= _SIGMAS * sigma:
        return ""  # nobody knows which side of the wall a point was seen on
    for k in _on_hull(shape):
        own = along[edge == k]
        behind = own[:0] if member.family == "rect" else _behind(shape, k, edge, along)
        limits, count = _bins(float(edge_lengths(shape)[k]), np.r_[own, behind] if closed else own, clear)
        if len(count) < _FEWEST:
            continue
        bare = count + (0 if closed else np.histogram(behind, limits)[0]) < _BARE * count.max()
        first, last = _widest(bare)
        apart_m = math.sqrt(float((~bare).sum()) * (limits[1] - limits[0]) * values["length"] / float(count[~bare].sum()))
        if (last - first) * float(count[~bare].mean()) <= VOID_POINTS:
            continue
        of_wall = own if closed else np.r_[own, behind]
        if limits[last] - limits[first] <= _LINES * apart_m and _in_lines(of_wall, limits, count, first, last):
            continue
        middle = np.linspace(0, values["length"], 2 * _PLACES + 1)[1::2]
        at = (limits[first:last] + limits[first + 1 : last + 1]) / 2
        step = max(float(limits[1] - limits[0]), values["length"] / _PLACES)
        places = np.stack(np.meshgrid(at, middle, indexing="ij"), -1).reshape(-1, 2)
        if uncovered([Hole(face=names[k], places=places, cell_m=step)], member, covers, sigma):
            return (
                f"{names[k]} of the {member.family} member is bare over {1e3 * (limits[last] - limits[first]):.0f} mm of its width from end to end, "
                "beside a part that was seen, and nothing was seen behind it: the section is open there, or something hid it; scan that side"
            )
    return ""


def _on_hull(shape: Section) -> list[int]:
    """Edges of the outline that no part of the section lies beyond."""
    corners = shape.loops[0]
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    into = inward(shape)[: len(corners)]
    return [k for k, at in enumerate(corners) if float(((corners - at) @ into[k]).min()) > -1e-9 * size]


def _bins(long_m: float, along: FloatArray, clear_m: float) -> tuple[FloatArray, IntArray]:
    """(m + 1,) limits of bins along an edge, m, and the points in each (m,); none where there is no place between its corners."""
    if long_m <= 2 * clear_m:
        return np.zeros(1), np.zeros(0, np.int64)
    inner = along[(along > clear_m) & (along < long_m - clear_m)]
    n = max(min(int(len(inner) / _A_BIN), _MOST), 1)
    limits = np.linspace(clear_m, long_m - clear_m, n + 1)
    return limits, np.histogram(inner, limits)[0]


def _behind(shape: Section, k: int, edge: IntArray, along: FloatArray) -> FloatArray:
    """How far along the edge k those points lie, m, that are on the other side of its wall: of which the way through the material leads to it."""
    start = np.concatenate(shape.loops)
    unit = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops]) / edge_lengths(shape)[:, None]
    into = inward(shape)
    opposite = np.flatnonzero(into @ into[k] < -0.999)
    rows = np.flatnonzero(np.isin(edge, opposite))
    own = edge[rows]
    at = start[own] + along[rows, None] * unit[own]
    hit, _ = first_across(at, into[own], shape, own)
    return np.asarray((at[hit == k] - start[k]) @ unit[k])


def _in_lines(along: FloatArray, limits: FloatArray, count: IntArray, first: int, last: int) -> bool:
    """Whether points across a face lie in lines: beside the bare strip a gap, or bins next to each other, differ as by chance in one of 1,000.

    limits, count : (m + 1,), (m,) of bins, of which those from `first` to before `last` are bare.
    """
    at = np.sort(along[(along > limits[0]) & (along < limits[-1])])
    gaps = np.diff(at)[(at[1:] <= limits[first]) | (at[:-1] >= limits[last])]
    one, two = (np.r_[count[k:first:2][: first // 2], count[last + k :: 2][: (len(count) - last) // 2]].astype(float) for k in (0, 1))
    if len(gaps) < _FEWEST or len(one) < _FEWEST:
        return True
    uneven = float(chdtrc(len(one), ((one - two) ** 2 / np.maximum(one + two, 1.0)).sum()))
    return uneven < _CHANCE or len(gaps) * math.exp(-len(gaps) * float(gaps.max()) / max(float(gaps.sum()), 1e-300)) < _CHANCE


def _widest(bare: BoolArray) -> tuple[int, int]:
    """First bin of the widest run of bare ones and the one after its last, where no other is nearly as wide; (0, 0) otherwise."""
    step = np.diff(np.r_[0, bare.astype(np.int64), 0])
    first, last = np.flatnonzero(step == 1), np.flatnonzero(step == -1)
    if len(first) == 0:
        return 0, 0
    wide = last - first
    top = int(wide.argmax())
    others = np.delete(wide, top)
    return (0, 0) if len(others) and wide[top] < _WIDER * others.max() else (int(first[top]), int(last[top]))
