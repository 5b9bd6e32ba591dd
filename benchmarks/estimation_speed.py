"""How long estimation takes: one member of 20,000 to 2,000,000 points, and a frame of 40 members in two processes.

    python benchmarks/estimation_speed.py [--jobs 2] [--points 20000]

Processor seconds of the fits alone (20,000, 200,000 and 2,000,000 points, 2 mm of noise); of the frame (five columns of four storeys, beams between
them, four braces; `--points` of each member) also the wall time, the right members and how far the nodes of `frame.json` lie from where axes meet.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time

import numpy as np

from scan2fea.estimation.frame import frame
from scan2fea.estimation.member import MemberFit, MemberOptions, fit_member
from scan2fea.kernel.transforms import random_rotation
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan

ONE = {
    "L": {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048},
    "I": {"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085, "length": 1.8},
    "CHS": {"d": 0.1683, "t": 0.01, "length": 1.6},
}
COLUMN = ("I", {"h": 0.19, "b": 0.2, "tw": 0.0065, "tf": 0.01})
BEAM = ("I", {"h": 0.3, "b": 0.15, "tw": 0.0071, "tf": 0.0107})
BRACE = ("L", {"a": 0.1, "b": 0.1, "t": 0.01})
BAY, STOREY, LINES, STOREYS = 5.0, 3.2, 5, 4
BACK = 0.12  # of a member's length at its ends, m: where it meets the others

Bar = tuple[str, dict[str, float], np.ndarray, np.ndarray]


def bars() -> list[Bar]:
    """40 members: family, dimensions, the nodes at both ends."""
    at = lambda i, j: np.array([i * BAY, 0.0, j * STOREY])  # noqa: E731
    found = [(*COLUMN, at(i, j), at(i, j + 1)) for i in range(LINES) for j in range(STOREYS)]
    found += [(*BEAM, at(i, j), at(i + 1, j)) for i in range(LINES - 1) for j in range(1, STOREYS + 1)]
    return found + [(*BRACE, at(0, j), at(1, j + 1)) for j in range(STOREYS)]


def scanned(bar: Bar, n: int, seed: int) -> np.ndarray:
    """(n, 3) points of a bar where it stands, 1 mm of noise, 5 % clutter; its centroid is on the line between its nodes."""
    family, size, start, end = bar
    along = (end - start) / np.linalg.norm(end - start)
    across = np.cross([0.0, 1.0, 0.0], along)
    T = np.stack([np.cross(along, across), -across, along], 1) if family == "I" else np.stack([across, np.cross(along, across), along], 1)
    length = float(np.linalg.norm(end - start)) - 2 * BACK
    points = member_points(family, {**size, "length": length}, n, MemberScanOptions(noise_m=0.001, caps=True, clutter=0.05, seed=seed))
    points -= points[:, :2].mean(axis=0) @ np.eye(2, 3)
    return points @ T.T + start + BACK * along


def timed(points: np.ndarray) -> tuple[MemberFit, float]:
    begun = time.process_time()
    found = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions())
    return found, time.process_time() - begun


def one_bar(task: tuple[Bar, int, int]) -> tuple[MemberFit, float]:
    return timed(scanned(*task))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--points", type=int, default=20_000, help="of each member of the frame")
    given = parser.parse_args()
    rng = np.random.default_rng(1)
    timed(member_points("I", ONE["I"], 2_000, MemberScanOptions(noise_m=0.002)))  # what is compiled is compiled once
    for n in (20_000, 200_000, 2_000_000):
        for family, values in ONE.items():
            found, seconds = timed(member_points(family, values, n, MemberScanOptions(noise_m=0.002, seed=n)) @ random_rotation(rng).T)
            print(f"{family:4s} {n:8d} points: {seconds:5.2f} s CPU, {found.member.family}, explained {found.explains}", flush=True)
    all_bars = bars()
    begun = time.perf_counter()
    with multiprocessing.get_context("fork").Pool(given.jobs) as pool:
        done = pool.map(one_bar, [(bar, given.points, k) for k, bar in enumerate(all_bars)], chunksize=1)
    wall, spent = time.perf_counter() - begun, np.array([seconds for _, seconds in done])
    right = sum(fit.member.family == bar[0] and fit.explains for (fit, _), bar in zip(done, all_bars, strict=True))
    begun = time.process_time()
    wire = frame([fit.member for fit, _ in done])
    nodes = np.unique(np.concatenate([bar[2:] for bar in all_bars]), axis=0)
    away = np.linalg.norm(wire.nodes[:, None] - nodes[None], axis=2).min(axis=1)
    print(
        f"frame of {len(all_bars)} members of {given.points} points: {spent.sum():.1f} s CPU, the dearest {spent.max():.2f} s, {wall:.1f} s wall on"
        f" {given.jobs} processes; {right} right; joined in {time.process_time() - begun:.2f} s to {len(wire.nodes)} nodes (of {len(nodes)}),"
        f" {1e3 * np.median(away):.1f} mm off in the median, {1e3 * away.max():.1f} at most"
    )


if __name__ == "__main__":
    main()
