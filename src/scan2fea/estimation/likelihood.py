"""The likelihood of the points of a member: a section swept along a nearly straight axis, noise around it, and a few points that belong to neither.

`Layout` is the one place that knows where each unknown stands; `SectionModel` turns the unknowns into log p and exact scores for `scoring.maximise`.

    p(point) = (1 - eps) p_section(R(-roll(z)) (xy - axis(z)); dimensions, sigma) + eps / A

A is the area of the convex hull of the points in the plane of the section (a box would change with the roll and so bias the walls).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from scan2fea.errors import InputError, UsageError, require
from scan2fea.estimation.arc import Arc
from scan2fea.estimation.scoring import Summed
from scan2fea.kernel.hull_rim import hull_rim
from scan2fea.kernel.noise_kernels import kernel_parts
from scan2fea.kernel.round_sums import round_levels, round_sums
from scan2fea.kernel.section_likelihood import edges_of, faces, is_section, log_density, radius_factors
from scan2fea.kernel.section_sums import INFORMATION, straight_levels, straight_sums
from scan2fea.kernel.sections import PARAMETERS, ROUND
from scan2fea.types import FloatArray, IntArray, Value

MAX_OUTLIERS = 0.3  # shape-estimation.md, method 3: more than this is another object
_SIGMA_FLOOR = 5e-4  # of the section's diameter: 0.06 mm for a 127 mm leg
_STATED_FLOOR = 1e-3  # no noise is known better than to a part in a thousand
_WIDEST_HULL = 4.0  # times its area: beyond, strays are so thin that none is taken for one (walls move by 0.01 mm from 2 to 4)
_LEAST_LOGIT, _HALVINGS = -16.0, 40
_LOGIT_PRIOR = (-5.0, 1.5)  # same place: mean and sd of log(eps / (1 - eps))


@dataclass(frozen=True, kw_only=True)
class StatedNoise:
    """sigma_m : standard deviation that was measured elsewhere.   error : how well, relative."""

    sigma_m: float
    error: float


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Names and places of the unknowns of a section fit, always in this order:

    the dimensions of the family; roll (rad, of the section's x from the member's x; absent for circles), cx, cy (m, the section's origin);
    log_sigma; logit_outliers; then, where asked for, tilt_x, tilt_y (m at the ends), bow_x2, bow_y2, bow_x3 ... (m), twist1 ... (rad; none of
    circles), all factors of Legendre polynomials of that degree in zeta = -1 .. 1 along the member; weight_FACE (log of points per metre of a
    face against the faces whose weight is not free).
    """

    family: str
    tilt: bool = False
    n_bow: int = 0
    n_twist: int = 0
    free_faces: tuple[str, ...] = ()

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        roll = () if self.family in ROUND else ("roll",)
        tilt = ("tilt_x", "tilt_y") if self.tilt else ()
        bow = tuple(f"bow_{axis}{degree}" for degree in range(2, self.n_bow + 2) for axis in "xy")
        twist = () if self.family in ROUND else tuple(f"twist{degree}" for degree in range(1, self.n_twist + 1))
        weight = tuple(f"weight_{name}" for name in self.free_faces)
        return (*PARAMETERS[self.family], *roll, "cx", "cy", "log_sigma", "logit_outliers", *tilt, *bow, *twist, *weight)

    @functools.cached_property
    def place(self) -> Mapping[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    @property
    def n_values(self) -> int:
        return len(PARAMETERS[self.family])

    def get(self, theta: FloatArray, name: str) -> float:
        """The unknown of that name; 0 where the layout has none (no roll, no twist ...)."""
        return float(theta[self.place[name]]) if name in self.place else 0.0

    def values(self, theta: FloatArray) -> FloatArray:
        """(p,) the dimensions."""
        return theta[: self.n_values]

    def sigma(self, theta: FloatArray) -> float:
        return math.exp(self.get(theta, "log_sigma"))

    def outlier_share(self, theta: FloatArray) -> float:
        return 1 / (1 + math.exp(-self.get(theta, "logit_outliers")))

    def axis(self, theta: FloatArray) -> FloatArray:
        """(2, k) Legendre coefficients, degree 0 first, of the place of the section's origin along the member."""
        degree = max(1 if self.tilt else 0, self.n_bow + 1 if self.n_bow else 0)
        rows = [[f"c{axis}", f"tilt_{axis}", *(f"bow_{axis}{k}" for k in range(2, degree + 1))][: degree + 1] for axis in "xy"]
        return np.array([[self.get(theta, name) for name in row] for row in rows])

    def roll(self, theta: FloatArray) -> FloatArray:
        """(k,) Legendre coefficients, degree 0 first, of the roll along the member."""
        return np.array([self.get(theta, "roll"), *(self.get(theta, f"twist{k}") for k in range(1, self.n_twist + 1))])

    def moved(self, theta: FloatArray, other: Layout) -> FloatArray:
        """theta in another layout of the same family: unknowns it does not have are left out, new ones are 0."""
        require(other.family == self.family, UsageError, f"a layout of {self.family} cannot become one of {other.family}")
        return np.array([self.get(theta, name) for name in other.names])


@dataclass(frozen=True, eq=False, kw_only=True)
class SectionModel(Value):
    """Points and what is known of them.

    xy : (n, 2) metres, across the provisional member axis.   zeta : (n,) in [-1, 1] along it.   area_m2 : of the outliers' uniform law.
    face_weight : (f,) points per metre of each face, relative (see `section_likelihood`), before the free ones; None: all alike.
    arc : of a circle that was seen in part; None: all round.   stated : noise that is known; None: it is fitted alone.
    """

    layout: Layout
    xy: FloatArray
    zeta: FloatArray
    area_m2: float
    noise: str = "gaussian"
    face_weight: FloatArray | None = None
    arc: Arc | None = None
    stated: StatedNoise | None = None

    @functools.cached_property
    def _free_rows(self) -> list[int]:
        return [faces(self.layout.family).index(name) for name in self.layout.free_faces]

    @functools.cached_property
    def _legendre(self) -> FloatArray:
        """(n, k) polynomials 0 .. k - 1 at the points."""
        layout = self.layout
        degree = max(int(layout.tilt), layout.n_bow + 1 if layout.n_bow else 0, layout.n_twist)
        return np.ascontiguousarray(np.polynomial.legendre.legvander(self.zeta, degree), float)  # of one order: else kernels are compiled twice

    def weights(self, theta: FloatArray) -> FloatArray | None:
        """(f,) the face weights at theta, None for all alike."""
        if self.face_weight is None and not self._free_rows:
            return None
        base = np.ones(len(faces(self.layout.family))) if self.face_weight is None else np.array(self.face_weight, float)
        if self._free_rows:
            base[self._free_rows] = np.exp(theta[-len(self._free_rows) :])
        return base

    def in_section(self, theta: FloatArray) -> FloatArray:
        """(n, 2) the points in the frame of the section at theta."""
        axis, roll = self.layout.axis(theta), self.layout.roll(theta)
        away = self.xy - self._legendre[:, : axis.shape[1]] @ axis.T
        turn = self._legendre[:, : len(roll)] @ roll if len(roll) > 1 else roll[0]
        c, s = np.cos(turn), np.sin(turn)
        return np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], 1)

    def evaluate(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """logp (n,) and scores (n, p) at theta; a log of -inf where the dimensions make no section."""
        layout = self.layout
        if not is_section(layout.family, layout.values(theta)):
            return np.full(len(self.xy), -np.inf), np.zeros((len(self.xy), len(theta)))
        u = self.in_section(theta)
        d = log_density(u, layout.family, layout.values(theta), layout.sigma(theta), self.noise, self.weights(theta))
        eps = layout.outlier_share(theta)
        stray = math.log(eps / self.area_m2)
        logp = np.logaddexp(math.log1p(-eps) + d.logp, stray)
        own = np.exp(math.log1p(-eps) + d.logp - logp)  # probability that the point is of the section
        scores = np.zeros((len(u), len(theta)))
        place = layout.place
        scores[:, : layout.n_values] = d.d_values
        scores[:, place["log_sigma"]] = d.d_log_sigma
        self.placement_scores(scores, theta, u, d.d_point)
        if self._free_rows:
            scores[:, -len(self._free_rows) :] = d.d_log_weight[:, self._free_rows]
        scores *= own[:, None]
        scores[:, place["logit_outliers"]] = (1 - eps) - own
        return logp, scores

    def placement_scores(self, scores: FloatArray, theta: FloatArray, u: FloatArray, g: FloatArray) -> None:
        """Roll, place, tilt, bow and twist: the chain rule from the gradient g by the point in the section's frame."""
        layout, place = self.layout, self.layout.place
        roll = layout.roll(theta)
        turn = self._legendre[:, : len(roll)] @ roll if len(roll) > 1 else roll[0]
        c, s = np.cos(turn), np.sin(turn)
        by_axis = {"x": s * g[:, 1] - c * g[:, 0], "y": -s * g[:, 0] - c * g[:, 1]}
        if "roll" in place:
            by_roll = g[:, 0] * u[:, 1] - g[:, 1] * u[:, 0]
            scores[:, place["roll"]] = by_roll
            for k in range(1, layout.n_twist + 1):
                scores[:, place[f"twist{k}"]] = by_roll * self._legendre[:, k]
        for axis, by in by_axis.items():
            scores[:, place[f"c{axis}"]] = by
            if layout.tilt:
                scores[:, place[f"tilt_{axis}"]] = by * self._legendre[:, 1]
            for k in range(2, layout.n_bow + 2 if layout.n_bow else 0):
                scores[:, place[f"bow_{axis}{k}"]] = by * self._legendre[:, k]

    def sums(self, theta: FloatArray, asked: int = INFORMATION) -> Summed:
        """The log likelihood, its slope and the outer products of its scores, over all points; -inf where the dimensions make no section."""
        layout = self.layout
        curve = (int(layout.tilt), layout.n_bow, layout.n_twist)
        base, rows = self._faces
        theta = np.array(theta, float)  # one that may be written to: else the kernel is compiled once more
        parts = kernel_parts(self.noise)
        if layout.family in ROUND:
            whole = round_sums(self.xy, self._legendre, theta, curve, base, rows, radius_factors(layout.family), parts, self.area_m2, asked)
            return whole if self.arc is None else self._of_arc(self.arc, theta, *whole)
        return straight_sums(self.xy, self._legendre, theta, curve, base, rows, *edges_of(layout.family), parts, self.area_m2, asked)

    def _of_arc(self, arc: Arc, theta: FloatArray, level: float, slope: FloatArray, products: FloatArray) -> Summed:
        """The sums of whole circles as those of the arc that was seen."""
        at = [self.layout.place["cx"], self.layout.place["cy"]]
        gain, by_centre = arc.log_share(theta[at])
        n = (1 - self.layout.outlier_share(theta)) * len(self.xy)
        slope = slope.copy()
        slope[at] += n * by_centre
        return level + n * gain, slope, products

    def levels(self, thetas: FloatArray) -> FloatArray:
        """(g,) log likelihoods at each of (g, q) thetas of a straight member with all its faces."""
        thetas, parts = np.array(thetas, float), kernel_parts(self.noise)
        if self.layout.family in ROUND:
            return round_levels(self.xy, thetas, radius_factors(self.layout.family), parts, self.area_m2)
        return straight_levels(self.xy, thetas, *edges_of(self.layout.family), parts, self.area_m2)

    @functools.cached_property
    def _faces(self) -> tuple[FloatArray, IntArray]:
        """(f,) weights of the faces where they are not free, and the rows of those that are."""
        base = np.ones(len(faces(self.layout.family))) if self.face_weight is None else np.array(self.face_weight, float)
        return base, np.array(self._free_rows, np.int64)

    def own_probability(self, theta: FloatArray) -> FloatArray:
        """(n,) probability of each point to be of the section rather than stray."""
        layout = self.layout
        d = log_density(self.in_section(theta), layout.family, layout.values(theta), layout.sigma(theta), self.noise, self.weights(theta))
        eps = layout.outlier_share(theta)
        return np.asarray(1 / (1 + np.exp(math.log(eps / self.area_m2) - math.log1p(-eps) - d.logp)))


def prior(layout: Layout, stated: StatedNoise | None = None) -> tuple[FloatArray, FloatArray]:
    """Mean and sd of every unknown for `scoring.maximise`: the share of outliers has one, and noise that was stated."""
    mean, sd = np.zeros(len(layout.names)), np.full(len(layout.names), np.inf)
    mean[layout.place["logit_outliers"]], sd[layout.place["logit_outliers"]] = _LOGIT_PRIOR
    if stated is not None:
        mean[layout.place["log_sigma"]], sd[layout.place["log_sigma"]] = math.log(stated.sigma_m), max(stated.error, _STATED_FLOOR)
    return mean, sd


def among_more(layout: Layout, theta: FloatArray, n: int, n_more: int) -> FloatArray:
    """theta, likeliest on n points, with the share of strays that is likeliest on n_more of the same.

    At the optimum the strays found and the pull of the prior add up to n eps. Where there are hardly any, it is the prior that holds the share up,
    and scoring would lead it down by no more than a factor e an iteration.
    """
    at = layout.place["logit_outliers"]
    found = max(_strays_found(float(theta[at]), n), 0.0) * n_more / n
    low, high = _LEAST_LOGIT, math.log(MAX_OUTLIERS / (1 - MAX_OUTLIERS))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _strays_found(middle, n_more) > found else (middle, high)
    more = theta.copy()
    more[at] = 0.5 * (low + high)
    return more


def _strays_found(logit: float, n: int) -> float:
    """How many of n points are strays where that share is the likeliest under its prior."""
    return n / (1 + math.exp(-logit)) + (logit - _LOGIT_PRIOR[0]) / _LOGIT_PRIOR[1] ** 2


def bounds(layout: Layout, size_m: float, fixed: Mapping[str, float] | None = None) -> tuple[FloatArray, FloatArray]:
    """Closed range of every unknown for a section of about `size_m`: nothing larger than 4 of it or thinner than 1e-5, outliers at most 0.3.

    fixed : unknowns held at a value. Raises UsageError for a name that the layout does not have.
    """
    lower, upper = np.full(len(layout.names), -np.inf), np.full(len(layout.names), np.inf)
    lower[: layout.n_values], upper[: layout.n_values] = 1e-5 * size_m, 4 * size_m
    place = layout.place
    lower[place["log_sigma"]], upper[place["log_sigma"]] = math.log(sigma_floor(size_m)), math.log(size_m)
    lower[place["logit_outliers"]], upper[place["logit_outliers"]] = _LEAST_LOGIT, math.log(MAX_OUTLIERS / (1 - MAX_OUTLIERS))
    for name in layout.free_faces:
        lower[place[f"weight_{name}"]], upper[place[f"weight_{name}"]] = math.log(1e-3), math.log(1e3)
    for name, value in (fixed or {}).items():
        require(name in place, UsageError, f"{name!r} is no unknown of a {layout.family}; it has {', '.join(layout.names)}")
        lower[place[name]] = upper[place[name]] = value
    return lower, upper


def sigma_floor(size_m: float) -> float:
    """The least noise the likelihood is asked about, m: below it the faces are exact and `polish` takes over.

    Without a floor any part of the points that lies exactly on some section outweighs the rest: its density grows without limit as sigma -> 0.
    """
    return _SIGMA_FLOOR * size_m


def scales(layout: Layout, size_m: float) -> FloatArray:
    """Size of a small change of every unknown, for the damping: lengths 1 % of the section, angles and logs 0.1."""
    is_angle = np.array([name.startswith(("roll", "twist", "log", "weight")) for name in layout.names])
    return np.where(is_angle, 0.1, 0.01 * size_m)


def hull_area(xy: FloatArray) -> float:
    """Area of the convex hull of (n, 2) points, m2. Raises InputError where they lie on one line."""
    return hull_of(xy)[0]


def hull_of(xy: FloatArray) -> tuple[float, int]:
    """Area of the convex hull of (n, 2) points, m2, and how many of them are its corners. Raises InputError where they lie on one line."""
    try:
        hull = ConvexHull(hull_rim(np.ascontiguousarray(xy)))
    except (QhullError, ValueError) as error:
        raise InputError(f"the {len(xy)} points of the member lie on one line across its axis; a section needs two directions") from error
    return float(hull.volume), len(hull.vertices)


def stray_area(hull: tuple[float, int], n_strays: float) -> float:
    """Area over which strays are even, m2, of the hull of all points (its area, its corners) and how many of these are strays.

    The hull of m points spread evenly lacks as many parts of m of their area as it has corners (Efron 1965). Where hardly any point is a stray the
    corners are the far ends of the noise: a law that ends just beyond them gets a few units of log likelihood for nothing, takes the ends of the
    noise for strays and so makes the noise smaller and walls thicker (thin L, 20 mm, 200,000 points: 0.3 mm).
    """
    area, corners = hull
    return area * min(1 + corners / max(n_strays, 1e-300), _WIDEST_HULL)


def model_of(
    points: FloatArray,
    layout: Layout,
    z_range: tuple[float, float],
    *,
    area_m2: float | None = None,
    noise: str = "gaussian",
    face_weight: FloatArray | None = None,
    stated: StatedNoise | None = None,
) -> SectionModel:
    """The model of (n, 3) points in a provisional member frame (z along the axis); zeta runs from -1 to 1 over `z_range`."""
    low, high = z_range
    zeta = (2 * points[:, 2] - low - high) / (high - low)
    xy = np.ascontiguousarray(points[:, :2])
    area = hull_area(xy) if area_m2 is None else area_m2
    return SectionModel(layout=layout, xy=xy, zeta=zeta, area_m2=area, noise=noise, face_weight=face_weight, stated=stated)
