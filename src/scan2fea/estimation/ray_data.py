"""The rays that can tell something about a member, in its frame: those that pass near it and that nothing stopped on the way."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import EstimationError, require
from scan2fea.kernel.sections import section
from scan2fea.kernel.transforms import applied, inverse, rotated
from scan2fea.types import BoolArray, FloatArray, IntArray, Member, Rays, Scan

N_LEAST = 50  # hits
MARGIN = 0.35  # of the section's size, around the box of the hits: rays that pass there still tell that it ends
ALONG_AXIS = 0.05  # least sine between a ray and the axis: flatter rays see the ends, not the section
OFF_RAY = 1e-3  # of the range, plus 6 sigma: how far a point may lie off its own ray
FULL_OPENING = 4.0  # standard deviations of a Gaussian beam between its 1 / e^2 points
USUAL_BEAM_RAD = 7e-4  # standard deviation: scanners open their beams by 0.3 to 10 mrad
RESOLVED = 8.0  # mean gaps between rays: no edge is known better, however narrow the beam


@dataclass(frozen=True, eq=False)
class RayData:
    """m rays in the frame of a member (z along its axis, from 0 at its start).

    rows : (m,) of the scan's rays.   o, d : (m, 3).
    range_m : (m,), nan where the ray passed.   distance : (m,) range at which the ray passes the axis.
    legendre, slopes : (m, degree + 1) Legendre polynomials and their slopes at the height of that place.   ahead : (m,) o's height less that height.
    hits_2d : (h, 2) where the hits lie in the plane of the section.   window : (2,) range and width over which outliers may lie.
    size : m, of the section.   least_width : m, what the rays can resolve at all.   ends : (2,) heights.
    """

    T_world_frame: FloatArray
    rows: IntArray
    o: FloatArray
    d: FloatArray
    range_m: FloatArray
    distance: FloatArray
    legendre: FloatArray
    slopes: FloatArray
    ahead: FloatArray
    foot_rad: FloatArray
    hits_2d: FloatArray
    window: FloatArray
    ends: FloatArray
    size: float
    least_width: float
    footprint_known: bool
    hits_only: bool

    def __len__(self) -> int:
        return len(self.o)

    @functools.cached_property
    def foot_m(self) -> FloatArray:
        """(m,) width of each beam where its ray passes the axis."""
        return self.foot_rad * self.distance

    @property
    def edge_unit_m(self) -> float:
        """Median standard deviation of the beam at the member, as stated (or as is usual): the unit in which edges move."""
        return float(np.median(self.foot_m)) * (1 / FULL_OPENING if self.footprint_known else USUAL_BEAM_RAD)

    def take(self, rows: IntArray) -> RayData:
        """Some of the rays; what describes all of them stays, but fewer rays resolve less."""
        names = ("rows", "o", "d", "range_m", "distance", "legendre", "slopes", "ahead", "foot_rad")
        taken = {name: getattr(self, name)[rows] for name in names}
        return dataclasses.replace(self, least_width=self.least_width * len(self) / max(len(rows), 1), **taken)


def prepared(
    scan: Scan, member: Member, degree: int, footprint_rad: float | None, box: FloatArray | None = None, among: IntArray | None = None
) -> RayData:
    """The rays near the member, in its frame.

    box : (2, 2) lowest and highest corner of the section in the member's frame; by default that of the hits.
    among : rows of the rays to choose from, by default all.   footprint_rad : full opening of the beam, None for what the rays state.
    Raises EstimationError: no rays, none that hit, rays of another frame than the points, a sensor inside the member, too few hits.
    """
    rays, hit_rows = _hits(scan, member.sigma_m)
    to_frame = inverse(member.T_world_member)
    all_range = np.full(len(rays), np.nan)
    all_range[hit_rows] = rays.range_m[hit_rows]
    known = slice(None) if among is None else among
    o, d = applied(to_frame, rays.origin[known]), rotated(to_frame, rays.direction[known])
    range_m, returned = all_range[known], rays.range_m[known]
    length = member.values()["length"]
    if box is None:
        hits = ~np.isnan(range_m)
        xy = o[hits, :2] + range_m[hits, None] * d[hits, :2]
        box = np.quantile(xy, [0.005, 0.995], axis=0)
    size = float(np.ptp(box, axis=0).max())
    require(size > 0, EstimationError, "the points along the rays lie on one line: there is no section to fit; drop the object or fix its dimensions")
    middle, reach = box.mean(axis=0), float(np.linalg.norm(np.ptp(box, axis=0))) / 2 + MARGIN * size
    rows, distance, passes = _near(o, d, range_m, returned, middle, reach, length)
    end_on = _through_ends(o[rows], d[rows], middle, reach, length, MARGIN * size)
    rows, distance, passes = rows[~end_on], distance[~end_on], passes[~end_on]
    n_hits, n_passes = int((~passes).sum()), int(passes.sum())
    says = f"{n_hits} rays hit the member; at least {N_LEAST} are needed to fit it from rays"
    require(n_hits >= N_LEAST, EstimationError, says)
    of_scan = rows if among is None else among[rows]
    foot, foot_known = _footprint(rays, of_scan, footprint_rad)
    o, d, range_m = o[rows], d[rows], range_m[rows]
    height = np.clip(o[:, 2] + distance * d[:, 2], 0.0, length)
    t = 2 * height / length - 1
    legendre = np.polynomial.legendre.legvander(t, degree)
    slope = [np.polynomial.legendre.legval(t, np.polynomial.legendre.legder(row)) for row in np.eye(degree + 1)]
    hit = ~np.isnan(range_m)
    return RayData(
        T_world_frame=np.asarray(member.T_world_member),
        rows=of_scan,
        o=np.ascontiguousarray(o),
        d=np.ascontiguousarray(d),
        range_m=range_m,
        distance=distance,
        legendre=np.asarray(legendre, np.float64),
        slopes=np.asarray(np.stack(slope, axis=1) * (2 / length), np.float64),
        ahead=o[:, 2] - height,
        foot_rad=foot,
        hits_2d=o[hit, :2] + range_m[hit, None] * d[hit, :2],
        window=np.array([2 * reach / float(np.sqrt(1 - np.mean(d[:, 2] ** 2))), 2 * reach]),
        ends=np.array([0.0, length]),
        size=size,
        least_width=RESOLVED * 2 * reach / len(o),
        footprint_known=foot_known,
        hits_only=n_passes == 0,
    )


def _hits(scan: Scan, sigma_m: float) -> tuple[Rays, IntArray]:
    """The rays and the rows of those that hit the object. Raises EstimationError."""
    require(scan.rays is not None and len(scan.rays) > 0, EstimationError, "the scan has no rays: state where the sensor stood, or fit to the points")
    rays: Rays = scan.rays  # type: ignore[assignment]
    of_ray = np.flatnonzero(scan.cloud.ray >= 0)
    rows = scan.cloud.ray[of_ray]
    says = f"none of the {len(rays)} rays hit the object: its points carry no ray, or every ray is a miss; fit to the points instead"
    require(len(rows) > 0, EstimationError, says)
    require(int(rows.max()) < len(rays), EstimationError, f"a point names ray {int(rows.max())}, but there are {len(rays)} rays")
    to = scan.cloud.points[of_ray] - rays.origin[rows]
    distance = np.linalg.norm(to, axis=1)
    off = np.linalg.norm(to - np.einsum("nc,nc->n", to, rays.direction[rows])[:, None] * rays.direction[rows], axis=1)
    worst = float(np.median(off))
    limit = OFF_RAY * float(np.median(distance)) + 6 * sigma_m
    says = f"the points lie {worst:.3g} m off their rays (limit {limit:.3g} m): the rays are of another frame; move their origins with the points"
    require(worst <= limit, EstimationError, says)
    good = np.isfinite(rays.range_m[rows])
    require(good.any(), EstimationError, "every ray of the object's points is a miss (range nan): the ranges are needed")
    return rays, rows[good]


def _near(
    o: FloatArray, d: FloatArray, hit_range: FloatArray, range_m: FloatArray, middle: FloatArray, reach: float, length: float
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Rows of the rays that pass within `reach` of the middle of the section, the range where they do, and which of them passed by."""
    across = np.hypot(d[:, 0], d[:, 1])
    w = middle - o[:, :2]
    steep = across > ALONG_AXIS
    square = np.where(steep, across, 1.0) ** 2
    distance = (w[:, 0] * d[:, 0] + w[:, 1] * d[:, 1]) / square
    gap = np.abs(w[:, 0] * d[:, 1] - w[:, 1] * d[:, 0]) / np.sqrt(square)
    height = o[:, 2] + distance * d[:, 2]
    near = steep & (gap < reach) & (distance > 0) & (height > -reach) & (height < length + reach)
    half = reach / np.sqrt(square)
    is_hit = np.isfinite(hit_range) & (np.abs(hit_range - distance) < half)
    passes = np.isnan(hit_range) & (np.isnan(range_m) | (range_m > distance + half))
    rows = np.flatnonzero(near & (is_hit | passes))
    return rows, distance[rows], passes[rows]


