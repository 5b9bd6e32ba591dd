"""From the points of one object to a member: axis, section, ends, rays where they are known, and whether the result explains the points.

axis (up to three) -> straightened points -> section of each -> the likelier -> curve and twist that are significant -> ends -> rays -> the test
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import EstimationError, InputError, UsageError, require
from scan2fea.estimation.along_axis import MemberOptions as MemberOptions
from scan2fea.estimation.along_axis import freed, likeliest
from scan2fea.estimation.as_member import (
    BLENDED,
    blind_plate,
    ends_of,
    honest,
    member_of,
    near_section,
    seen_faces,
    significant,
    with_length_std,
    with_reach,
    without_length,
)
from scan2fea.estimation.axis import Axis, axes_of
from scan2fea.estimation.bare_toes import bare_toes, bare_walls
from scan2fea.estimation.beside import beside
from scan2fea.estimation.caps import HOLLOW, SOLID, ends_show, full_ends, inside_of
from scan2fea.estimation.changing import changing, is_better
from scan2fea.estimation.continued import continued
from scan2fea.estimation.corner_doubt import with_corners, with_hidden_corners
from scan2fea.estimation.cut_toes import cut_toes
from scan2fea.estimation.end_faces import cut_askew
from scan2fea.estimation.ends import Ends, rough_ends
from scan2fea.estimation.ends_show_more import ends_show_more
from scan2fea.estimation.explain import MIN_SLENDER, Explanation, explanation
from scan2fea.estimation.face_noise import doubted_for_rays
from scan2fea.estimation.fit import MIN_POINTS, SectionFit
from scan2fea.estimation.from_outside import TUBE_OF, seen_from_outside, tube_of
from scan2fea.estimation.given import Given, Told, compared, joint_p_value, told_by
from scan2fea.estimation.holes import Covers
from scan2fea.estimation.lacking import lacking
from scan2fea.estimation.mirrored import told_toes
from scan2fea.estimation.open_faces import open_face
from scan2fea.estimation.prismatic import is_prismatic
from scan2fea.estimation.ray_noise import freed_of_ray_noise
from scan2fea.estimation.ray_voids import in_sheets, seen_through
from scan2fea.estimation.reach import end_rows, reach
from scan2fea.estimation.rim import BAR_OF, hollow, is_unsure, with_rim
from scan2fea.estimation.root_fillet import roots_of, squared
from scan2fea.estimation.round_holes import round_holes
from scan2fea.estimation.slopes import at_middle, parallel, slope_of
from scan2fea.estimation.swept import Sweep, sweep_of
from scan2fea.estimation.systematic import even_spacing, face_error, thinned_spacing, widened
from scan2fea.estimation.with_rays import compared_by_rays, needs_rays, refined, sensor_inside
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.pinned import SEEN, pinned
from scan2fea.kernel.section_likelihood import face_lengths, faces
from scan2fea.kernel.sections import PARAMETERS, makes_section
from scan2fea.types import FloatArray, Member, RootFillet, Scan, Value

_SOLID = {**BAR_OF, "C": "rect", "I": "rect", "L": "rect", "T": "rect"}
_BLIND = "the sheet is thinner than two sigma of the noise; it may have been seen from one side only"
_FREE_FORM = "along no axis do the points lie on the outline of a section, they fill areas: a free form, such as a sphere, and no member"
_OFF = 0.01  # share of the points in cells that are off, beyond which a changing section is looked for
_ASKED_FIRST = 8_000  # points
_CROWDED = 0.2  # share of the points that crowd off the member, four times what is allowed
_HOPELESS = 2.0  # scatter beyond that of neighbours over mill tolerance, four times what is allowed: another shape, whatever the rays say


@dataclass(frozen=True, eq=False, kw_only=True)
class MemberFit(Value):
    """A member and how far it explains the points.

    explains : whether it does, within their noise; `reason` says why or why not, `explanation` holds the figures.
    sag_m, sag_std_m : (2,) mid-length departure from the chord between the ends, in the section's x and y, before what is insignificant is set to 0.
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
    covers: Covers = (),
) -> MemberFit:
    """The member that the points of one object are likeliest to come from.

    fixed : dimensions (m) that are known: they are not fitted, their contradiction by the points is tested (`p_fixed`, `given`); "length" may be
    among them.   nominal : dimensions (m) that are fitted all the same and then compared (`given`); those of other families are left out.
    covers : (k, 3) points of each other body around, which may lie on it and hide a hole.
    Raises InputError for fewer than 50 points or points that are not finite; UsageError for bad options; EstimationError where the points lie on
    one line, no section fits, or (nothing being known) seen along no axis they lie on an outline. Other objects that are no member come back with
    `explains` False.
    """
    found = _sharp(scan, options, fixed, nominal, covers)
    pivot = found.member
    scan, found, slope = _with_parallel_flanges(scan, found, options, fixed, nominal, covers)
    rolled = _with_roots(scan, found, slope, options, fixed, nominal, covers)
    return dataclasses.replace(rolled, member=at_middle(rolled.member, pivot))


