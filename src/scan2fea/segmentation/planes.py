"""Large planes in a cloud: seeded hypotheses from neighbourhoods, scored by the points they explain (RANSAC, Fischler and Bolles 1981)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.near_tree import NearTree, near_tree
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import noise_sigma, sampled_rows, spacing
from scan2fea.kernel.normals import normals_at
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

_SUBSET = 10_000  # points that hypotheses are scored on
_HYPOTHESES = 100  # of each size
_REFITTED = 8  # of the hypotheses: the best by points near them
_NORMAL_NEIGHBOURS = 16
_PATCHES = (48, 240)  # neighbours that a hypothesis is fitted to: small ones fit small planes, large ones do not tilt
_WIDEST = 3.0  # a plane may spread over this many times the width that local noise gives (warped floors), not over a second wall
_COS_NORMAL = 0.8  # a point counts for a plane if its own normal is within 37 degrees: noise allows no less, a crossing wall is at 90
_SIGMAS = 4.0
_SHEET_SHARE, _SHEET_SIGMAS = 0.4, 1.05  # the shortest interval with 40 % of a Gaussian is 1.05 sigma long
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
    is refitted to the spread of the sheet it finds, so a floor that is a little warped stays one plane and the two faces of a slab are two.
    """
    if len(points) < 3 * _PATCHES[0]:
        return []
    rng = np.random.default_rng(seed)
    rows = sampled_rows(len(points), _SUBSET, seed)
    tree = near_tree(points)
    h, sigma = spacing(points, seed, tree), noise_sigma(points, seed=seed, tree=tree)
    least = 3.0 * sigma if np.isfinite(sigma) else h
    width = max(h, least)
    search = _Search(points=points[rows], normals=_both_normals(points, rows, tree), width=width, least=least)
    left = np.ones(len(rows), bool)
    found: list[Plane] = []
    for _ in range(at_most):
        if left.sum() < max(_PATCHES[0], least_share * len(rows)):
            break
        plane = search.of(left).best(len(rows), rng)
        if plane is None or plane.share < least_share:
            break
        found.append(plane)
        left &= ~search.on(plane.normal, plane.offset, max(plane.band_m, width))
    return found


def _both_normals(points: FloatArray, rows: IntArray, tree: NearTree) -> FloatArray:
    """(2, m, 3) normals of some points, from their neighbours among all points and among the drawn ones alone.

    Near neighbours tell the two faces of a thin slab apart; among few points the neighbours on one ring of a scanner do not stand alone.
    """
    drawn = points[rows]
    return np.stack([normals_at(drawn, points, _NORMAL_NEIGHBOURS, tree), normals_at(drawn, drawn, _NORMAL_NEIGHBOURS)])


@dataclass(frozen=True, eq=False, kw_only=True)
class _Search(Value):
    """points : (m, 3).   normals : (2, m, 3) of each, two opinions.   width, least : half the width to begin with, and the least one."""

    points: FloatArray
    normals: FloatArray
    width: float
    least: float

    def of(self, rows: IntArray | BoolArray) -> _Search:
        """The same search among some of the points."""
        return _Search(points=self.points[rows], normals=self.normals[:, rows], width=self.width, least=self.least)

    def on(self, normal: FloatArray, offset: float, width: float) -> BoolArray:
        """Which of the points lie on the plane and have its direction."""
        faces_it = (np.abs(self.normals @ normal) >= _COS_NORMAL).any(axis=0)
        on: BoolArray = faces_it & (np.abs(self.points @ normal - offset) <= width)
        return on

    def best(self, n_all: int, rng: np.random.Generator) -> Plane | None:
        """The plane that explains most of the points; its share is one of `n_all`."""
        score, normals, offsets = self._hypotheses(rng)
        ranked = np.argsort(-score, kind="stable")[:_REFITTED]
        planes = [self.refitted(normals[i], float(offsets[i]), n_all) for i in ranked]
        return max((plane for plane in planes if plane is not None), key=self._worth, default=None)

    def _hypotheses(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Score (m,) (each point counts by how near it is), normals (m, 3) and offsets (m,) of planes through small patches."""
        scores, normals, offsets = [], [], []
        for size in _PATCHES:
            drawn = rng.integers(len(self.points), size=_HYPOTHESES)
            patch = self.points[k_nearest(self.points, min(size, len(self.points)), self.points[drawn])[1]]
            centre = patch.mean(axis=1)
            patch -= centre[:, None]
            normals.append(np.linalg.eigh(np.einsum("mki,mkj->mij", patch, patch))[1][:, :, 0])
            offsets.append(np.einsum("mi,mi->m", normals[-1], centre))
            off = ((self.points @ normals[-1].T - offsets[-1]) / self.width) ** 2  # (n, m)
            faces_it = (np.abs(self.normals @ normals[-1].T) >= _COS_NORMAL).any(axis=0)
            scores.append((np.maximum(1.0 - off, 0.0) * faces_it).sum(axis=0))
        return np.concatenate(scores), np.concatenate(normals), np.concatenate(offsets)

    def _worth(self, plane: Plane) -> float:
        """Log-likelihood against points spread evenly over the widest plane: what lies on one sheet beats as much again that lies across two."""
        widest = _WIDEST * self.width
        return plane.share * float(np.log(2.0 * widest / max(plane.sigma_m, self.least / 3.0)))

    def refitted(self, normal: FloatArray, offset: float, n_all: int) -> Plane | None:
        """Least squares on the points of one sheet, its width following their spread: at least `least`, at most three times `width`."""
        reach, sigma, n_near = 2.0 * self.width, self.width / 3.0, 0
        for _ in range(6):
            before = (*normal, offset, reach)
            near = self.points[self.on(normal, offset, reach)]
            if len(near) < 3:
                return None
            offset, sigma = _sheet(near @ normal)
            reach = min(max(self.least, _SIGMAS * sigma), _WIDEST * self.width)
            near = self.points[self.on(normal, offset, reach)]
            n_near = len(near)
            if n_near < 3:
                return None
            centre = near.mean(axis=0)
            normal = np.linalg.eigh((near - centre).T @ (near - centre))[1][:, 0]
            offset = float(centre @ normal)
            if (*normal, offset, reach) == before:
                break
        sigma = min(max(sigma, 1e-9 * self.width), _WIDEST * self.width / _SIGMAS)
        if not self.on(normal, offset, _SIGMAS * sigma).any():
            return None  # laid between two sheets
        return Plane(normal=normal, offset=offset, sigma_m=sigma, share=n_near / n_all)


def _sheet(heights: FloatArray) -> tuple[float, float]:
    """Middle and standard deviation of the densest sheet among the heights (n,): of the shortest interval that holds 40 % of them.

    A median would lie between the two faces of a slab, and take their distance for its spread.
    """
    ranked = np.sort(heights)
    held = max(2, round(_SHEET_SHARE * len(ranked)))
    length = ranked[held - 1 :] - ranked[: len(ranked) - held + 1]
    first = int(np.argmin(length))
    return float(ranked[first : first + held].mean()), float(length[first]) / _SHEET_SIGMAS
