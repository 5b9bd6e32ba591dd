"""From the points of one object to a member: axis, section, ends, rays where they are known, and whether the result explains the points.

axis (up to three) -> straightened points -> section of each -> the likelier -> curve and twist that are significant -> ends -> rays -> the test
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from scan2fea.errors import EstimationError, InputError, UsageError, require
from scan2fea.estimation.axis import Axis, axes_of, tilted, turned
from scan2fea.estimation.cap_law import across
from scan2fea.estimation.caps import SOLID, ends_show, inside_of
from scan2fea.estimation.changing import changing, is_better
from scan2fea.estimation.ends import Ends, find_ends, rough_ends
from scan2fea.estimation.explain import MIN_SLENDER, Explanation, explanation, outline_distance
from scan2fea.estimation.fit import MIN_POINTS, FitOptions, SectionFit, fit_section
from scan2fea.estimation.given import Given, Told, compared, joint_p_value
from scan2fea.estimation.initial import Start, starts
from scan2fea.estimation.likelihood import hull_area
from scan2fea.estimation.observability import KERNEL_SPREAD, RESOLVED
from scan2fea.estimation.prismatic import is_prismatic
from scan2fea.estimation.swept import Sweep, sweep_of
from scan2fea.estimation.systematic import even_spacing, face_error, thinned_spacing, widened
from scan2fea.estimation.two_sided import blended
from scan2fea.estimation.with_rays import needs_rays, refined, sensor_inside
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.noise_kernels import KERNELS
from scan2fea.kernel.pinned import SEEN, pinned
from scan2fea.kernel.section_likelihood import face_lengths, faces
from scan2fea.kernel.sections import PARAMETERS, ROUND, section, section_area
from scan2fea.options import option
from scan2fea.types import BoolArray, FloatArray, Member, Parameter, Scan, Value

_POINTS_PER_DEGREE = 150  # points for each degree of curve that is fitted
_SOLID = {"RHS": "rect", "C": "rect", "I": "rect", "L": "rect", "T": "rect", "CHS": "round"}
_BLIND = "the sheet is thinner than two sigma of the noise; it may have been seen from one side only"
_UNSEEN = 0.05  # points per metre against the densest face: what noise carries over from its neighbours
_REACH = "it is only how far the scan reaches: no two faces that were seen fix it"
_FREE_FORM = "along no axis do the points lie on the outline of a section, they fill areas: a free form, such as a sphere, and no member"
_BLENDED = "its two faces do not stand apart: one face under wider noise explains the points too"
_UPRIGHT = 2e-3  # slope of the section across its axis above which it is fitted again along it: the fit shears, errors grow as the square
_RETURNS = 1
_OFF = 0.01  # share of the points in cells that are off, beyond which a changing section is looked for
_CROWDED = 0.2  # share of the points that crowd off the member, four times what is allowed
_HOPELESS = 2.0  # scatter beyond that of neighbours over mill tolerance, four times what is allowed: another shape, whatever the rays say
_CHORD = 2e-3  # of the section: circles bulge so far beyond their polygons, and exact points are rounded
_NEAR_SIGMAS = 4.0  # from the section: what lies further off has no say about the ends


@dataclass(frozen=True, kw_only=True)
class MemberOptions:
    """What is known of the member."""

    family: str = option("", "Family of its section where it is known; empty: all are tried", choices=("", *PARAMETERS))
    noise: str = option("auto", "Law of the noise; auto: the likeliest", choices=("auto", *KERNELS))
    max_degree: int = option(4, "Highest degree of the curve of its axis; 1 for a straight member", minimum=1, maximum=4)
    twist: bool = option(True, "Whether the section may turn along the axis")
    sigma_error: float | None = option(None, "Relative error of a noise that was calibrated elsewhere; none: the noise is fitted", minimum=0.0)
    seed: int = option(0, "Seed of the draws of subsamples", minimum=0)


@dataclass(frozen=True, eq=False, kw_only=True)
class MemberFit(Value):
    """A member and how far it explains the points.

    explains : whether it does, within their noise; `reason` says why or why not, `explanation` holds the figures.
    sag_m, sag_std_m : (2,) mid-length departure from the chord in the section's x and y, before anything insignificant is set to zero.
    length_std_m : of the distance between the end planes on the axis.   section : the fit it came from, in `axis`.   ends : in the member's frame.
    p_fixed : probability of data as far from the fixed dimensions as these if those were true; None where none was fixed or the points tell none.
    given : each fixed or nominal dimension beside what the points say of it.
    why : dimension -> why it is not observable; "rays", "sensor" -> why known rays were not used.   method : "density" or "rays".
    n_axes : provisional axes tried.
    """

    member: Member
    explains: bool
    reason: str
    explanation: Explanation
    sag_m: FloatArray
    sag_std_m: FloatArray
    axis: Axis
    section: SectionFit
    ends: Ends
    p_fixed: float | None
    given: tuple[Given, ...]
    why: Mapping[str, str]
    method: str
    n_axes: int


def fit_member(
    scan: Scan,
    options: MemberOptions = MemberOptions(),
    fixed: Mapping[str, float] | None = None,
    nominal: Mapping[str, float] | None = None,
) -> MemberFit:
    """The member that the points of one object are likeliest to come from.

    fixed : dimensions (m) that are known: they are not fitted, their contradiction by the points is tested (`p_fixed`, `given`); "length" may be
    among them.   nominal : dimensions (m) that are fitted all the same and then compared (`given`); those of other families are left out.
    Raises InputError for fewer than 50 points or points that are not finite; UsageError for bad options; EstimationError where the points lie on
    one line, no section fits, or (nothing being known) seen along no axis they lie on an outline. Other objects that are no member come back with
    `explains` False.
    """
    points = _checked(scan)
    section_fixed = {name: value for name, value in (fixed or {}).items() if name != "length"}
    families = _families(options, section_fixed)
    axes = axes_of(points, options.seed, options.max_degree)
    if not options.family and not fixed:
        require(is_prismatic(points, axes, options.seed), EstimationError, _FREE_FORM)
    found = _swept(points, axes, options, families, fixed or {})
    if nominal:
        found = dataclasses.replace(found, given=(*found.given, *_beside(found, nominal)))
    other = _SOLID.get(found.member.family)
    closed = other in families and found.member.family in ("RHS", "CHS") and ends_show(points, found.member) == SOLID
    short = found.explanation.slenderness < MIN_SLENDER  # along another axis it may be a bar
    may_be = not found.explains and (short or not _is_hopeless(found.explanation))  # where the likeliest is hopeless a likeness of it is too
    if other in families and (closed or may_be):  # from outside a tube and a bar are alike, but a bar's caps are closed
        bar = _swept(points, axes if short else (found.axis,), dataclasses.replace(options, family=other), (other,), fixed or {})
        found = bar if bar.explains else found
    if _may_change(found, fixed or {}):
        found = _with_change(points, found, options, families)
    inside = sensor_inside(scan, found.member)
    if inside:
        found = dataclasses.replace(found, why={**found.why, "sensor": inside})
    elif found.member.change is None and not _is_hopeless(found.explanation) and needs_rays(scan, found.member, found.explains):
        member, told, why_not = refined(scan, found.member, found.explanation, fixed or {}, families, options.seed)
        by_rays = not why_not
        found = dataclasses.replace(
            found,
            member=member,
            explanation=told,
            explains=told.explains,
            reason=told.reason,
            method="rays" if by_rays else "density",
            why={} if by_rays else {**found.why, "rays": why_not},
        )
    return dataclasses.replace(found, member=dataclasses.replace(found.member, inside=inside_of(points, found.member)))


def _may_change(found: MemberFit, fixed: Mapping[str, float]) -> bool:
    """Whether a section that changes along the axis is looked for: where a prism leaves a pattern, and no dimension is held."""
    told = found.explanation
    return not fixed and (not found.explains or told.off_share > _OFF)


def _with_change(points: FloatArray, found: MemberFit, options: MemberOptions, families: tuple[str, ...]) -> MemberFit:
    """The fit with a taper or a haunch where that is likelier than a prism and explains the points; else as it was."""
    fits: list[MemberFit] = []

    def prism(moved: FloatArray, family: str) -> tuple[Member, SectionFit]:
        own = (family,) if family else families
        plain = dataclasses.replace(options, family=family or options.family, max_degree=1, twist=False)
        fits.append(_swept(moved, axes_of(moved, options.seed, 1)[:1], plain, own, {}))
        return fits[-1].member, fits[-1].section

    other = changing(points, found.member, prism, options.seed)
    if other is None or not is_better(other, len(points)):
        return found
    told = explanation(points, other.member, other.section.sigma_m, options.seed)
    if not told.explains:
        return found
    last = fits[-1]
    member = dataclasses.replace(other.member, seen=_seen(last.section, told))
    return dataclasses.replace(last, member=member, explains=True, reason=told.reason, explanation=told, n_axes=found.n_axes)


def _swept(points: FloatArray, axes: tuple[Axis, ...], options: MemberOptions, families: tuple[str, ...], fixed: Mapping[str, float]) -> MemberFit:
    """One round: the section along the likeliest axis, its curve and ends, and the test."""
    section_fixed = {name: value for name, value in fixed.items() if name != "length"}
    axis, fit = _likeliest(points, axes, options, families, section_fixed)
    told_free = _free(points, axis, options, fit) if section_fixed else fit
    sweep, sag, sag_std = _significant(sweep_of(axis, fit), fit)
    coordinates = sweep.coordinates(points)
    rough = rough_ends(coordinates[_near(coordinates, fit), 2])
    sweep = sweep.rebased(*rough)
    coordinates = sweep.coordinates(points)
    ends = _ends(coordinates, fit, sweep.span)
    low, high = (end.position_m - float(end.slope @ end.pivot) for end in (ends.low, ends.high))
    require(high > low, EstimationError, "the ends of the member cannot be told apart")
    p_fixed, given = _tested(fixed, told_free, fit.family, ends)
    if "length" in fixed:
        low, high = _of_length(fixed["length"], low, high, ends)
    sweep = sweep.rebased(low, high)
    member = _member(sweep, fit, ends, fixed)
    told = explanation(points, member, fit.sigma_m, options.seed)
    member = dataclasses.replace(member, seen=_seen(fit, told))
    off_m = face_error(told.pattern_m, told.p_value, fit.sigma_m)
    area = (high - low) * float(face_lengths(fit.family, fit.values) @ np.array([member.seen[name] >= SEEN for name in faces(fit.family)]))
    pitch = max(thinned_spacing(points, options.seed), even_spacing(sweep.coordinates(points)[:, 2], (0.0, high - low), fit.sigma_m, area))
    member = widened(member, pitch, (ends.low.cap_points, ends.high.cap_points), off_m)
    member, untold = _honest(points, member, options)
    return MemberFit(
        member=member,
        explains=told.explains,
        reason=told.reason,
        explanation=told,
        sag_m=sag,
        sag_std_m=sag_std,
        axis=axis,
        section=fit,
        ends=ends,
        p_fixed=p_fixed,
        given=given,
        why={**untold, **fit.why, **{name: _BLIND for name in fit.names if _blind_plate(fit, name)}},
        method="density",
        n_axes=len(axes),
    )


def _checked(scan: Scan) -> FloatArray:
    points = scan.cloud.points
    if scan.cloud.is_inferred is not None:
        points = points[~scan.cloud.is_inferred]
    require(len(points) >= MIN_POINTS, InputError, f"{len(points)} points are too few for a member: at least {MIN_POINTS}")
    require(bool(np.isfinite(points).all()), InputError, "points of a member must be finite; remove nan and inf first")
    return points


def _families(options: MemberOptions, fixed: Mapping[str, float]) -> tuple[str, ...]:
    """The families that are tried: those that have every fixed dimension."""
    families = (options.family,) if options.family else tuple(PARAMETERS)
    for name, value in fixed.items():
        families = tuple(family for family in families if name in PARAMETERS[family])
        what = options.family or "any family of sections"
        require(len(families) > 0, UsageError, f"fixed dimension {name!r} is none of {what}'s, or not together with the others")
        require(math.isfinite(value) and value > 0, UsageError, f"fixed dimension {name} is {value} m; it must be positive")
    return families


def _section(
    points: FloatArray,
    axis: Axis,
    options: MemberOptions,
    families: tuple[str, ...],
    fixed: Mapping[str, float],
    begun: tuple[Start, ...] = (),
) -> SectionFit | EstimationError:
    """The section seen along one axis. A short member's axis may show no section at all: the error is kept until all axes were tried."""
    straight = axis.straightened(points)
    degree = int(np.clip(len(points) // _POINTS_PER_DEGREE, 1, options.max_degree))
    slender = axis.ends[1] - axis.ends[0] >= 2 * axis.size_m
    fit_options = FitOptions(
        families=families,
        noise=options.noise,
        n_bow=degree - 1 if slender else 0,
        n_twist=1 if options.twist and slender and degree > 1 else 0,
        sigma_error=options.sigma_error,
        seed=options.seed,
    )
    try:
        with np.errstate(all="ignore"):  # steps into impossible sections are refused by their likelihood
            return fit_section(straight, fit_options, fixed=fixed, begun=begun)
    except (EstimationError, InputError) as error:
        return EstimationError(str(error))
    except np.linalg.LinAlgError:
        return EstimationError(f"no section explains the {len(points)} points; where they are several bodies, segment first")


def _likeliest(
    points: FloatArray, axes: tuple[Axis, ...], options: MemberOptions, families: tuple[str, ...], fixed: Mapping[str, float]
) -> tuple[Axis, SectionFit]:
    """The axis and its section. Several axes are told apart by quick searches on few points; a box is a bar along each: the longest is its length."""
    begun: list[tuple[Start, ...]] = [()] * len(axes)
    if len(axes) > 1:
        quick = [_quick(points, axis, families, options.seed) for axis in axes]
        order = sorted(range(len(axes)), key=lambda k: (quick[k][0], k))
        if quick[order[0]][1] == "rect":
            order.sort(key=lambda k: (quick[k][1] != "rect", axes[k].ends[0] - axes[k].ends[1]))
        axes, begun = tuple(axes[k] for k in order), [quick[k][2] for k in order]
    failed: EstimationError | None = None
    for axis, starting in zip(axes, begun, strict=True):
        # an angle of unequal legs that are given has one way to run along its axis
        ways = (axis, turned(axis)) if fixed.get("a") != fixed.get("b") else (axis,)
        tried = [_upright(points, way, options, families, fixed, starting if way is axis else ()) for way in ways]
        fitted = [(way, fit) for way, fit in tried if isinstance(fit, SectionFit)]
        if fitted:
            return min(fitted, key=lambda one: one[1].bic)
        failed = failed or next(fit for _, fit in tried if isinstance(fit, EstimationError))
    raise failed or EstimationError("no section fits the points")


def _upright(
    points: FloatArray,
    axis: Axis,
    options: MemberOptions,
    families: tuple[str, ...],
    fixed: Mapping[str, float],
    begun: tuple[Start, ...] = (),
) -> tuple[Axis, SectionFit | EstimationError]:
    """The section along an axis that is tilted until the section stands upright on it. begun : starts along the axis, where there are any."""
    fit = _section(points, axis, options, families, fixed, begun)
    for _ in range(_RETURNS):
        slope = _slope(fit) if isinstance(fit, SectionFit) else np.zeros(2)
        if axis.bow.any() or axis.twist.any() or float(np.abs(slope).max()) < _UPRIGHT:
            break
        axis = tilted(axis, points, slope, options.seed)
        left = tuple(fit.families) if isinstance(fit, SectionFit) else families  # those that the slope did not put out of question
        fit = _section(points, axis, options, left, fixed)
    return axis, fit


def _is_hopeless(told: Explanation) -> bool:
    """Whether the points themselves, whatever the rays say, show another shape: holes, a crowd off the surface, or scatter that is none of theirs.

    The excess is nan where neighbours do not tell the noise: then the rays are asked.
    """
    return told.voids > 0 or told.crowd_share > _CROWDED or told.noise_excess > _HOPELESS


def _slope(fit: SectionFit) -> FloatArray:
    """(2,) how far the fitted section moves across the provisional axis per metre along it, in the frame of the points."""
    low, high = fit.z_range
    across = fit.T_points_fit[:3, :3] @ np.array([*(2 * fit.layout.axis(fit.theta)[:, 1] / (high - low)), 1.0])
    return np.asarray(across[:2] / across[2])


def _quick(points: FloatArray, axis: Axis, families: tuple[str, ...], seed: int) -> tuple[float, str, tuple[Start, ...]]:
    """BIC per point of the density in space along an axis, comparable between axes, the family it is of, and all starts; from some hundred points."""
    straight = axis.straightened(points)
    low, high = axis.ends
    margin = 0.1 * (high - low)
    inside = straight[(straight[:, 2] > low + margin) & (straight[:, 2] < high - margin)]
    if len(inside) < MIN_POINTS:
        return math.inf, "", ()
    try:
        found = starts(inside, families, (low + margin, high - margin), hull_area(inside[sampled_rows(len(inside), 20_000, seed), :2]), seed)
    except InputError:
        return math.inf, "", ()
    best = min(found, key=lambda one: one.bic)
    n = min(len(inside), 600)
    share = len(inside) / len(points)  # what is inside the trimmed ends is 0.8 of a member's points: caps count against an axis
    return best.bic / n + 2 * math.log(0.8 * (high - low) / max(share, 1e-9)), best.layout.family, tuple(found)


def _free(points: FloatArray, axis: Axis, options: MemberOptions, fit: SectionFit) -> SectionFit | None:
    """The same family on the same points with every dimension free; None where no such section fits."""
    free = _section(points, axis, dataclasses.replace(options, family=fit.family), (fit.family,), {})
    return free if isinstance(free, SectionFit) else None


def _tested(fixed: Mapping[str, float], free: SectionFit | None, family: str, ends: Ends) -> tuple[float | None, tuple[Given, ...]]:
    """p-value of all fixed dimensions together, and each beside what the points say of it."""
    if not fixed:
        return None, ()
    told = _told(free, ends)
    if free is not None and {"a", "b"} <= set(fixed) and fixed["a"] < fixed["b"]:  # the free fit calls the longer leg a
        told = dataclasses.replace(told, names=tuple({"a": "b", "b": "a"}.get(name, name) for name in told.names))
    return joint_p_value(fixed, told), compared(fixed, told, family, held=True)


def _told(free: SectionFit | None, ends: Ends) -> Told:
    """What the points tell of the section and of the length."""
    p = 0 if free is None else len(free.names)
    covariance = np.zeros((p + 1, p + 1))
    covariance[p, p] = ends.std_m**2
    if free is None:
        return Told(names=("length",), values=np.array([ends.length_m]), covariance=covariance, observable=(True,))
    covariance[:p, :p] = free.covariance[:p, :p]
    seen = tuple(free.observable.get(name, True) and not _blind_plate(free, name) for name in free.names)
    return Told(names=(*free.names, "length"), values=np.array([*free.values, ends.length_m]), covariance=covariance, observable=(*seen, True))


def _beside(found: MemberFit, nominal: Mapping[str, float]) -> tuple[Given, ...]:
    """Nominal dimensions beside the fitted ones."""
    member = found.member
    own = {name: value for name, value in nominal.items() if name in member.values()}
    told = Told(
        names=tuple(p.name for p in member.parameters),
        values=np.array([p.value_m for p in member.parameters]),
        covariance=member.covariance,
        observable=tuple(p.observable and p.source != "fixed" for p in member.parameters),
    )
    return compared(own, told, member.family, held=False)


def _of_length(length: float, low: float, high: float, ends: Ends) -> tuple[float, float]:
    """End planes at the distance that is known, where both ends together say: the surer one moves less."""
    weight = ends.low.std_m**2 / max(ends.low.std_m**2 + ends.high.std_m**2, 1e-300)
    at = (1 - weight) * low + weight * (high - length)
    return at, at + length


def _significant(sweep: Sweep, fit: SectionFit) -> tuple[Sweep, FloatArray, FloatArray]:
    """The sweep without the degrees of bow and twist that BIC would not pay for, and the sag (2,) with its sd before that.

    A degree of the bow is two unknowns: it stays where its chi-square exceeds 2 log n. Degrees are independent of each other on an even scan.
    """
    axis, roll = sweep.axis.copy(), sweep.roll.copy()
    place, price = fit.layout.place, math.log(fit.n_used)
    c, s = math.cos(roll[0]), math.sin(roll[0])
    turn = np.array([[c, s], [-s, c]])
    sag, sag_std = np.zeros(2), np.full(2, math.inf)
    for degree in range(2, axis.shape[1]):
        names = [f"bow_{one}{degree}" for one in "xy"]
        if names[0] not in place:  # what straightening and twist make of the degrees below
            if not axis[:, 2:degree].any() or np.linalg.norm(axis[:, degree]) < 1e-3 * float(fit.values.max()):
                axis[:, degree] = 0.0
            continue
        rows = [place[name] for name in names]
        covariance = turn @ fit.covariance[np.ix_(rows, rows)] @ turn.T
        value = turn @ axis[:, degree]
        if degree == 2:
            sag, sag_std = 1.5 * value, 1.5 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
        if not np.linalg.det(covariance) > 0 or float(value @ np.linalg.solve(covariance, value)) < 2 * price:
            axis[:, degree] = 0.0
    for degree in range(1, len(roll)):
        row = place.get(f"twist{degree}")
        small = 1e-3 if row is None else math.sqrt(price * max(float(fit.covariance[row, row]), 0.0))
        if abs(roll[degree]) < small:
            roll[degree] = 0.0
    return dataclasses.replace(sweep, axis=axis, roll=roll), sag, sag_std


def _near(coordinates: FloatArray, fit: SectionFit) -> BoolArray:
    """Points in the outline or within four sigma of it: those that can be on the sides or on the caps."""
    distance = outline_distance(section(fit.family, dict(zip(fit.names, fit.values.tolist(), strict=True))), coordinates[:, :2])[0]
    return np.asarray(distance < _NEAR_SIGMAS * fit.sigma_m + _CHORD * float(fit.values.max()))


def _ends(coordinates: FloatArray, fit: SectionFit, span: tuple[float, float]) -> Ends:
    lengths = face_lengths(fit.family, fit.values)
    seen = np.minimum(fit.face_weight, 1.0) if len(fit.face_weight) == len(lengths) else np.ones(len(lengths))
    perimeter = float(lengths @ seen)
    area = section_area(section(fit.family, dict(zip(fit.names, fit.values.tolist(), strict=True))))
    near = coordinates[_near(coordinates, fit)]
    box = float(np.prod(np.maximum(np.ptp(near[:, :2], axis=0), 1e-300))) if len(near) else 1.0
    look = partial(across, fit.family, fit.values, fit.sigma_m, fit.noise, seen, box)
    return find_ends(near, fit.sigma_m, span, area / perimeter if perimeter > 0 else 0.0, look)


def _member(sweep: Sweep, fit: SectionFit, ends: Ends, fixed: Mapping[str, float]) -> Member:
    names = (*fit.names, "length")
    n = len(fit.names)
    covariance = np.zeros((n + 1, n + 1))
    covariance[:n, :n] = fit.covariance[:n, :n]
    covariance[n, n] = ends.std_m**2
    length = sweep.span[1]
    values = (*fit.values.tolist(), fixed.get("length", length))
    parameters = []
    for i, name in enumerate(names):
        if name in fixed:
            covariance[i, :] = covariance[:, i] = 0.0
            parameters.append(Parameter(name=name, value_m=fixed[name], std_m=None, observable=True, source="fixed"))
            continue
        std = math.sqrt(max(float(covariance[i, i]), 0.0))
        blind = _blind_plate(fit, name)
        told = fit.observable.get(name, True) and std > 0 and not blind
        spread = max(std, KERNEL_SPREAD * values[i]) if std > 0 and not told and not blind else None
        parameters.append(Parameter(name=name, value_m=values[i], std_m=std if told else None, observable=told, source="fitted", spread_m=spread))
        if not told:
            covariance[i, :] = covariance[:, i] = 0.0
    degree = int(max((k for k in range(sweep.axis.shape[1]) if sweep.axis[:, k].any()), default=1))
    twists = int(max((k for k in range(len(sweep.roll)) if sweep.roll[k] != 0), default=0))
    normals = np.array([[*ends.low.slope, -1.0], [*(-ends.high.slope), 1.0]])
    return Member(
        family=fit.family,
        parameters=tuple(parameters),
        T_world_member=sweep.T_world_frame,
        bow=sweep.axis[:, 2 : degree + 1],
        twist=np.zeros(0) if fit.family in ROUND else sweep.roll[1 : twists + 1],
        end_normals=normals / np.linalg.norm(normals, axis=1)[:, None],
        covariance=covariance,
        sigma_m=fit.sigma_m,
        noise=fit.noise,
        outlier_share=fit.outlier_share,
        seen=fit.seen,
        families=fit.families,
    )


def _blind_plate(fit: SectionFit, name: str) -> bool:
    """A sheet thinner than two sigma may have been seen from one side only: what looks like its thickness may be the law of the noise."""
    return fit.family == "rect" and fit.value(name) < RESOLVED * fit.sigma_m if name in fit.names else False


def _honest(points: FloatArray, member: Member, options: MemberOptions) -> tuple[Member, Mapping[str, str]]:
    """The member without the dimensions that rest on how far a face reaches, or on a wall that may be one face; and why each is not observable."""
    seen = [name for name, share in member.seen.items() if share >= SEEN]
    fixed = pinned(member.family, seen)
    one_face = blended(points, member, seen) if options.sigma_error is None else frozenset()
    fitted = [p.name for p in member.parameters if p.name != "length" and p.source == "fitted" and p.observable]
    why = {name: _REACH if name not in fixed else _BLENDED for name in fitted if name not in fixed or name in one_face}
    loose = [k for k, p in enumerate(member.parameters) if p.name in why]
    covariance = np.array(member.covariance)
    covariance[loose, :] = covariance[:, loose] = 0.0
    unknown = {p.name for p in member.parameters if p.name in why or (p.spread_m is not None and p.name not in fixed)}  # not even nearly
    loose_one = {p.name: dataclasses.replace(p, std_m=None, observable=False, spread_m=None) for p in member.parameters}
    parameters = tuple(loose_one[p.name] if p.name in unknown else p for p in member.parameters)
    return dataclasses.replace(member, parameters=parameters, covariance=covariance), why


def _seen(fit: SectionFit, told: Explanation) -> Mapping[str, float]:
    """Share of each face that points support; none on a face that the section's fit found hidden."""
    hidden = {name for name, weight in fit.seen.items() if weight < _UNSEEN}
    return {name: 0.0 if name in hidden else share for name, share in told.seen.items()}
