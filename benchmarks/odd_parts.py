"""Odd single parts as closed meshes: what FE users scan and no room of the product was made for. Drawn by gmsh from their own dimensions."""

from __future__ import annotations

import math
from collections.abc import Callable

import gmsh
import numpy as np
from gmsh_surface import meshed_surface

from scan2fea.kernel.measures import volume
from scan2fea.types import TriangleMesh

Rng = np.random.Generator
Drawn = tuple[list[int], float]  # tags of the solids that make the part once fused, and its thinnest wall


def _box(x: float, y: float, z: float, dx: float, dy: float, dz: float) -> int:
    return int(gmsh.model.occ.addBox(x, y, z, dx, dy, dz))


def _rod(at: tuple[float, float, float], along: tuple[float, float, float], r: float) -> int:
    return int(gmsh.model.occ.addCylinder(*at, *along, r))


def _cut(solids: list[int], tools: list[int]) -> list[int]:
    left, _ = gmsh.model.occ.cut([(3, s) for s in solids], [(3, t) for t in tools])
    return [tag for _, tag in left]


def _prism(outline: list[tuple[float, float]], z: float, height: float) -> int:
    """A polygon in x, y at z, pulled along z."""
    occ = gmsh.model.occ
    corner = [occ.addPoint(x, y, z) for x, y in outline]
    lines = [occ.addLine(a, b) for a, b in zip(corner, [*corner[1:], corner[0]], strict=True)]
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    return next(int(tag) for dim, tag in occ.extrude([(2, face)], 0, 0, height) if dim == 3)


def stiffened(rng: Rng) -> Drawn:
    """A plate with four bolt holes and a stiffener across it."""
    t, x, y = rng.uniform(0.008, 0.016), rng.uniform(0.25, 0.4), rng.uniform(0.18, 0.3)
    r = rng.uniform(0.008, 0.014)
    holes = [_rod((sx * x * 0.4, sy * y * 0.38, -t), (0, 0, 3 * t), r) for sx in (-1, 1) for sy in (-1, 1)]
    return [*_cut([_box(-x / 2, -y / 2, 0, x, y, t)], holes), _box(-x / 2, -t / 2, t, x, t, y * rng.uniform(0.2, 0.4))], t


def elbow(rng: Rng) -> Drawn:
    """A pipe that turns by a right angle, with straight ends."""
    r, occ = rng.uniform(0.05, 0.12), gmsh.model.occ
    t, bend, leg = r * rng.uniform(0.12, 0.2), 3 * r, rng.uniform(1, 3) * r
    whole = []
    for radius in (r, r - t):
        turn = occ.addTorus(0, 0, 0, bend, radius, angle=math.pi / 2)
        whole.append([turn, _rod((bend, 0, 0), (0, -leg, 0), radius), _rod((0, bend, 0), (-leg, 0, 0), radius)])
    return _cut(whole[0], whole[1]), t


def shaft(rng: Rng) -> Drawn:
    """A stepped shaft with a keyway."""
    z, solids, r = 0.0, [], rng.uniform(0.02, 0.05)
    for factor in (1.0, rng.uniform(1.2, 1.6), rng.uniform(0.7, 0.9)):
        length = rng.uniform(2, 4) * r
        solids.append(_rod((0, 0, z), (0, 0, length), factor * r))
        z += length
    return _cut(solids, [_box(0.6 * r, -0.15 * r, 0.3 * r, r, 0.3 * r, r)]), 0.6 * r


def gusset(rng: Rng) -> Drawn:
    """An angle bracket of two plates with a triangular gusset between them."""
    a, w = rng.uniform(0.12, 0.25), rng.uniform(0.08, 0.16)
    t = a * rng.uniform(0.06, 0.1)
    rib = _prism([(t, t), (0.8 * a, t), (t, 0.8 * a)], w / 2 - t / 2, t)
    hole = [_rod((0.6 * a, -t, z), (0, 3 * t, 0), 0.05 * a) for z in (0.2 * w, 0.8 * w)]
    return [*_cut([_box(0, 0, 0, a, t, w)], hole), _box(0, 0, 0, t, a, w), rib], t


