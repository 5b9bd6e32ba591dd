"""A fitted member on the page: its dimensions with error bars, its section with the faces that were seen, the catalogue, and what is damaged."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from scan2fea.errors import Scan2FeaError
from scan2fea.kernel.outline import as_section, outline
from scan2fea.kernel.sections import ROUND
from scan2fea.kernel.sections import section as section_of
from scan2fea.report.axis import axis_drawing
from scan2fea.report.charts import FAINT, TEXT, swatches
from scan2fea.report.markup import NOTHING, Html, figure_cell, joined, table, tag
from scan2fea.report.parts import facts, section
from scan2fea.report.words import is_number, number, percent, quantity, with_deviation
from scan2fea.types import FloatArray, Section
from scan2fea.units import MILLIMETRES_PER_METRE

Row = Mapping[str, Any]

SEEN, UNSEEN, UNKNOWN = "#1f78b4", "#c8442c", FAINT
SEEN_SHARE = 0.1  # of a face that points support: less is chance
DRAWN, MARGIN = 240, 44  # size of the drawing and of the space around it
BAR = 96  # width of an error bar
LISTED = 8  # sizes of the catalogue and places of damage shown
SOURCES = {
    "fitted": "measured",
    "fixed": "given",
    "catalogue": "not observable: from the catalogue",
    "estimate": "not observable: an estimate that the points cannot vouch for",
}
WALLS = ("t", "tw", "tf")
SIDES: Mapping[str, tuple[str, str]] = {"L": ("a", "b"), "rect": ("b", "t"), "CHS": ("d", ""), "round": ("d", "")}  # written below and beside


def member_section(item: Row) -> Html:
    """Everything about the member of an object; nothing where it has none."""
    member = item.get("member")
    if not isinstance(member, Mapping):
        return NOTHING
    return section(
        f"Member {member.get('family', '')}",
        _dimensions(member),
        section_drawing(member),
        axis_drawing(member),
        _facts(member),
        _given(_rows(member.get("given"))),
        _catalogue(_rows(member.get("catalogue"))),
        _damage(_rows(member.get("damage"))),
    )


def _rows(value: object) -> list[Row]:
    return [row for row in value if isinstance(row, Mapping)] if isinstance(value, Sequence) and not isinstance(value, str) else []


def _parameters(member: Row) -> dict[str, Row]:
    found = member.get("parameters")
    named = found.items() if isinstance(found, Mapping) else ()
    return {str(name): row for name, row in named if isinstance(row, Mapping) and is_number(row.get("value_m"))}


# ------------------------------------------------------------------ dimensions


def _dimensions(member: Row) -> Html:
    parameters = _with_root(_parameters(member), member.get("root"))
    if not parameters:
        return NOTHING
    known = [float(row["std_m"]) for row in parameters.values() if is_number(row.get("std_m"))]
    widest = max(known, default=0.0)
    rows = []
    for name, row in parameters.items():
        is_seen, std = bool(row.get("observable", True)), row.get("std_m")
        std = float(std) if is_number(std) and is_seen else None
        shown = with_deviation(float(row["value_m"]) * MILLIMETRES_PER_METRE, None if std is None else std * MILLIMETRES_PER_METRE)
        source = SOURCES.get(str(row.get("source")), "measured")
        source = SOURCES["catalogue"] if not is_seen and source == SOURCES["fitted"] else source
        source = f"not observable: as {source}" if not is_seen and source == SOURCES["fixed"] else source
        rows.append([name, figure_cell(f"{shown} mm", "value"), _error_bar(std, widest), source])
    classes = ["" if row.get("observable", True) else "prior" for row in parameters.values()]
    note = tag("p", f"Error bars: one standard deviation, the longest {number(widest * MILLIMETRES_PER_METRE, 2)} mm.") if widest > 0 else NOTHING
    return joined((table(("dimension", "value", "error bar", "from"), rows, row_classes=classes), note))


def _with_root(parameters: dict[str, Row], root: object) -> dict[str, Row]:
    """The dimensions, and the radius of root fillets where the points tell one or it was given."""
    if not (parameters and isinstance(root, Mapping) and is_number(root.get("radius_m")) and root["radius_m"] > 0):
        return parameters
    return {**parameters, "r (root)": {**root, "value_m": root["radius_m"], "observable": True}}


def _error_bar(std: float | None, widest: float) -> Html:
    """A dot with whiskers, all to one scale; a dashed line over the whole width where nothing is known."""
    middle, height = BAR / 2, 14
    if std is None or not widest > 0:
        parts = [tag("line", x1=2, x2=BAR - 2, y1=7, y2=7, stroke=UNSEEN, stroke_width=1.2, stroke_dasharray="3 4")]
        alt = "no standard deviation"
    else:
        half = max((middle - 4) * std / widest, 0.5)
        ends = [tag("line", x1=f"{x:.1f}", x2=f"{x:.1f}", y1=3, y2=11, stroke=TEXT, stroke_width=1.2) for x in (middle - half, middle + half)]
        whisker = tag("line", x1=f"{middle - half:.1f}", x2=f"{middle + half:.1f}", y1=7, y2=7, stroke=TEXT, stroke_width=1.2)
        parts = [whisker, *ends, tag("circle", cx=middle, cy=7, r=2.6, fill=SEEN)]
        alt = f"plus or minus {number(std * MILLIMETRES_PER_METRE, 2)} mm"
    return tag("svg", tag("title", alt), *parts, viewBox=f"0 0 {BAR} {height}", width=BAR, height=height, role="img")


# ------------------------------------------------------------------ section


def section_drawing(member: Row) -> Html:
    """The section to scale, each face in the colour of whether it was seen; nothing where the record has no sound section."""
    parameters = _parameters(member)
    values = {name: float(row["value_m"]) for name, row in parameters.items()}
    try:
        shape = _shape(str(member.get("family")), values, member.get("root"))
    except Scan2FeaError:
        return NOTHING
    corners = np.concatenate(shape.loops)
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    scale = DRAWN / float(size.max())
    wide, high = size * scale
    found = member.get("seen")
    seen = {str(k): float(v) for k, v in found.items() if is_number(v)} if isinstance(found, Mapping) else {}

    def at(points: FloatArray) -> FloatArray:
        return np.stack([MARGIN + (points[:, 0] - low[0]) * scale, MARGIN / 2 + high - (points[:, 1] - low[1]) * scale], axis=1)

    parts = [tag("path", d=" ".join(_outline(at(loop)) for loop in shape.loops), fill="#e8eaec", fill_rule="evenodd", stroke="none")]
    parts += [line for loop, names in zip(shape.loops, shape.face_names, strict=True) for line in _faces(at(loop), names, seen)]
    below, beside = SIDES.get(shape.family, ("b", "h"))
    middle = (MARGIN + wide / 2, MARGIN / 2 + high / 2)
    if below in values:
        low_y = f"{MARGIN / 2 + high + 22:.1f}"
        parts.append(tag("text", _labelled(below, parameters), x=f"{middle[0]:.1f}", y=low_y, text_anchor="middle", fill=TEXT))
    if beside in values:
        turned = f"rotate(-90 18 {middle[1]:.1f})"
        parts.append(tag("text", _labelled(beside, parameters), x=18, y=f"{middle[1]:.1f}", text_anchor="middle", fill=TEXT, transform=turned))
    walls = [name for name in values if name not in (below, beside, "length") and name in WALLS]
    written = [_labelled(name, parameters) for name in walls]
    parts += [
        tag("text", text, x=f"{middle[0]:.1f}", y=f"{MARGIN / 2 + high + 22 + 15 * (k + 1):.0f}", text_anchor="middle", fill=_ink(parameters[name]))
        for k, (name, text) in enumerate(zip(walls, written, strict=True))
    ]
    told = _seen_in_words(shape, seen)
    high += 15 * len(walls)
    box = f"0 0 {DRAWN + 2 * MARGIN} {high + 1.2 * MARGIN:.0f}"  # as wide for all sections: text then has one size
    drawing = tag(
        "svg", tag("title", f"Section {shape.family}. {told}"), *parts, viewBox=box, role="img", font_size="12", font_family="system-ui, sans-serif"
    )
    legend = swatches([(SEEN, "seen by the scanner", False), (UNSEEN, "not seen", False)]) if seen else NOTHING
    return tag("figure", drawing, legend, tag("figcaption", tag("b", "Section"), f", to scale. {told}"), class_="chart")


def _shape(family: str, values: Mapping[str, float], root: object) -> Section:
    """The section with its fillets and slopes; with sharp corners where a record of another version has none, or they do not fit."""
    sharp = section_of(family, values)
    if not isinstance(root, Mapping) or family in ROUND:
        return sharp
    radius, toe, slope = (float(root[name]) if is_number(root.get(name)) else 0.0 for name in ("radius_m", "toe_m", "slope"))
    try:
        return as_section(outline(family, values, radius, toe, slope))
    except Scan2FeaError:
        return sharp


def _outline(points: FloatArray) -> str:
    return "M" + " L".join(f"{x:.1f} {y:.1f}" for x, y in points) + " Z"


def _faces(points: FloatArray, names: Sequence[str], seen: Mapping[str, float]) -> list[Html]:
    """One line for each edge of a loop, dashed where it was not seen."""
    lines = []
    for (ax, ay), (bx, by), name in zip(points, np.roll(points, -1, axis=0), names, strict=True):
        share = seen.get(name)
        colour = UNKNOWN if share is None else SEEN if share >= SEEN_SHARE else UNSEEN
        lines.append(
            tag(
                "line",
                x1=f"{ax:.1f}",
                y1=f"{ay:.1f}",
                x2=f"{bx:.1f}",
                y2=f"{by:.1f}",
                stroke=colour,
                stroke_width=3,
                stroke_linecap="round",
                stroke_dasharray="5 6" if colour == UNSEEN else None,
            )
        )
    return lines


def _labelled(name: str, parameters: Mapping[str, Row]) -> str:
    """`a = 127.2 ± 0.4 mm`; of a dimension that the points do not tell, where it comes from."""
    row = parameters[name]
    value, std, is_seen = float(row["value_m"]) * MILLIMETRES_PER_METRE, row.get("std_m"), bool(row.get("observable", True))
    if is_number(std) and is_seen:
        return f"{name} = {with_deviation(value, float(std) * MILLIMETRES_PER_METRE)} mm"
    return f"{name} = {number(value)} mm" + ("" if is_seen else " (not observable)")


def _ink(row: Row) -> str:
    return TEXT if row.get("observable", True) else UNSEEN


def _seen_in_words(shape: Section, seen: Mapping[str, float]) -> str:
    names = list(dict.fromkeys(name for loop in shape.face_names for name in loop))
    known = [name for name in names if name in seen]
    if not known:
        return "Which faces were seen was not recorded."
    hidden = [name.replace("_", " ").lower() for name in known if seen[name] < SEEN_SHARE]
    return f"{len(known) - len(hidden)} of {len(known)} faces were seen" + (f"; not seen: {', '.join(hidden)}." if hidden else ".")


# ------------------------------------------------------------------ the rest


def _facts(member: Row) -> Html:
    residual = member.get("residual")
    rows: list[tuple[str, object]] = []
    if isinstance(residual, Mapping):
        rows += [("Noise of its points (\u03c3)", quantity(residual["sigma_m"], "m"))] if is_number(residual.get("sigma_m")) else []
        rows += [("Law of the noise", str(residual["noise"]))] if residual.get("noise") else []
        rows += [("Points of something else", percent(residual["outlier_share"]))] if is_number(residual.get("outlier_share")) else []
    families = member.get("families")
    if isinstance(families, Mapping):
        best = sorted(((str(k), float(v)) for k, v in families.items() if is_number(v) and v > 5e-4), key=lambda pair: -pair[1])[:4]
        rows += [("Family", ", ".join(f"{name} {percent(share)}" for name, share in best))] if best else []
    rows += _rolled(member.get("root"))
    rows += _change(member.get("change"))
    rows += [(f"Bend {k + 1}", _bend(bend)) for k, bend in enumerate(_rows(member.get("bends")))]
    rows += [(f"Hole {k + 1}", _hole(hole)) for k, hole in enumerate(_rows(member.get("holes")))]
    rows += [("Given dimensions", f"p-value {number(member['p_fixed'], 2)}")] if is_number(member.get("p_fixed")) else []
    return facts(rows) if rows else NOTHING


def _hole(hole: Row) -> str:
    across = with_deviation(2 * MILLIMETRES_PER_METRE * hole["radius_m"], 2 * MILLIMETRES_PER_METRE * hole["std_m"])
    at = with_deviation(MILLIMETRES_PER_METRE * hole["along_m"], MILLIMETRES_PER_METRE * hole["place_std_m"])
    return f"{across} mm across, through {str(hole['face']).replace('_', ' ').lower()}, {at} mm from the first end"


def _rolled(root: object) -> list[tuple[str, object]]:
    """Round toes and slopes that the solid has and no dimension says."""
    if not isinstance(root, Mapping):
        return []
    rows: list[tuple[str, object]] = []
    if is_number(root.get("toe_m")) and root["toe_m"] > 0:
        is_assumed = root.get("toe_source") == "assumed"
        told = _deviating(root["toe_m"], root.get("toe_std_m"), MILLIMETRES_PER_METRE)
        rows.append(("Radius of its toes", f"{told} mm" + (" (assumed: the standards\u2019 share of the root radius)" if is_assumed else "")))
    if is_number(root.get("slope")) and root["slope"] > 0:
        told = _deviating(root["slope"], root.get("slope_std"), 100.0)
        rows.append(("Slope of its flanges", f"{told} %; tf is in the middle of what stands out of the web"))
    return rows


def _deviating(value: float, std: object, times: float) -> str:
    return with_deviation(times * value, times * float(std)) if is_number(std) and std > 0 else number(times * value)


def _change(change: object) -> list[tuple[str, object]]:
    """The dimension that changes along the member, at its knots."""
    if not isinstance(change, Mapping):
        return []
    at, values = change.get("z_m"), change.get("value_m")
    if not isinstance(at, Sequence) or not isinstance(values, Sequence):
        return []
    places = [f"{number(float(v) * MILLIMETRES_PER_METRE, 5)} mm at {number(float(z), 4)} m" for z, v in zip(at, values, strict=False)]
    return [("Section along the axis", f"{change.get('kind')} of {change.get('dimension')}: {', '.join(places)}")]


def _bend(bend: Row) -> str:
    """Angle and radius of a bend of the axis, and where it begins."""
    turn = with_deviation(math.degrees(float(bend["angle_rad"])), math.degrees(float(bend["angle_std_rad"])))
    radius = with_deviation(float(bend["radius_m"]) * MILLIMETRES_PER_METRE, float(bend["radius_std_m"]) * MILLIMETRES_PER_METRE)
    return f"{turn} degrees, radius of the axis {radius} mm, from {number(float(bend['start_m']), 4)} m on along the axis"


def _given(entries: Sequence[Row]) -> Html:
    """Dimensions that were given, beside what the points say of them."""
    rows = []
    for row in entries:
        value, std, p = row.get("measured_m"), row.get("std_m"), row.get("p_value")
        told = is_number(value) and is_number(std)
        shown = "not told"
        if told:
            shown = f"{with_deviation(float(row['measured_m']) * MILLIMETRES_PER_METRE, float(row['std_m']) * MILLIMETRES_PER_METRE)} mm"
        said = "denied by the points" if row.get("contradicted") else "not contradicted" if told else "untested"
        given = f"{number(float(row['value_m']) * MILLIMETRES_PER_METRE, 5)} mm" if is_number(row.get("value_m")) else ""
        use = "built with" if row.get("held") else "only compared"
        cells = [figure_cell(given, "given"), figure_cell(shown, "measured"), figure_cell(number(p, 2), "p-value")]
        rows.append([str(row.get("name")), *cells, f"{said}; {use}"])
    if not rows:
        return NOTHING
    note = tag("p", "Denied: p below 0.001 and beyond what mill tolerance allows.")
    return joined((tag("h4", "Given dimensions"), table(("dimension", "given", "measured", "p-value", ""), rows), note))


def _catalogue(entries: Sequence[Row]) -> Html:
    """What the table of standard sections says; the rows that speak against it are among them."""
    rows = [[str(row.get("name")), _share_bar(_share(row)), figure_cell(percent(_share(row)), "probability")] for row in entries[:LISTED]]
    if not rows:
        return NOTHING
    rest = sum(_share(row) for row in entries[LISTED:])
    more = tag("p", f"{len(entries) - LISTED} more hold {percent(rest)}.") if len(entries) > LISTED else NOTHING
    note = tag("p", "No dimension is snapped to a standard size; all may be off by as much together (the scanner's zero, paint).")
    return joined((tag("h4", "Catalogue"), table(("section", "", "probability"), rows), more, note))


def _share_bar(share: float) -> Html:
    """A probability as a bar; the whole width is 1."""
    rect = tag("rect", x=0, y=3, width=f"{max(BAR * min(max(share, 0.0), 1.0), 0.8):.1f}", height=8, fill=SEEN)
    frame = tag("rect", x=0.5, y=2.5, width=BAR - 1, height=9, fill="none", stroke=FAINT)
    return tag("svg", tag("title", f"probability {percent(share)}"), rect, frame, viewBox=f"0 0 {BAR} 14", width=BAR, height=14, role="img")


def _share(row: Row) -> float:
    value = row.get("probability")
    return float(value) if is_number(value) else 0.0


def _damage(places: Sequence[Row]) -> Html:
    """Local losses, the most significant first."""
    rows = []
    for place in places[:LISTED]:
        at = place.get("position_m")
        where = ", ".join(number(float(x) * MILLIMETRES_PER_METRE, 5) for x in at if is_number(x)) if isinstance(at, Sequence) else ""
        depth, std = place.get("depth_m"), place.get("std_m")
        error = float(std) * MILLIMETRES_PER_METRE if is_number(std) else None
        shown = with_deviation(float(depth) * MILLIMETRES_PER_METRE, error) if is_number(depth) else "\u2013"
        cells = [figure_cell(where, "position, mm"), figure_cell(quantity(place.get("size_m"), "m"), "size"), figure_cell(f"{shown} mm", "depth")]
        rows.append([str(place.get("kind", "damage")), *cells, figure_cell(number(place.get("p_value"), 2), "p-value")])
    if not rows:
        return NOTHING
    more = tag("p", f"{len(places) - LISTED} more places are in report.json.") if len(places) > LISTED else NOTHING
    told = tag("p", "Depth: positive where material is missing.")
    return joined((tag("h4", "Damage"), table(("kind", "position, mm", "size", "depth", "p-value"), rows), told, more))
