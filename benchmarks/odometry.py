"""The way of an HDL-32E past the simulated lab from its sweeps alone, on drawn ways, seeds and arrangements: how wrong, and is it said to be sure?

    python benchmarks/odometry.py [--cases 48] [--jobs 16] [--state FILE.jsonl]

Each case draws a way (sideways distance, height, speed, swing of 0 to 0.3 m), one of a hundred arrangements of the lab, and either all sweeps of 5 s
or every fifth; its capture is written, read and cut in sweeps as `run` does. Wrong: a place off by more than 50 mm and three stated deviations.
Resumable: cases that the state file holds are not computed again. Nothing is asserted: the table is in docs/registration.md.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from scan2fea.io import read_scan
from scan2fea.kernel.transforms import inverse
from scan2fea.pipeline.simulate_logs import write_logs
from scan2fea.pipeline.sweeps import cut_in_sweeps, period_of, range_noise, unwrapped
from scan2fea.registration import Odometry, odometry
from scan2fea.registration.agreement import Agreement, Fans, agreement
from scan2fea.registration.motion import moved
from scan2fea.simulation.lab17 import lab17
from scan2fea.simulation.motion import path_of, trajectory_at
from scan2fea.simulation.sensors import SENSORS

WRONG_M, WRONG_STD = 0.05, 3.0
ASKED_M, ASKED_DEG, ASKED_CLOUD_M = 0.005, 0.1, {1: 0.004, 5: 0.006}  # every sweep, every fifth
SEEN = 7  # every so many returns are placed by the truth at their moments
SECONDS = 5.0


def drawn(case: int) -> dict[str, float]:
    """The way of one case."""
    rng = np.random.default_rng([9, case])
    middle, length = rng.uniform(0.8, 2.6), rng.uniform(1.0, 5.0)
    return {
        "case": case, "lab": int(rng.integers(100)), "every": int(rng.choice([1, 5])), "x0": middle - length / 2, "x1": middle + length / 2,
        "y": float(rng.choice([-1.0, 1.0]) * rng.uniform(1.6, 2.6) + 0.6), "z": rng.uniform(0.8, 1.8),
        "swing": float(rng.choice([0.0, 0.05, 0.15, 0.3])),
        "period": float(rng.choice([0.8, 1.3, 2.5, 5.0])), "yaw": float(rng.choice([0.0, 0.0, 20.0])),
    }  # fmt: skip


def measured(case: int) -> dict[str, object]:
    """One case from the capture to the verdict."""
    way = drawn(case)
    t = np.linspace(0.0, SECONDS, 41)
    place = np.c_[np.linspace(way["x0"], way["x1"], 41), way["y"] + way["swing"] * np.sin(2 * np.pi * t / way["period"]), np.full(41, way["z"])]
    turn = np.c_[np.zeros((41, 2)), way["yaw"] * np.sin(2 * np.pi * t / SECONDS)]
    options = SENSORS["hdl32e"].options(
        positions_m=tuple(map(tuple, place)), times_s=tuple(t), orientations_deg=tuple(map(tuple, turn)), keep_every=way["every"]
    )
    scans = SENSORS["hdl32e"].scan(lab17(int(way["lab"])), options, case)
    with tempfile.TemporaryDirectory() as folder:
        write_logs(Path(folder), "c", "hdl32e", options, scans, case)
        raw = read_scan(Path(folder) / "c.pcap")
    started = time.process_time()
    rays, ray = raw.scan.rays, raw.scan.cloud.ray
    moment = unwrapped(rays.time_s[ray])
    sweeps, begun = cut_in_sweeps(raw.scan.cloud.points, rays, ray, moment, period_of(moment, raw.sweep))
    sigma = range_noise(rays, ray, moment)
    found = odometry(sweeps, sigma)
    cpu = time.process_time() - started
    path = path_of(options, "hdl32e")
    truth = trajectory_at(path, begun + sweeps.period_s * np.arange(len(sweeps) + 1)).T_world_frame
    true = trajectory_at(path, begun + sweeps.period_s * (np.arange(len(sweeps)) + found.middle)).T_world_frame
    off = np.array([inverse(a) @ b for a, b in zip(inverse(true[0]) @ true, found.T_world_sweep, strict=True)])
    far, turned = np.linalg.norm(off[:, :3, 3], axis=1), np.degrees(np.linalg.norm(Rotation.from_matrix(off[:, :3, :3]).as_rotvec(), axis=1))
    points, first, share = sweeps.points[::SEEN], sweeps.sweep[::SEEN], sweeps.share[::SEEN]
    exact = inverse(true[0]) @ trajectory_at(path, begun + sweeps.period_s * (first + share)).T_world_frame
    seen = moved(points, found.T_world_knot, first, share)
    cloud = np.sqrt(((seen - np.einsum("nij,nj->ni", exact[:, :3, :3], points) - exact[:, :3, 3]) ** 2).sum(axis=1).mean())
    right = agreement(Fans(sweeps.points, sweeps.sweep, sweeps.share, sigma, sweeps.gap_rad), truth)
    wrong = bool(((far > WRONG_M) & (far > WRONG_STD * found.std_m)).any())
    return {
        **way, "sweeps": len(sweeps), "returns": len(sweeps.points) // len(sweeps), "off_m": float(far.max()), "std_m": float(found.std_m.max()),
        "turned_deg": float(turned.max()), "cloud_m": float(cloud), "worst_stds": float((far[1:] / found.std_m[1:]).max()),
        "wrong": wrong, "sure": found.is_sure, "stands": found.stands, "contradicted": found.agreement.contradicted, "limit": found.agreement.limit,
        "under_truth": right.contradicted, "without_guard": found.is_sure or _sure_else(found), "cpu_s": cpu,
    }  # fmt: skip


def _sure_else(found: Odometry) -> bool:
    """Would it be sure if sweeps were not compared?"""
    return replace(found, agreement=Agreement(contradicted=0.0, limit=1.0, pair=(0, 0))).is_sure


def _as_asked(row: dict[str, object]) -> bool:
    """Every place within 5 mm, every turn within 0.1 degrees, and the returns within 4 mm rms (6 mm with every fifth sweep)."""
    within = row["off_m"] <= ASKED_M and row["turned_deg"] <= ASKED_DEG
    return bool(row["sure"] and within and row["cloud_m"] <= ASKED_CLOUD_M[int(row["every"])])


def table(rows: list[dict[str, object]]) -> None:
    print("case every swing  way   returns  off mm  turn deg  cloud mm  stated  contradicted  under truth  said (else: without that comparison)")
    for r in sorted(rows, key=lambda row: row["case"]):
        said = ("WRONG " if r["wrong"] else "right ") + ("sure" if r["sure"] else "not sure")
        said += " (else sure)" if r["without_guard"] > r["sure"] else ""
        way = f"{r['case']:4d} {r['every']:3d} {r['swing']:6.2f} {r['x1'] - r['x0']:5.1f} {r['returns']:7d}"
        print(
            f"{way} {1e3 * r['off_m']:9.1f} {r['turned_deg']:8.2f} {1e3 * r['cloud_m']:9.1f} {1e3 * r['std_m']:7.1f} "
            f"{r['contradicted']:10.2%} {r['under_truth']:12.2%}    {said}{', as asked' if _as_asked(r) else ''}"
        )
    for name, keep in (("right", [r for r in rows if not r["wrong"]]), ("wrong", [r for r in rows if r["wrong"]])):
        said, before = sum(bool(r["sure"]) for r in keep), sum(bool(r["without_guard"]) for r in keep)
        print(f"{name}: {len(keep)}, said to be sure {said}, without the guard {before}")
    for every, limit in ASKED_CLOUD_M.items():
        own = [r for r in rows if r["every"] == every and r["sure"]]
        near = sum(float(r["cloud_m"]) <= limit for r in own)
        print(f"every {every}: sure {len(own)}, of these cloud within {1e3 * limit:.0f} mm {near}, all as asked {sum(map(_as_asked, own))}")
    print(f"cpu s, mean {np.mean([r['cpu_s'] for r in rows]):.0f}; under the truth contradicted at most {max(r['under_truth'] for r in rows):.2%}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=48)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--state", type=Path, default=Path("odometry.jsonl"))
    asked = parser.parse_args()
    rows = [json.loads(line) for line in asked.state.read_text().splitlines()] if asked.state.exists() else []
    left = [case for case in range(asked.cases) if case not in {row["case"] for row in rows}]
    with ProcessPoolExecutor(asked.jobs) as pool, asked.state.open("a") as kept:
        for done in as_completed([pool.submit(measured, case) for case in left]):
            rows.append(done.result())
            kept.write(json.dumps(rows[-1]) + "\n")
            kept.flush()
    if rows:
        table(rows)


if __name__ == "__main__":
    main()
