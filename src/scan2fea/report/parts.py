"""Pieces that every section of the page is built from: pictures with their scale, verdict badges, lists of facts."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from scan2fea.report.charts import nice_step
from scan2fea.report.figures import Figure
from scan2fea.report.markup import NOTHING, Html, figure_cell, joined, link, table, tag
from scan2fea.report.words import millimetres, number

SCALE_SHARE = 0.3  # of the width of a picture that its scale bar may take
FILE_WORDS: Mapping[str, str] = {
    "model.step": "STEP",
    "model.inp": "deck (Abaqus, CalculiX)",
    "model.bdf": "deck (Nastran)",
    "surface.stl": "STL",
    "surface.ply": "surface",
    "sheet.ply": "open sheet",
    "volume.vtu": "mesh (VTU)",
    "volume.msh": "mesh (Gmsh)",
    "cloud.ply": "points",
    "as_built.ply": "points against the drawing",
    "drawing.step": "drawing where the part lies",
}
TABLE_FILES = {"model.step": "STEP", "model.inp": "deck", "surface.stl": "STL"}


def badge(verdict: object) -> Html:
    """The verdict in colour, shape and word."""
    good = verdict == "converted"
    return tag("span", "\u2713 converted" if good else "\u2717 failed", class_=f"badge {'good' if good else 'bad'}")


def mark(passed: object) -> Html:
    return tag("span", "\u2713 passed" if passed else "\u2717 failed", class_="good" if passed else "bad")


def anchor(place: int) -> str:
    """Name of an object's section; by place, since an id is the file's and may be anything."""
    return f"object-{place + 1}"


def picture(figure: Figure, overlay: Iterable[Html] = (), class_: str = "picture") -> Html:
    """A figure with its scale bar drawn over the picture (text stays readable when the picture shrinks) and its legend below."""
    source = "data:image/png;base64," + base64.b64encode(figure.png).decode("ascii")
    image = tag("img", src=source, alt=figure.alt, width=figure.width_px, height=figure.height_px)
    frame = tag("div", image, *overlay, _scale_bar(figure), class_="frame")
    return tag("figure", tag("b", figure.title, class_="title"), frame, figure.legend, tag("figcaption", figure.caption), class_=class_)


def facts(rows: Sequence[tuple[str, object]]) -> Html:
    """Name and value, several to a line where there is room."""
    return tag("dl", *(tag("div", tag("dt", name), tag("dd", value)) for name, value in rows), class_="facts")


def downloads(files: Iterable[str], words: Mapping[str, str] | None = None) -> Html:
    """Links to files beside the page; with `words` only to those named in it."""
    listed = {path.rsplit("/", 1)[-1]: path for path in files}
    names = [name for name in (words or listed) if name in listed]
    links = joined((link(listed[name], (words or FILE_WORDS).get(name, name)) for name in names), " \u00b7 ")
    return tag("span", links or "\u2013")


def quality_table(quality: Mapping[str, Mapping[str, Any]]) -> Html:
    """One row per measure: least, first percentile, median."""
    rows = []
    for name, spread in quality.items():
        cells = [figure_cell(number(spread.get(key)), label) for key, label in (("min", "least"), ("p01", "1 %"), ("median", "median"))]
        rows.append([name.replace("_deg", ", \u00b0").replace("_", " "), *cells])
    return table(("measure", "least", "1 %", "median"), rows, class_="narrow") if rows else NOTHING


def section(title: str, *content: Html, class_: str = "part") -> Html:
    """A part of an object's section; left out where it has no content."""
    held = [part for part in content if part]
    return tag("section", tag("h3", title), *held, class_=class_) if held else NOTHING


def _scale_bar(figure: Figure) -> Html:
    width_m = figure.width_px * figure.scale_m_per_px
    length = nice_step(width_m * SCALE_SHARE, 1)
    length = length if length <= width_m * SCALE_SHARE * 1.001 else nice_step(width_m * SCALE_SHARE / 2.5, 1)
    return tag("div", tag("span", millimetres(length)), class_="scale", style=f"width:{100 * length / width_m:.3g}%")
