"""Small charts as SVG: histograms with their limits, bars, shares, colour bars. No library, no script."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.report.colours import css
from scan2fea.report.markup import NOTHING, Html, tag
from scan2fea.report.words import number, percent
from scan2fea.types import ByteArray, FloatArray

WIDTH, HEIGHT = 340, 184
LEFT, RIGHT, TOP, BOTTOM = 12, 12, 36, 40
TEXT, FAINT, BAR, ALARM = "#22262b", "#b9bec4", "#5b86a8", "#a3261a"

Palette = Callable[[FloatArray], ByteArray]


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A line across a histogram: where it stands and what it says."""

    at: float
    label: str


def nice_step(span: float, n: int = 5) -> float:
    """A step of 1, 2 or 5 times a power of ten, about n of which make `span`."""
    if not span > 0 or not math.isfinite(span):
        return 1.0
    raw = span / n
    power = 10.0 ** math.floor(math.log10(raw))
    return next((step * power for step in (1.0, 2.0, 5.0) if step * power >= raw * (1 - 1e-9)), 10.0 * power)


def ticks(low: float, high: float, n: int = 5) -> list[float]:
    """Round values within [low, high]."""
    step = nice_step(high - low, n)
    return [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def histogram(
    values: FloatArray,
    *,
    low: float,
    high: float,
    axis: str,
    title: str,
    limits: Sequence[Limit] = (),
    palette: Palette | None = None,
    n_bins: int = 40,
) -> Html:
    """Counts of `values` between low and high; what lies beyond is counted in the last bars and said.

    palette : share of the range -> colour, the same as in the picture beside; None: one colour.
    """
    values = np.asarray(values, float)
    values = values[np.isfinite(values)]
    if not len(values) or not high > low:
        return NOTHING
    beyond = int(((values < low) | (values > high)).sum())
    counts, edges = np.histogram(np.clip(values, low, high), bins=n_bins, range=(low, high))
    tall = counts.max()
    wide = (WIDTH - LEFT - RIGHT) / n_bins
    middle = ((edges[:-1] + edges[1:]) / 2 - low) / (high - low)
    colours = [BAR] * n_bins if palette is None else [css(colour) for colour in palette(middle)]
    parts = []
    for k in np.flatnonzero(counts):
        size = max((HEIGHT - TOP - BOTTOM) * counts[k] / tall, 0.8)
        parts.append(
            tag(
                "rect",
                x=f"{LEFT + k * wide:.1f}",
                y=f"{HEIGHT - BOTTOM - size:.1f}",
                width=f"{wide * 0.94:.2f}",
                height=f"{size:.1f}",
                fill=colours[k],
                stroke="#6b7178",
                stroke_width="0.3",
            )
        )
    parts += _axis(low, high, axis) + [mark for k, limit in enumerate(limits) for mark in _limit(limit, low, high, 14 * (k % 2))]
    told = f"{len(values):,} values, median {number(float(np.median(values)))}, from {number(float(values.min()))} to {number(float(values.max()))}"
    if beyond:
        told += f"; {percent(beyond / len(values))} beyond the axis, counted in the outermost bars"
    note = tag("figcaption", tag("b", title), f". {told}.")
    return tag("figure", _svg(parts, f"Histogram: {title}, {axis}. {told}."), note, class_="chart")


def bars(rows: Sequence[tuple[str, float, str]], *, title: str, caption: str = "") -> Html:
    """Horizontal bars. rows : label, length, what is written at the end."""
    longest = max((row[1] for row in rows), default=0.0)
    if not longest > 0:
        return NOTHING
    line = 24
    parts = []
    for k, (label, value, written) in enumerate(rows):
        y = 4 + k * line
        size = max(value, 0) / longest * (WIDTH - 208)
        parts.append(tag("text", _short(label, 19), x=112, y=y + 14, text_anchor="end", fill=TEXT))
        parts.append(tag("rect", x=118, y=y + 3, width=f"{max(size, 0.8):.1f}", height=line - 9, fill=BAR))
        parts.append(tag("text", written, x=f"{122 + size:.1f}", y=y + 14, fill=TEXT))
    told = "; ".join(f"{label} {written}" for label, _, written in rows)
    note = tag("figcaption", tag("b", title), f". {caption}" if caption else ".")
    return tag("figure", _svg(parts, f"Bars: {title}. {told}.", 8 + line * len(rows)), note, class_="chart")


def ridges(rows: Sequence[tuple[str, Sequence[int], str]], *, low: float, high: float, axis: str, title: str) -> Html:
    """Histograms one below the other on one axis. rows : label, counts from low to high, what is written at the end.

    Heights are roots of the counts, all to one scale: a handful of bad elements among many thousands is what they are there to show.
    """
    tall = max((max(counts, default=0) for _, counts, _ in rows), default=0)
    if not tall or not high > low:
        return NOTHING
    line, floor = 40, 4 + 40 * len(rows)
    parts = []
    for k, (label, counts, written) in enumerate(rows):
        base = 4 + (k + 1) * line
        wide = (WIDTH - LEFT - RIGHT) / len(counts)
        for i, n in enumerate(counts):
            if n:
                size = max((line - 16) * math.sqrt(n / tall), 0.8)
                spot = {"x": f"{LEFT + i * wide:.1f}", "y": f"{base - size:.1f}", "width": f"{wide * 0.94:.2f}", "height": f"{size:.1f}"}
                parts.append(tag("rect", **spot, fill=BAR))
        parts.append(tag("line", x1=LEFT, x2=WIDTH - RIGHT, y1=base, y2=base, stroke=FAINT, stroke_width=1))
        parts.append(tag("text", _short(label, 19), x=LEFT, y=base - line + 12, fill=TEXT))
        parts.append(tag("text", written, x=WIDTH - RIGHT, y=base - line + 12, text_anchor="end", fill=TEXT))
    for value in ticks(low, high):
        parts.append(tag("text", number(value), x=f"{_x(value, low, high):.1f}", y=floor + 16, text_anchor="middle", fill=TEXT))
    parts.append(tag("text", axis, x=WIDTH / 2, y=floor + 32, text_anchor="middle", fill=TEXT))
    told = "; ".join(f"{label} {written}" for label, _, written in rows)
    note = tag("figcaption", tag("b", title), ". Heights are roots of the counts.")
    return tag("figure", _svg(parts, f"Histograms: {title}, {axis}. {told}.", floor + 40), note, class_="chart")


def colour_bar(anchors: str, low: str, middle: str, high: str, label: str) -> Html:
    """The scale under a picture: a strip of the palette (a CSS gradient) with its ends and its unit."""
    strip = tag("div", class_="strip", style=f"background:{anchors}")
    ends = tag("div", tag("span", low), tag("span", middle), tag("span", high), class_="ends")
    return tag("div", tag("div", label, class_="scale-name"), strip, ends, class_="colourbar")


def swatches(items: Sequence[tuple[str, str, bool]]) -> Html:
    """A legend: colour, text, hatched or not."""
    return tag(
        "ul",
        *(tag("li", tag("i", style=f"background-color:{colour}", class_="hatched" if hatched else None), text) for colour, text, hatched in items),
        class_="legend",
    )


def _axis(low: float, high: float, name: str) -> list[Html]:
    base = HEIGHT - BOTTOM
    parts = [tag("line", x1=LEFT, x2=WIDTH - RIGHT, y1=base, y2=base, stroke=TEXT, stroke_width=1)]
    for value in ticks(low, high):
        x = _x(value, low, high)
        parts.append(tag("line", x1=f"{x:.1f}", x2=f"{x:.1f}", y1=base, y2=base + 4, stroke=TEXT, stroke_width=1))
        parts.append(tag("text", number(value), x=f"{x:.1f}", y=base + 16, text_anchor="middle", fill=TEXT))
    parts.append(tag("text", name, x=WIDTH / 2, y=HEIGHT - 6, text_anchor="middle", fill=TEXT))
    return parts


def _limit(limit: Limit, low: float, high: float, drop: int) -> list[Html]:
    if not low <= limit.at <= high:
        return []
    x = _x(limit.at, low, high)
    anchor = "start" if x < WIDTH * 0.25 else "end" if x > WIDTH * 0.75 else "middle"
    line = tag("line", x1=f"{x:.1f}", x2=f"{x:.1f}", y1=TOP - 20 + drop, y2=HEIGHT - BOTTOM, stroke=ALARM, stroke_width=1.4, stroke_dasharray="4 3")
    return [line, tag("text", limit.label, x=f"{x:.1f}", y=TOP - 24 + drop, text_anchor=anchor, fill=ALARM)]


def _x(value: float, low: float, high: float) -> float:
    return LEFT + (WIDTH - LEFT - RIGHT) * (value - low) / (high - low)


def _svg(parts: Sequence[Html], alt: str, height: int = HEIGHT) -> Html:
    return tag("svg", tag("title", alt), *parts, viewBox=f"0 0 {WIDTH} {height}", role="img", font_size="12", font_family="system-ui, sans-serif")


def _short(label: str, n: int) -> str:
    return label if len(label) <= n else label[: n - 1] + "\u2026"
