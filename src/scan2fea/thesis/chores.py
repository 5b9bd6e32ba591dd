"""What takes long, and what several experiments share: made beforehand by several processes at once, and kept.

A chore is a tuple of words, its kind first; `needs` of an experiment lists its own. An experiment makes for itself what no chore has made, so that
chores change how long a run takes and nothing else.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from multiprocessing import get_context
from typing import Any, TypeVar

from scan2fea.errors import Scan2FeaError, StageError
from scan2fea.thesis import hypotheses, unposed
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.best import best
from scan2fea.thesis.clouds import beam_points, hdl_scans, lab_scan, treated
from scan2fea.thesis.experiment import Chore
from scan2fea.thesis.meshes import first_mesh, normals_of, steps

T = TypeVar("T")

# kind: what makes it; in the order in which they may lean on each other
KINDS: Mapping[str, Callable[..., object]] = {
    "lab": lambda bench, *_: lab_scan(bench),
    "hdl": lambda bench, every: hdl_scans(bench, int(every)),
    "treated": treated,
    "unposed": lambda bench, every: unposed.way(bench, int(every)),
    "normals": lambda bench, case: normals_of(bench, case),
    "beam": beam_points,
    "best": best,
    "held": lambda bench, case, mesh: steps(bench, case, mesh, held=True),
    "chain": steps,
    "first": first_mesh,
    "isolation": lambda bench, noise_mm: hypotheses.isolated(bench, float(noise_mm)),
    "trial": lambda bench, kind, noise_mm, column: hypotheses.trials(bench, kind, float(noise_mm), column),
}
# kinds that others start from: all of these are made before the rest begins
FIRST: Sequence[frozenset[str]] = (frozenset({"lab", "hdl"}), frozenset({"treated", "beam"}), frozenset({"normals"}))


def in_turn(chores: Iterable[Chore]) -> list[list[Chore]]:
    """Each chore once, in groups that follow one another; those of a group do not need each other."""
    once = list(dict.fromkeys(chores))
    groups = [[chore for chore in once if chore[0] in kinds] for kinds in FIRST]
    rest = [chore for chore in once if not any(chore[0] in kinds for kinds in FIRST)]
    order = list(KINDS)
    groups.append(sorted(rest, key=lambda chore: order.index(chore[0])))
    return [group for group in groups if group]


def done(bench: Bench, chore: Chore) -> None:
    """Make and keep what a chore names. One that cannot be made is told by the experiments that need it."""
    with contextlib.suppress(Scan2FeaError, ImportError):
        KINDS[chore[0]](bench, *chore[1:])


class Workers:
    """Processes that work on one bench; each keeps a bench of its own, and all share the folder."""

    def __init__(self, bench: Bench, jobs: int) -> None:
        self._bench = Bench(folder=bench.folder, options=bench.options)
        self._pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"))

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def each(self, verb: Callable[[Bench, Any], T], items: Sequence[Any]) -> Iterable[tuple[Any, T]]:
        """(item, verb(bench, item)) in the order in which they end. Raises StageError where a process was killed."""
        waiting = {self._pool.submit(_work, self._bench.folder, self._bench.options, verb, item): item for item in items}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        except BrokenProcessPool as error:
            raise StageError("a process of the thesis was killed (out of memory?): run again with --jobs 1; what was made is kept") from error


def _work(folder: Any, options: Any, verb: Callable[[Bench, Any], T], item: Any) -> T:
    return verb(_bench_of(folder, options), item)


@cache
def _bench_of(folder: Any, options: Any) -> Bench:
    """One bench a process."""
    return Bench(folder=folder, options=options)
