"""Rooms of touching members of many seeds: member-level F1 at IoU 0.5 of the default segmentation.

    python benchmarks/touching.py [--seeds 20] [--first 100] [--picture FOLDER]

A member is found where a segment of kind object overlaps it at IoU 0.5 or more; a segment that matches no solid of the room counts against precision.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from scan2fea.registration import joined
from scan2fea.report.segments_picture import segments_picture
from scan2fea.segmentation import SegmentationOptions, segment_scene
from scan2fea.segmentation.metrics import MATCH_IOU, agreement
from scan2fea.simulation.stations import StationsOptions, scan_stations
from scan2fea.simulation.touching import ROOM_KINDS, is_member, stations_around, touching_room
from scan2fea.types import PointCloud, Scan

LEAST_POINTS = 200


def room(seed: int) -> tuple[Scan, list[str], np.ndarray]:
    """The scan (labels: number of the solid), names, and which solids are members."""
    noise = float(np.random.default_rng([seed, 12]).uniform(0.0005, 0.002))
    scene = touching_room(seed)
    scan = joined(scan_stations(scene, StationsOptions(positions_m=stations_around(scene, seed), noise_m=noise), seed))
    return scan, [s.name for s in scene.solids], np.array([is_member(s) for s in scene.solids])


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seeds", type=int, default=20)
    arguments.add_argument("--first", type=int, default=100)
    arguments.add_argument("--picture", type=Path)
    given = arguments.parse_args()
    hits = wanted = found_all = false = 0
    purity = []
    for seed in range(given.first, given.first + given.seeds):
        scan, names, members = room(seed)
        start = time.process_time()
        found = segment_scene(scan, SegmentationOptions(seed=seed))
        took = time.process_time() - start
        objects = np.array([kind == "object" for kind in found.kinds])
        labels = np.where(found.labels >= 0, np.where(np.append(objects, False)[found.labels], found.labels, -1), -1)
        good = agreement(scan.cloud.label, labels)
        counted = np.isin(good.objects, np.flatnonzero(members)) & (good.n_points >= LEAST_POINTS)
        hit = counted & (good.iou >= MATCH_IOU)
        n_found = len(np.unique(labels[labels >= 0]))
        n_false = max(n_found - int((good.iou >= MATCH_IOU).sum()), 0)
        hits, wanted, found_all, false = hits + int(hit.sum()), wanted + int(counted.sum()), found_all + n_found, false + n_false
        pure = 1.0 - good.under[hit]
        purity += pure.tolist()
        missed = [names[k] for k in good.objects[counted & ~hit]]
        print(f"{seed} {ROOM_KINDS[seed % 3]:8s} {len(scan.cloud):7d} points {hit.sum():2d}/{counted.sum():2d} members, {n_false} false, "
              f"least purity {min(pure, default=0):.3f}, least recall {1 - good.over[hit].max(initial=0):.3f}, "
              f"{took:.1f} s; missed: {', '.join(missed)}", flush=True)  # fmt: skip
        if given.picture:
            given.picture.mkdir(parents=True, exist_ok=True)
            cloud = PointCloud.of(scan.cloud.points)
            (given.picture / f"{seed}.png").write_bytes(segments_picture(cloud, found))
    precision, recall = hits / max(hits + false, 1), hits / max(wanted, 1)
    f1 = 2 * precision * recall / max(precision + recall, 1e-9)
    pure = np.array(purity or [0.0])
    print(f"F1 {f1:.3f} (precision {precision:.3f}, recall {recall:.3f}), purity median {np.median(pure):.4f}, least {pure.min():.3f}")


if __name__ == "__main__":
    main()
