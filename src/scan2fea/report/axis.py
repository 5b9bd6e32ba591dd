"""The axis of a member, drawn from its side and from above: how far it leaves the straight line, and where something is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from scan2fea.report.charts import FAINT, TEXT, nice_step
from scan2fea.report.markup import NOTHING, Html, tag
from scan2fea.report.words import is_number, number
from scan2fea.types import FloatArray
from scan2fea.units import MILLIMETRES_PER_METRE

Row = Mapping[str, Any]
WIDTH, LANE, LEFT, RIGHT, TOP = 340, 58, 26, 12, 16
DRAWN_SAG = 20.0  # pixels that the largest sag takes, at most
STRAIGHT_M = 1e-6  # a sag below is none
ACROSS = (("x", "#1f78b4"), ("y", "#b35806"))
LOSS = "#a3261a"


def axis_drawing(member: Row) -> Html:
    """Sag along x and y of the section, enlarged by a stated factor; places of damage as crosses. Nothing where it is straight and whole."""
    length = (((member.get("parameters") or {}).get("length")) or {}).get("value_m")
    bow = _bow(member.get("bow_m"))
    if not is_number(length) or not length > 0 or member.get("bends"):  # the picture of the solid shows these
        return NOTHING
    at = np.linspace(0.0, 1.0, 61)
    series = np.concatenate([np.zeros((2, 2)), bow], axis=1)  # degrees 0 and 1 are the straight line itself
    sag = legendre.legval(2 * at - 1, series.T)
    sag = sag - (sag[:, :1] * (1 - at) + sag[:, -1:] * at)  # from the line between its ends
    largest = float(np.abs(sag).max())
    losses = _losses(member, float(length))
    if largest < STRAIGHT_M and not losses:
        return NOTHING
    scale = (WIDTH - LEFT - RIGHT) / float(length)
    factor = _round_down(DRAWN_SAG / (scale * largest)) if largest >= STRAIGHT_M else 0.0
    parts = []
    for lane, ((name, colour), off) in enumerate(zip(ACROSS, sag, strict=True)):
        base = TOP + LANE * (lane + 0.5)
        line = " ".join(f"{LEFT + scale * length * a:.1f},{base - factor * scale * d:.1f}" for a, d in zip(at.tolist(), off.tolist(), strict=True))
        parts.append(tag("line", x1=LEFT, x2=WIDTH - RIGHT, y1=f"{base:.1f}", y2=f"{base:.1f}", stroke=FAINT, stroke_width=1, stroke_dasharray="4 4"))
        parts.append(tag("polyline", points=line, fill="none", stroke=colour, stroke_width=2))
        parts.append(tag("text", name, x=8, y=f"{base + 4:.1f}", fill=TEXT))
        worst = int(np.abs(off).argmax())
        told = f"{number(float(off[worst]) * MILLIMETRES_PER_METRE, 3)} mm"
        if abs(off[worst]) >= STRAIGHT_M:
            x, y = LEFT + scale * length * at[worst], base - factor * scale * off[worst]
            parts.append(tag("text", told, x=f"{x:.1f}", y=f"{y - 5 if off[worst] > 0 else y + 14:.1f}", text_anchor="middle", fill=TEXT))
        for z in losses:
            x = LEFT + scale * z
            cross = f"M{x - 4:.1f} {base - 4:.1f} l8 8 m0 -8 l-8 8"
            parts.append(tag("path", d=cross, stroke=LOSS, stroke_width=2, fill="none"))
    shown = f"largest sag {number(largest * MILLIMETRES_PER_METRE, 3)} mm, drawn {number(factor)} times larger than the length"
    told = shown if factor else "straight"
    marked = f"; {len(losses)} places of damage as crosses" if losses else ""
    svg = tag(
        "svg", tag("title", f"Axis along the length: {told}{marked}."), *parts, viewBox=f"0 0 {WIDTH} {TOP + 2 * LANE}", role="img", font_size="12",
        font_family="system-ui, sans-serif",
    )  # fmt: skip
    return tag("figure", svg, tag("figcaption", tag("b", "Axis"), f", across x and y of the section: {told}{marked}."), class_="chart")


def _bow(value: object) -> FloatArray:
    """(2, k) Legendre coefficients from degree 2 on; none where the record holds no sound ones."""
    try:
        found = np.asarray(value if value is not None else np.zeros((2, 0)), float)
    except (TypeError, ValueError):
        return np.zeros((2, 0))
    return found if found.ndim == 2 and found.shape[0] == 2 and np.isfinite(found).all() else np.zeros((2, 0))


def _losses(member: Row, length: float) -> list[float]:
    """Places of damage along the axis, metres from its first end."""
    try:
        T = np.asarray(member.get("T_world_member"), float).reshape(4, 4)
        places: Sequence[Any] = member.get("damage") or ()
        along = [float((np.asarray(p["position_m"], float) - T[:3, 3]) @ T[:3, 2]) for p in places]
    except (TypeError, ValueError, KeyError):
        return []
    return [z for z in along if 0 <= z <= length]


def _round_down(factor: float) -> float:
    step = nice_step(factor, 1)
    return step if step <= factor * (1 + 1e-9) else nice_step(factor / 2.5, 1)
