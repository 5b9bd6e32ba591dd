"""One million points from file to labelled objects, stage by stage; beside it the usual way to cluster (scipy pairs + connected components).

    python benchmarks/segment.py [--points 1000000]

Prints seconds (wall and processor) and the peak memory of this process. Targets: 20 s and 2 GB in all; clustering at most 0.3 of the peer's time.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np


def timed(name: str, work: Callable[[], Any]) -> Any:
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    print(f"{name:34s} {time.perf_counter() - wall:8.2f} s wall {time.process_time() - cpu:8.2f} s cpu   peak {peak_mib():7.0f} MiB", flush=True)
    return result


def peak_mib() -> float:
    """Peak resident memory of this process, nan where the system does not say."""
    try:
        import resource
    except ImportError:
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10


def written(n_points: int, path: Path) -> None:
    """A denser scan of the demo lab, all stations in one file. Runs in a process of its own: its memory is not the chain's."""
    from scan2fea.io import write_scan_ply
    from scan2fea.registration import joined
    from scan2fea.simulation import LabOptions, simulate_lab

    start = time.perf_counter()
    lab = simulate_lab(LabOptions(density=n_points / 150_000, overview_deg=0.0))
    scan = joined(lab.scans)
    write_scan_ply(path, scan)
    print(f"simulated {len(scan.cloud)} points in {time.perf_counter() - start:.1f} s, {path.stat().st_size / 2**20:.0f} MiB", flush=True)


def peer(points: np.ndarray, radius: float) -> int:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    return int(connected_components(graph, directed=False)[0])


def main() -> None:
    import multiprocessing

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1_000_000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lab.ply"
        maker = multiprocessing.get_context("spawn").Process(target=written, args=(given.points, path))
        maker.start()
        maker.join()
        chain(path)


def chain(path: Path) -> None:
    from scan2fea.filtering import clean_up
    from scan2fea.io import InputOptions, read_scan
    from scan2fea.kernel.neighbors import radius_components
    from scan2fea.kernel.noise import spacing
    from scan2fea.registration import place
    from scan2fea.segmentation import segment_scene, select

    start = time.perf_counter()
    raw = timed("read", lambda: read_scan(path, InputOptions()))
    placed = timed("place", lambda: place([raw.scan], [None], [path.name]))
    clean = timed("clean up", lambda: clean_up(placed.scan))
    found = timed("supports and clusters", lambda: segment_scene(clean.scan))
    chosen = timed("select", lambda: select(clean.scan.cloud, found))
    print(f"file to {len(chosen.labels)} labelled objects{time.perf_counter() - start:12.2f} s wall, peak {peak_mib():.0f} MiB")
    points = clean.scan.cloud.points
    radius = 3.0 * spacing(points)  # the peer stores every pair: at the 24 mm that this uneven scene needs that is 13 GB
    ours = timed(f"components alone, r = {radius * 1e3:.1f} mm", lambda: int(radius_components(points, radius).max()) + 1)
    theirs = timed("scipy pairs + components", lambda: peer(points, radius))
    print(f"parts: {ours} and {theirs}")


if __name__ == "__main__":
    main()
