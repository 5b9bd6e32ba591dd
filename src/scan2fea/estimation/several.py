"""Two members in one cluster: parallel ones side by side, or crossing ones. Told only where each part is a member that explains its own points.

Side by side: seen along the common axis the points fall into pieces with a gap. Crossing: the normals of a member are all square to its axis, and
seen along it its points lie on top of each other while those of the other are spread out. Either way the parts are then fitted alone: a section of
which only some faces were seen also falls into pieces, but its pieces are no members by themselves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError, cKDTree

from scan2fea.errors import EstimationError, InputError
from scan2fea.estimation.axis import axes_of
from scan2fea.estimation.member import MemberFit, MemberOptions, fit_member
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import noise_sigma, sampled_rows
from scan2fea.types import BoolArray, FloatArray, IntArray, PointCloud, Scan, Value

_POINTS = 6_000
_PART = 0.15  # of the points: less is no second member
_CELL_POINTS = 10.0  # points that a cell of the section has on average where it has any: an outline is not torn by chance
_NEIGHBOURS = 16
_DIRECTIONS = 400
_SQUARE = 0.1  # cosine to the axis below which a normal is square to it
_DENSER = 3.0  # seen along its axis a member is so many times denser than what crosses it
_SLENDER = 2.0
_WITHIN = 0.9  # of the points of a piece


@dataclass(frozen=True, eq=False, kw_only=True)
class Several(Value):
    """how : "side by side" or "crossing".   families : of the parts.   apart_m : between their axes.   of : (n,) part of each point, -1 neither."""

    how: str
    families: tuple[str, str]
    apart_m: float
    of: IntArray

    @property
    def reason(self) -> str:
        a, b = self.families
        place = f"their axes {1e3 * self.apart_m:.0f} mm apart" if self.how == "side by side" else "their axes in different directions"
        return (
            f"two members in one cluster ({a} and {b}, {self.how}, {place}): segment them first "
            "(a smaller segmentation.radius_m, labels in the file, or split_radius_m in labels.csv)"
        )


def several_members(points: FloatArray, fit: MemberFit | None, options: MemberOptions = MemberOptions()) -> Several | None:
    """The two members that the points (n, 3) of one cluster are, or None. fit : of all of them together, where there is one.

    A cluster that one member explains is only looked at for pieces side by side.
    """
    some = sampled_rows(len(points), _POINTS, options.seed)
    part = _side_by_side(points[some], sweep_of_member(fit.member).coordinates(points[some])[:, :2], fit.member.sigma_m) if fit is not None else None
    if part is None and (fit is None or not fit.explains):  # the axis of what explains nothing may be none of theirs
        part = _along_the_longest(points[some], options.seed)
    found = None if part is None else _both(points[some], part, "side by side", options)
    if found is None and (fit is None or not fit.explains):
        part = _crossing(points[some], options.seed)
        found = None if part is None else _both(points[some], part, "crossing", options)
    if found is None:
        return None
    near = k_nearest(points[some], 1, points)[1][:, 0]
    return Several(how=found.how, families=found.families, apart_m=found.apart_m, of=found.of[near])


def _along_the_longest(points: FloatArray, seed: int) -> IntArray | None:
    """As `_side_by_side` along the most slender of the axes that a single member would be tried along; None where the noise is not known."""
    try:
        axis = max(axes_of(points, seed, 1), key=lambda axis: (axis.ends[1] - axis.ends[0]) / axis.size_m)
    except EstimationError:
        return None
    return _side_by_side(points, axis.straightened(points)[:, :2], math.inf)


def _side_by_side(points: FloatArray, xy: FloatArray, sigma_m: float) -> IntArray | None:
    """(n,) 0 or 1 for the two largest pieces of the points seen along an axis as xy (n, 2), -1 for others; None where there is one piece."""
    local = noise_sigma(points)  # the member's own is wide where it is the wrong one
    sigma_m = min(sigma_m, local if math.isfinite(local) else math.inf)
    if not math.isfinite(sigma_m):
        return None
    label, count = _pieces(xy, 4 * sigma_m)
    large = [int(k) for k in np.argsort(-count)[:2] if count[k] >= _PART * len(points)]
    if len(large) < 2 or _is_around(xy[label == large[0]], xy[label == large[1]]) or _is_around(xy[label == large[1]], xy[label == large[0]]):
        return None
    return np.where(label == large[0], 0, np.where(label == large[1], 1, -1))


def _is_around(outer: FloatArray, inner: FloatArray) -> bool:
    """Whether most of one piece lies within the convex hull of the other: the two faces of a tube's wall, not members side by side."""
    try:
        hull = ConvexHull(outer)
    except QhullError:
        return False
    inside = (inner @ hull.equations[:, :2].T + hull.equations[:, 2] < 0).all(axis=1)
    return float(inside.mean()) > _WITHIN