def _with_roots(
    scan: Scan,
    found: MemberFit,
    slope: tuple[float, float],
    options: MemberOptions,
    fixed: Mapping[str, float] | None,
    nominal: Mapping[str, float] | None,
    covers: Covers,
) -> MemberFit:
    """The fit with the fillets that its points show, to points that are moved as sharp corners would have them. slope : as in `roots_of`."""
    roots = roots_of(_checked(scan), found.member, options.seed, slope)
    if not roots.fillet.radius_m:
        return dataclasses.replace(found, member=with_hidden_corners(dataclasses.replace(found.member, root=roots.fillet)))
    moved = dataclasses.replace(scan, cloud=scan.cloud.replaced(points=squared(scan.cloud.points, found.member, roots)))
    again = _sharp(moved, dataclasses.replace(options, family=found.member.family), fixed, nominal, covers)
    root = roots_of(_checked(scan), again.member, options.seed, slope).fillet
    if not root.radius_m or (found.explains and not again.explains):
        sharp = dataclasses.replace(found.member, root=RootFillet(slope=slope[0], slope_std=slope[1]))
        return dataclasses.replace(found, member=with_hidden_corners(sharp))
    member = dataclasses.replace(_as_doubtful(again.member, found.member), root=root, families=found.member.families)
    return dataclasses.replace(again, member=with_corners(member, found.member))


def _with_parallel_flanges(
    scan: Scan, found: MemberFit, options: MemberOptions, fixed: Mapping[str, float] | None, nominal: Mapping[str, float] | None, covers: Covers
) -> tuple[Scan, MemberFit, tuple[float, float]]:
    """Of flanges that slope: the points as parallel ones would have them, the fit to these, the slope and its standard deviation; else as it was."""
    slope, std = slope_of(_checked(scan), found.member, options.seed)
    if not slope:
        return scan, found, (0.0, 0.0)
    moved = dataclasses.replace(scan, cloud=scan.cloud.replaced(points=parallel(scan.cloud.points, found.member, slope)))
    again = _sharp(moved, dataclasses.replace(options, family=found.member.family), fixed, nominal, covers)
    if found.explains and not again.explains:
        return scan, found, (0.0, 0.0)
    member = dataclasses.replace(again.member, families=found.member.families)
    return moved, dataclasses.replace(again, member=member), (slope, std)


def _as_doubtful(member: Member, before: Member) -> Member:
    """The member with no dimension known better than `before`: points moved off arcs by what was found show no more how far faces are uneven."""
    std = {p.name: p.std_m for p in before.parameters}
    times = np.array([max(1.0, (std.get(p.name) or 0.0) / p.std_m) if p.std_m else 1.0 for p in member.parameters])
    parameters = tuple(
        dataclasses.replace(p, std_m=None if p.std_m is None else p.std_m * float(x)) for p, x in zip(member.parameters, times, strict=True)
    )
    return dataclasses.replace(member, parameters=parameters, covariance=member.covariance * np.outer(times, times))


