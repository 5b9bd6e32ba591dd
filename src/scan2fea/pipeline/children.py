"""Runs the objects in child processes, a few at a time, with a time limit each; collects what they say and what they made."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from scan2fea.pipeline.record import Say
from scan2fea.units import BYTES_PER_GIB

PERIOD_S = 0.2
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a child may use."""

    seconds: float
    gib: float


def run_children(folders: Sequence[Path], jobs: int, limits: Limits, say: Say, done: Callable[[Path, str], None]) -> None:
    """One worker per folder, at most `jobs` at once. `done(folder, why)` is called as each ends; `why` is empty where it went well."""
    lock = threading.Lock()

    def one(folder: Path) -> None:
        why = _run_child(folder, limits, lambda event: _locked(lock, say, event))
        with lock:
            done(folder, why)

    with ThreadPoolExecutor(max(1, jobs)) as pool:
        for future in [pool.submit(one, folder) for folder in folders]:
            future.result()


def _locked(lock: threading.Lock, say: Say, event: Mapping[str, Any]) -> None:
    with lock:
        say(event)


def _run_child(folder: Path, limits: Limits, say: Say) -> str:
    command = [sys.executable, "-m", "scan2fea.pipeline.worker", str(folder)]
    with tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, text=True, encoding="utf-8", env={**os.environ, **ONE_THREAD}
        )
        stopped: list[str] = []
        watch = threading.Thread(target=_watch, args=(child, limits, stopped), daemon=True)
        watch.start()
        try:
            for line in child.stdout or ():
                if line.startswith("{"):
                    say(json.loads(line))
            child.wait()
        except BaseException:
            _kill(child.pid)
            raise
        watch.join()
        if stopped:
            return stopped[0]
        if child.returncode:
            errors.seek(0)
            tail = errors.read().decode(errors="replace").strip().splitlines()
            return f"its process ended with code {child.returncode}: {tail[-1] if tail else 'no message'}"
    return ""


def _watch(child: subprocess.Popen[str], limits: Limits, stopped: list[str]) -> None:
    left = limits.seconds
    while child.poll() is None:
        try:
            child.wait(PERIOD_S)
        except subprocess.TimeoutExpired:
            left -= PERIOD_S
        if left <= 0:
            stopped.append(f"stopped after {limits.seconds:.0f} s; raise run.object_seconds or give fewer points")
        elif _resident(child.pid) > limits.gib * BYTES_PER_GIB:
            stopped.append(f"stopped: it needed more than {limits.gib:g} GiB; raise run.object_gib or give fewer points")
        if stopped:
            _kill(child.pid)
            return


def _family(pid: int) -> list[psutil.Process]:
    try:
        process = psutil.Process(pid)
        return [process, *process.children(recursive=True)]
    except psutil.Error:
        return []


def _resident(pid: int) -> int:
    total = 0
    for process in _family(pid):
        try:
            total += process.memory_info().rss
        except psutil.Error:
            continue
    return total


def _kill(pid: int) -> None:
    for process in reversed(_family(pid)):
        try:
            process.kill()
        except psutil.Error:
            continue
