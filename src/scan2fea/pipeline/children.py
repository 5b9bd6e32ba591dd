"""Runs the objects in child processes, a few at a time, with limits each; collects what they say and what they made.

Each of the few is a worker (`pipeline.worker`) that has imported everything once and forks itself for each object: an object's process starts in
milliseconds and takes no other along when it dies.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Protocol, Self

import psutil

from scan2fea.io.files import write_bytes
from scan2fea.kernel.processes import PATIENCE, spent_by
from scan2fea.pipeline.record import ENDED, FORKS, LEFT, RESULT, Ended, Say
from scan2fea.units import BYTES_PER_GIB

PERIOD_S = 0.2
AHEAD = 2  # workers started before there are objects: each takes memory while it waits
AFTER_SECONDS, AFTER_GIB = 120.0, 1.0  # for writing down what a stopped process had made: read back, measured, written
KILLED = 9  # SIGKILL
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What an object may use: processor time and memory."""

    seconds: float
    gib: float


class Do(Protocol):
    """Does one object; None where it ended well."""

    def __call__(self, arguments: Sequence[str], limits: Limits, say: Say, closing: threading.Event, /) -> Ended | None: ...


class Workers:
    """The workers of a run, at most `jobs` (None: as many as there are cores) at once; leaving ends them."""

    def __init__(self, jobs: int | None) -> None:
        self.jobs = max(1, jobs or os.cpu_count() or 1)
        self._idle: deque[_Worker] = deque()
        self._context = contextlib.ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._context.close()

    def begin(self) -> None:
        """Start the first ones: they import while the scene is made ready."""
        for _ in range(min(self.jobs, AHEAD)):
            worker = self._new()
            worker.begin()
            self._idle.append(worker)

    def take(self) -> Do:
        """One for the caller's thread alone."""
        try:
            return self._idle.popleft()
        except IndexError:
            return self._new()

    def _new(self) -> _Worker:
        return self._context.enter_context(_Worker(self._context.enter_context(tempfile.TemporaryFile())))


def run_children(folders: Sequence[Path], workers: Workers, limits: Limits, say: Say, done: Callable[[Path, str], None]) -> None:
    """One worker per folder, as many at once as there may be. `done(folder, why)` is called as each ends, under a lock.

    A worker that is stopped or dies has a second one after it, which writes down what the first had made; `why` is "" where either of them
    left a result behind, else the reason why there is none.
    """
    lock, closing = threading.Lock(), threading.Event()
    waiting = deque(folders)

    def one(worker: Do, folder: Path) -> None:
        ended = worker([str(folder)], limits, lambda event: _locked(lock, say, event), closing)
        if closing.is_set():
            return
        if ended is None and not (folder / RESULT).exists():
            ended = Ended(why="its process ended without a result; please report it", stage="", stages=())
        if ended is not None and not (folder / RESULT).exists():
            write_bytes(folder / ENDED, json.dumps(asdict(ended)).encode())
            worker([str(folder), "ended"], Limits(seconds=AFTER_SECONDS, gib=max(AFTER_GIB, limits.gib)), lambda _: None, closing)
        with lock:
            done(folder, "" if ended is None or (folder / RESULT).exists() else ended.why)

    def work(worker: Do) -> None:
        while not closing.is_set():
            try:
                folder = waiting.popleft()
            except IndexError:
                return
            one(worker, folder)

    n = min(workers.jobs, len(folders))
    with ThreadPoolExecutor(max(1, n)) as pool:
        futures = [pool.submit(work, workers.take()) for _ in range(n)]
        try:
            for future in as_completed(futures):
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
        self.code: int | None = None  # how the object's process ended

    def line(self, text: str) -> None:
        if not (text.startswith("{") and text.endswith("}\n")):  # a library's own words, or the half line of a child that was killed
            return
        event = json.loads(text)
        if event["event"] == LEFT:
            self.code = int(event["code"])
            return
        if event["event"] == "begin":
            self.stage = event["name"]
        elif event["event"] == "end":
            self.stage, self.last = "", event["name"]
            self.stages.append(event)
        self._say(event)

    @property
    def where(self) -> str:
        return f"in its stage {self.stage!r}" if self.stage else f"after its stage {self.last!r}" if self.last else "before its first stage"


