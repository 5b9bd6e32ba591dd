"""Scans and catalogues that are no good for estimation, each through `scan2fea fit`: python benchmarks/estimation_bad_input.py [NAME ...].

One line each: exit code, CPU seconds, and the lines that the program says.
"""

from __future__ import annotations

import csv
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np

from scan2fea.cli.main import main as command
from scan2fea.estimation.table import shipped_text
from scan2fea.io.ply_writer import write_cloud_ply
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud

ANGLE = {"a": 0.1, "b": 0.1, "t": 0.01, "length": 1.0}
GOOD = member_points("L", ANGLE, 8_000, MemberScanOptions(noise_m=0.0005, caps=True))


def sphere() -> np.ndarray:
    rng = np.random.default_rng(0)
    way = rng.standard_normal((6_000, 3))
    return 0.2 * way / np.linalg.norm(way, axis=1)[:, None] + 0.0005 * rng.standard_normal(way.shape)


def stub() -> np.ndarray:
    return member_points("I", {"h": 0.3, "b": 0.2, "tw": 0.008, "tf": 0.012, "length": 0.1}, 6_000, MemberScanOptions(noise_m=0.0005))


def side_by_side() -> np.ndarray:
    return np.concatenate([GOOD, GOOD + np.array([0.3, 0.2, 0.0])])


def crossing() -> np.ndarray:
    return np.concatenate([GOOD, (GOOD - [0, 0, 0.5]) @ np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0.0]]) + [0, 0.12, 0.5]])


POINTS: dict[str, tuple[Callable[[], np.ndarray], tuple[str, ...]]] = {
    "40 points": (lambda: GOOD[:40], ()),
    "points on one line": (lambda: np.linspace(0, 1, 500)[:, None] * [1.0, 2.0, 3.0], ()),
    "all points alike": (lambda: np.ones((500, 3)), ()),
    "a sphere": (sphere, ()),
    "shorter than its section": (stub, ()),
    "two members side by side": (side_by_side, ()),
    "two members that cross": (crossing, ()),
    "a sensor inside the solid": (lambda: GOOD, ("--sensor-position", "0.005", "0.05", "0.5")),
}


def catalogues(folder: Path) -> dict[str, Path]:
    """Files made of the shipped table: a column left out, and values in inches under names in mm."""
    head, *rows = csv.reader(shipped_text().splitlines())
    cut, marked = head.index("t_mm"), [k for k, name in enumerate(head) if name.endswith("_mm")]
    missing, inches = folder / "missing.csv", folder / "inches.csv"
    with missing.open("w", newline="") as file:
        csv.writer(file).writerows([row[:cut] + row[cut + 1 :] for row in (head, *rows)])
    small = [[f"{float(v) / 25.4:.6g}" if k in marked and v else v for k, v in enumerate(row)] for row in rows]
    with inches.open("w", newline="") as file:
        csv.writer(file).writerows([head, *small])
    return {"a catalogue without a column": missing, "inches marked mm": inches}


def told(arguments: list[str]) -> str:
    out, error, begun = StringIO(), StringIO(), time.process_time()
    with redirect_stdout(out), redirect_stderr(error):
        try:
            code: object = command(arguments)
        except SystemExit as end:
            code = end.code
    return f"exit {code}, {time.process_time() - begun:.1f} s: {error.getvalue().strip() or out.getvalue().strip()}"


def main() -> None:
    wanted = sys.argv[1:]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for what, (points, more) in POINTS.items():
            if not wanted or what in wanted:
                write_cloud_ply(folder / "scan.ply", PointCloud.of(points()))
                print(f"{what}: {told(['fit', str(folder / 'scan.ply'), *more])}", flush=True)
        write_cloud_ply(folder / "scan.ply", PointCloud.of(GOOD))
        for what, path in catalogues(folder).items():
            if not wanted or what in wanted:
                print(f"{what}: {told(['fit', str(folder / 'scan.ply'), '--catalogue', str(path)])}", flush=True)


if __name__ == "__main__":
    main()
