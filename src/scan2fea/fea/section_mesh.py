"""A section cut into curved six-node triangles, fine where it matters: at re-entrant corners, along arcs.

Between its corners the torsion of a thin wall is a polynomial of degree 2, which long cells carry exactly; only corners need small ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InternalError
from scan2fea.kernel.outline import Edge, Outline, re_entrant
from scan2fea.kernel.sections import ROUND
from scan2fea.types import FloatArray, IntArray, Value

GRADES = (0.04, 0.15, 0.4, 1.0, 2.2)  # cuts beside a re-entrant corner, in walls
EDGES = (0.3, 0.9, 2.2)  # beside every other side: there the torsion of a wall dies away as exp(-pi x / t)
FILLET_CUTS = 3  # per leg of a root fillet
SECTORS = 8  # of a circle before it is refined; half of that of a rounded corner
WALL_SHARES = (0.0, 0.04, 0.15, 0.5, 0.85, 0.96)  # where the straight walls of a tube with rounded corners are cut
LEVEL = 1  # refinements: each cuts a triangle in four; one more changes no figure by 0.05 % (0.2 % of rounded tubes) in docs/fea.md
_SAME = 1e-9  # of the size of the section


@dataclass(frozen=True, eq=False, kw_only=True)
class SectionMesh(Value):
    """points : (n, 2) metres, corners and middles of sides.   triangles : (k, 6), corners, then the middles of sides 01 12 20."""

    points: FloatArray
    triangles: IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class _Coarse(Value):
    """points : (n, 2).   triangles : (k, 3), counter-clockwise.   arcs : (start, end, centre x, centre y) of sides that lie on a circle, by rows."""

    points: FloatArray
    triangles: IntArray
    arcs: FloatArray


def section_mesh(shape: Outline, level: int = LEVEL) -> SectionMesh:
    """The triangles of an outline with its true arcs, refined `level` times."""
    coarse = _coarse(shape)
    for _ in range(level):
        coarse = _refined(coarse)
    return _with_middles(coarse)


def _coarse(shape: Outline) -> _Coarse:
    if shape.family in ROUND:
        return _rings(shape)
    if shape.family == "RHS" and any(edge.centre is not None for edge in shape.loops[0]):
        return _rounded_tube(shape)
    return _rectangles(shape)


# ------------------------------------------------------------------ straight walls


def _rectangles(shape: Outline) -> _Coarse:
    """Rectangles between the lines of all sides and the cuts beside re-entrant corners, a patch in every fillet and under every rounded toe; of
    sloping flanges all but the arcs is made of level ones.
    """
    slant = shape.slant
    true = [_sharp(loop) for loop in shape.loops]
    loops = true if slant is None else [slant.level(loop) for loop in true]
    arcs = [edge for loop in shape.loops for edge in loop if edge.centre is not None]
    fillets = [_fillet(arc, true, shape) for arc in arcs]
    corners = np.concatenate(loops)
    size = float(np.ptp(corners, axis=0).max())
    walls = [_distinct(corners[:, axis], _SAME * size) for axis in (0, 1)]
    wall = min(float(np.diff(w).min()) for w in walls)
    turned = np.concatenate([loop[re_entrant(loop)] for loop in loops])
    xs, ys = (_cuts(walls[axis], turned[:, axis], fillets, axis, wall, size) for axis in (0, 1))
    middle = np.stack(np.meshgrid((xs[:-1] + xs[1:]) / 2, (ys[:-1] + ys[1:]) / 2, indexing="ij"), axis=-1).reshape(-1, 2)
    toes = [np.sort(fillet.ends, axis=0) for fillet in fillets if fillet.is_toe]
    is_left = ~np.any([((middle > low) & (middle < high)).all(1) for low, high in toes] or [np.zeros(len(middle), bool)], axis=0)
    i, j = (a.ravel()[np.intersect1d(_inside(loops, middle), np.flatnonzero(is_left))] for a in np.meshgrid(
        np.arange(len(xs) - 1), np.arange(len(ys) - 1), indexing="ij"
    ))  # fmt: skip
    a = i * len(ys) + j
    b, c, d = a + len(ys), a + len(ys) + 1, a + 1
    # diagonals in both directions: a symmetric section gets a symmetric mesh
    flip = ((xs[i] + xs[i + 1]) < xs[0] + xs[-1]) ^ ((ys[j] + ys[j + 1]) < ys[0] + ys[-1])
    one = np.where(flip[:, None], np.stack([a, b, d], 1), np.stack([a, b, c], 1))
    two = np.where(flip[:, None], np.stack([b, c, d], 1), np.stack([a, c, d], 1))
    grid = np.stack([np.repeat(xs, len(ys)), np.tile(ys, len(xs))], axis=1)
    grid = grid if slant is None else slant.sloped(grid)
    parts = [_Coarse(points=grid, triangles=np.concatenate([one, two]), arcs=np.zeros((0, 4)))]
    parts += [_fillet_patch(fillet.within, fillet.arc) for fillet in fillets]
    return _joined(parts, _SAME * size)


def _sharp(loop: Sequence[Edge]) -> FloatArray:
    """Corners of the straight edges, as if nothing were rounded."""
    straight = [edge for edge in loop if edge.centre is None]
    out = []
    for k, edge in enumerate(straight):
        before = straight[k - 1]
        directions = np.stack([before.end - before.start, edge.start - edge.end], axis=1)
        out.append(before.start + np.linalg.solve(directions, edge.start - before.start)[0] * (before.end - before.start))
    return np.array(out)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fillet(Value):
    """arc : that rounds a corner.   ends : (2, 2) where it begins and ends, and corner : (2,), where flanges are level.   within : (2,) of the patch
    beside the arc, the corner that opposes it.   is_toe : whether the arc cuts its corner off.
    """

    arc: Edge
    ends: FloatArray
    corner: FloatArray
    within: FloatArray
    is_toe: bool


def _fillet(arc: Edge, loops: Sequence[FloatArray], shape: Outline) -> _Fillet:
    if arc.centre is None:
        raise InternalError("a fillet without a centre")
    middle = (arc.start + arc.end) / 2 - arc.centre
    corners = np.concatenate(loops)
    corner = corners[np.linalg.norm(corners - arc.centre - middle / math.cos(arc.turn / 2) ** 2, axis=1).argmin()]
    level = np.stack([arc.start, arc.end, corner])
    level = level if shape.slant is None else shape.slant.level(level)
    opposed = level[0] + level[1] - level[2]
    within = corner if arc.turn < 0 else opposed if shape.slant is None else shape.slant.sloped(opposed[None])[0]
    return _Fillet(arc=arc, ends=level[:2], corner=level[2], within=within, is_toe=arc.turn > 0)


def _cuts(lines: FloatArray, corners: FloatArray, fillets: Sequence[_Fillet], axis: int, wall: float, size: float) -> FloatArray:
    """Coordinates of all cuts along one axis: the sides, the fillets evenly, graded beside re-entrant corners, long cells in five."""
    cuts = [lines]
    if fillets:
        for fillet in fillets:
            for end in fillet.ends:
                cuts.append(fillet.corner[axis] + (end - fillet.corner)[axis] * np.arange(FILLET_CUTS + 1) / FILLET_CUTS)
    kept = _distinct(np.concatenate(cuts), _SAME * size).tolist()  # these must be hit, the others only where there is room
    sharp = [] if fillets else np.unique(corners).tolist()
    wished = [c + sign * wall * g for of, grades in ((sharp, GRADES), (lines.tolist(), EDGES)) for c in of for g in grades for sign in (-1, 1)]
    spans = [np.sort(fillet.ends[:, axis]) for fillet in fillets]
    for cut in wished:
        if any(low < cut < high for low, high in spans):
            continue
        near = min(abs(cut - k) for k in kept)
        own = min(abs(cut - c) for c in lines)
        if lines[0] < cut < lines[-1] and near > 0.45 * own:
            kept.append(cut)
    return np.sort(np.array(kept))


def _distinct(values: FloatArray, least: float) -> FloatArray:
    found = np.sort(values)
    return np.asarray(found[np.concatenate([[True], np.diff(found) > least])])


def _inside(loops: Sequence[FloatArray], at: FloatArray) -> IntArray:
    """Rows of `at` inside the polygons (even-odd)."""
    odd = np.zeros(len(at), bool)
    x, y = at.T
    for loop in loops:
        x0, y0 = loop.T
        x1, y1 = np.roll(loop, -1, axis=0).T
        spans = (y0[None] > y[:, None]) != (y1[None] > y[:, None])
        rise = np.where(y1 == y0, 1.0, y1 - y0)
        crossing = (x1 - x0) / rise * (y[:, None] - y0) + x0
        odd ^= (spans & (x[:, None] < crossing)).sum(1) % 2 == 1
    return np.flatnonzero(odd)


def _fillet_patch(corner: FloatArray, arc: Edge) -> _Coarse:
    """The area between two legs of a corner and the arc that touches both: a grid of a triangle whose long side is bent onto the arc."""
    m = FILLET_CUTS
    place: dict[tuple[int, int], int] = {}
    points: list[FloatArray] = []
    for i in range(m + 1):
        for j in range(m + 1 - i):
            u, v = i / m, j / m
            s = u + v
            straight = corner + u * (arc.start - corner) + v * (arc.end - corner)
            if s > 0:
                t = v / s
                straight = straight + s**2 * (_on_arc(arc, t) - (arc.start + t * (arc.end - arc.start)))
            place[i, j] = len(points)
            points.append(straight)
    triangles = []
    for i in range(m):
        for j in range(m - i):
            triangles.append([place[i, j], place[i + 1, j], place[i, j + 1]])
            if i + j < m - 1:
                triangles.append([place[i + 1, j], place[i + 1, j + 1], place[i, j + 1]])
    centre = arc.centre if arc.centre is not None else np.zeros(2)
    arcs = [[place[m - k, k], place[m - k - 1, k + 1], *centre] for k in range(m)]
    return _Coarse(points=np.array(points), triangles=_turned(np.array(points), np.array(triangles)), arcs=np.array(arcs, float))


def _on_arc(arc: Edge, share: float) -> FloatArray:
    centre = arc.centre if arc.centre is not None else np.zeros(2)
    x, y = arc.start - centre
    angle = arc.turn * share
    return np.asarray(centre + np.array([math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y]))


def _turned(points: FloatArray, triangles: IntArray) -> IntArray:
    """Counter-clockwise."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    wrong = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]) < 0
    out = np.array(triangles, np.int64)
    out[wrong] = out[wrong][:, [0, 2, 1]]
    return out


