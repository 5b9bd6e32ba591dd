"""Held-out cases in the form of the judge: random family, size, length, unit, place, noise, occlusion; members and free-form parts.

    python benchmarks/make_cases.py CASES --n 20 --seed 7 [--kinds L,I,bracket,...] [--points 30000]
    python benchmarks/make_cases.py CASES --n 24 --seed 7 --hard    # hidden, cut, from few stations, among strays (hard_cases.py)
    python judge.py CASES OUT

Nothing is tuned here: every number is drawn from the ranges below, and a case is kept whatever the program makes of it. Same seed, same bytes.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from case_shapes import MEMBERS, PARTS, Case, in_logarithm, member_shape, part_shape, unobservable
from hard_cases import hard

from scan2fea.io import write_mesh_ply
from scan2fea.io.ply_writer import write_cloud_ply
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals, volume
from scan2fea.kernel.sections import ROUND, edge_names
from scan2fea.kernel.transforms import quaternion_to_matrix, rigid, rotation_about
from scan2fea.pipeline.simulate import simulate_scene
from scan2fea.simulation import parts
from scan2fea.simulation.bounds import member_bounds
from scan2fea.simulation.lab import Lab, SceneObject
from scan2fea.simulation.members import member
from scan2fea.simulation.sampling import SamplingOptions, sampled
from scan2fea.simulation.scanner import LabOptions, simulate
from scan2fea.simulation.scene_file import SceneFile
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Scene, Shape, Solid
from scan2fea.types import PointCloud, TriangleMesh
from scan2fea.units import METRES_PER_UNIT

SUFFIXES = ("xyz", "ply", "pcd")
LAWS: dict[str, Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]] = {  # of one; uniform: half its width, else standard deviations
    "gauss": lambda rng, shape: rng.standard_normal(shape),
    "uniform": lambda rng, shape: rng.uniform(-1, 1, shape),
    "laplace": lambda rng, shape: rng.laplace(0, 2**-0.5, shape),
}
STATIONS = [(2.2 * math.cos(a), 2.2 * math.sin(a), z) for k, a in enumerate(np.arange(14) * 2 * math.pi / 14) for z in ((0.2, 2.2)[k % 2],)]


def main() -> None:
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("cases", type=Path)
    given.add_argument("--n", type=int, default=20)
    given.add_argument("--seed", type=int, default=1)
    given.add_argument("--kinds", default=",".join((*MEMBERS, *PARTS)), help="also: room, several members over a floor")
    given.add_argument("--points", type=int, default=0, help="points of each case; 0: drawn, 15,000 to 60,000")
    given.add_argument("--full", action="store_true", help="no occlusion")
    given.add_argument("--hard", action="store_true", help="members and boxes of hard_cases.py")
    chosen = given.parse_args()
    kinds = chosen.kinds.split(",")
    for number in range(chosen.n):
        rng = np.random.default_rng([chosen.seed, number])
        name = f"s{chosen.seed}_{number:03d}"
        if kinds[number % len(kinds)] == "room":
            print(f"{name}: {room(chosen.cases / name, name, chosen.seed, rng)}", flush=True)
            continue
        if chosen.hard:
            case = hard(number, chosen.seed, rng)
            case.n_points = chosen.points or case.n_points
        else:
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
        shape, _, wall = member_shape(str(kinds[k]), in_logarithm(rng, 0.08, 0.16), rng)
        length = min(shape.parameters["length"], 1.5)
        shape = member(str(kinds[k]), {**{p: v for p, v in shape.parameters.items() if p != "length"}, "length": length}, 2e-5)
        lying = turn @ rotation_about((0, 1, 0), math.pi / 2 - rng.uniform(0, 0.3))
        middle = (shape.mesh.vertices.min(0) + shape.mesh.vertices.max(0)) / 2
        solids.append(
            _placed(f"{kinds[k]}_{k}", shape, lying, centre + 0.8 * np.eye(3)[2] - lying @ middle, float(np.clip(0.8 * wall, 0.003, 0.006)))
        )
    sigma = float(f"{in_logarithm(rng, 2e-4, 1.2e-3):.3g}")
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


def drawn(kind: str, rng: np.random.Generator, n_points: int, *, occlude: bool) -> Case:
    """One case of a kind."""
    is_member = kind in MEMBERS
    size = in_logarithm(rng, 0.04, 0.6) if is_member else in_logarithm(rng, 0.1, 1.2)
    shape, mesh, wall = member_shape(kind, size, rng) if is_member else part_shape(kind, size, rng)
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
    sigma = float(rng.choice([0.0, in_logarithm(rng, 0.02, worst)])) * thick if rng.random() < 0.6 else in_logarithm(rng, 0.02, worst) * thick
    noise = "uniform" if sigma > 0 and rng.random() < 0.2 and not stations else "gauss"
    unit = str(rng.choice(["m", "m", "mm", "in", "cm"])) if not (far or stations) else "m"
    case = Case(kind=kind, shape=shape, mesh=mesh, T=rigid(R, origin), sigma_m=float(f"{sigma:.3g}"), noise=noise, unit=unit, n_points=count)
    case.stations = stations
    if occlude and is_member and kind not in ROUND and not stations and rng.random() < 0.35:
        _occlude(case, rng)
    return case


def _occlude(case: Case, rng: np.random.Generator) -> None:
    """One to three faces of the section are never seen; what the rest cannot tell is worked out from which lines the data still hold."""
    names = [name for loop in edge_names(case.kind) for name in loop]
    hidden = rng.choice(len(names), int(rng.integers(1, min(4, len(names) - 1))), replace=False)
    case.hidden = tuple(names[i] for i in sorted(hidden))
    case.unobservable = unobservable(case.kind, case.hidden)
    case.expect = "may_fail" if case.unobservable else "convert"


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
    full = case.seen_fraction == 1.0 and not case.stations and not case.clutter
    if case.kind in MEMBERS and full and sd > 0 and case.noise == "gauss":
        ends = abs(face_normals(case.mesh)[:, 2]) > 0.99
        caps = n_points * _area(case.mesh, ends) / area(case.mesh)
        crb = member_bounds(case.kind, case.shape.parameters, sd, n_points - caps, cap_points=caps / 2)
    where = ", " + ", ".join(case.hidden) + " never seen" if case.hidden else ""
    where += f", cut at {case.cut[0]:.2f} of the points" if case.cut else ""
    where += f", {case.clutter:.0%} strays" if case.clutter else ""
    how = f" from {len(files)} stations" if case.stations and case.tells_places else " from stations not told" if case.stations else ""
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
    if case.cut:
        points = _kept(points, case)
        case.seen_fraction = case.cut[0]
    noise = LAWS[case.noise](rng, points.shape)
    points = points + case.sigma_m * noise
    if case.clutter:
        points = _among_strays(points, case, rng)
    points = points / METRES_PER_UNIT[case.unit]
    suffix = str(rng.choice(SUFFIXES)) if np.abs(points).max() < 1e5 else "ply"
    path = folder / f"scan.{suffix}"
    if suffix == "xyz":
        digits = 6 - round(math.log10(1 / METRES_PER_UNIT[case.unit]))
        np.savetxt(path, points, fmt=f"%.{max(digits, 3)}f")
    elif suffix == "ply":
        write_cloud_ply(path, PointCloud.of(points))
    else:
        path.write_bytes(pcd(points, (0.0, 0.0, 0.0)))
    return [path.name], len(points)


def _kept(points: np.ndarray, case: Case) -> np.ndarray:
    """The points on one side of the case's plane along the member."""
    assert case.cut is not None
    local = (points - case.T[:3, 3]) @ case.T[:3, :3]
    height = local[:, :2] @ np.array([math.cos(case.cut[1]), math.sin(case.cut[1])])
    return np.asarray(points[height < np.quantile(height, case.cut[0])])


