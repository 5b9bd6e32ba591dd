"""`scan2fea fuse`: logs of motion sensors to one trajectory. Exit 0 where there is one."""

from __future__ import annotations

import argparse
from pathlib import Path

from scan2fea.cli.progress import Progress
from scan2fea.cli.settings import config_of
from scan2fea.pipeline.fuse import fuse_files
from scan2fea.report.trajectory_picture import trajectory_picture


def execute(given: argparse.Namespace) -> int:
    out = Path(given.out)
    with Progress() as progress:
        report = fuse_files([Path(path) for path in given.inputs], out, config_of(given), trajectory_picture, progress)
    for row in report["inputs"]:
        print(f"  {Path(row['path']).name:<28} {row['kind']}: {row['n_rows']:,} rows, {row['from_s']:.3f} to {row['to_s']:.3f} s")
    way, found = report["trajectory"], report["fusion"]
    print(f"{way['n_poses']:,} poses by {report['method']}, {way['from_s']:.3f} to {way['to_s']:.3f} s", end="")
    if found["position"] == "estimated":
        print(f", {way['length_m']:.4g} m of way", end="")
    if "std_m" in way:
        std, turn = way["std_m"], way["std_rad"]
        print(f"; median std {std['x']:.3g}, {std['y']:.3g}, {std['z']:.3g} m and heading {turn['about_z'] * 57.29578:.2g} deg", end="")
    print()
    for name, row in found.get("measurements", {}).items():
        print(f"  {name}: {row['n'] - row['n_gated']} of {row['n']} used, scatter over stated {row['nis'] ** 0.5:.2f}")
    for text in report["warnings"]:
        print(f"  note: {text}")
    print(out / "trajectory.txt")
    return 0
