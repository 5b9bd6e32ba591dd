"""Normals made consistent by their own winding number.

The winding number of a closed surface drops from 1 inside to 0 outside, so its gradient at a point of the surface is the normal there.
Setting each normal to the gradient that all others cause, and repeating, carries orientation through walls thinner than the spacing
where neighbours alone cannot tell (Lin, Shi, Liu 2024, Fast and globally consistent normal orientation based on the winding number
normal consistency: WNNC).
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import noise_sigma
from scan2fea.kernel.side_normals import near_lists, side_normals
from scan2fea.kernel.winding import ROUGH_OPENING, layout, winding
from scan2fea.types import FloatArray

ROUNDS = 6
SOFTENING = 0.8  # spacings
AREA_NEIGHBORS = 12
FIT_RADIUS, WIDEST_FIT = 2.5, 6.0  # spacings
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


def fitted(points: FloatArray, outward: FloatArray, spacing_m: float) -> tuple[FloatArray, float]:
    """Planes of the points that face the same way, and the noise across them.

    points, outward : (n, 3).   Returns unit outward normals (n, 3) and sigma, m. Where the noise swamps the fit it is made wider; where no
    width tells noise from shape, sigma is a quarter of the widest: high, so that nothing fine is believed.
    """
    radius = FIT_RADIUS * spacing_m
    while True:
        normals = side_normals(near_lists(points, radius), outward)
        sigma = noise_sigma(points, normals)
        wider = min(FIT_OVER_NOISE * sigma if math.isfinite(sigma) else math.inf, WIDEST_FIT * spacing_m)
        if wider <= 1.1 * radius:
            return normals, sigma if math.isfinite(sigma) else radius / FIT_OVER_NOISE
        radius = wider


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
