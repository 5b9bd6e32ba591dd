"""Held-out cases in the form of the judge: random family, size, length, unit, place, noise, occlusion; members and free-form parts.

    python benchmarks/make_cases.py CASES --n 20 --seed 7 [--kinds L,I,bracket,...] [--points 30000]
    python judge.py CASES OUT

Nothing is tuned here: every number is drawn from the ranges below, and a case is kept whatever the program makes of it. Same seed, same bytes.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.io import write_mesh_ply
from scan2fea.io.ply_writer import write_cloud_ply
from scan2fea.kernel.construction import Plain
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals, volume
from scan2fea.kernel.sections import PARAMETERS, ROUND, corner_factors, edge_names
from scan2fea.kernel.transforms import quaternion_to_matrix, rigid, rotation_about
from scan2fea.pipeline.simulate import simulate_scene
from scan2fea.simulation import freeform, parts
from scan2fea.simulation.bounds import member_bounds
from scan2fea.simulation.lab import Lab, SceneObject
from scan2fea.simulation.members import member
from scan2fea.simulation.sampling import SamplingOptions, sampled
from scan2fea.simulation.scanner import LabOptions, simulate
from scan2fea.simulation.scene_file import SceneFile
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Probe, Scene, Shape, Solid
from scan2fea.types import PointCloud, TriangleMesh
from scan2fea.units import METRES_PER_UNIT

MEMBERS = ("L", "I", "C", "T", "RHS", "CHS", "rect", "round")
PARTS = ("box", "bracket", "tank", "vessel", "blob", "tee", "girder", "cylinder")
SUFFIXES = ("xyz", "ply", "pcd")
STATIONS = [(2.2 * math.cos(a), 2.2 * math.sin(a), z) for k, a in enumerate(np.arange(14) * 2 * math.pi / 14) for z in ((0.2, 2.2)[k % 2],)]


@dataclass
class Case:
    """What a case is made of before it is written. seen_share : 1 for a full scan.   size : longest side, metres."""

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
    expect: str = "convert"
    seen_fraction: float = 1.0
    unobservable: list[str] = field(default_factory=list)


def main() -> None:
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("cases", type=Path)
    given.add_argument("--n", type=int, default=20)
    given.add_argument("--seed", type=int, default=1)
    given.add_argument("--kinds", default=",".join((*MEMBERS, *PARTS)), help="also: room, several members over a floor")
    given.add_argument("--points", type=int, default=0, help="points of each case; 0: drawn, 15,000 to 60,000")
    given.add_argument("--full", action="store_true", help="no occlusion")
    chosen = given.parse_args()
    kinds = chosen.kinds.split(",")
    for number in range(chosen.n):
        rng = np.random.default_rng([chosen.seed, number])
        name = f"s{chosen.seed}_{number:03d}"
        if kinds[number % len(kinds)] == "room":
            print(f"{name}: {room(chosen.cases / name, name, chosen.seed, rng)}", flush=True)
            continue
        case = drawn(kinds[number % len(kinds)], rng, chosen.points, occlude=not chosen.full)
        title = written(chosen.cases / name, name, chosen.seed, case, rng)
        print(f"{name}: {title}", flush=True)


def room(folder: Path, name: str, seed: int, rng: np.random.Generator) -> str:
    """A floor, a crate on it and three or four members above it, each in its own cell of two metres; surfaces sampled evenly, isotropic noise."""
    solids = [_placed("floor", parts.box(6.0, 4.0, 0.1), np.eye(3), np.array([0, 0, -0.1]), 0.015)]
    n = int(rng.integers(3, 5))
    kinds = rng.choice(MEMBERS[:6], n, replace=False)
    cells = rng.permutation(6)
    for k in range(n + 1):
        turn = rotation_about((0, 0, 1), rng.uniform(0, 2 * math.pi))
        centre = np.array([2.0 * (cells[k] % 3) + 1, 2.0 * (cells[k] // 3) + 1, 0.0])
        if k == n:
            shape = parts.box(*(float(f"{v:.3g}") for v in rng.uniform(0.25, 0.6, 3)))
            middle = np.array([shape.parameters["sx"] / 2, shape.parameters["sy"] / 2, 0])
            solids.append(_placed("crate", shape, turn, centre - turn @ middle, 0.008))
            continue
        shape, _, wall = _member(str(kinds[k]), _draw(rng, 0.08, 0.16), rng)
        length = min(shape.parameters["length"], 1.5)
        shape = member(str(kinds[k]), {**{p: v for p, v in shape.parameters.items() if p != "length"}, "length": length}, 2e-5)
        lying = turn @ rotation_about((0, 1, 0), math.pi / 2 - rng.uniform(0, 0.3))
        middle = (shape.mesh.vertices.min(0) + shape.mesh.vertices.max(0)) / 2
        solids.append(
            _placed(f"{kinds[k]}_{k}", shape, lying, centre + 0.8 * np.eye(3)[2] - lying @ middle, float(np.clip(0.8 * wall, 0.003, 0.006)))
        )
    sigma = float(f"{_draw(rng, 2e-4, 1.2e-3):.3g}")
    given = SceneFile(scene=Scene(name="room", solids=tuple(solids)), sensors=(), sampling=SamplingOptions(noise_m=sigma))
    draw = int(rng.integers(2**31))
    truth = dict(simulate_scene(given, folder, seed=draw, step=False).truth)
    assert given.sampling is not None
    write_cloud_ply(folder / truth["files"][0], PointCloud.of(sampled(given.scene, given.sampling, draw).cloud.points))  # bare: no object, no sigma
    truth.update(id=name, seed=seed, title=f"room: {', '.join(s.name for s in solids)}, {sigma * 1e3:.3g} mm noise", tags=["room"])
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))
    return str(truth["title"])


def _placed(name: str, shape: Shape, R: np.ndarray, origin: np.ndarray, spacing_m: float) -> Solid:
    T = rigid(R, origin)
    mesh = posed(shape.mesh, T)
    return Solid(name=name, shape=shape, T_world_shape=T, mesh=mesh, volume_m3=volume(mesh), spacing_m=spacing_m)


def _draw(rng: np.random.Generator, low: float, high: float) -> float:
    """Evenly in the logarithm."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def drawn(kind: str, rng: np.random.Generator, n_points: int, *, occlude: bool) -> Case:
    """One case of a kind."""
    is_member = kind in MEMBERS
    size = _draw(rng, 0.04, 0.6) if is_member else _draw(rng, 0.1, 1.2)
    shape, mesh, wall = _member(kind, size, rng) if is_member else _part(kind, size, rng)
    R = quaternion_to_matrix(rng.standard_normal(4))
    stations = (not is_member and kind in ("bracket", "girder", "tank") and size < 1.0) or bool(rng.random() < 0.15)
    far = rng.random() < 0.1
    origin = rng.uniform(-4, 4, 3) + (np.array([412_000.0, 5_318_000.0, 300.0]) if far else 0)
    if stations:  # in the middle of the ring
        origin = np.array([0, 0, 1.2]) - R @ (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2
    count = n_points or int(rng.integers(15_000, 60_000))
    if wall and (stations or kind in ("bracket", "tank", "girder")):
        count = max(count, min(250_000, round(area(mesh) / (wall / 2.5) ** 2)))  # what is thin is scanned densely
    thick = min(wall, 0.15 * size) or 0.02 * size
    worst = 0.12 if stations or not is_member else 0.3
    sigma = float(rng.choice([0.0, _draw(rng, 0.02, worst)])) * thick if rng.random() < 0.6 else _draw(rng, 0.02, worst) * thick
    noise = "uniform" if sigma > 0 and rng.random() < 0.2 and not stations else "gauss"
    unit = str(rng.choice(["m", "m", "mm", "in", "cm"])) if not (far or stations) else "m"
    case = Case(kind=kind, shape=shape, mesh=mesh, T=rigid(R, origin), sigma_m=float(f"{sigma:.3g}"), noise=noise, unit=unit, n_points=count)
    case.stations = stations
    if occlude and is_member and kind not in ROUND and not stations and rng.random() < 0.35:
        _occlude(case, rng)
    return case


def _member(kind: str, size: float, rng: np.random.Generator) -> tuple[Shape, TriangleMesh, float]:
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
    shape = member(kind, {**values, "length": length}, 2e-4 * size)
    return shape, shape.mesh, min(v for k, v in values.items())


def _part(kind: str, size: float, rng: np.random.Generator) -> tuple[Shape, TriangleMesh, float]:
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


def _occlude(case: Case, rng: np.random.Generator) -> None:
    """One to three faces of the section are never seen; what the rest cannot tell is worked out from which lines the data still hold."""
    names = [name for loop in edge_names(case.kind) for name in loop]
    hidden = rng.choice(len(names), int(rng.integers(1, min(4, len(names) - 1))), replace=False)
    case.hidden = tuple(names[i] for i in sorted(hidden))
    case.unobservable = unobservable(case.kind, case.hidden)
    case.expect = "may_fail" if case.unobservable else "convert"


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


def _hidden_faces(case: Case) -> np.ndarray:
    """(m,) bool: triangles of the member's mesh on the hidden faces of its section."""
    normal, tri = face_normals(case.mesh), case.mesh.vertices[case.mesh.faces]
    hidden = np.zeros(len(case.mesh.faces), bool)
    for loop, names in zip(case.shape.section, edge_names(case.kind), strict=True):
        for a, b, name in zip(loop, np.roll(loop, -1, axis=0), names, strict=True):
            if name in case.hidden:
                n = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
                flat = tri[:, :, :2]
                on = (np.abs((flat - a) @ n).max(axis=1) < 1e-9) & (normal[:, :2] @ n > 0.99)
                along = ((flat - a) @ (b - a) / ((b - a) @ (b - a))).mean(axis=1)
                hidden |= on & (along > -1e-6) & (along < 1 + 1e-6)
    return hidden


def written(folder: Path, name: str, seed: int, case: Case, rng: np.random.Generator) -> str:
    """Write the scan, the mesh and truth.json; returns the title."""
    folder.mkdir(parents=True, exist_ok=True)
    world = posed(case.mesh, case.T)
    write_mesh_ply(folder / "truth" / f"{case.kind}.ply", world)
    files, n_points = _stations(folder, case, world, rng) if case.stations else _cloud(folder, case, world, rng)
    seen_area = area(case.mesh) * case.seen_fraction
    sd = case.sigma_m / math.sqrt(3) if case.noise == "uniform" else case.sigma_m
    crb: dict[str, float] = {}
    full = case.seen_fraction == 1.0 and not case.stations
    if case.kind in MEMBERS and full and sd > 0 and case.noise == "gauss":
        ends = abs(face_normals(case.mesh)[:, 2]) > 0.99
        caps = n_points * _area(case.mesh, ends) / area(case.mesh)
        crb = member_bounds(case.kind, case.shape.parameters, sd, n_points - caps, cap_points=caps / 2)
    where = ", " + ", ".join(case.hidden) + " never seen" if case.hidden else ""
    how = f" from {len(files)} stations" if case.stations else ""
    sizes = "x".join(f"{v * 1e3:.4g}" for k, v in case.shape.parameters.items())
    title = f"{case.kind} {sizes} mm{how}{where}, {case.noise} {case.sigma_m * 1e3:.3g} mm, unit {case.unit}"
    T = case.T
    probes = [[p.name, (T[:3, :3] @ p.middle + T[:3, 3]).tolist(), (T[:3, :3] @ p.direction).tolist(), p.size_m] for p in case.shape.probes]
    truth: dict[str, Any] = {
        "id": name, "title": title, "tags": ["member" if case.kind in MEMBERS else "free"], "quick": False, "seed": seed, "files": files,
        "objects": [{
            "name": case.kind, "family": case.shape.family, "target": True, "params_m": dict(case.shape.parameters), "volume_m3": volume(case.mesh),
            "bow_m": 0.0, "mesh": f"truth/{case.kind}.ply", "seen_fraction": case.seen_fraction, "unobservable": case.unobservable,
            "n_cad_faces": case.shape.n_cad_faces, "rotation": T[:3, :3].tolist(), "origin": T[:3, 3].tolist(),
            "section": [loop.tolist() for loop in case.shape.section] or None, "probes": probes, "crb_m": crb,
        }],
        "unit": case.unit, "noise": case.noise, "sigma_m": case.sigma_m, "noise_sd_m": sd, "expect": case.expect,
        "coverage": "full" if full else "partial", "n_points": n_points, "spacing_m": math.sqrt(seen_area / n_points),
    }  # fmt: skip
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))
    return title


