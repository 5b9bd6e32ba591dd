"""The thesis's Table 3.1 in figures: adjusted Rand index and mean IoU of each method on 2-D control sets, and the seconds of 1 M points.

python benchmarks/clusters.py [--speed]
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from scan2fea.kernel.spanning_tree import spanning_tree
from scan2fea.segmentation import METHODS, SegmentationOptions
from scan2fea.segmentation.fuzzy_cmeans import converged
from scan2fea.segmentation.kmeans import lloyd, plus_plus
from scan2fea.segmentation.metrics import agreement
from scan2fea.simulation.control_sets import CONTROL_SETS
from scan2fea.types import PointCloud

ROWS = (
    ("kmeans", {}),
    ("fuzzy_cmeans", {}),
    *(("agglomerative", {"linkage": how}) for how in ("single", "complete", "average", "ward")),
    ("divisive", {}),
    ("euclidean", {}),
)


def table() -> None:
    """Rows by method; in each cell ARI / mean IoU (clusters) with the number from the data, then with the true number where it can be given."""
    print("| method | " + " | ".join(CONTROL_SETS) + " |")
    for name, values in ROWS:
        cells = []
        for make in CONTROL_SETS.values():
            points, truth = make(300, 0)
            told = []
            for k in (None, int(truth.max()) + 1):
                if k is not None and name == "euclidean":
                    continue
                options = SegmentationOptions(method=name, clusters=k, min_points=10, **values)
                found = METHODS[name](PointCloud.of(points), options)
                good = agreement(truth, found)
                told.append(f"{good.adjusted_rand:.2f} / {good.mean_iou:.2f} ({found.max() + 1})")
            cells.append("; ".join(told))
        print(f"| {name} {values.get('linkage', '')} | " + " | ".join(cells) + " |", flush=True)


def speed(n: int = 1_000_000) -> None:
    rng = np.random.default_rng(0)
    flat = rng.random((n, 2))
    points = np.c_[flat, np.floor(3 * flat[:, 0])] + 0.001 * rng.standard_normal((n, 3))
    centres = plus_plus(points, 17, rng)
    for name, work in (
        ("single linkage (spanning tree)", lambda p: spanning_tree(p)),
        ("k-means, 17 centres, to the end", lambda p: lloyd(p, centres)),
        ("fuzzy c-means, 17 centres, to the end", lambda p: converged(p, centres, 2.0)),
    ):
        work(points[:1000])
        start = time.process_time()
        result = work(points)
        steps = f", {len(result.objective)} steps" if hasattr(result, "objective") else ""
        print(f"{name:40s} {time.process_time() - start:7.2f} s cpu for {n:,} points{steps}", flush=True)


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--speed", action="store_true")
    table()
    if arguments.parse_args().speed:
        speed()
