"""The section of one object: verdict, what to do, pictures, figures, checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from scan2fea.report.charts import bars
from scan2fea.report.drawing import drawing_figure, drawing_section
from scan2fea.report.figures import camera_for, deviation_figure, origin_figure, plain_figure, points_figure, regions_figure
from scan2fea.report.markup import NOTHING, Html, figure_cell, table, tag
from scan2fea.report.member import member_section
from scan2fea.report.optimised import optimised_block
from scan2fea.report.parts import anchor, badge, downloads, facts, mark, picture, quality_table, section
from scan2fea.report.response import response_section, stress_figure
from scan2fea.report.saved import Geometry
from scan2fea.report.solids import Solid, cut_figure, displacement_figure, mode_figure, quality_charts, worst_elements, worst_figure
from scan2fea.report.thickness import thickness_figure
from scan2fea.report.words import (
    check_name,
    count,
    dimensions,
    failed_first,
    first_frequency_hz,
    is_number,
    mass_kg,
    measured_share,
    millimetres,
    number,
    number_of,
    percent,
    quantity,
    stand_in,
    unobserved,
    volume,
    with_deviation,
)
from scan2fea.units import MILLIMETRES_PER_METRE

Item = Mapping[str, Any]
SHOWN_MODES = 3
MOST_CYLINDERS = 24  # that are named


def object_section(item: Item, place: int, made: Geometry, files: Sequence[str], width_px: int) -> Html:
    """Everything about one object, one page when printed."""
    pictures, charts = _pictures(item, made, width_px)
    good = item.get("verdict") == "converted"
    told = (member_section(item), _checks(item), response_section(item), drawing_section(item), _shape(item), _mesh(item, made.solid), _drift(item))
    return tag(
        "article",
        tag("h2", tag("span", number_of(item), class_="number"), " ", item.get("kind") or "object", " ", badge(item.get("verdict"))),
        tag("p", item.get("reason") or "no reason given", class_=f"reason {'good' if good else 'bad'}"),
        _what_to_do(item),
        _facts(item, made.size_m),
        tag("div", *pictures, class_="pictures") if pictures else NOTHING,
        tag("div", *charts, class_="charts") if charts else NOTHING,
        tag("div", *told, class_="parts"),
        tag("p", "Files: ", downloads(files), class_="files"),
        id=anchor(place),
        class_="object",
    )


def _pictures(item: Item, made: Geometry, width_px: int) -> tuple[list[Html], list[Html]]:
    """Pictures in one view, and the charts that go with them."""
    cloud, surface, solid = made.cloud, made.surface, made.solid
    camera = camera_for(cloud, surface, width_px)
    if camera is None:
        return [], []
    figures = [points_figure(cloud, camera)] if cloud is not None and len(cloud) else []
    charts: list[Html] = []
    if surface is not None and len(surface.faces):
        known = [origin_figure(surface, camera), deviation_figure(surface, camera, item.get("noise_m"))]
        wall = [thickness_figure(surface, camera, _sigma(item))] if (item.get("surface") or {}).get("closed") else []
        found = [*(known if any(known) else [plain_figure(surface, camera)]), *wall, regions_figure(surface, camera, item.get("cad") or {})]
        figures += [figure for figure in found if figure is not None]
        charts += [figure.chart for figure in figures if figure.chart]
    if made.as_built is not None:
        figure = drawing_figure(*made.as_built, (item.get("drawing") or {}).get("tolerance_m"), camera)
        figures += [figure] if figure is not None else []
        charts += [figure.chart] if figure is not None else []
    if solid is not None and len(solid.tets):
        frequencies = [*((item.get("fea") or {}).get("frequencies_hz") or [first_frequency_hz(item)]), None, None, None]
        modes = [mode_figure(solid, camera, k + 1, frequencies[k]) for k in range(SHOWN_MODES)]
        drawn = (cut_figure(solid, camera), worst_figure(solid, camera), displacement_figure(solid, camera), stress_figure(solid, camera), *modes)
        figures += [figure for figure in drawn if figure is not None]
        charts += quality_charts(solid)
    return [picture(figure) for figure in figures], charts


def _sigma(item: Item) -> float | None:
    """Noise of the object's points: of its surface, else of its member."""
    told = item.get("noise_m") or (((item.get("member") or {}).get("residual")) or {}).get("sigma_m")
    return float(told) if is_number(told) else None


