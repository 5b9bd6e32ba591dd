"""Time and quality of the reconstruction on simulated scans.

    python benchmarks/reconstruct.py [part ...] [--jobs N]

Lengths in mm, CPU seconds of one thread.

One row per part, noise (share of the wall) and source: closed and free of crossings, volume ratio, median wall, distance to the truth both ways.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from seeded import rows

from predicates import extruded, l_beam, sphere, two_sided
from scan2fea.kernel.measures import volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.thickness import median_thickness
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import METHODS, ReconstructionOptions
from scanned import scanned


def tee(b: float = 0.1, h: float = 0.08, t: float = 0.006, length: float = 0.2):
    return extruded(np.array([(-b / 2, 0), (b / 2, 0), (b / 2, t), (t / 2, t), (t / 2, h), (-t / 2, h), (-t / 2, t), (-b / 2, t)]), length, 0.02)


PARTS = {  # mesh, spacing, wall
    "beam": (l_beam(length=1.0), 0.006, 0.00635),
    "tee": (tee(), 0.0025, 0.006),
    "ball": (sphere(0.1, rounds=6), 0.003, 0.03),
    "seed": (l_beam(length=3.048), 0.006, 0.00635),  # the seed's own beam
    "finer": (l_beam(length=3.048), 0.0025, 0.00635),
    "large": (l_beam(length=3.048), 0.0035, 0.00635),
}


def row(name: str, noise: float, source: str, method: str) -> dict[str, str]:
    mesh, spacing, wall = PARTS[name]
    scan, _, _ = scanned(mesh, spacing, noise * wall, seed=1)
    begin = time.process_time()
    found = METHODS[method](scan, ReconstructionOptions(use_sensors=source == "sensors"))
    seconds = time.process_time() - begin
    topology = surface_topology(found.mesh)
    there, back = two_sided(found.mesh, mesh)
    figures = (
        f"{name:6s} {noise:4.2f} {method:15s} {found.source:13s} {len(scan.cloud):6d} closed {topology.is_clean!s:5}"
        f" crossed {len(self_intersections(found.mesh))}"
        f"  volume {volume(found.mesh) / volume(mesh):.4f}  wall {1e3 * median_thickness(found.mesh):7.3f} of {1e3 * wall:6.3f}"
        f" rms {1e3 * np.sqrt((there**2).mean()):.3f}  p95 {1e3 * np.percentile(there, 95):.3f} / {1e3 * np.percentile(back, 95):.3f}"
        f"  max {1e3 * there.max():.2f} / {1e3 * back.max():.2f}  {seconds:.1f} s"
    )
    refused = [check.name for check in found.checks if not check.passed]
    if "n_open_edges_before" in found.how:
        how = found.how
        figures += f"  before: {how['n_pieces']} pieces, {how['n_open_edges_before']} open edges; "
        figures += f"{how['share_kept']:.3f} kept, {how['n_faces_added']} added"
    return {"text": figures + (f"  refused: {', '.join(refused)}" if refused else "")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["beam", "tee", "ball"], help=f"of {', '.join(PARTS)}")
    parser.add_argument("--noise", type=float, nargs="*", default=[0.0, 0.1, 0.3], help="share of the wall")
    parser.add_argument("--method", nargs="*", default=["visibility"], choices=list(METHODS))
    parser.add_argument("--source", nargs="*", default=["sensors", "flood"])
    parser.add_argument("--jobs", type=int, default=1)
    chosen = parser.parse_args()
    cases = [(p, n, s, m) for p in chosen.parts for n in chosen.noise for s in chosen.source for m in chosen.method]
    for found in rows(row, cases, chosen.jobs):
        print(found["text"], flush=True)


if __name__ == "__main__":
    main()