def bolted(rng: Rng) -> Drawn:
    """A channel with a plate bolted on its back: heads of bolts stand out."""
    h, length = rng.uniform(0.1, 0.2), rng.uniform(0.5, 0.9)
    t, b = 0.08 * h, 0.5 * h
    solids = [_box(0, -h / 2, 0, t, h, length), _box(0, -h / 2, 0, b, t, length), _box(0, h / 2 - t, 0, b, t, length)]
    solids.append(_box(-t, -0.4 * h, 0.3 * length, t, 0.8 * h, 0.3 * length))
    heads = [_rod((-1.9 * t, y * h, z * length), (t, 0, 0), 0.09 * h) for y in (-0.25, 0.25) for z in (0.36, 0.54)]
    return [*solids, *heads], t


def haunched(rng: Rng) -> Drawn:
    """An I whose web deepens towards one end, as at the eaves of a portal frame."""
    h, length = rng.uniform(0.15, 0.25), rng.uniform(0.9, 1.4)
    t, tf, b, deep = 0.045 * h, 0.07 * h, 0.55 * h, h * rng.uniform(0.5, 0.9)
    low = lambda up: [(0, up), (0.6 * length, up), (length, up - deep)]  # noqa: E731
    web = _prism([*low(tf / 2), (length, h - tf / 2), (0, h - tf / 2)], -t / 2, t)
    return [web, _box(0, h - tf, -b / 2, length, tf, b), _prism([*low(0.0), *[(x, y + tf) for x, y in reversed(low(0.0))]], -b / 2, b)], t


def castellated(rng: Rng) -> Drawn:
    """An I with six-sided openings in its web."""
    h, n = rng.uniform(0.15, 0.3), int(rng.integers(4, 7))
    t, tf, b, pitch = 0.05 * h, 0.07 * h, 0.5 * h, 0.9 * h
    length, r = (n + 0.3) * pitch, 0.3 * h
    opening = [
        _prism([(x + r * math.cos(k * math.pi / 3), h / 2 + r * math.sin(k * math.pi / 3)) for k in range(6)], -t, 2 * t)
        for x in (np.arange(n) + 0.65) * pitch
    ]
    web = _cut([_box(0, tf / 2, -t / 2, length, h - tf, t)], opening)
    return [*web, _box(0, 0, -b / 2, length, tf, b), _box(0, h - tf, -b / 2, length, tf, b)], t


def cone(rng: Rng) -> Drawn:
    """A blunt solid cone."""
    r = rng.uniform(0.05, 0.2)
    return [int(gmsh.model.occ.addCone(0, 0, 0, 0, 0, rng.uniform(1, 3) * r, r, r * rng.uniform(0.2, 0.7)))], 0.4 * r


def reducer(rng: Rng) -> Drawn:
    """A hollow cone between two short pipes."""
    r, occ = rng.uniform(0.06, 0.12), gmsh.model.occ
    t, small, leg, long = 0.15 * r, 0.6 * r, 0.8 * r, 2 * r
    whole = [
        [_rod((0, 0, -leg), (0, 0, leg), r - d), occ.addCone(0, 0, 0, 0, 0, long, r - d, small - d), _rod((0, 0, long), (0, 0, leg), small - d)]
        for d in (0, t)
    ]
    return _cut(whole[0], whole[1]), t


def flanged(rng: Rng) -> Drawn:
    """A pipe with a flange of six holes at each end."""
    r, length = rng.uniform(0.05, 0.1), rng.uniform(0.3, 0.6)
    t, d = 0.14 * r, 0.25 * r
    discs = [_rod((0, 0, z), (0, 0, d), 1.8 * r) for z in (0, length - d)]
    angle = np.arange(6) * math.pi / 3
    holes = [_rod((1.4 * r * math.cos(a), 1.4 * r * math.sin(a), -d), (0, 0, length + 2 * d), 0.16 * r) for a in angle]
    return _cut([*discs, _rod((0, 0, 0), (0, 0, length), r)], [*holes, _rod((0, 0, -d), (0, 0, length + 2 * d), r - t)]), t