# ------------------------------------------------------------------ round walls


def _rings(shape: Outline) -> _Coarse:
    """A tube of one ring of sectors, or a disc of sectors round its centre."""
    outer = shape.loops[0][0]
    angle = 2 * np.pi * np.arange(SECTORS) / SECTORS
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    here, after = np.arange(SECTORS), (np.arange(SECTORS) + 1) % SECTORS
    arcs = np.stack([here, after, 0 * here, 0 * here], axis=1).astype(float)
    if len(shape.loops) == 1:
        points = np.concatenate([outer.radius * unit, np.zeros((1, 2))])
        return _Coarse(points=points, triangles=np.stack([0 * here + SECTORS, here, after], axis=1), arcs=arcs)
    inner = shape.loops[1][0].radius
    return _tube(outer.radius, inner)


def _tube(outer: float, inner: float) -> _Coarse:
    # chords of the outer circle must not cut into the wall
    n = max(SECTORS, 4 * math.ceil(1.2 * math.sqrt(outer / (outer - inner))))
    angle = 2 * np.pi * np.arange(n) / n
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    here, after = np.arange(n), (np.arange(n) + 1) % n
    arcs = np.stack([here, after, 0 * here, 0 * here], axis=1).astype(float)
    triangles = np.concatenate([np.stack([here, after, n + after], 1), np.stack([here, n + after, n + here], 1)])
    return _Coarse(points=np.concatenate([outer * unit, inner * unit]), triangles=triangles, arcs=np.concatenate([arcs, _shifted(arcs, n)]))


