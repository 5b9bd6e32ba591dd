"""report.html: one file, offline, readable on a phone, printable, made from what a run left in OUT and from nothing else."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import UsageError
from scan2fea.kernel.threads import in_threads
from scan2fea.report.charts import swatches
from scan2fea.report.colours import BACKDROP, categories, css
from scan2fea.report.figures import scene_figure
from scan2fea.report.glossary import GLOSSARY, MORE
from scan2fea.report.markup import NOTHING, Html, figure_cell, joined, link, table, tag
from scan2fea.report.parts import TABLE_FILES, anchor, badge, downloads, facts, picture
from scan2fea.report.saved import Saved
from scan2fea.report.schema import read_report
from scan2fea.report.sections import object_section
from scan2fea.report.words import (
    NOT_KNOWN,
    check_name,
    count,
    dimensions,
    first_frequency_hz,
    headline,
    mass_kg,
    measured_share,
    millimetres,
    number,
    number_of,
    percent,
    quantity,
    worst_check,
)
from scan2fea.types import PointCloud

PAGE = "report.html"
PICTURE_PX = 700
FULL_SIZE_OBJECTS = 20  # above this the pictures shrink, so that the page stays within what a phone opens
STAGE_ROWS = 60
SEGMENT_ROWS = 60
LISTED_INPUTS = 4  # more push the picture of the scene off the first page
UNIT_SOURCES = {"format": "stated by the file", "option": "given by the user", "assumed": "ASSUMED"}
# nothing is fetched and nothing runs, whatever a file name holds
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def write_report(out: Path) -> Path:
    """Write `out`/report.html from `out`/report.json and the files beside it; returns its path.

    Works on what there is: no objects, failed objects, missing or damaged files. Raises InputError (FormatError) where report.json is missing
    or damaged, UsageError where the page cannot be written.
    """
    out = Path(out)
    page = render_page(Saved(out=out, report=read_report(out)))
    path = out / PAGE
    try:
        path.write_text(page, encoding="utf-8", newline="\n")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror}); free the disk or the folder and run `scan2fea run` with --resume") from error
    return path


def render_page(saved: Saved) -> str:
    """The whole page as text."""
    report, objects = saved.report, saved.report.get("objects") or []
    clouds = [saved.cloud(item) for item in objects]
    width_px = round(PICTURE_PX * min(1.0, math.sqrt(FULL_SIZE_OBJECTS / max(len(objects), 1))))

    def drawn(place: int) -> tuple[Html, tuple[float, ...] | None]:
        made = saved.geometry(objects[place], clouds[place])
        return object_section(objects[place], place, made, saved.files(objects[place]), max(width_px, 240)), made.size_m

    told = in_threads(drawn, range(len(objects)), at_most=2)  # the geometry of all at once may not fit into memory
    sections, sizes = [section for section, _ in told], [size for _, size in told]
    title = "scan2fea: " + headline(report)
    style = resources.files("scan2fea.report").joinpath("style.css").read_text(encoding="utf-8")
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(style)),
    )
    body = tag("body", tag("main", _top(report), _overview(saved, clouds, sizes), *sections, _method(saved), _glossary()))
    return f"<!DOCTYPE html>\n{tag('html', head, body, lang='en')}\n"


def _top(report: Mapping[str, Any]) -> Html:
    """The sentence, what came in, and how to repeat it."""
    command = [str(word) for word in report.get("command") or []]
    told = facts([("Version", report.get("version", "\u2013")), ("Seed", report.get("seed", "\u2013")), *_scene_facts(report)])
    return tag(
        "header",
        tag("p", "scan2fea report", class_="kicker"),
        tag("h1", headline(report)),
        _came_in(report.get("inputs") or []),
        told,
        tag("p", tag("b", "How to repeat: "), tag("code", shlex.join(command))) if command else NOTHING,
        *(tag("p", text, class_="note") for text in report.get("warnings") or []),
    )


def _scene_facts(report: Mapping[str, Any]) -> list[tuple[str, object]]:
    rows: list[tuple[str, object]] = []
    rows += [("Noise (\u03c3)", millimetres(report["noise_m"]))] if report.get("noise_m") is not None else []
    rows += [("Spacing of the points", millimetres(report["spacing_m"]))] if report.get("spacing_m") is not None else []
    shift = (report.get("frame") or {}).get("shift_m") or []
    rows += [("Shifted by", f"{', '.join(number(x, 9) for x in shift)} m (files are input minus this)")] if any(shift) else []
    return rows


def _came_in(inputs: Sequence[Mapping[str, Any]]) -> Html:
    """A row for each input; of many one sentence and those that were left out, the rest stands in "How it was done"."""
    if len(inputs) <= LISTED_INPUTS:
        return _inputs(inputs)
    names = [str(row.get("path")).replace("\\", "/").rpartition("/")[2] for row in inputs]
    units = ", ".join(dict.fromkeys(_unit(row) for row in inputs if row.get("used")))
    sensors = ", ".join(dict.fromkeys(str(row.get("sensor") or NOT_KNOWN) for row in inputs if row.get("used")))
    points = count(sum(int(row.get("n_points") or 0) for row in inputs))
    dates = ", ".join(dict.fromkeys(str(row["date"]) for row in inputs if row.get("date"))) or "not stated"
    told = f"{count(len(inputs))} inputs, {names[0]} to {names[-1]}: {points} points, unit {units}, sensor position {sensors}, date of data {dates}."
    return joined((tag("p", told), _inputs([row for row in inputs if not row.get("used")][:STAGE_ROWS])))


def _unit(row: Mapping[str, Any]) -> str:
    return f"{row['unit']} ({UNIT_SOURCES.get(str(row.get('unit_source')), 'source not recorded')})" if row.get("unit") else NOT_KNOWN


def _inputs(inputs: Sequence[Mapping[str, Any]]) -> Html:
    rows = []
    for row in inputs:
        used = "yes" if row.get("used") else f"no: {row.get('reason') or 'no reason given'}"
        cells = (figure_cell(count(row.get("n_points")), "points"), _unit(row), row.get("sensor") or "\u2013", row.get("date") or "not stated", used)
        folder, _, name = str(row.get("path")).replace("\\", "/").rpartition("/")
        rows.append([tag("span", tag("b", name, class_="path"), tag("span", f" in {folder}", class_="folder") if folder else NOTHING), *cells])
    return table(("input", "points", "unit", "sensor position", "date of the data", "used"), rows, class_="inputs") if rows else NOTHING


def _overview(saved: Saved, clouds: Sequence[PointCloud | None], sizes: Sequence[Sequence[float] | None]) -> Html:
    """The scene with numbers that lead to the objects, and the table of all objects: failed ones are not hidden."""
    objects = saved.report.get("objects") or []
    scene = scene_figure(saved.scene(), clouds)
    parts: list[Html] = [tag("h2", "Overview")]
    if scene is not None:
        figure, pins = scene
        overlay = [_pin(objects[k], k, *where) for k, where in pins.items()]
        parts.append(picture(figure, overlay, class_="picture scene"))
    parts.append(_objects(saved, sizes) if objects else tag("p", "There is no object to show."))
    parts.append(_segments(saved.report))
    return tag("section", *parts, class_="overview")


def _pin(item: Mapping[str, Any], place: int, left: float, top: float) -> Html:
    verdict = "good" if item.get("verdict") == "converted" else "bad"
    return tag("a", number_of(item), href=f"#{anchor(place)}", class_=f"pin {verdict}", style=f"left:{100 * left:.2f}%;top:{100 * top:.2f}%")


def _objects(saved: Saved, sizes: Sequence[Sequence[float] | None]) -> Html:
    head = ("no.", "kind", "verdict", "reason", "x, y, z, mm", "points", "measured", "worst check", "mass, kg", "first mode, Hz", "files")
    rows = []
    for place, item in enumerate(saved.report.get("objects") or []):
        worst = worst_check(item.get("checks") or [])
        told = "\u2013" if worst is None else f"{check_name(worst.get('name'))}: {quantity(worst.get('value'), str(worst.get('unit', '')))}"
        rows.append(
            [
                tag("a", number_of(item), href=f"#{anchor(place)}"),
                _kind(item, place),
                badge(item.get("verdict")),
                item.get("reason") or "no reason given",
                figure_cell(dimensions(sizes[place]).removesuffix(" mm"), "x, y, z, mm"),
                figure_cell(count(item.get("n_points")), "points"),
                figure_cell(percent(measured_share(item)), "measured"),
                told,
                figure_cell(number(mass_kg(item)), "mass, kg"),
                figure_cell(number(first_frequency_hz(item)), "first mode, Hz"),
                downloads(saved.files(item), TABLE_FILES),
            ]
        )
    return table(head, rows, class_="objects")


def _kind(item: Mapping[str, Any], place: int) -> Html:
    """The colour of the object in the picture of the scene, and what it is; how sure that is where it is a guess."""
    guess = item.get("guess") or {}
    told = str(item.get("kind") or "object")
    if not item.get("member") and guess.get("confidence") is not None and guess.get("kind") == item.get("kind"):
        told += f" ({percent(guess['confidence'])})"
    return swatches([(css(categories(np.array([place]))[0]), told, False)])


def _segments(report: Mapping[str, Any]) -> Html:
    """What the scene fell into, in the colours of its picture, and why each part is modelled or is not."""
    rows = []
    listed = report.get("segments") or []
    for row in listed[:SEGMENT_ROWS]:
        number_of_object = row.get("object")
        colour = css(BACKDROP if number_of_object is None else categories(np.array([int(number_of_object) - 1]))[0])
        sure = percent(row["confidence"]) if row.get("confidence") is not None else "given" if row.get("source") == "user" else ""
        size = dimensions(row.get("size_m") or []).removesuffix(" mm")
        kind = swatches([(colour, str(row.get("kind") or NOT_KNOWN), False)])
        figures = (figure_cell(sure, "sure"), figure_cell(size, "x, y, z, mm"), figure_cell(count(row.get("n_points")), "points"))
        rows.append([figure_cell(row.get("label"), "label"), kind, *figures, row.get("why") or NOT_KNOWN])
    if not rows:
        return NOTHING
    more = tag("p", f"and {len(listed) - SEGMENT_ROWS} more, see report.json") if len(listed) > SEGMENT_ROWS else NOTHING
    told = tag("p", "The kind is a guess from the points, with its probability; it decides nothing. labels.csv can be edited and the run resumed.")
    head = ("label", "kind", "sure", "x, y, z, mm", "points", "why it is modelled, or is not")
    return joined((tag("h3", "What the scene fell into"), table(head, rows, class_="objects segments"), more, told))


def _method(saved: Saved) -> Html:
    """Stages with counts, seconds and memory; options that were changed; what was assumed."""
    report = saved.report
    names = {str(row.get("id")): number_of(row) for row in report.get("objects") or []}
    parts: list[Html] = [tag("h2", "How it was done")]
    if len(report.get("inputs") or []) > LISTED_INPUTS:
        parts.append(joined((tag("h3", "What came in"), _inputs(report["inputs"]))))
    parts.append(_stages(report.get("stages") or [], names))
    changed = report.get("options_changed") or {}
    if changed:
        rows = [[tag("code", key), _value(row.get("value")), _value(row.get("default"))] for key, row in changed.items() if isinstance(row, Mapping)]
        parts.append(joined((tag("h3", "Options that differ from their defaults"), table(("option", "value", "default"), rows, class_="narrow"))))
    else:
        parts.append(tag("p", "All options have their default values."))
    for title, sentences in (("What was assumed", report.get("assumptions") or []), ("What could not be shown", sorted(saved.troubles))):
        parts.append(joined((tag("h3", title), tag("ul", *(tag("li", text) for text in sentences)))) if sentences else NOTHING)
    kept = [name for name in ("report.json", "config.toml", "log.jsonl", "labels.csv", "cloud.ply", "trajectory.txt") if saved.exists(name)]
    parts.append(tag("p", "Files of the run: ", joined((link(name, name) for name in kept), " \u00b7 "), class_="files"))
    versions = report.get("versions") or {}
    parts.append(
        tag("p", "Libraries: ", ", ".join(f"{name} {version}" for name, version in versions.items()), ".", class_="files") if versions else NOTHING
    )
    return tag("section", *parts, class_="method")


def _stages(stages: Sequence[Mapping[str, Any]], names: Mapping[str, str]) -> Html:
    """Every stage; where there are very many, those of the objects summed by name."""
    if len(stages) > STAGE_ROWS:
        stages = _summed(stages)
    rows = []
    for row in stages:
        of = row.get("object")
        kept = " (kept from an earlier run)" if row.get("resumed") or row.get("kept") else ""
        cells = [
            ("in", count(row.get("n_in"))),
            ("out", count(row.get("n_out"))),
            ("seconds", number(row.get("seconds"), 3)),
            ("memory, MB", number(row.get("peak_mb"), 3)),
        ]
        rows.append(
            [f"{row.get('name')}{kept}", "" if of is None else names.get(str(of), str(of)), *(figure_cell(value, label) for label, value in cells)]
        )
    return table(("stage", "object", "in", "out", "seconds", "memory, MB"), rows, class_="stages") if rows else tag("p", "No stage was recorded.")


def _summed(stages: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    sums: dict[tuple[str, bool], dict[str, Any]] = {}
    for row in stages:
        alone = row.get("object") is None
        total = sums.setdefault(
            (str(row.get("name")), alone),
            {"name": row.get("name"), "object": None if alone else "all", "n_in": 0, "n_out": 0, "seconds": 0.0, "peak_mb": 0.0},
        )
        for key in ("n_in", "n_out", "seconds"):
            total[key] += row.get(key) or 0
        total["peak_mb"] = max(total["peak_mb"], row.get("peak_mb") or 0.0)
    return list(sums.values())


def _value(value: Any) -> str:
    return "from the data" if value is None else ", ".join(str(part) for part in value) if isinstance(value, list) else str(value)


def _more(word: str) -> Html:
    """The page of the documentation that goes further; the report fetches nothing, so it is named, not linked."""
    return tag("span", f" (docs/{MORE[word]}.md)", class_="more") if word in MORE else NOTHING


def _glossary() -> Html:
    return tag(
        "section",
        tag("h2", "Glossary"),
        tag("dl", *(tag("div", tag("dt", word), tag("dd", meaning, _more(word))) for word, meaning in GLOSSARY), class_="glossary"),
    )
