"""A beam with openings in its web is one body, though above and below them it looks like two members side by side.

Two parts of a cluster are one where they run side by side from end to end and touch, themselves or by what stands between them and is not slender,
along half their length or more, when stretches without touch count that are no longer than both together are deep: such are the openings of a
castellated or cellular beam (EN 1993-1-13, large web openings). The chords of a truss are joined by members, and farther apart than they are deep.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.spanning_tree import tree_parts
from scan2fea.segmentation.extents import Extent
from scan2fea.segmentation.sweeps import GAP, across
from scan2fea.types import FloatArray, IntArray

_NEIGHBOURS = 16
_ALONG = 0.5  # of its length that a part touches the other
_LONG = 6.0  # length over width of a member for which a cluster falls apart (`members`)
_LEAST = 3  # stretches of touch: two may be end plates
_TAIL, _INSIDE = 0.01, 0.8  # of the points: outside a box at each side; inside it at least


def with_openings(points: FloatArray, labels: IntArray, extents: Sequence[Extent], h: float, reach: float) -> IntArray:
    """Labels (n,) of points (n, 3) with parts of one body put together; part k < len(extents) has the box extents[k], others stay.

    h : spacing of the points.   reach : how far apart two points of one surface may lie, m.
    """
    slender = {k for k, extent in enumerate(extents) if extent.length >= _LONG * extent.width}
    pairs = [(a, b) for b in sorted(slender) for a in sorted(slender) if a < b and extents[a].ends_with(extents[b])]
    if not pairs:
        return labels
    distance, near = k_nearest(points, _NEIGHBOURS, points)
    i, j = np.nonzero((distance <= reach) & (labels[near] != labels[:, None]))
    touching = np.unique(np.stack([i, labels[near[i, j]]], 1), axis=0)  # a point, and another part that it touches
    joined: list[tuple[int, int]] = []
    for a, b in pairs:
        both = points[(labels == a) | (labels == b)]
        frame = _frame(both, extents[a].axis)
        posts = _posts(points, labels, touching, (a, b), frame, slender)
        between = np.isin(labels, posts)
        between[touching[(labels[touching[:, 0]] == a) & (touching[:, 1] == b), 0]] = True
        if _runs_along(points[between] @ frame[2], float(np.ptp(both @ frame[1])), min(extents[a].length, extents[b].length), GAP * h):
            joined += [(a, b), *((a, post) for post in posts)]
    return np.asarray(tree_parts(np.array(joined, np.int64), int(labels.max()) + 1)[labels]) if joined else labels


def _posts(points: FloatArray, labels: IntArray, touching: IntArray, pair: tuple[int, int], frame: FloatArray, slender: set[int]) -> list[int]:
    """Parts that are not slender, touch one of the pair and stay within the box of both: what is left of the web between openings.

    touching : (m, 2) point and the part it touches.   frame : (3, 3) of that box, rows.
    """
    own = points[np.isin(labels, pair)] @ frame.T
    low, high = np.quantile(own, [_TAIL, 1 - _TAIL], axis=0)
    low[2], high[2] = own[:, 2].min(), own[:, 2].max()
    beside = np.unique(labels[touching[np.isin(touching[:, 1], pair), 0]])
    flat = points @ frame.T
    within = ((flat >= low) & (flat <= high)).all(axis=1)
    return [int(part) for part in beside if part not in slender and within[labels == part].mean() >= _INSIDE]


def _runs_along(z: FloatArray, deep: float, length: float, slice_m: float) -> bool:
    """Whether places (k,) along the axis fill half of a length, m, with stretches between them that are no longer than the section is deep."""
    slices = np.unique(np.floor(z / slice_m).astype(np.int64))
    gaps = np.diff(slices) - 1
    if (gaps > 0).sum() + 1 < _LEAST:
        return False
    return bool((len(slices) + gaps[gaps * slice_m <= deep].sum()) * slice_m >= _ALONG * length)


def _frame(points: FloatArray, axis: FloatArray) -> FloatArray:
    """(3, 3) rows: the narrow and the deep side of the section of all the points (n, 3), and the axis."""
    u, v = across(axis)
    turn = np.linalg.eigh(np.cov(points @ u, points @ v))[1]
    return np.stack([turn[0, 0] * u + turn[1, 0] * v, turn[0, 1] * u + turn[1, 1] * v, axis])
