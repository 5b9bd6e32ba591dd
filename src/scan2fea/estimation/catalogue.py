"""Which standard section is it? A posterior over the sizes of a table that leaves room for none of them: nothing is ever snapped.

Three hypotheses (shape-estimation.md, finding 4): it is a size of the table (prior 0.5, shared equally), its outer dimensions are those of the table
but its walls are not (0.1), or it is none of them (0.4). A naive choice among sizes returned L5X5X5/16 for the thesis's L5x5x1/4 with probability 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.estimation.table import WALLS, Shape, Table, shipped_table
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.types import CatalogueEntry, FloatArray, Value

PRIOR_SIZE, PRIOR_WALL, PRIOR_OTHER = 0.5, 0.1, 0.4
OTHER = "no size of the table"
MAX_ENTRIES, SMALLEST = 12, 1e-3  # sizes listed, and the least probability that is worth a line
# a third of what mills are allowed: EN 10034 (I), EN 10056-2 (L), EN 10210-2 (hollow), EN 10058, EN 10060 (flats, rounds), ASTM A6
OUTER_SHARE, OUTER_LEAST_M = 0.004, 0.0003
WALL_SHARE, WALL_LEAST_M = 0.035, 0.0002
BEYOND = 1.5  # sizes outside the table by that factor are as likely as those inside
PAIRS: Mapping[str, tuple[str, str]] = {"L": ("a", "b"), "RHS": ("h", "b"), "rect": ("b", "t")}  # dimensions that carry no order


@dataclass(frozen=True, kw_only=True)
class PriorThickness(Value):
    """What stands in for dimensions that the data do not tell.

    name : the size or the rule it comes from.   values : all dimensions of the section, metres; the observed ones as they are estimated when the
    others are as assumed.   std_m : of the observed ones then; of the assumed ones the spread of the prior.
    """

    name: str
    values: Mapping[str, float]
    std_m: Mapping[str, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Question(Value):
    """The dimensions of one family in order, what is known of them, and the sizes of the table in either order of the pair."""

    names: tuple[str, ...]
    value: FloatArray
    covariance: FloatArray
    known: tuple[int, ...]
    shapes: tuple[Shape, ...]
    sizes: FloatArray  # (shapes, orders, p)


def posterior(
    family: str, values: Mapping[str, float], covariance: FloatArray, observable: Mapping[str, bool], table: Table | None = None
) -> tuple[CatalogueEntry, ...]:
    """The sizes of the table by probability, and what speaks against all of them; the probabilities of all hypotheses add up to 1.

    values : estimates, metres.   covariance : (p, p) in the order of `values`.   observable : the others are left out of the comparison.
    Raises UsageError for an unknown family or a missing dimension.
    """
    asked = _question(family, values, covariance, observable, table)
    told = {name: float(value) for name, value in zip(asked.names, asked.value, strict=True)}
    if not asked.shapes:
        return (CatalogueEntry(name=OTHER, probability=1.0, parameters=told),)
    by_order = _log_sizes(asked)
    each = np.logaddexp.reduce(by_order, axis=1) - math.log(by_order.shape[1]) + math.log(PRIOR_SIZE / len(asked.shapes))
    wall, standard = _log_other_wall(asked)
    other = math.log(PRIOR_OTHER) + _log_free(asked, asked.known)
    total = np.logaddexp.reduce(np.concatenate([each, [wall, other]]))
    share = np.exp(each - total)
    entries = []
    for row in np.argsort(-share, kind="stable")[:MAX_ENTRIES]:
        if share[row] >= SMALLEST:
            size = asked.sizes[row, int(by_order[row].argmax())]
            parameters = {name: float(v) for name, v in zip(asked.names, size, strict=True)}
            entries.append(CatalogueEntry(name=asked.shapes[row].name, probability=float(share[row]), parameters=parameters, is_standard=True))
    if standard is not None:
        outer = " x ".join(f"{1e3 * v:.4g}" for n, v in standard.items() if n not in WALLS)
        name, parameters = f"{family} {outer}, another thickness", {**told, **standard}
        entries.append(CatalogueEntry(name=name, probability=float(np.exp(wall - total)), parameters=parameters, is_standard=True))
    entries.append(CatalogueEntry(name=OTHER, probability=float(np.exp(other - total)), parameters=told))
    return tuple(sorted(entries, key=lambda entry: -entry.probability))


def prior_thickness(
    family: str, values: Mapping[str, float], covariance: FloatArray, observable: Mapping[str, bool], table: Table | None = None
) -> PriorThickness:
    """What to build with where dimensions are not observable: the middle one of the sizes that fit the observed dimensions.

    Where no size fits, the nearest one is scaled. Observed dimensions move with the assumed ones as their covariance says.
    Raises UsageError where nothing is observable and where the table has no size of the family.
    """
    asked = _question(family, values, covariance, observable, table)
    require(asked.shapes, UsageError, f"the table has no section of family {family}: give the thickness (--member) or another table (--catalogue)")
    require(asked.known, UsageError, f"no dimension of the {family} was observed: give the section (--member)")
    hidden = [k for k in range(len(asked.names)) if k not in asked.known]
    by_order = _log_sizes(asked)
    weight = np.exp(by_order - by_order.max()).ravel()
    flat = asked.sizes.reshape(-1, len(asked.names))
    fits = math.log(PRIOR_SIZE / len(asked.shapes)) + by_order.max() > math.log(PRIOR_OTHER) + _log_free(asked, asked.known)
    if fits:
        chosen = _middle(np.log(flat[:, hidden]), weight)
        name, scale = asked.shapes[chosen // by_order.shape[1]].name, 1.0
    else:
        gap = (np.log(flat[:, asked.known]) - np.log(asked.value[list(asked.known)])) @ np.ones(len(asked.known))
        spread = np.abs(np.log(flat[:, asked.known]) - np.log(asked.value[list(asked.known)])).max(axis=1)
        chosen = int(np.argmin(spread))
        scale = math.exp(-gap[chosen] / len(asked.known))
        name = f"{asked.shapes[chosen // by_order.shape[1]].name} times {scale:.3g}"
    assumed = scale * flat[chosen, hidden]
    middle = np.average(flat[:, hidden], axis=0, weights=weight) if fits else assumed
    width = np.sqrt(np.average((flat[:, hidden] - middle) ** 2, axis=0, weights=weight)) if fits else 0.5 * assumed
    return _conditioned(asked, hidden, assumed, np.maximum(width, WALL_SHARE * assumed), name)


def standard_odds(family: str, values: Mapping[str, float], std_m: float, table: Table | None = None) -> float:
    """How much likelier the outer dimensions are when standard sections are more common than others (Bayes factor against "anything goes").

    values : estimates, metres, each with the standard deviation std_m. 1 where the table has no section of the family.
    """
    outer = {name: name not in WALLS or family == "rect" for name in PARAMETERS[family]}
    asked = _question(family, values, np.eye(len(values)) * std_m**2, outer, table)
    if not asked.shapes or not asked.known:
        return 1.0
    by_order = _log_sizes(asked)
    standard = float(np.logaddexp.reduce(by_order.ravel())) - math.log(by_order.size)
    gain = standard - _log_free(asked, asked.known)
    return PRIOR_OTHER + (1 - PRIOR_OTHER) * math.exp(min(gain, 50.0))


def _middle(at: FloatArray, weight: FloatArray) -> int:
    """The row whose weighted distance to all others is least."""
    worth = np.flatnonzero(weight > 1e-6)
    cost = np.abs(at[worth][:, None] - at[worth][None]).sum(axis=2) @ weight[worth]
    return int(worth[int(np.argmin(cost))])


def _conditioned(asked: _Question, hidden: list[int], assumed: FloatArray, width: FloatArray, name: str) -> PriorThickness:
    """Estimates of the observed dimensions given the assumed ones (conditional Gaussian); the covariance of a hidden one may be zero: unknown."""
    value, std = asked.value.copy(), np.sqrt(np.diag(asked.covariance))
    known, used = list(asked.known), [k for k in hidden if asked.covariance[k, k] > 0]
    if used:
        gain = np.linalg.solve(asked.covariance[np.ix_(used, used)], asked.covariance[np.ix_(used, known)]).T
        value[known] += gain @ (assumed[[hidden.index(k) for k in used]] - asked.value[used])
        rest = asked.covariance[np.ix_(known, known)] - gain @ asked.covariance[np.ix_(used, known)]
        std[known] = np.sqrt(np.maximum(np.diag(rest), 0.0))
    value[hidden], std[hidden] = assumed, width
    names = asked.names
    return PriorThickness(name=name, values=dict(zip(names, value.tolist(), strict=True)), std_m=dict(zip(names, std.tolist(), strict=True)))


def _question(family: str, values: Mapping[str, float], covariance: FloatArray, observable: Mapping[str, bool], table: Table | None) -> _Question:
    require(family in PARAMETERS, UsageError, f"section family {family!r} is unknown; choose one of {', '.join(PARAMETERS)}")
    names = PARAMETERS[family]
    order = list(values)
    for name in names:
        require(name in values and math.isfinite(values[name]) and values[name] > 0, UsageError, f"dimension {name!r} of the {family} is missing")
    covariance = np.asarray(covariance, float)
    says = f"the covariance is {covariance.shape}, there are {len(order)} dimensions ({', '.join(order)})"
    require(covariance.shape == (len(order), len(order)), UsageError, says)
    rows = [order.index(name) for name in names]
    shapes = (shipped_table() if table is None else table).of(family)
    ways = _orders(family)
    sizes = np.array([[[shape.parameters[name] for name in way] for way in ways] for shape in shapes]).reshape(len(shapes), len(ways), len(names))
    known = tuple(k for k, name in enumerate(names) if observable.get(name, True))
    return _Question(
        names=names,
        value=np.array([values[name] for name in names]),
        covariance=covariance[np.ix_(rows, rows)],
        known=known,
        shapes=shapes,
        sizes=sizes,
    )


def _orders(family: str) -> list[tuple[str, ...]]:
    """The dimensions of a size as they may be named in the fit."""
    names = PARAMETERS[family]
    if family not in PAIRS:
        return [names]
    first, second = PAIRS[family]
    return [names, tuple(second if n == first else first if n == second else n for n in names)]


def _tolerance(names: Sequence[str], size: FloatArray) -> FloatArray:
    """(..., p) standard deviation of what mills deliver."""
    is_wall = np.array([name in WALLS for name in names])
    return np.where(is_wall, np.maximum(WALL_SHARE * size, WALL_LEAST_M), np.maximum(OUTER_SHARE * size, OUTER_LEAST_M))


def _log_gauss(off: FloatArray, covariance: FloatArray) -> FloatArray:
    """(...) log densities of N(0, covariance) at off (..., k)."""
    _, logdet = np.linalg.slogdet(covariance)
    solved = np.linalg.solve(covariance, off[..., None])[..., 0]
    return np.asarray(-0.5 * ((off * solved).sum(-1) + logdet + off.shape[-1] * math.log(2 * math.pi)))


def _log_match(asked: _Question, sizes: FloatArray, which: Sequence[int]) -> FloatArray:
    """(...) log density of the estimates of the dimensions `which`, were they those of the sizes (..., p) within what mills deliver."""
    if not len(which):
        return np.zeros(sizes.shape[:-1])
    spread = _tolerance(asked.names, sizes)[..., which] ** 2
    covariance = asked.covariance[np.ix_(which, which)] + spread[..., None] * np.eye(len(which))
    return _log_gauss(asked.value[list(which)] - sizes[..., which], covariance)


def _log_sizes(asked: _Question) -> FloatArray:
    """(shapes, orders) of the observed dimensions."""
    return _log_match(asked, asked.sizes, asked.known)


def _log_free(asked: _Question, which: Sequence[int]) -> float:
    """Log density of dimensions that may be anything: log-uniform over the table's range, walls over its range of wall to first dimension."""
    total = 0.0
    first = asked.sizes[..., 0]
    for k in which:
        ratio = asked.sizes[..., k] / first if asked.names[k] in WALLS else asked.sizes[..., k]
        width = math.log(max(float(ratio.max() / ratio.min()), BEYOND**2) * BEYOND**2)
        total -= math.log(asked.value[k] * width)
    return total


def _log_other_wall(asked: _Question) -> tuple[float, dict[str, float] | None]:
    """Outer dimensions of the table with any wall; the outer dimensions that fit best. Not for sections without walls or outer dimensions."""
    outer = [k for k in asked.known if asked.names[k] not in WALLS]
    walls = [k for k in asked.known if asked.names[k] in WALLS]
    if not outer or not any(name in WALLS for name in asked.names):
        return -math.inf, None
    flat = asked.sizes.reshape(-1, len(asked.names))
    _, first = np.unique(np.round(flat[:, [k for k, n in enumerate(asked.names) if n not in WALLS]], 6), axis=0, return_index=True)
    log = _log_match(asked, flat[first], outer)
    total = float(np.logaddexp.reduce(log)) - math.log(len(first)) + math.log(PRIOR_WALL) + _log_free(asked, walls)
    best = flat[first[int(np.argmax(log))]]
    return total, {name: float(best[k]) for k, name in enumerate(asked.names) if name not in WALLS}
