"""Many independent cases of a benchmark in several processes, one line of JSON for each, so that a run that was cut off goes on where it stopped."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def rows(of: Callable[..., Row], cases: Sequence[tuple[Any, ...]], jobs: int = 1, state: Path | None = None) -> Iterator[Row]:
    """The row of each case (its arguments), as they are done; those found in `state` first, and not made again. A row holds its `case`."""
    done: dict[str, Row] = {}
    if state and state.exists():
        done = {json.dumps(row["case"]): row for row in map(json.loads, state.read_text().splitlines())}
    left = []
    for case in cases:
        known = done.get(json.dumps(list(case)))
        if known:
            yield known
        else:
            left.append(case)
    for row in _made(of, left, jobs):
        if state:
            with state.open("a") as file:
                file.write(json.dumps(row) + "\n")
        yield row


def _made(of: Callable[..., Row], cases: Sequence[tuple[Any, ...]], jobs: int) -> Iterator[Row]:
    if jobs <= 1:
        yield from ({"case": list(case), **of(*case)} for case in cases)
        return
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        asked = {pool.submit(of, *case): case for case in cases}
        for one in as_completed(asked):
            yield {"case": list(asked[one]), **one.result()}
