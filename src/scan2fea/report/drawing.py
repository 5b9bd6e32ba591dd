"""Nominal against scanned, on the page: the map of the points over the drawing, its faces, and what the drawn solid answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from scan2fea.kernel.noise import sampled_rows
from scan2fea.report.camera import Camera
from scan2fea.report.charts import Limit, colour_bar, histogram
from scan2fea.report.colours import DIVERGING, diverging, gradient
from scan2fea.report.figures import DRAWN_POINTS, Figure, dots, drawn
from scan2fea.report.markup import NOTHING, Html, figure_cell, table, tag
from scan2fea.report.parts import section
from scan2fea.report.render import render
from scan2fea.report.words import MINUS, NOT_KNOWN, check_name, count, is_number, measure_name, number, percent, quantity
from scan2fea.types import FloatArray
from scan2fea.units import MILLIMETRES_PER_METRE

Row = Mapping[str, Any]
SPAN = 1.5  # of the tolerance: where the colours end
LISTED_FACES = 60


def drawing_figure(points: FloatArray, local_m: FloatArray, tolerance_m: object, camera: Camera) -> Figure | None:
    """The points coloured by how far they lie off the drawing (mean of 16 neighbours), and the histogram of that."""
    if not len(points) or not is_number(tolerance_m):
        return None
    rows = sampled_rows(len(points), DRAWN_POINTS, 0)
    end = SPAN * tolerance_m
    shown, give = number(end * MILLIMETRES_PER_METRE, 3), tolerance_m * MILLIMETRES_PER_METRE
    off = local_m * MILLIMETRES_PER_METRE
    title = f"Points to drawing, tolerance \u00b1{number(give, 3)} mm"
    legend = colour_bar(gradient(DIVERGING), f"\u2212{shown} mm (inside)", "0", f"+{shown} mm (outside)", title)
    chart = histogram(
        off, low=-2 * give, high=2 * give, axis="distance of the points from the drawing, mm", title="As built",
        limits=(Limit(at=-give, label="\u2212tolerance"), Limit(at=give, label="+tolerance")),
        palette=lambda share: diverging((share - 0.5) * 4 / SPAN),
    )  # fmt: skip
    things = (dots(points[rows], diverging(local_m[rows] / end), camera),)
    alt = f"Map of the signed distance of the points from the drawing; tolerance \u00b1{number(give, 3)} mm."
    caption = "White is zero; blue: the points lie inside the drawn solid, red: outside. Each point shows the mean of 16 neighbours."
    return drawn("As built", alt, caption, camera, render(camera, things), legend, chart)


def drawing_section(item: Row) -> Html:
    """The table of the faces of the drawing, those out of tolerance first; and of what both solids answer."""
    found = item.get("drawing") or {}
    if not found:
        return NOTHING
    name = str(found.get("path")).replace("\\", "/").rpartition("/")[2]
    failed = tag("p", str(found["failed"]), class_="note") if found.get("failed") else NOTHING
    if "faces" not in found:
        return section("As drawn, as built", failed)
    return section("As drawn, as built", _sentence(found, name), failed, _faces(found["faces"]), _cases(found.get("cases") or []))


def _sentence(found: Row, name: str) -> Html:
    out, hidden = found.get("out_of_tolerance") or [], found.get("not_seen") or []
    given = f"{quantity(found.get('tolerance_m'), 'm')} ({found.get('tolerance_source')})"
    if not found.get("fits"):
        text = f"{name} is no drawing of this part: {percent(found.get('share_out'))} of the points lie off it by more than {given}."
    else:
        text = f"{name} was laid onto the points (least squares). Faces may be off by {given}: {len(out)} are out of it"
        text += f", {len(hidden)} were not seen." if hidden else "."
    return tag("p", text)


def _faces(faces: Sequence[Row]) -> Html:
    rows = []
    for face in sorted(faces, key=lambda row: (not row.get("is_out"), bool(row.get("is_seen"))))[:LISTED_FACES]:
        place = ", ".join(number(x * MILLIMETRES_PER_METRE) for x in face.get("centre_m") or [])
        said = tag("span", "\u2717 out", class_="bad") if face.get("is_out") else "not seen" if not face.get("is_seen") else "within"
        told = (("mean_m", "mean"), ("std_m", "\u03c3"), ("p95_m", "95 % within"))
        cells = [figure_cell(place, "centre, mm"), figure_cell(count(face.get("n_points")), "points")]
        cells += [figure_cell(quantity(face.get(key), "m"), label) for key, label in told]
        rows.append([tag("code", str(face.get("name"))), *cells, figure_cell(percent(face.get("share_out")), "out"), said])
    head = ("face", "centre, mm", "points", "mean", "\u03c3", "95 % within", "out", "verdict")
    more = tag("p", f"and {len(faces) - LISTED_FACES} more, see report.json") if len(faces) > LISTED_FACES else NOTHING
    return tag("div", table(head, rows), more)


def _signed(share: object) -> str:
    return f"{100 * share:+.2f} %".replace("-", MINUS) if is_number(share) else NOT_KNOWN


def _cases(cases: Sequence[Row]) -> Html:
    rows = []
    for case in cases:
        unit = str(case.get("unit") or "")
        cells = [figure_cell(quantity(case.get(key), unit), key) for key in ("scanned", "drawn")]
        cells.append(figure_cell(_signed(case.get("difference")), "difference"))
        rows.append([f"{check_name(case.get('name'))}: {measure_name(case.get('measure'))}", *cells])
    return tag("div", tag("h4", "Response"), table(("", "scanned", "drawn", "difference"), rows), class_="block") if rows else NOTHING