def _area(mesh: TriangleMesh, rows: np.ndarray) -> float:
    return area(TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[rows]))


def _cloud(folder: Path, case: Case, world: TriangleMesh, rng: np.random.Generator) -> tuple[list[str], int]:
    """Points spread evenly by area over what is seen, inside and outside, with noise in every coordinate."""
    points, face = sample_surface(world, case.n_points, int(rng.integers(2**31)))
    if case.hidden:
        hidden = _hidden_faces(case)
        case.seen_fraction = 1 - _area(case.mesh, hidden) / area(case.mesh)
        points = points[~hidden[face]]
    noise = rng.uniform(-1, 1, points.shape) if case.noise == "uniform" else rng.standard_normal(points.shape)
    points = (points + case.sigma_m * noise) / METRES_PER_UNIT[case.unit]
    suffix = str(rng.choice(SUFFIXES)) if np.abs(points).max() < 1e5 else "ply"
    path = folder / f"scan.{suffix}"
    if suffix == "xyz":
        digits = 6 - round(math.log10(1 / METRES_PER_UNIT[case.unit]))
        np.savetxt(path, points, fmt=f"%.{max(digits, 3)}f")
    elif suffix == "ply":
        write_cloud_ply(path, PointCloud.of(points))
    else:
        path.write_bytes(_pcd(points, (0.0, 0.0, 0.0)))
    return [path.name], len(points)


