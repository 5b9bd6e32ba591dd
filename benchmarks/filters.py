"""CPU seconds of voxel means and outlier filters, beside Open3D where it is installed (never in the project's own environment).

    python benchmarks/filters.py [--points 10000000]

Points of surfaces in a cube of 20 m, noise 5 mm. One thread of ours; process time of both, so that Open3D's threads count. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import importlib.util
import resource
import time
from collections.abc import Callable

import numpy as np

from scan2fea.filtering import FilteringOptions
from scan2fea.filtering.outliers import outliers
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.types import FloatArray


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
    n = parser.parse_args().points
    points, few = faces(n), faces(n // 10, 1)
    voxel_mean(few[:100], 0.1)
    for edge in (0.02, 0.1):
        timed(f"voxel mean of {n:,}, edge {edge} m, ours ({points.nbytes / 2**20:.0f} MB in)", lambda edge=edge: voxel_mean(points, edge))
    for method in ("density", "statistical", "isolated"):
        outliers(few[:1000], FilteringOptions(outliers=method))
        timed(f"{method} filter of {n // 10:,}, ours", lambda method=method: outliers(few, FilteringOptions(outliers=method)))
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
