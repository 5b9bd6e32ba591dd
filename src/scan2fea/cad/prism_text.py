"""STEP AP214 text of a swept outline: every entity written here, in order of the faces, for the reasons given in step_text.py."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.cad.step_text import FIRST_FREE, FOOTER, HEAD, HEADER, PRODUCT_NAME, real
from scan2fea.types import FloatArray, Value
from scan2fea.units import MILLIMETRES_PER_METRE


@dataclass(frozen=True, eq=False, kw_only=True)
class Curve(Value):
    """points : (2, 3) of a line, or the control points of one Bezier curve, metres."""

    points: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Side(Value):
    """A face along the member. edge, loop : of the outline.   kind : plane, cylinder or nurbs.   corners : (2, 2, 3) [end, start or end of the edge].

    stations : numbers of the planes across the member where it begins and ends.   ways : per stretch between stations, from one to the next, of the
    start and the end of the edge, and between them of the middle control point of an arc of weight `weight`; only planes have several stretches.
    axis : (2, 3) of a cylinder, at the two ends.   radius, turn : of an arc, counter-clockwise positive.
    """

    name: str
    edge: str
    loop: int
    kind: str
    stations: tuple[int, int]
    corners: FloatArray
    ways: tuple[tuple[Curve, ...], ...]
    weight: float
    axis: FloatArray | None
    radius: float
    turn: float


@dataclass(frozen=True, eq=False, kw_only=True)
class End(Value):
    """A plane across the member: a place in it, its normal (outward at the ends), a direction in it."""

    origin: FloatArray
    normal: FloatArray
    x: FloatArray


def prism_text(sides: Sequence[Side], ends: Sequence[End], names: tuple[str, ...], uncertainty_m: float) -> str:
    """The file: the sides in order, then the first and the last end. ends : the planes of all stations, in order."""
    writer = _Writer()
    faces = [writer.side(side, ends, name) for side, name in zip(sides, names, strict=False)]
    last = len(ends) - 1
    faces += [writer.end(sides, ends[station], station, station == last, names[len(sides) + k]) for k, station in enumerate((0, last))]
    shell = f"#22=CLOSED_SHELL('',({','.join(f'#{n}' for n in faces)}));\n"
    head = HEAD.format(name=PRODUCT_NAME, uncertainty=real(uncertainty_m * MILLIMETRES_PER_METRE))
    return HEADER.format(description="scan2fea solid", name="model.step") + head + shell + "".join(writer.lines) + FOOTER


def _list(numbers: Iterable[int]) -> str:
    return "(" + ",".join(f"#{n}" for n in numbers) + ")"


class _Writer:
    def __init__(self) -> None:
        self.lines: list[str] = []
        self.known: dict[str, int] = {}
        self.edges: dict[tuple[object, ...], int] = {}

    def add(self, text: str) -> int:
        number = FIRST_FREE + len(self.lines)
        self.lines.append(f"#{number}={text};\n")
        return number

    def once(self, text: str) -> int:
        if text not in self.known:
            self.known[text] = self.add(text)
        return self.known[text]

    def point(self, at: FloatArray) -> int:
        return self.once(f"CARTESIAN_POINT('',({','.join(real(x) for x in (at * MILLIMETRES_PER_METRE).tolist())}))")

    def direction(self, vector: FloatArray) -> int:
        unit = vector / np.linalg.norm(vector) + 0.0  # + 0.0: no "-0.0"
        return self.once(f"DIRECTION('',({','.join(real(x) for x in unit.tolist())}))")

    def placement(self, origin: FloatArray, normal: FloatArray, x: FloatArray) -> int:
        unit = normal / np.linalg.norm(normal)
        return self.once(f"AXIS2_PLACEMENT_3D('',#{self.point(origin)},#{self.direction(unit)},#{self.direction(x - (x @ unit) * unit)})")

    def vertex(self, at: FloatArray) -> int:
        return self.once(f"VERTEX_POINT('',#{self.point(at)})")

    def line(self, start: FloatArray, end: FloatArray) -> int:
        vector = self.once(f"VECTOR('',#{self.direction(end - start)},1.)")
        return self.add(f"LINE('',#{self.point(start)},#{vector})")

    def edge(self, key: tuple[object, ...], start: FloatArray, end: FloatArray, curve: int, same: bool = True) -> int:
        self.edges[key] = self.add(f"EDGE_CURVE('',#{self.vertex(start)},#{self.vertex(end)},#{curve},.{'T' if same else 'F'}.)")
        return self.edges[key]

    def oriented(self, edge: int, forward: bool) -> int:
        return self.add(f"ORIENTED_EDGE('',*,*,#{edge},.{'T' if forward else 'F'}.)")

    def way(self, curve: Curve) -> int:
        """The edge along the member through a corner; each is shared by two sides (or twice by a cylinder that closes on itself)."""
        points = curve.points
        key = ("way", *points[0].tolist(), *points[-1].tolist())
        if key in self.edges:
            return self.edges[key]
        if len(points) == 2:
            return self.edge(key, points[0], points[1], self.line(points[0], points[1]))
        controls = _list(self.point(p) for p in points)
        degree = len(points) - 1
        spline = self.add(
            f"B_SPLINE_CURVE_WITH_KNOTS('',{degree},{controls},.UNSPECIFIED.,.F.,.F.,({degree + 1},{degree + 1}),(0.,1.),.PIECEWISE_BEZIER_KNOTS.)"
        )
        return self.edge(key, points[0], points[-1], spline)

    def rim(self, side: Side, which: int, end: End) -> int:
        """The edge of a side in an end plane, in the direction of the outline."""
        start, stop = side.corners[which]
        key = ("rim", side.stations[which], side.edge)
        if key in self.edges:
            return self.edges[key]
        ways = side.ways[-which]
        if len(ways) == 3:
            controls = _list(self.point(way.points[-which]) for way in ways)
            arc = self.add(
                f"(BOUNDED_CURVE()B_SPLINE_CURVE(2,{controls},.UNSPECIFIED.,.F.,.F.)B_SPLINE_CURVE_WITH_KNOTS((3,3),(0.,1.),.PIECEWISE_BEZIER_KNOTS.)"
                f"CURVE()GEOMETRIC_REPRESENTATION_ITEM()RATIONAL_B_SPLINE_CURVE((1.,{real(side.weight)},1.))REPRESENTATION_ITEM(''))"
            )
            return self.edge(key, start, stop, arc)
        if side.axis is None:
            return self.edge(key, start, stop, self.line(start, stop))
        along = side.axis[1] - side.axis[0]
        along = along / np.linalg.norm(along)
        normal = end.normal if end.normal @ along > 0 else -end.normal  # counter-clockwise about it is counter-clockwise of the outline
        cosine = float(normal @ along)
        centre, across = side.axis[which], along - cosine * normal
        if np.linalg.norm(across) < 1e-12:
            curve = self.add(f"CIRCLE('',#{self.placement(centre, normal, start - centre)},{real(side.radius * MILLIMETRES_PER_METRE)})")
        else:
            axes = ",".join(real(a * MILLIMETRES_PER_METRE) for a in (side.radius / cosine, side.radius))
            curve = self.add(f"ELLIPSE('',#{self.placement(centre, normal, across)},{axes})")
        return self.edge(key, start, stop, curve, same=side.turn > 0)

    def face(self, loops: Sequence[Sequence[int]], surface: int, name: str, same: bool) -> int:
        bounds = []
        for k, loop in enumerate(loops):
            wire = self.add(f"EDGE_LOOP('',{_list(loop)})")
            bounds.append(self.add(f"{'FACE_BOUND' if k else 'FACE_OUTER_BOUND'}('',#{wire},.T.)"))
        return self.add(f"ADVANCED_FACE('{name}',{_list(bounds)},#{surface},.{'T' if same else 'F'}.)")

    def side(self, side: Side, ends: Sequence[End], name: str) -> int:
        """Along the first end, up at the end of the edge, back along the last end, down at its start."""
        ups, downs = [self.way(ways[-1]) for ways in side.ways], [self.way(ways[0]) for ways in side.ways]
        near, far = (self.rim(side, which, ends[side.stations[which]]) for which in (0, 1))
        loop = [self.oriented(near, True), *(self.oriented(up, True) for up in ups)]
        loop += [self.oriented(far, False), *(self.oriented(down, False) for down in downs[::-1])]
        return self.face([loop], self.surface(side), name, same=side.axis is None or side.turn > 0)

    def surface(self, side: Side) -> int:
        (a, b), (d, _) = side.corners
        if side.axis is not None:
            frame = self.placement(side.axis[0], side.axis[1] - side.axis[0], a - side.axis[0])
            return self.add(f"CYLINDRICAL_SURFACE('',#{frame},{real(side.radius * MILLIMETRES_PER_METRE)})")
        if side.kind == "plane":
            return self.add(f"PLANE('',#{self.placement(a, np.cross(b - a, d - a), b - a)})")
        # u across from start to end, v along the member: du x dv points outward
        ways = side.ways[0]
        rows = ",".join(_list(self.point(p) for p in way.points) for way in ways)
        degree, n = len(ways) - 1, len(ways[0].points)
        knots = f"({degree + 1},{degree + 1}),({n},{n}),(0.,1.),(0.,1.),.PIECEWISE_BEZIER_KNOTS."
        if degree == 1:
            return self.add(f"B_SPLINE_SURFACE_WITH_KNOTS('',1,{n - 1},({rows}),.UNSPECIFIED.,.F.,.F.,.F.,{knots})")
        weights = ",".join("(" + ",".join([real(w)] * n) + ")" for w in (1.0, side.weight, 1.0))
        return self.add(
            f"(BOUNDED_SURFACE()B_SPLINE_SURFACE(2,{n - 1},({rows}),.UNSPECIFIED.,.F.,.F.,.F.)B_SPLINE_SURFACE_WITH_KNOTS({knots})"
            f"GEOMETRIC_REPRESENTATION_ITEM()RATIONAL_B_SPLINE_SURFACE(({weights}))REPRESENTATION_ITEM('')SURFACE())"
        )

    def end(self, sides: Sequence[Side], end: End, station: int, is_last: bool, name: str) -> int:
        """The last end has the loops of the outline, the first one the same backwards."""
        which, loops = int(is_last), []
        here = [side for side in sides if side.stations[which] == station]
        for number in sorted({side.loop for side in here}):
            rims = [self.oriented(self.rim(side, which, end), is_last) for side in here if side.loop == number]
            loops.append(rims if is_last else rims[::-1])
        return self.face(loops, self.add(f"PLANE('',#{self.placement(end.origin, end.normal, end.x)})"), name, same=True)
