"""`python -m scan2fea.pipeline.warm`: runs small objects through everything, so that all kernels are compiled (numba keeps them on disk).

Not needed for anything but speed: without it the first run takes minutes longer.
"""

from __future__ import annotations

import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from scan2fea.estimation.member import fit_member
from scan2fea.io import write_scan_ply
from scan2fea.pipeline.config import load_config
from scan2fea.pipeline.run import run
from scan2fea.registration.register import register
from scan2fea.registration.surface import common_edge, surface_of
from scan2fea.simulation.sampling import blue_noise
from scan2fea.simulation.shapes import bracket
from scan2fea.types import FloatArray, PointCloud, Rays, Scan

N_POINTS = 1500


def _ball() -> FloatArray:
    """(n, 3) points spread evenly over the unit sphere along a golden spiral."""
    k = np.arange(N_POINTS) + 0.5
    polar, around = np.arccos(1 - 2 * k / N_POINTS), np.pi * (1 + 5**0.5) * k
    return np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], axis=1)


def _angle() -> FloatArray:
    """(n, 3) points evenly over the sides of an angle with legs of 0.1 m, 0.5 m long."""
    k = np.arange(N_POINTS)
    corners = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.01], [0.01, 0.01], [0.01, 0.1], [0.0, 0.1], [0.0, 0.0]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    around = (k + 0.5) / N_POINTS * along[-1]
    xy = np.stack([np.interp(around, along, corners[:, axis]) for axis in (0, 1)], axis=1)
    return np.asarray(np.c_[xy, 0.5 * (k * 0.6180339887498949 % 1.0)], np.float64)


def _bracket(rng: np.random.Generator) -> FloatArray:
    """(n, 3) noisy points on an angle plate with a hole."""
    points, _ = blue_noise(bracket(0.1, 0.1, 0.02, 0.1, [("a", 0.06, 0.05, 0.015)]), 0.004, seed=0)
    return np.asarray(points + rng.normal(0.0, 2e-4, points.shape))


def _members() -> None:
    """A member is fitted, and two frames are registered."""
    rng = np.random.default_rng(0)
    frames = [Scan(cloud=PointCloud.of(_angle() + rng.normal(0.0, 0.001, (N_POINTS, 3)))) for _ in range(2)]
    fit_member(frames[0])
    edge = common_edge([frame.cloud.points for frame in frames])
    register([surface_of(frame, edge) for frame in frames], [None, None])


def _runs() -> None:
    """A ball goes through both ways of the reconstruction, with sensor positions and without, and a bracket through flat and true faces."""
    points = _ball()
    rays = Rays(origin=3 * points, direction=-points, range_m=np.full(N_POINTS, 2.0))
    config = load_config(None, {"remeshing.max_faces": 500, "run.jobs": 1})
    with tempfile.TemporaryDirectory() as folder:
        for name, scan in {
            "seen": Scan(cloud=PointCloud.of(points, ray=np.arange(N_POINTS)), rays=rays),
            "bare": Scan(cloud=PointCloud.of(points)),
            "flat": Scan(cloud=PointCloud.of(_bracket(np.random.default_rng(0)))),
        }.items():
            path = Path(folder) / f"{name}.ply"
            write_scan_ply(path, scan)
            run([path], Path(folder) / name, config)


def main() -> None:
    """Both at once, for each compiles on one core. Raises what either raised."""
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for done in [pool.submit(_runs), pool.submit(_members)]:
            done.result()


if __name__ == "__main__":
    main()
