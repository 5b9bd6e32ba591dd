"""Do the error bars of a member's response hold the truth? Points of known members, fitted, and the beam model with the covariance of the fit.

    python benchmarks/response_bars.py [--seeds N] [--jobs N] [--only NAME] [--state FILE]

Each run (cell, seed) is one line of the state file (JSON); a second call goes on where the first stopped and prints the table. Truth is the same beam
model with the true dimensions; a bar is value +- 1.96 std. Figures whose bar is nothing are counted apart: dimensions of a catalogue have none.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np

from scan2fea.errors import Scan2FeaError
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.fea.budget import beam_response, budget
from scan2fea.fea.materials import chosen_material
from scan2fea.fea.options import FeaOptions
from scan2fea.fea.section_properties import properties_of
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.kernel.transforms import random_rotation
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan
from scan2fea.verification.member import member_checks

FORCE_N = 100.0
N_POINTS = 8_000
BODIES = {
    "L": {"a": 0.127, "b": 0.09, "t": 0.0083, "length": 1.8},
    "I": {"h": 0.193, "b": 0.097, "tw": 0.0061, "tf": 0.0089, "length": 1.8},
    "C": {"h": 0.163, "b": 0.067, "tw": 0.0077, "tf": 0.0109, "length": 1.5},
    "T": {"h": 0.103, "b": 0.097, "tw": 0.0113, "tf": 0.0107, "length": 1.2},
    "RHS": {"h": 0.147, "b": 0.097, "t": 0.0083, "length": 1.6},
    "CHS": {"d": 0.1663, "t": 0.0103, "length": 1.6},
    "rect": {"b": 0.117, "t": 0.0213, "length": 1.2},
    "round": {"d": 0.0617, "length": 0.9},
}
FIGURES = ("mass_kg", "tension", "bend_x_x", "bend_y_y", "twist", "buckling_n", "f1_hz", "f2_hz", "f3_hz")
# noise, m; share of points anywhere; both end faces seen
SCANS = {"0.5 mm": (0.0005, 0.0), "2 mm": (0.002, 0.0), "0.5 mm, 15 % clutter": (0.0005, 0.15)}


def run(family: str, scan: str, seed: int) -> dict:
    """One fitted scan: of each figure value, standard deviation, truth."""
    noise, clutter = SCANS[scan]
    true = BODIES[family]
    options = MemberScanOptions(noise_m=noise, clutter=clutter, caps=True, seed=seed)
    points = member_points(family, true, N_POINTS, options) @ random_rotation(np.random.default_rng([seed, 1])).T
    row = {"family": family, "scan": scan, "seed": seed}
    began = time.process_time()
    try:
        found = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions())
    except Scan2FeaError as error:
        return {**row, "error": str(error), "cpu_s": time.process_time() - began}
    member = found.member
    row["found"] = member.family
    row["built"] = all(check.passed for check in member_checks(member, found.explains))
    if member.family == family:
        material = chosen_material(FeaOptions())
        bars = budget(member, material, FORCE_N, 0.0, FeaOptions().n_samples, 0)
        p = properties_of(family, {name: true[name] for name in PARAMETERS[family]})
        truth = beam_response(p, material, true["length"], FORCE_N)
        row["figures"] = {name: (bars.value[name], bars.std[name], truth[name]) for name in FIGURES}
        row["assumed"] = list(bars.assumed)
    return {**row, "cpu_s": time.process_time() - began}


def table(rows: list[dict]) -> None:
    print("| member | scan | seeds, fitted and built | held by 1.96 std, all figures | of each figure | median relative std of bending | CPU s |")
    print("|---|---|---|---|---|---|---|")
    cells = defaultdict(list)
    for row in rows:
        cells[row["family"], row["scan"]].append(row)
    every = []
    for (family, scan), own in sorted(cells.items()):
        good = [r["figures"] for r in own if "figures" in r and r["built"]]
        z = {name: np.array([(f[name][0] - f[name][2]) / f[name][1] for f in good if f[name][1] > 0]) for name in FIGURES}
        pooled = np.concatenate([np.zeros(0), *z.values()])
        every.append(pooled)
        each = ", ".join(f"{name} {np.mean(np.abs(v) < 1.96):.2f}" for name, v in z.items() if len(v))
        bend = np.median([f["bend_y_y"][1] / abs(f["bend_y_y"][0]) for f in good]) if good else float("nan")
        held = f"{np.mean(np.abs(pooled) < 1.96):.3f} of {len(pooled)}" if len(pooled) else "-"
        print(f"| {family} | {scan} | {len(own)}, {len(good)} | {held} | {each} | {bend:.2%} | {np.mean([r['cpu_s'] for r in own]):.1f} |")
    z = np.concatenate([np.zeros(0), *every])
    if len(z):
        print(f"all: {np.mean(np.abs(z) < 1.96):.3f} within 1.96, {np.mean(np.abs(z) < 1):.3f} within 1, worst {np.abs(z).max():.1f}, of {len(z)}")


def main() -> None:
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--seeds", type=int, default=100)
    ask.add_argument("--jobs", type=int, default=1)
    ask.add_argument("--only", default="", help="cells whose 'family scan' holds this")
    ask.add_argument("--state", type=Path, default=Path("response_bars.jsonl"))
    args = ask.parse_args()
    rows = [json.loads(line) for line in args.state.read_text().splitlines()] if args.state.exists() else []
    done = {(r["family"], r["scan"], r["seed"]) for r in rows}
    cells = [(f, s) for s in SCANS for f in BODIES if args.only in f"{f} {s}"]
    wanted = [(f, s, seed) for seed in range(args.seeds) for f, s in cells if (f, s, seed) not in done]
    with ProcessPoolExecutor(args.jobs) as pool, args.state.open("a") as state:
        for job in as_completed([pool.submit(run, *one) for one in wanted]):
            rows.append(job.result())
            state.write(json.dumps(rows[-1]) + "\n")
            state.flush()
    table([r for r in rows if (r["family"], r["scan"]) in cells])


if __name__ == "__main__":
    main()
