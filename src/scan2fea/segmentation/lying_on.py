"""Bodies that lie flat on a member: the leg of a bracket, a cover plate, a foot. One body or two is decided by the Bayesian information criterion.

A body that lies on a face covers it, stands out from it all over, and ends in a step. So on each flat face of a member the connected points that
stand out where the face itself is not seen, and is seen beside them, are asked for: either the member's own face bends there (a quadratic in both
directions of the face) or a second face begins at another height. Both have six parameters, and the better fit to the points there and round about
has the lower criterion (Schwarz 1978): a dent, a haunch, a taper bends; a plate steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.polynomial import legendre

from scan2fea.kernel.neighbors import k_nearest, radius_components
from scan2fea.segmentation.extents import Extent
from scan2fea.segmentation.sweeps import SLICE
from scan2fea.types import BoolArray, FloatArray, IntArray

_ALONG = 0.5  # of the member's length: a face shows in as many slices; a body that lies on it in fewer
_SQUARE = 0.26  # sine of 15 degrees: normals of a prism are square to its axis
_PARALLEL = 0.966  # cosine of 15 degrees: normals of one face
_SHARE = 0.1  # of the points: as many normals make a direction of faces
_TOP = 2.0  # standard deviations that the highest of a slice's points lie above their face
_BAND = 3.0  # standard deviations: points of the face
_CLEAR = 4.0  # the same from which a point stands out
_LEAST = 16  # points
_ROUNDS, _EXACT = 20, 1e-3  # of least absolute deviations, and the share of the range below which they count as equal
_BESIDE = 3.5  # spacings: round about
_COVERED = 0.5  # of the points that stand out: where more are seen below them, they are the other skin of a plate


def lying_on(points: FloatArray, normals: FloatArray, member: IntArray, extents: Sequence[Extent], h: float, sigma: float) -> BoolArray:
    """(n,) which points (n, 3) belong to a body that lies on the member they were given to.

    normals : (n, 3), either way.   member : (n,) k has the box extents[k]; other numbers are not asked.   h : spacing, m.   sigma : noise, m; where
    it is nan, nothing is told.
    """
    lies = np.zeros(len(points), bool)
    if not np.isfinite(sigma):
        return lies
    for k, extent in enumerate(extents):
        rows = np.flatnonzero(member == k)
        if len(rows) >= _LEAST:
            local, turned = (points[rows] - extent.middle) @ extent.frame.T, normals[rows] @ extent.frame.T
            for facing in _facings(turned[np.abs(turned[:, 2]) < _SQUARE]):
                lies[rows] |= _on_face(local, facing, h, max(sigma, 1e-3 * h))
    return lies


def _facings(normals: FloatArray) -> Iterator[FloatArray]:
    """Outward directions (3,) of the flat faces of a prism whose axis is z, both ways of each: those that a tenth of its normals share."""
    left = normals[:, :2] / np.maximum(np.linalg.norm(normals[:, :2], axis=1, keepdims=True), 1e-12)
    least = max(_LEAST, _SHARE * len(left))
    while len(left) >= least:
        tried = left[:: max(1, len(left) // 64)]
        alike = np.abs(tried @ left.T) >= _PARALLEL
        near = alike[int(alike.sum(axis=1).argmax())]
        if near.sum() < least:
            return
        main = np.linalg.eigh(left[near].T @ left[near])[1][:, 1]
        yield np.append(main, 0.0)
        yield np.append(-main, 0.0)
        left = left[~near]


def _slice(z: FloatArray, h: float) -> IntArray:
    return np.asarray(np.floor((z - z.min()) / (SLICE * h)).astype(np.int64))


def _on_face(local: FloatArray, outward: FloatArray, h: float, sigma: float) -> BoolArray:
    """(n,) which points of a member, in its own frame, lie on its outermost face of one direction as another body."""
    lies = np.zeros(len(local), bool)
    height = local @ outward
    at = _slice(local[:, 2], h)
    every = np.arange(len(local))
    level = _level(at, height, every, np.max) - _TOP * sigma
    band = np.flatnonzero(np.abs(height - level) <= _BAND * sigma)
    if len(np.unique(at[band])) < max(3, _ALONG * (int(at.max()) + 1)):
        return lies
    over = height - _level(at, height, band, np.median)
    spread = max(1.4826 * float(np.median(np.abs(over[band]))), sigma)
    flat = np.stack([local @ np.cross(outward, [0.0, 0.0, 1.0]), local[:, 2]], 1)
    for part in _parts(local, np.flatnonzero(over > _CLEAR * spread), _BESIDE * h):
        if _is_a_second_body(flat, over, part, np.flatnonzero(np.abs(over) <= _CLEAR * spread), spread, h):
            lies[part] = True
    return lies


def _level(at: IntArray, height: FloatArray, rows: IntArray, of_slice: Callable[[FloatArray], float]) -> FloatArray:
    """(n,) height of the face at each point: a parabola, as a member may be bowed, through one number of each slice, with least absolute deviations.

    at : (n,) slice along the axis.   rows : the points that count.
    """
    order = rows[np.argsort(at[rows], kind="stable")]
    slices, first = np.unique(at[order], return_index=True)
    found = np.array([of_slice(own) for own in np.split(height[order], first[1:])])
    basis = legendre.legvander(2.0 * np.arange(int(at.max()) + 1) / max(int(at.max()), 1) - 1.0, 2)
    fitted = np.full(len(found), np.median(found))
    for _ in range(_ROUNDS):  # least absolute deviations by reweighted least squares
        weight = 1.0 / np.sqrt(np.maximum(np.abs(found - fitted), _EXACT * max(float(np.ptp(found)), 1e-12)))
        bow = np.linalg.lstsq(basis[slices] * weight[:, None], found * weight, rcond=None)[0]
        fitted = basis[slices] @ bow
    return np.asarray(basis @ bow)[at]


def _parts(local: FloatArray, rows: IntArray, reach: float) -> Iterator[IntArray]:
    if len(rows) < _LEAST:
        return
    part = radius_components(local[rows], reach)
    for p in np.flatnonzero(np.bincount(part) >= _LEAST):
        yield rows[part == p]


def _is_a_second_body(flat: FloatArray, over: FloatArray, part: IntArray, face: IntArray, spread: float, h: float) -> bool:
    """Whether the part lies on the face: it covers it, the face goes on beside it, and a step explains the heights better than a bend.

    flat : (n, 2) places on the face, m.   over : (n,) heights above it.   part, face : their rows.
    """
    if len(face) < _LEAST:
        return False
    under, own = (_n_within(flat[those], flat[part], h) for those in (face, part))
    beside = face[k_nearest(flat[part], 1, flat[face])[0][:, 0] <= _BESIDE * h]
    if np.median(under) > _COVERED * np.median(own) or len(beside) < _LEAST:
        return False
    rows = np.concatenate([part, beside])
    place = (flat[rows] - flat[rows].mean(axis=0)) / h
    x, y = place.T
    bend = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], 1)
    most = _CLEAR * spread  # a residual counts up to here: rims and strays are in neither
    step = np.concatenate([over[part] - np.median(over[part]), over[beside]])
    bent = over[rows] - bend @ np.linalg.lstsq(bend, over[rows], rcond=None)[0]
    return _misfit(step, most, spread) < _misfit(bent, most, spread)


def _n_within(points: FloatArray, places: FloatArray, radius_m: float) -> IntArray:
    """(m,) how many points (n, 2) lie within a radius of each place (m, 2); counted up to 8."""
    return np.asarray((k_nearest(points, 8, places)[0] <= radius_m).sum(axis=1))


def _misfit(residual: FloatArray, most: float, spread: float) -> float:
    """Minus twice the log likelihood of residuals (m,), up to a constant: n log of their mean square, which is no less than the noise's."""
    return len(residual) * float(np.log(max(float((np.minimum(np.abs(residual), most) ** 2).mean()), spread**2)))
