"""The picture of a trajectory: its way from above, height and angles over time, and how sure they are."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from scan2fea.report.charts import ticks
from scan2fea.types import FloatArray, Trajectory

WIDTH, HEIGHT = 1240, 720
_INK, _FAINT, _PAPER = (34, 38, 43), (205, 208, 212), (255, 255, 255)
_LINES, _BAND = ((0, 114, 178), (213, 94, 0), (0, 158, 115)), (206, 222, 236)
_MOST = 4000  # points of a line that are drawn
Box = tuple[int, int, int, int]


def trajectory_picture(trajectory: Trajectory, report: Mapping[str, Any]) -> bytes:
    """PNG. Without places only the angles are drawn."""
    from PIL import Image, ImageDraw
    from scipy.spatial.transform import Rotation

    known = np.flatnonzero(trajectory.placed) if trajectory.placed.any() else np.arange(len(trajectory.placed))
    rows = known[np.unique(np.linspace(0, len(known) - 1, _MOST).astype(int))]
    T = trajectory.T_world_frame[rows]
    time = (trajectory.time_s if trajectory.time_s is not None else np.arange(len(trajectory.T_world_frame), dtype=float))[rows]
    std = None if trajectory.covariance is None else np.sqrt(np.maximum(np.diagonal(trajectory.covariance[rows], axis1=1, axis2=2), 0.0))
    yaw, pitch, roll = np.degrees(Rotation.from_matrix(T[:, :3, :3]).as_euler("ZYX")).T
    yaw = np.degrees(np.unwrap(np.radians(yaw)))
    image = Image.new("RGB", (WIDTH, HEIGHT), _PAPER)
    draw = ImageDraw.Draw(image)
    placed = report["fusion"]["position"] == "estimated"
    left = 700 if placed else 70
    if placed:
        _way(draw, (70, 40, 620, HEIGHT - 60), T[:, :3, 3])
    t = time - time[0]
    panels: list[tuple[str, list[tuple[str, FloatArray]], FloatArray | None]] = [("roll, pitch (deg)", [("roll", roll), ("pitch", pitch)], None)]
    panels.append(("heading (deg)", [("heading", yaw)], None if std is None else 2 * np.degrees(std[:, 5])))
    if placed:
        panels.insert(0, ("height (m)", [("z", T[:, 2, 3])], None if std is None else 2 * std[:, 2]))
    if std is not None:
        panels.append(("standard deviation of x, y, z (mm)", [(name, 1e3 * std[:, k]) for k, name in enumerate("xyz")], None))
    high = (HEIGHT - 70) // len(panels)
    for k, (title, lines, band) in enumerate(panels):
        box = (left, 40 + k * high, WIDTH - 30, 40 + (k + 1) * high - 46)
        _panel(draw, box, t, title, lines, band)
    draw.text(((left + WIDTH) // 2 - 40, HEIGHT - 22), f"seconds after {time[0]:.3f}", fill=_INK)
    stream = io.BytesIO()
    image.save(stream, "PNG", compress_level=6)
    return stream.getvalue()


def _way(draw: Any, box: Box, place: FloatArray) -> None:
    """x to the right, y up, one scale; the start is a dot."""
    x0, y0, x1, y1 = box
    low, high = place[:, :2].min(axis=0), place[:, :2].max(axis=0)
    middle, span = 0.5 * (low + high), max(float((high - low).max()), 1e-6) * 1.08
    scale = min(x1 - x0, y1 - y0) / span
    at = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1)]) + (place[:, :2] - middle) * scale * [1.0, -1.0]
    half = 0.5 * np.array([x1 - x0, y1 - y0]) / scale
    for value in ticks(float(middle[0] - half[0]), float(middle[0] + half[0])):
        x = 0.5 * (x0 + x1) + (value - middle[0]) * scale
        draw.line([(x, y0), (x, y1)], fill=_FAINT)
        draw.text((x - 10, y1 + 6), f"{value:g}", fill=_INK)
    for value in ticks(float(middle[1] - half[1]), float(middle[1] + half[1])):
        y = 0.5 * (y0 + y1) - (value - middle[1]) * scale
        draw.line([(x0, y), (x1, y)], fill=_FAINT)
        draw.text((x0 - 42, y - 6), f"{value:g}", fill=_INK)
    draw.rectangle(box, outline=_INK)
    draw.line([tuple(point) for point in at.tolist()], fill=_LINES[0], width=2)
    draw.ellipse([at[0, 0] - 5, at[0, 1] - 5, at[0, 0] + 5, at[0, 1] + 5], fill=_LINES[1])
    draw.text((x0, y0 - 18), "way from above (m); the dot is the start", fill=_INK)


def _panel(draw: Any, box: Box, time: FloatArray, title: str, lines: list[tuple[str, FloatArray]], band: FloatArray | None) -> None:
    """Lines over time; a band of two standard deviations around the first."""
    x0, y0, x1, y1 = box
    ends = [column for _, column in lines] + ([] if band is None else [lines[0][1] - band, lines[0][1] + band])
    low, high = min(float(e.min()) for e in ends), max(float(e.max()) for e in ends)
    low, high = (low, high) if high - low > 1e-9 else (low - 1.0, high + 1.0)

    def down(values: FloatArray) -> FloatArray:
        return np.asarray(y1 - (values - low) / (high - low) * (y1 - y0))

    across = x0 + (time - time[0]) / max(float(time[-1] - time[0]), 1e-9) * (x1 - x0)
    for value in ticks(low, high, 5):
        y = float(down(np.array(value)))
        draw.line([(x0, y), (x1, y)], fill=_FAINT)
        draw.text((x0 - 52, y - 6), f"{value:g}", fill=_INK)
    for value in ticks(0.0, float(time[-1] - time[0]), 6):
        x = x0 + value / max(float(time[-1] - time[0]), 1e-9) * (x1 - x0)
        draw.line([(x, y1), (x, y1 + 4)], fill=_INK)
        draw.text((x - 8, y1 + 6), f"{value:g}", fill=_INK)
    if band is not None:
        edge = np.concatenate([np.c_[across, down(lines[0][1] - band)], np.c_[across, down(lines[0][1] + band)][::-1]])
        draw.polygon([tuple(point) for point in edge.tolist()], fill=_BAND)
    for k, (_, column) in enumerate(lines):
        draw.line([tuple(point) for point in np.c_[across, down(column)].tolist()], fill=_LINES[k])
    draw.rectangle(box, outline=_INK)
    draw.text((x0, y0 - 16), title + ("" if band is None else ", with two standard deviations"), fill=_INK)
    if len(lines) > 1:
        for k, (name, _) in enumerate(lines):
            draw.text((x1 - 60 * (len(lines) - k), y0 - 16), name, fill=_LINES[k])
