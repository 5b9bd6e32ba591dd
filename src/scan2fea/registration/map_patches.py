"""Surfaces that a map of many sweeps is held against: its planes, and patches of what lies on none; each fitted along the rays that measured it.

A scanner's noise lies along its rays: across a surface it is sigma |n . u|, for a floor seen at a flat angle a third of sigma. Residuals are measured
in that, so that what is seen at a flat angle tells the height and what faces the scanner tells the way. Levers are those of where the rays meet the
surface: those of the noisy points go together with their residuals, and a narrow surface is turned towards whoever looks at it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.voxels import voxel_mean
from scan2fea.registration.icp import tukey
from scan2fea.registration.map_planes import MapPlanes, map_planes
from scan2fea.types import FloatArray, IntArray

PATCH_EDGES = 1.3  # edge of the cells that patches begin from
FLATTEST = 0.15  # |n . u| below this is taken for this: the width of a beam spreads what it measures at a flat angle
_LEAST = 30  # points of a patch
_SHIFTS, _REFITS = 2, 2
_MAD = 1.4826


def map_surfaces(world: FloatArray, ray: FloatArray, edge_m: float, spread_m: float, sigma_m: float) -> tuple[MapPlanes, FloatArray]:
    """Planes and patches of points world (n, 3) seen along ray (n, 3) unit, and (n,) standard deviation of each point across its own (1 where none).

    A surface that scatters more than the noise (a hedge, a patch of a curved thing) has the deviation of its own scatter.
    """
    planes = map_planes(world, edge_m, spread_m)
    planes = _with_patches(planes, world, ray, sigma_m, PATCH_EDGES * edge_m)
    on = np.flatnonzero(planes.label >= 0)
    deviation = np.ones(len(world))
    if not len(on):
        return planes, deviation
    label = planes.label[on]
    for _ in range(_REFITS):
        own = _deviation(planes, label, world[on], ray[on], sigma_m)
        planes = refitted(planes, label, world[on], ray[on], own)
    deviation[on] = _deviation(planes, label, world[on], ray[on], sigma_m)
    return planes, deviation


def _with_patches(planes: MapPlanes, world: FloatArray, ray: FloatArray, sigma_m: float, edge_m: float) -> MapPlanes:
    """Points on no plane go to the nearest of centres that begin as voxel means; each such group of enough points is a patch."""
    rows = np.flatnonzero(planes.label < 0)
    if len(rows) < _LEAST:
        return planes
    points = world[rows]
    centre = voxel_mean(points, edge_m).mean
    for _ in range(_SHIFTS):
        centre = _means(points, _nearest(centre, points), len(centre))
    own = _nearest(centre, points)
    count = np.bincount(own, minlength=len(centre))
    number = np.cumsum(count >= _LEAST) - 1
    kept = count[own] >= _LEAST
    rows, points, own = rows[kept], points[kept], number[own[kept]]
    k = int((count >= _LEAST).sum())
    centre = _means(points, own, k)
    off = points - centre[own]
    # the scatter of the points less that of the noise along their rays is that of the surface
    scatter = np.zeros((k, 3, 3))
    for i in range(3):
        for j in range(3):
            scatter[:, i, j] = np.bincount(own, off[:, i] * off[:, j] - sigma_m**2 * ray[rows, i] * ray[rows, j], k)
    axes = np.linalg.eigh(scatter)[1] if k else np.zeros((0, 3, 3))
    label = planes.label.copy()
    label[rows] = len(planes) + own
    return MapPlanes(
        label=label,
        normal=np.concatenate([planes.normal, axes[:, :, 0]]),
        centre=np.concatenate([planes.centre, centre]),
        axes=np.concatenate([planes.axes, np.swapaxes(axes[:, :, 1:], 1, 2)]),
    )


def _nearest(centre: FloatArray, points: FloatArray) -> IntArray:
    return np.asarray(cKDTree(centre).query(points, k=1, workers=1)[1], np.int64)


def _means(points: FloatArray, label: IntArray, k: int) -> FloatArray:
    """(k', 3) means of the labels that have points."""
    count = np.bincount(label, minlength=k)
    total = np.stack([np.bincount(label, points[:, c], k) for c in range(3)], axis=1)
    mean: FloatArray = total[count > 0] / count[count > 0, None]
    return mean


def _deviation(planes: MapPlanes, label: IntArray, world: FloatArray, ray: FloatArray, sigma_m: float) -> FloatArray:
    normal = planes.normal[label]
    own = max(sigma_m, 1e-9) * np.maximum(np.abs(np.einsum("nc,nc->n", normal, ray)), FLATTEST)
    off = np.abs(np.einsum("nc,nc->n", normal, world - planes.centre[label])) / own
    widened = np.maximum(1.0, _MAD * _medians(off, label, len(planes)))
    return np.asarray(own * widened[label])


def _medians(values: FloatArray, label: IntArray, k: int) -> FloatArray:
    """(k,) medians by label; 0 where one has no values."""
    order = np.lexsort((values, label))
    bounds = np.searchsorted(label[order], np.arange(k + 1))
    found = np.zeros(k)
    full = np.diff(bounds) > 0
    found[full] = values[order][(bounds[:-1] + np.diff(bounds) // 2)[full]]
    return found


def plane_terms(planes: MapPlanes, label: IntArray, world: FloatArray, ray: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n,) distance across, (n, 3) its derivative by height and the two tilts of the plane, and (n, 3) where the ray meets it."""
    normal, off = planes.normal[label], world - planes.centre[label]
    across: FloatArray = np.einsum("nc,nc->n", normal, off)
    slope = np.einsum("nc,nc->n", normal, ray)
    met = off - ray * (across / np.copysign(np.maximum(np.abs(slope), FLATTEST), slope))[:, None]
    terms = np.concatenate([np.ones((len(off), 1)), np.einsum("nac,nc->na", planes.axes[label], met)], axis=1)
    return across, terms, planes.centre[label] + met


def blocks_of(terms: FloatArray, weight: FloatArray, label: IntArray, k: int) -> FloatArray:
    """(k, 3, 3) sums of weighted squares of the terms, made safe to invert."""
    blocks: FloatArray = np.zeros((k, 3, 3))
    for i in range(3):
        for j in range(i, 3):
            blocks[:, i, j] = blocks[:, j, i] = np.bincount(label, weight * terms[:, i] * terms[:, j], k)
    ridge = 1e-9 * np.trace(blocks, axis1=1, axis2=2) + 1e-300
    return np.asarray(blocks + ridge[:, None, None] * np.eye(3))


def refitted(planes: MapPlanes, label: IntArray, world: FloatArray, ray: FloatArray, deviation: FloatArray) -> MapPlanes:
    """Planes of weighted least squares through their points, robustly."""
    k = len(planes)
    across, terms, _ = plane_terms(planes, label, world, ray)
    weight = tukey(across, deviation) / deviation**2
    right = np.stack([np.bincount(label, weight * across * terms[:, i], k) for i in range(3)], axis=1)
    step = np.linalg.solve(blocks_of(terms, weight, label, k), right[:, :, None])[:, :, 0]
    normal = planes.normal - np.einsum("ka,kac->kc", step[:, 1:], planes.axes)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    first = planes.axes[:, 0] - np.einsum("kc,kc->k", planes.axes[:, 0], normal)[:, None] * normal
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return MapPlanes(
        label=planes.label,
        normal=normal,
        centre=planes.centre + planes.normal * step[:, :1],
        axes=np.stack([first, np.cross(normal, first)], axis=1),
    )
