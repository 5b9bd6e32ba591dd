"""A member as the solid a draughtsman draws: one true face for each face of its section, planes, cylinders, and B-splines where it is bent.

Not made from triangles: `to_brep` would cut circles and bends into facets. The STEP text is read back and measured like that of `to_brep`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from scan2fea.cad.bent_pipe import bent_pipe_step
from scan2fea.cad.prism_text import Curve, End, Side, prism_text
from scan2fea.cad.readback import ReadBack, read_back
from scan2fea.errors import CadError, InternalError, require
from scan2fea.kernel.outline import Edge, Outline, outline_moments
from scan2fea.kernel.sweep import Sweep, swept_points, swept_volume
from scan2fea.types import Brep, FloatArray

OCC_RESOLUTION_M = 1e-10  # as in brep.py
ELBOWS = 1e-5  # relative: how well Open Cascade integrates over tori that it has read
EXACT, BENT = 1e-6, 2e-3  # volume of the file against the closed form, which for twisted members with oblique ends holds to first order only
BEND_DEGREE = 9
COPLANAR = 1e-9  # of the size of a face
CIRCLE = 1.6  # radians: pieces of circles turn less, whole ones more; the arcs of fillets are quarters
FIRST_END, LAST_END = "END_FIRST", "END_LAST"


def prism_brep(shape: Outline, sweep: Sweep) -> Brep:
    """The B-Rep of an outline swept along a member.

    Straight: planes and true cylinders. Bent or twisted: B-splines, circles in quarters. Where the section changes along the axis faces are cut at
    the knots of the change unless they go on in their plane; arcs become ruled B-splines there. Pipes with elbows: cylinders and tori.
    Raises CadError where the file does not read back as one valid solid of as many faces and of the volume of the member.
    """
    if sweep.bends:
        return _read_back(*bent_pipe_step(shape, sweep), member_volume(shape, sweep), ELBOWS)
    edges = _edges(shape, sweep)
    sides = [side for loop, edge in edges for side in _sides(sweep, loop, edge)]
    ends = tuple(_plane(shape, sweep, float(share)) for share in sweep.knot_shares)
    names = (*(side.name for side in sides), FIRST_END, LAST_END)
    text = prism_text(sides, ends, names, OCC_RESOLUTION_M if sweep.is_straight else _fit_error(edges, sweep))
    exact = sweep.is_straight and (sweep.stretch is None or _is_square(sweep))
    kinds = (*(side.kind for side in sides), "plane", "plane")
    return _read_back(text, names, kinds, member_volume(shape, sweep), EXACT if exact else BENT)


def _read_back(text: str, names: tuple[str, ...], kinds: tuple[str, ...], volume_m3: float, limit: float) -> Brep:
    found = read_back(text)
    problem = _problem(found, len(names), volume_m3, limit)
    require(not problem, CadError, f"no valid solid of the member: {problem}")
    return Brep(
        step=text, face_names=names, face_kinds=kinds, region_of_face=np.arange(len(names)), facet_of_face=np.full(len(names), -1, np.int64),
        volume_m3=found.volume_m3, area_m2=found.area_m2, is_valid=found.is_valid, n_solids=found.n_solids, n_free_edges=found.n_free_edges,
    )  # fmt: skip


def _is_square(sweep: Sweep) -> bool:
    return bool(np.abs(sweep.end_normals[:, :2]).max() < 1e-12)


def member_volume(shape: Outline, sweep: Sweep) -> float:
    """Volume of the member, m3, by Simpson's rule where the section changes: areas are quadratic in each dimension, so that it is exact."""
    area, moment = outline_moments(shape)
    if sweep.stretch is None:
        return swept_volume(sweep, area, moment / area)
    total = 0.0
    for low, high in zip(sweep.knots_m[:-1], sweep.knots_m[1:], strict=True):
        places = (low, (low + high) / 2, high)
        total += (high - low) / 6 * float(np.dot((1, 4, 1), [outline_moments(_grown(shape, sweep, z))[0] for z in places]))
    for normal, z, sign in zip(sweep.end_normals, (0.0, sweep.length_m), (-1, 1), strict=True):  # oblique ends, to first order
        end_area, end_moment = outline_moments(_grown(shape, sweep, z))
        total -= sign * float(end_moment @ normal[:2]) / normal[2] if end_area > 0 else 0.0
    return total


