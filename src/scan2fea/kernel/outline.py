"""The outline of a section as a draughtsman draws it: straight edges, true arcs and circles, root fillets where they are asked for.

`kernel.sections` gives the corners; here circles stay circles, so that `cad` can write true cylinders and the mesh its chords, from one source.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.kernel.sections import ROUND, check_section, section
from scan2fea.types import FloatArray, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Edge(Value):
    """One edge of an outline, metres. centre : (2,) of an arc, None for a straight edge.   turn : angle swept, radians, counter-clockwise positive;
    a full circle starts where it ends.
    """

    name: str
    start: FloatArray
    end: FloatArray
    centre: FloatArray | None = None
    turn: float = 0.0

    @property
    def radius(self) -> float:
        return 0.0 if self.centre is None else float(np.linalg.norm(self.start - self.centre))


@dataclass(frozen=True, eq=False, kw_only=True)
class Outline(Value):
    """loops : the outer one first, counter-clockwise; holes clockwise."""

    family: str
    loops: tuple[tuple[Edge, ...], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The faces in order, each once."""
        return tuple(dict.fromkeys(edge.name for loop in self.loops for edge in loop))


def outline(family: str, values: Mapping[str, float], root_radius_m: float = 0.0) -> Outline:
    """The outline of a section. root_radius_m : of the fillets where leg, web and flange meet; of RHS the outer corner radius, the wall being even.

    Raises UsageError as `kernel.sections.check_section`, and where a fillet does not fit.
    """
    check_section(family, values)
    require(math.isfinite(root_radius_m) and root_radius_m >= 0, UsageError, f"root radius is {root_radius_m} m; it must be 0 or more")
    if family in ROUND:
        radii = [values["d"] / 2] if family == "round" else [values["d"] / 2, values["d"] / 2 - values["t"]]
        return Outline(
            family=family, loops=tuple((_circle(name, r, sign),) for name, r, sign in zip(("OUTER", "INNER"), radii, (1, -1), strict=False))
        )
    shape = section(family, values)
    loops = []
    for number, (loop, names) in enumerate(zip(shape.loops, shape.face_names, strict=True)):
        radius = root_radius_m if family != "RHS" or number == 0 else max(0.0, root_radius_m - values["t"])
        arcs = "ROOT" if family != "RHS" else "CORNER" if number == 0 else "INNER_CORNER"
        loops.append(_rounded(loop, names, radius, arcs, every=family == "RHS"))
    return Outline(family=family, loops=tuple(loops))


def _circle(name: str, radius: float, sign: int) -> Edge:
    at = np.array([radius, 0.0])
    return Edge(name=name, start=at, end=at, centre=np.zeros(2), turn=sign * 2 * math.pi)


def _rounded(loop: FloatArray, names: tuple[str, ...], radius: float, arcs: str, *, every: bool) -> tuple[Edge, ...]:
    """The polygon with its re-entrant corners (or `every` corner) replaced by arcs of `radius`, named after `arcs`: ROOT_1, ..."""
    n = len(loop)
    along = np.roll(loop, -1, axis=0) - loop
    length = np.linalg.norm(along, axis=1)
    unit = along / length[:, None]
    before = np.roll(unit, 1, axis=0)
    turn = np.arctan2(before[:, 0] * unit[:, 1] - before[:, 1] * unit[:, 0], (before * unit).sum(1))
    is_cut = (np.full(n, True) if every else turn < 0) & (radius > 0)
    back = np.where(is_cut, radius * np.tan(np.abs(turn) / 2), 0.0)
    room = length - back - np.roll(back, -1)
    says = f"a root radius of {radius:.6g} m does not fit the section: an edge is only {length.min():.6g} m long"
    require((room > 0).all(), UsageError, says)
    edges: list[Edge] = []
    for i in range(n):
        if is_cut[i]:
            side = np.array([-before[i][1], before[i][0]]) * math.copysign(radius, turn[i])
            start, end = loop[i] - back[i] * before[i], loop[i] + back[i] * unit[i]
            number = 1 + sum(edge.centre is not None for edge in edges)
            edges.append(Edge(name=f"{arcs}_{number}", start=start, end=end, centre=start + side, turn=float(turn[i])))
        j = (i + 1) % n
        edges.append(Edge(name=names[i], start=loop[i] + back[i] * unit[i], end=loop[j] - back[j] * unit[i]))
    return tuple(edges)


def outline_area(shape: Outline) -> float:
    """True area, m2: the polygon of the ends of the edges, and what lies between each arc and its chord."""
    total = 0.0
    for loop in shape.loops:
        for edge in loop:
            (ax, ay), (bx, by) = edge.start, edge.end
            total += 0.5 * (ax * by - ay * bx) + 0.5 * edge.radius**2 * (edge.turn - math.sin(edge.turn))
    return total


def outline_moments(shape: Outline) -> tuple[float, FloatArray]:
    """Area, m2, and (2,) first moments of the area about the origin, m3: by Green's theorem, Gauss points on the arcs."""
    node, weight = np.polynomial.legendre.leggauss(24)
    area, moment = 0.0, np.zeros(2)
    for loop in shape.loops:
        for edge in loop:
            at, along = _on_edge(edge, (node + 1) / 2)
            x, y = at.T
            dx, dy = along.T
            area += float(weight @ (x * dy - y * dx)) / 4
            moment += [float(weight @ (x**2 * dy)) / 4, -float(weight @ (y**2 * dx)) / 4]
    return area, moment


def _on_edge(edge: Edge, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 2) places at the shares of an edge, and their derivatives by the share."""
    if edge.centre is None:
        along = edge.end - edge.start
        return edge.start + share[:, None] * along, np.tile(along, (len(share), 1))
    x, y = edge.start - edge.centre
    cos, sin = np.cos(edge.turn * share), np.sin(edge.turn * share)
    arm = np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)
    return edge.centre + arm, edge.turn * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
