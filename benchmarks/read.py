"""Time and memory of our readers beside the best of others, on files made on the fly. Printed, not asserted.

    python benchmarks/read.py [--points 10e6]

Every reading runs in its own process, after a small file of the same kind has been read (compiled code is then loaded).
The columns are cpu s, wall s and MB above start.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil

SMALL = 1000


def points_of(n: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.column_stack([rng.random((n, 2)) * [20.0, 15.0], rng.normal(size=n) * 0.002])


def make_las(path: Path, n: int) -> None:
    import laspy

    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales = [0.001] * 3
    file = laspy.LasData(header)
    file.x, file.y, file.z = points_of(n).T
    file.write(path)


def make_e57(path: Path, n: int) -> None:
    import pye57

    xyz = points_of(n)
    with pye57.E57(str(path), "w") as file:
        file.write_scan_raw({f"cartesian{axis}": xyz[:, k].copy() for k, axis in enumerate("XYZ")})


def make_ply(path: Path, n: int) -> None:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    path.write_bytes(head.encode() + points_of(n).astype("<f4").tobytes())


def make_pcd(path: Path, n: int) -> None:
    head = f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nPOINTS {n}\nDATA binary\n"
    path.write_bytes(head.encode() + points_of(n).astype("<f4").tobytes())


def make_xyz(path: Path, n: int) -> None:
    np.savetxt(path, points_of(n), fmt="%.6f")


def ours(path: Path) -> int:
    from scan2fea.io import read_scan

    return len(read_scan(path).scan.cloud)


def ours_bare(path: Path) -> int:
    """Points alone: no checksum, no cloud."""
    from scan2fea.io.formats import open_source

    return sum(len(piece.points) for piece in open_source(path)[1].pieces(frozenset()))


def by_laspy(path: Path) -> int:
    import laspy

    return len(laspy.read(path).xyz)


def by_laspy_chunks(path: Path) -> int:
    import laspy

    with laspy.open(path) as file:
        return sum(len(np.column_stack([chunk.x, chunk.y, chunk.z])) for chunk in file.chunk_iterator(1_000_000))


def by_pye57(path: Path) -> int:
    import pye57

    with pye57.E57(str(path)) as file:
        return len(file.read_scan(0, ignore_missing_fields=True)["cartesianX"])


def by_loadtxt(path: Path) -> int:
    return len(np.loadtxt(path))


def by_trimesh(path: Path) -> int:
    import trimesh

    return len(trimesh.load(path, process=False).vertices)


READERS: dict[str, Callable[[Path], int]] = {
    "scan2fea": ours, "scan2fea points": ours_bare, "laspy": by_laspy, "laspy chunks": by_laspy_chunks,
    "pye57": by_pye57, "numpy.loadtxt": by_loadtxt, "trimesh": by_trimesh,
}  # fmt: skip
MAKERS = {make.__name__: make for make in (make_las, make_e57, make_ply, make_pcd, make_xyz)}
# file, maker, share of the points, readers
CASES = [
    ("a.las", make_las, 1.0, ("scan2fea", "scan2fea points", "laspy", "laspy chunks")),
    ("a.laz", make_las, 0.1, ("scan2fea", "scan2fea points", "laspy", "laspy chunks")),
    ("a.e57", make_e57, 0.1, ("scan2fea", "scan2fea points", "pye57")),
    ("a.ply", make_ply, 1.0, ("scan2fea", "scan2fea points", "trimesh")),
    ("a.pcd", make_pcd, 1.0, ("scan2fea", "scan2fea points")),
    ("a.xyz", make_xyz, 0.1, ("scan2fea", "scan2fea points", "numpy.loadtxt")),
]


def measure(reader: str, path: Path, small: Path) -> str:
    """In the child: read the small file, then the large one."""
    READERS[reader](small)
    process = psutil.Process()
    before, cpu, wall = process.memory_info().rss, time.process_time(), time.perf_counter()
    n = READERS[reader](path)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    memory = process.memory_info()
    peak = getattr(memory, "peak_wset", None) or _peak()
    return f"{n:>11,} points {cpu:8.2f} {wall:8.2f} {max(peak - before, 0) / 1e6:8.0f}"


def _peak() -> int:
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=float, default=10e6)
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("--make", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.make:
        MAKERS[given.make[0]](Path(given.make[1]), int(given.make[2]))
        return
    if given.child:
        print(measure(given.child[0], Path(given.child[1]), Path(given.child[2])))
        return
    print(f"{'file':<8}{'reader':<18}{'read':>18} {'cpu s':>8} {'wall s':>8} {'MB':>8}")
    for name, make, share, readers in CASES:
        with tempfile.TemporaryDirectory() as folder:
            large, small = Path(folder) / name, Path(folder) / f"small{Path(name).suffix}"
            for path, n in ((large, int(given.points * share)), (small, SMALL)):  # in a child: a process begins with the peak of its parent
                subprocess.run([sys.executable, __file__, "--make", make.__name__, str(path), str(n)], check=True)
            for reader in readers:
                command = [sys.executable, __file__, "--child", reader, str(large), str(small)]
                done = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
                print(f"{Path(name).suffix[1:]:<8}{reader:<18}{done.stdout.rstrip()}", flush=True)


if __name__ == "__main__":
    main()