def _what_to_do(item: Item) -> Html:
    """What would make a failed object convert; of a converted one, what was not observed."""
    if item.get("verdict") == "converted":
        hidden = unobserved(item)
        told = f"Built with {', '.join(hidden)} from {stand_in([item])}: the scan could not tell. Measure it before you rely on it."
        return tag("p", told, class_="note") if hidden else NOTHING
    says = [str(check.get("says")) for check in item.get("checks") or [] if not check.get("passed") and check.get("says")]
    more = [text for text in dict.fromkeys(says) if text != item.get("reason")]
    return tag("div", tag("b", "What would make it convert"), tag("ul", *(tag("li", text) for text in more)), class_="note") if more else NOTHING


def _facts(item: Item, size: Sequence[float] | None) -> Html:
    surface, cad, fea = item.get("surface") or {}, item.get("cad") or {}, item.get("fea") or {}
    mass, frequency, share = mass_kg(item), first_frequency_hz(item), measured_share(item)
    rows: list[tuple[str, object]] = [("Size along x, y, z", dimensions(size))]
    rows += [("Volume", volume(surface["volume_m3"]))] if is_number(surface.get("volume_m3")) and surface.get("closed") else []
    rows += [("Surface", f"{number(surface['area_m2'])} m\u00b2")] if is_number(surface.get("area_m2")) else []
    rows += [("Mass", f"{number(mass)} kg")] if mass is not None else []
    rows += [("First frequency, free", f"{number(frequency)} Hz")] if frequency is not None else []
    rows += [("Points", count(item.get("n_points")))]
    rows += [("Spacing of the points", millimetres(item["spacing_m"]))] if is_number(item.get("spacing_m")) else []
    rows += [("Noise (\u03c3)", millimetres(item["noise_m"]))] if is_number(item.get("noise_m")) and item["noise_m"] > 0 else []
    doubt = item.get("between_frames_m")
    rows += [("Scans lie off each other by (\u03c3 of their poses)", millimetres(doubt))] if is_number(doubt) and doubt > 0 else []
    apart = item.get("how", {}).get("scans_apart_m")
    rows += [("Scans lie off each other by (\u03c3, on faces that several saw)", millimetres(apart))] if is_number(apart) else []
    rows += [("Sensor position", item["sensor"])] if item.get("sensor") else []
    rows += [("Measured surface", percent(share))] if share is not None else []
    if cad:
        kinds = [((cad.get("n_planar") or 0) - (cad.get("n_facets") or 0), "planar"), (cad.get("n_facets"), "facets")]
        kinds += [(cad.get("n_cylindrical"), "cylindrical"), (cad.get("n_conical"), "conical")]
        kinds += [(cad.get("n_spherical"), "spherical"), (cad.get("n_revolution"), "turned"), (cad.get("n_nurbs"), "free-form")]
        rows += [("CAD faces", f"{count(cad.get('n_faces'))} ({', '.join(f'{count(n)} {kind}' for n, kind in kinds if n)})")]
        rows += [("Cylinders", _cylinders(cad["cylinders"]))] if cad.get("cylinders") else []
        rows += [("CAD relations", _relations(cad["snaps"]))] if cad.get("snaps") else []
        made_of = "free-form patches" if cad.get("patches") else "facets"
        rows += [(f"CAD faces are {made_of} because", cad["reason"])] if cad.get("reason") else []
        rows += [("CAD patches", _patches(cad["patches"]))] if cad.get("patches") else []
    rows += [("Elements", f"{count((item.get('volume') or {}).get('n_tets'))} {fea.get('elements', '')}")] if item.get("volume") else []
    rows += [("Material", fea["material"].get("name", "\u2013"))] if fea.get("material") else []
    rows += [("Made by", f"{item.get('route')}: {item.get('route_reason') or 'no reason given'}")]
    return facts(rows)


def _patches(told: Mapping[str, Any]) -> str:
    """How closely NURBS patches follow the surface, and at what angle they meet."""
    off = f"within {millimetres(told['off_max_m'])} of the surface, 95 % within {millimetres(told['off_p95_m'])}"
    angle = f"neighbours meet at {number(told['across_median_deg'])}\u00b0 (median), {number(told['across_max_deg'])}\u00b0 at most"
    return f"{off}; {angle}"


