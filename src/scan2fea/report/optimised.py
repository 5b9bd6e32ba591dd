"""What each optimiser did to the tetrahedra: a table, and the histograms of every measure before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from scan2fea.report.charts import ridges
from scan2fea.report.markup import NOTHING, Html, figure_cell, table, tag
from scan2fea.report.words import count, is_number, number

NAMES = {"filled": "as filled", "odt": "ODT", "lloyd": "Lloyd", "perturb": "perturbation", "exude": "exudation"}
FIRST = ("min_dihedral_deg", "scaled_jacobian")  # shown at once; the others behind a click


def optimised_block(steps: Sequence[Mapping[str, Any]]) -> Html:
    """Nothing where no optimiser was logged."""
    if not steps:
        return NOTHING
    rows = []
    for step in steps:
        angle = step["measures"].get("min_dihedral_deg", {})
        cells = [figure_cell(f"{number(angle.get(key))}\u00b0", label) for key, label in (("min", "least"), ("p01", "1 %"), ("median", "median"))]
        rows.append([_name(step), figure_cell(count(step["n_tets"]), "elements"), *cells, _done(step.get("done") or {})])
    spread = table(("step", "elements", "least dihedral", "1 %", "median", "done"), rows)
    names = [name for name in steps[0]["measures"] if name not in FIRST]
    first = tag("div", *(_chart(name, steps) for name in FIRST), class_="charts")
    more = tag("details", tag("summary", "The other measures"), tag("div", *(_chart(name, steps) for name in names), class_="charts"))
    return tag("div", spread, first, more)


def _name(step: Mapping[str, Any]) -> str:
    return NAMES.get(str(step.get("step")), str(step.get("step")))


def _chart(name: str, steps: Sequence[Mapping[str, Any]]) -> Html:
    found = [(_name(step), step["measures"][name]) for step in steps if name in step["measures"]]
    if not found or not all(is_number(measure.get(key)) for _, measure in found for key in ("low", "high")):
        return NOTHING
    rows = [(label, measure["counts"], f"{number(measure.get('min'))} to {number(measure.get('max'))}") for label, measure in found]
    unit = ", degrees" if name.endswith("_deg") else ""
    words = name.removesuffix("_deg").replace("_", " ")
    return ridges(rows, low=found[0][1]["low"], high=found[0][1]["high"], axis=words + unit, title=words)


def _done(done: Mapping[str, Any]) -> str:
    """`5 iterations, 1,283 flips`; the energies are in report.json."""
    if "undone" in done:
        return "taken back: it made the worst element worse"
    energy = done.get("energy") or []
    told = [f"{count(n)} {what}" for what, n in done.items() if isinstance(n, int)]
    return ", ".join(told + ([f"energy to {number(100 * energy[-1])} %"] if len(energy) > 1 else []))
