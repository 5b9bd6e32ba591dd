"""The real scenes of the data folder (SCAN2FEA_DATA) through `scan2fea segment`: objects and kinds found, time, memory, and IoU where there is truth.

    python benchmarks/real_scenes.py [WORD ...] [-o FOLDER]          WORD: only scans whose path holds one of them

Truth: the labels of the file (pc2beam); the CAD at the pose that the file's name gives, within 15 mm of it and clear of the table (steel_tee: that
pose is 8 mm off, NOTES.md); a footprint (city3d/001: what stands in it is the building); one body, where the file was cut out to hold nothing else.
The pictures are FOLDER/NAME/segments.png: look at them, a figure does not tell what is missing from the truth.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from scan2fea.io import InputOptions, read_mesh, read_scan
from scan2fea.kernel.distances import distance_to_mesh
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation.shapes import posed

Truth = Callable[[Path, np.ndarray], np.ndarray]  # the scan's path and the points (n, 3) -> object of each, -1: nobody knows
ELSEWHERE = 10**6  # of no object that is asked for; a segment that takes it in has it against itself
NEAR_CAD_M, CLEAR_M = 0.015, 0.02
SHOWN = 6


def labelled(path: Path, points: np.ndarray) -> np.ndarray:
    given = read_scan(path, InputOptions(labels="7")).scan.cloud
    return np.asarray(given.label)[k_nearest(given.points, 1, points)[1][:, 0]]


def one_body(path: Path, points: np.ndarray) -> np.ndarray:
    return np.zeros(len(points), np.int64)


def tee(path: Path, points: np.ndarray) -> np.ndarray:
    """0 on the tee, clear of the table."""
    x, yaw = (0.1016, 45.0) if "x4y24_45" in path.name else (0.0, 0.0)
    cad = posed(read_mesh(path.parent / "8in10in_tee_01.ply"), rigid(rotation_about((0, 0, 1), np.radians(yaw)), (x, -0.6096, 0.0254)))
    is_tee = distance_to_mesh(points, cad).distance < NEAR_CAD_M
    return np.where(is_tee, np.where(points[:, 2] > CLEAR_M, 0, -1), ELSEWHERE)


def footprint(path: Path, points: np.ndarray) -> np.ndarray:
    """0 within the outline of the building."""
    lines = [line.split() for line in (path.parent / "001_footprint.obj").read_text().splitlines()]
    corner = np.array([row[1:3] for row in lines if row and row[0] == "v"], float)
    ring = next([int(word.split("/")[0]) - 1 for word in row[1:]] for row in lines if row and row[0] == "f")
    start, end = corner[ring], corner[np.roll(ring, -1)]
    beyond = np.zeros(len(points), np.int64)  # sides that a ray along x crosses: an odd number from within
    for (x, y), (u, v) in zip(start[:, :2], end[:, :2], strict=True):
        crosses = (points[:, 1] >= min(y, v)) & (points[:, 1] < max(y, v))
        beyond += crosses & (points[:, 0] < x + (points[:, 1] - y) * (u - x) / (v - y if v != y else 1.0))
    return np.where(beyond % 2 == 1, 0, ELSEWHERE)


SCENES: tuple[tuple[str, Truth | None], ...] = (
    ("structural/pc2beam/test_points.txt", labelled),
    ("structural/steel_tee/table_8in10in_tee_x0y24.pcd", tee),
    ("structural/steel_tee/table_8in10in_tee_x4y24_45.pcd", tee),
    *((f"structural/steel_shape2/shape2_{turn}deg_filtered.pcd", one_body) for turn in (0, 45, 60, 90)),
    ("structural/weld_parts/2plate_partA_fig1_cropped.pcd", None),
    ("structural/weld_parts/2plate_partA_fig2_cropped.pcd", None),
    ("structural/box/caixa.ply", None),
    ("structural/box/caixa7.ply", one_body),
    ("structural/buildings/building.ply", one_body),
    ("structural/city3d/001.ply", footprint),
    *((f"structural/city3d/building_{number}.ply", one_body) for number in (5, 9, 12, 72, 94)),
    ("structural/misc/min_cut_segmentation_tutorial.pcd", None),
)


def measured(command: list[str]) -> tuple[float, float]:
    """Processor seconds and peak memory, MiB, of a command that must succeed."""
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(command)}: exit {os.waitstatus_to_exitcode(status)}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def row(path: Path, truth: Truth | None, out: Path) -> str:
    seconds, mebibytes = measured([sys.executable, "-m", "scan2fea", "segment", str(path), "-o", str(out)])
    report = json.loads((out / "report.json").read_text())
    segments = report["segments"]
    roles = [segment["role"] for segment in segments]
    named = [f"{s['kind']} {s['confidence']:.0%}" if s["confidence"] is not None else s["kind"] for s in segments]
    told = ", ".join(named[:SHOWN]) + (f", {len(named) - SHOWN} more" if len(named) > SHOWN else "")
    figures = "no truth" if truth is None else against(path, truth, report, out)
    counts = f"{roles.count('object')} / {roles.count('support')} / {roles.count('clutter')}"
    return f"| {path.parent.name}/{path.stem} | {report['n_points']:,} | {counts} | {told} | {figures} | {seconds:.1f} | {mebibytes:.0f} |"


def against(path: Path, truth: Truth, report: dict, out: Path) -> str:
    """IoU of each true object with the segment of role object that fits it best."""
    labelled = read_scan(out / "cloud.ply", InputOptions(labels="label")).scan.cloud
    objects = np.append([segment["role"] == "object" for segment in report["segments"]], False)
    found = np.where(objects[labelled.label], labelled.label, -1)
    true = truth(path, labelled.points + np.array(report["frame"]["shift_m"]))
    known = true >= 0
    figures = []
    for number in np.unique(true[known & (true != ELSEWHERE)]):
        own = known & (true == number)
        figures.append(max((own & (found == label)).sum() / (own | (known & (found == label))).sum() for label in np.unique(found[found >= 0])))
    return "IoU " + ", ".join(f"{iou:.3f}" for iou in figures)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("words", nargs="*")
    arguments.add_argument("-o", "--out", type=Path)
    given = arguments.parse_args()
    data = Path(os.environ.get("SCAN2FEA_DATA", "."))
    print("| scan | points | objects / supports / clutter | kinds guessed | truth | s | MiB |\n|---|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as spare:
        for name, truth in SCENES:
            if given.words and not any(word in name for word in given.words):
                continue
            out = (given.out or Path(spare)) / Path(name).parent.name / Path(name).stem
            out.mkdir(parents=True, exist_ok=True)
            print(row(data / name, truth, out), flush=True)


if __name__ == "__main__":
    main()
