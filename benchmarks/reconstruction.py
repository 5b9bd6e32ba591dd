"""Noisy scans by a range camera without sensor positions: python benchmarks/reconstruction.py [part ...] [--seeds N]. Parts of size 1.

One row per part and seed: images, points, noise along the rays, volume ratio, 95 % of the distances both ways in spacings, what refused it.
`--scan FILE --truth FILE` does the same for a scan on disk.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from photographed import photographed
from predicates import box, sphere, two_sided
from scan2fea.io import read_scan
from scan2fea.kernel.measures import volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import reconstruct
from scan2fea.simulation.polyhedra import meshed, prism, revolved
from scan2fea.simulation.shapes import bracket, chs, circle, cylinder, i_beam, l_beam, table
from scan2fea.types import PointCloud, Scan, TriangleMesh


def hole(x: float, y: float, radius: float) -> np.ndarray:
    return (circle(radius, 0.0005) + np.array([x, y]))[::-1]


def blob() -> TriangleMesh:
    ball = sphere(1.0, rounds=5)
    u = ball.vertices
    size = 0.35 + 0.08 * np.sin(3 * u[:, :1]) * np.cos(2 * u[:, 1:2] + 1) + 0.05 * u[:, 2:] ** 3
    return TriangleMesh(vertices=u * size * np.array([1.2, 1.0, 0.8]), faces=ball.faces)


TEE = [[-0.4, 0], [0.4, 0], [0.4, 0.08], [0.04, 0.08], [0.04, 0.6], [-0.04, 0.6], [-0.04, 0.08], [-0.4, 0.08]]
OPENING = np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.7], [0.1, 0.7]])[::-1]
PARTS = {
    "plate": lambda: meshed(prism([[0, 0], [1, 0], [1, 0.6], [0, 0.6]], 0.05, [hole(0.2, 0.3, 0.06), hole(0.75, 0.2, 0.1)])),
    "angle": lambda: l_beam(0.7, 0.5, 0.15, 0.8),
    "tee": lambda: meshed(prism(TEE, 0.7)),
    "cylinder": lambda: cylinder(0.25, 0.9, 0.001),
    "tube": lambda: chs(0.5, 0.07, 0.6, 0.001),
    "bracket": lambda: bracket(0.7, 0.6, 0.06, 0.5, [("a", 0.4, 0.25, 0.08), ("b", 0.35, 0.25, 0.07)], 0.001),
    "table": lambda: table(1.0, 0.7, 0.6, 0.05, 0.07, 0.05),
    "cup": lambda: revolved([[0, 0], [0.3, 0], [0.3, 0.6], [0.22, 0.6], [0.22, 0.1], [0, 0.1]], 72),
    "ibeam": lambda: i_beam(0.4, 0.3, 0.04, 0.05, 0.9),
    "blob": blob,
    "block": lambda: box((0.8, 0.5, 0.4)),
    "frame": lambda: meshed(prism([[0, 0], [1, 0], [1, 0.8], [0, 0.8]], 0.09, [OPENING])),
}


def row(name: str, points: np.ndarray, truth: TriangleMesh, sigma: float | None) -> str:
    begin = time.process_time()
    found = reconstruct(Scan(cloud=PointCloud.of(points)))
    seconds = time.process_time() - begin
    there, back = two_sided(found.mesh, truth)
    good = surface_topology(found.mesh).is_clean and not len(self_intersections(found.mesh))
    refused = [check.name for check in found.checks if not check.passed]
    noise = "" if sigma is None else f" of {1e3 * sigma:5.1f}"
    return (
        f"{name:10s} {found.how.get('n_images', 0):3.0f} images {len(points):6d} points  noise {1e3 * found.sigma_m:5.1f}{noise} e-3"
        f"  wall {1e3 * float(found.how['wall_m']):6.1f}  volume {volume(found.mesh) / volume(truth):.4f}"
        f"  p95 {np.percentile(there, 95) / found.spacing_m:.2f} / {np.percentile(back, 95) / found.spacing_m:.2f} h"
        f"  {'clean' if good else 'NOT CLEAN'}  {seconds:5.1f} s{'  refused: ' + ', '.join(refused) if refused else ''}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=list(PARTS), help=f"of {', '.join(PARTS)}")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--scan", type=Path)
    parser.add_argument("--truth", type=Path)
    args = parser.parse_args()
    if args.scan and args.truth:
        truth = read_scan(args.truth).mesh
        print(row(args.scan.stem[:10], read_scan(args.scan).scan.cloud.points, truth, None))
        return
    for seed in range(args.seeds):
        rng = np.random.default_rng(seed)
        for k, name in enumerate(args.parts):
            n, sigma = int(rng.integers(8, 28)), float(rng.uniform(0.005, 0.045))
            truth, points, _ = photographed(PARTS[name](), n, sigma, seed=1000 * seed + k)
            print(row(name, points, truth, sigma), flush=True)


if __name__ == "__main__":
    main()
