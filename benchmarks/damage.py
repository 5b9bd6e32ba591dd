"""Damage of members: how often sound ones show any, and from which depth on a loss and a dent are found. Printed, not asserted.

python benchmarks/damage.py [--seeds N] [--points N]
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from pathlib import Path

import numpy as np

from scan2fea.estimation.damage import damages
from scan2fea.kernel.transforms import random_rotation

_SPEC = importlib.util.spec_from_file_location("made", Path(__file__).parents[1] / "tests" / "estimation" / "made.py")
_MADE = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_MADE)
SIZES, made, scanned = _MADE.SIZES, _MADE.made, _MADE.scanned

SIGMAS = (0.0005, 0.002, 0.0067, 0.02)
L = {"a": 0.127, "b": 0.127, "t": 0.00635}


def loss(depth):
    def change(local):
        local = local.copy()
        local[(local[:, 1] < 1e-9) & (abs(local[:, 2] - 1.2) < 0.2), 1] += depth
        return local

    return change


def dent(depth):
    def change(local):
        local = local.copy()
        rows = (local[:, 1] < 0.0064) & (local[:, 0] > 0.0064)
        local[rows, 1] += depth * np.exp(-(((local[rows, 0] - 0.07) / 0.05) ** 2 + ((local[rows, 2] - 1.0) / 0.05) ** 2))
        return local

    return change


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--seeds", type=int, default=10)
    arguments.add_argument("--points", type=int, default=8000)
    given = arguments.parse_args()
    start, n, false = time.process_time(), 0, 0
    for family in SIZES:
        row = []
        for sigma in SIGMAS:
            shown = 0
            for seed in range(given.seeds):
                member = made(family, 3.0, R=random_rotation(seed), sigma=sigma)
                shown += bool(damages(scanned(member, given.points, sigma, seed, 0.15 * (seed % 2)), member, sigma))
            row.append(shown)
            n, false = n + given.seeds, false + shown
        print(f"{family:6} sound members with damage, by noise {SIGMAS} m: {row} of {given.seeds} each")
    print(f"false: {false} of {n} ({false / n:.2%}), {(time.process_time() - start) / n:.2f} s each\n")
    for name, change in (("loss of 400 mm", loss), ("dent of 100 mm", dent)):
        for sigma in SIGMAS[:3]:
            found = {}
            for depth in (0.0005, 0.001, 0.002, 0.003, 0.005):
                member = made("L", 3.0, L, sigma=sigma)
                places = [damages(scanned(member, given.points, sigma, seed, change=change(depth)), member, sigma) for seed in range(given.seeds)]
                right = [p[0] for p in places if p and 0.8 < p[0].position_m[2] < 1.6]
                median = 1e3 * float(np.median([p.depth_m for p in right])) if right else float("nan")
                found[f"{1e3 * depth:g} mm"] = f"{len(right)}/{given.seeds} (depth {median:.2f})"
            print(f"{name}, sigma {1e3 * sigma:g} mm, {given.points} points: {found}")


if __name__ == "__main__":
    main()
