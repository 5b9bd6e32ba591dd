"""From a section fitted along an axis to a member: the curve that is significant, the ends, the parameters, and what of them the points tell."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import partial

import numpy as np

from scan2fea.estimation.along_axis import MemberOptions
from scan2fea.estimation.anneal import walls
from scan2fea.estimation.cap_law import across
from scan2fea.estimation.ends import Ends, find_ends
from scan2fea.estimation.explain import Explanation
from scan2fea.estimation.fit import SectionFit
from scan2fea.estimation.observability import KERNEL_SPREAD, RELATIVE, RESOLVED, thickness_observable
from scan2fea.estimation.outline import outline_distance, section_distance
from scan2fea.estimation.reach import Reach
from scan2fea.estimation.swept import Sweep, sweep_of_member
from scan2fea.estimation.two_sided import blended
from scan2fea.kernel.pinned import SEEN, pinned
from scan2fea.kernel.section_likelihood import face_lengths, faces
from scan2fea.kernel.sections import PARAMETERS, ROUND, edge_names, section, section_area
from scan2fea.types import BoolArray, FloatArray, Member, Parameter

_CELLS = 200  # across the section, to measure areas
_UNSEEN = 0.05  # points per metre against the densest face: what noise carries over from its neighbours
_REACH = "it is only how far the scan reaches: no two faces that were seen fix it"
BLENDED = "its two faces do not stand apart: one face under wider noise explains the points too"
_EDGES = ("LEFT", "RIGHT")  # of a flat: where it may be one face, what looks like them may be where the scan ends
_THINNEST = 0.01  # of the width: hollow sections of sections.csv have 0.0109 and more
_BLURRED = 8.0  # sigma across a face, over which the noise of its neighbours reaches, four from either side
_THINNER, _SURE = 1 / 3, 3.0  # how much thinner than these; over root n of its points, which is what chance leaves (0.6 to 0.8 measured)
_HALF = 0.5  # of a wall that may be one face
_CHORD = 2e-3  # of the section: circles bulge so far beyond their polygons, and exact points are rounded
_OUTER_SIGMAS = 2.0  # below the outer faces of a tube: 2.5 in 100 of their points lie deeper
_ROOM = 0.49  # of the width of a tube, for each of two walls
_NEAR_SIGMAS = 4.0  # from the section: what lies further off has no say about the ends


def significant(sweep: Sweep, fit: SectionFit) -> tuple[Sweep, FloatArray, FloatArray]:
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


def near_section(coordinates: FloatArray, fit: SectionFit) -> BoolArray:
    """Points in the outline or within four sigma of it: those that can be on the sides or on the caps."""
    distance = section_distance(fit.family, dict(zip(fit.names, fit.values.tolist(), strict=True)), coordinates[:, :2])
    return np.asarray(distance < _NEAR_SIGMAS * fit.sigma_m + _CHORD * float(fit.values.max()))


def ends_of(coordinates: FloatArray, fit: SectionFit, span: tuple[float, float], wall_m: float | None = None) -> Ends:
    """The end planes. wall_m : of a tube, from its rim, where the section's fit does not tell it.

    A tube whose fit tells no wall was seen from outside: then by the outer half of that wall, or by what is within two sigma of the outer faces.
    """
    outside = fit.family in ("RHS", "CHS") and not fit.observable["t"]
    vague = wall_m is None and outside
    near = coordinates[near_section(coordinates, fit)]
    if outside:
        fit = _outer_half(fit, wall_m or 2 * _OUTER_SIGMAS * fit.sigma_m + _CHORD * float(fit.values.max()))
        values = dict(zip(fit.names, fit.values.tolist(), strict=True))
        near = near[section_distance(fit.family, values, near[:, :2], filled=True) > -fit.value("t")]
    lengths = face_lengths(fit.family, fit.values)
    seen = np.minimum(fit.face_weight, 1.0) if len(fit.face_weight) == len(lengths) else np.ones(len(lengths))
    thinnest = min((fit.value(wall) for wall in walls(fit.family)), default=0.0)
    apart = not outside and fit.family not in ROUND and thinnest > 2 * _OUTER_SIGMAS * fit.sigma_m  # else nobody knows whose a point is
    hidden = (seen < _UNSEEN) & apart
    near, share = _off_hidden(fit, near, hidden) if hidden.any() else (near, 1.0)
    perimeter = float(lengths @ seen)
    area = share * section_area(section(fit.family, dict(zip(fit.names, fit.values.tolist(), strict=True))))
    box = float(np.prod(np.maximum(np.ptp(near[:, :2], axis=0), 1e-300))) if len(near) else 1.0
    look = partial(across, fit.family, fit.values, fit.sigma_m, fit.noise, seen, box, share=share)
    return find_ends(near, fit.sigma_m, span, area / perimeter if perimeter > 0 else 0.0, look, vague=vague)


def _off_hidden(fit: SectionFit, points: FloatArray, hidden: BoolArray) -> tuple[FloatArray, float]:
    """The points (n, 3) that lie nearer to a face that was seen than to a `hidden` (f,) one, and the share of the section's area that does.

    From the side a hidden face is seen past the edge of a flange, but only near the end: its points lie there as those of an end face would.
    """
    shape = section(fit.family, dict(zip(fit.names, fit.values.tolist(), strict=True)))
    low, high = (one(np.concatenate(shape.loops), axis=0) for one in (np.min, np.max))
    cells = np.stack(np.meshgrid(*(np.linspace(a, b, 2 * _CELLS + 1)[1::2] for a, b in zip(low, high, strict=True))), -1).reshape(-1, 2)
    distance, edge, _ = outline_distance(shape, cells)
    within = distance < 0
    share = float((~hidden[edge] & within).sum()) / max(int(within.sum()), 1)
    return points[~hidden[outline_distance(shape, points[:, :2])[1]]], max(share, _UNSEEN)


def _outer_half(fit: SectionFit, wall_m: float) -> SectionFit:
    """A tube of the outer half of its wall of which the outer faces alone were seen.

    Through the opening one sees the inner face, but only near the end: its points lie there as those of an end face would. A tube narrower than the
    noise has no room for more than its own walls.
    """
    names = faces(fit.family)
    half = min(wall_m / 2, _ROOM * min(fit.value(name) for name in fit.names if name != "t"))
    return dataclasses.replace(
        fit,
        values=np.array([half if name == "t" else fit.value(name) for name in fit.names]),
        face_weight=np.array([0.0 if "INNER" in name else 1.0 for name in names]),
    )


def member_of(sweep: Sweep, fit: SectionFit, ends: Ends, fixed: Mapping[str, float]) -> Member:
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
        blind = blind_plate(fit, name)
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


def with_reach(member: Member, fit: SectionFit, found: Reach) -> tuple[Sweep, SectionFit]:
    """The sweep of the member and the fit with what hidden faces, told by their neighbours, make of its section. The fit's theta stays as it was.

    What two seen faces fix keeps its standard deviation where that is wider.
    """
    own = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    n = len(fit.names)
    new = np.array([name in found.told for name in fit.names])
    std = np.where(new, own, np.maximum(own, fit.std))
    covariance = np.array(fit.covariance)
    covariance[:n, :n] = found.covariance * np.outer(*[std / np.where(own > 0, own, 1.0)] * 2)
    observable, why = dict(fit.observable), dict(fit.why)
    for k, name in enumerate(fit.names):
        if name not in found.told:
            continue
        wall = name in walls(fit.family)
        ok, reason = thickness_observable(found.values[k], own[k], fit.sigma_m) if wall else (own[k] < RELATIVE * found.values[k], "")
        observable[name] = bool(ok)
        why = {key: text for key, text in why.items() if key != name} | ({name: reason} if reason else {})
    T = np.array(sweep_of_member(member).T_world_frame)
    T[:3, 3] += T[:3, :2] @ found.shift_m
    sweep = dataclasses.replace(sweep_of_member(member), T_world_frame=T)
    return sweep, dataclasses.replace(fit, values=found.values, std=std, covariance=covariance, observable=observable, why=why)


def with_length_std(member: Member, std_m: float) -> Member:
    """The member with a length known no better than to `std_m`, where it was fitted."""
    at = len(member.parameters) - 1
    p = member.parameters[at]
    if p.std_m is None or p.std_m >= std_m:
        return member
    covariance = np.array(member.covariance)
    covariance[at, at] = std_m**2
    return dataclasses.replace(member, covariance=covariance, parameters=(*member.parameters[:at], dataclasses.replace(p, std_m=std_m)))


def without_length(member: Member) -> Member:
    """The member whose length is not observable."""
    covariance = np.array(member.covariance)
    covariance[-1, :] = covariance[:, -1] = 0.0
    length = dataclasses.replace(member.parameters[-1], std_m=None, observable=False)
    return dataclasses.replace(member, covariance=covariance, parameters=(*member.parameters[:-1], length))


def blind_plate(fit: SectionFit, name: str) -> bool:
    """A sheet thinner than two sigma may have been seen from one side only: what looks like its thickness may be the law of the noise."""
    return fit.family == "rect" and fit.value(name) < RESOLVED * fit.sigma_m if name in fit.names else False


def honest(points: FloatArray, member: Member, options: MemberOptions) -> tuple[Member, Mapping[str, str]]:
    """The member without the dimensions that rest on how far a face reaches, or on a wall that may be one face; and why each is not observable."""
    seen = [name for name, share in member.seen.items() if share >= SEEN]
    one_face = blended(points, member, seen) if options.sigma_m is None else frozenset()
    if member.family == "rect" and ("t" in one_face or not all(p.observable for p in member.parameters if p.name == "t")):
        seen = [name for name in seen if name not in _EDGES]
    fixed = pinned(member.family, [*seen, *member.reached])
    fitted = [p.name for p in member.parameters if p.name != "length" and p.source == "fitted" and p.observable]
    why = {name: _REACH if name not in fixed else BLENDED for name in fitted if name not in fixed or name in one_face}
    by_noise = _is_by_noise(member)
    if member.family in ("RHS", "CHS") and (why.get("t") == BLENDED or by_noise):
        member = _one_face(member)
    loose = [k for k, p in enumerate(member.parameters) if p.name in why]
    covariance = np.array(member.covariance)
    covariance[loose, :] = covariance[:, loose] = 0.0
    told = fixed - {"t"} if by_noise else fixed
    unknown = {p.name for p in member.parameters if p.name in why or (p.spread_m is not None and p.name not in told)}  # not even nearly
    open_walls = walls(member.family) if member.family not in ("RHS", "CHS") else ()
    parameters = tuple(_loose(p, guess=p.name in open_walls and why.get(p.name) == BLENDED) if p.name in unknown else p for p in member.parameters)
    return dataclasses.replace(member, parameters=parameters, covariance=covariance), why


def _loose(p: Parameter, *, guess: bool) -> Parameter:
    """Not observable. guess : the estimate stays one, good to half of itself: two faces under the noise that was found, or one under more."""
    return dataclasses.replace(p, std_m=None, observable=False, spread_m=max(p.std_m or 0.0, _HALF * p.value_m) if guess else None)


def _is_by_noise(member: Member) -> bool:
    """A tube whose wall was fitted and is not told, and that is thinner than any tube's or has an inner face on some sides only.

    Faces whose noises differ look like two of one wall where they are rougher.
    """
    t = next((p for p in member.parameters if p.name == "t"), None)
    if member.family not in ("RHS", "CHS") or t is None or t.source != "fitted" or t.observable:
        return False
    inner = [share >= SEEN for name, share in member.seen.items() if name.endswith("INNER")]
    return t.value_m < _THINNEST * max(member.values()[name] for name in PARAMETERS[member.family]) or (any(inner) and not all(inner))


def _one_face(member: Member) -> Member:
    """A tube whose wall may be one face under wider noise: its outer faces then lie in the middle of that wall, so they are told between both."""
    half = next(p.value_m for p in member.parameters if p.name == "t") / 2
    covariance, parameters = np.array(member.covariance), []
    for k, p in enumerate(member.parameters):
        if p.name in ("t", "length") or p.std_m is None:
            parameters.append(p)
            continue
        covariance[k, k] += half**2
        parameters.append(dataclasses.replace(p, value_m=p.value_m - half, std_m=math.hypot(p.std_m, half)))
    return dataclasses.replace(member, covariance=covariance, parameters=tuple(parameters))


def seen_faces(fit: SectionFit, told: Explanation) -> Mapping[str, float]:
    """Share of each face that points support; none on a face that the section's fit found hidden, or that may be where its neighbours were cut."""
    hidden = {name for name, weight in fit.seen.items() if weight < _UNSEEN} | _cut_ends(fit)
    return {name: 0.0 if name in hidden else share for name, share in told.seen.items()}


def _cut_ends(fit: SectionFit) -> set[str]:
    """Faces so narrow that noise joins their neighbours over them, and thinner in points than these: of neighbours that were cut the ends look so."""
    if fit.family in ROUND or not fit.seen:
        return set()
    width = dict(zip(faces(fit.family), face_lengths(fit.family, fit.values), strict=True))
    per_m = fit.n_weighed / max(sum(width[name] * fit.seen[name] for name in width), 1e-300)
    cut = set()
    for loop in edge_names(fit.family):
        for i, name in enumerate(loop):
            beside = min(fit.seen[loop[i - 1]], fit.seen[loop[(i + 1) % len(loop)]])
            lacks = max(_THINNER, _SURE / math.sqrt(max(per_m * width[name] * beside, 1e-300)))
            if RESOLVED * fit.sigma_m < width[name] < _BLURRED * fit.sigma_m and fit.seen[name] < (1 - lacks) * beside:
                cut.add(name)
    return cut