def _rounded_tube(shape: Outline) -> _Coarse:
    """A rectangular tube with rounded corners: pairs of places outside and inside, joined to a ring of quadrangles."""
    outer, inner = (_ring(loop, shape.loops[0]) for loop in shape.loops)
    n = len(outer[0])
    here, after = np.arange(n), (np.arange(n) + 1) % n
    points = np.concatenate([outer[0], inner[0]])
    triangles = np.concatenate([np.stack([here, after, n + after], 1), np.stack([here, n + after, n + here], 1)])
    size = float(np.ptp(points, axis=0).max())
    arcs = np.concatenate([outer[1], _shifted(inner[1], n)])
    return _joined([_Coarse(points=points, triangles=_turned(points, triangles), arcs=arcs)], _SAME * size)


def _ring(loop: Sequence[Edge], outside: Sequence[Edge]) -> tuple[FloatArray, FloatArray]:
    """(places counter-clockwise, arcs) round a loop of a tube, as many for each corner and wall as there are outside."""
    if loop is not outside:  # the hole runs clockwise
        loop = tuple(Edge(name=e.name, start=e.end, end=e.start, centre=e.centre, turn=-e.turn) for e in reversed(loop))
    straight = [e for e in loop if e.centre is None]
    middle = np.mean([e.start for e in outside], axis=0)
    # begin with the wall whose outward side is lowest, so that both loops begin at the same place
    first = min(range(len(straight)), key=lambda k: float((straight[k].start + straight[k].end)[1]))
    straight = straight[first:] + straight[:first]
    by_start = {tuple(np.round(e.start - middle, 12)): e for e in loop if e.centre is not None}
    n_arc = SECTORS // 2
    points, arcs = [], []
    for k, wall in enumerate(straight):
        following = straight[(k + 1) % len(straight)]
        points += list(wall.start + np.array(WALL_SHARES)[:, None] * (wall.end - wall.start))
        arc = by_start.get(tuple(np.round(wall.end - middle, 12)))
        for j in range(n_arc):
            row = len(points)
            points.append(wall.end if arc is None else _on_arc(arc, j / n_arc))
            if arc is not None and arc.centre is not None:
                arcs.append([row, row + 1, *arc.centre])
        if np.linalg.norm(following.start - (wall.end if arc is None else arc.end)) > _SAME:
            raise InternalError("the outline of a tube does not close")
    rows = np.array(arcs, float).reshape(-1, 4)
    rows[:, :2] %= len(points)
    return np.array(points), rows


