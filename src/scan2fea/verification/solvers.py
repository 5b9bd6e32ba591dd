"""Which solvers would take these tets: the worst element of each measure against the limits that a solver states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from scan2fea.kernel.quality import worst_element
from scan2fea.types import FloatArray, Value
from scan2fea.verification.limits import solver_limits

ACCEPTS, WARNS, REFUSES = "accepts", "warns", "refuses"


@dataclass(frozen=True, kw_only=True)
class Judged(Value):
    """One measure of one solver. value : of the worst element, number `element` (from 0).   n_beyond : elements beyond the limit that was passed.

    confirmed : False where the limit comes from no primary page.
    """

    solver: str
    measure: str
    value: float
    element: int
    warn: float | None
    fail: float | None
    says: str
    n_beyond: int
    source: str
    confirmed: bool


def judged(quality: Mapping[str, FloatArray], order: int) -> tuple[Judged, ...]:
    """Every row of the table of solvers that holds for elements of this order (1: TET4, 2: TET10); `quality` as from `tet_quality`."""
    out = []
    for solver, rows in solver_limits().items():
        for row in rows:
            if row.get("order", order) != order:
                continue
            values = quality[row["measure"]]
            above = bool(row.get("above", False))
            warn, fail = row.get("warn"), row.get("fail")
            refused, warned = (_beyond(values, limit, above, at_limit) for limit, at_limit in ((fail, True), (warn, False)))
            says = REFUSES if refused else WARNS if warned else ACCEPTS
            at = worst_element(row["measure"], values)
            value = float(values[at]) if at >= 0 else float("nan")
            out.append(
                Judged(
                    solver=solver, measure=row["measure"], value=value, element=at, warn=warn, fail=fail, says=says, n_beyond=refused or warned,
                    source=row["source"], confirmed=bool(row.get("confirmed", True)),
                )
            )  # fmt: skip
    return tuple(out)


def verdicts(rows: tuple[Judged, ...]) -> dict[str, str]:
    """solver -> the worst that any of its measures says."""
    out: dict[str, str] = {}
    for row in rows:
        rank = (ACCEPTS, WARNS, REFUSES)
        out[row.solver] = max(out.get(row.solver, ACCEPTS), row.says, key=rank.index)
    return out


def _beyond(values: FloatArray, limit: float | None, above: bool, at_limit: bool) -> int:
    """How many values lie beyond the limit; where it is an error, on it too (a Jacobian of exactly 0). What is not a number counts."""
    if limit is None:
        return 0
    if above:
        good = values < limit if at_limit else values <= limit
    else:
        good = values > limit if at_limit else values >= limit
    return int((~good).sum())
