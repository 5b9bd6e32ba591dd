"""`scan2fea demo`: simulates the lab scan, writes the stations as a scanner would, and runs everything on the files."""

from __future__ import annotations

import argparse
from pathlib import Path

from scan2fea.cli.run_command import convert
from scan2fea.cli.settings import config_of
from scan2fea.io import write_scan_ply
from scan2fea.simulation import LabOptions, simulate_lab


def execute(given: argparse.Namespace) -> int:
    config = config_of(given)
    out = Path(given.out)
    scans = out.with_name(out.name + "-scans")
    lab = simulate_lab(LabOptions(seed=config.run.seed))
    files = []
    for number, scan in enumerate(lab.scans):
        files.append(scans / f"station{number:02d}.ply")
        write_scan_ply(files[-1], scan)
    return convert(files, out, config, resume=False, options_given=[])
