"""`scan2fea run`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from scan2fea.cli.progress import Progress
from scan2fea.cli.settings import config_of
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.run import run
from scan2fea.report.html import write_report
from scan2fea.report.summary import summary_lines

NOTHING_CONVERTED = 4
USAGE = 2


def execute(given: argparse.Namespace) -> int:
    return convert([Path(path) for path in given.inputs], Path(given.out), config_of(given), resume=given.resume, options_given=_spoken(given))


def convert(inputs: list[Path], out: Path, config: Config, *, resume: bool, options_given: list[str]) -> int:
    """Run the chain, write the report, and print one line per object and the path of the report."""
    command = ["scan2fea", "run", *map(str, inputs), "-o", "OUT", *options_given]
    with Progress() as progress:
        report = run(inputs, out, config, resume=resume, say=progress, command=command)
    page = write_report(out)
    for line in summary_lines(report):
        print(line)
    print(page)
    for text in report["asked_in_vain"]:
        print(f"asked in vain: {text}", file=sys.stderr)
    if report["asked_in_vain"]:
        return USAGE
    return 0 if any(o["verdict"] == "converted" for o in report["objects"]) else NOTHING_CONVERTED


def _spoken(given: argparse.Namespace) -> list[str]:
    """The options as the user gave them, for "how to repeat"."""
    words: list[Any] = ["-c", given.config] if given.config else []
    for text in given.settings:
        words += ["--set", text]
    for name in ("seed", "unit", "poses", "calibration", "labels", "imu", "gps", "sensor", "scale", "known_length"):
        if getattr(given, name, None) is not None:
            words += [f"--{name.replace('_', '-')}", getattr(given, name)]
    if getattr(given, "sensor_position", None) is not None:
        words += ["--sensor-position", *given.sensor_position]
    return [str(word) for word in words]
