"""Estimation or reconstruction? A member that explains its points within their noise needs a dozen numbers where a free surface needs thousands:
it is tried first, and whatever it does not explain is reconstructed. Why is told either way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from scan2fea.errors import EstimationError, InputError
from scan2fea.estimation.as_member import without_length
from scan2fea.estimation.beside import strip_beside
from scan2fea.estimation.catalogued import catalogued, with_standard_odds
from scan2fea.estimation.cuts import Cut, share_of_sides
from scan2fea.estimation.damage import damages
from scan2fea.estimation.designation import parse_designation
from scan2fea.estimation.elbows import bent_back, laid_out
from scan2fea.estimation.end_faces import cut_askew
from scan2fea.estimation.explain import explanation
from scan2fea.estimation.fit import SectionFit
from scan2fea.estimation.given import Given, contradictions
from scan2fea.estimation.going_on import going_on
from scan2fea.estimation.joined import NO_PLANE, ended_at, joints
from scan2fea.estimation.lacking import lack
from scan2fea.estimation.member import MemberFit, MemberOptions, fit_member
from scan2fea.estimation.resting import END, abutting, rested, standing
from scan2fea.estimation.round_holes import in_world, plugged, round_holes
from scan2fea.estimation.seated import seated
from scan2fea.estimation.several import several_members
from scan2fea.estimation.slopes import parallel
from scan2fea.estimation.systematic import face_error
from scan2fea.estimation.table import Table, read_table
from scan2fea.estimation.unseen_end import unseen_end
from scan2fea.kernel.coordinate_steps import noise_before, rounding_std, spread
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.pinned import SEEN
from scan2fea.kernel.pipe_path import pipe_path
from scan2fea.kernel.sections import PARAMETERS, ROUND
from scan2fea.options import option
from scan2fea.pipeline.dimension_doubt import PoseDoubt, coarsened, widened
from scan2fea.pipeline.stations import larger_doubt
from scan2fea.types import FloatArray, Footing, Member, PointCloud, RootFillet, RoundHole, Route, Scan, Value
from scan2fea.units import MILLIMETRES_PER_METRE

ESTIMATION, RECONSTRUCTION = "estimation", "reconstruction"


@dataclass(frozen=True, kw_only=True)
class RouteOptions:
    """Which way an object becomes a solid, and what is known of it."""

    mode: str = option("auto", "auto: a member where one explains the points, else free form", choices=("auto", ESTIMATION, RECONSTRUCTION))
    member: str = option("", "section that is known, such as L127x127x6.35 (mm), HE 140 A, L; its dimensions are not fitted but tested")
    catalogue: str = option("", "CSV table of sections instead of the shipped one")


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate(Value):
    """What estimation says of one object. member is None where none could be fitted.

    p_fixed : probability of data as far from the given dimensions as these if those were true; None where none was given or none is told.
    given : each given dimension beside what the points say of it.   whole : the user said that nothing hid the object and nothing was cut off it.
    open_end : why its length is not told: the member may go on beyond the scan; "" where it is told or it explains nothing.
    bare_ends : ends of which no face was seen, and that rest on nothing.   bare_wall : the largest stretch of a wall of which neither side was
    seen.   bare_share : of the area of its sides, that of all such stretches.
    apart_m : standard deviation of the difference of two stations' places along one axis, as the faces that several saw tell.
    strip : why it is only part of what was scanned, as an object of its own beside it shows; "" where none does.
    stray_share : of the points, off a member that explains the others, and no crowd.   lack : of its section, what the points hold beyond it, below 0
    where it holds too much.   likeliest : the section that explains the points of which
    they tell no dimension: to look at, not to build.
    """

    member: Member | None
    explains: bool
    reason: str
    p_fixed: float | None = None
    given: tuple[Given, ...] = ()
    whole: bool = False
    open_end: str = ""
    bare_ends: int = 0
    bare_wall: Cut | None = None
    bare_share: float = 0.0
    strip: str = ""
    stray_share: float = 0.0
    lack: float = 0.0
    likeliest: Member | None = None
    apart_m: float = 0.0

    @property
    def shown(self) -> Member | None:
        """What may be looked at: the member, or the likeliest section."""
        return self.member or self.likeliest

    @property
    def untold(self) -> tuple[str, ...]:
        """Dimensions that the member was built with as given, of which the points tell nothing."""
        return tuple(g.name for g in self.given if g.held and g.measured_m is None)

    @property
    def n_contradicted(self) -> int:
        """Dimensions that the member was built with though the points deny them."""
        return sum(g.held and g.is_contradicted for g in self.given)


@dataclass(frozen=True, kw_only=True)
class KnownSection(Value):
    """What is known of the member of one object: its family (or ""), dimensions (m) that are held, and dimensions that are only compared.

    whole : nothing hid it from the scan and nothing was cut off it.
    """

    family: str = ""
    fixed: Mapping[str, float] = field(default_factory=dict)
    nominal: Mapping[str, float] = field(default_factory=dict)
    whole: bool = False


def estimate(
    scan: Scan,
    options: MemberOptions,
    route: RouteOptions,
    known: KnownSection | None = None,
    doubt: PoseDoubt = PoseDoubt(),
    footings: Sequence[Footing] = (),
    strips: Sequence[FloatArray] = (),
    covers: Sequence[FloatArray] = (),
    root_radius_m: float | None = None,
    meets: Sequence[FloatArray] = (),
) -> Estimate:
    """The member of the points, with its catalogue and damage. A bad designation or table raises; an object that is no member does not.

    known : of this object alone, in place of `route.member`.   doubt : of the places that its points, by `frame`, were measured from.
    footings : planes that the object may rest on.   strips : (k, 3) points of thin objects beside it.   covers : of all others.
    root_radius_m : of its fillets, where it is given.   meets : (k, 3) points of each neighbour that it was cut off, as of a welded node.
    A pipe with elbows is a member of its points laid out straight; what it rests on or was covered by is not asked there.
    """
    scan, step_m = spread(scan, options.seed)
    pipe = None if doubt.between_m > 0 else _with_elbows(scan, options, route, known)
    found = pipe or _straight(scan, options, route, known, doubt, footings, strips, covers, step_m, meets)
    if root_radius_m is None or found.member is None:
        return found
    root = found.member.root if root_radius_m else RootFillet(slope=found.member.root.slope, slope_std=found.member.root.slope_std)
    given = replace(root, radius_m=root_radius_m, std_m=0.0, is_observable=False, most_m=root_radius_m, source="fixed")
    return replace(found, member=replace(found.member, root=given))


def _with_elbows(scan: Scan, options: MemberOptions, route: RouteOptions, known: KnownSection | None) -> Estimate | None:
    """The pipe with elbows that the points are; None where they are none."""
    family = (known.family if known is not None else "") or options.family
    points = _measured(scan)
    path = pipe_path(points, options.seed) if not family or family in ROUND else None
    if path is None:
        return None
    straight = Scan(cloud=PointCloud.of(laid_out(points, path)))
    found = _straight(straight, replace(options, max_degree=1, twist=False), route, known)
    member = bent_back(found.member, path) if found.member is not None and found.explains else None
    if member is None:
        return None
    turns = ", ".join(f"{math.degrees(b.angle_rad):.1f} deg at {b.radius_m * MILLIMETRES_PER_METRE:.1f} mm" for b in member.bends)
    return replace(found, member=member, reason=f"pipe with {len(member.bends)} bend{'s'[: len(member.bends) > 1]} ({turns}): {found.reason}")


def _measured(scan: Scan) -> FloatArray:
    """(n, 3) its points without those that fill a gap."""
    cloud = scan.cloud
    return cloud.points if cloud.is_inferred is None else cloud.points[~cloud.is_inferred]


def _straight(
    scan: Scan,
    options: MemberOptions,
    route: RouteOptions,
    known: KnownSection | None = None,
    doubt: PoseDoubt = PoseDoubt(),
    footings: Sequence[Footing] = (),
    strips: Sequence[FloatArray] = (),
    covers: Sequence[FloatArray] = (),
    step_m: float = 0.0,
    meets: Sequence[FloatArray] = (),
) -> Estimate:
    """`estimate` of a member without elbows.   step_m : its coordinates were rounded to."""
    table = table_of(route)
    section = known_section(route, table) if known is None else known
    if scan.cloud.is_inferred is not None and bool((scan.cloud.is_inferred & (scan.cloud.frame >= 0)).any()):
        scan = Scan(cloud=scan.cloud.take(~scan.cloud.is_inferred | (scan.cloud.frame < 0)), rays=scan.rays)  # what fills a gap is no measurement
    inferred = scan.cloud.is_inferred
    try:
        options = replace(options, family=section.family or options.family, whole=options.whole or section.whole)
        scan, fit, holes = _drilled(scan, options, section, covers)
    except InputError as error:
        return Estimate(member=None, explains=False, reason=str(error))
    except EstimationError as error:
        two = several_members(_measured(scan), None, options)
        return Estimate(member=None, explains=False, reason=str(error) if two is None else two.reason)
    scan = replace(scan, cloud=scan.cloud.replaced(points=parallel(scan.cloud.points, fit.member, fit.member.root.slope)))  # as its section has them
    measured = _measured(scan)
    two = several_members(measured, fit, options)
    if two is not None:
        fit = replace(fit, explains=False, reason=two.reason)
    strip = strip_beside(fit.member, strips) if fit.explains and not options.family else ""
    if strip:
        fit = replace(fit, explains=False, reason=strip)
    member = fit.member
    if inferred is not None:
        member = rested(member, scan.cloud.points[inferred], spacing(scan.cloud.points[~inferred]))
    is_rested = member is not fit.member
    if not is_rested:  # no face that its ring of points encloses
        member = standing(seated(measured, member, footings), footings)
    member, fit = (member, fit) if "length" in section.fixed else _ended(scan, member, fit, options, (footings, covers, meets))
    bare = fit.ends.low.cap_points == 0, fit.ends.high.cap_points == 0
    member = abutting(member, spacing(measured), covers, bare) if fit.explains and fit.method == "density" else member
    told = fit.explanation
    face_m = face_error(told.pattern_m, told.p_value, fit.section.sigma_m) if fit.method == "density" else 0.0
    cloud, larger = larger_doubt(scan, member, doubt)
    member = coarsened(widened(member, cloud, larger, face_m), step_m)
    apart_m = 0.0 if larger is doubt else larger.between_m
    if not any(p.observable or p.source == "fixed" for p in member.parameters if p.name != "length"):
        reason, likeliest = (_open(fit.member, options), member) if fit.explains else (fit.reason, None)
        return Estimate(member=None, explains=False, reason=reason, strip=strip, likeliest=likeliest)
    if fit.method == "density":
        member = with_standard_odds(member, alternatives(fit.section), table)
    try:
        member = catalogued(member, table)
    except EstimationError as error:
        return Estimate(member=None, explains=False, reason=str(error), strip=strip)
    if fit.explains:
        member = replace(member, damage=damages(scan.cloud.points, member, member.sigma_m, options.seed), holes=holes)
    return Estimate(
        member=member, explains=fit.explains, reason=_reason(fit, options, step_m, apart_m), apart_m=apart_m, p_fixed=fit.p_fixed, given=fit.given,
        whole=options.whole, strip=strip,
        stray_share=told.stray_share if fit.explains else 0.0, open_end=fit.why.get("length", "") if fit.explains else "",
        bare_ends=_bare_ends(fit, is_rested or END in member.seated), bare_wall=told.cuts[0] if fit.explains and told.cuts else None,
        bare_share=share_of_sides(told.cuts, fit.member) if fit.explains else 0.0,
        lack=lack(scan.cloud.points, fit.member, options.seed) if fit.explains and not fit.member.root.radius_m else 0.0,
    )  # fmt: skip


def _drilled(
    scan: Scan, options: MemberOptions, section: KnownSection, covers: Sequence[FloatArray]
) -> tuple[Scan, MemberFit, tuple[RoundHole, ...]]:
    """The fit, and the round holes through the walls of what explains the points but for these: then of the scan as it would be without them."""
    fit = fit_member(scan, options, section.fixed, section.nominal, covers)
    if fit.explains or fit.method != "density":
        return scan, fit, ()
    holes = round_holes(_measured(scan), fit.member, options.seed, scan.rays)
    if not holes:
        return scan, fit, ()
    whole = plugged(scan, fit.member, holes, options.seed)
    again = fit_member(whole, options, section.fixed, section.nominal, covers)
    holes = round_holes(_measured(scan), again.member, options.seed, scan.rays) if again.explains else ()
    return (whole, again, in_world(holes, _measured(scan), again.member)) if holes else (scan, fit, ())


def _ended(
    scan: Scan, member: Member, fit: MemberFit, options: MemberOptions,
    around: tuple[Sequence[Footing], Sequence[FloatArray], Sequence[FloatArray]]
) -> tuple[Member, MemberFit]:
    """The member with its ends on neighbours where these are, and without its length where the scan may have been cut off at one end; why in the fit.

    around : footings, covers and meets of `estimate`.
    """
    footings, covers, meets = around
    points = _measured(scan)
    if fit.method != "density":  # hits and misses know where it ends
        return _untold(member, fit, "" if options.whole else going_on(points, member, covers))
    low, high = joints(points, member, meets) if fit.explains else (None, None)
    joined = low is not None, high is not None
    if any(joined):
        if not all(joint is None or joint.is_plane for joint in (low, high)):
            return member, replace(fit, explains=False, reason=NO_PLANE)
        member = ended_at(member, low, high, fit.ends.std_m)
        again = explanation(points, member, member.sigma_m, options.seed, covers=[*covers, *meets])
        askew = "" if options.whole else cut_askew(fit.ends, member.family, joined)
        fit = replace(fit, why={**fit.why, "length": askew}, explains=again.explains, reason=again.reason)
        member = without_length(member) if askew else member
    if options.whole or not member.parameters[-1].observable:
        return member, fit
    unseen = going_on(points, member, covers, joined) or unseen_end(scan, fit.ends, member, footings, joined)
    return _untold(member, fit, unseen)


def _untold(member: Member, fit: MemberFit, why: str) -> tuple[Member, MemberFit]:
    """The member without its length where that is not told, and why; as they are where it is."""
    return (without_length(member), replace(fit, why={**fit.why, "length": why})) if why else (member, fit)


def _bare_ends(fit: MemberFit, rests: bool) -> int:
    """Ends of which no face was seen, but for one that rests on a plane; hits and misses know where a member ends without."""
    bare = sum(end.cap_points == 0 for end in (fit.ends.low, fit.ends.high)) if fit.explains and fit.method == "density" else 0
    return max(bare - rests, 0)


def _open(member: Member, options: MemberOptions) -> str:
    """Why no dimension of a member that explains the points is told, and what the user may know of it."""
    seen = ", ".join(name for name, share in member.seen.items() if share >= SEEN) or "none"
    says = f"no dimension of the {member.family} member was seen: where its seen faces ({seen}) end, the scan may end"
    return says if options.whole else f"{says}; if nothing hid it and nothing was cut off it, say so (estimation.whole = true)"


def alternatives(fit: SectionFit) -> Mapping[str, Mapping[str, float]]:
    """Family -> dimensions of its best hypothesis."""
    best = {c.family: c for c in sorted(fit.candidates, key=lambda c: -c.bic)}
    return {name: dict(zip(PARAMETERS[name], c.layout.values(c.theta).tolist(), strict=True)) for name, c in best.items()}


def table_of(route: RouteOptions) -> Table | None:
    """The user's table of sections; None for the shipped one. Raises InputError or UsageError for a table that cannot be used."""
    return read_table(Path(route.catalogue)) if route.catalogue else None


