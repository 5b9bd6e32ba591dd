"""Seconds and peak memory of reading a scan of 100 million points, LAS and E57. Printed, not asserted; the issue asks for 4 GB at most.

    python benchmarks/read_big.py [--points 100e6] [--folder WITH_4_GB]

The files are written piece by piece into a folder that is deleted afterwards. E57 comes twice: one bare cloud, and stations as terrestrial
scanners write them (pose, grid, intensity, colour, a fifth of the rays without return).
"""

from __future__ import annotations

import argparse
import os
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

PIECE = 1_000_000
ROOM = np.array([20.0, 15.0, 4.0])
AT = np.array([5.0, 5.0, 1.5])  # where the stations stand
STATION_POINTS, ROWS = 7_500_000, 2500  # of one station, and of its columns
FIELDS = (
    "cartesianX",
    "cartesianY",
    "cartesianZ",
    "intensity",
    "colorRed",
    "colorGreen",
    "colorBlue",
    "rowIndex",
    "columnIndex",
    "cartesianInvalidState",
)


def pieces(n: int) -> Iterator[np.ndarray]:
    """Points on the walls and the floor of a room, 2 mm noise."""
    for k in range(0, n, PIECE):
        rng = np.random.default_rng(k)
        m = min(PIECE, n - k)
        xyz = rng.random((m, 3)) * ROOM
        xyz[np.arange(m), rng.integers(3, size=m)] = 0.0
        yield xyz + 0.002 * rng.standard_normal((m, 3))


def swept(station: int, first: int, m: int) -> np.ndarray:
    """The same walls in the frame of a scanner that sweeps about z: row = elevation, column = azimuth. Stations begin at other azimuths."""
    row = np.arange(first, first + m)
    elevation, azimuth = (row % ROWS) / ROWS * 2.4 - 1.0, row // ROWS * (2 * np.pi / (STATION_POINTS // ROWS)) + 0.7 * station
    ray = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1)
    with np.errstate(divide="ignore"):
        away = np.abs(np.where(ray > 0, ROOM - AT, AT) / ray).min(axis=1)
    return ray * (away + 0.002 * np.random.default_rng([station, first]).standard_normal(m))[:, None]


def make_las(path: Path, n: int) -> None:
    head = bytearray(227)
    head[0:4], head[24:26] = b"LASF", bytes([1, 2])
    struct.pack_into("<HIIBHI", head, 94, 227, 227, 0, 3, 34, n)
    struct.pack_into("<6d", head, 131, 0.001, 0.001, 0.001, 0.0, 0.0, 0.0)
    with path.open("wb") as file:
        file.write(head)
        for xyz in pieces(n):
            rows = np.zeros((len(xyz), 34), np.uint8)
            rows[:, :12] = np.rint(xyz / 0.001).astype("<i4").view(np.uint8).reshape(-1, 12)
            rows[:, 12:14] = 100
            rows.tofile(file)


def make_e57(path: Path, n: int) -> None:
    _write_e57(path, [n], FIELDS[:3])


def make_e57_stations(path: Path, n: int) -> None:
    _write_e57(path, [min(STATION_POINTS, n - k) for k in range(0, n, STATION_POINTS)], FIELDS)


def _write_e57(path: Path, sizes: list[int], fields: tuple[str, ...]) -> None:
    import pye57
    from pye57 import libe57

    with pye57.E57(str(path), "w") as file:
        image = file.image_file
        for number, n in enumerate(sizes):
            scan, prototype = libe57.StructureNode(image), libe57.StructureNode(image)
            scan.set("guid", libe57.StringNode(image, f"{{{number}}}"))
            if len(fields) > 3:
                _set_pose(image, scan, libe57)
            for name in fields:
                is_whole = name.startswith("color") or name.endswith(("Index", "State"))
                largest = 2 if name.endswith("State") else 255 if name.startswith("color") else 1 << 14
                prototype.set(
                    name, libe57.IntegerNode(image, 0, 0, largest) if is_whole else libe57.FloatNode(image, 0.0, libe57.E57_SINGLE, -1e3, 1e3)
                )
            points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
            scan.set("points", points)
            file.data3d.append(scan)
            arrays, buffers = file.make_buffers(list(fields), PIECE)
            writer = points.writer(buffers)
            posed = len(fields) > 3
            for first, xyz in zip(range(0, n, PIECE), pieces(n), strict=True):
                _fill(arrays, swept(number, first, len(xyz)) if posed else xyz, np.arange(first, first + len(xyz)))
                writer.write(len(xyz))
            writer.close()


def _set_pose(image: object, scan: object, libe57: object) -> None:
    pose, rotation, translation = (libe57.StructureNode(image) for _ in range(3))  # type: ignore[attr-defined]
    for node, names, values in ((rotation, "wxyz", (1.0, 0.0, 0.0, 0.0)), (translation, "xyz", AT.tolist())):
        for name, value in zip(names, values, strict=True):
            node.set(name, libe57.FloatNode(image, value))  # type: ignore[attr-defined]
    scan.set("pose", pose)  # type: ignore[attr-defined]
    pose.set("rotation", rotation)
    pose.set("translation", translation)


def _fill(arrays: dict[str, np.ndarray], xyz: np.ndarray, row: np.ndarray) -> None:
    m = len(xyz)
    for k, name in enumerate(FIELDS[:3]):
        arrays[name][:m] = xyz[:, k]
    if "rowIndex" in arrays:
        arrays["rowIndex"][:m], arrays["columnIndex"][:m] = row % ROWS, row // ROWS
        arrays["cartesianInvalidState"][:m] = np.where(row % 5 == 0, 2, 0)
        arrays["intensity"][:m] = 0.5
        for name in ("colorRed", "colorGreen", "colorBlue"):
            arrays[name][:m] = row % 256


MAKERS = {"LAS": ("a.las", make_las), "E57": ("a.e57", make_e57), "E57 stations": ("b.e57", make_e57_stations)}


def measure(path: Path) -> str:
    import resource

    from scan2fea.io import read_scan

    wall, cpu = time.perf_counter(), time.process_time()
    raw = read_scan(path)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    edge = "all kept" if raw.voxel_edge_m is None else f"{1e3 * raw.voxel_edge_m:.2f} mm"
    rays = 0 if raw.scan.rays is None else len(raw.scan.rays)
    return f"{raw.n_points:>12,}{len(raw.scan.cloud):>12,}{rays:>12,}{edge:>12}{cpu:>9.1f}{wall:>9.1f}{peak / 1e9:>8.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=float, default=100e6)
    parser.add_argument("--folder", help="where the files are written for the while")
    parser.add_argument("--only", choices=MAKERS, help="one of the files")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        action, path = given.child
        print(measure(Path(path)) if action == "read" else MAKERS[action][1](Path(path), int(given.points)) or "")
        return
    print(f"{'file':<14}{'GB':>6}{'points':>12}{'read':>12}{'rays':>12}{'voxels':>12}{'cpu s':>9}{'wall s':>9}{'peak GB':>8}")
    for name in [given.only] if given.only else MAKERS:
        with tempfile.TemporaryDirectory(dir=given.folder) as folder:
            path = Path(folder) / MAKERS[name][0]
            child = [sys.executable, __file__, "--points", str(given.points), "--child"]
            subprocess.run([*child, name, str(path)], check=True, capture_output=True)
            done = subprocess.run([*child, "read", str(path)], check=True, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
            print(f"{name:<14}{path.stat().st_size / 1e9:>6.2f}{done.stdout.rstrip()}", flush=True)


if __name__ == "__main__":
    main()
