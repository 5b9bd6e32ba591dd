"""`scan2fea thesis`: the source thesis's tables and figures, made by our code."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scan2fea.errors import InputError, require
from scan2fea.thesis import ThesisOptions, run_thesis


def execute(given: argparse.Namespace) -> int:
    real = Path(given.real) if given.real else None
    require(real is None or real.is_file(), InputError, f"{given.real}: no such file; --real takes a capture of an HDL-32E (.pcap)")
    options = ThesisOptions(quick=given.quick, clock_s=given.clock, real=real, seed=given.seed)
    out = Path(given.out)
    made = run_thesis(out, options, given.only, _progress(), given.jobs or os.cpu_count() or 1)
    failed = [name for name, item in made.items() if item.failed]
    missing = f"; not made: {', '.join(failed)}" if failed else ""
    print(f"{len(made) - len(failed)} of {len(made)} experiments made{missing}; {out / 'thesis.html'}")
    return 4 if len(failed) == len(made) else 0


def _progress() -> Any:
    began = time.perf_counter()

    def say(event: Mapping[str, Any]) -> None:
        clock = f"[{time.perf_counter() - began:6.1f} s] "
        if event["event"] == "begin":
            print(f"{clock}{event['number']}/{event['of']} {event['id']} {event['title']} ...", file=sys.stderr, flush=True)
        elif event["event"] == "chore":
            print(f"{clock}prepared {event['number']}/{event['of']}: {event['id']}", file=sys.stderr, flush=True)
        elif event["failed"]:
            print(f"{clock}{event['id']} not made: {event['failed']}", file=sys.stderr, flush=True)
        else:
            done = "unchanged" if event["kept"] else f"{event['seconds']:.1f} s"
            print(f"{clock}{event['id']} {done}", file=sys.stderr, flush=True)

    return say
