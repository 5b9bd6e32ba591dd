"""`python -m scan2fea.pipeline.warm`: runs small objects through everything, so that all kernels are compiled (numba keeps them on disk).

Not needed for anything but speed: without it the first run takes minutes longer.
"""

from __future__ import annotations

import contextlib
import gc
import io
import tempfile
import threading
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from scan2fea.estimation.member import fit_member
from scan2fea.io import write_scan_ply
from scan2fea.io.ply_writer import write_mesh_ply
from scan2fea.pipeline import worker
from scan2fea.pipeline.children import Do, Limits, Workers
from scan2fea.pipeline.config import load_config
from scan2fea.pipeline.record import Say
from scan2fea.pipeline.run import run
from scan2fea.registration.register import register
from scan2fea.registration.surface import common_edge, surface_of
from scan2fea.simulation.sampling import blue_noise
from scan2fea.simulation.shapes import bracket
from scan2fea.types import FloatArray, PointCloud, Rays, Scan, TriangleMesh

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


def _frames() -> list[Scan]:
    """Two scans of an angle."""
    rng = np.random.default_rng(0)
    return [Scan(cloud=PointCloud.of(_angle() + rng.normal(0.0, 0.001, (N_POINTS, 3)))) for _ in range(2)]


def _registered() -> None:
    frames = _frames()
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


class _Here(Workers):
    """Converts the objects in this process: what numba has once compiled it compiles anew in each other one, such as its own `np.empty`."""

    def begin(self) -> None:
        """There is nothing to start."""

    def take(self) -> Do:
        """One object after the other."""
        return _convert_here


def _convert_here(arguments: Sequence[str], limits: Limits, say: Say, closing: threading.Event) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        worker.main(Path(arguments[0]))


def _given() -> TriangleMesh:
    """The hull of an uneven ball."""
    points = _ball() * (1 + 1e-3 * np.random.default_rng(0).standard_normal((N_POINTS, 1)))
    hull = ConvexHull(points)
    a, b, c = np.moveaxis(points[hull.simplices], 1, 0)
    inside_out = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    return TriangleMesh(vertices=points, faces=np.where(inside_out[:, None], hull.simplices[:, ::-1], hull.simplices).astype(np.int64))


def _run(name: str) -> None:
    """A scan goes the whole way: through the reconstruction with sensor positions or without, through flat and true faces; or a surface given."""
    settings = {"remeshing.max_faces": 500, "tetmeshing.max_elements": 2000, "run.jobs": 1, "input.unit": "m"}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.ply"
        if name == "given":  # to its tets at once: the scans come to theirs later
            settings |= {"cad.true_faces": False, "cad.patches": False}
            write_mesh_ply(path, _given())
        else:
            write_scan_ply(path, _scan(name))
        run([path], Path(folder) / name, load_config(None, settings), kind=_Here)


def _first() -> None:
    _run("seen")
    _run("bare")
    _registered()
    _run("flat")


def _second() -> None:
    _run("given")
    fit_member(_frames()[0])


def main() -> None:
    """Two at once, for each compiles on one core: what the first comes to late the second has compiled, and the other way round.

    Raises what any raised.
    """
    with ProcessPoolExecutor(2, mp_context=get_context("spawn"), initializer=_seldom_tidied) as pool:
        for done in [pool.submit(_first), pool.submit(_second)]:
            done.result()


def _seldom_tidied() -> None:
    """Compiling makes many objects that live on; to look for dead ones among them as often as Python does takes a tenth of the time."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)


if __name__ == "__main__":
    main()