# ------------------------------------------------------------------ refinement


def _joined(parts: Sequence[_Coarse], least: float) -> _Coarse:
    """One mesh: places nearer than `least` become one, triangles without area and places without triangle vanish."""
    points = np.concatenate([part.points for part in parts])
    shift = np.cumsum([0, *(len(part.points) for part in parts)])
    triangles = np.concatenate([part.triangles + s for part, s in zip(parts, shift, strict=False)])
    arcs = np.concatenate([_shifted(part.arcs, int(s)) for part, s in zip(parts, shift, strict=False)])
    _, first, number = np.unique(np.round(points / least / 4).astype(np.int64), axis=0, return_index=True, return_inverse=True)
    triangles = number.ravel()[triangles]
    ends = number.ravel()[arcs[:, :2].astype(np.int64)]
    whole = (triangles[:, 0] != triangles[:, 1]) & (triangles[:, 1] != triangles[:, 2]) & (triangles[:, 0] != triangles[:, 2])
    used, packed = np.unique(triangles[whole], return_inverse=True)
    place = np.full(len(first), -1, np.int64)
    place[used] = np.arange(len(used))
    arcs = np.concatenate([place[ends], arcs[:, 2:]], axis=1)[ends[:, 0] != ends[:, 1]]
    return _Coarse(points=points[first][used], triangles=packed.reshape(-1, 3), arcs=arcs)


def _shifted(arcs: FloatArray, first: int) -> FloatArray:
    """The arcs where their points are numbered from `first` on."""
    return np.asarray(arcs + np.array([first, first, 0, 0]))


def _middles(mesh: _Coarse) -> tuple[FloatArray, IntArray, FloatArray]:
    """(middles (e, 2) of the sides, those on arcs on their circles; number of the side 01 12 20 of each triangle; arcs as (side, *row))."""
    n = len(mesh.points)
    sides = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    key, number = np.unique(sides[..., 0] * n + sides[..., 1], return_inverse=True)
    middle = (mesh.points[key // n] + mesh.points[key % n]) / 2
    ends = mesh.arcs[:, :2].astype(np.int64)
    at = np.searchsorted(key, ends.min(axis=1) * n + ends.max(axis=1))
    centre = mesh.arcs[:, 2:]
    radius = np.linalg.norm(mesh.points[ends[:, 0]] - centre, axis=1)
    arm = middle[at] - centre
    middle[at] = centre + arm / np.linalg.norm(arm, axis=1)[:, None] * radius[:, None]
    return middle, number.reshape(-1, 3), np.concatenate([at[:, None], mesh.arcs], axis=1)


def _refined(mesh: _Coarse) -> _Coarse:
    middle, side, arcs = _middles(mesh)
    n = len(mesh.points)
    a, b, c = mesh.triangles.T
    ab, bc, ca = (side + n).T
    triangles = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    halves = [np.stack([arcs[:, 1], arcs[:, 0] + n, arcs[:, 3], arcs[:, 4]], 1), np.stack([arcs[:, 0] + n, arcs[:, 2], arcs[:, 3], arcs[:, 4]], 1)]
    return _Coarse(points=np.concatenate([mesh.points, middle]), triangles=triangles, arcs=np.concatenate(halves))


def _with_middles(mesh: _Coarse) -> SectionMesh:
    middle, side, _ = _middles(mesh)
    return SectionMesh(points=np.concatenate([mesh.points, middle]), triangles=np.concatenate([mesh.triangles, side + len(mesh.points)], axis=1))
