"""Five defects of a scan, each on meshes of the data folder: the default surface beside screened Poisson on the same points and normals.

    python benchmarks/defects.py [--meshes fandisk,femur] [--rows FILE]

After the synthetic part of the SCUT benchmark (2022): perfect, noise (sigma 0.005 of the part's size), outliers (5 % of the points anywhere in its
box), missing (20 % in three patches of one side), misaligned (every fourth of the points, by direction of sight, moved 0.005 and turned by half a
degree). The points are cleaned as in a run. A row tells of each surface the share of it within 0.005 of the truth, the share of the truth within
0.005 of it, and their harmonic mean (F); the last rows are means over the meshes.
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

from closed_cases import occluded
from seeded import rows

from scan2fea.errors import ReconstructionError
from scan2fea.filtering import outliers
from scan2fea.io import read_mesh
from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import area
from scan2fea.reconstruction import ReconstructionOptions, reconstruct
from scan2fea.types import FloatArray, Scan, TriangleMesh
from scanned import scan_of, scanned

MESHES = ("cgal/fandisk.off", "cgal/anchor.off", "cgal/femur.off", "cgal/joint.off", "libigl/3holes.off", "cgal/pipe.off", "common3d/rocker-arm.obj")
DEFECTS = ("perfect", "noise", "outliers", "missing", "misaligned")
METHODS = ("visibility", "poisson")
N_POINTS, N_SAMPLES = 15_000, 20_000
NEAR, SIGMA, STRAY, GONE, SHIFT, TURN = 0.005, 0.005, 0.05, 0.2, 0.005, np.radians(0.5)


def truth_of(name: str) -> TriangleMesh:
    """The mesh, its longest side 1."""
    mesh = read_mesh(Path(os.environ.get("SCAN2FEA_DATA", "data")) / "meshes" / name)
    low, size = mesh.vertices.min(axis=0), np.ptp(mesh.vertices, axis=0).max()
    return TriangleMesh(vertices=(mesh.vertices - low) / size, faces=mesh.faces)


def spoiled(truth: TriangleMesh, defect: str, seed: int) -> Scan:
    """A scan of about N_POINTS points with one defect, cleaned."""
    rng = np.random.default_rng(seed)
    spacing = float(np.sqrt(area(truth) / N_POINTS))
    scan, _, normals = scanned(truth, spacing, SIGMA if defect == "noise" else 0.0, seed=seed)
    if defect == "missing":
        scan = occluded(scan, normals, GONE, rng)
    points, sensors = scan.cloud.points, scan.sensors()
    if defect == "outliers":
        n = int(STRAY * len(points))
        points = np.concatenate([points, rng.uniform(truth.vertices.min(axis=0), truth.vertices.max(axis=0), (n, 3))])
        sensors = np.concatenate([sensors, sensors[rng.integers(len(sensors), size=n)]])
    if defect == "misaligned":
        points, sensors = shifted(points, sensors, rng)
    kept = outliers(points).is_good
    return scan_of(points[kept], sensors[kept])


def shifted(points: FloatArray, sensors: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """The quarter of the points that was seen most from one direction, with its sensors, turned about the middle and moved."""
    way = rng.normal(size=3)
    seen = np.nan_to_num((sensors - points) @ way)
    mine = seen >= np.quantile(seen, 0.75)
    axis, off = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    points, sensors = points.copy(), sensors.copy()
    for block in (points, sensors):
        block[mine] += TURN * np.cross(axis, block[mine] - points.mean(axis=0)) + SHIFT * off
    return points, sensors


def row(name: str, defect: str, seed: int) -> dict[str, Any]:
    truth = truth_of(name)
    scan = spoiled(truth, defect, seed)
    out: dict[str, Any] = {"n": len(scan.cloud)}
    for method in METHODS:
        began = time.process_time()
        try:
            found = reconstruct(scan, ReconstructionOptions(method=method))
        except ReconstructionError as error:
            out[method] = {"why": str(error)}
            continue
        there = share_near(found.mesh, truth)
        here = share_near(truth, found.mesh)
        refused = [check.name for check in found.checks if not check.passed]
        out[method] = {"precision": there, "recall": here, "f": 2 * there * here / (there + here), "refused": refused}
        out[method]["cpu"] = time.process_time() - began
    return out


def share_near(mesh: TriangleMesh, other: TriangleMesh) -> float:
    return float((PointToMesh(other).nearest(sample_surface(mesh, N_SAMPLES, 0)[0]).distance <= NEAR).mean())


def told(r: dict[str, Any]) -> str:
    parts = [f"{r['case'][0]:24s} {r['case'][1]:10s} {r['n']:6d}"]
    for method in METHODS:
        m = r[method]
        parts.append(f"{method} {'none' if 'why' in m else '%.2f' % (100 * m['f'])}{' refused' if m.get('refused') else ''}")
    return "  ".join(parts)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", default="", help="parts of their names, separated by commas")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--rows", type=Path)
    given = parser.parse_args()
    names = [name for name in MESHES if any(part in name for part in given.meshes.split(","))]
    made = []
    for r in rows(row, [(name, defect, 1) for name in names for defect in DEFECTS], given.jobs, given.rows):
        made.append(r)
        print(told(r), flush=True)
    for defect in DEFECTS:
        of = [r for r in made if r["case"][1] == defect]
        means = {method: 100 * float(np.mean([r[method].get("f", 0.0) for r in of])) for method in METHODS}
        print(f"mean of {len(of)}  {defect:10s}  " + "  ".join(f"{method} {value:.2f}" for method, value in means.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