def casting(rng: Rng) -> Drawn:
    """A foot with a boss, a bore and four ribs."""
    r, height = rng.uniform(0.03, 0.06), rng.uniform(0.1, 0.2)
    t, foot = 0.35 * r, 3.2 * r
    ribs = [_prism([(0, t / 2), (0.9 * foot, t / 2), (0, 0.8 * height)], -t / 2, t) for _ in range(4)]
    for k, rib in enumerate(ribs):
        gmsh.model.occ.rotate([(3, rib)], 0, 0, 0, 1, 0, 0, math.pi / 2)
        gmsh.model.occ.rotate([(3, rib)], 0, 0, 0, 0, 0, 1, k * math.pi / 2)
    solids = [_rod((0, 0, 0), (0, 0, t), foot), _rod((0, 0, 0), (0, 0, height), r), *ribs]
    return _cut(solids, [_rod((0, 0, 0.3 * height), (0, 0, height), 0.6 * r)]), t


def endplate(rng: Rng) -> Drawn:
    """An I with an end plate that is larger than its section."""
    h, length = rng.uniform(0.12, 0.22), rng.uniform(0.6, 1.2)
    t, tf, b = 0.05 * h, 0.08 * h, 0.6 * h
    solids = [_box(-t / 2, -h / 2, 0, t, h, length), _box(-b / 2, -h / 2, 0, b, tf, length), _box(-b / 2, h / 2 - tf, 0, b, tf, length)]
    holes = [_rod((x * b, y * h, -2 * tf), (0, 0, 3 * tf), 0.06 * h) for x in (-0.4, 0.4) for y in (-0.64, 0.64)]
    plate = _cut([_box(-0.6 * b, -0.75 * h, -1.5 * tf, 1.2 * b, 1.5 * h, 1.5 * tf)], holes)
    return [*solids, *plate], t


def milled(rng: Rng) -> Drawn:
    """A block with a pocket, a step and a blind hole."""
    x, y, z = rng.uniform(0.1, 0.25), rng.uniform(0.08, 0.15), rng.uniform(0.04, 0.08)
    tools = [_box(0.1 * x, 0.2 * y, 0.4 * z, 0.4 * x, 0.6 * y, z), _box(0.75 * x, -y, 0.6 * z, x, 3 * y, z)]
    tools.append(_rod((0.62 * x, 0.5 * y, 0.3 * z), (0, 0, z), 0.12 * y))
    return _cut([_box(0, 0, 0, x, y, z)], tools), 0.1 * x


def zed(rng: Rng) -> Drawn:
    """A Z: a section that is in no table of ours."""
    h, length = rng.uniform(0.1, 0.2), rng.uniform(0.6, 1.2)
    t, b = 0.06 * h, 0.4 * h
    return [_box(-t / 2, 0, 0, t, h, length), _box(-b, 0, 0, b + t / 2, t, length), _box(-t / 2, h - t, 0, b + t / 2, t, length)], t


PARTS: dict[str, Callable[[Rng], Drawn]] = {
    f.__name__: f
    for f in (stiffened, elbow, shaft, gusset, bolted, haunched, castellated, cone, reducer, flanged, casting, endplate, milled, zed)
}  # fmt: skip


def meshed(name: str, rng: Rng) -> tuple[TriangleMesh, float]:
    """The part as one closed mesh about its middle, and its thinnest wall."""
    gmsh.initialize(interruptible=False)
    try:
        for option, value in (("General.Terminal", 0), ("General.NumThreads", 1), ("Mesh.MeshSizeFromCurvature", 90)):
            gmsh.option.setNumber(option, value)
        solids, wall = PARTS[name](rng)
        if len(solids) > 1:
            gmsh.model.occ.fuse([(3, solids[0])], [(3, s) for s in solids[1:]])
        gmsh.model.occ.synchronize()
        left = gmsh.model.getEntities(3)
        assert len(left) == 1, f"{name}: {len(left)} solids"
        points, faces = meshed_surface()
    finally:
        gmsh.finalize()
    mesh = TriangleMesh(vertices=points - (points.min(0) + points.max(0)) / 2, faces=faces)
    assert volume(mesh) > 0, name
    return mesh, wall
