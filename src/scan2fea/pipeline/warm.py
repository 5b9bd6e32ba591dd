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


def _scan(name: str) -> Scan:
    """A ball whose sensor positions are known ("seen") or not ("bare"), or a bracket ("flat")."""
    if name == "flat":
        return Scan(cloud=PointCloud.of(_bracket(np.random.default_rng(0))))
    points = _ball()
    if name == "bare":
        return Scan(cloud=PointCloud.of(points))
    rays = Rays(origin=3 * points, direction=-points, range_m=np.full(N_POINTS, 2.0))
    return Scan(cloud=PointCloud.of(points, ray=np.arange(N_POINTS)), rays=rays)


def _run(name: str) -> None:
    """A scan goes the whole way: through the reconstruction with sensor positions or without, through flat and true faces."""
    config = load_config(None, {"remeshing.max_faces": 500, "run.jobs": 1})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.ply"
        write_scan_ply(path, _scan(name))
        run([path], Path(folder) / name, config)


def main() -> None:
    """Two at once, for each compiles on one core, in the order in which most is compiled once. Raises what any raised."""
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        first = [pool.submit(_run, "seen"), pool.submit(_members)]
        for done in [*first, pool.submit(_run, "flat"), pool.submit(_run, "bare")]:
            done.result()


if __name__ == "__main__":
    main()
