"""`python -m scan2fea.pipeline.warm`: runs a small ball through everything, so that all kernels are compiled (numba keeps them on disk).

Not needed for anything but speed: without it the first run takes about a minute longer.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from scan2fea.io import write_scan_ply
from scan2fea.pipeline.config import load_config
from scan2fea.pipeline.run import run
from scan2fea.types import FloatArray, PointCloud, Rays, Scan

N_POINTS = 1500


def _ball() -> FloatArray:
    """(n, 3) points spread evenly over the unit sphere along a golden spiral."""
    k = np.arange(N_POINTS) + 0.5
    polar, around = np.arccos(1 - 2 * k / N_POINTS), np.pi * (1 + 5**0.5) * k
    return np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], axis=1)


def main() -> None:
    """Once with sensor positions and once without: both ways through the reconstruction."""
    points = _ball()
    rays = Rays(origin=3 * points, direction=-points, range_m=np.full(N_POINTS, 2.0))
    config = load_config(None, {"remeshing.max_faces": 500, "run.jobs": 1})
    with tempfile.TemporaryDirectory() as folder:
        for name, scan in {
            "seen": Scan(cloud=PointCloud.of(points, ray=np.arange(N_POINTS)), rays=rays),
            "bare": Scan(cloud=PointCloud.of(points)),
        }.items():
            path = Path(folder) / f"{name}.ply"
            write_scan_ply(path, scan)
            run([path], Path(folder) / name, config)


if __name__ == "__main__":
    main()