def _stations(folder: Path, case: Case, world: TriangleMesh, rng: np.random.Generator) -> tuple[list[str], int]:
    """One PCD per station with its VIEWPOINT; noise along the ray."""
    thing = SceneObject(
        name=case.kind, kind=case.kind, mesh=world, dimensions=case.shape.parameters, volume_m3=1.0,
        spacing_m=0.978 * math.sqrt(area(world) / case.n_points), stands_on="",
    )  # fmt: skip
    reach = float(np.linalg.norm(np.ptp(world.vertices, axis=0)))
    middle = np.array([0, 0, 1.2])
    places = middle + (np.array(STATIONS) - middle) * max(1.0, 0.8 * reach)
    lab = simulate(Lab(objects=(thing,), stations=places), LabOptions(noise_m=case.sigma_m, overview_deg=0.0, seed=int(rng.integers(2**31))))
    case.seen_fraction = float(lab.seen[0])
    if case.seen_fraction < 0.9:  # the inside of a tube or a vessel: an honest failure is right too
        case.expect = "may_fail"
        case.unobservable = ["t"] if case.kind in ("RHS", "CHS") else []
    files = []
    for k, scan in enumerate(lab.scans):
        files.append(f"station{k:02d}.pcd")
        (folder / files[-1]).write_bytes(_pcd(scan.cloud.points, tuple(places[k])))
    return files, sum(len(s.cloud) for s in lab.scans)


def _pcd(points: np.ndarray, viewpoint: tuple[float, ...]) -> bytes:
    at = " ".join(f"{v:.6g}" for v in viewpoint)
    lines = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", "FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "COUNT 1 1 1"]
    lines += [f"WIDTH {len(points)}", "HEIGHT 1", f"VIEWPOINT {at} 1 0 0 0", f"POINTS {len(points)}", "DATA binary", ""]
    return "\n".join(lines).encode() + points.astype("<f4").tobytes()


if __name__ == "__main__":
    main()
