"""Copies of the triangulated section along a member: what `tetmeshing.layered` fills with tets."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.estimation.grid import Grid, is_orthogonal, rectangle_grid, ring_grid, strip_grid
from scan2fea.estimation.solid import NODES, Solid
from scan2fea.kernel.measures import volume
from scan2fea.kernel.sections import ROUND
from scan2fea.kernel.sweep import shares_with_knots, swept_points
from scan2fea.options import option
from scan2fea.types import FloatArray, IntArray, Value

WALLS_PER_EDGE = 2.0  # TET10 one element deep and two walls long is within 0.5 % in bending
MANY_WALLS, MOST_WALLS = 5.5, 8.0  # smallest dihedral 9 to 12 deg, or 7; 2 to 3 deg less beside fillets; verification refuses 5
OVER = 1.9  # times the nodes asked for, before elements grow beyond MANY_WALLS
COMPACT_TETS = 6_000  # of second order: more say no more about a compact part, and its factor grows as their 4/3
PER_THICKNESS = 5.0  # elements through a compact part: more change its first frequency by 0.1 %
FINER = 0.88


@dataclass(frozen=True, kw_only=True)
class LayerOptions:
    """How fine the swept mesh of a member is."""

    edge_m: float | None = option(None, "edge length of the elements; two walls, coarser on long members, without it", unit="m", minimum=0.0)
    max_nodes: int = option(
        NODES,
        "TET10 nodes that element sizes are chosen for; elements longer than 5.5 walls are made only where it would be twice as many",
        minimum=100,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Layers(Value):
    """The arguments of `tetmeshing.layered`, and the sizes chosen: edge_m in the section, layer_m along the axis."""

    points: FloatArray
    triangles: IntArray
    rim: IntArray
    rim_tag: IntArray
    face_names: tuple[str, ...]
    edge_m: float
    layer_m: float


def layers_of(solid: Solid, options: LayerOptions = LayerOptions()) -> Layers:
    """Section and layers as fine as the budget of nodes allows."""
    edge = options.edge_m or _wanted(solid)
    while options.edge_m is None:
        grid = _grid(solid, edge)
        excess, walls = _n_nodes(grid, _n_layers(solid, grid, edge)) / options.max_nodes, edge / _cell(solid)
        if excess <= 1 or (excess <= OVER and walls >= MANY_WALLS) or walls >= MOST_WALLS:
            break
        edge /= FINER
    grid = _grid(solid, edge)
    n_layers = _n_layers(solid, grid, edge)
    share = shares_with_knots(solid.sweep, n_layers)
    points = swept_points(solid.mesh_sweep, grid.points, share)
    tags = [np.array([solid.face_names.index(name) for name in loop]) for loop in solid.loop_names]
    tag = np.array([tags[i][k] for i, k in zip(grid.rim_loop.tolist(), grid.rim_edge.tolist(), strict=True)], np.int64)
    layer = float(np.linalg.norm(np.diff(points, axis=0), axis=2).sum(axis=0).max()) / (len(share) - 1)
    return Layers(
        points=points, triangles=grid.triangles, rim=grid.rim, rim_tag=tag, face_names=solid.face_names, edge_m=edge, layer_m=layer
    )


def _cell(solid: Solid) -> float:
    """The shortest side that an element must have: the thinnest wall, the chord of a round member, the legs of a chamfer where those are shorter."""
    curved = {edge.name for loop in solid.shape.loops for edge in loop if edge.centre is not None}
    chords = [solid.wall_m]
    for points, names in zip(solid.loops[:1], solid.loop_names[:1], strict=True):
        length = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
        share = 1.0 if solid.shape.family in ROUND else math.sqrt(0.5)
        chords += [share * float(x) for x, name in zip(length, names, strict=True) if name in curved]
    return min(chords)


def _wanted(solid: Solid) -> float:
    """Two walls, or of a compact body what makes COMPACT_TETS, or PER_THICKNESS through it."""
    compact = max((8.49 * volume(solid.mesh) / COMPACT_TETS) ** (1 / 3), solid.wall_m / PER_THICKNESS)
    return float(min(WALLS_PER_EDGE * _cell(solid), compact))


def _grid(solid: Solid, edge_m: float) -> Grid:
    """Rings for round sections, strips for tubes with rounded corners, else rectangles with fillets in their corners, sloped as flanges."""
    loops = list(solid.loops)
    if solid.shape.family in ROUND:
        return ring_grid(loops, edge_m)
    if is_orthogonal(loops):
        return rectangle_grid(loops, (), edge_m)
    if len(loops) == 2:
        return strip_grid(loops, edge_m)
    curved = {edge.name for edge in solid.shape.loops[0] if edge.centre is not None}
    slant = solid.shape.slant
    if slant is None:
        return rectangle_grid(*_sharp(loops[0], solid.loop_names[0], curved), edge_m)
    level = rectangle_grid(*_sharp(slant.level(loops[0]), solid.loop_names[0], curved), edge_m)
    return replace(level, points=slant.sloped(np.asarray(level.points)))


def _sharp(corners: FloatArray, names: tuple[str, ...], curved: set[str]) -> tuple[list[FloatArray], list[FloatArray]]:
    """The polygon without its chamfers, and each of these: (3, 2) its start, the corner it fills or cuts off, its end."""
    sharp, chamfers = [], []
    for k, name in enumerate(names):
        if name in curved:
            start, end = corners[k], corners[(k + 1) % len(corners)]
            along_x = abs(corners[k - 1][1] - start[1]) < abs(corners[k - 1][0] - start[0])  # the edge before the chamfer
            corner = np.array([end[0], start[1]] if along_x else [start[0], end[1]])
            chamfers.append(np.stack([start, corner, end]))
            sharp.append(corner)
        elif names[k - 1] not in curved:
            sharp.append(corners[k])
    return [np.array(sharp)], chamfers


def _n_layers(solid: Solid, grid: Grid, edge_m: float) -> int:
    """Layers as long as the elements; of a bent member at least as many as its strips."""
    ends = swept_points(solid.mesh_sweep, grid.points, solid.sweep.knot_shares)
    longest = float(np.linalg.norm(np.diff(ends, axis=0), axis=2).sum(axis=0).max())
    n_strips = (len(solid.mesh.vertices) // sum(len(loop) for loop in solid.loops)) - 1
    n = max(1, n_strips if not solid.sweep.is_straight else 1, math.ceil(longest / edge_m - 1e-9))
    return len(shares_with_knots(solid.sweep, n)) - 1 if solid.sweep.bends else n


def _n_nodes(grid: Grid, n_layers: int) -> int:
    """TET10 nodes: corners and edges (edges = corners + tets + boundary / 2 - 1 on a ball; a tube has one edge more a place round)."""
    corners, tets = len(grid.points) * (n_layers + 1), 3 * len(grid.triangles) * n_layers
    boundary = 2 * len(grid.rim) * n_layers + 2 * len(grid.triangles)
    return 2 * corners + tets + boundary // 2
