"""Parts and members that stand on a floor, as most are found, in the form of the judge; nobody sees what they stand on.

    python benchmarks/floor_cases.py CASES [--seed 1] [--stations 8] [--noise 0.15] [--kinds box,tank,I] [--side 0..3] [--lift 0.03]
    python judge.py CASES OUT

Stations stand round the part at two heights. Shapes are those of `make_cases.py`. An honest failure is right wherever a side stays out of sight.
Members lie: --side says which of the four sides of the section is down: +x (0, toes of an angle or a channel), -y, -x or +y. With --lift what lies
there is held that far above the floor by two packers under it.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import case_shapes
import make_cases
import numpy as np

from scan2fea.io import write_mesh_ply
from scan2fea.kernel.measures import area, volume
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation import parts
from scan2fea.simulation.lab import Lab, SceneObject
from scan2fea.simulation.scanner import LabOptions, simulate
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Shape
from scan2fea.types import FloatArray, TriangleMesh

KINDS = "box,bracket,tank,vessel,girder,tee,cylinder,blob,RHS,I,L,rect"
FLOOR_M, FLOOR_SPACING_M = 6.0, 0.02


def main() -> None:
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("cases", type=Path)
    given.add_argument("--seed", type=int, default=1)
    given.add_argument("--stations", type=int, default=8)
    given.add_argument("--noise", type=float, default=0.15, help="of the spacing of the part's points")
    given.add_argument("--kinds", default=KINDS)
    given.add_argument("--side", type=int, default=0, choices=range(4), help="of a member's section that is down")
    given.add_argument("--lift", type=float, default=0.0, help="above the floor, on packers (m)")
    chosen = given.parse_args()
    for number, kind in enumerate(chosen.kinds.split(",")):
        print(written(chosen.cases / f"f{chosen.seed}_{number:02d}", kind, chosen, np.random.default_rng([chosen.seed, number])), flush=True)


def written(folder: Path, kind: str, chosen: argparse.Namespace, rng: np.random.Generator) -> str:
    """One case: station files, the true meshes and truth.json; returns its title."""
    size = float(math.exp(rng.uniform(math.log(0.2), math.log(0.6))))
    is_member = kind in case_shapes.MEMBERS
    shape, mesh, wall = case_shapes.member_shape(kind, 0.4 * size, rng) if is_member else case_shapes.part_shape(kind, size, rng)
    T = _standing(mesh, rng, chosen.side if is_member else None, chosen.lift)
    world = posed(mesh, T)
    spacing = max((wall or 0.04 * size) / 2.5, math.sqrt(area(world) / 120_000))
    half = FLOOR_M / 2
    floor, F = parts.box(FLOOR_M, FLOOR_M, 0.1), rigid(np.eye(3), np.array([-half, -half, -0.1]))
    things = (_thing("floor", posed(floor.mesh, F), FLOOR_SPACING_M), _thing(kind, world, spacing), *_packers(world, chosen.lift, spacing))
    stations = _stations(chosen.stations, max(1.2, 2 * float(np.linalg.norm(np.ptp(world.vertices, axis=0)))), rng.uniform(0, 2 * math.pi))
    sigma = float(f"{chosen.noise * spacing:.3g}")
    lab = simulate(Lab(objects=things, stations=stations), LabOptions(noise_m=sigma, overview_deg=0.0, seed=chosen.seed))
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    files = [f"station{k:02d}.pcd" for k in range(len(lab.scans))]
    for name, scan, place in zip(files, lab.scans, stations, strict=True):
        (folder / name).write_bytes(make_cases.pcd(scan.cloud.points, tuple(place)))
    for thing in things:
        write_mesh_ply(folder / "truth" / f"{thing.name}.ply", thing.mesh)
    title = f"{kind} on the floor, {len(files)} stations, {sigma * 1e3:.3g} mm, seen {lab.seen[1]:.2f}"
    truth: dict[str, Any] = {
        "id": folder.name, "title": title, "tags": ["room"], "quick": False, "seed": chosen.seed, "files": files,
        "objects": [_row("floor", floor, things[0].mesh, F, 1.0, False), _row(kind, shape, world, T, float(lab.seen[1]), True)],
        "unit": "m", "noise": "gauss", "sigma_m": sigma, "noise_sd_m": sigma, "expect": "may_fail", "coverage": "partial",
        "n_points": sum(len(s.cloud) for s in lab.scans), "spacing_m": spacing,
    }  # fmt: skip
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))
    return f"{folder.name}: {title}"


def _standing(mesh: TriangleMesh, rng: np.random.Generator, side: int | None, lift_m: float) -> FloatArray:
    """(4, 4) that puts a part above the floor at the origin, turned about the vertical; side : of a member that lies, the one that is down."""
    R = rotation_about((0, 0, 1), rng.uniform(0, 2 * math.pi))
    R = R if side is None else R @ rotation_about((0, 1, 0), math.pi / 2) @ rotation_about((0, 0, 1), side * math.pi / 2)
    turned = mesh.vertices @ R.T
    middle = (turned.min(axis=0) + turned.max(axis=0)) / 2
    return rigid(R, np.array([-middle[0], -middle[1], lift_m - turned[:, 2].min()]))


def _packers(world: TriangleMesh, lift_m: float, spacing_m: float) -> tuple[SceneObject, ...]:
    """Two blocks under the part, half as wide as it is, a quarter of its length from its ends."""
    if not lift_m > 0:
        return ()
    flat = world.vertices[:, :2]
    along, across = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2]
    length, width = np.ptp(flat @ along), np.ptp(flat @ across)
    block = parts.box(0.05 * length, 0.5 * width, lift_m).mesh
    R = np.eye(3)
    R[:2, 0], R[:2, 1] = along, [-along[1], along[0]]
    out = []
    for k, place in enumerate((-0.25, 0.25)):
        middle = np.array([*(place * length * along), 0.0]) - R @ np.array([0.025 * length, 0.25 * width, 0.0])
        out.append(_thing(f"packer {k + 1}", posed(block, rigid(R, middle)), spacing_m))
    return tuple(out)


def _stations(n: int, reach_m: float, first: float) -> FloatArray:
    angle = first + np.arange(n) * 2 * math.pi / n
    return np.stack([reach_m * np.cos(angle), reach_m * np.sin(angle), np.where(np.arange(n) % 2, 0.5, 1.2) * reach_m], axis=1)


def _thing(name: str, mesh: TriangleMesh, spacing_m: float) -> SceneObject:
    return SceneObject(name=name, kind=name, mesh=mesh, dimensions={}, volume_m3=1.0, spacing_m=spacing_m, stands_on="")


def _row(name: str, shape: Shape, mesh: TriangleMesh, T: FloatArray, seen: float, target: bool) -> dict[str, Any]:
    R, origin = T[:3, :3], T[:3, 3]
    return {
        "name": name, "family": shape.family, "target": target, "params_m": dict(shape.parameters), "volume_m3": volume(mesh), "bow_m": 0.0,
        "mesh": f"truth/{name}.ply", "seen_fraction": seen, "unobservable": [], "n_cad_faces": shape.n_cad_faces, "rotation": R.tolist(),
        "origin": origin.tolist(), "section": [loop.tolist() for loop in shape.section] or None, "crb_m": {},
        "probes": [[p.name, (R @ p.middle + origin).tolist(), (R @ p.direction).tolist(), p.size_m] for p in shape.probes],
    }  # fmt: skip


if __name__ == "__main__":
    main()
