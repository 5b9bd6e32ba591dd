"""Fuzzy c-means beside scikit-fuzzy, single linkage beside fastcluster: processor seconds of the same work, one thread, and their ratio.

    pip install --target PEERS scikit-fuzzy networkx fastcluster; PYTHONPATH=PEERS python benchmarks/cluster_peers.py [--points 200000]

A peer that is not installed is left out. Targets: fuzzy c-means 0.1 of scikit-fuzzy, single linkage 1.05 of its best peer.
"""

from __future__ import annotations

import argparse
import importlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from scan2fea.kernel.spanning_tree import spanning_tree
from scan2fea.segmentation.fuzzy_cmeans import _step
from scan2fea.segmentation.kmeans import plus_plus

CLUSTERS, STEPS = 17, 20
TREE_POINTS = 20_000


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


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--points", type=int, default=200_000)
    points = np.random.default_rng(0).random((arguments.parse_args().points, 3))
    fuzzy(points)
    single(points[:TREE_POINTS])


if __name__ == "__main__":
    main()