def _cylinders(told: Sequence[Mapping[str, Any]]) -> str:
    """Diameters, those of holes first; one standard deviation where the points tell it."""
    rows = sorted(told[:MOST_CYLINDERS], key=lambda row: not row["is_hole"])
    said = [f"{row['name']} {_wide(row)}" for row in rows]
    return "; ".join(said) + (f"; {len(told) - MOST_CYLINDERS} more in report.json" if len(told) > MOST_CYLINDERS else "")


def _wide(row: Mapping[str, Any]) -> str:
    std = row.get("std_m")
    wide = with_deviation(float(row["diameter_m"]) * MILLIMETRES_PER_METRE, None if std is None else float(std) * MILLIMETRES_PER_METRE)
    return f"\u00d8 {wide} mm"


def _relations(snaps: Sequence[Mapping[str, Any]]) -> str:
    """How many relations of each kind were applied, and how many the data refused."""
    told = []
    for name in sorted({str(snap["relation"]) for snap in snaps}):
        applied = [bool(snap["applied"]) for snap in snaps if snap["relation"] == name]
        refused = f", {count(applied.count(False))} refused by the data" if not all(applied) else ""
        told.append(f"{name}: {count(sum(applied))} applied{refused}")
    return "; ".join(told)


def _checks(item: Item) -> Html:
    checks = failed_first(item.get("checks") or [])
    rows = []
    for check in checks:
        unit = str(check.get("unit", ""))
        cells = (figure_cell(quantity(check.get(key), unit), key) for key in ("value", "limit"))
        rows.append([check_name(check.get("name")), *cells, mark(check.get("passed"))])
    classes = ["" if check.get("passed") else "bad-row" for check in checks]
    return section("Checks", table(("check", "value", "limit", "result"), rows, row_classes=classes), class_="part checks") if rows else NOTHING


def _shape(item: Item) -> Html:
    """How far the points lie from the final surface."""
    found = item.get("deviation")
    if not found:
        return NOTHING
    names = (("mean_m", "mean (signed)"), ("rms_m", "root mean square"), ("p95_m", "95 % of the points within"), ("max_m", "largest"))
    rows = [[label, figure_cell(millimetres(found.get(key)), "distance")] for key, label in names]
    return section("Points against the final surface", table(("distance", "value"), rows, class_="narrow"))


def _mesh(item: Item, solid: Solid | None) -> Html:
    titles = (("surface", "Triangles of the surface"), ("volume", "Tetrahedra"))
    blocks = [(title, quality_table((item.get(name) or {}).get("quality") or {})) for name, title in titles]
    if solid is not None and len(solid.tets):
        rows = []
        for element, angle, centre in worst_elements(solid):
            where = ", ".join(number(x * MILLIMETRES_PER_METRE) for x in centre)
            rows.append([count(element), figure_cell(f"{number(angle)}\u00b0", "smallest dihedral"), figure_cell(where, "centroid, mm")])
        blocks.append(("The five worst elements", table(("element", "smallest dihedral", "centroid, mm"), rows)))
    blocks.append(("What the optimisers did", optimised_block((item.get("volume") or {}).get("optimised") or [])))
    return section("Mesh quality", *(tag("div", tag("h4", title), made, class_="block") for title, made in blocks if made), class_="part long")


def _drift(item: Item) -> Html:
    """What each step did to the shape: the ledger, and its 95 % distances as bars."""
    ledger = item.get("drift") or []
    rows, lengths = [], []
    first = next((row["volume_m3"] for row in ledger if is_number(row.get("volume_m3")) and row["volume_m3"]), None)
    for row in ledger:
        held, p95 = row.get("volume_m3"), row.get("p95_m")
        change = f"{100 * (held / first - 1):+.2f} %".replace("-", "\u2212") if first and is_number(held) else "\u2013"
        cells = [
            (millimetres(row.get("thickness_m")), "thickness"),
            (millimetres(p95), "95 % of the points within"),
            (volume(held), "volume"),
            (change, "change"),
        ]
        rows.append([row.get("step"), *(figure_cell(value, label) for value, label in cells)])
        lengths += [(str(row.get("step")), float(p95), millimetres(p95))] if is_number(p95) else []
    chart = bars(lengths, title="Distance of 95 % of the points after each step")
    return section("What each step changed", table(("step", "thickness", "95 % within", "volume", "change"), rows), chart) if rows else NOTHING
