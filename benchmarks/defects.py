"""Scans of real shapes with one defect each, the default beside screened Poisson on the same points: python benchmarks/defects.py [--rows FILE].

Closed meshes of the data folder (SCAN2FEA_DATA), scaled to a diagonal of 1, points SPACING apart, sensor positions known. The defects are those of
the survey whose F-scores reference/peers.md quotes, their sizes our own: noise (0.004 in all directions), outliers (2 % of the points, anywhere in
the box), missing (a tenth of the points, in three balls), misaligned (eight stations, each 0.005 and 0.5 degrees off). Outliers are filtered first,
for both methods. F-score: harmonic mean of the shares of either surface within 0.005 of the other. A surface that is refused says so.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from seeded import rows

from predicates import two_sided
from scan2fea.errors import ReconstructionError
from scan2fea.filtering import outliers
from scan2fea.io import read_mesh
from scan2fea.kernel.measures import volume
from scan2fea.kernel.topology import surface_topology
from scan2fea.kernel.transforms import rotation_about
from scan2fea.reconstruction import ReconstructionOptions, reconstruct
from scan2fea.types import Scan, TriangleMesh
from scanned import scan_of, scanned

MESHES = ("cgal/femur.off", "common3d/rocker-arm.obj", "cgal/fandisk.off", "libigl/3holes.off", "cgal/anchor.off")
DEFECTS = ("none", "noise", "outliers", "missing", "misaligned")
METHODS = ("visibility", "poisson")
SPACING, NEAR = 0.01, 0.005  # of the diagonal
NOISE, OUTLIERS, MISSING, STATIONS, SHIFT, TURN = 0.004, 0.02, 0.1, 8, 0.005, np.radians(0.5)


def shape(name: str) -> TriangleMesh:
    mesh = read_mesh(Path(os.environ["SCAN2FEA_DATA"]) / "meshes" / name)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return TriangleMesh(vertices=(mesh.vertices - low) / float(np.linalg.norm(high - low)), faces=mesh.faces)


def defective(truth: TriangleMesh, defect: str) -> Scan:
    rng = np.random.default_rng(DEFECTS.index(defect))
    scan, _, _ = scanned(truth, SPACING, NOISE if defect == "noise" else 0.0, seed=1)
    points, sensors = scan.cloud.points.copy(), scan.sensors()
    if defect == "outliers":
        n = int(OUTLIERS * len(points))
        stray = truth.vertices.min(axis=0) + rng.random((n, 3)) * np.ptp(truth.vertices, axis=0)
        of = rng.integers(len(points), size=n)
        points, sensors = np.concatenate([points, stray]), np.concatenate([sensors, sensors[of]])
        keep = outliers(points).is_good
        points, sensors = points[keep], sensors[keep]
    elif defect == "missing":
        gone = np.zeros(len(points), bool)
        for middle in points[rng.integers(len(points), size=3)]:
            away = np.linalg.norm(points - middle, axis=1)
            gone |= away <= np.quantile(away, MISSING / 3)
        points, sensors = points[~gone], sensors[~gone]
    elif defect == "misaligned":
        ways, shifts = rng.normal(size=(2, STATIONS, 3))
        station = np.argmax(np.nan_to_num(sensors - points) @ ways.T, axis=1)
        for k in range(STATIONS):
            own, centre = station == k, points.mean(axis=0)
            R, shift = rotation_about(rng.normal(size=3), TURN), SHIFT * shifts[k] / np.linalg.norm(shifts[k])
            points[own] = (points[own] - centre) @ R.T + centre + shift
    return scan_of(points, sensors)


def row(name: str, defect: str, method: str) -> dict[str, Any]:
    truth = shape(name)
    scan = defective(truth, defect)
    begin = time.process_time()
    try:
        found = reconstruct(scan, ReconstructionOptions(method=method))
    except ReconstructionError as error:
        return {"n": len(scan.cloud), "f": 0.0, "sound": False, "refused": str(error)}
    there, back = two_sided(found.mesh, truth)
    share = float((there <= NEAR).mean()), float((back <= NEAR).mean())
    refused = ", ".join(check.name for check in found.checks if not check.passed)
    out = {"n": len(scan.cloud), "f": 2 * share[0] * share[1] / max(sum(share), 1e-300), "sound": bool(surface_topology(found.mesh).is_clean)}
    out["volume"] = volume(found.mesh) / volume(truth)
    return {**out, "refused": refused, "seconds": round(time.process_time() - begin, 1), "how": found.how["method"]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--meshes", nargs="*", default=list(MESHES))
    parser.add_argument("--rows", type=Path, help="file of finished rows, read and continued")
    args = parser.parse_args()
    table: dict[tuple[str, str], list[float]] = {}
    for r in rows(row, [(mesh, defect, method) for mesh in args.meshes for defect in DEFECTS for method in METHODS], 1, args.rows):
        name, defect, method = r["case"]
        table.setdefault((defect, method), []).append(r["f"])
        text = f"{name:26s} {defect:10s} {method:10s} {r['n']:6d} points  F {100 * r['f']:6.2f}  volume {r.get('volume', 0):.3f}"
        print(f"{text}  {r.get('seconds', 0):5.1f} s  {r['refused'] or 'passed'}", flush=True)
    for defect in DEFECTS:
        print(f"{defect:10s} " + "  ".join(f"{method} {100 * np.mean(table[defect, method]):.2f}" for method in METHODS if (defect, method) in table))


if __name__ == "__main__":
    main()
