"""Where a scanner that was moved along a straight line saw each point from, told by the grid of its range image alone.

A laser stripe that is swept past a part (Cyberware and its like) writes a column per step, and in every column one point per row of its
camera. All columns lie on planes square to the sweep. A row is seen at one angle: looked at along the sweep its points lie on one line, and
these lines meet where the camera moves. A point was seen from the place of that track beside it: light and camera stand in its column, or a
little before and behind it.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from scan2fea.types import BoolArray, FloatArray, IntArray

ROWS, FEWEST = 16, 30  # rows of an image, and points of one, that are needed
DEEP = 10.0  # times as long as the row is rough: less says little of where its line leads
ON_LINE = 0.2  # steps: how far the points of a row lie off its line, in the median of the rows
SAME_PLACE = 1.0  # steps: how far the points of a column lie apart along the sweep
MEET = 0.1  # of the angle between the outermost rows: how badly they meet (rms)
LEAST_FAN = np.radians(1.0)  # between the outermost rows: less, and they may as well meet on the other side


def seen_from(points: FloatArray, row: IntArray, column: IntArray) -> FloatArray | None:
    """(n, 3) where each point (n, 3) was seen from; None where rows and columns (n,) of the image do not tell. Rows of -1 are of no image (nan)."""
    use = np.flatnonzero((row >= 0) & np.isfinite(points).all(axis=1))
    if len(use) < ROWS * FEWEST:
        return None
    centre = points[use].mean(axis=0)
    local, number = points[use] - centre, np.unique(column[use], return_inverse=True)[1]
    count = np.bincount(number)
    middle = np.stack([np.bincount(number, local[:, k]) / count for k in range(3)], axis=1)
    within = local - middle[number]
    frame = np.linalg.eigh(within.T @ within)[1].T  # rows: along the sweep, and two across
    if not _is_swept(local @ frame[0], middle @ frame[0], number, column[use]):
        return None
    step = float(np.median(np.abs(np.diff(middle @ frame[0]))))
    track = _track(local @ frame[1:].T, row[use], step)
    if track is None:
        return None
    out = np.full_like(points, np.nan)
    out[use] = centre + (local @ frame[0])[:, None] * frame[0] + track @ frame[1:]
    return out


def _is_swept(place: FloatArray, middle: FloatArray, number: IntArray, column: IntArray) -> bool:
    """Do the points of each column stand at one place along the sweep, and columns in their order, as far apart as their numbers say?"""
    if len(middle) < FEWEST:
        return False
    steps: FloatArray = np.diff(middle) / np.diff(np.unique(column)).astype(float)
    step = float(np.median(steps))
    apart: BoolArray = np.abs(place - middle[number]) <= 0.5 * SAME_PLACE * abs(step)
    return bool(step != 0.0 and (np.sign(steps) == np.sign(step)).all() and apart.mean() >= 0.99)


def _track(flat: FloatArray, row: IntArray, step: float) -> FloatArray | None:
    """(2,) where the lines of the rows meet, looked at along the sweep; None where they are no lines, few, parallel, or meet among the points.

    flat : (n, 2).   step : between two columns, m.
    """
    order = np.argsort(row, kind="stable")
    bounds = np.flatnonzero(np.diff(row[order], prepend=-1, append=-1))
    middles, ways, off = list[FloatArray](), list[FloatArray](), list[float]()
    for first, last in pairwise(bounds.tolist()):
        own = flat[order[first:last]]
        if len(own) < FEWEST:
            continue
        middle = own.mean(axis=0)
        size, axes = np.linalg.svd(own - middle, full_matrices=False)[1:]
        if size[0] >= DEEP * size[1]:
            middles.append(middle)
            ways.append(axes[0])
            off.append(float(size[1]) / np.sqrt(len(own)))
    if len(ways) < ROWS or np.median(off) > ON_LINE * step:
        return None
    way = np.array(ways)
    normal = np.stack([-way[:, 1], way[:, 0]], axis=1)
    height = np.einsum("ij,ij->i", normal, np.array(middles))
    meet = np.linalg.lstsq(normal, height, rcond=None)[0]
    angle = np.arctan2(way[:, 1], way[:, 0])
    fan = float(np.ptp((angle - angle[0] + 0.5 * np.pi) % np.pi))  # either sense of a line
    badly = float(np.sqrt(np.mean((normal @ meet - height) ** 2))) / float(np.linalg.norm(meet))
    is_outside = float((flat @ meet).max()) < float(meet @ meet)
    return meet if fan >= LEAST_FAN and badly <= MEET * fan and is_outside else None
