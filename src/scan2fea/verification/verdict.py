"""One verdict per object: the conjunction of its checks; the reason is the first that failed, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from scan2fea.types import Check


class Verdict(NamedTuple):
    name: Literal["converted", "failed"]
    reason: str


def verdict(checks: Sequence[Check], stopped: str = "", missing: Sequence[str] = ()) -> Verdict:
    """`stopped`: why the chain ended early, if it did. `missing`: results that a converted object must have and this one lacks.

    An object without one check is never converted.
    """
    for check in checks:
        if not check.passed:
            return Verdict("failed", check.says or f"{check.name} is {check.value}, limit {check.limit} {check.unit}")
    if stopped:
        return Verdict("failed", stopped)
    if missing or not checks:
        return Verdict("failed", f"not made: {', '.join(missing) or 'any check'}")
    return Verdict("converted", f"all {len(checks)} checks passed")
