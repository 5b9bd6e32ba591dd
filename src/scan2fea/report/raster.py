"""The inner loops of the rasteriser: triangles, discs and lines into one picture with one depth buffer.

Screen points are (x right, y down, nearness) in pixels of the picture; pixel (row i, column j) has its centre at (j + 0.5, i + 0.5).
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import ByteArray, FloatArray, IntArray


@jit
def draw_triangles(screen: FloatArray, faces: IntArray, colour: FloatArray, image: FloatArray, depth: FloatArray) -> None:
    """Fill each triangle where it is nearest. screen : (n, 3).   faces : (m, 3).   colour : (m, 3 corners, 3), shaded.

    image : (h, w, 3) and depth : (h, w) are drawn into (they belong to the caller's canvas).
    """
    height, width = depth.shape
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, bx, by, cx, cy = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1], screen[c, 0], screen[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if not abs(area) > 1e-12:
            continue
        first_row = max(math.floor(min(ay, by, cy) - 0.5), 0)
        last_row = min(math.ceil(max(ay, by, cy)), height - 1)
        first_column = max(math.floor(min(ax, bx, cx) - 0.5), 0)
        last_column = min(math.ceil(max(ax, bx, cx)), width - 1)
        for i in range(first_row, last_row + 1):
            y = i + 0.5
            for j in range(first_column, last_column + 1):
                x = j + 0.5
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1 - u - v
                if u < 0 or v < 0 or w < 0:
                    continue
                near = u * screen[a, 2] + v * screen[b, 2] + w * screen[c, 2]
                if near > depth[i, j]:
                    depth[i, j] = near
                    for k in range(3):
                        image[i, j, k] = u * colour[face, 0, k] + v * colour[face, 1, k] + w * colour[face, 2, k]


@jit
def draw_discs(screen: FloatArray, colour: FloatArray, radius: float, image: FloatArray, depth: FloatArray) -> None:
    """A disc of `radius` pixels around each point that faces the viewer. colour : (n, 3)."""
    height, width = depth.shape
    for point in range(len(screen)):
        x, y, near = screen[point, 0], screen[point, 1], screen[point, 2]
        for i in range(max(math.ceil(y - radius - 0.5), 0), min(math.floor(y + radius - 0.5), height - 1) + 1):
            for j in range(max(math.ceil(x - radius - 0.5), 0), min(math.floor(x + radius - 0.5), width - 1) + 1):
                away = (j + 0.5 - x) ** 2 + (i + 0.5 - y) ** 2
                if away <= radius * radius and near > depth[i, j]:
                    depth[i, j] = near
                    for k in range(3):
                        image[i, j, k] = colour[point, k]


@jit
def draw_lines(screen: FloatArray, segments: IntArray, colour: FloatArray, lift: float, opacity: float, image: FloatArray, depth: FloatArray) -> None:
    """One pixel wide lines where nothing is nearer by more than `lift` pixels. segments : (m, 2).   colour : (3,)."""
    height, width = depth.shape
    for segment in range(len(segments)):
        a, b = segments[segment, 0], segments[segment, 1]
        dx, dy, dz = screen[b, 0] - screen[a, 0], screen[b, 1] - screen[a, 1], screen[b, 2] - screen[a, 2]
        steps = int(min(max(abs(dx), abs(dy)), 4.0 * (width + height))) + 1
        for step in range(steps):  # the last point belongs to the next line of the chain: not drawn twice
            t = step / steps
            i, j = math.floor(screen[a, 1] + t * dy), math.floor(screen[a, 0] + t * dx)
            if 0 <= i < height and 0 <= j < width and screen[a, 2] + t * dz + lift > depth[i, j]:
                for k in range(3):
                    image[i, j, k] += opacity * (colour[k] - image[i, j, k])


@jit
def shade_depth(image: FloatArray, depth: FloatArray, unit: float, start: float, strength: float, near: int, far: int) -> None:
    """Darken what lies behind what is next to it (eye-dome lighting, Boucheny 2009): it gives bare points their shape and things an outline.

    unit : pixels of depth that count as a full step.   start : share of a step that is let pass.   near, far : how far to look, pixels; far may be 0.
    """
    height, width = depth.shape
    reaches = (near, far)
    n = 8 if far > 0 else 4
    for i in range(height):
        for j in range(width):
            own = depth[i, j]
            if own == -math.inf:
                continue
            step = 0.0
            for reach in reaches:
                if reach == 0:
                    continue
                for side in range(4):
                    di = reach * (1 - side) if side % 2 == 0 else 0
                    dj = reach * (2 - side) if side % 2 == 1 else 0
                    other = depth[min(max(i + di, 0), height - 1), min(max(j + dj, 0), width - 1)]
                    step += min(max((other - own) / unit - start, 0.0), 1.0)
            if step > 0:
                dark = math.exp(-strength * step / n)
                for k in range(3):
                    image[i, j, k] *= dark


@jit
def blank(height: int, width: int, background: FloatArray) -> tuple[FloatArray, FloatArray]:
    """An empty picture (h, w, 3) and its depth (h, w), nothing anywhere near."""
    image, depth = np.empty((height, width, 3)), np.empty((height, width))
    for i in range(height):
        for j in range(width):
            depth[i, j] = -math.inf
            for k in range(3):
                image[i, j, k] = background[k]
    return image, depth


@jit
def averaged(image: FloatArray, s: int) -> ByteArray:
    """(h / s, w / s, 3) bytes: the mean of each s x s pixels."""
    height, width = image.shape[0] // s, image.shape[1] // s
    out = np.empty((height, width, 3), np.uint8)
    for i in range(height):
        for j in range(width):
            for k in range(3):
                total = 0.0
                for di in range(s):
                    for dj in range(s):
                        total += image[s * i + di, s * j + dj, k]
                out[i, j, k] = np.uint8(np.rint(min(max(total / s**2, 0.0), 255.0)))
    return out
