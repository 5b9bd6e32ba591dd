"""Parts as a workshop makes them, in random sizes: brackets, plates, blocks, tanks, flanges, tubes, ribs. Drawn by gmsh; faces and volume are exact.

Each function fuses, cuts and returns the tags of its solids (one part once fused) and its thinnest wall, in metres.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import gmsh
import numpy as np
from gmsh_surface import meshed_surface
from odd_parts import Drawn, Rng, _box, _cut, _prism, _rod

from scan2fea.kernel.measures import volume
from scan2fea.types import TriangleMesh


@dataclass(frozen=True, eq=False, kw_only=True)
class Workpiece:
    """mesh : closed, about its middle, its chords within 1e-3 of a radius.   wall_m : thinnest.   faces : kind -> number.   volume_m3 : exact."""

    mesh: TriangleMesh
    wall_m: float
    faces: dict[str, int]
    volume_m3: float


def _slot(x: float, y: float, z: float, length: float, r: float, depth: float) -> list[int]:
    """A slot along x with round ends, `length` between their centres."""
    ends = [_rod((x + s * length / 2, y, z), (0, 0, depth), r) for s in (-1, 1)]
    whole, _ = gmsh.model.occ.fuse([(3, ends[0])], [(3, ends[1]), (3, _box(x - length / 2, y - r, z, length, 2 * r, depth))])
    return [tag for _, tag in whole]


def angle_bracket(rng: Rng) -> Drawn:
    """Two legs, two bolt holes in each."""
    a, b, w = rng.uniform(0.06, 0.14), rng.uniform(0.05, 0.12), rng.uniform(0.06, 0.12)
    t = rng.uniform(0.006, 0.012)
    r = rng.uniform(0.004, 0.009)
    holes = [_rod((0.65 * a, -t, z * w), (0, 3 * t, 0), r) for z in (0.25, 0.75)]
    holes += [_rod((-t, 0.65 * b, z * w), (3 * t, 0, 0), r) for z in (0.25, 0.75)]
    return _cut([_box(0, 0, 0, a, t, w), _box(0, t, 0, t, b - t, w)], holes), t


def clevis(rng: Rng) -> Drawn:
    """A U of two cheeks on a base, a pin hole through both and two holes in the base."""
    x, y, z = rng.uniform(0.06, 0.1), rng.uniform(0.05, 0.09), rng.uniform(0.06, 0.11)
    t = rng.uniform(0.007, 0.013)
    cheeks = [_box(0, 0, t, t, y, z - t), _box(x - t, 0, t, t, y, z - t)]
    holes = [_rod((-t, y / 2, 0.7 * z), (x + 2 * t, 0, 0), 0.17 * y)] + [_rod((x / 2, k * y, -t), (0, 0, 3 * t), 0.08 * y) for k in (0.25, 0.75)]
    return _cut([_box(0, 0, 0, x, y, t), *cheeks], holes), t


def slotted_plate(rng: Rng) -> Drawn:
    """A plate with two slots and a large hole between."""
    x, y, t = rng.uniform(0.14, 0.3), rng.uniform(0.08, 0.14), rng.uniform(0.006, 0.014)
    tools = [_rod((0, 0, -t), (0, 0, 3 * t), 0.22 * y)]
    for s in (-1, 1):
        tools += _slot(s * 0.32 * x, 0, -t, 0.1 * x, 0.08 * y, 3 * t)
    return _cut([_box(-x / 2, -y / 2, 0, x, y, t)], tools), t


def round_plate(rng: Rng) -> Drawn:
    """A disc with a bore and a circle of holes of two sizes."""
    r, t = rng.uniform(0.06, 0.12), rng.uniform(0.008, 0.016)
    n = int(rng.integers(2, 5))
    angle = np.arange(2 * n) * math.pi / n
    holes = [_rod((0.7 * r * math.cos(a), 0.7 * r * math.sin(a), -t), (0, 0, 3 * t), (0.1, 0.06)[k % 2] * r) for k, a in enumerate(angle)]
    return _cut([_rod((0, 0, 0), (0, 0, t), r)], [*holes, _rod((0, 0, -t), (0, 0, 3 * t), 0.3 * r)]), t


def stepped_block(rng: Rng) -> Drawn:
    """A stair of three steps with a vertical bore through the lowest and a blind one in the highest."""
    x, y, z = rng.uniform(0.08, 0.18), rng.uniform(0.05, 0.1), rng.uniform(0.04, 0.09)
    stair = [_box(0, 0, 0, x, y, 0.3 * z), _box(0, 0, 0.3 * z, 0.66 * x, y, 0.35 * z), _box(0, 0, 0.65 * z, 0.33 * x, y, 0.35 * z)]
    tools = [_rod((0.83 * x, 0.5 * y, -z), (0, 0, 2 * z), 0.16 * y), _rod((0.165 * x, 0.5 * y, 0.5 * z), (0, 0, z), 0.12 * y)]
    return _cut(stair, tools), 0.1 * x


def grooved_block(rng: Rng) -> Drawn:
    """A block with a T-slot along it, a cross bore below it and two chamfers."""
    x, y, z = rng.uniform(0.1, 0.18), rng.uniform(0.07, 0.11), rng.uniform(0.06, 0.09)
    c = 0.12 * z
    block = _prism([(-y / 2, 0), (y / 2, 0), (y / 2, z - c), (y / 2 - c, z), (-y / 2 + c, z), (-y / 2, z - c)], 0, x)
    neck, head = _box(-0.1 * y, 0.5 * z, -x, 0.2 * y, z, 3 * x), _box(-0.22 * y, 0.5 * z, -x, 0.44 * y, 0.2 * z, 3 * x)
    slot = [tag for _, tag in gmsh.model.occ.fuse([(3, neck)], [(3, head)])[0]]  # two tools would leave the floor in three faces
    return _cut([block], [*slot, _rod((-y, 0.25 * z, 0.5 * x), (2 * y, 0, 0), 0.12 * z)]), 0.2 * z


def box_tank(rng: Rng) -> Drawn:
    """An open rectangular tank with a pipe stub in one side."""
    x, y, z = rng.uniform(0.18, 0.35), rng.uniform(0.12, 0.22), rng.uniform(0.1, 0.2)
    t = rng.uniform(0.006, 0.01)
    r = 0.12 * z + t
    solids = _cut([_box(0, 0, 0, x, y, z)], [_box(t, t, t, x - 2 * t, y - 2 * t, z)])
    stub = [*solids, _rod((x - t / 2, 0.5 * y, 0.4 * z), (2.5 * r, 0, 0), r)]
    return _cut(stub, [_rod((x - 2 * t, 0.5 * y, 0.4 * z), (4 * r, 0, 0), r - t)]), t


def drum(rng: Rng) -> Drawn:
    """An open round tank with a rim flange and a drain."""
    r, z, t = rng.uniform(0.08, 0.16), rng.uniform(0.12, 0.24), rng.uniform(0.006, 0.01)
    solids = [_rod((0, 0, 0), (0, 0, z), r), _rod((0, 0, z - t), (0, 0, t), 1.2 * r)]
    return _cut(solids, [_rod((0, 0, t), (0, 0, z), r - t), _rod((0, 0, -t), (0, 0, 3 * t), 0.15 * r)]), t


def hub_flange(rng: Rng) -> Drawn:
    """A round flange with a hub, a bore and bolt holes."""
    r, t = rng.uniform(0.05, 0.1), rng.uniform(0.01, 0.018)
    n = int(rng.integers(4, 9))
    holes = [_rod((0.8 * r * math.cos(a), 0.8 * r * math.sin(a), -t), (0, 0, 3 * t), 0.08 * r) for a in np.arange(n) * 2 * math.pi / n]
    bore = _rod((0, 0, -t), (0, 0, 6 * r), 0.36 * r)
    return _cut([_rod((0, 0, 0), (0, 0, t), r), _rod((0, 0, 0), (0, 0, t + 0.7 * r), 0.55 * r)], [*holes, bore]), 0.19 * r


def square_flange(rng: Rng) -> Drawn:
    """A square plate with four holes on a tube that ends square."""
    a, t, wall = rng.uniform(0.09, 0.16), rng.uniform(0.009, 0.014), rng.uniform(0.007, 0.011)
    r, length = 0.28 * a, rng.uniform(0.8, 1.5) * a
    holes = [_rod((sx * 0.38 * a, sy * 0.38 * a, -t), (0, 0, 3 * t), 0.05 * a) for sx in (-1, 1) for sy in (-1, 1)]
    bore = _rod((0, 0, -t), (0, 0, length + 2 * t), r - wall)
    return _cut([_box(-a / 2, -a / 2, 0, a, a, t), _rod((0, 0, 0), (0, 0, length), r)], [*holes, bore]), wall


def bored_tube(rng: Rng) -> Drawn:
    """A round tube with cross bores of two sizes."""
    r, length = rng.uniform(0.03, 0.06), rng.uniform(0.18, 0.35)
    t = r * rng.uniform(0.15, 0.25)
    tools = [_rod((0, 0, -length), (0, 0, 3 * length), r - t), _rod((-2 * r, 0, 0.25 * length), (4 * r, 0, 0), 0.35 * r)]
    tools.append(_rod((0, 0, 0.7 * length), (0, 2 * r, 0), 0.25 * r))
    return _cut([_rod((0, 0, 0), (0, 0, length), r)], tools), t


def bored_box_tube(rng: Rng) -> Drawn:
    """A square tube, sharp corners, holes through two sides."""
    a, length = rng.uniform(0.05, 0.09), rng.uniform(0.2, 0.4)
    t = rng.uniform(0.005, 0.008)
    tools = [_box(t - a / 2, t - a / 2, -length, a - 2 * t, a - 2 * t, 3 * length)]
    tools += [_rod((-a, 0, z * length), (2 * a, 0, 0), 0.18 * a) for z in (0.2, 0.8)]
    return _cut([_box(-a / 2, -a / 2, 0, a, a, length)], tools), t


def ribbed_base(rng: Rng) -> Drawn:
    """A base plate with three parallel ribs."""
    x, y, t = rng.uniform(0.15, 0.25), rng.uniform(0.1, 0.16), rng.uniform(0.008, 0.012)
    h = rng.uniform(0.02, 0.05)
    return [_box(0, 0, 0, x, y, t), *[_box(0, k * y - t / 2, t, x, t, h) for k in (0.2, 0.5, 0.8)]], t


def ribbed_bracket(rng: Rng) -> Drawn:
    """A bracket with two triangular ribs and two holes in the wall plate."""
    a, b, w = rng.uniform(0.08, 0.14), rng.uniform(0.09, 0.15), rng.uniform(0.08, 0.14)
    t = rng.uniform(0.007, 0.011)
    plates = _cut([_box(0, 0, 0, a, t, w), _box(0, t, 0, t, b - t, w)], [_rod((-t, 0.7 * b, z * w), (3 * t, 0, 0), 0.005) for z in (0.5,)])
    ribs = [_prism([(t, t), (0.8 * a, t), (t, 0.5 * b)], z, t) for z in (0.15 * w, 0.85 * w - t)]
    return [*plates, *ribs], t


def bearing_block(rng: Rng) -> Drawn:
    """A foot with two holes and a round-topped housing with a bore across."""
    r, w = rng.uniform(0.025, 0.045), rng.uniform(0.03, 0.05)
    h, foot, t = 1.6 * r, 4.6 * r, 0.5 * r
    solids = [_box(-foot / 2, 0, 0, foot, w, t), _box(-r, 0, 0, 2 * r, w, h), _rod((0, 0, h), (0, w, 0), r)]
    holes = [_rod((s * 0.36 * foot, w / 2, -t), (0, 0, 3 * t), 0.18 * w) for s in (-1, 1)]
    return _cut(solids, [*holes, _rod((0, -w, h), (0, 3 * w, 0), 0.55 * r)]), 0.45 * r


def lug(rng: Rng) -> Drawn:
    """A lifting lug: a cheek with a round end and an eye, on a base with four holes."""
    x, y, t = rng.uniform(0.1, 0.16), rng.uniform(0.07, 0.11), rng.uniform(0.01, 0.016)
    r, h = 0.22 * x, rng.uniform(0.05, 0.08)
    cheek = [_box(-r, -t / 2, 0, 2 * r, t, t + h), _rod((0, -t / 2, t + h), (0, t, 0), r)]
    holes = [_rod((sx * 0.4 * x, sy * 0.34 * y, -t), (0, 0, 3 * t), 0.07 * y) for sx in (-1, 1) for sy in (-1, 1)]
    return _cut([_box(-x / 2, -y / 2, 0, x, y, t), *cheek], [*holes, _rod((0, -t, t + h), (0, 2 * t, 0), 0.5 * r)]), t


PARTS: dict[str, Callable[[Rng], Drawn]] = {
    f.__name__: f
    for f in (
        angle_bracket, clevis, slotted_plate, round_plate, stepped_block, grooved_block, box_tank, drum, hub_flange, square_flange, bored_tube,
        bored_box_tube, ribbed_base, ribbed_bracket, bearing_block, lug,
    )
}  # fmt: skip


def made(name: str, rng: Rng) -> Workpiece:
    """The part, drawn."""
    gmsh.initialize(interruptible=False)
    try:
        for option, value in (("General.Terminal", 0), ("General.NumThreads", 1), ("Mesh.MeshSizeFromCurvature", 90)):
            gmsh.option.setNumber(option, value)
        solids, wall = PARTS[name](rng)
        occ = gmsh.model.occ
        if len(solids) > 1:
            occ.fuse([(3, solids[0])], [(3, s) for s in solids[1:]])
        occ.synchronize()
        left = gmsh.model.getEntities(3)
        assert len(left) == 1, f"{name}: {len(left)} solids"
        exact = float(occ.getMass(*left[0]))
        kinds = Counter(gmsh.model.getType(*face).lower() for face in gmsh.model.getEntities(2))
        points, faces = meshed_surface()
    finally:
        gmsh.finalize()
    mesh = TriangleMesh(vertices=points - (points.min(0) + points.max(0)) / 2, faces=faces)
    assert abs(volume(mesh) / exact - 1) < 0.005, f"{name}: {volume(mesh)} of {exact}"
    return Workpiece(mesh=mesh, wall_m=wall, faces=dict(kinds), volume_m3=exact)