def _through_ends(o: FloatArray, d: FloatArray, middle: FloatArray, reach: float, length: float, margin: float) -> BoolArray:
    """(n,) True where a ray comes in through an end of the member rather than through its side; which rays do is no matter of what they hit."""
    out = np.zeros(len(o), bool)
    for height, beyond in ((0.0, o[:, 2] < margin), (length, o[:, 2] > length - margin)):
        dz = np.where(beyond & (np.abs(d[:, 2]) > 0), d[:, 2], np.nan)
        for z in (height - margin, height, height + margin):
            s = (z - o[:, 2]) / dz
            at = o[:, :2] + s[:, None] * d[:, :2] - middle
            out |= (s > 0) & (np.hypot(at[:, 0], at[:, 1]) < reach)
    return out


def _footprint(rays: Rays, rows: IntArray, stated_rad: float | None) -> tuple[FloatArray, bool]:
    """(n,) full opening of each beam, and whether it is known; ones where it is not."""
    if stated_rad is not None:
        return np.full(len(rows), stated_rad), True
    if rays.footprint_rad is not None and np.isfinite(rays.footprint_rad[rows]).all():
        return np.asarray(rays.footprint_rad[rows]), True
    return np.full(len(rows), 1.0), False


def outline_box(member: Member, margin_m: float) -> FloatArray:
    """(2, 2) lowest and highest corner of the member's section, widened."""
    corners = np.concatenate(section(member.family, member.values()).loops)
    return np.stack([corners.min(axis=0) - margin_m, corners.max(axis=0) + margin_m])
