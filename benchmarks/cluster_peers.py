"""Fuzzy c-means beside scikit-fuzzy, single linkage beside fastcluster, Euclidean clustering beside PCL: processor seconds of the same work, one
thread, and their ratio.

    pip install --target PEERS scikit-fuzzy networkx fastcluster
    PYTHONPATH=PEERS python benchmarks/cluster_peers.py [--points 200000] [--pcl PROGRAM]

PROGRAM is `pcl_clusters.cpp`, compiled (its second line says how). A peer that is not there is left out. Targets: fuzzy c-means 0.1 of scikit-fuzzy,
single linkage 1.05 of its best peer, Euclidean clustering 0.1 of PCL at the lab's 115,000 points and 0.3 at a million.
"""

from __future__ import annotations

import argparse
import importlib
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.kernel.near_tree import near_tree
from scan2fea.kernel.neighbors import radius_components
from scan2fea.kernel.spanning_tree import spanning_tree
from scan2fea.segmentation.euclidean import absorbed
from scan2fea.segmentation.fuzzy_cmeans import _step
from scan2fea.segmentation.kmeans import plus_plus
from scan2fea.segmentation.metrics import agreement
from scan2fea.simulation.lab17 import SPACING_M, lab17
from scan2fea.simulation.sampling import SamplingOptions, sampled

CLUSTERS, STEPS = 17, 20
TREE_POINTS, LEAST = 20_000, 100


def cpu(work: Callable[[], Any]) -> tuple[float, Any]:
    """The least of three runs."""
    runs = []
    for _ in range(3):
        start = time.process_time()
        result = work()
        runs.append(time.process_time() - start)
    return min(runs), result


def peer(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        print(f"{name}: not installed")
        return None


def fuzzy(points: np.ndarray) -> None:
    start = plus_plus(points, CLUSTERS, np.random.default_rng(0))
    _step(points[:100], start, 2.0)

    def ours() -> np.ndarray:
        centres = start
        for _ in range(STEPS):
            sums, weight, _ = _step(points, centres, 2.0)
            centres = sums / weight[:, None]
        return centres

    own, centres = cpu(ours)
    print(f"fuzzy c-means, {len(points):,} points, {CLUSTERS} centres, {STEPS} steps: {own:.2f} s")
    theirs = peer("skfuzzy")
    if theirs is not None:
        from_start = ((points[:, None] - start[None]) ** 2).sum(axis=2) + 1e-30
        degrees = (1 / from_start) / (1 / from_start).sum(axis=1, keepdims=True)
        seconds, found = cpu(lambda: theirs.cmeans(points.T, CLUSTERS, 2.0, error=0.0, maxiter=STEPS, init=degrees.T))
        gap = float(np.abs(found[0] - centres).max())
        print(f"  scikit-fuzzy {seconds:.2f} s: ours is {own / seconds:.3f} of it; centres differ by {gap:.1e}")


def single(points: np.ndarray) -> None:
    spanning_tree(points[:100])
    own, (_, length) = cpu(lambda: spanning_tree(points))
    print(f"single linkage, {len(points):,} points: {own:.2f} s")
    theirs = peer("fastcluster")
    if theirs is not None:
        seconds, found = cpu(lambda: theirs.linkage_vector(points, "single"))
        gap = float(np.abs(np.sort(found[:, 2]) - np.sort(length)).max())
        print(f"  fastcluster {seconds:.2f} s: ours is {own / seconds:.3f} of it; heights differ by {gap:.1e}")


def of_radius(name: str, points: np.ndarray, radius: float, program: Path | None) -> None:
    """Parts nearer than the radius, of at least so many points; the peer reads its points from a file, its seconds begin after that."""

    def ours() -> np.ndarray:
        tree = near_tree(points)
        return absorbed(points, radius_components(points, radius, tree), radius, LEAST, tree)

    ours()
    own, labels = cpu(ours)
    print(f"Euclidean, {name}, {len(points):,} points, radius {1e3 * radius:.1f} mm: {own:.3f} s, {labels.max() + 1} parts")
    if program is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder) / "points", Path(folder) / "labels"
        points.astype(np.float64).tofile(given)
        order = [str(program), str(given), str(radius), str(LEAST), str(out)]
        runs = 3 if len(points) < 500_000 else 1
        seconds = min(float(subprocess.run(order, check=True, capture_output=True, text=True).stdout) for _ in range(runs))
        found = np.fromfile(out, np.int64)
    same = agreement(found, labels).adjusted_rand if found.max() > 0 else float(found.max() == labels.max())
    print(f"  PCL {seconds:.3f} s: ours is {own / seconds:.3f} of it; adjusted Rand of both {same:.6f}")


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--points", type=int, default=200_000)
    arguments.add_argument("--pcl", type=Path)
    given = arguments.parse_args()
    rng = np.random.default_rng(0)
    points = rng.random((given.points, 3))
    fuzzy(points)
    single(points[:TREE_POINTS])
    lab = sampled(lab17(), SamplingOptions(method="grid", spacing_m=SPACING_M), 0).cloud.points
    of_radius("the thesis's lab and radius", lab, 0.0127, given.pcl)
    sheets = np.c_[rng.random((1_000_000, 2)), np.floor(4 * rng.random(1_000_000)) / 4]  # four squares of 1 m, 2 mm between their points
    for around in (20, 80):
        of_radius(f"four sheets, {around} neighbours", sheets, float(np.sqrt(around / np.pi / 250_000)), given.pcl)


if __name__ == "__main__":
    main()
