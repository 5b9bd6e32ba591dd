"""Rays per second beside the raw embree binding, and the whole LiDAR run. Printed, not asserted.

    python benchmarks/lidar.py [--rays 400000] [--frames 100]

The peer is `embreex` (pip install embreex), rays already in its own float32 and only the number of the triangle asked for; ours are
float64, with the range. One thread each unless said otherwise; thread time, so that other work on the machine does not count; the best of five.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

import numpy as np

from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.simulation.casting import THREADS
from scan2fea.simulation.lab17 import lab17
from scan2fea.simulation.lidar import Hdl32eOptions, scan_lidar
from scan2fea.simulation.sensors import SENSORS
from scan2fea.types import TriangleMesh


def best_of(work: Callable[[], object], clock: Callable[[], float], repeats: int = 5) -> float:
    """Seconds of the quickest run after one that does not count."""
    work()
    seconds = []
    for _ in range(repeats):
        start = clock()
        work()
        seconds.append(clock() - start)
    return min(seconds)


def finer(mesh: TriangleMesh, rounds: int) -> TriangleMesh:
    """Every triangle cut into four, `rounds` times."""
    corners = mesh.vertices[mesh.faces]
    for _ in range(rounds):
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate([np.stack(part, 1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return TriangleMesh(vertices=corners.reshape(-1, 3), faces=np.arange(3 * len(corners)).reshape(-1, 3))


def patterns(n: int, station: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Origins and directions: a LiDAR's turn, and rays in random order and direction."""
    turn = scan_lidar(lab17(), Hdl32eOptions(positions_m=(tuple(station),), frames=max(1, n // 34_720), wobble_deg=0.0))
    lidar = np.concatenate([scan.rays.direction for scan in turn])[:n]
    anywhere = np.random.default_rng(0).standard_normal((len(lidar), 3))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    origin = np.tile(station, (len(lidar), 1))
    return {"HDL-32E order": (origin, lidar), "random order": (origin, anywhere)}


def compare(n: int) -> None:
    scene = lab17()
    station = np.array([0.5, 0.6, 1.2])
    try:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh as EmbreeMesh
    except ImportError:
        rtcore_scene = None
        print("embreex is not installed: no ratios (pip install embreex)")
    for rounds in (0, 3):
        mesh = finer(scene.mesh(), rounds)
        start = time.perf_counter()
        ours = scene_of(mesh)
        built = time.perf_counter() - start
        print(f"{len(mesh.faces):,} triangles: our tree {built:.3f} s", end="")
        if rtcore_scene is not None:
            start = time.perf_counter()
            theirs = rtcore_scene.EmbreeScene()
            EmbreeMesh(theirs, mesh.vertices[mesh.faces].astype(np.float32))
            theirs.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
            print(f", embree {time.perf_counter() - start:.3f} s", end="")
        print()
        for name, (origin, direction) in patterns(n, station).items():
            one = best_of(lambda s=ours, o=origin, d=direction: first_hits(s, o, d), time.thread_time)
            wall = best_of(lambda s=ours, o=origin, d=direction: first_hits(s, o, d, threads=THREADS), time.perf_counter)
            line = f"  {name:14s} {len(origin) / one / 1e6:6.2f} Mrays/s, {THREADS} threads {len(origin) / wall / 1e6:6.2f} (wall)"
            if rtcore_scene is not None:
                o, d = origin.astype(np.float32), direction.astype(np.float32)
                ids = best_of(lambda s=theirs, o=o, d=d: s.run(o, d), time.thread_time)
                full = best_of(lambda s=theirs, o=o, d=d: s.run(o, d, output=1), time.thread_time)
                hit = theirs.run(o, d)
                _, face = first_hits(ours, origin, direction)
                line += (
                    f"; embree {len(o) / ids / 1e6:6.2f}, with the range {len(o) / full / 1e6:6.2f}: ratio {ids / one:.2f}, {full / one:.2f}; "
                    f"same triangle {np.mean(hit == face):.6f}"
                )
            print(line)


def runs(frames: int) -> None:
    scene = lab17()
    options = Hdl32eOptions(positions_m=((0.3, 0.3, 1.2), (1.5, 1.0, 1.2)), times_s=(0.0, frames / 20.0))
    scan_lidar(scene, Hdl32eOptions(positions_m=((0.5, 0.6, 1.2),)))
    start, cpu = time.perf_counter(), time.process_time()
    scans = scan_lidar(scene, options, 1)
    shots = sum(len(s.rays) for s in scans)
    seconds = time.perf_counter() - start
    print(f"HDL-32E, {len(scans)} frames, {shots:,} rays: {seconds:.2f} s wall, {time.process_time() - cpu:.2f} s cpu on {os.cpu_count()} cores")
    terrestrial = SENSORS["terrestrial"]
    start = time.perf_counter()
    (scan,) = terrestrial.scan(scene, terrestrial.options(positions_m=((0.5, 0.6, 1.2),), step_deg=0.2, footprint_rays=7), 1)
    print(f"terrestrial, {len(scan.rays):,} shots of 7 rays: {time.perf_counter() - start:.2f} s wall")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rays", type=int, default=400_000)
    parser.add_argument("--frames", type=int, default=100)
    arguments = parser.parse_args()
    compare(arguments.rays)
    runs(arguments.frames)
