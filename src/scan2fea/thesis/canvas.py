"""Flat drawings as PNG: panels with axes, lines, dots, polygons and words; and pictures set side by side under their titles."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from scan2fea.report.charts import nice_step
from scan2fea.types import ByteArray, FloatArray

Colour = tuple[int, int, int]
INK, FAINT, BLUE, ORANGE, GREEN, RED = (34, 38, 43), (200, 204, 209), (0, 114, 178), (230, 159, 0), (0, 158, 115), (200, 60, 40)
PAPER = (250, 250, 248)
_FINE = 2  # drawn at twice the size and averaged down
_TITLE_PX = 15
_TEXT_PX = 12


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A rectangle of the drawing with its own axes. box : left, top, right, bottom in pixels of the finished picture."""

    draw: Any
    box: tuple[float, float, float, float]
    x: tuple[float, float]
    y: tuple[float, float]

    def at(self, points: npt.ArrayLike) -> FloatArray:
        """(n, 2) pixels of the fine picture."""
        p = np.asarray(points, float).reshape(-1, 2)
        left, top, right, bottom = self.box
        u = left + (p[:, 0] - self.x[0]) / (self.x[1] - self.x[0]) * (right - left)
        v = bottom - (p[:, 1] - self.y[0]) / (self.y[1] - self.y[0]) * (bottom - top)
        return np.stack([u, v], axis=1) * _FINE

    def line(self, points: npt.ArrayLike, colour: Colour = INK, width: float = 1.5, *, closed: bool = False) -> None:
        p = self.at(points)
        if len(p) > 1:
            ends = [tuple(q) for q in (np.vstack([p, p[:1]]) if closed else p).tolist()]
            self.draw.line(ends, fill=colour, width=max(1, round(width * _FINE)), joint="curve")

    def polygon(self, points: npt.ArrayLike, fill: Colour, outline: Colour | None = None) -> None:
        self.draw.polygon([tuple(q) for q in self.at(points).tolist()], fill=fill, outline=outline)

    def dots(self, points: npt.ArrayLike, colours: Colour | ByteArray = BLUE, radius: float = 2.0) -> None:
        p = self.at(points)
        every = np.broadcast_to(np.asarray(colours), (len(p), 3)).tolist()
        r = radius * _FINE
        for (u, v), colour in zip(p.tolist(), every, strict=True):
            self.draw.ellipse([u - r, v - r, u + r, v + r], fill=tuple(colour))

    def words(self, place: tuple[float, float], text: str, colour: Colour = INK, anchor: str = "mm", size: int = _TEXT_PX) -> None:
        u, v = self.at([place])[0].tolist()
        self.draw.text((u, v), text, fill=colour, anchor=anchor, font=_font(size * _FINE))

    def axes(self, x: str, y: str, *, ticks: bool = True) -> None:
        """A frame, round figures along it, and what is drawn along each axis."""
        left, top, right, bottom = (_FINE * b for b in self.box)
        self.draw.rectangle([left, top, right, bottom], outline=FAINT, width=_FINE)
        font = _font(_TEXT_PX * _FINE)
        if ticks:
            for value in _ticks(*self.x):
                u = self.at([(value, self.y[0])])[0, 0]
                self.draw.line([(u, bottom), (u, bottom + 4 * _FINE)], fill=INK, width=_FINE)
                self.draw.text((u, bottom + 6 * _FINE), f"{value:g}", fill=INK, anchor="mt", font=font)
            for value in _ticks(*self.y):
                v = self.at([(self.x[0], value)])[0, 1]
                self.draw.line([(left - 4 * _FINE, v), (left, v)], fill=INK, width=_FINE)
                self.draw.text((left - 6 * _FINE, v), f"{value:g}", fill=INK, anchor="rm", font=font)
        self.draw.text(((left + right) / 2, bottom + 22 * _FINE), x, fill=INK, anchor="mt", font=font)
        self.draw.text((left, top - 4 * _FINE), y, fill=INK, anchor="lb", font=font)


class Canvas:
    """A drawing of so many pixels."""

    def __init__(self, width: int, height: int) -> None:
        self.size = (width, height)
        self.image = Image.new("RGB", (width * _FINE, height * _FINE), PAPER)
        self.draw = ImageDraw.Draw(self.image)

    def panel(
        self, box: tuple[float, float, float, float], x: tuple[float, float], y: tuple[float, float], title: str = "", *, equal: bool = False
    ) -> Panel:
        """Axes in a rectangle of the drawing; equal : a metre is as long upwards as across, the box shrinks to it."""
        left, top, right, bottom = box
        if title:
            self.words(((left + right) / 2, top - 22), title)
        if equal:
            scale = min((right - left) / (x[1] - x[0]), (bottom - top) / (y[1] - y[0]))
            across, up = scale * (x[1] - x[0]), scale * (y[1] - y[0])
            left, top = left + (right - left - across) / 2, top + (bottom - top - up) / 2
            right, bottom = left + across, top + up
        return Panel(draw=self.draw, box=(left, top, right, bottom), x=x, y=y)

    def words(self, place: tuple[float, float], text: str, size: int = _TITLE_PX, anchor: str = "mt", colour: Colour = INK) -> None:
        self.draw.text((place[0] * _FINE, place[1] * _FINE), text, fill=colour, anchor=anchor, font=_font(size * _FINE))

    def png(self) -> bytes:
        return packed(np.asarray(self.image.resize(self.size, Image.Resampling.BOX)))


def packed(picture: ByteArray, n_colours: int = 160) -> bytes:
    """PNG with a palette."""
    few = Image.fromarray(picture).quantize(colors=n_colours, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    stream = io.BytesIO()
    few.save(stream, "PNG", compress_level=6)
    return stream.getvalue()


def tiles(pictures: Sequence[tuple[str, ByteArray]], columns: int = 2, below: str = "") -> bytes:
    """PNG of pictures (h, w, 3) in rows, each under its title; a line of words below all."""
    rows = [pictures[k : k + columns] for k in range(0, len(pictures), columns)]
    wide = max(image.shape[1] for _, image in pictures)
    band = _TITLE_PX + 13
    heights = [max(image.shape[0] for _, image in row) + band for row in rows]
    whole = Image.new("RGB", (wide * min(columns, len(pictures)), sum(heights) + (band if below else 0)), PAPER)
    draw = ImageDraw.Draw(whole)
    for r, row in enumerate(rows):
        top = sum(heights[:r])
        for c, (title, image) in enumerate(row):
            whole.paste(Image.fromarray(image), (c * wide + (wide - image.shape[1]) // 2, top + band))
            draw.text((c * wide + wide / 2, top + 6), title, fill=INK, anchor="mt", font=_font(_TITLE_PX))
    if below:
        draw.text((whole.width / 2, whole.height - band + 4), below, fill=INK, anchor="mt", font=_font(_TEXT_PX))
    return packed(np.asarray(whole))


def told(text: str, width: int = 700, height: int = 160) -> bytes:
    """PNG of a sentence: what stands in the place of a picture that could not be made."""
    canvas = Canvas(width, height)
    words, lines = text.split(), [""]
    for word in words:
        longer = f"{lines[-1]} {word}".strip()
        if len(longer) > 90:
            lines.append(word)
        else:
            lines[-1] = longer
    for k, line in enumerate(lines[:8]):
        canvas.words((14, 14 + 17 * k), line, 13, "lt")
    return canvas.png()


def _ticks(low: float, high: float) -> list[float]:
    step = nice_step(high - low)
    return [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def _font(size: int) -> Any:
    return ImageFont.load_default(size)
