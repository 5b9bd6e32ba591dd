"""`scan2fea check`: which solvers would accept this mesh, measure by measure? Exit 0: it passes the checks that all share, 4: no."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

from scan2fea.pipeline.check_file import inspect_file
from scan2fea.verification.inspect import Inspection
from scan2fea.verification.solvers import verdicts

NOT_PASSED = 4


def execute(given: argparse.Namespace) -> int:
    found = inspect_file(Path(given.file))
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
    _print_quality(found)
    _print_solvers(found)
    failed = [check for check in found.checks if not check.passed]
    print()
    for check in failed:
        print(f"  {check.says}")
    print("  accepted" if not failed else f"  not accepted: {len(failed)} of {len(found.checks)} checks failed")


def _print_quality(found: Inspection) -> None:
    if not found.quality:
        return
    heads = "".join(f"{head:>10}" for head in ("min", "1 %", "median", "99 %", "max", "regular"))
    print(f"\n  {'quality':<20}{heads}   warn / fail at       worst element")
    for key, row in found.quality.items():
        limit = found.limits.get(key)
        told = "" if limit is None else f"{_show(limit.warn)} / {_show(limit.fail)}"
        best = "" if limit is None else f"{limit.best:.4g}"
        spread = "".join(f"{row[name]:>10.4g}" for name in ("min", "p01", "median", "p99", "max"))
        print(f"  {key:<20}{spread}{best:>10}   {told:<20} {found.worst[key] + 1:,}")


def _print_solvers(found: Inspection) -> None:
    if not found.solvers:
        return
    print(f"\n  {'solver':<12}{'measure':<22}{'worst':>10}{'warns at':>10}{'fails at':>10}  says")
    for row in found.solvers:
        says = f"{row.says} ({row.n_beyond:,} elements)" if row.n_beyond else row.says
        doubt = "" if row.confirmed else "; limit not confirmed"
        print(f"  {row.solver:<12}{row.measure:<22}{_show(row.value):>10}{_show(row.warn):>10}{_show(row.fail):>10}  {says}{doubt}")
    print("\n  " + ", ".join(f"{solver} {says}" for solver, says in verdicts(found.solvers).items()))


def _show(value: object) -> str:
    return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _tree(found: Inspection) -> dict[str, object]:
    def finite(x: object) -> object:
        return None if isinstance(x, float) and not math.isfinite(x) else x

    return {
        "figures": dict(found.figures),
        "quality": {name: {k: finite(v) for k, v in row.items()} for name, row in found.quality.items()},
        "worst_element": dict(found.worst),
        "solvers": [{name: finite(value) for name, value in vars(row).items()} for row in found.solvers],
        "checks": [{"name": c.name, "value": finite(c.value), "limit": c.limit, "unit": c.unit, "passed": c.passed} for c in found.checks],
        "passed": found.passed,
    }
