"""Bars that something in front cuts in two, and two bars in line: what `segmentation/hidden_gaps.py` puts together, and what it must not.

    python benchmarks/hidden_gaps.py [--seeds 100] [--first 0]

Each seed is a bar (section, length, noise and stations from the seed) with a post in front of it, scanned from two or three places on one side:

one     the bar is whole; where the post's shadow cuts its points in two, are they one again?
open    it is two bars with a gap between them elsewhere: sensors see through it
behind  the gap between the two bars lies behind the post, and from one place at least it is seen through
unseen  the same, and nobody sees through it: the points of one bar half hidden; told, not counted
A scene counts only if Euclidean clustering has the points of the bar, or bars, in two parts or more of 100 points.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from scan2fea.registration import joined
from scan2fea.segmentation.euclidean import euclidean
from scan2fea.segmentation.hidden_gaps import one_bar
from scan2fea.simulation.solids import Scene
from scan2fea.simulation.stations import StationsOptions, scan_stations
from scan2fea.simulation.touching import _UP, _between, _solid

SECTIONS = (
    {"kind": "RHS", "h": 0.12, "b": 0.08, "t": 0.006},
    {"kind": "CHS", "d": 0.114, "t": 0.006},
    {"kind": "I", "h": 0.16, "b": 0.082, "tw": 0.005, "tf": 0.0074},
    {"kind": "C", "h": 0.14, "b": 0.06, "tw": 0.007, "tf": 0.01},
    {"kind": "L", "a": 0.1, "b": 0.1, "t": 0.01},
)
SPACING_M, LEAST = 0.012, 100


def scene(seed: int, case: str) -> tuple[Scene, tuple[tuple[float, float, float], ...], float]:
    """Solids (the post last), stations, noise."""
    rng = np.random.default_rng([seed, 31])
    section = SECTIONS[int(rng.integers(len(SECTIONS)))]
    length, z, at = float(rng.uniform(1.5, 3.0)), 1.0, float(rng.uniform(0.35, 0.65))
    wide, before = float(rng.uniform(0.06, 0.2)), float(rng.uniform(0.3, 0.8))
    away = float(rng.uniform(2.0, 4.0))
    places = [(float(at * length + x), -away, float(rng.uniform(0.5, 1.8))) for x in rng.uniform(-0.15, 0.15, int(rng.integers(1, 3)))]
    noise = float(rng.uniform(0.0005, 0.002))
    gap = float(rng.uniform(0.06, 0.2))
    middle = at * length if case in ("behind", "unseen") else (0.15 if at > 0.5 else 0.85) * length
    if case == "behind":
        places.append((float(at * length + 1.5 * away * (1 if rng.random() < 0.5 else -1)), -away, 1.2))  # looks past the post
    turn, ends = np.eye(3), [(0.0, length)] if case == "one" else [(0.0, middle - gap / 2), (middle + gap / 2, length)]
    solids = [
        _between(f"bar_{k}", section, np.array([a, 0, z]), np.array([b, 0, z]), _UP, turn, SPACING_M) for k, (a, b) in enumerate(ends)
    ]
    post = {"x": wide, "y": 0.05, "z": 2.2}
    solids.append(_solid("post", "box", post, turn, np.array([at * length - wide / 2, -before - 0.05, 0.0]), SPACING_M))
    return Scene(name=f"gap{seed}", solids=tuple(solids)), tuple(places), noise


def judged(seed: int, case: str) -> tuple[int, int, int]:
    """Of the points of bars: parts, parts after, and how many of those hold points of two bars."""
    solids, places, noise = scene(seed, case)
    scan = joined(scan_stations(solids, StationsOptions(positions_m=places, noise_m=noise, overview_deg=0.5), seed))
    truth, n_bars = np.array(scan.cloud.label), len(solids.solids) - 1
    labels = euclidean(scan.cloud)
    parts = [np.flatnonzero(labels == k) for k in range(int(labels.max()) + 1)]
    number = one_bar(scan.cloud.points, parts, scan.sensors())
    whole = np.append(number, -1)[labels]

    def large(found: np.ndarray) -> int:
        return int((np.bincount(found[(truth < n_bars) & (found >= 0)]) >= LEAST).sum())

    mixed = sum(len(np.unique(truth[whole == k])) > 1 for k in range(int(number.max()) + 1)) - sum(len(np.unique(truth[p])) > 1 for p in parts)
    return large(labels), large(whole), mixed


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seeds", type=int, default=100)
    arguments.add_argument("--first", type=int, default=0)
    given = arguments.parse_args()
    for case in ("one", "open", "behind", "unseen"):
        start, cut, whole, wrong = time.process_time(), 0, 0, 0
        for seed in range(given.first, given.first + given.seeds):
            before, after, mixed = judged(seed, case)
            n = 1 if case == "one" else 2
            cut, whole, wrong = cut + (before > n), whole + (before > n >= after), wrong + mixed
        seconds = time.process_time() - start
        told = f"{cut} with a bar in two, of these {whole} whole again; {wrong} pairs of bars made one"
        print(f"{case:7s} {given.seeds} scenes: {told}; {seconds:.0f} s", flush=True)


if __name__ == "__main__":
    main()