def _grown(shape: Outline, sweep: Sweep, z: float) -> Outline:
    """The outline at height z, arcs moved as a whole."""
    stretch, growth = sweep.stretch, float(sweep.growth(np.array(z)))
    if stretch is None or growth == 0:
        return shape
    loops = []
    for loop in shape.loops:
        moved = []
        for edge in loop:
            at = np.stack([edge.start, edge.end])
            start, end = at + growth * stretch.moves(at)
            centre = edge.centre
            if centre is not None and abs(edge.turn) < CIRCLE:
                centre = centre + (start - edge.start)
            moved.append(replace(edge, start=start, end=end, centre=centre))
        loops.append(tuple(moved))
    return Outline(family=shape.family, loops=tuple(loops))


def _edges(shape: Outline, sweep: Sweep) -> list[tuple[int, Edge]]:
    """The edges that become faces, each with its loop; of members that are bent or change arcs are cut into at most quarters."""
    out = []
    for number, loop in enumerate(shape.loops):
        for edge in loop:
            n = 1 if sweep.is_prism or edge.centre is None else math.ceil(abs(edge.turn) / (math.pi / 2) - 1e-9)
            out += [(number, piece) for piece in _pieces(edge, n)]
    return out


def _pieces(edge: Edge, n: int) -> list[Edge]:
    if n == 1 or edge.centre is None:
        return [edge]
    x, y = edge.start - edge.centre
    angle = edge.turn * np.arange(n + 1) / n
    at = edge.centre + np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y], axis=1)
    at[[0, -1]] = edge.start, edge.end
    return [replace(edge, name=f"{edge.name}_{k + 1}", start=at[k], end=at[k + 1], turn=edge.turn / n) for k in range(n)]


def _sides(sweep: Sweep, loop: int, edge: Edge) -> list[Side]:
    """The faces over an edge, from knot to knot; consecutive ones in one plane are one face."""
    knots = sweep.knot_shares
    parts = [_side(sweep, loop, edge, (k, k + 1)) for k in range(len(knots) - 1)]
    joined = parts[:1]
    for part in parts[1:]:
        before = joined[-1]
        if before.kind == part.kind == "plane" and _in_plane(before, part.corners[1]):
            corners = np.stack([before.corners[0], part.corners[1]])
            joined[-1] = replace(before, stations=(before.stations[0], part.stations[1]), corners=corners, ways=before.ways + part.ways)
        else:
            joined.append(part)
    return joined if len(joined) == 1 else [replace(part, name=f"{part.name}_SPAN_{k + 1}") for k, part in enumerate(joined)]


def _in_plane(side: Side, points: FloatArray) -> bool:
    (a, b), (c, _) = side.corners
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal)
    return bool(np.abs((points - a) @ normal).max() < COPLANAR * float(np.linalg.norm(points - a, axis=1).max()))


def _side(sweep: Sweep, loop: int, edge: Edge, stations: tuple[int, int]) -> Side:
    share = sweep.knot_shares[list(stations)]
    corners = swept_points(sweep, np.stack([edge.start, edge.end]), share)
    ways = [_way(sweep, edge.start, share), _way(sweep, edge.end, share)]
    axis, weight = None, 1.0
    is_true = sweep.is_prism  # planes and cylinders
    if edge.centre is not None and is_true:
        axis = swept_points(sweep, edge.centre[None], share)[:, 0]
    elif edge.centre is not None:  # a rational quadratic arc: its middle control point is where the tangents meet
        middle = (edge.start + edge.end) / 2 - edge.centre
        weight = math.cos(edge.turn / 2)
        grows = sweep.stretch is not None and sweep.is_straight
        ways.insert(1, _tangents(sweep, edge, corners, share, weight) if grows else _way(sweep, edge.centre + middle / weight**2, share))
    flat = sweep.is_straight and edge.centre is None
    kind = "plane" if flat else "cylinder" if axis is not None else "nurbs"
    return Side(
        name=edge.name, edge=edge.name, loop=loop, kind=kind, stations=stations, corners=corners, ways=(tuple(ways),), weight=weight, axis=axis,
        radius=edge.radius, turn=edge.turn,
    )  # fmt: skip


