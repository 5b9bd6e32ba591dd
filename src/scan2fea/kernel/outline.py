"""The outline of a section as a draughtsman draws it: straight edges, true arcs and circles, root fillets where they are asked for.

`kernel.sections` gives the corners; here circles stay circles, so that `cad` can write true cylinders and the mesh its chords, from one source.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.kernel.sections import ROUND, check_section, edge_names, section
from scan2fea.types import FloatArray, IntArray, Member, Section, Value

SLOPING = ("I", "C")  # families whose flanges may slope


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


@dataclass(frozen=True, kw_only=True)
class Slant(Value):
    """How inner faces of flanges slope: by `slope` about the middle of what stands out from near to far along x, metres, where they are tf thick.

    h : height of the section.
    """

    slope: float
    near: float
    far: float
    tf: float
    h: float

    @staticmethod
    def of(family: str, values: Mapping[str, float], slope: float) -> Slant | None:
        """None for sections that have no such faces."""
        if family not in SLOPING or not slope:
            return None
        near, far = flange_span(family, values)
        return Slant(slope=slope, near=near, far=far, tf=values["tf"], h=values["h"])

    def thickness(self, x: FloatArray) -> FloatArray:
        """(n,) of the flange at x (n,), within the web as beside it."""
        across = np.clip(np.abs(x), self.near, self.far)
        return np.asarray(self.tf + self.slope * ((self.near + self.far) / 2 - across))

    def sloped(self, points: FloatArray) -> FloatArray:
        """(n, 2) points of a section with parallel flanges where they lie in the sloping one: flanges and web stretch along y."""
        return self._stretched(points, np.full(len(points), self.tf), self.thickness(points[:, 0]))

    def level(self, points: FloatArray) -> FloatArray:
        """The way back from `sloped`, to 1e-12 m, so that faces are exactly level."""
        return np.round(self._stretched(points, self.thickness(points[:, 0]), np.full(len(points), self.tf)), 12)

    def _stretched(self, points: FloatArray, old: FloatArray, new: FloatArray) -> FloatArray:
        """Depths below the outer faces up to `old` become up to `new`, deeper ones share the rest."""
        depth = self.h / 2 - np.abs(points[:, 1])
        deep = np.where(depth <= old, depth * new / old, new + (depth - old) * (self.h / 2 - new) / (self.h / 2 - old))
        return np.stack([points[:, 0], np.sign(points[:, 1]) * (self.h / 2 - deep)], axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Outline(Value):
    """loops : the outer one first, counter-clockwise; holes clockwise.   slant : of sloping flanges."""

    family: str
    loops: tuple[tuple[Edge, ...], ...]
    slant: Slant | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The faces in order, each once."""
        return tuple(dict.fromkeys(edge.name for loop in self.loops for edge in loop))


def outline(family: str, values: Mapping[str, float], root_radius_m: float = 0.0, toe_radius_m: float = 0.0, slope: float = 0.0) -> Outline:
    """The outline of a section. root_radius_m : of the fillets where leg, web and flange meet; of RHS the outer corner radius, the wall being even.

    toe_radius_m : of the inner corners of the toes of L, I and C.   slope : of the inner faces of the flanges of I and C, which are tf thick in the
    middle of what stands out of the web. Raises UsageError as `kernel.sections.check_section`, and where a fillet does not fit.
    """
    check_section(family, values)
    for name, value in (("root radius", root_radius_m), ("toe radius", toe_radius_m)):
        require(math.isfinite(value) and value >= 0, UsageError, f"{name} is {value} m; it must be 0 or more")
    if family in ROUND:
        radii = [values["d"] / 2] if family == "round" else [values["d"] / 2, values["d"] / 2 - values["t"]]
        return Outline(
            family=family, loops=tuple((_circle(name, r, sign),) for name, r, sign in zip(("OUTER", "INNER"), radii, (1, -1), strict=False))
        )
    shape = section(family, values)
    if family == "RHS":
        loops = []
        for loop, names, radius, arcs in zip(
            shape.loops, shape.face_names, (root_radius_m, max(0.0, root_radius_m - values["t"])), ("CORNER", "INNER_CORNER"), strict=True
        ):
            loops.append(_rounded(loop, names, {arcs: (radius, np.arange(len(loop)))}))
        return Outline(family=family, loops=tuple(loops))
    (loop,), (names,), slant = shape.loops, shape.face_names, Slant.of(family, values, slope)
    if slant is not None:
        says = f"flanges of slope {slope:.3g} that are {values['tf']:.6g} m thick in the middle have no thickness at their toes"
        require(slant.thickness(loop[:, 0]).min() > 0, UsageError, says)
        loop = slant.sloped(loop)
    arcs_at = {"ROOT": (root_radius_m, re_entrant(loop)), "TOE_CORNER": (toe_radius_m, toe_corners(family))}
    return Outline(family=family, loops=(_rounded(loop, names, arcs_at),), slant=slant)