def known_section(route: RouteOptions, table: Table | None) -> KnownSection:
    """What `route.member` says of every object. Raises UsageError for a designation that names no section."""
    if not route.member:
        return KnownSection()
    given = parse_designation(route.member, table)
    return KnownSection(family=given.family, fixed=given.parameters)


def _reason(fit: MemberFit, options: MemberOptions, step_m: float, apart_m: float) -> str:
    said = [fit.reason]
    noise_m = noise_before(fit.section.sigma_m, step_m)
    if rounding_std(step_m, noise_m) > noise_m:
        said.append(f"the coordinates are whole steps of {MILLIMETRES_PER_METRE * step_m:.3g} mm, which no number of points averages away")
    if apart_m > 0:
        off = f"{MILLIMETRES_PER_METRE * apart_m:.2g} mm"
        said.append(f"stations lie {off} off each other (one standard deviation, from the faces that several saw): its dimensions are as uncertain")
    if fit.p_fixed is not None:
        said.append(f"the dimensions given have a p-value of {fit.p_fixed:.3g}")
    said += [fit.why["length"]] if fit.why.get("length") and fit.explains else []
    said += [fit.why["sensor"]] if "sensor" in fit.why and fit.explains else []
    if options.sigma_m is not None and fit.method == "density":
        stated = f"the noise was stated: {MILLIMETRES_PER_METRE * options.sigma_m:.3g} mm, known to {100 * options.sigma_error:g} %"
        said.append(fit.why.get("sigma", stated))
    denied = contradictions(fit.given)
    return "; ".join([*said, denied] if denied else said)


def route_of(found: Estimate, mode: str) -> Route:
    """The way to go after estimation was tried."""
    if found.member is not None and (found.explains or mode == ESTIMATION):
        return Route(name="estimation", reason=found.reason)
    return Route(name="reconstruction", reason=f"free form: {found.reason}")
