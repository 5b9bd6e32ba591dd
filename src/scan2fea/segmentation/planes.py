"""Large planes in a cloud: seeded hypotheses from neighbourhoods, scored by the points they explain (RANSAC, Fischler and Bolles 1981)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import noise_sigma, sampled_rows, spacing
from scan2fea.kernel.normals import pca_normals
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

_SUBSET = 10_000  # points that hypotheses are scored on
_HYPOTHESES = 100  # of each size
_PATCHES = (48, 240)  # neighbours that a hypothesis is fitted to: small ones fit small planes, large ones do not tilt
_WIDEST = 3.0  # a plane may spread over this many times the width that local noise gives (warped floors), not over a second wall
_COS_NORMAL = 0.8  # a point counts for a plane if its own normal is within 37 degrees: noise allows no less, a crossing wall is at 90
_SIGMAS = 4.0
_CANDIDATES = 4
_LEAST_SHARE = 0.05


@dataclass(frozen=True, eq=False, kw_only=True)
class Plane(Value):
    """normal . x = offset.

    normal : (3,) unit.   sigma_m : standard deviation of its points across it.   share : of the cloud's points that lie on it.
    """

    normal: FloatArray
    offset: float
    sigma_m: float
    share: float

    def height(self, points: FloatArray) -> FloatArray:
        """(n,) signed distance, positive along the normal."""
        above: FloatArray = points @ self.normal - self.offset
        return above

    def flipped(self) -> Plane:
        """The same plane seen from the other side."""
        return Plane(normal=-self.normal, offset=-self.offset, sigma_m=self.sigma_m, share=self.share)

    @property
    def band_m(self) -> float:
        """Half the thickness within which a point belongs to the plane."""
        return _SIGMAS * self.sigma_m


class PlaneFinder:
    """The large planes of parts of one cloud; a part that is asked for again is not searched again."""

    def __init__(self, points: FloatArray, seed: int) -> None:
        self.points = points
        self._seed = seed
        self._known: dict[bytes, tuple[Plane, ...]] = {}

    def of(self, rows: IntArray) -> tuple[Plane, ...]:
        """At most four planes with 5 % of the part's points or more: what is smaller carries nothing."""
        key = rows.tobytes()
        if key not in self._known:
            self._known[key] = tuple(large_planes(self.points[rows], _CANDIDATES, _LEAST_SHARE, self._seed))
        return self._known[key]


def large_planes(points: FloatArray, at_most: int, least_share: float, seed: int = 0) -> list[Plane]:
    """The planes that hold most points, largest first, each with at least `least_share` of the points (n, 3).

    The width of a plane follows the data: it starts at the spacing of the points or 3 sigma of their local noise, whichever is larger, and
    is refitted to the spread of the points it finds, so a floor that is a little warped stays one plane.
    """
    if len(points) < 3 * _PATCHES[0]:
        return []
    rng = np.random.default_rng(seed)
    subset = points[sampled_rows(len(points), _SUBSET, seed)]
    h, sigma = spacing(points, seed), noise_sigma(points, seed=seed)
    width = max(h, 3.0 * sigma if np.isfinite(sigma) else 0.0)
    normals = pca_normals(subset, 16)
    left = np.ones(len(subset), bool)
    found: list[Plane] = []
    for _ in range(at_most):
        if left.sum() < max(_PATCHES[0], least_share * len(subset)):
            break
        plane = _best(subset, normals, left, width, rng)
        if plane is None or plane.share < least_share:
            break
        found.append(plane)
        left &= ~_on(plane.normal, plane.offset, subset, normals, max(plane.band_m, width))
    return found


def _on(normal: FloatArray, offset: float, points: FloatArray, normals: FloatArray, width: float) -> BoolArray:
    on: BoolArray = (np.abs(points @ normal - offset) <= width) & (np.abs(normals @ normal) >= _COS_NORMAL)
    return on


def _best(points: FloatArray, normals: FloatArray, left: BoolArray, width: float, rng: np.random.Generator) -> Plane | None:
    """The hypothesis that explains most of the points left, refitted to them."""
    rows = np.flatnonzero(left)
    candidates, member_normals = points[rows], normals[rows]
    best, score = (np.array([0.0, 0.0, 1.0]), 0.0), -1
    for size in _PATCHES:
        drawn = rows[rng.integers(len(rows), size=_HYPOTHESES)]
        patch = candidates[k_nearest(candidates, min(size, len(rows)), points[drawn])[1]]
        centre = patch.mean(axis=1)
        axes = np.linalg.eigh(np.einsum("mki,mkj->mij", patch - centre[:, None], patch - centre[:, None]))[1]
        for normal, middle in zip(axes[:, :, 0], centre, strict=True):
            on = int(_on(normal, float(middle @ normal), candidates, member_normals, width).sum())
            if on > score:
                best, score = (normal, float(middle @ normal)), on
    return _refitted(*best, candidates, member_normals, width, len(points))


def _refitted(normal: FloatArray, offset: float, points: FloatArray, normals: FloatArray, width: float, n_all: int) -> Plane | None:
    """Least squares on the points near the plane, its width following their spread."""
    reach, sigma = 2.0 * width, width / 3.0
    for _ in range(6):
        near = _on(normal, offset, points, normals, reach)
        if near.sum() < 3:
            return None
        middle = points[near].mean(axis=0)
        normal = np.linalg.svd(points[near] - middle, full_matrices=False)[2][2]
        offset = float(middle @ normal)
        sigma = 1.4826 * float(np.median(np.abs(points[near] @ normal - offset)))
        reach = min(max(width, _SIGMAS * sigma), _WIDEST * width)
    sigma = min(max(sigma, 1e-9 * width), _WIDEST * width / _SIGMAS)
    return Plane(normal=normal, offset=offset, sigma_m=sigma, share=float(near.sum()) / n_all)