def _among_strays(points: np.ndarray, case: Case, rng: np.random.Generator) -> np.ndarray:
    """Points in any order with strays spread evenly over a box of the member's directions, an eighth wider on every side."""
    local = (points - case.T[:3, 3]) @ case.T[:3, :3]
    low, high = local.min(axis=0), local.max(axis=0)
    margin, n = (high - low) / 8, round(len(points) * case.clutter / (1 - case.clutter))
    strays = rng.uniform(low - margin, high + margin, (n, 3)) @ case.T[:3, :3].T + case.T[:3, 3]
    return rng.permutation(np.concatenate([points, strays]))


def _stations(folder: Path, case: Case, world: TriangleMesh, rng: np.random.Generator) -> tuple[list[str], int]:
    """One PCD per station with its VIEWPOINT, or one PLY of all that does not tell them; noise along the ray."""
    thing = SceneObject(
        name=case.kind, kind=case.kind, mesh=world, dimensions=case.shape.parameters, volume_m3=1.0,
        spacing_m=0.978 * math.sqrt(area(world) / case.n_points), stands_on="",
    )  # fmt: skip
    reach = float(np.linalg.norm(np.ptp(world.vertices, axis=0)))
    middle = np.array([0, 0, 1.2])
    places = middle + (np.array(STATIONS) - middle) * max(1.0, 0.8 * reach) if case.places is None else case.places
    lab = simulate(Lab(objects=(thing,), stations=places), LabOptions(noise_m=case.sigma_m, overview_deg=0.0, seed=int(rng.integers(2**31))))
    case.seen_fraction = float(lab.seen[0])
    if case.seen_fraction < 0.9:  # the inside of a tube or a vessel: an honest failure is right too
        case.expect = "may_fail"
        case.unobservable = ["t"] if case.kind in ("RHS", "CHS") else []
    unit, n_points = METRES_PER_UNIT[case.unit], sum(len(s.cloud) for s in lab.scans)
    if not case.tells_places:
        write_cloud_ply(folder / "scan.ply", PointCloud.of(np.concatenate([s.cloud.points for s in lab.scans]) / unit))
        return ["scan.ply"], n_points
    files = []
    for k, scan in enumerate(lab.scans):
        files.append(f"station{k:02d}.pcd")
        (folder / files[-1]).write_bytes(pcd(scan.cloud.points / unit, tuple(places[k] / unit)))
    return files, n_points


def pcd(points: np.ndarray, viewpoint: tuple[float, ...]) -> bytes:
    at = " ".join(f"{v:.6g}" for v in viewpoint)
    lines = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", "FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "COUNT 1 1 1"]
    lines += [f"WIDTH {len(points)}", "HEIGHT 1", f"VIEWPOINT {at} 1 0 0 0", f"POINTS {len(points)}", "DATA binary", ""]
    return "\n".join(lines).encode() + points.astype("<f4").tobytes()


if __name__ == "__main__":
    main()