def _pieces(xy: FloatArray, least_m: float) -> tuple[IntArray, IntArray]:
    """(n,) number of the piece of each point, and (k,) points in each: cells of the plane that touch, as small as the points allow."""
    size = np.ptp(xy, axis=0).max()
    cell = max(least_m, size / 200)
    for _ in range(6):
        at = np.floor((xy - xy.min(axis=0)) / cell).astype(np.int64)
        shape = at.max(axis=0) + 1
        counts = np.zeros(shape, np.int64)
        np.add.at(counts, (at[:, 0], at[:, 1]), 1)
        if float(counts[counts > 0].mean()) >= _CELL_POINTS:
            break
        cell *= 1.4
    threshold = 0.1 * float(np.median(counts[counts > 0]))  # clutter does not join what is apart
    label, n = ndimage.label(counts > max(threshold, 1), structure=np.ones((3, 3)))
    own = label[at[:, 0], at[:, 1]] - 1
    return own, np.bincount(own[own >= 0], minlength=max(n, 1))


def _crossing(points: FloatArray, seed: int) -> IntArray | None:
    """(n,) 0 for the points of the member along the direction that most normals are square to, 1 for the others; None where there are no two."""
    normals = _normals(points)
    rng = np.random.default_rng([seed, 5])
    pair = rng.integers(0, len(points), (_DIRECTIONS, 2))
    axes = np.cross(normals[pair[:, 0]], normals[pair[:, 1]])
    length = np.linalg.norm(axes, axis=1)
    axes = axes[length > 0.3] / length[length > 0.3, None]
    if len(axes) == 0:
        return None
    order = np.argsort(-(np.abs(normals @ axes.T) < _SQUARE).sum(axis=0), kind="stable")
    tried: list[FloatArray] = []
    for k in order:
        if len(tried) >= 6:
            break
        if all(abs(float(axes[k] @ other)) < 0.9 for other in tried):
            tried.append(axes[k])
    best: tuple[float, IntArray] | None = None
    for axis in tried:
        own = _dense_along(points, _refined(normals, axis))
        share = float(own.mean())
        if _PART <= share <= 1 - _PART and _is_slender(points[own]) and _is_slender(points[~own]):
            score = min(share, 1 - share)
            best = (score, np.where(own, 0, 1)) if best is None or score > best[0] else best
    return None if best is None else best[1]


def _refined(normals: FloatArray, axis: FloatArray) -> FloatArray:
    """The direction that the normals near square to the axis are square to, by least squares."""
    own = normals[np.abs(normals @ axis) < _SQUARE]
    return np.asarray(np.linalg.eigh(own.T @ own)[1][:, 0])


def _normals(points: FloatArray) -> FloatArray:
    near = k_nearest(points, _NEIGHBOURS)[1]
    local = points[near] - points[near].mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.einsum("nki,nkj->nij", local, local))[1][:, :, 0])


def _dense_along(points: FloatArray, axis: FloatArray) -> BoolArray:
    """(n,) points that lie on top of each other seen along the axis."""
    x = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    x /= np.linalg.norm(x)
    xy = points @ np.stack([x, np.cross(axis, x)], 1)
    tree = cKDTree(xy)
    size = float(np.ptp(points @ axis))
    count = np.asarray(tree.query_ball_point(xy, 0.02 * size, return_length=True), float)
    return np.asarray(count > np.quantile(count, 0.9) / _DENSER)


def _is_slender(points: FloatArray) -> bool:
    """Whether a part is longer than it is wide by far: of its middle nine tenths, along its principal directions."""
    centred = points - np.median(points, axis=0)
    along = centred @ np.linalg.eigh(np.cov(centred.T))[1]
    reach = np.sort(np.quantile(along, 0.95, axis=0) - np.quantile(along, 0.05, axis=0))
    return bool(reach[2] > _SLENDER * math.hypot(reach[0], reach[1]) / math.sqrt(2))


def _both(points: FloatArray, part: IntArray, how: str, options: MemberOptions) -> Several | None:
    """The parts as members of their own, where both are: each explains its points, and no dimension of its section is hidden."""
    fits: list[MemberFit] = []
    for k in (0, 1):
        try:
            fit = fit_member(Scan(cloud=PointCloud.of(points[part == k])), options)
        except (EstimationError, InputError):
            return None
        if not fit.explains or not all(p.observable for p in fit.member.parameters if p.name not in ("t", "tw", "tf")) or _is_sheet(fit):
            return None
        fits.append(fit)
    a, b = (fit.member for fit in fits)
    along = float(abs(a.T_world_member[:3, 2] @ b.T_world_member[:3, 2]))
    if (how == "side by side") != (along > math.cos(math.radians(10))):
        return None
    gap = b.T_world_member[:3, 3] - a.T_world_member[:3, 3]
    apart = float(np.linalg.norm(gap - (gap @ a.T_world_member[:3, 2]) * a.T_world_member[:3, 2]))
    return Several(how=how, families=(a.family, b.family), apart_m=apart, of=part)


def _is_sheet(fit: MemberFit) -> bool:
    """A flat whose thickness is not told is a face of something, not a member."""
    return fit.member.family == "rect" and not all(p.observable for p in fit.member.parameters)

