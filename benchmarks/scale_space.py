"""Speed of scale space on the seed's beam, noise 0.2 mm, beside CGAL's: python benchmarks/scale_space.py [--spacing 0.0036 0.0021] [--cgal PROGRAM].

CPU seconds of one thread. "steps": what CGAL does too, with sides given (smoothing, tets, front, closing, the way back to scale 0); "whole": all of
`reconstruct` with that method and mesher, the sides found from the sensors and all checks.   PROGRAM: `cgal_scale_space.cpp`, compiled.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from predicates import l_beam
from scan2fea.kernel.delaunay import tetrahedralise
from scan2fea.kernel.face_tree import morton_order
from scan2fea.reconstruction import ReconstructionOptions, reconstruct
from scan2fea.reconstruction.advancing_front import front
from scan2fea.reconstruction.closing import closed
from scan2fea.reconstruction.scale_space import returned, scale_zero, smoothed, smoothing_radius
from scan2fea.reconstruction.visibility import sides
from scan2fea.types import Scan
from scanned import scanned

NOISE_M, STEPS = 0.0002, 4


def seen(spacing_m: float) -> Scan:
    return scanned(l_beam(length=3.048), spacing_m, NOISE_M, seed=1)[0]


def steps(scan: Scan) -> str:
    told = sides(scan)
    scan = Scan(cloud=scan.cloud.replaced(normals=told.normals), rays=scan.rays)
    times = [time.process_time()]
    scan = Scan(cloud=scan.cloud.take(morton_order(scan.cloud.points)), rays=scan.rays)
    points, normals = scan.cloud.points, scan.cloud.normals
    moved = smoothed(points, smoothing_radius(points), STEPS, normals)
    times.append(time.process_time())
    tetra = tetrahedralise(moved, told.spacing_m, 0)
    pieces = front(tetra, normals)
    times.append(time.process_time())
    found = closed(tetra, pieces, normals, told.spacing_m)
    times.append(time.process_time())
    mesh, _ = returned(found.mesh, scale_zero(found.mesh, moved, points, told.spacing_m))
    times.append(time.process_time())
    smoothing, meshing, closing, back = np.diff(times)
    return (
        f"steps: smoothing {smoothing:.2f}, tets and front {meshing:.2f}, closing {closing:.2f}, back {back:.2f},"
        f" in all {times[-1] - times[0]:.2f}, {len(mesh.faces)} triangles"
    )


def whole(scan: Scan, mesher: str) -> str:
    begin = time.process_time()
    reconstruct(scan, ReconstructionOptions(method="scale_space", mesher=mesher, max_points=max(len(scan.cloud), 100)))
    return f"whole, {mesher}: {time.process_time() - begin:.2f}"


def cgal(program: Path, points: np.ndarray) -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "points"
        points.astype("<f8").tofile(path)
        told = subprocess.run([program, path], capture_output=True, text=True, check=True).stdout.split()
    smoothing, fronting, alpha = map(float, told[1:4])
    return (
        f"CGAL: smoothing {smoothing:.2f}, with front {smoothing + fronting:.2f} ({told[4]} triangles),"
        f" with alpha shape {smoothing + alpha:.2f} ({told[5]})"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--spacing", type=float, nargs="*", default=[0.0036, 0.0021], help="m: 100 and 300 thousand points")
    parser.add_argument("--meshers", nargs="*", default=["visibility"])
    parser.add_argument("--cgal", type=Path)
    chosen = parser.parse_args()
    small = seen(0.012)  # machine code is made first
    for mesher in chosen.meshers:
        whole(small, mesher)
    steps(small)
    for spacing in chosen.spacing:
        scan = seen(spacing)
        print(len(scan.cloud), steps(scan), flush=True)
        for mesher in chosen.meshers:
            print(len(scan.cloud), whole(scan, mesher), flush=True)
        if chosen.cgal:
            print(len(scan.cloud), cgal(chosen.cgal, scan.cloud.points), flush=True)


if __name__ == "__main__":
    main()