def _sharp(scan: Scan, options: MemberOptions, fixed: Mapping[str, float] | None, nominal: Mapping[str, float] | None, covers: Covers) -> MemberFit:
    """`fit_member` of sections with sharp corners."""
    points = _checked(scan)
    section_fixed = {name: value for name, value in (fixed or {}).items() if name != "length"}
    families = _families(options, section_fixed)
    axes = axes_of(points, options.seed, options.max_degree)
    if not options.family and not fixed:
        require(is_prismatic(points, axes, options.seed), EstimationError, _FREE_FORM)
    found = _swept(points, axes, options, families, fixed or {}, covers)
    if nominal:
        found = dataclasses.replace(found, given=(*found.given, *_beside(found, nominal)))
    other = _SOLID.get(found.member.family)
    closed = other in families and found.member.family in ("RHS", "CHS") and ends_show(points, found.member) == SOLID
    short = found.explanation.slenderness < MIN_SLENDER  # along another axis it may be a bar
    may_be = not found.explains and (short or not _is_hopeless(found.explanation))  # where the likeliest is hopeless a likeness of it is too
    if other in families and (closed or may_be):  # from outside a tube and a bar are alike, but a bar's caps are closed
        bar = _swept(points, axes if short else (found.axis,), dataclasses.replace(options, family=other), (other,), fixed or {}, covers)
        found = bar if bar.explains else found
    if not fixed:
        found = _tube_for(points, found, options, families, covers)
    if _may_change(found, fixed or {}):
        found = _with_change(points, found, options, families, covers)
    inside = sensor_inside(scan, found.member)
    if inside:
        found = dataclasses.replace(found, why={**found.why, "sensor": inside})
    elif found.member.change is None and needs_rays(scan, found.member, found.explains) and _rays_may_help(scan, found, options.seed):
        member, told, why_not = refined(scan, found.member, found.explanation, fixed or {}, families, options.seed)
        by_rays = not why_not
        found = dataclasses.replace(
            found,
            member=with_rim(points, member) if by_rays else member,
            explanation=told,
            explains=told.explains,
            reason=told.reason,
            method="rays" if by_rays else "density",
            why={} if by_rays else {**found.why, "rays": why_not},
        )
        if by_rays and fixed:
            p_fixed, given = compared_by_rays(scan, member, fixed, options.seed)
            found = dataclasses.replace(found, p_fixed=p_fixed, given=given)
    if found.method == "density" and found.explains and not inside:
        found = dataclasses.replace(found, member=_after_ray_noise(scan, points, found, options.seed))
    member = dataclasses.replace(found.member, inside=inside_of(points, found.member), told_toes=told_toes(points, found.member))
    more = ends_show_more(points, member) if found.explains else ""
    if found.explains and not more and not inside:
        has_rays = scan.rays is not None and bool((scan.cloud.ray >= 0).any())
        more = seen_through(scan, member, options.seed) if has_rays else open_face(points, member, covers)
    if found.explains and not more and not fixed:
        more = full_ends(points, member) or lacking(points, member, options.seed)
    return dataclasses.replace(found, member=member, explains=found.explains and not more, reason=more or found.reason)


def _after_ray_noise(scan: Scan, points: FloatArray, found: MemberFit, seed: int) -> Member:
    """The member freed of what noise along its rays did, or, where these are not known, with the doubt about it."""
    if scan.rays is not None and (scan.cloud.ray >= 0).any():
        return freed_of_ray_noise(scan, found.member, found.section.face_weight, seed)
    return doubted_for_rays(points, found.member, found.section.face_weight, seed)


def _tube_for(points: FloatArray, found: MemberFit, options: MemberOptions, families: tuple[str, ...], covers: Covers) -> MemberFit:
    """Where the ends are seen to be open and no inner face was seen, the tube with the outer faces of the bar that looks the same."""
    family = TUBE_OF.get(found.member.family, found.member.family)
    doubtful = found.member.family in TUBE_OF or found.why.get("t") == BLENDED or _partly_from_outside(found.member)
    if not doubtful or family not in BAR_OF or family not in families or inside_of(points, found.member) != HOLLOW:
        return found
    bar = BAR_OF[family]
    tube = _swept(points, (found.axis,), dataclasses.replace(options, family=bar), (bar,), {}, covers, open_ends=True)
    if not tube.explains or inside_of(points, tube.member) != HOLLOW:
        return found
    known = {**found.member.families, family: found.member.families.get(family, 0.0)}
    return dataclasses.replace(tube, member=dataclasses.replace(tube.member, families=hollow(family, known)))


def _partly_from_outside(member: Member) -> bool:
    """Whether of a tube no inner face was seen, nor each outer one: the rings of its ends may tell a hidden one, but not with a wall of chance."""
    inner = [share for name, share in member.seen.items() if name.endswith("INNER")]
    outer = [share for name, share in member.seen.items() if name.endswith("OUTER")]
    return member.family == "RHS" and max(inner) < SEEN and min(outer) < SEEN


def _may_change(found: MemberFit, fixed: Mapping[str, float]) -> bool:
    """Whether a section that changes along the axis is looked for: where a prism leaves a pattern, and no dimension is held."""
    told = found.explanation
    return not fixed and (not found.explains or told.off_share > _OFF)


