"""`scan2fea segment`: one label per point of a scene. Exit 0 where at least one segment was found, 4 where none was."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from scan2fea.cli.settings import config_of
from scan2fea.pipeline.segment import segment_files
from scan2fea.report.segments_picture import segments_picture

SHOWN = 30  # rows of segments
NOTHING_FOUND = 4


def execute(given: argparse.Namespace) -> int:
    out = Path(given.out)
    report = segment_files([Path(path) for path in given.inputs], out, config_of(given), segments_picture)
    segments = report["segments"]
    for row in segments[:SHOWN]:
        print(_line(row))
    if len(segments) > SHOWN:
        print(f"  ... and {len(segments) - SHOWN} more, see report.json")
    method, unlabelled = report["segmentation"]["method"], report["n_unlabelled"]
    print(f"{len(segments)} segments of {report['n_points']:,} points by {method}; {unlabelled:,} points in none")
    if "agreement" in report:
        told = report["agreement"]
        names = {"adjusted_rand": "adjusted Rand", "mean_iou": "mean IoU", "f1": "F1 at IoU 0.5"}
        print("against the labels of the file: " + ", ".join(f"{text} {told[name]:.3f}" for name, text in names.items()))
    for text in report["warnings"]:
        print(f"  note: {text}")
    print(out / "cloud.ply")
    return 0 if segments else NOTHING_FOUND


def _line(row: dict[str, Any]) -> str:
    size = " x ".join(f"{length:.3g}" for length in row["size_m"])
    sure = "" if row["confidence"] is None else f" {row['confidence']:.0%}"
    return f"  {row['label']:>3}  {row['role']:<8} {row['kind'] + sure:<14} {row['n_points']:>9,} points, {size} m; {row['why']}"
