"""The one table of limits, and the way from a figure to a Check."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

from scan2fea.types import Check


@functools.cache
def limits() -> Mapping[str, Mapping[str, Any]]:
    """`limits.toml` as {"surface.boundary_edges": {"limit": ..., "unit": ..., "says": ...}, ...}."""
    return {f"{room}.{name}": row for room, rows in _table().items() if room != "solver" for name, row in rows.items()}


@functools.cache
def _table() -> Mapping[str, Mapping[str, Any]]:
    return tomllib.loads(resources.files("scan2fea.verification").joinpath("limits.toml").read_text(encoding="utf-8"))


def solver_limits() -> Mapping[str, Sequence[Mapping[str, Any]]]:
    """solver -> rows of measure, above, warn, fail, order, source, confirmed."""
    return _table()["solver"]


def _short(x: float | bool | str | None) -> str:
    return f"{x:.4g}" if isinstance(x, float) else str(x)


def at_most(name: str, value: float, limit: float | None = None) -> Check:
    """Passed where value <= limit; a value that is not a number fails."""
    return _check(name, value, limit, lambda v, m: v <= m)


def at_least(name: str, value: float, limit: float | None = None) -> Check:
    """Passed where value >= limit."""
    return _check(name, value, limit, lambda v, m: v >= m)


def above(name: str, value: float, limit: float | None = None) -> Check:
    """Passed where value > limit."""
    return _check(name, value, limit, lambda v, m: v > m)


def holds(name: str, passed: bool, value: float | str, limit: float | str | None = None) -> Check:
    """A check whose condition is not a comparison of two numbers."""
    row = limits()[name]
    shown = row.get("limit") if limit is None else limit
    return Check(
        name=name, value=value, limit=shown, unit=row["unit"], passed=passed, says=row["says"].format(value=_short(value), limit=_short(shown))
    )


def _check(name: str, value: float, limit: float | None, test: Any) -> Check:
    row = limits()[name]
    bound = row["limit"] if limit is None else limit
    passed = bool(test(value, bound))  # nan compares False: it fails
    shown = value if value == value else None
    says = row["says"].format(value=_short(shown), limit=_short(bound))
    return Check(name=name, value=shown, limit=bound, unit=row["unit"], passed=passed, says=says)
