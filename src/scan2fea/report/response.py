"""What the model answers, on the page: load cases with error bars, what could not be solved, the sets that loads can name, stress with its traps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from scan2fea.report.camera import Camera
from scan2fea.report.charts import colour_bar, swatches
from scan2fea.report.colours import VIRIDIS, css, gradient, viridis
from scan2fea.report.figures import DATA_CONTRAST, Figure, drawn
from scan2fea.report.markup import NOTHING, Html, figure_cell, table, tag
from scan2fea.report.parts import section
from scan2fea.report.render import Shape, render
from scan2fea.report.solids import WORST_COLOUR, Solid
from scan2fea.report.words import NOT_KNOWN, PAGE_UNITS, check_name, count, is_number, measure_name, number, percent, quantity, with_deviation
from scan2fea.units import MILLIMETRES_PER_METRE
from scan2fea.verification.limits import limits as bounds
from scan2fea.verification.response import MEMBER_CHECKS

Row = Mapping[str, Any]
QUANTILE = 0.99  # of the nodes away from singular places: the end of the scale
LISTED_SETS = 40
DUST, SHOWN_NORMAL = 1e-6, 0.01  # of the largest coordinate; the last digit of a normal that is shown
SHELL = "shell_"  # begins the names of the cases that a model of shells was solved for
# check, cases, measures: the check whose limit their relative error has to keep
JUDGED = (
    ("response.weight", ("self_weight",), ("reaction_n",)),
    ("response.weight", ("mass",), ("mass_kg",)),
    ("response.energy", ("self_weight",), ("strain_energy_j",)),
    ("response.rigid_modes", ("modal",), ("rigid_max_hz",)),
    *MEMBER_CHECKS,
)


def response_section(item: Row) -> Html:
    """The load cases: what was computed and how far it is known, what was expected, by how much they differ."""
    fea = item.get("fea") or {}
    limits = {str(check.get("name")): check.get("limit") for check in item.get("checks") or []}
    cases = fea.get("cases") or []
    rows = [_case_row(case, limits) for case in cases if not str(case.get("name")).startswith(SHELL)]
    frequencies = [f"{number(f)} Hz" for f in fea.get("frequencies_hz") or [] if is_number(f)][:6]
    modes = tag("p", f"Elastic frequencies of the free body: {', '.join(frequencies)}.") if frequencies else NOTHING
    told = tag("p", f"Solved by: {fea['solver']}; {count(fea.get('dof'))} unknowns.") if fea.get("solver") else NOTHING
    failed = [tag("li", tag("b", name), f": {why}") for name, why in (fea.get("failed_cases") or {}).items()]
    missing = tag("div", tag("b", "Cases without a result"), tag("ul", *failed), class_="note") if failed else NOTHING
    if not rows:
        return missing
    answers = table(("load case: measure", "value", "expected", "error", "verdict"), rows)
    more = (_three_models(cases), modes, told, _singular(fea), _sets(fea))
    return section("Response", _sentence(item), missing, answers, *more, class_="part response")


def _three_models(cases: Sequence[Row]) -> Html:
    """The last end of a member under the same loads, by its solid, as shells and as a beam: where they part, the cheap ones leave something out."""
    solid = {(case.get("name"), case.get("measure")): case for case in cases}
    rows = []
    for shell in cases:
        name, measure, unit = str(shell.get("name")), shell.get("measure"), str(shell.get("unit") or "")
        of = solid.get((name.removeprefix(SHELL), measure))
        if not name.startswith(SHELL) or of is None:
            continue
        cells = [figure_cell(quantity(value, unit), how) for value, how in ((of.get("value"), "solid"), (shell.get("value"), "shells"))]
        beam = figure_cell(quantity(of.get("expected"), unit), "beam")
        rows.append([f"{check_name(name.removeprefix(SHELL))}: {measure_name(measure)}", *cells, beam])
    if not rows:
        return NOTHING
    head = ("the last end moves by", "solid (model.inp)", "shells (model_shell.inp)", "beam (model_beam.inp)")
    return tag("div", tag("h4", "Three models"), table(head, rows))


def _case_row(case: Row, limits: Row) -> list[Any]:
    """limits : of the checks of the object, by name: the verdict is theirs; what no check looks at is compared alone."""
    unit = str(case.get("unit") or "")
    return [
        f"{check_name(case.get('name'))}: {measure_name(case.get('measure'))}",
        figure_cell(_with_std(case), "value"),
        figure_cell(quantity(case.get("expected"), unit), "expected"),
        figure_cell(percent(case.get("relative_error")), "error"),
        _verdict(case, limits),
    ]


def _verdict(case: Row, limits: Row) -> Html | str:
    name, measure, error = str(case.get("name")), str(case.get("measure")), case.get("relative_error")
    if measure.endswith("discretisation") and is_number(case.get("value")):
        return _refinement(float(case["value"]))
    limit = next((limits.get(check) for check, cases, measures in JUDGED if name in cases and measure in measures), None)
    if not is_number(error):
        return NOT_KNOWN
    if not is_number(limit):
        return "compared, not checked"
    return _against(error, limit)


def _against(error: float, limit: float) -> Html:
    good = error <= limit
    sign, relation = ("\u2713", "\u2264") if good else ("\u2717", ">")
    return tag("span", f"{sign} {relation} {number(100 * limit)} %", class_="good" if good else "bad")


def _refinement(change: float) -> Html:
    """What a better solution on the same elements would change: accepted, told, or more than the answer should be trusted to."""
    row = bounds()["told.discretisation"]
    return _against(change, row["accept"] if change <= row["accept"] else row["limit"])


def _with_std(case: Row) -> str:
    """`3.10 +- 0.14 mm`: digits as the standard deviation allows."""
    unit, value, std = str(case.get("unit") or ""), case.get("value"), case.get("std")
    if not (is_number(value) and is_number(std) and std > 0):
        return quantity(value, unit)
    factor, shown = PAGE_UNITS.get(unit, (1.0, unit))
    return f"{with_deviation(value * factor, std * factor)} {shown}".strip()


def _sentence(item: Row) -> Html:
    """The answer of a member in one line."""
    cases = (item.get("fea") or {}).get("cases") or []
    along = {"bend_x": "tip_x_m", "bend_y": "tip_y_m"}
    bent = [c for c in cases if along.get(str(c.get("name"))) == c.get("measure") and c.get("measure") and is_number(c.get("std"))]
    if not bent:
        return NOTHING
    worst = max(bent, key=lambda c: abs(float(c["value"])))
    text = f"Held at its first end and loaded at the other: tip deflection {_with_std(worst)} along {str(worst['name'])[-1]} of its section"
    walls = [name for name, row in ((item.get("member") or {}).get("parameters") or {}).items() if row.get("source") in ("catalogue", "estimate")]
    vague = f", and from how far off {', '.join(walls)} may be, which the scan could not tell" if walls else ""
    text += f"; \u00b1 is one standard deviation, from those of the dimensions{vague or ' alone'}."
    return tag("p", text)


def _singular(fea: Row) -> Html:
    """What the peak stress leaves out."""
    n = fea.get("n_singular_nodes")
    if not is_number(n) or n <= 0:
        return NOTHING
    text = f"Stress has no limit at re-entrant edges without a fillet, at tips and at the rims of supports ({count(int(n))} nodes, marked red): "
    return tag("p", text + "peaks are given outside the elements that touch them, with the jump to the mean at the nodes as their convergence.")


def _sets(fea: Row) -> Html:
    """Names for fea.supports and fea.loads."""
    rows = []
    for row in (fea.get("sets") or [])[:LISTED_SETS]:
        place = [x * MILLIMETRES_PER_METRE for x in row.get("centre_m") or []]
        centre = ", ".join(number(x) for x in _without_dust(place, DUST * max(map(abs, place), default=0.0)))
        mean = _without_dust(row.get("normal") or [], SHOWN_NORMAL / 2)
        normal = ", ".join(number(x, 2) for x in mean) if any(mean) else NOT_KNOWN  # all round a hole it has none
        area = f"{number(row['area_m2'] * 1e6)} mm\u00b2" if is_number(row.get("area_m2")) else number(None)
        cells = (figure_cell(area, "area"), figure_cell(centre, "centroid, mm"), figure_cell(normal, "mean normal"))
        rows.append([tag("code", str(row.get("name"))), *cells])
    if not rows:
        return NOTHING
    told = "Put these names into fea.supports and fea.loads and run again with --resume: only the solution is made anew."
    return tag("div", tag("h4", "Sets of faces"), table(("set", "area", "centroid, mm", "mean normal"), rows), tag("p", told), class_="block")


def _without_dust(values: Sequence[float], least: float) -> list[float]:
    """What is smaller than `least` is zero: rounding has its size."""
    return [x if abs(x) >= least else 0.0 for x in values]


def stress_figure(solid: Solid, camera: Camera) -> Figure | None:
    """Von Mises stress under its own weight, singular places in red."""
    stress, singular = solid.point_data.get("von_mises_pa"), solid.point_data.get("is_singular")
    if stress is None or stress.shape != (len(solid.nodes),) or not np.isfinite(stress).all():
        return None
    marked = np.zeros(len(stress), bool) if singular is None or singular.shape != stress.shape else singular > 0.5
    clear = stress[~marked]
    top = float(np.quantile(clear if len(clear) else stress, QUANTILE))
    if not top > 0:
        return None
    faces, _ = solid.boundary()
    colours = viridis(stress / top)
    colours[marked] = WORST_COLOUR
    shown = number(top * 1e-6)
    legend = colour_bar(gradient(VIRIDIS), "0", "", f"{shown} MPa", "Von Mises stress under its own weight")
    if marked.any():
        legend = Html(legend + swatches([(css(WORST_COLOUR), "stress has no limit here", False)]))
    shape = Shape(vertices=solid.nodes, faces=faces, colours=colours, per_vertex=True, contrast=DATA_CONTRAST)
    alt = f"Von Mises stress under its own weight; 99 % of the nodes away from singular places are below {shown} MPa."
    return drawn("Stress", alt, "The scale ends where 99 % of the nodes stay below.", camera, render(camera, (shape,)), legend)
