"""Shapes that held-out cases are drawn from: members and parts of random size, and what of a member the faces that were seen leave open."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from scan2fea.kernel.construction import Plain
from scan2fea.kernel.sections import PARAMETERS, corner_factors, edge_names
from scan2fea.simulation import freeform, parts
from scan2fea.simulation.members import member
from scan2fea.simulation.solids import Probe, Shape
from scan2fea.types import TriangleMesh

MEMBERS = ("L", "I", "C", "T", "RHS", "CHS", "rect", "round")
PARTS = ("box", "bracket", "tank", "vessel", "blob", "tee", "girder", "cylinder")


@dataclass
class Case:
    """What a case is made of before it is written.

    hidden : faces never seen.   stations : scanned from places, by default a ring; tells_places : and the files hold them.
    clutter : share of stray points.   cut : share of the points kept on one side of a plane along the member, and its angle.
    """

    kind: str
    shape: Shape
    mesh: TriangleMesh
    T: np.ndarray
    sigma_m: float
    noise: str
    unit: str
    n_points: int
    hidden: tuple[str, ...] = ()
    stations: bool = False
    places: np.ndarray | None = None
    tells_places: bool = True
    clutter: float = 0.0
    cut: tuple[float, float] | None = None
    expect: str = "convert"
    seen_fraction: float = 1.0
    unobservable: list[str] = field(default_factory=list)


def in_logarithm(rng: np.random.Generator, low: float, high: float) -> float:
    """Evenly in the logarithm."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def member_shape(kind: str, size: float, rng: np.random.Generator) -> tuple[Shape, TriangleMesh, float]:
    u = rng.uniform
    values: dict[str, float]
    if kind == "L":
        values = {"a": size, "b": size * u(0.55, 1.0), "t": size * u(0.06, 0.14)}
    elif kind in ("I", "C", "T"):
        tw = size * u(0.03, 0.07)
        values = {"h": size, "b": size * u(0.4, 0.8), "tw": tw, "tf": tw * u(1.1, 1.7)}
    elif kind == "RHS":
        values = {"h": size, "b": size * u(0.5, 1.0), "t": size * u(0.035, 0.1)}
    elif kind == "CHS":
        values = {"d": size, "t": size * u(0.04, 0.12)}
    elif kind == "rect":
        values = {"b": size, "t": size * u(0.06, 0.4)}
    else:
        values = {"d": size}
    values = {k: float(f"{v:.3g}") for k, v in values.items()}
    length = float(f"{size * u(4, 14):.3g}")
    shape = member(kind, {**values, "length": length}, 2e-6 * size)  # a pipe of 350 mm with chords of 2e-4 was 0.09 mm thinner than its name
    return shape, shape.mesh, min(v for k, v in values.items())


def part_shape(kind: str, size: float, rng: np.random.Generator) -> tuple[Shape, TriangleMesh, float]:
    """The part, its mesh, and its thinnest wall (0 for a solid one)."""
    u, chord = rng.uniform, 2e-4 * size
    r = lambda x: float(f"{x:.3g}")  # noqa: E731
    wall = 0.0
    if kind == "box":
        shape = parts.box(r(size), r(size * u(0.3, 1)), r(size * u(0.15, 0.8)))
    elif kind == "cylinder":
        shape = parts.cylinder(r(size * u(0.15, 0.5)), r(size), chord)
    elif kind == "blob":
        shape = freeform.blob(r(size / 2), u(0.1, 0.3), int(rng.integers(2**31)), chord)
    elif kind == "vessel":
        shape = parts.vessel(r(size * u(0.15, 0.3)), r(size), chord)
    elif kind == "tank":
        radius, wall = size / 2 * u(0.4, 0.9), r(size * u(0.03, 0.06))
        shape = parts.tank(r(radius), r(size * u(0.6, 1.0)), wall, chord)
    elif kind == "girder":
        b, tw, ts = size * u(0.15, 0.25), size * u(0.009, 0.015), size * u(0.009, 0.015)
        wall = min(r(tw), r(ts))
        n = int(rng.integers(2, 5))
        shape = parts.girder(r(size * u(0.25, 0.4)), r(b), r(tw), r(tw * u(1.2, 1.8)), r(size), r(ts), r(b * u(0.3, 0.42)), n)
    elif kind == "bracket":
        a, wall, width = size * u(0.7, 1.0), r(size * u(0.06, 0.12)), size * u(0.6, 1.2)
        holes = [("a", r(a * 0.6), r(width * 0.25), r(size * u(0.05, 0.1))), ("a", r(a * 0.6), r(width * 0.75), r(size * u(0.05, 0.1)))]
        holes.append(("b", r(size * 0.6), r(width * 0.5), r(size * u(0.06, 0.12))))
        shape = parts.bracket(r(a), r(size), wall, r(width), holes, chord)
    else:
        shape = _tee(r(size * u(0.15, 0.25)), u(0.5, 0.85), r(size), r(size * u(0.4, 0.6)), chord)
    return shape, shape.mesh, wall


