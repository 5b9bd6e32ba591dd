"""Cases that no room of the product was made for, in the form of the judge: odd single parts, and workshops of members, brackets and clutter.

    python benchmarks/odd_cases.py CASES [--seed 7] [--only shaft,scene] [--scenes 6]
    python judge.py CASES OUT

The truth is the mesh of each part (`odd_parts.py`). How it is scanned goes round: evenly over all faces, from stations with or without their
positions, with a ball or a half space of it never seen. Every number is drawn; nothing is kept or left out by result.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from odd_parts import PARTS, meshed

from scan2fea.io import write_mesh_ply
from scan2fea.io.ply_writer import write_cloud_ply
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, volume
from scan2fea.kernel.transforms import random_rotation, rigid, rotation_about
from scan2fea.simulation import parts as exact_parts
from scan2fea.simulation.lab import Lab, SceneObject
from scan2fea.simulation.members import member
from scan2fea.simulation.scanner import LabOptions, simulate
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Shape
from scan2fea.types import FloatArray, PointCloud, TriangleMesh
from scan2fea.units import METRES_PER_UNIT

Rng = np.random.Generator
WAYS = ("even", "stations", "bare", "ball", "half")


def part_case(folder: Path, case: str, name: str, way: str, rng: Rng) -> str:
    """One odd part, scanned in one way."""
    mesh, wall = meshed(name, rng)
    world = posed(mesh, rigid(random_rotation(int(rng.integers(2**31))), rng.uniform(-3, 3, 3)))
    spacing = wall / rng.uniform(2.0, 5.0)
    n = min(200_000, max(10_000, round(area(mesh) / spacing**2)))
    sigma = float(f"{wall * math.exp(rng.uniform(math.log(0.01), math.log(0.12))):.3g}")
    unit = str(rng.choice(["m", "mm", "in"])) if way != "stations" else "m"
    mean = 0.978 * math.sqrt(area(mesh) / n)
    thing = SceneObject(name=name, kind=name, mesh=world, dimensions={}, volume_m3=1.0, spacing_m=mean, stands_on="")
    seen = 1.0
    if way in ("stations", "bare"):
        places = _ring(world.vertices.mean(0), 1.5 * float(np.linalg.norm(np.ptp(world.vertices, axis=0))), int(rng.integers(6, 11)), rng)
        files, seen, n = _scanned(folder, [thing], places, sigma, unit, way == "stations", rng)
    else:
        points, _ = sample_surface(world, n, int(rng.integers(2**31)))
        kept = _kept(points, way, rng)
        seen, n = float(kept.mean()), int(kept.sum())
        files = [_cloud(folder, points[kept] + sigma * rng.standard_normal((n, 3)), unit, rng)]
    objects = [_truth(folder, name, world, "free", {}, None, np.eye(4), seen)]
    title = f"{name} {way}, wall {wall * 1e3:.3g} mm, noise {sigma * 1e3:.3g} mm, {n} points, seen {seen:.2f}, {unit}"
    return _written(folder, case, title, objects, files, unit, sigma, area(mesh) * seen / n, n, seen > 0.98)


def _kept(points: FloatArray, way: str, rng: Rng) -> np.ndarray:
    """Which points are seen: all, all but a ball, or all but what lies beyond a plane."""
    middle, size = points.mean(0), float(np.linalg.norm(np.ptp(points, axis=0)))
    if way == "ball":
        return np.linalg.norm(points - points[int(rng.integers(len(points)))], axis=1) > rng.uniform(0.08, 0.2) * size
    if way == "half":
        return np.asarray((points - middle) @ _unit(rng) < rng.uniform(0.15, 0.3) * size)
    return np.ones(len(points), bool)


def _unit(rng: Rng) -> FloatArray:
    v = rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def _ring(middle: FloatArray, radius: float, n: int, rng: Rng) -> FloatArray:
    """Stations round about, alternately low and high."""
    angle = rng.uniform(0, 2 * math.pi) + np.arange(n) * 2 * math.pi / n
    return middle + radius * np.c_[np.cos(angle), np.sin(angle), np.where(np.arange(n) % 2, 0.6, -0.6)]


def _scanned(
    folder: Path, things: list[SceneObject], places: FloatArray, sigma: float, unit: str, known: bool, rng: Rng
) -> tuple[list[str], float, int]:
    """Files, the least share of a thing that is seen, and the number of points."""
    scan = simulate(Lab(objects=tuple(things), stations=places), LabOptions(noise_m=sigma, overview_deg=0.0, seed=int(rng.integers(2**31))))
    clouds = [s.cloud.points / METRES_PER_UNIT[unit] for s in scan.scans]
    n = sum(map(len, clouds))
    if not known:
        return [_cloud(folder, np.concatenate(clouds) * METRES_PER_UNIT[unit], unit, rng)], float(scan.seen.min()), n
    files = []
    for k, points in enumerate(clouds):
        if len(points):
            files.append(f"station{k:02d}.pcd")
            (folder / files[-1]).write_bytes(_pcd(points, places[k] / METRES_PER_UNIT[unit]))
    return files, float(scan.seen.min()), n


def _cloud(folder: Path, points: FloatArray, unit: str, rng: Rng) -> str:
    points = (points / METRES_PER_UNIT[unit])[rng.permutation(len(points))]
    if rng.random() < 0.5:
        np.savetxt(folder / "scan.xyz", points, fmt="%.6f")
        return "scan.xyz"
    write_cloud_ply(folder / "scan.ply", PointCloud.of(points))
    return "scan.ply"


def _pcd(points: FloatArray, at: FloatArray) -> bytes:
    lines = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", "FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "COUNT 1 1 1"]
    lines += [f"WIDTH {len(points)}", "HEIGHT 1", f"VIEWPOINT {at[0]:.6g} {at[1]:.6g} {at[2]:.6g} 1 0 0 0"]
    lines += [f"POINTS {len(points)}", "DATA binary", ""]
    return "\n".join(lines).encode() + points.astype("<f4").tobytes()


def _truth(
    folder: Path, name: str, world: TriangleMesh, family: str, values: dict[str, float], shape: Shape | None, T: FloatArray, seen: float,
    target: bool = True,
) -> dict[str, Any]:  # fmt: skip
    write_mesh_ply(folder / "truth" / f"{name}.ply", world)
    lines = shape.probes if shape else ()
    probes = [[p.name, (T[:3, :3] @ p.middle + T[:3, 3]).tolist(), (T[:3, :3] @ p.direction).tolist(), p.size_m] for p in lines]
    return {
        "name": name, "family": family, "target": target, "params_m": values, "volume_m3": volume(world), "bow_m": 0.0, "mesh": f"truth/{name}.ply",
        "seen_fraction": seen, "unobservable": [], "n_cad_faces": shape.n_cad_faces if shape else 0, "rotation": T[:3, :3].tolist(),
        "origin": T[:3, 3].tolist(), "section": [loop.tolist() for loop in shape.section] if shape and shape.section else None,
        "probes": probes, "crb_m": {},
    }  # fmt: skip


def _written(
    folder: Path, case: str, title: str, objects: list[dict[str, Any]], files: list[str], unit: str, sigma: float, cell: float, n: int, full: bool
) -> str:
    truth = {
        "id": case, "title": title, "tags": ["odd"], "quick": False, "seed": 0, "files": files, "objects": objects, "unit": unit, "noise": "gauss",
        "sigma_m": sigma, "noise_sd_m": sigma, "expect": "convert" if full else "may_fail", "coverage": "full" if full else "partial",
        "n_points": n, "spacing_m": math.sqrt(cell),
    }  # fmt: skip
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))
    return title


class Workshop:
    """What stands in a scene while it is put together: (name, shape, T, target, spacing factor)."""

    def __init__(self, rng: Rng) -> None:
        self.rng = rng
        self.solids: list[tuple[str, Shape, FloatArray, bool]] = []

    def put(self, name: str, shape: Shape, R: FloatArray, at: tuple[float, float, float], target: bool = True) -> None:
        self.solids.append((name, shape, rigid(R, np.array(at, float)), target))

    def member(self, kind: str, size: float, length: float) -> Shape:
        u = self.rng.uniform
        tw = size * u(0.05, 0.08)
        values = {
            "L": {"a": size, "b": size * u(0.6, 1), "t": size * u(0.08, 0.12)}, "RHS": {"h": size, "b": size * u(0.6, 1), "t": size * u(0.05, 0.08)},
            "CHS": {"d": size, "t": size * u(0.05, 0.1)},
        }.get(kind, {"h": size, "b": size * u(0.5, 0.8), "tw": tw, "tf": tw * u(1.2, 1.6)})  # fmt: skip
        return member(kind, {**{k: float(f"{v:.3g}") for k, v in values.items()}, "length": length}, 2e-5)


def workshop(rng: Rng) -> Workshop:
    """A floor, none to two walls, three to five members (a portal that touches, or each alone), a bracket on a column or a tank, and clutter."""
    room = Workshop(rng)
    u = rng.uniform
    room.put("floor", exact_parts.box(5.0, 4.0, 0.1), np.eye(3), (0, 0, -0.1), False)
    if rng.random() < 0.7:
        room.put("wall", exact_parts.box(0.1, 4.0, 2.4), np.eye(3), (-0.35, 0, 0), False)
    turn = rotation_about((0, 0, 1), u(0, 2 * math.pi))
    lying = rotation_about((0, 1, 0), math.pi / 2)
    kinds = rng.permutation(["I", "L", "C", "RHS", "CHS", "T"])
    if rng.random() < 0.5:  # a portal: two columns on the floor and a beam on them
        h = float(f"{u(1.2, 1.8):.3g}")
        column = room.member(str(rng.choice(["I", "RHS"])), u(0.1, 0.16), h)
        for k, x in enumerate((1.2, 2.6)):
            room.put(f"column{k}", column, np.eye(3), (x, 1.2, 0.0))
        beam = room.member("I", u(0.1, 0.16), 1.8)
        on_side = rotation_about((1, 0, 0), -math.pi / 2) @ rotation_about((0, 1, 0), math.pi / 2)
        room.put("beam", beam, on_side, (1.0, 1.2, h + beam.parameters["h"] / 2))
    else:
        for k, (x, y) in enumerate(((1.1, 1.0), (2.4, 1.1), (1.6, 2.2))):
            shape = room.member(str(kinds[k]), u(0.08, 0.16), float(f"{u(0.9, 1.5):.3g}"))
            R = turn @ lying @ rotation_about((0, 0, 1), u(0, 6)) if rng.random() < 0.6 else turn
            room.put(f"{kinds[k]}_{k}", shape, R, (x, y, u(0.5, 0.9)))
    if rng.random() < 0.5:
        a, t, w = u(0.15, 0.25), u(0.012, 0.02), u(0.12, 0.2)
        room.put("bracket", exact_parts.bracket(a, a, t, w, [("a", 0.6 * a, 0.5 * w, 0.02)], 2e-5), turn, (4.0, 1.0, 0.6))
    else:
        room.put("tank", exact_parts.tank(u(0.15, 0.25), u(0.3, 0.5), u(0.012, 0.02), 5e-5), np.eye(3), (4.0, 1.0, 0.5))
    sides = u(0.3, 0.6, 3)
    room.put("crate", exact_parts.box(*sides), turn, (4.0, 2.9, 0.0), False)
    room.put("drum", exact_parts.cylinder(u(0.15, 0.25), u(0.4, 0.8), 1e-4), np.eye(3), (0.5, 3.3, 0.0), False)
    return room


def scene_case(folder: Path, case: str, way: str, rng: Rng) -> str:
    """A workshop turned any way, scanned from two to six stations, or evenly without positions."""
    room = workshop(rng)
    frame = rigid(random_rotation(int(rng.integers(2**31))) if rng.random() < 0.6 else np.eye(3), rng.uniform(-20, 20, 3))
    density = math.exp(rng.uniform(math.log(0.3), math.log(3.0)))
    sigma = float(f"{math.exp(rng.uniform(math.log(3e-4), math.log(3e-3))):.3g}")
    unit = str(rng.choice(["m", "mm", "in"]))
    things, objects = [], []
    for name, shape, T, target in room.solids:
        world = posed(shape.mesh, frame @ T)
        spacing = (0.006 if target else 0.03) / math.sqrt(density)
        things.append(SceneObject(name=name, kind=name, mesh=world, dimensions={}, volume_m3=1.0, spacing_m=spacing, stands_on=""))
        objects.append(_truth(folder, name, world, shape.family, dict(shape.parameters), shape, frame @ T, 1.0, target))
    cell = (0.006 / 0.978) ** 2 / density
    seen = 1.0
    if way == "even":
        clouds = [sample_surface(t.mesh, round(area(t.mesh) * (0.978 / t.spacing_m) ** 2), int(rng.integers(2**31)))[0] for t in things]
        points = np.concatenate(clouds)
        n = len(points)
        files, k = [_cloud(folder, points + sigma * rng.standard_normal(points.shape), unit, rng)], 0
    else:
        k = int(rng.integers(2, 7))
        angle = rng.uniform(0, 6) + np.arange(k) * 2 * math.pi / k
        local = np.c_[2.3 + 2.4 * np.cos(angle), 1.9 + 1.9 * np.sin(angle), np.where(np.arange(k) % 2, 0.25, 2.1)]
        files, seen, n = _scanned(folder, things, local @ frame[:3, :3].T + frame[:3, 3], sigma, unit, way == "stations", rng)
    title = f"scene {way} {k} stations: {', '.join(s[0] for s in room.solids)}; noise {sigma * 1e3:.2g} mm, density {density:.2f}, {n} points, {unit}"
    for row in objects:
        row["seen_fraction"] = seen
    return _written(folder, case, title, objects, files, unit, sigma, cell, n, way == "even")


def main() -> None:
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("cases", type=Path)
    given.add_argument("--seed", type=int, default=7)
    given.add_argument("--only", default="", help="names of parts, or scene")
    given.add_argument("--scenes", type=int, default=6)
    chosen = given.parse_args()
    jobs = [(name, WAYS[(k + chosen.seed + 3) % len(WAYS)]) for k, name in enumerate(PARTS)]
    jobs += [("scene", ("stations", "bare", "even")[k % 3]) for k in range(chosen.scenes)]
    for number, (name, way) in enumerate(jobs):
        if chosen.only and name not in chosen.only.split(","):
            continue
        case = f"o{chosen.seed}_{number:02d}_{name}"
        folder = chosen.cases / case
        (folder / "truth").mkdir(parents=True, exist_ok=True)
        rng = np.random.default_rng([chosen.seed, number])
        print(case, scene_case(folder, case, way, rng) if name == "scene" else part_case(folder, case, name, way, rng), flush=True)


if __name__ == "__main__":
    main()
