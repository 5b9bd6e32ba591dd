"""A member as the solid a draughtsman draws: one true face for each face of its section, planes, cylinders, and B-splines where it is bent.

Not made from triangles: `to_brep` would cut circles and bends into facets. The STEP text is read back and measured like that of `to_brep`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from scan2fea.cad.prism_text import Curve, End, Side, prism_text
from scan2fea.cad.readback import ReadBack, read_back
from scan2fea.errors import CadError, require
from scan2fea.kernel.outline import Edge, Outline, outline_moments
from scan2fea.kernel.sweep import Sweep, swept_points, swept_volume
from scan2fea.types import Brep, FloatArray

OCC_RESOLUTION_M = 1e-10  # as in brep.py
EXACT, BENT = 1e-6, 2e-3  # volume of the file against the closed form, which for twisted members with oblique ends holds to first order only
BEND_DEGREE = 9
FIRST_END, LAST_END = "END_FIRST", "END_LAST"


def prism_brep(shape: Outline, sweep: Sweep) -> Brep:
    """The B-Rep of an outline swept along a member.

    Straight: planes and true cylinders. Bent or twisted: B-splines, circles in quarters. Raises CadError where the file does not read back as one
    valid solid of as many faces and of the volume of the member.
    """
    edges = _edges(shape, sweep)
    sides = [_side(sweep, loop, edge) for loop, edge in edges]
    ends = (_end(shape, sweep, 0), _end(shape, sweep, 1))
    names = (*(side.name for side in sides), FIRST_END, LAST_END)
    text = prism_text(sides, ends, names, OCC_RESOLUTION_M if sweep.is_straight else _fit_error(edges, sweep))
    found = read_back(text)
    area, moment = outline_moments(shape)
    problem = _problem(found, len(names), swept_volume(sweep, area, moment / area), EXACT if sweep.is_straight else BENT)
    require(not problem, CadError, f"no valid solid of the member: {problem}")
    kinds = (*(side.kind for side in sides), "plane", "plane")
    return Brep(
        step=text, face_names=names, face_kinds=kinds, region_of_face=np.arange(len(names)), facet_of_face=np.full(len(names), -1, np.int64),
        volume_m3=found.volume_m3, area_m2=found.area_m2, is_valid=found.is_valid, n_solids=found.n_solids, n_free_edges=found.n_free_edges,
    )  # fmt: skip


def _edges(shape: Outline, sweep: Sweep) -> list[tuple[int, Edge]]:
    """The edges that become faces, each with its loop; of bent members arcs are cut into at most quarters."""
    out = []
    for number, loop in enumerate(shape.loops):
        for edge in loop:
            n = 1 if sweep.is_straight or edge.centre is None else math.ceil(abs(edge.turn) / (math.pi / 2) - 1e-9)
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


def _side(sweep: Sweep, loop: int, edge: Edge) -> Side:
    corners = swept_points(sweep, np.stack([edge.start, edge.end]), np.array([0.0, 1.0]))
    ways = [_way(sweep, edge.start), _way(sweep, edge.end)]
    axis, weight = None, 1.0
    if edge.centre is not None and sweep.is_straight:
        axis = swept_points(sweep, edge.centre[None], np.array([0.0, 1.0]))[:, 0]
    elif edge.centre is not None:  # a rational quadratic arc: its middle control point is where the tangents meet
        middle = (edge.start + edge.end) / 2 - edge.centre
        weight = math.cos(edge.turn / 2)
        ways.insert(1, _way(sweep, edge.centre + middle / weight**2))
    kind = "nurbs" if not sweep.is_straight else "plane" if axis is None else "cylinder"
    return Side(name=edge.name, loop=loop, kind=kind, corners=corners, ways=tuple(ways), weight=weight, axis=axis, radius=edge.radius, turn=edge.turn)


def _end(shape: Outline, sweep: Sweep, share: int) -> End:
    """Plane of an end, through three places of the section."""
    size = max(float(np.abs(edge.start).max()) for loop in shape.loops for edge in loop)
    origin, x, y = swept_points(sweep, np.array([[0.0, 0.0], [size, 0.0], [0.0, size]]), np.array([float(share)]))[0]
    normal = np.cross(x - origin, y - origin)
    return End(origin=origin, normal=(1 if share else -1) * normal / np.linalg.norm(normal), x=(x - origin) / np.linalg.norm(x - origin))


def _way(sweep: Sweep, point: FloatArray) -> Curve:
    """The way of a place of the section along the member: a line, or the control points of one Bezier curve through Chebyshev places."""
    if sweep.is_straight:
        return Curve(points=swept_points(sweep, point[None], np.array([0.0, 1.0]))[:, 0])
    share = (1 - np.cos(np.pi * np.arange(BEND_DEGREE + 1) / BEND_DEGREE)) / 2
    at = swept_points(sweep, point[None], share)[:, 0]
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
    share = np.linspace(0, 1, 101)
    worst = 0.0
    for _, edge in edges:
        control = _way(sweep, edge.start).points
        made = _bernstein(share) @ (control - control[0]) + control[0]
        worst = max(worst, float(np.linalg.norm(made - swept_points(sweep, edge.start[None], share)[:, 0], axis=1).max()))
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