def _tangents(sweep: Sweep, edge: Edge, corners: FloatArray, share: FloatArray, weight: float) -> Curve:
    """The way of the place where the tangents of an arc meet that grows (a circle) or moves as a whole (a fillet) between two shares."""
    if edge.centre is None:
        raise InternalError("a straight edge has no tangents that meet")
    centre = swept_points(sweep, edge.centre[None], share)[:, 0]
    if np.any(edge.centre):
        centre = corners[:, 0] + sweep.T_world_member[:3, :2] @ (edge.centre - edge.start)
    return Curve(points=centre + (corners.mean(1) - centre) / weight**2)


def _plane(shape: Outline, sweep: Sweep, share: float) -> End:
    """The plane across the member at a share of its way, through three places of the section."""
    size = max(float(np.abs(edge.start).max()) for loop in shape.loops for edge in loop)
    origin, x, y = swept_points(sweep, np.array([[0.0, 0.0], [size, 0.0], [0.0, size]]), np.array([share]))[0]
    normal = np.cross(x - origin, y - origin)
    return End(origin=origin, normal=(1 if share > 0 else -1) * normal / np.linalg.norm(normal), x=(x - origin) / np.linalg.norm(x - origin))


def _way(sweep: Sweep, point: FloatArray, ends: FloatArray) -> Curve:
    """The way of a place of the section between two shares (2,): a line, or the control points of one Bezier curve through Chebyshev places."""
    if sweep.is_straight:
        return Curve(points=swept_points(sweep, point[None], ends)[:, 0])
    share = (1 - np.cos(np.pi * np.arange(BEND_DEGREE + 1) / BEND_DEGREE)) / 2
    at = swept_points(sweep, point[None], ends[0] + (ends[1] - ends[0]) * share)[:, 0]
    middle = at.mean(0)  # coordinates far from the origin would lose digits in the fit
    control = np.linalg.solve(_bernstein(share), at - middle) + middle
    control[[0, -1]] = at[[0, -1]]
    return Curve(points=control)


def _bernstein(share: FloatArray) -> FloatArray:
    """(m, degree + 1) values of the Bernstein polynomials."""
    k = np.arange(BEND_DEGREE + 1)
    ways = np.array([math.comb(BEND_DEGREE, i) for i in k], float)
    return np.asarray(ways * share[:, None] ** k * (1 - share[:, None]) ** (BEND_DEGREE - k))


def _fit_error(edges: list[tuple[int, Edge]], sweep: Sweep) -> float:
    """Twice the most by which the curves of the corners leave the bent member, metres: the tolerance of the file."""
    share, knots = np.linspace(0, 1, 101), sweep.knot_shares
    worst = 0.0
    for _, edge in edges:
        for k in range(len(knots) - 1):
            control = _way(sweep, edge.start, knots[k : k + 2]).points
            made = _bernstein(share) @ (control - control[0]) + control[0]
            true = swept_points(sweep, edge.start[None], knots[k] + (knots[k + 1] - knots[k]) * share)[:, 0]
            worst = max(worst, float(np.linalg.norm(made - true, axis=1).max()))
    return max(OCC_RESOLUTION_M, 2 * worst)


def _problem(found: ReadBack, n_faces: int, volume_m3: float, limit: float) -> str:
    """The first test that the file fails, in words; empty where it passes all."""
    if found.n_solids != 1:
        return f"Open Cascade reads {found.n_solids} solids instead of one"
    if found.n_free_edges:
        return f"{found.n_free_edges} edges belong to one face only"
    if not found.is_valid:
        return "Open Cascade's BRepCheck finds it invalid"
    if len(found.face_area) != n_faces:
        return f"Open Cascade reads {len(found.face_area)} faces instead of {n_faces}"
    if abs(found.volume_m3 - volume_m3) > limit * volume_m3:
        return f"the solid holds {found.volume_m3:.9g} m3, the member {volume_m3:.9g} m3 (limit {limit:g} of it)"
    return ""
