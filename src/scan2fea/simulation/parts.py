"""Parts that are no plain member, with their closed forms and the lines to measure them on: boxes, drums, brackets, vessels, girders, tables."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.construction import Hole, Plain, Stroke, Turned
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation import shapes
from scan2fea.simulation.closed_forms import Moments, block, dish, half_spheroid_area, rod, together, without
from scan2fea.simulation.girder import girder_mesh
from scan2fea.simulation.polyhedra import revolved
from scan2fea.simulation.solids import Probe, Shape
from scan2fea.types import FloatArray, TriangleMesh

X, Y, Z = np.eye(3)


def _probe(name: str, middle: Sequence[float], direction: FloatArray, size_m: float) -> Probe:
    return Probe(name=name, middle=np.array(middle, float), direction=direction, size_m=size_m)


def _positive(kind: str, **sizes: float) -> None:
    for name, value in sizes.items():
        require(math.isfinite(value) and value > 0, InputError, f"{kind}: {name} is {value} m; it must be positive")


def _moved(moments: Moments, t: Sequence[float]) -> Moments:
    return moments.moved(rigid(np.eye(3), t))


def box(x: float, y: float, z: float) -> Shape:
    """A block from the origin to (x, y, z)."""
    _positive("box", x=x, y=y, z=z)
    middle = (x / 2, y / 2, z / 2)
    probes = tuple(_probe(f"s{name}", middle, axis, size) for name, axis, size in (("x", X, x), ("y", Y, y), ("z", Z, z)))
    mesh = shapes.box(x, y, z)
    return Shape(
        kind="box", family="box", parameters={"sx": x, "sy": y, "sz": z}, mesh=mesh, exact=block((0, 0, 0), (x, y, z)), chord_m=0.0,
        section=(), n_cad_faces=6, probes=probes, base=Plain(mesh=mesh),
    )  # fmt: skip


def cylinder(radius: float, length: float, chord_m: float) -> Shape:
    """A drum about z from 0 to the length."""
    _positive("cylinder", radius=radius, length=length)
    probes = [_probe("d", (0, 0, s * length), axis, 2 * radius) for axis in (X, Y) for s in (0.2, 0.5, 0.8)]
    probes.append(_probe("length", (0, 0, length / 2), Z, length))
    return Shape(
        kind="cylinder", family="free", parameters={"d": 2 * radius, "length": length}, mesh=shapes.cylinder(radius, length, chord_m),
        exact=rod(radius, length), chord_m=chord_m, section=(), n_cad_faces=3, probes=tuple(probes),
        base=_turned([(0, 0), (radius, 0), (radius, length), (0, length)], ("BOTTOM", "SIDE", "TOP")),
    )  # fmt: skip


def table(x: float, y: float, height: float, top: float, leg: float, inset: float) -> Shape:
    """A top on four square legs."""
    _positive("table", x=x, y=y, height=height, top=top, leg=leg, inset=inset)
    below = height - top
    legs = [block((p, q, 0), (p + leg, q + leg, below)) for p in (inset, x - inset - leg) for q in (inset, y - inset - leg)]
    mesh = shapes.table(x, y, height, top, leg, inset)
    exact = together(block((0, 0, below), (x, y, height)), *legs).with_area(2 * x * y + 2 * (x + y) * top + 16 * leg * below)
    probes = (_probe("top", (x / 2, y / 2, height - top / 2), Z, top), _probe("leg", (inset + leg / 2, inset + leg / 2, below / 2), X, leg))
    named = {"x": x, "y": y, "height": height, "top": top, "leg": leg, "inset": inset}
    return Shape(
        kind="table", family="free", parameters=named, mesh=mesh, exact=exact, chord_m=0.0, section=(), n_cad_faces=26, probes=probes,
        base=Plain(mesh=mesh),
    )  # fmt: skip


def bracket(a: float, b: float, t: float, width: float, holes: Sequence[tuple[str, float, float, float]], chord_m: float) -> Shape:
    """An angle plate with round holes (leg, distance from the heel, place along the width, radius) through its legs."""
    _positive("bracket", a=a, b=b, t=t, width=width)
    mesh = shapes.bracket(a, b, t, width, holes, chord_m)
    bored = [_bore(*hole, t) for hole in holes]
    solid = without(together(block((0, 0, 0), (b, t, width)), block((0, t, 0), (t, a, width))), *bored)
    plain = 2 * t * (a + b - t) + 2 * (a + b) * width
    exact = solid.with_area(plain + sum(2 * math.pi * r * t - 2 * math.pi * r**2 for *_, r in holes))
    free_a, free_b = _free_place(holes, "a", t, a, width), _free_place(holes, "b", t, b, width)
    probes = [_probe("t", (t / 2, free_a[0], free_a[1]), X, t), _probe("t", (free_b[0], t / 2, free_b[1]), Y, t)]
    probes += [_probe("width", (t / 2, t / 2, width / 2), Z, width)]
    parameters = {"a": a, "b": b, "t": t, "width": width}
    return Shape(
        kind="bracket", family="free", parameters=parameters, mesh=mesh, exact=exact, chord_m=chord_m if len(holes) else 0.0, section=(),
        n_cad_faces=8 + len(holes), probes=tuple(probes),
        base=Plain(mesh=shapes.bracket(a, b, t, width, ()), holes=tuple(_hole(*hole, t) for hole in holes)),
    )  # fmt: skip


def _hole(leg: str, along: float, z: float, radius: float, t: float) -> Hole:
    if leg == "a":
        return Hole(start=np.array([0.0, along, z]), through=t * X, radius_m=radius)
    return Hole(start=np.array([along, 0.0, z]), through=t * Y, radius_m=radius)


def _turned(corners: Sequence[Sequence[float]], names: tuple[str, ...], domes: Mapping[int, tuple[float, float, float]] | None = None) -> Turned:
    """Strokes between corners (radius, z); domes : number of a stroke -> height of the centre on the axis, and the semi-axes, of its ellipse."""
    at = np.asarray(corners, float)
    strokes = []
    for k, (start, end) in enumerate(itertools.pairwise(at)):
        dome = (domes or {}).get(k)
        centre, semi = (None, None) if dome is None else (np.array([0.0, dome[0]]), np.array(dome[1:]))
        strokes.append(Stroke(start=start, end=end, centre=centre, semi_axes=semi))
    return Turned(profile=tuple(strokes), names=names)


def _bore(leg: str, along: float, z: float, radius: float, t: float) -> Moments:
    if leg == "a":
        return rod(radius, t).moved(rigid(rotation_about(Y, math.pi / 2), (0.0, along, z)))
    return rod(radius, t).moved(rigid(rotation_about(X, -math.pi / 2), (along, 0.0, z)))


def _free_place(holes: Sequence[tuple[str, float, float, float]], leg: str, t: float, size: float, width: float) -> tuple[float, float]:
    """A place on a leg (from the heel, along the width) as far from its holes and rims as a grid of 15 x 15 places tells."""
    p, q = (g.ravel() for g in np.meshgrid(np.linspace(t, size, 17)[1:-1], np.linspace(0, width, 17)[1:-1], indexing="ij"))
    room = np.minimum.reduce([p - t, size - p, q, width - q])
    for where, along, z, radius in holes:
        if where == leg:
            room = np.minimum(room, np.hypot(p - along, q - z) - radius)
    best = int(np.argmax(room))
    return float(p[best]), float(q[best])


def tank(radius: float, height: float, wall: float, chord_m: float) -> Shape:
    """An open vessel about z: a straight shell on an ellipsoidal 2:1 bottom, the wall as thick at the pole as along the shell."""
    _positive("tank", radius=radius, height=height, wall=wall)
    mesh = shapes.tank(radius, height, wall, chord_m)
    d, r = radius / 2, radius - wall
    outer = together(dish(radius, d), _moved(rod(radius, height - d), (0, 0, d)))
    inner = together(_moved(dish(r, d - wall), (0, 0, wall)), _moved(rod(r, height - d), (0, 0, d)))
    sides = 2 * math.pi * (radius + r) * (height - d)
    area = half_spheroid_area(radius, d) + half_spheroid_area(r, d - wall) + sides + math.pi * (radius**2 - r**2)
    probes = [_probe("t", (s * (radius - wall / 2), 0, z), X, wall) for s in (-1, 1) for z in np.linspace(d, height, 5)[1:-1]]
    probes += [_probe("d*", (0, 0, z), axis, 2 * radius) for axis in (X, Y) for z in np.linspace(d, height, 4)[1:-1]]
    parameters = {"d": 2 * radius, "height": height, "t": wall}
    return Shape(
        kind="tank", family="free", parameters=parameters, mesh=mesh, exact=without(outer, inner).with_area(area), chord_m=chord_m, section=(),
        n_cad_faces=5, probes=tuple(probes),
        base=_turned(
            [(0, 0), (radius, d), (radius, height), (r, height), (r, d), (0, wall)], ("BOTTOM", "SHELL", "RIM", "INNER_SHELL", "INNER_BOTTOM"),
            {0: (d, radius, d), 4: (d, r, d - wall)},
        ),
    )  # fmt: skip


def vessel(radius: float, length: float, chord_m: float) -> Shape:
    """A solid drum about z with ellipsoidal 2:1 heads, `length` from pole to pole."""
    _positive("vessel", radius=radius, length=length)
    d = radius / 2
    require(length > 2 * d, InputError, f"vessel: length is {length} m; it must exceed {2 * d} m, its two heads")
    angle = np.linspace(0, np.pi / 2, max(4, shapes.segments_of(radius, chord_m) // 4 + 1))
    head = np.c_[radius * np.sin(angle), d * (1 - np.cos(angle))]
    profile = np.concatenate([head, np.c_[head[::-1, 0], length - head[::-1, 1]]])
    profile[[0, -1], 0] = 0.0
    mesh = revolved(profile, shapes.segments_of(radius, chord_m))
    upper = dish(radius, d).moved(rigid(rotation_about(X, math.pi), (0, 0, length)))
    exact = together(dish(radius, d), _moved(rod(radius, length - 2 * d), (0, 0, d)), upper)
    exact = exact.with_area(2 * half_spheroid_area(radius, d) + 2 * math.pi * radius * (length - 2 * d))
    probes = [_probe("d", (0, 0, z), axis, 2 * radius) for axis in (X, Y) for z in np.linspace(d, length - d, 4)[1:-1]]
    return Shape(
        kind="vessel", family="free", parameters={"d": 2 * radius, "length": length}, mesh=mesh, exact=exact, chord_m=chord_m, section=(),
        n_cad_faces=3, probes=(*probes, _probe("length", (0, 0, length / 2), Z, length)),
        base=_turned(
            [(0, 0), (radius, d), (radius, length - d), (0, length)], ("LOWER_HEAD", "SHELL", "UPPER_HEAD"),
            {0: (d, radius, d), 2: (length - d, radius, d)},
        ),
    )  # fmt: skip


def girder(h: float, b: float, tw: float, tf: float, length: float, ts: float, bs: float, n_stiffeners: int) -> Shape:
    """A welded I along z, centred, with pairs of stiffeners of full depth, `ts` thick and `bs` wide, at equal distances."""
    _positive("girder", h=h, b=b, tw=tw, tf=tf, length=length, ts=ts, bs=bs)
    mesh: TriangleMesh = girder_mesh(h, b, tw, tf, length, ts, bs, n_stiffeners)
    inner, at = h / 2 - tf, length * np.arange(1, n_stiffeners + 1) / (n_stiffeners + 1)
    flanges = [block((-b / 2, y, 0), (b / 2, y + tf, length)) for y in (-h / 2, inner)]
    web = block((-tw / 2, -inner, 0), (tw / 2, inner, length))
    plates = [block((x, -inner, z - ts / 2), (x + bs, inner, z + ts / 2)) for x in (-tw / 2 - bs, tw / 2) for z in at]
    bare = 2 * length * (2 * b + h - tw) + 2 * (2 * b * tf + tw * (h - 2 * tf))
    exact = together(*flanges, web, *plates).with_area(bare + len(plates) * 2 * bs * (2 * inner - ts))
    bays = (np.arange(n_stiffeners + 1) + 0.5) * length / (n_stiffeners + 1)
    probes = [_probe("tw", (0, 0, z), X, tw) for z in bays] + [_probe("h", (0, 0, z), Y, h) for z in bays]
    probes += [_probe("tf", (s * (b + tw) / 4, v * (h - tf) / 2, z), Y, tf) for z in bays for s in (-1, 1) for v in (-1, 1)]
    probes += [_probe("ts", (s * (tw + bs) / 2, 0, z), Z, ts) for z in at for s in (-1, 1)]
    probes += [_probe("b", (0, v * (h - tf) / 2, z), X, b) for z in bays for v in (-1, 1)]
    parameters = {"h": h, "b": b, "tw": tw, "tf": tf, "ts": ts, "bs": bs, "length": length}
    return Shape(
        kind="girder", family="free", parameters=parameters, mesh=mesh, exact=exact, chord_m=0.0, section=(), n_cad_faces=14 + 8 * n_stiffeners,
        probes=tuple(probes), base=Plain(mesh=mesh),
    )  # fmt: skip
