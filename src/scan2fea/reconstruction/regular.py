"""Directions that planes share: where the noise does not speak against it, planes are turned to one rigid set of directions that all of them fix.

A face knows its place well and its tilt badly: a leg 60 mm wide with 200 points in 0.3 mm of noise leaves a milliradian open, which is a millimetre a
metre on. A rim of the same part two rows wide and a metre long fixes it twenty times as well, about one axis. So each plane brings the information
on its tilt (3, 3) into the frame, and is held against what frame and plane together would be, not against a direction taken as exact.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.transforms import rotation_about
from scan2fea.types import BoolArray, FloatArray, IntArray

TURN_DEG, UNLIKELY = 8.0, 13.8  # chi-square with two degrees of freedom exceeds 13.8 once in a thousand
WAYS_TRIED, ONE_WAY = 4, 1.0 - 1e-6
EXACT = 1e-9  # m: less noise is none
HARDLY = 1.05  # times the scatter: what points of next faces do near the edges of a small one
LINE = 0.5  # sine of the angle from which two planes give a line


def near_ways(known: FloatArray, normal: FloatArray) -> FloatArray:
    """(k, 3) directions that (m, 3) known normals give (theirs, and the lines in which two planes meet) near a normal: nearest first, each once."""
    first, second = np.triu_indices(len(known), 1)
    every = np.concatenate([known, np.cross(known[first], known[second])]).reshape(-1, 3)
    length = np.linalg.norm(every, axis=1)
    unit = every[length > LINE] / length[length > LINE, None]
    unit = np.where((unit @ normal > 0)[:, None], unit, -unit)
    cosine = unit @ normal
    order = np.argsort(-cosine, kind="stable")
    order = order[cosine[order] >= np.cos(np.radians(TURN_DEG))]
    return np.asarray(unit[order[_first_of_each(unit[order], cosine[order])]]).reshape(-1, 3)


@jit
def _first_of_each(unit: FloatArray, cosine: FloatArray) -> BoolArray:
    """(k,) the directions (k, 3) that none before them is; cosine : (k,) to the one they are sorted by, falling."""
    kept = np.zeros(len(unit), np.bool_)
    apart = 1.01 * np.sqrt(2.0 * (1.0 - ONE_WAY))  # directions that are one differ by no more, and so do their cosines
    for row in range(len(unit)):
        kept[row] = True
        other = row - 1
        while kept[row] and other >= 0 and cosine[other] - cosine[row] <= apart:
            kept[row] = not (kept[other] and (unit[row] * unit[other]).sum() >= ONE_WAY)
            other -= 1
    return kept


def regular(points: FloatArray, planes: list[Plane], label: IntArray, sigma_m: float) -> list[Plane]:
    """The planes, each along a direction of one frame: its own, one that another plane has too, or the line in which two of them meet.

    A plane joins a direction where the squares of its points (and of those of the frame, which turns as one) grow by less than chance allows once in
    a thousand, or by less than points of next faces do.   label : (n,) plane of each point, -1 none.
    """
    count = np.bincount(label[label >= 0], minlength=len(planes))
    ways = np.zeros((0, 3))
    information = np.zeros((3, 3))
    way_of = np.zeros(len(planes), np.int64)
    for k in np.argsort(-count, kind="stable").tolist():
        own = _trimmed(points[label == k], planes[k])
        scatter_matrix = _scatter(own)
        normal = planes[k].normal
        free = max(0.0, float(normal @ scatter_matrix @ normal))
        noise = max(sigma_m, float(np.sqrt(free / max(1, len(own)))))
        for way in near_ways(ways, normal)[:WAYS_TRIED]:
            tilt, turn = _turning(way, scatter_matrix, information)
            cost = float(way @ scatter_matrix @ way) + float(turn[1] @ turn[0])
            grown = cost - free
            if grown <= UNLIKELY * noise**2 or (sigma_m > EXACT and cost <= len(own) * (HARDLY * noise) ** 2):
                turned = rotation_about(turn[0], float(np.linalg.norm(turn[0]))) if turn[0].any() else np.eye(3)
                ways = ways @ turned.T
                way_of[k], ways = _numbered(ways, turned @ way)
                information = information + tilt
                break
        else:
            way_of[k], ways = len(ways), np.vstack([ways, normal])
            information = information + _turning(normal, scatter_matrix, information)[0]
    out: list[Plane] = []
    for k, plane in enumerate(planes):
        way = ways[way_of[k]]
        own = _trimmed(points[label == k], plane)
        height = own @ (way if way @ plane.normal > 0 else -way)
        out.append(Plane(normal=way if way @ plane.normal > 0 else -way, offset=float(height.mean()), rms_m=float(height.std())))
    return out


def _trimmed(own: FloatArray, plane: Plane) -> FloatArray:
    """The points of a plane without those that lie far off for it."""
    if not len(own):
        return own
    distance = np.abs(plane.distance(own))
    return own[distance <= max(3.5 * 1.4826 * float(np.median(distance)), 1e-15)]


def _scatter(own: FloatArray) -> FloatArray:
    """(3, 3) sum of squares of points about their mean."""
    local = own - own.mean(axis=0)
    return np.asarray(local.T @ local)


def _turning(way: FloatArray, scatter_matrix: FloatArray, information: FloatArray) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """Information of a plane along `way` on a small rotation w of the frame, and the best w with the slope it answers.

    Heights r of the points change by w . (way x (x - mean)), so the sum of squares is r'r + 2 b.w + w'(A + information) w.
    """
    across = np.array([[0.0, -way[2], way[1]], [way[2], 0.0, -way[0]], [-way[1], way[0], 0.0]])
    tilt = across @ scatter_matrix @ across.T
    slope = across @ scatter_matrix @ way
    return tilt, (-np.linalg.pinv(tilt + information, rcond=1e-12, hermitian=True) @ slope, slope)


def _numbered(ways: FloatArray, way: FloatArray) -> tuple[int, FloatArray]:
    """The row of a direction (either sense) among those of the frame; a line between two of them becomes a direction of its own."""
    if len(ways):
        best = int(np.argmax(np.abs(ways @ way)))
        if abs(float(ways[best] @ way)) > ONE_WAY:
            return best, ways
    return len(ways), np.vstack([ways, way])
