"""Which standard section is it? A posterior over the sizes of a table that leaves room for none of them: nothing is ever snapped.

Three hypotheses (shape-estimation.md, finding 4): it is a size of the table (prior 0.5, shared equally), its outer dimensions are those of the table
but its walls are not (0.1), or it is none of them (0.4). A naive choice among sizes returned L5X5X5/16 for the thesis's L5x5x1/4 with probability 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

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
ESTIMATE = "the estimate of the points"  # what stands in for a wall where no size of the table is near it
N_WALLS = 400  # steps of the log-uniform prior of a wall
PAIRS: Mapping[str, tuple[str, str]] = {"L": ("a", "b"), "RHS": ("h", "b"), "rect": ("b", "t")}  # dimensions that carry no order


@dataclass(frozen=True, kw_only=True)
class PriorThickness(Value):
    """What stands in for dimensions that the data do not tell.

    name : the size or the rule it comes from.   values : all dimensions of the section, metres; the observed ones as they are estimated when the
    others are as assumed.   std_m : of the observed ones then; of the assumed ones how far from `values` they may be.
    estimated : assumed dimensions that are the points' own estimate, since no size of the table is near it.
    """

    name: str
    values: Mapping[str, float]
    std_m: Mapping[str, float]
    estimated: frozenset[str] = frozenset()


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
    family: str,
    values: Mapping[str, float],
    covariance: FloatArray,
    observable: Mapping[str, bool],
    table: Table | None = None,
    offset_m: float = 0.0,
) -> tuple[CatalogueEntry, ...]:
    """The sizes of the table by probability, and what speaks against all of them; the probabilities of all hypotheses add up to 1.

    values : estimates, metres.   covariance : (p, p) in the order of `values`.   observable : the others are left out of the comparison.
    offset_m : standard deviation of how far all faces may lie off along their normals together (the sensor's zero, paint, scale): every dimension of
    every family is then longer by twice as much. Of no account where a dimension is hidden: outer sizes alone do not tell it from another size.
    Raises UsageError for an unknown family or a missing dimension.
    """
    common = (2 * offset_m) ** 2 if all(observable.get(name, True) for name in values) else 0.0  # variance of what all dimensions are longer by
    asked = _question(family, values, np.asarray(covariance, float) + common, observable, table)
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
            entry = CatalogueEntry(
                name=asked.shapes[row].name,
                probability=float(share[row]),
                parameters={name: float(v) for name, v in zip(asked.names, size, strict=True)},
                is_standard=True,
                offset_m=_offset(asked, size, common) / 2,
            )
            entries.append(entry)
    if standard is not None:
        outer = " x ".join(f"{1e3 * v:.4g}" for n, v in standard.items() if n not in WALLS)
        name, parameters = f"{family} {outer}, another thickness", {**told, **standard}
        entries.append(CatalogueEntry(name=name, probability=float(np.exp(wall - total)), parameters=parameters, is_standard=True))
    entries.append(CatalogueEntry(name=OTHER, probability=float(np.exp(other - total)), parameters=told))
    return tuple(sorted(entries, key=lambda entry: -entry.probability))


def outer_sizes(entries: Sequence[CatalogueEntry]) -> tuple[tuple[Mapping[str, float], float], ...]:
    """Outer dimensions of standard sections, metres, whatever their walls: with the probability of all sizes that have them, the likeliest first.

    Where no wall was observed a dozen sizes share what the outer dimensions alone leave no doubt of.   entries : as of `posterior`.
    """
    pooled: dict[tuple[tuple[str, float], ...], float] = {}
    for entry in entries:
        if entry.is_standard:
            outer = tuple((name, round(value, 6)) for name, value in entry.parameters.items() if name not in WALLS)
            pooled[outer] = pooled.get(outer, 0.0) + entry.probability
    return tuple((dict(outer), share) for outer, share in sorted(pooled.items(), key=lambda item: -item[1]))


def prior_thickness(
    family: str,
    values: Mapping[str, float],
    covariance: FloatArray,
    observable: Mapping[str, bool],
    table: Table | None = None,
    least: Mapping[str, float] | None = None,
) -> PriorThickness:
    """What to build with where dimensions are not observable.

    A wall whose covariance is not zero has an estimate that the points cannot vouch for: of the sizes that go with the observed dimensions the one
    nearest to it in its standard deviations, or the estimate itself where "no size" is likelier than all of them. Where nothing is known of a
    dimension, the middle one of the sizes that fit the observed dimensions; where no size fits, the nearest one is scaled. Observed dimensions move
    with the assumed ones as their covariance says.
    least : what dimensions that are not observable reach at least, metres: sizes that end short of it are none.
    Raises UsageError where nothing is observable and where the table has no size of the family.
    """
    asked = _question(family, values, covariance, observable, table)
    require(asked.shapes, UsageError, f"the table has no section of family {family}: give the thickness (--member) or another table (--catalogue)")
    require(asked.known, UsageError, f"no dimension of the {family} was observed: give the section (--member)")
    hidden = [k for k in range(len(asked.names)) if k not in asked.known]
    floor = np.array([(least or {}).get(name, 0.0) for name in asked.names])
    reaches = np.flatnonzero(np.any(np.all(asked.sizes >= floor, axis=2), axis=1))
    if len(reaches):
        asked = replace(asked, shapes=tuple(asked.shapes[row] for row in reaches), sizes=asked.sizes[reaches])
    by_order = _log_sizes(asked)
    if math.log(PRIOR_SIZE / len(asked.shapes)) + by_order.max() > math.log(PRIOR_OTHER) + _log_free(asked, asked.known):
        weight = np.exp(by_order - by_order.max()).ravel()
        flat = asked.sizes.reshape(-1, len(asked.names))
        chosen = _middle(np.log(flat[:, hidden]), weight)
        name, assumed = asked.shapes[chosen // by_order.shape[1]].name, flat[chosen, hidden]
        middle = np.average(flat[:, hidden], axis=0, weights=weight)
        width = np.sqrt(np.average((flat[:, hidden] - middle) ** 2, axis=0, weights=weight))
    else:
        name, assumed = _scaled(asked, hidden)
        width = 0.5 * assumed
    guessed = [k for k in hidden if asked.covariance[k, k] > 0 and asked.names[k] in WALLS and family != "rect"]
    estimated: frozenset[str] = frozenset()
    if guessed:
        name, assumed, width, estimated = _nearest(asked, hidden, guessed, name, assumed, width)
    assumed = np.maximum(assumed, floor[hidden])
    return _conditioned(asked, hidden, assumed, np.maximum(width, WALL_SHARE * assumed), name, estimated)


def _scaled(asked: _Question, hidden: list[int]) -> tuple[str, FloatArray]:
    """The size whose observed dimensions are in the likeliest proportion, scaled to those."""
    flat = asked.sizes.reshape(-1, len(asked.names))
    away = np.log(flat[:, asked.known]) - np.log(asked.value[list(asked.known)])
    chosen = int(np.argmin(np.abs(away).max(axis=1)))
    scale = math.exp(-float(away[chosen].mean()))
    return f"{asked.shapes[chosen // asked.sizes.shape[1]].name} times {scale:.3g}", scale * flat[chosen, hidden]


def _nearest(
    asked: _Question, hidden: list[int], guessed: list[int], name: str, assumed: FloatArray, width: FloatArray
) -> tuple[str, FloatArray, FloatArray, frozenset[str]]:
    """Name, values and spread of the hidden dimensions, with estimates for those in `guessed`; names of those that are estimates.

    The spread is the root mean square distance of what is built to everything that the points and the table leave possible, and not below what the
    points alone leave.
    """
    log = _log_match(asked, asked.sizes, (*asked.known, *guessed)).ravel()
    flat = asked.sizes.reshape(-1, len(asked.names))
    walls = [_any_wall(asked, k) for k in guessed]
    sizes = float(np.logaddexp.reduce(log)) + math.log(PRIOR_SIZE / len(log))
    outer = [k for k in asked.known if asked.names[k] not in WALLS]
    free_known = _log_free(asked, asked.known)
    standard = _log_other_wall(asked)[0] if outer else -math.inf
    other = float(np.logaddexp(math.log(PRIOR_OTHER) + free_known, standard)) + sum(wall[0] for wall in walls)
    share = np.exp(log - np.logaddexp.reduce(log))
    by_size = 1 / (1 + math.exp(min(other - sizes, 700.0)))
    value, spread = np.array(assumed), np.array(width)
    if by_size >= 0.5:
        best = int(np.argmax(log))
        name, value = asked.shapes[best // asked.sizes.shape[1]].name, flat[best, hidden]
    rows = [hidden.index(k) for k in guessed]
    if by_size < 0.5:
        value[rows] = [wall[1] for wall in walls]
        name = ESTIMATE if len(rows) == len(hidden) else f"{name}, {ESTIMATE}"
    for row, k, (_, middle, std) in zip(rows, guessed, walls, strict=True):
        away = by_size * float(share @ (flat[:, k] - value[row]) ** 2) + (1 - by_size) * ((middle - value[row]) ** 2 + std**2)
        spread[row] = max(math.sqrt(away), std)
    return name, value, spread, frozenset(asked.names[k] for k in guessed) if by_size < 0.5 else frozenset()


def _any_wall(asked: _Question, k: int) -> tuple[float, float, float]:
    """Log density of the estimate of a wall that may be any (log-uniform as in `_log_free`), and mean and standard deviation given the estimate."""
    at = float(asked.value[k])
    std = max(math.sqrt(float(asked.covariance[k, k])), WALL_SHARE * at)  # finer than what mills deliver nothing is asked
    ratio = asked.sizes[..., k] / asked.sizes[..., 0] * asked.value[0]
    low, high = min(float(ratio.min()) / BEYOND, max(at - 3 * std, 0.5 * at)), max(float(ratio.max()) * BEYOND, at + 3 * std)
    high = min(high, 0.5 * float(asked.value[0]))
    t = np.geomspace(min(low, 0.5 * high), high, N_WALLS)
    log = -0.5 * ((t - at) / std) ** 2
    peak = float(log.max())
    weight = np.exp(log - peak)
    mean = float(weight @ t / weight.sum())
    evidence = peak + math.log(float(weight.mean())) - math.log(std * math.sqrt(2 * math.pi))
    return evidence, mean, math.sqrt(float(weight @ (t - mean) ** 2 / weight.sum()))


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


def _conditioned(asked: _Question, hidden: list[int], assumed: FloatArray, width: FloatArray, name: str, estimated: frozenset[str]) -> PriorThickness:
    """Estimates of the observed dimensions given the assumed ones (conditional Gaussian); the covariance of a hidden one may be zero: unknown."""
    value, std = asked.value.copy(), np.sqrt(np.diag(asked.covariance))
    known, used = list(asked.known), [k for k in hidden if asked.covariance[k, k] > 0]
    if used:
        gain = np.linalg.solve(asked.covariance[np.ix_(used, used)], asked.covariance[np.ix_(used, known)]).T
        value[known] += gain @ (assumed[[hidden.index(k) for k in used]] - asked.value[used])
        rest = asked.covariance[np.ix_(known, known)] - gain @ asked.covariance[np.ix_(used, known)]
        std[known] = np.sqrt(np.maximum(np.diag(rest), 0.0))
    value[hidden], std[hidden] = assumed, width
    by_name, spread = dict(zip(asked.names, value.tolist(), strict=True)), dict(zip(asked.names, std.tolist(), strict=True))
    return PriorThickness(name=name, values=by_name, std_m=spread, estimated=estimated)


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


def _offset(asked: _Question, size: FloatArray, common: float) -> float:
    """By how much all dimensions are longer together, were it that size: the mean given the estimates, of variance `common` beforehand."""
    if not common > 0:
        return 0.0
    spread = asked.covariance + np.diag(_tolerance(asked.names, size) ** 2)
    return common * float(np.linalg.solve(spread, asked.value - size).sum())


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
