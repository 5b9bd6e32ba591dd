"""Limits on processor time: what a busy machine does slowly is not stopped for that, and ends as on an idle one."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import psutil

PATIENCE = 4.0  # seconds of wall clock per second of processor time allowed: what waits for nothing ends too
_PERIOD_S = 0.2


def spent_s() -> float:
    """Processor time of this process and of those it started that have ended, s."""
    return sum(os.times()[:4])


def spent_by(processes: Iterable[psutil.Process]) -> float:
    """Processor time of these processes and of those each has started and seen end, s; of one that has ended itself nothing is known any more."""
    total = 0.0
    for process in processes:
        with contextlib.suppress(psutil.Error):
            times = process.cpu_times()
            total += times.user + times.system + getattr(times, "children_user", 0.0) + getattr(times, "children_system", 0.0)
    return total


def run_limited(command: Sequence[str], seconds: float, *, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command to its end, on one thread and with our modules in its path.

    Raises subprocess.TimeoutExpired, and has killed it, where it uses more than `seconds` of processor time or `PATIENCE` times as much wall clock.
    """
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    until = time.monotonic() + PATIENCE * seconds
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace", env=environment, cwd=folder
    ) as child:
        try:
            known = psutil.Process(child.pid)
            while True:
                try:
                    out, errors = child.communicate(timeout=_PERIOD_S)
                except subprocess.TimeoutExpired:
                    if spent_by([known]) > seconds or time.monotonic() > until:
                        raise subprocess.TimeoutExpired(command, seconds) from None
                else:
                    return subprocess.CompletedProcess(command, child.returncode, out, errors)
        finally:
            child.kill()
