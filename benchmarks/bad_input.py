"""Clouds that are not what a reconstruction would like, each through the command line: python benchmarks/bad_input.py [NAME ...].

No orientation, normals flipped, a single sheet, two parts that touch, points twice, spacing varying 20:1, 60 % missing; with sensor positions and
without. One line each: exit code, volume against the truth, share of the surface that was invented, and what the program says. Exit 1 where
anything is passed that is more than 5 % off its volume.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from predicates import box, moved, rotation
from reconstruction import PARTS
from scan2fea.cli.main import main as command
from scan2fea.io.ply_writer import write_scan_ply
from scan2fea.kernel.measures import volume
from scan2fea.simulation.polyhedra import meshed, prism
from scan2fea.types import PointCloud, Scan, TriangleMesh
from scanned import scan_of, scanned

Case = tuple[TriangleMesh, Scan]
NOISE = 0.001  # of the parts' size of 1
TURN = rotation(7)
WRONG = 0.05


def _scan(truth: TriangleMesh, spacing: float) -> tuple[Scan, np.ndarray]:
    scan, _, normals = scanned(truth, spacing, NOISE, seed=1)
    return scan, normals


def _both(one: TriangleMesh, other: TriangleMesh) -> TriangleMesh:
    return TriangleMesh(vertices=np.concatenate([one.vertices, other.vertices]), faces=np.concatenate([one.faces, other.faces + len(one.vertices)]))


def no_orientation() -> Case:
    truth = moved(PARTS["bracket"](), TURN, np.zeros(3))
    return truth, Scan(cloud=PointCloud.of(_scan(truth, 0.02)[0].cloud.points))


def normals_flipped() -> Case:
    truth = moved(PARTS["bracket"](), TURN, np.zeros(3))
    scan, normals = _scan(truth, 0.02)
    return truth, Scan(cloud=PointCloud.of(scan.cloud.points, normals=-normals))


def normals_flipped_seen() -> Case:
    truth = moved(PARTS["bracket"](), TURN, np.zeros(3))
    scan, normals = _scan(truth, 0.02)
    return truth, scan_of(scan.cloud.points, scan.sensors(), normals=-normals)


def _sheet() -> tuple[TriangleMesh, Scan]:
    truth = moved(meshed(prism([[0, 0], [1, 0], [1, 0.6], [0, 0.6]], 0.05)), TURN, np.zeros(3))
    scan, normals = _scan(truth, 0.02)
    top = normals @ TURN[:, 2] > 0.9
    return truth, scan_of(scan.cloud.points[top], scan.sensors()[top])


def single_sheet() -> Case:
    truth, scan = _sheet()
    return truth, Scan(cloud=PointCloud.of(scan.cloud.points))


def single_sheet_seen() -> Case:
    return _sheet()


def _touching() -> tuple[TriangleMesh, Scan]:
    """A box on a larger one: nobody sees the places where they meet."""
    low, high = box((1.0, 0.6, 0.3)), moved(box((0.3, 0.3, 0.3)), np.eye(3), np.array([0.1, 0.1, 0.3]))
    scans = [_scan(part, 0.025) for part in (low, high)]
    points = np.concatenate([scan.cloud.points for scan, _ in scans])
    hidden = (np.abs(points[:, 2] - 0.3) < 5 * NOISE) & (np.abs(points[:, :2] - 0.25) < 0.15).all(axis=1)
    sensors = np.concatenate([scan.sensors() for scan, _ in scans])
    return _both(low, high), scan_of(points[~hidden], sensors[~hidden])


def two_touching() -> Case:
    truth, scan = _touching()
    return truth, Scan(cloud=PointCloud.of(scan.cloud.points))


def two_touching_seen() -> Case:
    return _touching()


def two_at_an_edge() -> Case:
    """Two boxes that share an edge only."""
    parts = box((0.5, 0.6, 0.3)), moved(box((0.5, 0.6, 0.3)), np.eye(3), np.array([0.5, 0.0, 0.3]))
    points = np.concatenate([_scan(part, 0.025)[0].cloud.points for part in parts])
    return _both(*parts), Scan(cloud=PointCloud.of(points))


def duplicated() -> Case:
    truth, scan = no_orientation()
    return truth, Scan(cloud=PointCloud.of(np.repeat(scan.cloud.points, 3, axis=0)))


def _uneven(seen: bool) -> Case:
    """A block scanned ever more coarsely along its length: points 5 mm apart at one end, 100 mm at the other."""
    truth = box((1.6, 0.5, 0.4))
    scan, _ = _scan(truth, 0.005)
    points = scan.cloud.points
    wanted = 0.005 * 20.0 ** np.clip(points[:, 0] / 1.6, 0.0, 1.0)
    keep = np.random.default_rng(0).random(len(points)) < (0.005 / wanted) ** 2
    return truth, scan_of(points[keep], scan.sensors()[keep] if seen else None)


def spacing_20_to_1() -> Case:
    return _uneven(False)


def spacing_20_to_1_seen() -> Case:
    return _uneven(True)


def _missing(seen: bool) -> Case:
    truth = moved(PARTS["bracket"](), TURN, np.zeros(3))
    scan, _ = _scan(truth, 0.02)
    height = scan.cloud.points @ np.array([0.6, 0.8, 0.0])
    keep = height < np.quantile(height, 0.4)
    return truth, scan_of(scan.cloud.points[keep], scan.sensors()[keep] if seen else None)


def missing_60() -> Case:
    return _missing(False)


def missing_60_seen() -> Case:
    return _missing(True)


CASES: dict[str, Callable[[], Case]] = {
    f.__name__: f
    for f in (
        no_orientation, normals_flipped, normals_flipped_seen, single_sheet, single_sheet_seen, two_touching, two_touching_seen, two_at_an_edge,
        duplicated, spacing_20_to_1, spacing_20_to_1_seen, missing_60, missing_60_seen,
    )
}  # fmt: skip


def told(name: str, folder: Path) -> tuple[str, bool]:
    """The line of a case, and whether it was passed though wrong."""
    truth, scan = CASES[name]()
    file, out, said = folder / f"{name}.ply", folder / name, StringIO()
    write_scan_ply(file, scan, lengths="metres")
    begin = time.process_time()
    with redirect_stdout(said), redirect_stderr(said):
        code = command(["reconstruct", str(file), "-o", str(out)])
    seconds = time.process_time() - begin
    text = f"{name:22s} {len(scan.cloud):6d} points  exit {code}  {seconds:5.1f} s"
    report = out / "report.json"
    if not report.exists():
        return f"{text}  {said.getvalue().strip().splitlines()[-1]}", False
    found = json.loads(report.read_text())
    surface = found["surface"]
    ratio = surface["volume_m3"] / volume(truth)
    closed = "closed" if surface["closed"] and surface["manifold"] and not surface["n_self_intersections"] else "NOT SOUND"
    text += f"  {closed}, volume {ratio:.3f}, invented {surface['area_share']['invented']:.0%}, {found['how']['method']} by {found['how']['source']}"
    return f"{text}  {found['reason'] or 'passed'}", not code and abs(ratio - 1) > WRONG


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(CASES)}")
    wrong = False
    for name in parser.parse_args().names or CASES:
        with tempfile.TemporaryDirectory() as folder:
            line, is_wrong = told(name, Path(folder))
        wrong |= is_wrong
        print(f"{line}{'  WRONG' if is_wrong else ''}", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
