"""Runs of a benchmark in processes of their own, each written down as it ends: a run that is cut off goes on where it stopped."""

from __future__ import annotations

import json
import multiprocessing
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path


def read_state(path: Path) -> dict[str, list[dict]]:
    """Cell -> its runs so far."""
    rows: dict[str, list[dict]] = defaultdict(list)
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            one = json.loads(line)
            rows[one.pop("cell")].append(one)
    return rows


def ordered(wanted: dict[str, int], cost: Callable[[str], float], rows: dict[str, list[dict]]) -> list[tuple[str, int]]:
    """(cell, seed) still to run: every cell gets the same part of its seeds before any gets more, cheap cells first."""
    done = {(name, row["seed"]) for name, own in rows.items() for row in own}
    todo = [(name, seed) for name, n in wanted.items() for seed in range(n) if (name, seed) not in done]
    return sorted(todo, key=lambda one: (one[1] / wanted[one[0]], cost(one[0])))


def run_all(
    todo: list[tuple[str, int]], run: Callable[[tuple[str, int]], dict], state: Path, *, jobs: int = 1, seconds: float = float("inf")
) -> None:
    """Each of `todo` once. The first runs here, so that what is compiled is compiled once.   seconds : wall time after the first at which it ends."""

    def note(row: dict) -> None:
        with state.open("a", encoding="utf-8") as out:
            out.write(json.dumps(row) + "\n")

    if not todo:
        return
    note(run(todo[0]))
    until = time.monotonic() + seconds
    if jobs == 1:
        for one in todo[1:]:
            if time.monotonic() > until:
                return
            note(run(one))
        return
    with multiprocessing.get_context("fork").Pool(jobs) as pool:
        for row in pool.imap_unordered(run, todo[1:]):
            note(row)
            if time.monotonic() > until:
                pool.terminate()
                return