def _tee(radius: float, ratio: float, length: float, height: float, chord_m: float) -> Shape:
    """Two round bars that meet at a right angle, fused and meshed by gmsh: along x, and from the axis along z."""
    import gmsh
    from gmsh_surface import meshed_surface

    branch = float(f"{radius * ratio:.3g}")
    gmsh.initialize(interruptible=False)
    try:
        for option, value in (("General.Terminal", 0), ("General.NumThreads", 1), ("Mesh.MeshSizeMax", length / 4)):
            gmsh.option.setNumber(option, value)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", math.ceil(math.pi / math.acos(1 - chord_m / radius)))
        occ = gmsh.model.occ
        occ.fuse([(3, occ.addCylinder(-length / 2, 0, 0, length, 0, 0, radius))], [(3, occ.addCylinder(0, 0, 0, 0, 0, height, branch))])
        occ.synchronize()
        points, faces = meshed_surface()
    finally:
        gmsh.finalize()
    mesh = TriangleMesh(vertices=points, faces=faces)
    x, y, z = np.eye(3)
    lines = [("d", np.array([s * length / 3, 0, 0]), y, 2 * radius) for s in (-1, 1)] + [
        ("d", np.array([s * length / 3, 0, 0]), z, 2 * radius) for s in (-1, 1)
    ]
    lines += [("d2", np.array([0, 0, (radius + height) / 2]), axis, 2 * branch) for axis in (x, y)]
    probes = tuple(Probe(name=n, middle=m, direction=d, size_m=s) for n, m, d, s in lines)
    bare = freeform.sphere(1.0, 0.1).exact  # closed forms of a tee are not needed here: the judge measures the mesh
    return Shape(
        kind="tee", family="free", parameters={"d": 2 * radius, "d2": 2 * branch}, mesh=mesh, exact=bare, chord_m=chord_m, section=(), n_cad_faces=5,
        probes=probes, base=Plain(mesh=mesh),
    )  # fmt: skip


def unobservable(family: str, hidden: tuple[str, ...]) -> list[str]:
    """Dimensions that the seen faces leave free: each seen edge tells the place of its line and of its two ends; place and roll are unknown too."""
    rows = []
    for factors, names in zip(corner_factors(family), edge_names(family), strict=True):
        for i, name in enumerate(names):
            if name in hidden:
                continue
            here, after = factors[i], factors[(i + 1) % len(factors)]
            axis = 0 if np.array_equal(here[0], after[0]) else 1
            for corner, along in ((here, axis), (here, 1 - axis), (after, 1 - axis)):
                rows.append([*corner[along], *np.eye(2)[along]])
    matrix = np.array(rows)
    free = []
    for k, name in enumerate(PARAMETERS[family]):
        others = np.delete(matrix, k, axis=1)
        if np.linalg.matrix_rank(matrix) == np.linalg.matrix_rank(others):
            free.append(name)
    return free
