"""The driver of the four optimisers inside a fixed boundary: ODT, Lloyd, perturbation, exudation, in this or the thesis's order.

What is returned is never worse than what was given, in its smallest dihedral angle and in how near one comes to 0 or 180 degrees: a step is undone
where it is. The boundary stays as it is, to the last bit, its triangles too.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.kernel.quality import TET_LIMITS, summary, tet_dihedrals, tet_quality
from scan2fea.kernel.relaxation import relax
from scan2fea.options import option
from scan2fea.tetmeshing.exude import exude_all
from scan2fea.tetmeshing.flips import flip_all
from scan2fea.tetmeshing.insert import insert_all
from scan2fea.tetmeshing.lloyd import Lloyd
from scan2fea.tetmeshing.odt import Odt
from scan2fea.tetmeshing.perturb import perturb_all
from scan2fea.tetmeshing.work import POINTS, Work, all_qualities, closed, opened
from scan2fea.types import FloatArray, IntArray, Value

ORDERS: Mapping[str, tuple[str, ...]] = {
    "odt_first": ("odt", "lloyd", "perturb", "exude"),
    "lloyd_first": ("lloyd", "odt", "perturb", "exude"),
    "perturb": ("perturb",),
    "exude": ("exude",),
    "none": (),
}
BINS = 24  # of the histograms that the report shows
MANY = 10.0  # times the best: where the histograms of measures without a bound end
MORE_NODES = 0.1  # of those given: how many vertices exudation may put in where nothing else helps


@dataclass(frozen=True, kw_only=True)
class OptimiseOptions:
    """How tets are made better. Nothing is done to a mesh whose angles are all above the target."""

    optimise: str = option("odt_first", "odt, lloyd, perturb, exude; lloyd first as in the thesis; one of them alone; or none", choices=tuple(ORDERS))
    target_deg: float = option(
        25.0, "smallest dihedral angle aimed at, and a scaled Jacobian to match; the steps end there", unit="deg", minimum=0.0, maximum=40.0
    )
    relaxations: int = option(5, "iterations of ODT and of Lloyd", minimum=0)
    passes: int = option(6, "of perturbation and of exudation, as long as they gain", minimum=0)
    optimise_time_s: float | None = option(None, "no step is begun after this; the result then depends on the machine", unit="s", minimum=0.0)
    seed: int = option(0, "of the places where walls are measured and of the directions of the perturbation", minimum=0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Optimised(Value):
    """nodes, tets : better or as given.   row : (n,) of the nodes given, where each is now (-1: no longer used; never for the boundary).

    log : a row for what was given and one per step: step, n_tets, measures (of every measure: min, p01, median, p99, max, and a histogram: low, high,
    counts, what lies beyond in the outermost), done (how much of what; for ODT and Lloyd the energies).
    """

    nodes: FloatArray
    tets: IntArray
    row: IntArray
    log: tuple[Mapping[str, Any], ...]


def optimised(nodes: FloatArray, tets: IntArray, options: OptimiseOptions = OptimiseOptions()) -> Optimised:
    """Positive, conforming tets (m, 4) made better inside their boundary."""
    began = time.monotonic()
    size = float(np.ptp(nodes, axis=0).max())
    centre = nodes.mean(0)
    scaled = (nodes - centre) / size  # only to choose by: what moved is brought back, what did not keeps its bits
    work = opened(scaled, tets)
    log: list[Mapping[str, Any]] = [{"step": "filled", **_told(work)}]
    steps: Mapping[str, Callable[[Work, OptimiseOptions], tuple[Work, dict[str, Any]]]] = {
        "odt": _relaxed_by(Odt), "lloyd": _relaxed_by(Lloyd), "perturb": _perturbed, "exude": _exuded,
    }  # fmt: skip
    for name in ORDERS[options.optimise]:
        late = options.optimise_time_s is not None and time.monotonic() - began > options.optimise_time_s
        if float(all_qualities(work).min()) >= _quality(options.target_deg) or late:
            break
        trial, done = steps[name](_copy(work), options)
        kept = all(now >= before for now, before in zip(_flattest(trial), _flattest(work), strict=True))
        work = trial if kept else work
        log.append({"step": name, **_told(work), "done": done if kept else {"undone": 1}})
    found, packed, used = closed(work)
    row = np.full(len(nodes), -1, np.int64)
    given = used < len(nodes)
    row[used[given]] = np.flatnonzero(given)
    result = found * size + centre
    still = given.copy()
    still[given] = (found[given] == scaled[used[given]]).all(1)
    result[still] = nodes[used[still]]
    return Optimised(nodes=result, tets=packed, row=row, log=tuple(log))


def _quality(angle_deg: float) -> float:
    return float(1 - np.cos(np.radians(angle_deg)))


def _flattest(work: Work) -> tuple[float, float]:
    """The smallest dihedral angle, and how near one comes to 0 or to 180 degrees."""
    nodes, tets, _ = closed(work)
    angles = tet_dihedrals(nodes, tets)
    return float(angles.min()), float(np.minimum(angles, 180 - angles).min())


def _told(work: Work) -> dict[str, Any]:
    nodes, tets, _ = closed(work)
    measures = {name: {**summary(values), **_histogram(name, values)} for name, values in tet_quality(nodes, tets).items()}
    return {"n_tets": len(tets), "measures": measures}


def _histogram(name: str, values: FloatArray) -> dict[str, Any]:
    limit = TET_LIMITS[name]
    low, high = sorted((limit.best, limit.worst if np.isfinite(limit.worst) else MANY * limit.best))
    counts, _ = np.histogram(np.clip(values, low, high), BINS, (low, high))
    return {"low": low, "high": high, "counts": [int(k) for k in counts]}


def _copy(work: Work) -> Work:
    return Work(**{name: array.copy() for name, array in work._asdict().items()})


def _queue(work: Work, bound: float) -> IntArray:
    """Tets flatter than `bound`, the worst first."""
    quality = all_qualities(work)
    rows = np.flatnonzero(quality < bound)
    return np.asarray(rows[np.argsort(quality[rows], kind="stable")], np.int64)


def _relaxed_by(kind: type[Odt] | type[Lloyd]) -> Callable[[Work, OptimiseOptions], tuple[Work, dict[str, Any]]]:
    def step(work: Work, options: OptimiseOptions) -> tuple[Work, dict[str, Any]]:
        alive = np.ascontiguousarray(work.tets[work.tets[:, 0] >= 0])
        n = int(work.tally[POINTS])
        method = kind(tets=alive, held=work.held[:n], floor=_quality(options.target_deg))
        found = relax(work.points[:n], method, iterations=options.relaxations)
        work.points[:n] = found.points
        flips = flip_all(work, _queue(work, _quality(options.target_deg)))
        energies = [float(e) for e in found.energies / max(abs(found.energies[0]), 1e-300)]
        return work, {"iterations": found.iterations, "ended": found.why, "energy": energies, "flips": flips}

    return step


def _perturbed(work: Work, options: OptimiseOptions) -> tuple[Work, dict[str, Any]]:
    """Flips and perturbation in turn, until neither makes the slivers fewer."""
    bound = _quality(options.target_deg)
    moves = flips = 0
    for k in range(options.passes):
        before = _queue(work, bound)
        flips += flip_all(work, before)
        moves += perturb_all(work, _queue(work, bound), bound, options.seed + k)
        if len(_queue(work, bound)) in (0, len(before)):
            break
    return work, {"moves": moves, "flips": flips}


def _exuded(work: Work, options: OptimiseOptions) -> tuple[Work, dict[str, Any]]:
    """Weights; where these do not help, a new vertex; then perturbation and flips round both. Until the worst angle rises no more."""
    bound = _quality(options.target_deg)
    room = int(MORE_NODES * int(work.tally[POINTS]))
    pumped = inserted = 0
    for k in range(options.passes):
        before = _queue(work, bound)
        worst = float(all_qualities(work).min())
        pumped += exude_all(work, before, bound)
        inserted += insert_all(work, _queue(work, bound), bound, room - inserted, options.seed + k)
        perturb_all(work, _queue(work, bound), bound, options.seed + k)
        flip_all(work, _queue(work, bound))
        after = _queue(work, bound)
        if not len(after) or (len(after) == len(before) and float(all_qualities(work).min()) <= worst):
            break
    return work, {"pumped": pumped, "inserted": inserted}
