"""With registration error simulated: how often do 95 % intervals of a fitted member's dimensions hold the truth? 0.90 to 0.98 is asked.

    python benchmarks/pose_doubt.py [--seeds 100] [--beside] [--state FILE.jsonl]

An angle of 150 x 100 x 12, 1 mm of noise, 2,500 points. `sides`: its outer faces from one frame, the rest from another, that is off by 0.6 mm a
standard deviation and axis. `stations`: four frames, each sees the faces that look its way, all are off by as much and turned by 0.03 degrees
(about their middle, 0.45 m from the ends). `--beside`: the doubt of the poses taken whole for every dimension, and none. Nothing is asserted: the
table is in docs/registration.md. Resumable.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from scan2fea.estimation.member import MemberOptions
from scan2fea.kernel.sections import section
from scan2fea.pipeline.dimension_doubt import FramePose, PoseDoubt
from scan2fea.pipeline.route import RouteOptions, estimate
from scan2fea.types import PointCloud, Scan

SIZES = {"a": 0.15, "b": 0.1, "t": 0.012, "length": 0.9}
SIGMA, SHIFT, TURN = 0.001, 0.0006, np.radians(0.03)
POINTS = 2_500
WAYS = ("derivative", "whole", "none")


def seen(rng: np.random.Generator, kind: str) -> tuple[PointCloud, PoseDoubt]:
    """The points of one draw, displaced by the errors of their frames, and what is told of these."""
    (loop,) = section("L", SIZES).loops
    way = np.roll(loop, -1, axis=0) - loop
    long = np.linalg.norm(way, axis=1)
    edge = rng.choice(len(loop), POINTS, p=long / long.sum())
    xy = loop[edge] + rng.random((POINTS, 1)) * way[edge]
    outward = np.stack([way[edge, 1], -way[edge, 0]], axis=1)
    points = np.column_stack([xy, SIZES["length"] * rng.random(POINTS)]) + rng.normal(0, SIGMA, (POINTS, 3))
    if kind == "sides":
        frame, moved, turn = (outward.sum(axis=1) > 0).astype(np.int64), (1,), 0.0
    else:  # each face is looked at by the two stations in front of it
        looks = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
        chance = (outward @ looks.T > 0) / 2.0
        frame, moved, turn = (rng.random((POINTS, 1)) > np.cumsum(chance, axis=1)).sum(axis=1).astype(np.int64), (0, 1, 2, 3), TURN
    frames, variance = [], np.zeros(POINTS)
    for k in moved:
        own = frame == k
        centre = points[own].mean(axis=0)
        variance[own] = SHIFT**2 + 2 / 3 * turn**2 * ((points[own] - centre) ** 2).sum(axis=1)
        R = Rotation.from_rotvec(rng.normal(0, turn, 3) if turn else np.zeros(3))
        points[own] = R.apply(points[own] - centre) + centre + rng.normal(0, SHIFT, 3)
        x, y, z = centre.tolist()
        frames.append(FramePose(frame=k, centre_m=(x, y, z), std_m=np.sqrt(3) * SHIFT, std_rad=np.sqrt(3) * turn))
    cloud = PointCloud.of(points).replaced(frame=frame)
    return cloud, PoseDoubt(frames=tuple(frames), between_m=float(np.sqrt(2 * variance.mean())))


def measured(kind: str, seed: int, beside: bool) -> dict[str, object]:
    cloud, doubt = seen(np.random.default_rng([19, seed]), kind)
    row: dict[str, object] = {"kind": kind, "seed": seed}
    for name, told in (("derivative", doubt), ("none", PoseDoubt()))[: 1 + beside]:
        found = estimate(Scan(cloud=cloud), MemberOptions(), RouteOptions(), None, told).member
        if found is not None and found.family == "L":
            row[name] = {p.name: [p.value_m - SIZES[p.name], p.std_m] for p in found.parameters}
    if "none" in row:
        row["whole"] = {name: [off, std and math.hypot(std, doubt.between_m)] for name, (off, std) in dict(row["none"]).items()}
    return row


def table(rows: list[dict[str, object]]) -> None:
    print("frames    way         dimension  n    within 1.96 std  error / told, rms  told, median mm")
    for kind in sorted({str(r["kind"]) for r in rows}):
        for way in WAYS:
            own = [r[way] for r in rows if r["kind"] == kind and way in r]
            every: list[float] = []
            for name in SIZES:
                pairs = np.array([[o[name][0], o[name][1]] for o in own if o[name][1]], float)
                if not len(pairs):
                    continue
                share = pairs[:, 0] / pairs[:, 1]
                every += [] if name == "length" else share.tolist()
                print(
                    f"{kind:9s} {way:11s} {name:9s} {len(pairs):4d} {np.mean(np.abs(share) < 1.96):10.3f} {np.sqrt(np.mean(share**2)):18.2f} "
                    f"{1e3 * np.median(pairs[:, 1]):15.3f}"
                )
            if every:
                z = np.array(every)
                print(f"{kind:9s} {way:11s} section   {len(z):4d} {np.mean(np.abs(z) < 1.96):10.3f} {np.sqrt(np.mean(z**2)):18.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--beside", action="store_true")
    parser.add_argument("--state", type=Path, default=Path("pose_doubt.jsonl"))
    asked = parser.parse_args()
    rows = [json.loads(line) for line in asked.state.read_text().splitlines()] if asked.state.exists() else []
    done = {(row["kind"], row["seed"]) for row in rows}
    started = time.process_time()
    with asked.state.open("a") as kept:
        for seed in range(asked.seeds):
            for kind in ("sides", "stations"):
                if (kind, seed) not in done:
                    rows.append(measured(kind, seed, asked.beside))
                    kept.write(json.dumps(rows[-1]) + "\n")
                    kept.flush()
    table(rows)
    print(f"{time.process_time() - started:.0f} cpu s")


if __name__ == "__main__":
    main()
