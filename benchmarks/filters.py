"""CPU seconds of voxel means and outlier filters, beside PCL and Open3D where they are there (never in the project's own environment).

    python benchmarks/filters.py [--points 10000000] [--pcl PROGRAM]

Points of surfaces in a cube of 20 m, noise 5 mm; the filters get the first tenth of them. PROGRAM is `pcl_filters.cpp`, compiled (its second line
says how). One thread of ours; process time of all, so that threads of others count. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import importlib.util
import resource
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from scan2fea.filtering import FilteringOptions
from scan2fea.filtering.outliers import outliers
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.types import FloatArray

RADIUS = 0.26  # m: about fifteen of a million points lie within


def faces(n: int, seed: int = 0) -> FloatArray:
    """Points on twelve planes."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 20.0, (n, 3))
    k = np.arange(n)
    points[k, k % 3] = 5.0 * ((k // 3) % 4) + 0.005 * rng.standard_normal(n)
    return points


def timed(what: str, verb: Callable[[], object]) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = time.process_time()
    verb()
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(f"{what}: {time.process_time() - started:.2f} cpu s, peak {grown:.0f} MB more")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=10_000_000)
    parser.add_argument("--pcl", type=Path)
    given = parser.parse_args()
    n = given.points
    points = faces(n)
    few = points[: n // 10].copy()
    voxel_mean(few[:100], 0.1)
    for edge in (0.02, 0.1):
        timed(f"voxel mean of {n:,}, edge {edge} m, ours ({points.nbytes / 2**20:.0f} MB in)", lambda edge=edge: voxel_mean(points, edge))
    for method in ("density", "radius", "statistical", "isolated"):
        options = FilteringOptions(outliers=method, radius_m=RADIUS)
        outliers(few[:1000], options)
        timed(f"{method} filter of {n // 10:,}, ours", lambda options=options: outliers(few, options))
    if given.pcl:
        with tempfile.NamedTemporaryFile() as file:
            points.tofile(file)
            file.flush()
            print(subprocess.run([given.pcl, file.name, str(RADIUS)], check=True, capture_output=True, text=True).stdout, end="")
    if importlib.util.find_spec("open3d") is None:
        print("open3d is not installed here")
        return
    import open3d

    cloud, small = (open3d.geometry.PointCloud(open3d.utility.Vector3dVector(p)) for p in (points, few))
    for edge in (0.02, 0.1):
        timed(f"voxel mean of {n:,}, edge {edge} m, Open3D", lambda edge=edge: cloud.voxel_down_sample(edge))
    timed(f"radius filter of {n // 10:,}, Open3D", lambda: small.remove_radius_outlier(10, 0.2))
    timed(f"statistical filter of {n // 10:,}, Open3D", lambda: small.remove_statistical_outlier(10, 1.0))


if __name__ == "__main__":
    main()
