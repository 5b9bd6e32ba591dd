"""Runs the objects in child processes, a few at a time, with a time limit each; collects what they say and what they made."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import psutil

from scan2fea.io.files import write_bytes
from scan2fea.pipeline.record import ENDED, RESULT, Ended, Say
from scan2fea.units import BYTES_PER_GIB

PERIOD_S = 0.2
AFTER_SECONDS, AFTER_GIB = 120.0, 1.0  # for writing down what a stopped process had made: read back, measured, written
KILLED = 9  # SIGKILL
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a child may use."""

    seconds: float
    gib: float


def run_children(folders: Sequence[Path], jobs: int, limits: Limits, say: Say, done: Callable[[Path, str], None]) -> None:
    """One worker per folder, at most `jobs` at once. `done(folder, why)` is called as each ends, under a lock.

    A worker that is stopped or dies has a second one after it, which writes down what the first had made; `why` is "" where either of them
    left a result behind, else the reason why there is none.
    """
    lock, closing = threading.Lock(), threading.Event()

    def one(folder: Path) -> None:
        ended = _run_child([str(folder)], limits, lambda event: _locked(lock, say, event), closing)
        if closing.is_set():
            return
        if ended is not None and not (folder / RESULT).exists():
            write_bytes(folder / ENDED, json.dumps(asdict(ended)).encode())
            _run_child([str(folder), "ended"], Limits(seconds=AFTER_SECONDS, gib=max(AFTER_GIB, limits.gib)), lambda _: None, closing)
        with lock:
            done(folder, "" if ended is None or (folder / RESULT).exists() else ended.why)

    with ThreadPoolExecutor(max(1, jobs)) as pool:
        futures = [pool.submit(one, folder) for folder in folders]
        try:
            for future in futures:
                future.result()
        except BaseException:  # Ctrl-C too: nothing is begun any more, and what runs is stopped
            closing.set()
            pool.shutdown(cancel_futures=True)
            raise


def _locked(lock: threading.Lock, say: Say, event: Mapping[str, Any]) -> None:
    with lock:
        say(event)


class _Heard:
    """What a child said: the stage it is in, and those it ended."""

    def __init__(self, say: Say) -> None:
        self._say = say
        self.stage, self.last, self.stages = "", "", []  # type: tuple[str, str, list[Mapping[str, Any]]]

    def line(self, text: str) -> None:
        if not (text.startswith("{") and text.endswith("}\n")):  # a library's own words, or the half line of a child that was killed
            return
        event = json.loads(text)
        if event["event"] == "begin":
            self.stage = event["name"]
        elif event["event"] == "end":
            self.stage, self.last = "", event["name"]
            self.stages.append(event)
        self._say(event)

    @property
    def where(self) -> str:
        return f"in its stage {self.stage!r}" if self.stage else f"after its stage {self.last!r}" if self.last else "before its first stage"


def _run_child(arguments: Sequence[str], limits: Limits, say: Say, closing: threading.Event) -> Ended | None:
    """None where the worker ended well. Nothing that it started outlives it. `closing` stops it."""
    command = [sys.executable, "-m", "scan2fea.pipeline.worker", *arguments]
    heard = _Heard(say)
    with tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, text=True, encoding="utf-8",
            env={**os.environ, **ONE_THREAD}, start_new_session=True,  # Ctrl-C is for us alone: we end the children
        )  # fmt: skip
        family: set[psutil.Process] = set()
        stopped: list[str] = []
        watch = threading.Thread(target=_watch, args=(child, limits, family, stopped, closing), daemon=True)
        watch.start()
        try:
            for line in child.stdout or ():
                heard.line(line)
            child.wait()
        finally:
            child.kill()
            watch.join()
            _kill(child, family)
        if child.returncode == 0:
            return None
        errors.seek(0)
        why = stopped[0].format(where=heard.where) if stopped else _death(child.returncode, heard.where, errors.read().decode(errors="replace"))
        return Ended(why=why, stage=heard.stage, stages=tuple(heard.stages))


def _death(code: int, where: str, told: str) -> str:
    """A process that ended by itself, in words."""
    if code == -KILLED:
        return f"its process was killed {where}: most often the system ran out of memory; lower run.jobs or give fewer points, then --resume"
    lines = told.strip().splitlines()
    how = f"signal {-code}" if code < 0 else f"code {code}"
    return f"its process died {where} ({how}: {lines[-1] if lines else 'no message'}); please report it"


def _watch(child: subprocess.Popen[str], limits: Limits, family: set[psutil.Process], stopped: list[str], closing: threading.Event) -> None:
    """Kills the child at its limits; `family` receives every process it starts, `stopped` why it was killed."""
    until = time.monotonic() + limits.seconds
    while child.poll() is None:
        _meet(child, family)
        if closing.is_set():
            stopped.append("interrupted {where}")
        elif time.monotonic() > until:
            stopped.append(f"stopped after {limits.seconds:g} s {{where}}: raise run.object_seconds or give fewer points")
        elif _resident(family) > limits.gib * BYTES_PER_GIB:
            stopped.append(f"stopped at more than {limits.gib:g} GiB {{where}}: raise run.object_gib or give fewer points")
        if stopped:
            _kill(child, family)
            return
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(PERIOD_S)


def _resident(family: Iterable[psutil.Process]) -> int:
    total = 0
    for process in family:
        with contextlib.suppress(psutil.Error):  # it has ended
            total += process.memory_info().rss
    return total


def _meet(child: subprocess.Popen[str], family: set[psutil.Process]) -> None:
    """Enter the child and what it has started by now: once it has died nobody knows any more whose they were."""
    with contextlib.suppress(psutil.Error):
        process = psutil.Process(child.pid)
        family.update([process, *process.children(recursive=True)])


def _kill(child: subprocess.Popen[str], family: set[psutil.Process]) -> None:
    """The child first, so that it starts no more; psutil never kills a process that only inherited a number."""
    _meet(child, family)
    child.kill()
    for process in list(family):
        with contextlib.suppress(psutil.Error):
            process.kill()
