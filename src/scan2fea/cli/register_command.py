"""`scan2fea register`: scans into one frame. Exit 0 where at least one was placed."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from scan2fea.cli.settings import config_of
from scan2fea.pipeline.register import register_files
from scan2fea.units import MILLIMETRES_PER_METRE

SHOWN = 40  # rows of frames


def execute(given: argparse.Namespace) -> int:
    out = Path(given.out)
    report = register_files([Path(path) for path in given.inputs], out, config_of(given))
    frames, links = report["registration"]["frames"], report["registration"]["links"]
    for frame in frames[:SHOWN]:
        print(_line(frame))
    if len(frames) > SHOWN:
        print(f"  ... and {len(frames) - SHOWN} more, see report.json")
    used = sum(link["used"] for link in links)
    print(f"{sum(frame['placed'] for frame in frames)} of {len(frames)} inputs placed; {used} of {len(links)} links used")
    for text in report["warnings"]:
        print(f"  note: {text}")
    print(out / "cloud.ply")
    return 0


def _line(frame: dict[str, Any]) -> str:
    name = Path(frame["path"]).name
    if not frame["placed"]:
        return f"  {name:<28} left out: {frame['reason']}"
    at = ", ".join(f"{row[3]:.4f}" for row in frame["T_world_frame"][:3])
    sure = "" if frame["std_m"] is None else f", std {frame['std_m'] * MILLIMETRES_PER_METRE:.3g} mm, {frame['std_rad'] * 57.29578:.2g} deg"
    return f"  {name:<28} at ({at}) m{sure}"
