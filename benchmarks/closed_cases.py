"""Seeded cases that must come out closed, manifold and free of crossings, whatever the gates say.

    python benchmarks/closed_cases.py [--quick] [--jobs N]

Parts with bores, walls and blobs in random poses and scales; spacing 0.35 to 0.8 of the wall, noise 0 to 0.3 of it, up to 20 % of the points taken
away on one side of a wall, half of the cases without sensor positions. One row per case; the last line counts. Exit 1 where any surface is not
sound, or where one that passed its gates is more than 10 % off in volume.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from seeded import rows

from predicates import moved, rotation
from reconstruction import PARTS
from scan2fea.errors import ReconstructionError
from scan2fea.kernel.measures import volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import METHODS, ReconstructionOptions, reconstruct
from scan2fea.types import PointCloud, Scan, TriangleMesh
from scanned import scan_of, scanned

WALLS = {"plate": 0.05, "angle": 0.15, "tee": 0.08, "cylinder": 0.2, "tube": 0.07, "bracket": 0.06, "table": 0.05, "cup": 0.08, "ibeam": 0.04}
WALLS |= {"blob": 0.2, "block": 0.2, "frame": 0.09}
LARGEST_H = 0.04  # of the part's size of 1: thick parts are not scanned as coarsely as their wall would allow
QUICK, ALL = 20, 200
WRONG = 0.10


def occluded(scan: Scan, normals: np.ndarray, share: float, rng: np.random.Generator) -> Scan:
    """The scan without the points of one side in up to three balls that hold `share` of all: with both sides gone it would be a hole indeed."""
    points, sensors = scan.cloud.points, scan.sensors()
    keep = np.ones(len(points), bool)
    for _ in range(3):
        middle = rng.integers(len(points))
        own = np.flatnonzero(normals @ normals[middle] > 0)
        distance = np.linalg.norm(points[own] - points[middle], axis=1)
        keep[own[distance <= np.sort(distance)[min(int(share / 3 * len(points)), len(own) - 1)]]] = False
    return scan_of(points[keep], sensors[keep])


def case(seed: int) -> tuple[str, TriangleMesh, Scan, dict[str, float]]:
    rng = np.random.default_rng(seed)
    name = list(PARTS)[seed % len(PARTS)]
    size = float(10.0 ** rng.uniform(-2, 1))
    truth = moved(PARTS[name](), size * rotation(seed), rng.uniform(-5, 5, 3))
    spacing = min(float(rng.uniform(0.35, 0.8)) * WALLS[name], LARGEST_H)
    noise, share = float(rng.choice([0.0, 0.1, 0.2, 0.3])), float(rng.choice([0.0, 0.0, 0.1, 0.2]))
    scan, _, normals = scanned(truth, spacing * size, noise * WALLS[name] * size, seed=seed)
    scan = occluded(scan, normals, share, rng) if share else scan
    blind = bool(rng.integers(2))
    scan = Scan(cloud=PointCloud.of(scan.cloud.points)) if blind else scan
    return name, truth, scan, {"h": spacing, "noise": noise, "hidden": share, "blind": blind}


def row(seed: int, method: str) -> dict[str, Any]:
    """The row of a case; its `end` is "sound", "refused", "no surface", "UNSOUND" or "WRONG"."""
    name, truth, scan, facts = case(seed)
    out: dict[str, Any] = {"part": name, "n": len(scan.cloud), **facts}
    begin = time.process_time()
    try:
        found = reconstruct(scan, ReconstructionOptions(method=method))
    except ReconstructionError as error:
        return {**out, "refused": str(error), "end": "no surface"}
    out["seconds"] = time.process_time() - begin
    out["crossings"], out["volume"] = len(self_intersections(found.mesh)), volume(found.mesh) / volume(truth)
    out["refused"] = ", ".join(check.name for check in found.checks if not check.passed)
    end = "refused" if out["refused"] else "sound"
    if not surface_topology(found.mesh).is_clean or out["crossings"]:
        end = "UNSOUND"
    elif not out["refused"] and abs(out["volume"] - 1) > WRONG:
        end = "WRONG"
    return {**out, "end": end}


def told(r: dict[str, Any]) -> str:
    head = f"{r['case'][0]:4d} {r['part']:9s} {r['n']:6d} noise {r['noise']:.1f} hidden {r['hidden']:.1f} {'blind' if r['blind'] else 'seen '}"
    if "volume" not in r:
        return f"{head}  no surface: {r['refused']}"
    return f"{head}  volume {r['volume']:.3f}  crossings {r['crossings']}  {r['seconds']:5.1f} s  {r['end']} {r['refused']}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} cases in place of {ALL}")
    parser.add_argument("--cases", type=int, help="so many cases")
    parser.add_argument("--first", type=int, default=0, help="seed of the first case")
    parser.add_argument("--method", default="visibility", choices=list(METHODS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="file of finished rows, read and continued")
    args = parser.parse_args()
    ends: Counter[str] = Counter()
    cases = [(seed, args.method) for seed in range(args.first, args.first + (args.cases or (QUICK if args.quick else ALL)))]
    for found in rows(row, cases, args.jobs, args.rows):
        ends[found["end"]] += 1
        print(told(found), flush=True)
    print(f"{args.method}: " + ", ".join(f"{count} {end}" for end, count in sorted(ends.items())))
    return 1 if ends["UNSOUND"] + ends["WRONG"] else 0


if __name__ == "__main__":
    sys.exit(main())
