"""The section of a member from its points: family, dimensions, place, noise, and how far to trust each of them.

starts (all families, few points) -> ridge restarts and annealing -> faces not seen -> law of the noise -> the section on all points -> covariance
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import EstimationError, InputError, UsageError, require
from scan2fea.estimation.anneal import climbed, walls
from scan2fea.estimation.arc import Arc, seen_arc
from scan2fea.estimation.candidates import Candidate, Scene, near_again, posterior, scene_of, search, with_likeliest_noise, with_noise
from scan2fea.estimation.canonical import canonical, turned_weight
from scan2fea.estimation.cap_odds import bar_log_odds
from scan2fea.estimation.end_view import end_view
from scan2fea.estimation.ends import rough_ends
from scan2fea.estimation.face_weights import seen_weights
from scan2fea.estimation.initial import Start, size_of
from scan2fea.estimation.laws import PLAUSIBLE, law_spread, with_law_spread
from scan2fea.estimation.likelihood import (
    Layout,
    SectionModel,
    StatedNoise,
    among_more,
    bounds,
    hull_of,
    model_of,
    prior,
    sigma_floor,
    stray_area,
)
from scan2fea.estimation.observability import observable
from scan2fea.estimation.polish import Polished, polished
from scan2fea.estimation.scoring import Scored
from scan2fea.estimation.uncertainty import uncertainty
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.noise_kernels import KERNELS
from scan2fea.kernel.section_likelihood import faces, radius_factors
from scan2fea.kernel.section_sums import SLOPE
from scan2fea.kernel.sections import PARAMETERS, ROUND
from scan2fea.options import option
from scan2fea.types import FloatArray, IntArray, Value
from scan2fea.units import MILLIMETRES_PER_METRE

MIN_POINTS = 50
_LAST_STEPS = 8  # on all points: one or two are enough but where wall and noise trade
_TRIM_SIGMAS = 3.5  # cap points blurred into the length beyond it are one in 4000
_TRIM_SHARE = 0.01  # of the length: what `rough_ends` is good to
_BARS = ("rect", "round")
_POLISH_BELOW = 0.3  # sigma / t (shape-estimation.md, method 7)
_EXACT = 0.02  # sigma / t below which the faces alone are as good as the likelihood, whose maximum is then a needle
_ROUNDING = 1e-7  # of the section's size: how far exact points are known to lie on the faces, and the polish to have ended
_DENIED = 10.83  # chi-square of one degree, p = 0.001
_BETWEEN = 10  # subsamples, before all points
_FEW_POINTS = 5_000  # lead near the optimum of all, where a third of the steps is enough
_NEAR = 0.05  # log-likelihood units of these that may be left on the table
_SANDWICH_POINTS = 8_000  # curvature and outer products agree within 2 %


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    families: tuple[str, ...] = option(tuple(PARAMETERS), "families of sections that are tried", choices=tuple(PARAMETERS))
    noise: str = option("auto", "law of the noise; auto: the likeliest", choices=("auto", *KERNELS))
    hidden_faces: bool = option(True, "also try sections of which some faces were not seen")
    n_bow: int = option(0, "degrees of the axis curve beyond a straight line", minimum=0, maximum=6)
    n_twist: int = option(0, "degrees of the twist along the axis", minimum=0, maximum=4)
    sigma_m: float | None = option(None, "noise of the points where it is known, one standard deviation; none: it is fitted", unit="m", minimum=1e-9)
    sigma_error: float = option(0.02, "how well sigma_m is known, relative", minimum=0.0, maximum=1.0)
    subsample: int = option(20_000, "points that the section is fitted to before all points polish it", minimum=500)
    seed: int = option(0, "of the draws of subsamples", minimum=0)

    @property
    def stated(self) -> StatedNoise | None:
        return None if self.sigma_m is None else StatedNoise(sigma_m=self.sigma_m, error=self.sigma_error)


@dataclass(frozen=True, eq=False, kw_only=True)
class SectionFit(Value):
    """The section of a member in its provisional frame.

    names, values (p,) metres, std (p,): the dimensions; std is 0 where the points do not depend on one.   observable, why : per dimension.
    T_points_fit : (4, 4) proper: the frame theta is expressed in to the frame of the points (a half turn about x where that makes a >= b of an L).
    T_points_section : (4, 4) proper: the section's frame at zeta = 0 (z: along the member, unshifted) to the frame of the points.
    z_range : of the points used, in the frame of the fit: zeta = -1 .. 1.
    layout, theta (q,), covariance (q, q): everything that was fitted (see Layout).   misfit (q,): sd of the sandwich over that of the model.
    sigma_m, noise, outlier_share : of the points.   noises : law -> BIC difference to the best.
    face_weight : (f,) points per metre of each face against the densest, of most likelihood; seen : the same by name.
    families : family -> posterior.   candidates : every hypothesis, best first.
    n_used : points in z_range.   n_weighed : of these, those that face_weight is of.
    """

    family: str
    names: tuple[str, ...]
    values: FloatArray
    std: FloatArray
    observable: Mapping[str, bool]
    why: Mapping[str, str]
    T_points_fit: FloatArray
    T_points_section: FloatArray
    z_range: tuple[float, float]
    layout: Layout
    theta: FloatArray
    covariance: FloatArray
    misfit: FloatArray
    sigma_m: float
    noise: str
    noises: Mapping[str, float]
    outlier_share: float
    face_weight: FloatArray
    base_weight: FloatArray | None
    seen: Mapping[str, float]
    families: Mapping[str, float]
    candidates: tuple[Candidate, ...]
    log_likelihood: float
    bic: float
    n_used: int
    n_weighed: int
    n_iterations: int
    converged: bool

    def value(self, name: str) -> float:
        return float(self.values[self.names.index(name)])


@dataclass(frozen=True, eq=False, kw_only=True)
class _Task(Value):
    """What the last stages share: the points in the frame of the fit and the hypothesis that won."""

    points: FloatArray
    z_range: tuple[float, float]
    hull: tuple[float, int]  # of all points across the member: area and corners
    area_m2: float  # of strays
    size_m: float
    fixed: Mapping[str, float]
    best: Candidate
    options: FitOptions
    arc: Arc | None = None  # of a circle that was seen in part

    def model(self, layout: Layout, at_most: int | None = None) -> SectionModel:
        some = self.points if at_most is None else self.points[sampled_rows(len(self.points), at_most, self.options.seed)]
        model = model_of(
            some, layout, self.z_range, area_m2=self.area_m2, noise=self.best.noise, face_weight=self.best.face_weight, stated=self.options.stated
        )  # fmt: skip
        return model if self.arc is None else replace(model, arc=self.arc)

    def with_strays(self, share: float, among: int) -> _Task:
        """The same, knowing what share of so many points are strays: these at least are known to fill the hull."""
        return replace(self, area_m2=stray_area(self.hull, share * among))

    def with_arc(self, layout: Layout, theta: FloatArray) -> _Task:
        """The same, knowing what part of a circle was seen."""
        if layout.family not in ROUND:
            return self
        radii, middle = radius_factors(layout.family) @ layout.values(theta), layout.axis(theta)[:, 0]
        return replace(self, arc=seen_arc(self.model(layout, self.options.subsample).in_section(theta), radii, layout.sigma(theta), middle))


def fit_section(
    points: FloatArray,
    options: FitOptions = FitOptions(),
    *,
    fixed: Mapping[str, float] | None = None,
    z_range: tuple[float, float] | None = None,
    begun: tuple[Start, ...] = (),
) -> SectionFit:
    """The likeliest section of a straight (or nearly straight) member.

    points : (n, 3) metres in a provisional member frame: z along the axis within a few degrees, ends included.   fixed : dimensions (m) that are
    known and not fitted.   z_range : where the section is to be fitted; None: between the ends, trimmed so that points of the caps do not count.
    begun : places to search from, in the frame of the points; none: they are found.
    Raises InputError for fewer than 50 points, points that are not finite or lie on one line; UsageError for bad options; EstimationError where no
    family fits.
    """
    points = _checked(points, options, fixed)
    fixed = fixed or {}
    hull = hull_of(points[:, :2])  # of all: strays of a smaller area than the points fill would be likelier than they are
    area, size = hull[0], size_of(points[:, :2])
    low, high = rough_ends(points[:, 2])
    z_used = z_range or (low, high)
    rows = _between(points, z_used)
    where = f"z {z_used[0]:.6g} .. {z_used[1]:.6g} m"
    require(len(rows) >= MIN_POINTS, InputError, f"only {len(rows)} points lie in {where}; a section needs {MIN_POINTS}")
    scene = scene_of(points, rows, z_used, area, size, fixed, options.seed, options.stated)
    found = search(scene, options.families, may_hide=options.hidden_faces, seed=options.seed, begun=begun)
    if z_range is None:
        z_used = _trimmed(low, high, found[0].layout.sigma(found[0].theta))
        rows = _between(points, z_used)
        require(len(rows) > 0, EstimationError, "no points are left between the ends of what was fitted: it is no longer than its noise reaches")
        scene = scene_of(points, rows, z_used, area, size, fixed, options.seed, options.stated)
        found = near_again(scene, found)
    found = _with_ends(points, found, (low, high), z_used)
    found, noises = with_likeliest_noise(scene, found, tuple(KERNELS) if options.noise == "auto" else (options.noise,))
    best = found[0]
    require(math.isfinite(best.bic), EstimationError, f"no section of {', '.join(options.families)} fits the {len(rows)} points")
    other = _denied_law(scene, best, options)
    if other:
        free = fit_section(points, replace(options, noise="auto", sigma_m=None), fixed=fixed, z_range=z_range, begun=begun)
        return replace(free, why={**free.why, "sigma": other})
    inside = points[rows]
    layout, theta, turned = canonical(best.layout, best.theta, fixed)
    if turned and layout.family == "L":
        inside, z_used = inside * np.array([1.0, -1.0, -1.0]), (-z_used[1], -z_used[0])
    if turned and best.face_weight is not None:
        best = replace(best, face_weight=turned_weight(layout.family, best.face_weight))
    longer = replace(layout, tilt=True, n_bow=options.n_bow, n_twist=options.n_twist)
    task = _Task(points=inside, z_range=z_used, hull=hull, area_m2=area, size_m=size, fixed=fixed, best=best, options=options)
    task = task.with_strays(layout.outlier_share(theta), len(scene.points)).with_arc(layout, theta)
    last = _final(task, longer, layout.moved(theta, longer))
    denied = _denied(task, longer, last[1].theta)
    if denied:
        free = fit_section(points, replace(options, sigma_m=None), fixed=fixed, z_range=z_range, begun=begun)
        return replace(free, why={**free.why, "sigma": denied})
    return _result(task, *last, found, noises, turned)


def _denied_law(scene: Scene, best: Candidate, options: FitOptions) -> str:
    """Why the points deny the law of noise that was stated together with its size, "" where they do not."""
    if options.stated is None or options.noise == "auto":
        return ""
    under = {law: with_noise(scene, best, law).bic for law in KERNELS if law != options.noise}
    law = min(under, key=lambda name: under[name])
    if best.bic <= under[law] + _DENIED:
        return ""
    return f"the points deny the stated {options.noise} law of noise ({law} is likelier by {best.bic - under[law]:.0f} BIC units), it was not used"


def _denied(task: _Task, layout: Layout, theta: FloatArray) -> str:
    """Why the points deny the noise that was stated, "" where they do not.

    Freed of it they may be likelier by chance only: twice the gain and the square of the departure, in units of its error, are together chi-square
    of one degree.
    """
    stated = task.options.stated
    if stated is None:
        return ""
    held = {name: value for name, value in task.fixed.items() if name in layout.place}
    model = task.model(layout, task.options.subsample)
    bound = climbed(model, theta, task.size_m, fixed=held)
    free = climbed(replace(model, stated=None), bound.theta, task.size_m, fixed=held)
    mean, sd = prior(layout, stated)
    at = layout.place["log_sigma"]
    away = float((bound.theta[at] - mean[at]) / sd[at])
    if 2 * (free.log_likelihood - bound.log_likelihood) + away**2 <= _DENIED:
        return ""
    said, found = (MILLIMETRES_PER_METRE * sigma for sigma in (stated.sigma_m, layout.sigma(free.theta)))
    return f"the points deny the stated noise of {said:.3g} mm (they have {found:.3g} mm), it was not used"


def _checked(points: FloatArray, options: FitOptions, fixed: Mapping[str, float] | None) -> FloatArray:
    points = np.ascontiguousarray(points, float)
    require(points.ndim == 2 and points.shape[1] == 3, InputError, f"points of a member have three coordinates, not the shape {points.shape}")
    require(len(points) >= MIN_POINTS, InputError, f"{len(points)} points are too few for a member: at least {MIN_POINTS}")
    require(bool(np.isfinite(points).all()), InputError, "points of a member must be finite; remove nan and inf first")
    require(len(options.families) > 0, UsageError, "estimation.families is empty; name at least one family")
    for family in options.families:
        require(family in PARAMETERS, UsageError, f"section family {family!r} is unknown; choose one of {', '.join(PARAMETERS)}")
    require(options.noise in ("auto", *KERNELS), UsageError, f"noise kernel {options.noise!r} is unknown; choose auto or one of {', '.join(KERNELS)}")
    known = {name for family in options.families for name in PARAMETERS[family]}
    for name, value in (fixed or {}).items():
        require(name in known, UsageError, f"fixed dimension {name!r} is none of {', '.join(options.families)}: they have {', '.join(sorted(known))}")
        require(math.isfinite(value) and value > 0, UsageError, f"fixed dimension {name} is {value} m; it must be positive")
    return points


def _between(points: FloatArray, z_range: tuple[float, float]) -> IntArray:
    return np.flatnonzero((points[:, 2] >= z_range[0]) & (points[:, 2] <= z_range[1]))


def _trimmed(low: float, high: float, sigma: float) -> tuple[float, float]:
    """Without the ends, but never more than the outer three tenths on either side: a stub keeps points."""
    margin = min(_TRIM_SIGMAS * sigma + _TRIM_SHARE * (high - low), 0.3 * (high - low))
    return low + margin, high - margin


def _with_ends(points: FloatArray, found: list[Candidate], ends: tuple[float, float], z_range: tuple[float, float]) -> list[Candidate]:
    """Bars weighed by what the ends show: only they have caps that are full."""
    weighed = []
    for c in found:
        view = end_view(points, c, ends, z_range) if c.family in _BARS else None
        gain = 0.0 if view is None else 2 * bar_log_odds(view.n_core, view.n_elsewhere, view.n_cap)
        weighed.append(replace(c, bic=c.bic - gain, price=c.price - gain))
    return sorted(weighed, key=lambda c: c.bic)


def _final(task: _Task, layout: Layout, theta: FloatArray) -> tuple[Layout, Scored, FloatArray | None]:
    """The optimum on a subsample, then on all points (from near: mostly two steps), then by the faces where the noise is small.

    The third is the covariance where it comes from the faces and not from the likelihood.
    """
    held = {name: value for name, value in task.fixed.items() if name in layout.place}
    some, few = task.model(layout, task.options.subsample), task.model(layout, _FEW_POINTS)
    near = climbed(few, theta, task.size_m, fixed=held, tolerance=_NEAR) if len(few.xy) < len(some.xy) else None
    done = climbed(some, theta if near is None else among_more(layout, near.theta, len(few.xy), len(some.xy)), task.size_m, fixed=held)
    thinnest = min((layout.get(done.theta, wall) for wall in walls(layout.family)), default=float(layout.values(done.theta).min()))
    if layout.sigma(done.theta) < _POLISH_BELOW * thinnest:
        smooth = polished(few, done.theta, task.size_m, held)
        if smooth.converged:
            if layout.sigma(smooth.theta) < max(_EXACT * thinnest, 2 * sigma_floor(task.size_m)):
                return _exact(task, layout, done, smooth, held)
            done = max((done, climbed(some, smooth.theta, task.size_m, fixed=held, max_iterations=8)), key=lambda s: s.log_posterior)
    if len(task.points) > len(some.xy):
        told, n = task.with_strays(layout.outlier_share(done.theta), len(some.xy)), len(some.xy)
        for most in (_BETWEEN * len(some.xy), len(task.points)):  # each leads nearer to the next, in as few looks at all points as can be
            if most <= len(task.points):
                start = among_more(layout, done.theta, n, most)
                done = climbed(told.model(layout, most), start, task.size_m, fixed=held, max_iterations=_LAST_STEPS, tolerance=1e-2)
                n = most
        done = replace(done, converged=True)
    return layout, done, None


def _exact(task: _Task, layout: Layout, done: Scored, smooth: Polished, held: Mapping[str, float]) -> tuple[Layout, Scored, FloatArray]:
    """The faces alone, on all points."""
    if len(task.points) > _FEW_POINTS:
        again = polished(task.model(layout), smooth.theta, task.size_m, held)
        smooth = again if again.converged else smooth
    rounding = np.zeros(len(smooth.theta))
    rounding[: layout.n_values] = np.where(np.diag(smooth.covariance)[: layout.n_values] > 0, (_ROUNDING * task.size_m) ** 2, 0.0)
    return layout, replace(done, theta=smooth.theta, converged=True), smooth.covariance + np.diag(rounding)


def _result(
    task: _Task, layout: Layout, done: Scored, covariance: FloatArray | None, found: list[Candidate], noises: Mapping[str, Candidate], turned: bool
) -> SectionFit:
    held = {name: value for name, value in task.fixed.items() if name in layout.place}
    lower, upper = bounds(layout, task.size_m, held)
    free = np.asarray((lower < upper) & ~done.at_bound, bool)
    model = task.model(layout, _SANDWICH_POINTS)
    misfit = np.ones(len(done.theta))
    if covariance is None:
        believed, each = prior(layout, task.options.stated), len(task.points) / len(model.xy)
        trust = uncertainty(model.sums, done.theta, free, believed, slope=lambda theta: model.sums(theta, SLOPE)[1], weight=each)
        covariance, misfit = with_law_spread(layout, trust.covariance, noises), trust.misfit
    values, names, sigma = layout.values(done.theta), PARAMETERS[layout.family], layout.sigma(done.theta)
    std = np.sqrt(np.diag(covariance)[: len(values)])
    told = observable(
        layout.family,
        dict(zip(names, values.tolist(), strict=True)),
        dict(zip(names, std.tolist(), strict=True)),
        sigma,
        sigma_error=None if task.options.sigma_m is None else task.options.sigma_error,
        kernel_spread=law_spread(layout.family, noises),
        plausible_spread=law_spread(layout.family, noises, PLAUSIBLE),
    )
    weighed = task.model(layout, task.options.subsample)  # of 8,000 points a narrow toe between blurred faces holds too few
    weight = seen_weights(weighed, done.theta)
    weight = weight / max(float(weight.max()), 1e-300)
    T_points_fit = np.diag([1.0, -1.0, -1.0, 1.0]) if turned and layout.family == "L" else np.eye(4)
    best = min(c.bic for c in noises.values())
    return SectionFit(
        family=layout.family,
        names=names,
        values=values,
        std=std,
        observable={name: ok for name, (ok, _) in told.items()},
        why={name: why for name, (_, why) in told.items() if why},
        T_points_fit=T_points_fit,
        T_points_section=T_points_fit @ _placement(layout, done.theta),
        z_range=task.z_range,
        layout=layout,
        theta=done.theta,
        covariance=covariance,
        misfit=misfit,
        sigma_m=sigma,
        noise=task.best.noise,
        noises={name: c.bic - best for name, c in noises.items()},
        outlier_share=layout.outlier_share(done.theta),
        face_weight=weight,
        base_weight=task.best.face_weight,
        seen=dict(zip(faces(layout.family), np.minimum(weight, 1).tolist(), strict=True)),
        families=posterior(found),
        candidates=tuple(found),
        log_likelihood=done.log_likelihood,
        bic=-2 * done.log_posterior + int(free.sum()) * math.log(len(task.points)),
        n_used=len(task.points),
        n_weighed=len(weighed.xy),
        n_iterations=done.n_iterations,
        converged=done.converged,
    )


def _placement(layout: Layout, theta: FloatArray) -> FloatArray:
    """(4, 4) the section's frame at zeta = 0 to the frame of the fit."""
    roll, axis = layout.roll(theta), layout.axis(theta)
    middle = np.polynomial.legendre.legvander(np.zeros(1), max(axis.shape[1], len(roll)))[0]
    turn = 0.0 if layout.family in ROUND else float(middle[: len(roll)] @ roll)
    c, s = math.cos(turn), math.sin(turn)
    T = np.eye(4)
    T[:2, :2] = [[c, -s], [s, c]]
    T[:2, 3] = axis @ middle[: axis.shape[1]]
    return T