def _with_change(points: FloatArray, found: MemberFit, options: MemberOptions, families: tuple[str, ...], covers: Covers) -> MemberFit:
    """The fit with a taper or a haunch where that is likelier than a prism and explains the points; else as it was.

    Of many points some are asked first: what changes by more than noise and tolerance shows in them, and most of what comes here is no member.
    """
    few = points[sampled_rows(len(points), _ASKED_FIRST, options.seed)]
    if len(few) < len(points) and _with_change(few, found, options, families, covers) is found:
        return found
    fits: list[MemberFit] = []

    def prism(moved: FloatArray, family: str) -> tuple[Member, SectionFit]:
        own = (family,) if family else families
        plain = dataclasses.replace(options, family=family or options.family, max_degree=1, twist=False)
        fits.append(_swept(moved, axes_of(moved, options.seed, 1)[:1], plain, own, {}, covers))
        return fits[-1].member, fits[-1].section

    other = changing(points, found.member, prism, options.seed)
    if other is None or not is_better(other, len(points)):
        return found
    told = explanation(points, other.member, other.section.sigma_m, options.seed, covers=covers)
    if not told.explains:
        return found
    last = fits[-1]
    member = dataclasses.replace(other.member, seen=seen_faces(last.section, told))
    return dataclasses.replace(last, member=member, explains=True, reason=told.reason, explanation=told, n_axes=found.n_axes)


def _no_member(points: FloatArray, member: Member) -> str:
    """Why a member that explains the points is none all the same; empty where it is one."""
    if not makes_section(member.family, member.values()):
        return f"a wall of the {member.family} member would be thicker than its section lets it"
    return continued(points, member) or beside(points, member)


