"""Normals made consistent by their own winding number.

The winding number of a closed surface drops from 1 inside to 0 outside, so its gradient at a point of the surface is the normal there.
Setting each normal to the gradient that all others cause, and repeating, carries orientation through walls thinner than the spacing
where neighbours alone cannot tell (Lin, Shi, Liu 2024, Fast and globally consistent normal orientation based on the winding number
normal consistency: WNNC).
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.frame_noise import sigma_of_scans
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import noise_sigma, sampled_rows
from scan2fea.kernel.side_normals import SAME_SIDE, near_lists, side_normals
from scan2fea.kernel.winding import ROUGH_OPENING, layout, winding
from scan2fea.types import FloatArray, IntArray

ROUNDS = 6
SOFTENING = 0.8  # spacings
AREA_NEIGHBORS = 12
FIT_RADIUS, WIDEST_FIT = 2.5, 6.0  # spacings
FIT_GROWTH = 1.3  # step where the noise cannot yet be told
SCATTER_QUERIES, SCATTER_NEIGHBORS = 3000, 96
FIT_OVER_NOISE = 4.0  # a plane fitted over less than this many sigma takes its tilt from the noise
SAME_SHEET = -0.5  # cosine: round a crease the surface goes on, behind a wall it is another sheet


def polish(points: FloatArray, start: FloatArray, spacing_m: float, rounds: int = ROUNDS) -> FloatArray:
    """Unit outward normals after `rounds` rounds of WNNC.

    points : (n, 3).   start : (n, 3) outward, zero where not known.   Returns (n, 3) unit; a point no gradient reaches keeps its start.
    """
    tree = layout(points)
    area = plain_areas(points)
    normals = start
    for _ in range(rounds):
        _, outward = winding(tree, normals, area, SOFTENING * spacing_m, opening=ROUGH_OPENING)
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        normals = np.where(length > 0, outward / np.maximum(length, np.finfo(float).tiny), normals)
    return normals


def fitted(points: FloatArray, outward: FloatArray, spacing_m: float, frame: IntArray | None = None) -> tuple[FloatArray, float, float]:
    """Planes of the points that face the same way, the noise across them, and that of the places of their scans alone (0: none told).

    points, outward : (n, 3).   frame : (n,) the scan each point came from, where several may lie off each other.   Returns unit outward normals
    (n, 3) and two standard deviations, m. Where the noise swamps the fit it is made wider; where no width tells noise from shape, sigma is the
    scatter about the widest planes: too high rather than too low.
    """
    radius, widest = FIT_RADIUS * spacing_m, WIDEST_FIT * spacing_m
    while True:
        normals = side_normals(near_lists(points, radius), outward)
        sigma = noise_sigma(points, normals, is_measured=None if frame is None else frame >= 0)
        wanted = FIT_OVER_NOISE * sigma if math.isfinite(sigma) else FIT_GROWTH * radius
        if min(wanted, widest) <= 1.1 * radius:
            break
        radius = min(wanted, widest)
    sigma, between = sigma_of_scans(points, normals, frame, sigma)
    wider = min(FIT_OVER_NOISE * sigma, widest)
    if between > 0.0 and wider > 1.1 * radius:
        normals = side_normals(near_lists(points, wider), outward)
    return normals, sigma if math.isfinite(sigma) else _scatter(points, normals, radius), between


def _scatter(points: FloatArray, normals: FloatArray, radius_m: float) -> float:
    """Low quantile of the distances (root mean square) of the points of one side from their plane, over its factor for normal noise."""
    rows = sampled_rows(len(points), SCATTER_QUERIES, 0)
    distance, near = k_nearest(points, SCATTER_NEIGHBORS, points[rows])
    own = (distance <= radius_m) & (np.einsum("nc,nkc->nk", normals[rows], normals[near]) > SAME_SIDE)
    height = np.einsum("nc,nkc->nk", normals[rows], points[near] - points[rows][:, None])
    count = np.maximum(own.sum(axis=1), 1)
    mean = np.where(own, height, 0.0).sum(axis=1) / count
    rms = np.sqrt(np.where(own, (height - mean[:, None]) ** 2, 0.0).sum(axis=1) / count)
    return float(np.quantile(rms, 0.3) / 0.92)  # the quantile and factor of reference/reconstruction.md


def plain_areas(points: FloatArray) -> FloatArray:
    """(n,) area each point stands for, from its distance to its neighbours; two sheets nearer than that share."""
    distance, _ = k_nearest(points, AREA_NEIGHBORS + 1)
    return np.asarray(np.pi * distance[:, -1] ** 2 / (distance.shape[1] - 0.5))


def sheet_areas(points: FloatArray, normals: FloatArray) -> FloatArray:
    """(n,) area each point stands for on its own sheet: neighbours that face the other way are not counted."""
    distance, near = k_nearest(points, 3 * AREA_NEIGHBORS + 1)
    own = np.einsum("nc,nkc->nk", normals, normals[near]) > SAME_SHEET
    own[:, 0] = True
    count = np.cumsum(own, axis=1)
    wanted = np.minimum(count[:, -1], AREA_NEIGHBORS + 1)
    at = np.argmax(count >= wanted[:, None], axis=1)
    reach = distance[np.arange(len(points)), at]
    return np.asarray(np.pi * reach**2 / np.maximum(wanted - 0.5, 0.5))
