"""thesis.html: every table and figure by the thesis's own number, in one file that fetches nothing."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from importlib import resources

from scan2fea import __version__
from scan2fea.report.markup import NOTHING, Html, figure_cell, table, tag
from scan2fea.thesis.bench import ThesisOptions
from scan2fea.thesis.experiment import Cell, Experiment, Made, Table
from scan2fea.thesis.published import blanks, source
from scan2fea.thesis.registry import EXPERIMENTS, REPRINTED

CHAPTERS = {
    "2": "Background", "3": "Approach", "4.1": "Results: zero noise", "4.2": "Results: noise of 2 cm", "4.3": "Results: HDL-32E",
    "4.4": "Results: informed shape estimation", "5": "Conclusion: boundary representations and finite elements", "H": "The two hypotheses",
}  # fmt: skip
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
STYLE = """
main{max-width:1440px} section.x{margin:1.6rem 0;border-top:1px solid #d5d9dd;padding-top:.6rem} section.x img{max-width:100%;height:auto}
.x table{font-size:.8rem} .x td,.x th{padding:.25rem .35rem} .x td:last-child:not(.n){min-width:11rem} .x .fail{color:var(--bad)}
.x>p{max-width:62rem} .wide{overflow-x:auto} nav a{margin-right:.6rem}
tr.published td{background:#f3f1e8} tr.best td{background:#e8f1ea}
@media screen and (prefers-color-scheme:dark){tr.published td{background:#35322a} tr.best td{background:#1d3528}}
@media screen and (max-width:760px){.x td:not(.n){min-width:6.5rem}}
@media print{.x table{font-size:6pt} .x td,.x th{padding:.2mm .5mm} .x td:last-child:not(.n){min-width:0} tr,img{break-inside:avoid}}
"""


def render_page(made: Mapping[str, Made], options: ThesisOptions) -> str:
    """The whole page; experiments that were not run are named at its end. No time and no path is in it."""
    style = resources.files("scan2fea.report").joinpath("style.css").read_text(encoding="utf-8")
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", "scan2fea: the thesis, reproduced"),
        tag("style", Html(style + STYLE)),
    )
    blocks: list[Html] = []
    for key, title in CHAPTERS.items():
        own = [experiment for experiment in EXPERIMENTS.values() if experiment.id in made and chapter_of(experiment) == key]
        if own:
            blocks.append(tag("h2", f"{key} {title}", id=f"c{key}"))
            blocks += [_block(experiment, made[experiment.id]) for experiment in own]
    body = tag("body", tag("main", _top(made, options), *blocks, _blanks(made), _rest(made)))
    return f"<!DOCTYPE html>\n{tag('html', head, body, lang='en')}\n"


def chapter_of(experiment: Experiment) -> str:
    """Key of CHAPTERS."""
    return next((key for key in CHAPTERS if experiment.section == key or experiment.section.startswith(f"{key}.")), experiment.section[0])


def _top(made: Mapping[str, Made], options: ThesisOptions) -> Html:
    failed = [name for name, item in made.items() if item.failed]
    said = f"{len(made) - len(failed)} of {len(EXPERIMENTS)} experiments made" + (f", {len(failed)} failed: {', '.join(failed)}" if failed else "")
    links = [tag("a", f"{key} {title}", href=f"#c{key}") for key, title in CHAPTERS.items()]
    links.append(tag("a", "What the thesis left to be written", href="#blanks"))
    quick = "Quick run: smaller inputs, told where they are used. " if options.quick else ""
    stopped = "ODT, perturbation and exudation were stopped by a clock, and their figures depend on the machine"
    clock = "" if options.clock_s is None else f"{stopped} ({options.clock_s:g} s). "
    return tag(
        "header",
        tag("p", f"scan2fea {__version__}, seed {options.seed}", class_="kicker"),
        tag("h1", "The thesis, reproduced"),
        tag("p", source() + "."),
        _sentence(f"{said}. {quick}{clock}Numbers of the thesis are marked published; every other number on this page was computed by this run. "
                  "'Same method' is the thesis's own chain, 'best route' what `scan2fea run` does with the same cloud."),
        tag("nav", *links),
    )  # fmt: skip


def _block(experiment: Experiment, made: Made) -> Html:
    kind = {"F": "Figure", "T": "Table", "S": "Section", "H": "Hypothesis"}[experiment.id[0]]
    content: list[Html] = [tag("h3", f"{kind} {experiment.id[1:]}: {experiment.title}"), tag("p", f"section {experiment.section}", class_="kicker")]
    if made.failed:
        content.append(tag("p", f"Not made: {made.failed}", class_="fail"))
    if made.picture:
        data = "data:image/png;base64," + base64.b64encode(made.picture).decode("ascii")
        content.append(tag("img", src=data, alt=f"{experiment.title}. {' '.join(made.says)}"[:400]))
    if made.table is not None:
        content.append(tag("div", _table(made.table), class_="wide"))
    content += [_sentence(text) for text in made.says]
    return tag("section", *content, class_="x", id=experiment.id)


def _sentence(text: str) -> Html:
    """A paragraph; what stands between backticks is code."""
    return tag("p", *(tag("code", part) if k % 2 else part for k, part in enumerate(text.split("`"))))


def _table(given: Table) -> Html:
    classes = []
    for row in given.rows:
        words = [cell for cell in row[:3] if isinstance(cell, str)]
        classes.append("published" if "published" in words else "best" if any("best route" in word for word in words) else "")
    return table(given.head, [[_cell(cell, name) for cell, name in zip(row, given.head, strict=True)] for row in given.rows], row_classes=classes)


def _cell(cell: Cell, name: str) -> Html | str:
    if cell is None:
        return figure_cell("\u2013", name)
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, int | float):
        return figure_cell("\u2013" if not math.isfinite(cell) else f"{cell:,}" if isinstance(cell, int) else f"{cell:.4g}", name)
    return cell


def _blanks(made: Mapping[str, Made]) -> Html:
    """Where on the page each blank of the thesis is filled."""
    rows = []
    for blank in blanks():
        links = [tag("a", name, href=f"#{name}") if name in made else f"{name} (not run here)" for name in blank.at]
        rows.append((blank.section, blank.asks, tag("span", *(part for link in links for part in (link, " ")))))
    head = ("section", "what is asked there", "answered at")
    return tag("section", tag("h2", "What the thesis left to be written", id="blanks"), table(head, rows))


def _rest(made: Mapping[str, Made]) -> Html:
    missing = [name for name in EXPERIMENTS if name not in made]
    notes = [tag("p", f"Not run here: {', '.join(missing)}.")] if missing else []
    other = "; ".join(f"{name[1:]} ({what})" for name, what in REPRINTED.items())
    notes.append(tag("p", f"Figures that the thesis reprints from others, or schemes without data, are not redrawn: {other}."))
    return tag("section", *notes) if notes else NOTHING
