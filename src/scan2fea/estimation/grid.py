"""The section of a solid cut into triangles for layered tets: rectangles for straight-edged sections, rings for round ones."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InternalError, StageError, require
from scan2fea.types import FloatArray, IntArray, Value

STEP = 1.3  # of the chords of the rim: depth of the ring below it, between their length and that of chords twice as long


@dataclass(frozen=True, eq=False, kw_only=True)
class Grid(Value):
    """points : (n, 2) metres.   triangles : (k, 3) counter-clockwise.   rim : (r, 2) border edges.   rim_loop, rim_edge : (r,) the loop of the
    polygon and its edge that each lies on.
    """

    points: FloatArray
    triangles: IntArray
    rim: IntArray
    rim_loop: IntArray
    rim_edge: IntArray


def is_orthogonal(loops: list[FloatArray]) -> bool:
    """Does every edge of the polygons run along x or y (to rounding)?"""
    return all(bool((np.abs(np.roll(loop, -1, axis=0) - loop).min(1) <= 1e-12 * np.abs(loop).max()).all()) for loop in loops)


def rectangle_grid(loops: list[FloatArray], chamfers: Sequence[FloatArray], edge_m: float) -> Grid:
    """An orthogonal section: cut at every corner and about every `edge_m` between. Raises StageError where an edge is oblique.

    chamfers : (3, 2) each, start, corner and end of a triangle that fills a re-entrant corner of `loops`, or is cut off another, in the order of the
    outline.
    """
    require(is_orthogonal(loops), StageError, "only sections whose edges run along two axes are cut into rectangles")
    corners = np.concatenate([*loops, *chamfers])
    xs, ys = (_divided(_distinct(corners[:, axis]), edge_m) for axis in (0, 1))
    middle = np.stack(np.meshgrid((xs[:-1] + xs[1:]) / 2, (ys[:-1] + ys[1:]) / 2, indexing="ij"), axis=-1).reshape(-1, 2)
    i, j = (a.ravel()[inside(loops, middle)] for a in np.meshgrid(np.arange(len(xs) - 1), np.arange(len(ys) - 1), indexing="ij"))
    a = i * len(ys) + j
    b, c, d = a + len(ys), a + len(ys) + 1, a + 1
    triangles = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
    points = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
    for start, corner, end in chamfers:
        is_cut = _turn(start, corner, end) > 0
        if is_cut:
            middle = points[triangles].mean(1)
            low, high = np.minimum(start, end), np.maximum(start, end)
            triangles = triangles[~((middle > low) & (middle < high)).all(1)]
        within = start + end - corner if is_cut else corner
        triangles = np.concatenate([triangles, ears(points, _border(points, start, within, end))])
    used, packed = np.unique(triangles, return_inverse=True)
    points, triangles = points[used], packed.reshape(-1, 3).astype(np.int64)
    return _with_rim(points, triangles, [_chamfered(loop, chamfers) for loop in loops])


def _turn(start: FloatArray, corner: FloatArray, end: FloatArray) -> float:
    """Above 0 where the way turns left."""
    (ax, ay), (bx, by) = corner - start, end - corner
    return float(ax * by - ay * bx)


def _border(points: FloatArray, start: FloatArray, corner: FloatArray, end: FloatArray) -> list[int]:
    """The points of the grid around a chamfer, counter-clockwise: the chamfer, then back along both sides of its corner."""
    back, out = _between(points, end, corner), _between(points, corner, start)
    return [int(out[-1]), *back.tolist(), *out[1:-1].tolist()]


def _between(points: FloatArray, start: FloatArray, end: FloatArray) -> IntArray:
    """The points of the grid on the straight way from start to end, in order, both included."""
    along = end - start
    length = float(np.linalg.norm(along))
    share = (points - start) @ along / length**2
    off = np.linalg.norm(points - start - share[:, None] * along, axis=1)
    rows = np.flatnonzero((off < 1e-9 * length) & (share > -1e-9) & (share < 1 + 1e-9))
    return np.asarray(rows[np.argsort(share[rows])])


def _chamfered(loop: FloatArray, chamfers: Sequence[FloatArray]) -> FloatArray:
    """The polygon with its chamfers, starting where `loop` starts."""
    out = []
    for corner in loop:
        found = next((c for c in chamfers if (c[1] == corner).all()), None)
        out.append(corner[None] if found is None else found[[0, 2]])
    return np.concatenate(out)


def strip_grid(loops: list[FloatArray], edge_m: float) -> Grid:
    """A tube whose outer corners are chamfered: every side cut alike outside and inside, about every `edge_m`; chamfers fan out from inner corners.

    Raises InternalError unless there are two outer corners for each inner one.
    """
    outer, hole = loops
    require(len(outer) == 2 * len(hole), InternalError, "a tube with chamfers has two outer corners for each inner one")
    inner = hole[np.argmin(np.linalg.norm(outer[:, None] - hole, axis=2), axis=1)]
    n_parts = np.maximum(1, np.ceil(np.linalg.norm(np.roll(outer, -1, axis=0) - outer, axis=1) / edge_m - 0.3)).astype(np.int64)
    sides = [_cut(side, n_parts) for side in (outer, inner)]
    wall = float(np.linalg.norm(sides[0] - sides[1], axis=1).min())
    points, triangles = _rings(sides[0], sides[1], max(1, round(wall / edge_m)), len(sides[0]))
    _, first, packed = np.unique(np.round(points / (1e-9 * np.ptp(outer))), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    triangles = np.argsort(order)[packed.ravel()[triangles]]
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return _with_rim(points[first[order]], triangles[whole].astype(np.int64), loops)


def _cut(polygon: FloatArray, n_parts: IntArray) -> FloatArray:
    """The polygon with its edges cut into so many parts."""
    parts = [a + (b - a) * (np.arange(n) / n)[:, None] for a, b, n in zip(polygon, np.roll(polygon, -1, axis=0), n_parts, strict=True)]
    return np.concatenate(parts)


def _rings(outer: FloatArray, inner: FloatArray, n_rows: int, n: int) -> tuple[FloatArray, IntArray]:
    """Rings of n places from the inner to the outer one, and the triangles between them."""
    share = np.arange(n_rows + 1)[:, None, None] / n_rows
    points = ((1 - share) * inner + share * outer).reshape(-1, 2)
    row, k = (a.ravel() for a in np.meshgrid(np.arange(n_rows), np.arange(n), indexing="ij"))
    a, b = row * n + k, row * n + (k + 1) % n
    triangles = np.stack([a, a + n, b + n, a, b + n, b], axis=1).reshape(-1, 3)
    return points, triangles.astype(np.int64)


def ring_grid(loops: list[FloatArray], edge_m: float) -> Grid:
    """A round section between regular polygons: rings of as many places; a full one gets rings of 6, 12, 18, ... places about its centre.

    Raises InternalError where a full section has a number of corners that 6 does not divide.
    """
    outer = loops[0]
    n = len(outer)
    if len(loops) == 1:
        require(n % 6 == 0, InternalError, f"a full round section of {n} corners; 6 must divide them")
        return _with_rim(*_coarsened(outer, edge_m), loops)
    inner = np.roll(loops[1][::-1], 1, axis=0)  # both from the same angle, counter-clockwise
    n_rows = max(1, round(float(np.linalg.norm(outer[0] - inner[0])) / edge_m))
    return _with_rim(*_rings(outer, inner, n_rows, n), loops)


def _coarsened(outer: FloatArray, edge_m: float) -> tuple[FloatArray, IntArray]:
    """`_disc`, where the elements asked for are longer than the chords: every ring below the rim has half the places of that above it, as long as its
    chords stay within `edge_m` and 6 divides its places. The rim needs its chords for the shape, the inside does not.
    """
    n = len(outer)
    centre = outer.mean(0)
    chord = float(np.linalg.norm(outer[1] - outer[0]))
    share = 1 - STEP * chord / float(np.linalg.norm(outer[0] - centre))  # of the radius: where the next ring lies
    if n % 12 or n < 24 or 2 * chord * share > edge_m:
        return _disc(outer)
    inner = centre + share * (outer[::2] - centre)
    points, triangles = _coarsened(inner, edge_m)
    k, rim = np.arange(n // 2), len(points)
    low = rim - n // 2 + k  # a disc ends with its rim
    after = np.roll(low, -1)
    first, middle, last = rim + 2 * k, rim + 2 * k + 1, rim + (2 * k + 2) % n
    more = np.concatenate([np.stack([low, first, middle], 1), np.stack([low, middle, after], 1), np.stack([after, middle, last], 1)])
    return np.concatenate([points, outer]), np.concatenate([triangles, more]).astype(np.int64)


def _disc(outer: FloatArray) -> tuple[FloatArray, IntArray]:
    """Rings j = 1 ... m of 6 j places, the last one the polygon itself; between rings, six equal sectors of 2 j - 1 triangles."""
    m = len(outer) // 6
    centre = outer.mean(0)
    radius = float(np.linalg.norm(outer[0] - centre))
    start = float(np.arctan2(*(outer[0] - centre)[::-1]))
    points = [centre[None]]
    for j in range(1, m):
        angle = start + 2 * np.pi * np.arange(6 * j) / (6 * j)
        points.append(centre + radius * j / m * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    points.append(outer)
    first = [0, *(1 + 3 * j * (j - 1) for j in range(1, m + 1))]
    triangles = []
    for j, sector in itertools.product(range(1, m + 1), range(6)):
        below = [first[j - 1] + (sector * (j - 1) + k) % max(6 * (j - 1), 1) for k in range(j)]
        above = [first[j] + (sector * j + k) % (6 * j) for k in range(j + 1)]
        triangles += [[below[k], above[k], above[k + 1]] for k in range(j)]
        triangles += [[below[k], above[k + 1], below[k + 1]] for k in range(j - 1)]
    return np.concatenate(points), np.array(triangles, np.int64)


def _distinct(values: FloatArray) -> FloatArray:
    """Ascending, equal to rounding counted once."""
    ordered = np.sort(values)
    return np.asarray(ordered[np.concatenate([[True], np.diff(ordered) > 1e-9 * np.ptp(ordered)])])


def _divided(cuts: FloatArray, edge_m: float) -> FloatArray:
    parts = [np.linspace(a, b, max(1, int(np.ceil((b - a) / edge_m - 0.3))) + 1)[:-1] for a, b in itertools.pairwise(cuts)]
    return np.concatenate([*parts, cuts[-1:]])


def inside(loops: list[FloatArray], at: FloatArray) -> IntArray:
    """Which of the points (n, 2) lie inside, by crossings of a ray."""
    crossings = np.zeros(len(at), np.int64)
    for loop in loops:
        for (ax, ay), (bx, by) in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            spans = (ay > at[:, 1]) != (by > at[:, 1])
            with np.errstate(divide="ignore", invalid="ignore"):
                crossings += spans & (at[:, 0] < ax + (at[:, 1] - ay) * (bx - ax) / (by - ay))
    return np.flatnonzero(crossings % 2)


def _with_rim(points: FloatArray, triangles: IntArray, loops: list[FloatArray]) -> Grid:
    """Border edges, each with the edge of the polygon that its middle is nearest to."""
    edge = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    _, first, count = np.unique(np.sort(edge, axis=1), axis=0, return_index=True, return_counts=True)
    rim = edge[np.sort(first[count == 1])]
    middle = points[rim].mean(1)
    start, end = np.concatenate(loops), np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    along = end - start
    share = np.einsum("rek,ek->re", middle[:, None] - start, along) / (along**2).sum(1)
    off = np.linalg.norm(middle[:, None] - (start + np.clip(share, 0, 1)[..., None] * along), axis=2)
    nearest = off.argmin(1)
    which = np.concatenate([np.full(len(loop), i) for i, loop in enumerate(loops)])
    number = np.concatenate([np.arange(len(loop)) for loop in loops])
    return Grid(points=points, triangles=triangles, rim=rim, rim_loop=which[nearest].astype(np.int64), rim_edge=number[nearest].astype(np.int64))


def ears(corners: FloatArray, polygon: list[int]) -> IntArray:
    """Triangles (n - 2, 3) of the polygon through the given corners, counter-clockwise: each time the ear that is nearest to equilateral."""
    left = list(polygon)
    triangles = []
    while len(left) > 3:
        best, at = 0.0, -1
        for i in range(len(left)):
            trio = (left[i - 1], left[i], left[(i + 1) % len(left)])
            quality = _ear_quality(corners[list(trio)])
            if quality > best and not _holds(corners[list(trio)], corners[[v for v in left if v not in trio]]):
                best, at = quality, i
        require(at >= 0, InternalError, "the outline of a section crosses itself")
        triangles.append([left[at - 1], left[at], left[(at + 1) % len(left)]])
        del left[at]
    return np.array([*triangles, left], np.int64)


def _ear_quality(trio: FloatArray) -> float:
    """Twice the area over the sum of squared edges; negative where the corner is re-entrant."""
    (ax, ay), (bx, by), (cx, cy) = trio
    squares = float(((trio - np.roll(trio, 1, axis=0)) ** 2).sum())
    return float((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) / squares


def _holds(trio: FloatArray, others: FloatArray) -> bool:
    """Does any of the points (n, 2) lie in or on the triangle?"""
    inside = np.full(len(others), True)
    for k in range(3):
        a, b = trio[k], trio[(k + 1) % 3]
        inside &= (b[0] - a[0]) * (others[:, 1] - a[1]) - (b[1] - a[1]) * (others[:, 0] - a[0]) >= 0
    return bool(inside.any())
