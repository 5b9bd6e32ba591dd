"""`scan2fea train [LABELLED...] -o WEIGHTS.npz`: teaches the forest of points and the network of kinds; prints how they do on what is new."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from scan2fea.cli.settings import config_of
from scan2fea.pipeline.train import TrainOptions, train


def execute(given: argparse.Namespace) -> int:
    names = tuple(name.strip() for name in given.names.split(",")) if given.names else ()
    config = config_of(given)
    options = TrainOptions(objects=given.objects, rooms=given.rooms, epochs=given.epochs, seed=config.run.seed, names=names, base=given.base)
    report = train([Path(path) for path in given.inputs], Path(given.out), options, config.input, lambda text: print(text, file=sys.stderr))
    if "points" in report:
        print("\n".join(_points(report["points"])))
    if "objects" in report:
        print("\n".join(_objects(report["objects"])))
    print(given.out)
    return 0


def _points(found: dict[str, Any]) -> list[str]:
    told = ", ".join(f"{name} {'-' if value is None else f'{value:.3f}'}" for name, value in found["iou"].items())
    return [f"classes of points: {found['accuracy']:.3f} of {found['n_tested']:,} points right that it had not seen; IoU: {told}"]


def _objects(found: dict[str, Any]) -> list[str]:
    head = f"kinds of objects: {found['accuracy']:.3f} of {found['n_tested']:,} right that it had not seen"
    named = f"{found['accuracy_named'] or 0:.3f} of those named, {found['unknown']:.1%} unknown"
    lines = [f"{head}; {named}; calibration error {found['calibration_error']:.3f}"]
    for row in found["reliability"]:
        if row["n"]:
            lines.append(f"  says {row['confidence']:.3f}: right {row['accuracy']:.3f} ({row['n']})")
    return lines