class _Worker:
    """A process that waits for objects. It is started for the first or before, and anew after it was killed; leaving ends it."""

    def __init__(self, errors: IO[bytes]) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._errors = errors

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._end()

    def begin(self) -> None:
        """Start the process, which imports what it needs."""
        self._started()

    def __call__(self, arguments: Sequence[str], limits: Limits, say: Say, closing: threading.Event) -> Ended | None:
        """Do one object; None where it ended well. Nothing that it started outlives it. `closing` stops it."""
        process, heard = self._started(), _Heard(say)
        words_from = self._errors.seek(0, os.SEEK_END)
        family: set[psutil.Process] = set()
        stopped: list[str] = []
        over = threading.Event()
        watch = threading.Thread(target=_watch, args=(process, limits, family, stopped, closing, over), daemon=True)
        watch.start()
        try:
            code = _asked(process, arguments, heard)
        except BaseException:
            self._end()
            raise
        finally:
            over.set()
            watch.join()
            _kill(process, family)
        if process.poll() is not None or not FORKS:
            self._end()
        if code == 0 and not stopped:
            return None
        self._errors.seek(words_from)
        told = self._errors.read().decode(errors="replace")
        why = stopped[0].format(where=heard.where) if stopped else _death(code, heard.where, told)
        return Ended(why=why, stage=heard.stage, stages=tuple(heard.stages))

    def _started(self) -> subprocess.Popen[str]:
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "scan2fea.pipeline.worker"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, text=True,
                encoding="utf-8", env={**os.environ, **ONE_THREAD}, start_new_session=True,  # Ctrl-C is for us alone: we end the children
            )  # fmt: skip
        return self._process

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                with contextlib.suppress(OSError):  # what was not read by a worker that died
                    if pipe is not None:
                        pipe.close()


def _asked(process: subprocess.Popen[str], arguments: Sequence[str], heard: _Heard) -> int:
    """Exit code of the object's process, or of the worker where that died first."""
    with contextlib.suppress(BrokenPipeError):  # it is dead: its code says how
        if process.stdin is not None:
            process.stdin.write(json.dumps(list(arguments)) + "\n")
            process.stdin.flush()
    for line in process.stdout or ():
        heard.line(line)
        if heard.code is not None:
            return heard.code
    return process.wait()


def _death(code: int, where: str, told: str) -> str:
    """A process that ended by itself, in words."""
    if code == -KILLED:
        return f"its process was killed {where}: most often the system ran out of memory; lower run.jobs or give fewer points, then --resume"
    lines = told.strip().splitlines()
    how = f"signal {-code}" if code < 0 else f"code {code}"
    return f"its process died {where} ({how}: {lines[-1] if lines else 'no message'}); please report it"


def _watch(
    worker: subprocess.Popen[str], limits: Limits, family: set[psutil.Process], stopped: list[str], closing: threading.Event, over: threading.Event
) -> None:
    """Kills the worker and all it started at the limits of its object; `family` receives what it starts, `stopped` why it was killed."""
    until = time.monotonic() + PATIENCE * limits.seconds
    while worker.poll() is None and not over.is_set():
        _meet(worker, family)
        if closing.is_set():
            stopped.append("interrupted {where}")
        elif spent_by(family) > limits.seconds or time.monotonic() > until:
            stopped.append(f"stopped after {limits.seconds:g} s of processor time {{where}}: raise run.object_seconds or give fewer points")
        elif _resident(family) > limits.gib * BYTES_PER_GIB:
            stopped.append(f"stopped at more than {limits.gib:g} GiB {{where}}: raise run.object_gib or give fewer points")
        if stopped:
            worker.kill()
            _kill(worker, family)
            return
        over.wait(PERIOD_S)


def _resident(family: Iterable[psutil.Process]) -> int:
    total = 0
    for process in family:
        with contextlib.suppress(psutil.Error):  # it has ended
            total += process.memory_info().rss
    return total


def _meet(worker: subprocess.Popen[str], family: set[psutil.Process]) -> None:
    """Enter what the worker has started by now: once it has died nobody knows any more whose they were."""
    with contextlib.suppress(psutil.Error):
        family.update(psutil.Process(worker.pid).children(recursive=True))


def _kill(worker: subprocess.Popen[str], family: set[psutil.Process]) -> None:
    """What the worker started; psutil never kills a process that only inherited a number."""
    _meet(worker, family)
    for process in list(family):
        with contextlib.suppress(psutil.Error):
            process.kill()