def _swept(
    points: FloatArray,
    axes: tuple[Axis, ...],
    options: MemberOptions,
    families: tuple[str, ...],
    fixed: Mapping[str, float],
    covers: Covers,
    *,
    open_ends: bool = False,
) -> MemberFit:
    """One round: the section along the likeliest axis, its curve and ends, and the test. open_ends : the bars of `families` are tubes."""
    section_fixed = {name: value for name, value in fixed.items() if name != "length"}
    axis, fit = likeliest(points, axes, options, families, section_fixed)
    told_free = freed(points, axis, options, fit) if section_fixed else fit
    fit = seen_from_outside(fit) if options.whole else fit
    sweep, sag, sag_std = significant(sweep_of(axis, fit), fit)
    if open_ends:
        fit = tube_of(fit)
        if fit.family == "RHS":
            sweep = dataclasses.replace(sweep, roll=np.r_[sweep.roll[0] + math.pi / 2, sweep.roll[1:]])
            sag, sag_std = np.array([sag[1], -sag[0]]), sag_std[::-1].copy()
    coordinates = sweep.coordinates(points)
    used_m = sweep.span[1] - sweep.span[0]  # of the length: without the ends, which the noise blurs
    near = near_section(coordinates, fit)
    require(bool(near.any()), EstimationError, f"no point lies near the {fit.family} section with the dimensions given")
    rough = rough_ends(coordinates[near, 2])
    sweep = sweep.rebased(*rough)
    one = _between_ends(points, sweep, fit, options, fixed, covers)
    if one.wall_m is not None:  # the rim tells how many points the end faces hold
        one = _between_ends(points, sweep, fit, options, fixed, covers, one.wall_m)
    hidden = reach(points, one.member, one.pitch_m, whole=options.whole) if one.told.explains and (options.whole or not fixed) else None
    if hidden is not None:
        sweep, fit = with_reach(one.member, fit, hidden)
        one = _between_ends(points, sweep, fit, options, fixed, covers, one.wall_m, hidden.faces)
        one = dataclasses.replace(one, member=with_length_std(one.member, end_rows(points, one.member))) if options.whole else one
    more = _no_member(points, one.member) if one.told.explains else ""
    told = dataclasses.replace(one.told, explains=False, reason=more) if more else one.told
    p_fixed, given = _tested(fixed, told_free, fit.family, one.ends)
    return MemberFit(
        member=one.member,
        explains=told.explains,
        reason=told.reason,
        explanation=told,
        sag_m=sag * (one.ends.length_m / used_m) ** 2,
        sag_std_m=sag_std * (one.ends.length_m / used_m) ** 2,
        axis=axis,
        section=fit,
        ends=one.ends,
        p_fixed=p_fixed,
        given=given,
        why=one.untold,
        method="density",
        n_axes=len(axes),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Closed(Value):
    """A member between its ends. untold : why dimensions are not observable.   pitch_m : of points that keep a distance.

    wall_m : of a tube, where its rim alone tells it.
    """

    member: Member
    told: Explanation
    ends: Ends
    untold: Mapping[str, str]
    pitch_m: float
    wall_m: float | None


def _between_ends(
    points: FloatArray,
    sweep: Sweep,
    fit: SectionFit,
    options: MemberOptions,
    fixed: Mapping[str, float],
    covers: Covers,
    wall_m: float | None = None,
    reached: tuple[str, ...] = (),
) -> _Closed:
    """The ends of a sweep, the test, and what of the dimensions is observable.

    wall_m : of a tube, known from its rim.   reached : hidden faces that are told all the same.
    """
    ends = ends_of(sweep.coordinates(points), fit, sweep.span, wall_m)
    low, high = (end.position_m - float(end.slope @ end.pivot) for end in (ends.low, ends.high))
    require(high > low, EstimationError, "the ends of the member cannot be told apart")
    if "length" in fixed:
        low, high = _of_length(fixed["length"], low, high, ends)
    sweep = sweep.rebased(low, high)
    member = member_of(sweep, fit, ends, fixed)
    told = explanation(points, member, fit.sigma_m, options.seed, covers=covers)
    asked = told.explains and not options.whole
    cut = cut_toes(points, member) | bare_toes(points, member, fit.seen, options.seed) if asked else frozenset()
    cut |= bare_walls(points, member, fit.seen) if asked else cut
    member = dataclasses.replace(member, seen={**seen_faces(fit, told), **dict.fromkeys(cut, 0.0)}, reached=reached)
    off_m = face_error(told.pattern_m, told.p_value, fit.sigma_m)
    area = (high - low) * float(face_lengths(fit.family, fit.values) @ np.array([member.seen[name] >= SEEN for name in faces(fit.family)]))
    pitch = max(thinned_spacing(points, options.seed), even_spacing(sweep.coordinates(points)[:, 2], (0.0, high - low), fit.sigma_m, area))
    member = widened(member, pitch, (ends.low.cap_points, ends.high.cap_points), off_m)
    member, untold = honest(points, member, options)
    untold = {**untold, **fit.why, **{name: _BLIND for name in fit.names if blind_plate(fit, name)}}
    askew = "" if options.whole else cut_askew(ends, fit.family)
    if askew and "length" not in fixed:
        member, untold = without_length(member), {**untold, "length": askew}
    rimmed = member if untold.get("t") == BLENDED else with_rim(points, member, pitch)
    if rimmed is member:
        return _Closed(member=member, told=told, ends=ends, untold=untold, pitch_m=pitch, wall_m=None)
    untold = {name: why for name, why in untold.items() if name != "t" or is_unsure(rimmed)}
    return _Closed(member=rimmed, told=told, ends=ends, untold=untold, pitch_m=pitch, wall_m=rimmed.values()["t"])


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


def _is_hopeless(told: Explanation) -> bool:
    """Whether the points themselves, whatever the rays say, show another shape: holes, a crowd off the surface, or scatter that is none of theirs.

    The excess is nan where neighbours do not tell the noise: then the rays are asked.
    """
    return told.voids > 0 or told.crowd_share > _CROWDED or told.noise_excess > _HOPELESS


def _rays_may_help(scan: Scan, found: MemberFit, seed: int) -> bool:
    """Whether the points leave it open, or are none to ask: in sheets of rays, holes, crowds and scatter are the sensor's."""
    hopeless = _is_hopeless(found.explanation) or (not found.explains and bool(round_holes(_checked(scan), found.member, seed, scan.rays)))
    return not hopeless or in_sheets(scan, seed)


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
    fixed = pinned(free.family, [name for name, share in free.seen.items() if share >= SEEN])  # how far a face reaches denies nothing
    seen = tuple(free.observable.get(name, True) and name in fixed and not blind_plate(free, name) for name in free.names)
    return Told(names=(*free.names, "length"), values=np.array([*free.values, ends.length_m]), covariance=covariance, observable=(*seen, True))


def _beside(found: MemberFit, nominal: Mapping[str, float]) -> tuple[Given, ...]:
    """Nominal dimensions beside the fitted ones."""
    member = found.member
    own = {name: value for name, value in nominal.items() if name in member.values()}
    return compared(own, told_by(member), member.family, held=False)


def _of_length(length: float, low: float, high: float, ends: Ends) -> tuple[float, float]:
    """End planes at the distance that is known, where both ends together say: the surer one moves less."""
    weight = ends.low.std_m**2 / max(ends.low.std_m**2 + ends.high.std_m**2, 1e-300)
    at = (1 - weight) * low + weight * (high - length)
    return at, at + length
