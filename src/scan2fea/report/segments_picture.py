"""The picture of a segmented scene: each object in its own colour, floors and walls in grey."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.noise import sampled_rows, spacing
from scan2fea.report.camera import look_down
from scan2fea.report.colours import categories
from scan2fea.report.figures import DISC_SPACINGS, DRAWN_POINTS
from scan2fea.report.render import Dots, png, render
from scan2fea.types import PointCloud, Segments


def segments_picture(cloud: PointCloud, segments: Segments) -> bytes:
    """PNG of the points in the colours of their segments; what is no object is grey."""
    rows = sampled_rows(len(cloud), DRAWN_POINTS, 0)
    points = cloud.points[rows]
    number, shown = np.full(len(segments.kinds) + 1, -1, np.int64), 0
    for label, kind in enumerate(segments.kinds):
        if kind == "object":
            number[label], shown = shown, shown + 1
    colours = categories(number[segments.labels[rows]])
    camera = look_down(points)
    distance = spacing(points) if len(points) > 1 else np.nan
    radius = float(np.clip(DISC_SPACINGS * distance / camera.m_per_px, 0.8, 4.0)) if np.isfinite(distance) else 1.5
    return png(render(camera, (Dots(points=points, colours=colours, radius_px=radius),)))
