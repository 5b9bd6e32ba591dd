"""`scan2fea check`: would a solver accept this mesh? Exit 0 yes, 4 no."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

from scan2fea.io import read_mesh
from scan2fea.verification.inspect import Inspection, inspect

NOT_PASSED = 4


def execute(given: argparse.Namespace) -> int:
    found = inspect(read_mesh(Path(given.file)))
    if given.json:
        print(json.dumps(_tree(found), indent=1, allow_nan=False))
    else:
        _print(found, given.file)
    return 0 if found.passed else NOT_PASSED


def _print(found: Inspection, name: str) -> None:
    print(name)
    for key, value in found.figures.items():
        print(f"  {key:<12} {value:>14,.6g}")
    print(f"\n  {'check':<28}{'value':>14}{'limit':>12}  unit")
    for check in found.checks:
        mark = "ok" if check.passed else "FAILED"
        print(f"  {check.name:<28}{_show(check.value):>14}{_show(check.limit):>12}  {check.unit:<10} {mark}")
    print(f"\n  {'quality':<20}{'min':>10}{'1 %':>10}{'median':>10}{'regular':>10}   warn / fail at")
    for key, row in found.quality.items():
        limit = found.limits.get(key)
        told = "" if limit is None else f"{_show(limit.warn)} / {_show(limit.fail)}"
        best = "" if limit is None else f"{limit.best:.4g}"
        print(f"  {key:<20}{row['min']:>10.4g}{row['p01']:>10.4g}{row['median']:>10.4g}{best:>10}   {told}")
    failed = [check for check in found.checks if not check.passed]
    print()
    for check in failed:
        print(f"  {check.says}")
    print("  accepted" if not failed else f"  not accepted: {len(failed)} of {len(found.checks)} checks failed")


def _show(value: object) -> str:
    return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _tree(found: Inspection) -> dict[str, object]:
    def finite(x: object) -> object:
        return None if isinstance(x, float) and not math.isfinite(x) else x

    return {
        "figures": dict(found.figures),
        "quality": {name: {k: finite(v) for k, v in row.items()} for name, row in found.quality.items()},
        "checks": [{"name": c.name, "value": finite(c.value), "limit": c.limit, "unit": c.unit, "passed": c.passed} for c in found.checks],
        "passed": found.passed,
    }
