"""Time and quality of the reconstruction on simulated scans.

    python benchmarks/reconstruct.py [part ...] [--method default visibility ...] [--turned] [--jobs N] [--rows FILE]

Lengths in mm, CPU seconds of one thread. "default" is what `scan2fea reconstruct` does: visibility, then flat faces where these explain the points.

One row per part, noise (share of the wall) and source: closed and free of crossings, volume ratio, median wall, distance to the truth both ways,
and of the true creases to those found (95 % of their length, and all of it).
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from seeded import rows

from predicates import extruded, l_beam, moved, rotation, sphere, two_sided
from scan2fea.kernel.measures import face_normals, volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.thickness import median_thickness
from scan2fea.kernel.topology import edge_table, surface_topology
from scan2fea.reconstruction import METHODS, ReconstructionOptions, reconstruct
from scan2fea.types import FloatArray, TriangleMesh
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


INCH = 0.0254
SHARP = np.cos(np.radians(30.0))


def creases(mesh: TriangleMesh, pitch: float) -> FloatArray:
    """(n, 3) places `pitch` apart along the edges between faces that meet at more than 30 degrees."""
    normals, twin = face_normals(mesh), edge_table(mesh.faces).twin
    half = np.arange(len(twin))
    sharp = (twin > half) & (np.einsum("ij,ij->i", normals[half // 3], normals[twin // 3]) < SHARP)
    start, end = mesh.faces.ravel()[sharp], mesh.faces[:, [1, 2, 0]].ravel()[sharp]
    out = []
    for a, b in zip(mesh.vertices[start], mesh.vertices[end], strict=True):
        share = np.linspace(0, 1, 2 + int(np.linalg.norm(b - a) / pitch))[:, None]
        out.append((1 - share) * a + share * b)
    return np.concatenate(out) if out else np.zeros((0, 3))


def row(name: str, noise: float, source: str, method: str, turned: bool) -> dict[str, str]:
    mesh, spacing, wall = PARTS[name]
    scale = 1.0
    if turned:  # any pose, and lengths in inches: nothing may rest on axes or units
        scale = 1.0 / INCH
        mesh, spacing, wall = moved(mesh, scale * rotation(3), np.array([40.0, -7.0, 3.0])), spacing * scale, wall * scale
    scan, _, _ = scanned(mesh, spacing, noise * wall, seed=1)
    options = ReconstructionOptions(use_sensors=source == "sensors")
    begin = time.process_time()
    found = reconstruct(scan, options) if method == "default" else METHODS[method](scan, options)
    seconds = time.process_time() - begin
    topology = surface_topology(found.mesh)
    there, back = two_sided(found.mesh, mesh)
    mm = 1e3 / scale
    figures = (
        f"{name:6s} {noise:4.2f} {method:15s} {found.source:13s} {len(scan.cloud):6d} closed {topology.is_clean!s:5}"
        f" crossed {len(self_intersections(found.mesh))}"
        f"  volume {volume(found.mesh) / volume(mesh):.6f}  wall {mm * median_thickness(found.mesh):7.3f} of {mm * wall:6.3f}"
        f" rms {mm * np.sqrt((there**2).mean()):.3f}  p95 {mm * np.percentile(there, 95):.3g} / {mm * np.percentile(back, 95):.3g}"
        f"  max {mm * there.max():.3g} / {mm * back.max():.3g}  {seconds:.1f} s  {found.how['method']}"
    )
    sharp = creases(found.mesh, 0.02 * spacing)
    if found.how["method"] == "planar" and len(sharp):
        off = cKDTree(sharp).query(creases(mesh, 0.5 * spacing))[0]
        figures += f"  creases {np.percentile(off, 95) / spacing:.3f} / {off.max() / spacing:.3f} h"
    elif "not_planar" in found.how:
        figures += f"  not planar: {found.how['not_planar']}"
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
    parser.add_argument("--method", nargs="*", default=["visibility"], choices=["default", *METHODS])
    parser.add_argument("--source", nargs="*", default=["sensors", "flood"])
    parser.add_argument("--turned", action="store_true", help="in another pose, and in inches")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="file of finished rows, read and continued")
    chosen = parser.parse_args()
    cases = [(p, n, s, m, chosen.turned) for p in chosen.parts for n in chosen.noise for s in chosen.source for m in chosen.method]
    for found in rows(row, cases, chosen.jobs, chosen.rows):
        print(found["text"], flush=True)


if __name__ == "__main__":
    main()
