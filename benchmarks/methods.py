"""Every method of segmentation on simulated scenes whose truth is known: adjusted Rand / mean IoU of the objects (objects found at IoU 0.5 of those
there are), processor seconds.

    python benchmarks/methods.py [--points 40000] [--seed 0] [--scenes lab demo ...] [--without METHOD ...] [--case FOLDER]

All with the numbers that they take from the data, supports taken out first (learned finds its own, primitives has none). Floors and walls are no
object: their points do not count, and what a method calls a support is in no object. Purity: the least of the found objects'.

--case: a case of the judge (`scan.ply`, `truth.json`, `truth/`) instead; a point belongs to the nearest of its solids, and to none where that is a
floor or a wall, or as near to two as four times the noise (where two touch nobody can say).
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scan2fea.io import read_mesh, read_scan
from scan2fea.kernel.distances import distance_to_mesh
from scan2fea.kernel.noise import sampled_rows
from scan2fea.registration import joined
from scan2fea.segmentation import SegmentationOptions, segment_scene
from scan2fea.segmentation.metrics import MATCH_IOU, agreement
from scan2fea.simulation import LabOptions, simulate_lab
from scan2fea.simulation.kind_rooms import POINT_CLASSES, furnished_room
from scan2fea.simulation.lab17 import SPACING_M, lab17
from scan2fea.simulation.sampling import SamplingOptions, sampled
from scan2fea.simulation.stations import StationsOptions, scan_stations
from scan2fea.simulation.touching import is_member, stations_around, touching_room
from scan2fea.types import PointCloud, Scan

CERTAIN = 4.0  # standard deviations of the noise
ROWS = (
    *((name, {"method": name}) for name in ("euclidean", "kmeans", "fuzzy_cmeans")),
    *((f"agglomerative, {how}", {"method": "agglomerative", "linkage": how}) for how in ("single", "complete", "average", "ward")),
    *((name, {"method": name}) for name in ("divisive", "learned", "primitives")),
)


def scenes(seed: int) -> Iterator[tuple[str, Scan, np.ndarray]]:
    """Name, scan, and the true object (n,) of each point, -1 for floors, walls and leaves."""
    scan = sampled(lab17(), SamplingOptions(method="grid", spacing_m=SPACING_M), seed)
    yield "lab, 17 objects", scan, np.array(scan.cloud.label)
    lab = simulate_lab(LabOptions())
    scan = joined(lab.scans)
    yield "demo room", scan, np.array(scan.cloud.label) - 1  # 0 is the floor
    for name, number in (("frame", 1), ("truss", 2), ("brackets", 0)):
        number += 300 + 3 * seed
        scene = touching_room(number)
        scan = joined(scan_stations(scene, StationsOptions(positions_m=stations_around(scene, number), noise_m=0.001), number))
        is_object = np.array([is_member(s) or s.shape.kind == "bracket" for s in scene.solids])
        label = np.array(scan.cloud.label)
        yield f"touching, {name}", scan, np.where(is_object[label], label, -1)
    room = furnished_room(960 + seed)
    is_object = np.array([POINT_CLASSES[c] in ("member", "body") for c in room.classes] + [False])
    yield "furnished room", Scan(cloud=PointCloud.of(room.points)), np.where(is_object[room.solid], room.solid, -1)


def case(folder: Path, at_most: int) -> tuple[str, Scan, np.ndarray]:
    """Name, scan thinned to so many points, and the true object (n,) of each point."""
    told = json.loads((folder / "truth.json").read_text())
    scan = read_scan(folder / "scan.ply").scan
    scan, _ = thinned(scan, np.zeros(len(scan.cloud)), at_most, 0)
    away = np.stack([distance_to_mesh(scan.cloud.points, read_mesh(folder / each["mesh"])).distance for each in told["objects"]])
    nearest, second = np.sort(away, axis=0)[:2]
    is_object = np.array([not each["name"].startswith(("floor", "wall")) for each in told["objects"]])
    sure = is_object[away.argmin(axis=0)] & (second - nearest > CERTAIN * told["noise_sd_m"])
    return told["id"], scan, np.where(sure, away.argmin(axis=0), -1)


def thinned(scan: Scan, truth: np.ndarray, at_most: int, seed: int) -> tuple[Scan, np.ndarray]:
    rows = sampled_rows(len(scan.cloud), at_most, seed)
    return Scan(cloud=scan.cloud.take(rows), rays=scan.rays), truth[rows]


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--points", type=int, default=40_000)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--scenes", nargs="*", default=[""], help="words of their names")
    arguments.add_argument("--without", nargs="*", default=[])
    arguments.add_argument("--case", type=Path)
    given = arguments.parse_args()
    for name, whole, label in [case(given.case, given.points)] if given.case else scenes(given.seed):
        if not any(word in name for word in given.scenes):
            continue
        scan, truth = thinned(whole, label, given.points, given.seed)
        print(f"## {name}: {len(truth):,} points, {len(np.unique(truth[truth >= 0]))} objects", flush=True)
        for row, values in ROWS:
            if values["method"] in given.without:
                continue
            start = time.process_time()
            found = segment_scene(scan, SegmentationOptions(**values))
            took = time.process_time() - start
            objects = np.append([kind == "object" for kind in found.kinds], False)
            good = agreement(truth, np.where(objects[found.labels], found.labels, -1))
            hit = int((good.iou >= MATCH_IOU).sum())
            pure = 1.0 - good.under[good.iou >= MATCH_IOU].max() if hit else float("nan")
            figures = f"{good.adjusted_rand:.2f} / {good.mean_iou:.2f} ({hit} of {len(good.iou)})"
            print(f"| {row} | {figures} | purity {pure:.4f} | {took:.1f} s |", flush=True)


if __name__ == "__main__":
    main()
