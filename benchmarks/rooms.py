"""Furnished rooms in odd frames through `scan2fea segment`: what of each class comes out as it should. No sensor positions.

    python benchmarks/rooms.py [--seeds 6] [--first 920]

Units go round with the seed (inches with y up, millimetres with x up, metres turned any way). A member or body is found where a segment of
role object overlaps it at IoU 0.5 or more; a floor or wall where most of its points are of role support. Solids of fewer than 200 points and
heaps, which are several things thrown together, do not count; leaves should be in no object that is a member.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from scan2fea.io import InputOptions, read_scan, write_scan_ply
from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation.metrics import MATCH_IOU, agreement
from scan2fea.simulation.kind_rooms import POINT_CLASSES, furnished_room
from scan2fea.types import PointCloud, Scan

LEAST_POINTS = 200
UNITS = (("in", 1 / 0.0254), ("mm", 1000.0), ("m", 1.0))


def frame_of(seed: int) -> np.ndarray:
    """(3, 3): y up, x up, or any way."""
    turned = (np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), random_rotation(seed))
    return turned[seed % 3]


def counted(seed: int, folder: Path) -> tuple[Counter[str], Counter[str]]:
    """Found and wanted of each class in one room."""
    room = furnished_room(seed)
    unit, scale = UNITS[seed % 3]
    path, out = folder / f"room{seed}.ply", folder / f"out{seed}"
    cloud = PointCloud.of(room.points @ frame_of(seed).T * scale, label=np.where(room.solid < 0, len(room.names), room.solid))
    write_scan_ply(path, Scan(cloud=cloud))
    command = [sys.executable, "-m", "scan2fea", "segment", str(path), "-o", str(out), "--unit", unit]
    subprocess.run(command, check=True, capture_output=True)
    rows = json.loads((out / "report.json").read_text())["segments"]
    labelled = read_scan(out / "cloud.ply", InputOptions(labels="label")).scan.cloud
    given = read_scan(path, InputOptions(labels="label", unit=unit)).scan.cloud
    truth = given.label[nearest(given.points, labelled.points)]
    role = {row["label"]: row["role"] for row in rows}
    roles = np.array([role.get(int(label), "none") for label in labelled.label])
    good = agreement(truth, np.where(roles == "object", labelled.label, -1))
    found: Counter[str] = Counter()
    wanted: Counter[str] = Counter()
    for solid, iou, n in zip(good.objects, good.iou, good.n_points, strict=True):
        if n < LEAST_POINTS or solid >= len(room.names) or room.names[solid].startswith("heap"):
            continue
        name = POINT_CLASSES[room.classes[solid]]
        name = "bracket" if room.names[solid].startswith("bracket") else name
        wanted[name] += 1
        is_support = (roles[truth == solid] == "support").mean() > 0.5
        found[name] += int(is_support if name in ("floor", "wall") else iou >= MATCH_IOU)
    return found, wanted


def nearest(points: np.ndarray, queries: np.ndarray) -> np.ndarray:
    from scan2fea.kernel.neighbors import k_nearest

    return k_nearest(points, 1, queries)[1][:, 0]


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seeds", type=int, default=6)
    arguments.add_argument("--first", type=int, default=920)
    given = arguments.parse_args()
    found: Counter[str] = Counter()
    wanted: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(given.first, given.first + given.seeds):
            one, of = counted(seed, Path(folder))
            print(seed, UNITS[seed % 3][0], ", ".join(f"{name} {one[name]}/{of[name]}" for name in of), flush=True)
            found, wanted = found + one, wanted + of
    print("all", ", ".join(f"{name} {found[name]}/{wanted[name]}" for name in wanted))


if __name__ == "__main__":
    main()
