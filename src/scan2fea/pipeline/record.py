"""Every stage call goes through a Record: it times and counts it, writes the log, and keeps the result so that `--resume` need not repeat it.

A value is known by the key of how it was made: the hash of the program, the stage, its options and the keys of what went in. The same key
means the same bytes, so a kept result is as good as a new one.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, is_dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Generic, TypeVar

import scan2fea
from scan2fea.errors import Scan2FeaError, StageError
from scan2fea.io.artifacts import load, save
from scan2fea.pipeline.config import as_tree
from scan2fea.pipeline.memory import PeakMemory

T = TypeVar("T")
Say = Callable[[Mapping[str, Any]], None]  # receives each event: the CLI's progress, a child's pipe, or nothing

KEEP = ".scan2fea"  # folder inside OUT for what --resume reads
RESULT, ENDED = "result.json", "ended.json"  # of each object in there: its row and stages; how its process ended before its time
FORKS = hasattr(os, "fork")  # else each object has a worker of its own
OURS = (".py", ".toml", ".csv", ".npz")
LIBRARIES = ("numpy", "scipy", "numba", "PyMaxflow", "gmsh", "cadquery-ocp-novtk", "pytetwild", "pyamg", "opencv-python-headless", "pycolmap")
LEFT = "left"  # event: an object's process has ended, with its exit code


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a process that was to make an object ended before its time. stage : that it was in, "" between two.   stages : events of those it ended."""

    why: str
    stage: str
    stages: tuple[Mapping[str, Any], ...]


@dataclass(frozen=True)
class Tracked(Generic[T]):
    """A value and the key of how it was made."""

    value: T
    key: str


@functools.cache
def program() -> str:
    """Hash of our own files and of the versions of the libraries that results depend on: what another program made is made again."""
    root = Path(scan2fea.__file__).parent
    digest = hashlib.sha256(scan2fea.__version__.encode())
    for path in sorted(p for p in root.rglob("*") if p.suffix in OURS):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    for name in LIBRARIES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            digest.update(f"{name} {metadata.version(name)}\0".encode())
    return digest.hexdigest()


def key_of(*parts: Any) -> str:
    """sha256 over JSON-able parts and the program."""
    text = json.dumps([program(), *parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


class Record:
    """The log of one run (or of one object in its child process)."""

    def __init__(self, folder: Path, *, resume: bool = False, say: Say | None = None, label: str = "", ended: Ended | None = None) -> None:
        """`ended`: nothing is made any more; a stage whose result was not kept raises StageError with `ended.why`, and `lacks` names it."""
        self.folder = folder
        self.resume = resume or ended is not None
        self.label = label
        self.lacks = ""
        self._ended = ended
        self.stages: list[dict[str, Any]] = []
        self._say: Say = say or (lambda _: None)
        folder.mkdir(parents=True, exist_ok=True)

    def __call__(
        self,
        name: str,
        verb: Callable[..., T],
        *data: Tracked[Any],
        options: Any = None,
        n_in: int = 0,
        count: Callable[[T], int] = lambda _: 1,
        extra: Mapping[str, Any] | None = None,
        keep: bool = True,
    ) -> Tracked[T]:
        """Run `verb(*values, options?, **extra)` as stage `name`; with `resume` take the kept result where its key is the same.

        `extra` holds further keyword arguments (plain values, part of the key). `keep=False`: too cheap or too big to keep.
        """
        tree = as_tree(options) if is_dataclass(options) else {}
        key = key_of(name, tree, dict(extra or {}), [d.key for d in data])
        path = self.folder / f"{name.replace(' ', '_')}-{key[:20]}.npz"
        self.event("begin", name=name)
        started = time.perf_counter()
        with PeakMemory() as peak:
            result = self._kept(path) if self.resume and keep else None
            kept = result is not None
            if result is None:
                self._may_make(name, keep)
                positional = [d.value for d in data] + ([options] if options is not None else [])
                result = verb(*positional, **dict(extra or {}))
                if keep:
                    save(result, path)
        self.add(name, time.perf_counter() - started, peak.mb, n_in, count(result), tree, kept=kept)
        return Tracked(result, key)

    def add(self, name: str, seconds: float, peak_mb: float, n_in: int, n_out: int, options: Mapping[str, Any], *, kept: bool = False) -> None:
        """Enter a finished stage."""
        row = {
            "name": name,
            "object": self.label or None,
            "seconds": round(seconds, 3),
            "peak_mb": round(peak_mb, 1),
            "n_in": int(n_in),
            "n_out": int(n_out),
        }
        self.stages.append({**row, "options": dict(options)})
        self.event("end", **row, kept=kept)

    def _may_make(self, name: str, keep: bool) -> None:
        """Raises StageError after an early end, but for what is too cheap to keep and was not what the process ended in."""
        if self._ended is not None and (keep or self._ended.stage == name):
            self.lacks = self.lacks or name
            raise StageError(self._ended.why)

    def event(self, what: str, **data: Any) -> None:
        self._say({"event": what, "object": self.label or None, **data})

    def _kept(self, path: Path) -> Any:
        # a file cut short by an interruption, or of another version, is made again
        if path.exists():
            with contextlib.suppress(Scan2FeaError, OSError, ValueError, KeyError):
                return load(path)
        return None
