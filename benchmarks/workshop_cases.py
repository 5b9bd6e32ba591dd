"""Parts of a workshop with exact truth and a draughtsman's number of faces, in the form of the judge.

    python benchmarks/workshop_cases.py CASES [--seed 20261124] [--only lug,drum]
    python judge.py CASES OUT

Unit, place, turn, noise (0.05 to 0.5 mm, at most 0.08 walls) and density (3 to 7 spacings a wall) are drawn, the way of scanning goes round; none is
kept or left out by result.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

import numpy as np
from odd_cases import _cloud, _ring, _scanned, _truth, _written
from workshop_parts import PARTS, made

from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area
from scan2fea.kernel.transforms import random_rotation, rigid
from scan2fea.simulation.lab import SceneObject
from scan2fea.simulation.shapes import posed

WAYS = ("even", "stations", "bare", "occluded")  # evenly over all faces; from stations with and without their places; a small ball of it never seen


def case(folder: Path, name: str, part: str, way: str, rng: np.random.Generator) -> str:
    """One part, scanned in one way."""
    piece = made(part, rng)
    mesh = piece.mesh
    world = posed(mesh, rigid(random_rotation(int(rng.integers(2**31))), rng.uniform(-3, 3, 3)))
    n = min(150_000, max(15_000, round(area(mesh) / (piece.wall_m / rng.uniform(3.0, 7.0)) ** 2)))
    sigma = min(math.exp(rng.uniform(math.log(5e-5), math.log(5e-4))), 0.08 * piece.wall_m)
    sigma = float(f"{sigma:.3g}")
    unit = str(rng.choice(["m", "mm", "in", "cm"])) if way != "stations" else "m"
    seen = 1.0
    if way in ("stations", "bare"):
        mean = 0.978 * math.sqrt(area(mesh) / n)
        thing = SceneObject(name=part, kind=part, mesh=world, dimensions={}, volume_m3=1.0, spacing_m=mean, stands_on="")
        places = _ring(world.vertices.mean(0), 1.5 * float(np.linalg.norm(np.ptp(world.vertices, axis=0))), int(rng.integers(10, 15)), rng)
        files, seen, n = _scanned(folder, [thing], places, sigma, unit, way == "stations", rng)
    else:
        points, _ = sample_surface(world, n, int(rng.integers(2**31)))
        if way == "occluded":
            size = float(np.linalg.norm(np.ptp(points, axis=0)))
            points = points[np.linalg.norm(points - points[int(rng.integers(len(points)))], axis=1) > rng.uniform(0.03, 0.07) * size]
        seen, n = len(points) / n, len(points)
        files = [_cloud(folder, points + sigma * rng.standard_normal((n, 3)), unit, rng)]
    row = _truth(folder, part, world, "free", {}, None, np.eye(4), seen)
    row |= {"n_cad_faces": sum(piece.faces.values()), "volume_m3": piece.volume_m3}
    kinds = ", ".join(f"{n} {kind}" for kind, n in sorted(piece.faces.items()))
    title = f"{part} {way}, wall {piece.wall_m * 1e3:.3g} mm, noise {sigma * 1e3:.3g} mm, {n} points, seen {seen:.2f}, {unit}; {kinds}"
    return _written(folder, name, title, [row], files, unit, sigma, area(mesh) * seen / n, n, seen > 0.98)


def main() -> None:
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("cases", type=Path)
    given.add_argument("--seed", type=int, default=20261124)
    given.add_argument("--only", default="", help="names of parts")
    chosen = given.parse_args()
    for number, part in enumerate(PARTS):
        if chosen.only and part not in chosen.only.split(","):
            continue
        name = f"w{number:02d}_{part}"
        folder = chosen.cases / name
        (folder / "truth").mkdir(parents=True, exist_ok=True)
        rng = np.random.default_rng([chosen.seed, number])
        way = WAYS[(number + number // 4 + chosen.seed) % 4]
        print(name, case(folder, name, part, way, rng), flush=True)
        truth = json.loads((folder / "truth.json").read_text())
        (folder / "truth.json").write_text(json.dumps(truth | {"seed": chosen.seed, "tags": ["free", "cad"]}, indent=1))


if __name__ == "__main__":
    main()
