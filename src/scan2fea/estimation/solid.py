"""The solid of a fitted member: a closed mesh whose faces are the faces a draughtsman would draw, by name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.estimation.grid import ears
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.outline import Edge, Outline, outline_of
from scan2fea.kernel.sections import ROUND
from scan2fea.kernel.sweep import Sweep, stations, sweep_of, swept_points
from scan2fea.options import option
from scan2fea.types import FloatArray, IntArray, Member, TetMesh, TriangleMesh, Value

FIRST_END, LAST_END = "END_FIRST", "END_LAST"
ROUND_ERROR = 1e-3  # of the radius: chords closer to their circle say nothing more
ROUND_SIGMAS = 0.3  # nor do chords closer than this share of the noise
MIN_CHORDS, MAX_CHORDS = 12, 60  # of a full circle
NODES = 30_000  # TET10 nodes that sizes are chosen for: elements of 4 walls are within 0.3 % in bending, twice as many nodes cost 3 times the time
LAYER_WALLS = 4.0  # layers may be so many walls or chords long: smallest dihedral about 14 deg
WHOLE = 6.0  # radians: arcs beyond are whole circles
CHAMFER_ERROR = 0.062  # of the radius of a fillet: where its chamfer ends, 1 - sqrt(1 - (1 - 0.655)^2)


@dataclass(frozen=True, kw_only=True)
class SolidOptions:
    """How a fitted member becomes a solid."""

    root_radius_m: float | None = option(
        None, "radius of the root fillets (of RHS: of the outer corners), 0 for sharp corners; as the points tell without it", unit="m", minimum=0.0
    )
    chord_m: float | None = option(
        None, "how far straight strips may leave a bent or twisted member; from its noise and its thinnest wall without it", unit="m", minimum=0.0
    )
    n_chords: int | None = option(None, "chords of a full circle; from the noise, the length and the elements without it", minimum=8, maximum=512)


@dataclass(frozen=True, eq=False, kw_only=True)
class Solid(Value):
    """mesh : closed, manifold, oriented; its face_region numbers `face_names`.   chord_m : how far the mesh may lie from the true member.

    shape : the outline with true arcs.   sweep, mesh_sweep : how it runs, and how the corners of polygons that stand for circles do.
    wall_m : the thinnest wall.
    loops : (k, 2) polygons of the section that the mesh sweeps, outside first; loop_names : the face over each of their edges.
    """

    mesh: TriangleMesh
    face_names: tuple[str, ...]
    chord_m: float
    wall_m: float
    shape: Outline
    sweep: Sweep
    mesh_sweep: Sweep
    loops: tuple[FloatArray, ...]
    loop_names: tuple[tuple[str, ...], ...]


def solid_of(member: Member, options: SolidOptions = SolidOptions()) -> Solid:
    """The solid of a member, circles as polygons of the same area, so that the volume is area x length.

    Raises StageError or UsageError where its dimensions make no solid.
    """
    sweep = sweep_of(member)
    values = member.values()
    shape = outline_of(member, options.root_radius_m)
    wall = thinnest_wall(values)
    n = options.n_chords or _n_chords(values, sweep.length_m, member.sigma_m)
    loops = _polygons(shape, n)
    bend = options.chord_m if options.chord_m is not None else max(0.02 * wall, 0.1 * member.sigma_m)
    of_mesh = _of_polygons(sweep, n) if member.family in ROUND else sweep
    share, bent = stations(of_mesh, [points for points, _ in loops], bend)
    round_error = max((_round_error(edge, n) for loop in shape.loops for edge in loop), default=0.0)
    names = (*dict.fromkeys(name for _, of in loops for name in of), FIRST_END, LAST_END)
    return Solid(
        mesh=_mesh(of_mesh, loops, share, names),
        face_names=names,
        chord_m=bent + round_error,
        wall_m=wall,
        shape=shape,
        sweep=sweep,
        mesh_sweep=of_mesh,
        loops=tuple(points for points, _ in loops),
        loop_names=tuple(of for _, of in loops),
    )


def swept(member: Member, options: SolidOptions = SolidOptions()) -> TriangleMesh:
    """Only the mesh of `solid_of`."""
    return solid_of(member, options).mesh


def thinnest_wall(values: Mapping[str, float]) -> float:
    """The smallest dimension of the section, metres."""
    return min(value for name, value in values.items() if name != "length")


def _n_chords(values: Mapping[str, float], length_m: float, sigma_m: float) -> int:
    """Chords of a circle: as the noise needs, no more than NODES allow at layers of LAYER_WALLS chords or walls; a multiple of 12.

    A polygon of the circle's area leaves it by (2 pi / n)^2 / 12 of the radius at most. A tube has 12 TET10 nodes a cell of chord x layer; a full
    section of n corners 2 n^2 / 3 nodes a layer.
    """
    d, t = values.get("d"), values.get("t")
    if d is None:
        return MIN_CHORDS
    wanted = 2 * math.pi / math.sqrt(12 * max(ROUND_ERROR, ROUND_SIGMAS * sigma_m / (d / 2)))
    slender = LAYER_WALLS * NODES * d / length_m
    most = math.cbrt(1.5 * math.pi * slender) if t is None else min(math.sqrt(math.pi * slender / 12), slender * t / d / 12)
    return 12 * round(min(max(min(wanted, most), MIN_CHORDS), MAX_CHORDS) / 12)


def _round_error(edge: Edge, n_chords: int) -> float:
    """How far the polygon leaves an arc at most: inside by 2/3 of the sagitta of a circle (outside by 1/3); a chamfer by 6 % of the radius."""
    if edge.centre is None:
        return 0.0
    return edge.radius * ((1 - math.cos(math.pi / n_chords)) * 2 / 3 if abs(edge.turn) > WHOLE else CHAMFER_ERROR)


def _polygons(shape: Outline, n_chords: int) -> list[tuple[FloatArray, tuple[str, ...]]]:
    """Corners (k, 2) of each loop and the name of the face over each edge, of the same area.

    A circle becomes a regular polygon; a fillet the chamfer that cuts off as much, since the chords of a fillet meet its neighbours in needles. Of a
    tube with rounded corners only the outer ones are cut, by the difference of both: chamfers inside would be shorter than its wall by far.
    """
    outer = shape.loops[0]
    if len(outer) == 1:
        return [_circle_polygon(loop[0], n_chords) for loop in shape.loops]
    if len(shape.loops) == 1:
        return [_chamfered(outer, 1.0)]
    hole = shape.loops[1]
    radii = [max((edge.radius for edge in loop), default=0.0) for loop in shape.loops]
    share = math.sqrt(1 - (radii[1] / radii[0]) ** 2) if radii[0] > 0 else 1.0
    straight = [edge for edge in hole if edge.centre is None]
    corners = [_crossing(before, edge) for edge, before in zip(straight, (straight[-1], *straight[:-1]), strict=True)]
    return [_chamfered(outer, share), (np.array(corners), tuple(edge.name for edge in straight))]


def _crossing(before: Edge, edge: Edge) -> FloatArray:
    """(2,) where the lines of two straight edges meet."""
    directions = np.stack([before.end - before.start, edge.start - edge.end], axis=1)
    share = np.linalg.solve(directions, edge.start - before.start)
    return np.asarray(before.start + share[0] * (before.end - before.start))


def _chamfered(loop: tuple[Edge, ...], scale: float) -> tuple[FloatArray, tuple[str, ...]]:
    """The loop with chamfers for arcs, `scale` times as large as those of the same area."""
    points = []
    for edge, before in zip(loop, (loop[-1], *loop[:-1]), strict=True):
        if edge.centre is not None:
            points.append(_chamfer(edge, edge.centre, edge.start, scale))
        elif before.centre is not None:
            points.append(_chamfer(before, before.centre, before.end, scale))
        else:
            points.append(edge.start)
    return np.array(points), tuple(edge.name for edge in loop)


def _of_polygons(sweep: Sweep, n: int) -> Sweep:
    """The sweep of corners of polygons that have the area of their circle at every height."""
    if sweep.stretch is None:
        return sweep
    step = 2 * math.pi / n
    return replace(sweep, stretch=replace(sweep.stretch, shift=sweep.stretch.shift * math.sqrt(step / math.sin(step))))


def _circle_polygon(edge: Edge, n: int) -> tuple[FloatArray, tuple[str, ...]]:
    step = edge.turn / n
    radius = edge.radius * math.sqrt(step / math.sin(step))
    angle = step * np.arange(n)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), (edge.name,) * n


def _chamfer(arc: Edge, centre: FloatArray, end: FloatArray, scale: float) -> FloatArray:
    """Where the chamfer of the area of a fillet starts, on the way from the end of the arc to the corner it rounds off.

    With turn s and radius r: r^2 (tan(s / 2) - s / 2) lies between arc and corner, k^2 r^2 tan^2(s / 2) sin(s) / 2 behind the chamfer.
    """
    half = abs(arc.turn) / 2
    share = math.sqrt((math.tan(half) - half) * 2 / (math.tan(half) ** 2 * math.sin(2 * half)))
    middle = (arc.start + arc.end) / 2 - centre
    corner = centre + middle / math.cos(half) ** 2
    return np.asarray(corner + scale * share * (end - corner))


# ------------------------------------------------------------------ triangles


def _mesh(sweep: Sweep, loops: list[tuple[FloatArray, tuple[str, ...]]], share: FloatArray, names: tuple[str, ...]) -> TriangleMesh:
    """Strips along the member and a cap at each end; rings of vertices from the first end to the last."""
    corners = np.concatenate([points for points, _ in loops])
    n, m = len(corners), len(share)
    vertices = swept_points(sweep, corners, share).reshape(-1, 3)
    faces, region, first = [], [], 0
    for points, of in loops:
        k = len(points)
        here = first + np.arange(k)
        after = first + (np.arange(k) + 1) % k
        for row in range(m - 1):
            a, b, c, d = row * n + here, row * n + after, (row + 1) * n + after, (row + 1) * n + here
            faces.append(np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3))
            region.append(np.repeat([names.index(name) for name in of], 2))
        first += k
    cap = cap_triangles([points for points, _ in loops])
    faces += [cap[:, ::-1], cap + (m - 1) * n]
    region += [np.full(len(cap), names.index(FIRST_END)), np.full(len(cap), names.index(LAST_END))]
    return TriangleMesh(vertices=vertices, faces=np.concatenate(faces).astype(np.int64), face_region=np.concatenate(region).astype(np.int64))


def cap_triangles(loops: list[FloatArray]) -> IntArray:
    """Triangles (k, 3) of the area between an outer polygon (counter-clockwise) and at most one hole (clockwise), corners numbered in order.

    Tubes of as many corners inside as outside are cut into a ring of quadrangles, all else ear by ear, a hole joined to the outside by a bridge.
    """
    require(1 <= len(loops) <= 2, InternalError, f"a section of {len(loops)} loops")
    if len(loops) == 1:
        return ears(loops[0], list(range(len(loops[0]))))
    outer, hole = loops
    k = len(outer)
    if len(hole) == k:
        start = int(np.argmin(np.linalg.norm(hole - outer[0], axis=1)))
        inner = k + (start - np.arange(k)) % k
        a, b, c, d = np.arange(k), (np.arange(k) + 1) % k, np.roll(inner, -1), inner
        return np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3).astype(np.int64)
    gap = np.linalg.norm(outer[:, None] - hole[None], axis=2)
    i, j = (int(x) for x in np.unravel_index(np.argmin(gap), gap.shape))
    bridge = [*range(i + 1), *(k + (j + np.arange(len(hole) + 1)) % len(hole)).tolist(), *range(i, k)]
    return ears(np.concatenate([outer, hole]), bridge)


# ------------------------------------------------------------------ names


def named(tets: TetMesh, solid: Solid) -> TetMesh:
    """The tets with each boundary triangle tagged by the face of the member it lies on, for the names of the sets of the deck."""
    middle = tets.nodes[tets.boundary[:, :3]].mean(1)
    region = solid.mesh.face_region
    if region is None:
        raise InternalError("the mesh of a solid has no regions")
    return replace(tets, face_tag=region[PointToMesh(solid.mesh).nearest(middle).face], face_names=solid.face_names)
