"""Members that touch, told apart: a frame, a truss, a beam on its column is one piece of a cloud but several objects of a structure.

1. Every point takes the direction in which its surface runs farthest (`sweeps`); neighbours of one direction make a piece.
2. A piece is cut where its section stops being there and another member passes: two beams in line on both sides of a column are two.
3. Pieces that lie along each other, or go on in line with the same section, are one member: the flanges and the web of a haunched beam, a bar that
   an obstacle hides in part.
4. What is left (ends, stiffeners, bolts) goes to the member it lies on; what sticks out, or lies flat on a member as a second body (`lying_on`), is
   an object of its own.

A cluster falls apart only if it is more than one section led on (`led_on`) and mostly made of members, and of two or more that are long, or of a
girder and a brace: a table, a vessel on legs, a tee of two stubs stay whole.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from scan2fea.kernel.neighbors import k_nearest, radius_components
from scan2fea.kernel.pipe_path import pipe_path
from scan2fea.kernel.spanning_tree import tree_parts
from scan2fea.segmentation.extents import Extent, extent_of
from scan2fea.segmentation.leaves import apart_from_leaves, leaves_of, share_of_surfaces
from scan2fea.segmentation.led_on import is_one
from scan2fea.segmentation.lying_on import lying_on
from scan2fea.segmentation.pieces import LEAST_PIECE, LINK, NORMAL_NEIGHBOURS, Thin, pieces, thinned
from scan2fea.segmentation.sweeps import GAP, ONE_FACE, SHOWS, SLICE, across, run_lengths, slice_profile
from scan2fea.segmentation.web_openings import with_openings
from scan2fea.types import BoolArray, FloatArray, IntArray

LONG = 6.0  # a member's length over the larger side of its section, for a cluster to fall apart because of it
_BEAM = 3.0  # the same of a girder and its brace: below it EN 1992-1-1, 5.3.1 calls a beam, or a column, by another name
_STUB = 2.5  # the same for what else becomes a member once it does
_EXPLAINED = 0.6  # of the points must lie on long members
_LEAST = 300
_ALONG = 0.5  # of its length that a piece lies along another to be one with it
_IN_LINE = 0.97  # cosine of 14 degrees
_OBLIQUE = 0.26  # cosine of 75 degrees
_ALIKE = 1.35  # ratio of widths that still is the same section
_MOST_CUTS, _MOST_CELLS = 40, 2e6
_SHORT, _INSIDE = 0.25, 0.8  # a piece of less than a quarter of the length must lie within the other's box to be one with it


def members(points: FloatArray, seed: int = 0, min_points: int = 100, slenderness: float = LONG) -> IntArray:
    """(n,) labels from 0 of the members that one connected cluster (n, 3) is made of; all 0 where it is one object.

    slenderness : length over width of the two or more that make it fall apart.
    What leaves hide is looked for without them, and found only where it is members, two or more: the noise of a thin beam looks like leaves, too.
    """
    whole = np.zeros(len(points), np.int64)
    thin = thinned(points, seed) if len(points) >= _LEAST else None
    if thin is None:
        return whole
    labels = _of_surfaces(points, thin, min_points, seed, slenderness)
    leaf = leaves_of(thin.points) if labels.max() == 0 else None
    if leaf is None:
        return labels
    found: list[int] = []

    def of_part(own: FloatArray) -> IntArray:
        part = thinned(own, seed)
        inside = np.zeros(len(own), np.int64) if part is None else _of_surfaces(own, part, min_points, seed, slenderness)
        found.append(int(inside.max()) + 1)
        return inside

    labels = apart_from_leaves(points, leaf[thin.of_point], LINK * thin.h, min_points, of_part)
    return labels if max(found, default=0) > 1 else whole


def _of_surfaces(points: FloatArray, thin: Thin, min_points: int, seed: int, slenderness: float) -> IntArray:
    """`members` of points (n, 3) that lie on surfaces."""
    whole = np.zeros(len(points), np.int64)
    piece, axes = pieces(thin, seed)
    piece = _cut(thin, _shortened(thin, piece, axes), axes)
    if len(np.unique(piece[piece >= 0])) < 2:
        return whole
    group = _joined(thin, piece)
    chosen = _members_of(thin, group, slenderness)
    if chosen is None or is_one(thin, group) or pipe_path(points, seed) is not None:  # a pipe with elbows
        return whole
    member, extents = chosen
    filled = _filled(thin, _run_through(thin, member, extents), extents)
    labels = with_openings(thin.points, filled, extents, thin.h, LINK * thin.h)[thin.of_point]
    own = np.unique(labels[filled[thin.of_point] < len(extents)])
    lies = lying_on(points, thin.normals[thin.of_point], filled[thin.of_point], extents, thin.spacing, thin.sigma)
    labels, lies = _to_neighbours(points, labels, lies, extents, thin)
    labels = _apart(points, labels, lies | ~np.isin(labels, own), LINK * thin.h, min_points)
    counts = np.bincount(labels)
    if (counts < min_points).any():
        large = counts >= min_points
        if large.sum() < 2:
            return whole
        rows = np.flatnonzero(large[labels])
        labels = labels[rows[k_nearest(points[rows], 1, points)[1][:, 0]]]
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)


def _shortened(thin: Thin, piece: IntArray, axes: FloatArray) -> IntArray:
    """Pieces (n,) without the slices at their ends where their section is not there because another piece passes; the emptiest end first.

    What it leaves goes to who runs through, as in `_cut`: of two that both hold points of one joint only one loses its end.
    """
    ends: list[tuple[float, int, bool]] = []
    for p in range(len(axes)):
        rows = np.flatnonzero(piece == p)
        zones, at, share = _empty_zones(thin, rows, piece, axes, p) if len(rows) else ([], rows, np.zeros(0))
        ends += [(float(share[a:b].min()), p, far) for a, b in zones for far in (False, True) if (b == int(at.max()) + 1 if far else a == 0)]
    for _, p, far in sorted(ends):
        rows = np.flatnonzero(piece == p)
        zones, at, _ = _empty_zones(thin, rows, piece, axes, p) if len(rows) else ([], rows, np.zeros(0))
        gone = [rows[(at >= a) & (at < b)] for a, b in zones if (b == int(at.max()) + 1 if far else a == 0)]
        if gone:
            piece = piece.copy()
            piece[np.concatenate(gone)] = -1
            piece = _given_back(thin, piece)
    return piece


def _cut(thin: Thin, piece: IntArray, axes: FloatArray) -> IntArray:
    """Pieces (n,) cut in two where their section is not there because another piece passes; the emptiest place of all first.

    What it leaves there goes to who runs through, so that the other has its section again and is not cut too.
    """
    axes = axes.copy()
    for _ in range(_MOST_CUTS):
        found: tuple[float, int, IntArray, IntArray] | None = None
        for p in range(len(axes)):
            rows = np.flatnonzero(piece == p)
            zones, at, share = _empty_zones(thin, rows, piece, axes, p) if len(rows) else ([], rows, np.zeros(0))
            for first, last in zones:
                left = float(share[first:last].min())
                if first > 0 and last <= int(at.max()) and (found is None or left < found[0]):
                    found = (left, p, rows[(at >= first) & (at < last)], rows[at >= last])
        if found is None:
            break
        _, p, between, beyond = found
        piece = piece.copy()
        piece[between], piece[beyond] = -1, len(axes)
        axes = np.concatenate([axes, axes[p : p + 1]])
        piece = _given_back(thin, piece)
    return piece


def _empty_zones(thin: Thin, rows: IntArray, piece: IntArray, axes: FloatArray, p: int) -> tuple[list[tuple[int, int]], IntArray, FloatArray]:
    """First slice and end of each stretch where less than 75 % of the section of piece p shows and another passes; slice of each row, shares."""
    share, at = slice_profile(thin.points[rows], axes[p], thin.h)
    share = share / max(float(np.median(share)), 1e-12)
    label, n_zones = ndimage.label(share < SHOWS)
    zones = []
    for zone in range(1, n_zones + 1):
        slices = np.flatnonzero(label == zone)
        stretch = (int(slices[0]), int(slices[-1]) + 1)
        if _passes(thin, rows, piece, axes, p, stretch):
            zones.append(stretch)
    return zones, at, share


def _given_back(thin: Thin, piece: IntArray) -> IntArray:
    """Pieces (n,) where what one was shortened by goes to a long one that runs through there."""
    long_ones: list[Extent] = []
    numbers = []
    for p in np.flatnonzero(np.bincount(piece[piece >= 0]) >= LEAST_PIECE):
        extent = extent_of(thin.points[piece == p], thin.normals[piece == p])
        if extent.length >= _STUB * extent.width:
            long_ones.append(extent)
            numbers.append(p)
    if not numbers:
        return piece
    through = _run_through(thin, np.full(len(piece), -1, np.int64), long_ones)
    return np.where((piece < 0) & (through >= 0), np.array(numbers)[through], piece)


def _passes(thin: Thin, rows: IntArray, piece: IntArray, axes: FloatArray, p: int, gap: tuple[int, int]) -> bool:
    """Whether a piece of another direction goes through the section of piece p between two of its slices."""
    axis = axes[p]
    u, v = across(axis)
    z = thin.points @ axis
    z0 = float(z[rows].min())
    low, high = z0 + (gap[0] * SLICE - 1.0) * thin.h, z0 + (gap[1] * SLICE + 1.0) * thin.h
    beside = np.flatnonzero((z >= low) & (z <= high) & (piece >= 0) & (piece != p))
    across_it = np.stack([u, v], 1)
    own, flat = thin.points[rows] @ across_it, thin.points[beside] @ across_it
    box_low, box_high = own.min(axis=0) + thin.h, own.max(axis=0) - thin.h  # what only rests on it does not pass
    inside = beside[((flat >= box_low) & (flat <= box_high)).all(axis=1)]
    others, counts = np.unique(piece[inside], return_counts=True)
    passing = [q for q, n in zip(others, counts, strict=True) if n >= NORMAL_NEIGHBOURS and abs(float(axes[q] @ axis)) < _IN_LINE]
    return any(_is_on_both_sides(thin, rows, beside[piece[beside] == q]) for q in passing)


def _is_on_both_sides(thin: Thin, rows: IntArray, others: IntArray) -> bool:
    """False where the piece (rows) is one plane sheet and the others lie on one side of it only: a brace that ends under a flange."""
    values, axes = np.linalg.eigh(thin.normals[rows].T @ thin.normals[rows] / len(rows))
    if values[1] >= ONE_FACE:
        return True
    height = (thin.points[others] - np.median(thin.points[rows], axis=0)) @ axes[:, 2]
    return bool(min((height > thin.h).sum(), (height < -thin.h).sum()) >= NORMAL_NEIGHBOURS / 2)


def _joined(thin: Thin, piece: IntArray) -> IntArray:
    """Pieces that lie along each other become one, and pieces in line with the same section between which nothing passes; twice, as they grow."""
    for _ in range(2):
        used, packed = np.unique(piece[piece >= 0], return_inverse=True)
        n = len(used)
        if n < 2:
            return piece
        group = np.full(len(piece), -1, np.int64)
        group[piece >= 0] = packed
        extents = [extent_of(thin.points[group == g], thin.normals[group == g]) for g in range(n)]
        edges = _side_by_side(thin, group, extents)
        if not edges:
            return group
        parts = tree_parts(np.array(edges, np.int64).reshape(-1, 2), n)
        piece = np.where(group >= 0, parts[group], -1)
    return piece


def _side_by_side(thin: Thin, group: IntArray, extents: list[Extent]) -> list[tuple[int, int]]:
    """Pairs of which the shorter lies along the other over half its length, or which go on in line."""
    border = _near_another(thin, group)
    distance, near = k_nearest(thin.points, 32, thin.points[border])
    i, j = np.nonzero(distance <= LINK * thin.h)
    a, b = group[border[i]], group[near[i, j]]
    ok = (b >= 0) & (a != b)
    i, a, b = border[i[ok]], a[ok], b[ok]
    axes = np.array([e.axis for e in extents])
    at = np.floor(np.einsum("nc,nc->n", thin.points[i], axes[a]) / (GAP * thin.h)).astype(np.int64)
    if not len(a):
        return []
    n, n_slices = len(extents), int(np.ptp(at)) + 1
    touched = np.unique((a * n + b) * n_slices + at - at.min())  # as one number: many times as fast as rows of three
    pairs, slices = np.unique(touched // n_slices, return_counts=True)
    edges = []
    along: dict[int, tuple[int, float, int]] = {}  # each piece lies along one other, the one it touches most: else it would bridge two members
    for pair, count in zip(pairs.tolist(), slices.tolist(), strict=True):
        p, q = divmod(pair, n)
        one, other = extents[p], extents[q]
        is_along = one.length <= other.length and count * GAP * thin.h >= _ALONG * one.length
        if is_along and one.length < _SHORT * other.length:  # a stiffener is part of the member, a bracket on its face is not
            is_along = bool(other.holds(thin.points[group == p], LINK * thin.h, to_ends=True).mean() >= _INSIDE)
        if is_along:
            along[p] = max(along.get(p, (0, 0.0, 0)), (count, other.length, q))
        elif p < q and _in_line(one, other):
            edges.append((p, q))
    return edges + [(p, q) for p, (_, _, q) in along.items()]


def _near_another(thin: Thin, group: IntArray) -> IntArray:
    """Rows of the points of a group that may have one of another within the reach of a link: all others have only their own in the cells around."""
    rows = np.flatnonzero(group >= 0)
    cell = np.floor((thin.points[rows] - thin.points[rows].min(axis=0)) / (LINK * thin.h)).astype(np.int64) + 1
    shape = cell.max(axis=0) + 2
    if np.prod(shape.astype(float)) > _MOST_CELLS:
        return rows
    most, least = np.full(shape, -1, np.int32), np.full(shape, group.max() + 1, np.int32)
    np.maximum.at(most, tuple(cell.T), group[rows])
    np.minimum.at(least, tuple(cell.T), group[rows])
    differs = ndimage.maximum_filter(most, 3) != ndimage.minimum_filter(least, 3)
    found: IntArray = rows[differs[tuple(cell.T)]]
    return found


def _in_line(one: Extent, other: Extent) -> bool:
    """Whether one goes on where the other ends, with the same section."""
    gap = min(float(np.linalg.norm(p - q)) for p in one.ends for q in other.ends)
    is_alike = 1 / _ALIKE <= one.width / other.width <= _ALIKE
    return is_alike and abs(float(one.axis @ other.axis)) >= _IN_LINE and gap <= 0.5 * max(one.width, other.width)


def _members_of(thin: Thin, group: IntArray, least: float) -> tuple[IntArray, list[Extent]] | None:
    """Number (n,) of the member that each point lies on, -1 none, and the boxes; None where the cluster is not made of two long ones or more.

    least : length over width of a long one. Two that meet at a slant are two already at three times their width if one is a third wider than the
    other: a girder and its brace. Stubs that meet square may be one welded body, and how much of a section was seen tells too little of their sizes.
    """
    out = np.full(len(group), -1, np.int64)
    extents: list[Extent] = []
    for g in range(int(group.max(initial=-1)) + 1):
        rows = np.flatnonzero(group == g)
        if len(rows) < LEAST_PIECE:
            continue
        extent = extent_of(thin.points[rows], thin.normals[rows])
        if extent.length < min(_STUB, least) * extent.width:
            continue
        out[rows] = len(extents)
        extents.append(extent)
    slender = np.array([extent.length / extent.width for extent in extents])
    width = np.array([extent.width for extent in extents])

    def is_made_of(those: BoolArray) -> bool:
        if those.sum() < 2:
            return False
        on = np.append(those, False)[out]
        return bool(on.mean() >= _EXPLAINED or share_of_surfaces(thin.points, on) >= _EXPLAINED)

    beams = slender >= _BEAM
    axes = np.array([extent.axis for extent in extents]).reshape(-1, 3)
    cosine = np.abs(axes @ axes.T)
    braced = (width[:, None] > _ALIKE * width) & (cosine > _OBLIQUE) & (cosine < _IN_LINE) & beams[:, None] & beams
    return (out, extents) if is_made_of(slender >= least) or (braced.any() and is_made_of(beams)) else None


def _run_through(thin: Thin, member: IntArray, extents: list[Extent]) -> IntArray:
    """Members (n,) where points at joints go to the one that runs through.

    A point in the box of a member and in a run of half its length is that member's; of several the one whose ends are farther away: the web of a
    column may be in one plane with that of the beam that ends at it.
    """
    out, best = member.copy(), np.zeros(len(member))
    for k, extent in enumerate(extents):
        inside = np.flatnonzero(extent.holds(thin.points, 0.5 * thin.h))
        runs = run_lengths(thin.points[inside], thin.normals[inside], extent.axis, thin.h)
        z = (thin.points[inside] - extent.middle) @ extent.axis
        from_ends = np.minimum(z - extent.low[2], extent.high[2] - z)
        own = (runs >= _ALONG * extent.length) & (from_ends > best[inside])
        out[inside[own]], best[inside[own]] = k, from_ends[own]
    return out


def _to_neighbours(points: FloatArray, labels: IntArray, lies: BoolArray, extents: list[Extent], thin: Thin) -> tuple[IntArray, BoolArray]:
    """Labels, and what lies on a member still, where parts that lie in the box of another are of that one: the end of a column under its beam."""
    labels, lies, rows, points = labels.copy(), lies.copy(), np.flatnonzero(lies), points - points.min(axis=0)  # as `thin` has them
    part = radius_components(points[rows], LINK * thin.h) if len(rows) else rows
    for p in range(int(part.max(initial=-1)) + 1):
        mine = rows[part == p]
        shares = [float(extent.holds(points[mine], 0.5 * thin.h, to_ends=True).mean()) for extent in extents]
        inside = np.where(np.isin(np.arange(len(extents)), labels[mine]), 0.0, shares)
        if inside.max() >= _INSIDE:
            labels[mine], lies[mine] = int(inside.argmax()), False
    return labels, lies


def _apart(points: FloatArray, labels: IntArray, free: BoolArray, reach: float, min_points: int) -> IntArray:
    """Labels (n,) where each connected part of the free points (n,), of no fewer than `min_points`, is an object of its own."""
    out, rows = labels.copy(), np.flatnonzero(free)
    if len(rows):
        part = radius_components(points[rows], reach)
        for p in np.flatnonzero(np.bincount(part) >= min_points):
            out[rows[part == p]] = int(out.max()) + 1
    return out


def _filled(thin: Thin, member: IntArray, extents: list[Extent]) -> IntArray:
    """Labels (n,) without gaps: what is left goes to the nearest member; a connected part that sticks out of all is an object of its own."""
    labels = member.copy()
    left = np.flatnonzero(member < 0)
    on = np.flatnonzero(member >= 0)
    if not len(left):
        return labels
    labels[left] = member[on[k_nearest(thin.points[on], 1, thin.points[left])[1][:, 0]]]
    out = left[~np.any([extent.holds(thin.points[left], thin.h, to_ends=True) for extent in extents], axis=0)]
    if len(out):
        part = radius_components(thin.points[out], LINK * thin.h)
        for p in np.flatnonzero(np.bincount(part) >= LEAST_PIECE):
            labels[out[part == p]] = int(labels.max()) + 1
    return labels