def outline_of(member: Member, root_radius_m: float | None = None) -> Outline:
    """The outline of a member with its fillets and slopes. root_radius_m : in place of its own."""
    root = member.root
    return outline(member.family, member.values(), root.radius_m if root_radius_m is None else root_radius_m, root.toe_m, root.slope)


def flange_span(family: str, values: Mapping[str, float]) -> tuple[float, float]:
    """From where to where flanges of I and C stand out of the web, metres along x of the section."""
    return (values["tw"] / 2, values["b"] / 2) if family == "I" else (values["tw"], values["b"])


def re_entrant(loop: FloatArray) -> IntArray:
    """Which corners of an outline (k, 2) are re-entrant."""
    after = np.roll(loop, -1, axis=0) - loop
    before = np.roll(after, 1, axis=0)
    return np.flatnonzero(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < 0)


def toe_corners(family: str) -> IntArray:
    """Which corners of the outer loop lie between a toe and an inner face, of L, I and C."""
    names = edge_names(family)[0]
    meets = [("TOE" in names[i - 1]) != ("TOE" in name) and "INNER" in names[i - 1] + name for i, name in enumerate(names)]
    return np.flatnonzero(np.array(meets) & (family in ("L", *SLOPING)))


def _circle(name: str, radius: float, sign: int) -> Edge:
    at = np.array([radius, 0.0])
    return Edge(name=name, start=at, end=at, centre=np.zeros(2), turn=sign * 2 * math.pi)


def _rounded(loop: FloatArray, names: tuple[str, ...], arcs: Mapping[str, tuple[float, IntArray]]) -> tuple[Edge, ...]:
    """The polygon with corners replaced by arcs, by the name of each sort its radius and its corners: ROOT_1, ..."""
    n = len(loop)
    along = np.roll(loop, -1, axis=0) - loop
    length = np.linalg.norm(along, axis=1)
    unit = along / length[:, None]
    before = np.roll(unit, 1, axis=0)
    turn = np.arctan2(before[:, 0] * unit[:, 1] - before[:, 1] * unit[:, 0], (before * unit).sum(1))
    radius, arc = np.zeros(n), dict[int, str]()
    for name, (size, at) in arcs.items():
        radius[at] = size
        arc |= {i: f"{name}_{k}" for k, i in enumerate(at.tolist(), start=1) if size > 0}
    back = radius * np.tan(np.abs(turn) / 2)
    room = length - back - np.roll(back, -1)
    sizes = " and a ".join(f"{name.lower().replace('_', ' ')} radius of {size:.6g} m" for name, (size, _) in arcs.items() if size > 0)
    says = f"a {sizes} does not fit the section: an edge is only {length.min():.6g} m long"
    require((room > 0).all(), UsageError, says)
    edges: list[Edge] = []
    for i in range(n):
        if i in arc:
            side = np.array([-before[i][1], before[i][0]]) * math.copysign(radius[i], turn[i])
            start, end = loop[i] - back[i] * before[i], loop[i] + back[i] * unit[i]
            edges.append(Edge(name=arc[i], start=start, end=end, centre=start + side, turn=float(turn[i])))
        j = (i + 1) % n
        edges.append(Edge(name=names[i], start=loop[i] + back[i] * unit[i], end=loop[j] - back[j] * unit[i]))
    return tuple(edges)


def as_section(shape: Outline, n_chords: int = 96) -> Section:
    """The outline as polygons, arcs as so many chords to a full circle, each under the name of its arc."""
    loops, names = [], []
    for loop in shape.loops:
        n = [1 if edge.centre is None else max(2, round(n_chords * abs(edge.turn) / (2 * math.pi))) for edge in loop]
        loops.append(np.concatenate([_on_edge(edge, np.arange(k) / k)[0] for edge, k in zip(loop, n, strict=True)]))
        names.append(tuple(edge.name for edge, k in zip(loop, n, strict=True) for _ in range(k)))
    return Section(family=shape.family, loops=tuple(loops), face_names=tuple(names))


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
