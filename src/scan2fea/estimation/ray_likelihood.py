"""The member that the rays saw: what came back, from how far, and what passed beside it.

A ray that hits tells the distance of one face, a ray that passes tells that there is nothing in its way; together they place the outline to a
fraction of the noise, because the noise lies along the ray and the outline across it. `rays_of_member` has the likelihood of one ray; here
it is maximised over the section, the pose, the curve of the axis, the ends, the noise and the width of the beam. `ray_starts` has the starts: two
planes that meet away from the sensor and two that meet towards it are both among them, and the rays choose; `ray_trust` says what is told.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import EstimationError
from scan2fea.estimation.ray_data import FULL_OPENING, RayData, outline_box, prepared
from scan2fea.estimation.ray_model import WALLS, RayLayout
from scan2fea.estimation.ray_pose import canonical_member
from scan2fea.estimation.ray_starts import best_starts, contenders, fitted, of_member, thinnest
from scan2fea.estimation.ray_trust import BY_CHANCE, GAIN, TOLD, Trust, checked, dimensions_of, doubted, rivals_of, without_spread_law
from scan2fea.estimation.rays_of_member import inside_outline
from scan2fea.estimation.scoring import Scored
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.sections import section
from scan2fea.kernel.transforms import applied, compose, inverse, rigid, rotation_about
from scan2fea.options import option
from scan2fea.types import FloatArray, Member, Scan, Value

EDGE_DOUBT = 0.5  # of how far edges were moved (simulated beams that report any light: legs 1.5 to 3 mm wrong where edges moved by 3)
N_RESTARTS = 3
N_FIRST = 5000  # rays of the first round and of the check
WORTH = 0.1  # standard deviations: means nearer to the top are left there
BOX_MARGIN = 3.0  # standard deviations of the noise


@dataclass(frozen=True, kw_only=True)
class RayOptions:
    """How a member is fitted to rays."""

    footprint_rad: float | None = option(None, "Full opening of the beam; by default as the scan states it, else estimated", unit="rad", minimum=0.0)
    degree: int = option(1, "Degree of the curve of the axis: 1 straight, 2 with sag or sweep", minimum=1, maximum=4)
    n_start: int = option(1200, "Rays that judge the starts", minimum=100)
    n_fit: int = option(20000, "Rays of the fit, from which one step on n_polish rays is as good as any number", minimum=500)
    n_polish: int = option(500000, "Most rays that the last step uses", minimum=500)
    seed: int = option(0, "Seed of the draw of rays", minimum=0)


@dataclass(frozen=True, eq=False, kw_only=True)
class RayFit(Value):
    """What the rays say.

    member : the fitted member; what the rays do not tell is marked so.   names : of the unknowns.   theta : (p,), in the frame of T_world_frame.
    information : (p, p) of the rays used, with the priors.   log_likelihood : of the same rays.   footprint_rad : full opening of the beam.
    tells : dimension -> whether the rays hold it.   n_hits, n_misses : rays near the member.   misses_known : False where only hits were recorded.
    """

    member: Member
    names: tuple[str, ...]
    theta: FloatArray
    information: FloatArray
    T_world_frame: FloatArray
    log_likelihood: float
    sigma_m: float
    footprint_rad: float
    tells: Mapping[str, bool]
    n_hits: int
    n_misses: int
    misses_known: bool
    converged: bool
    n_iterations: int


def fit_rays(scan: Scan, start: Member, options: RayOptions = RayOptions(), fixed: Mapping[str, float] | None = None) -> RayFit:
    """The member of `start`'s family that makes hits and misses likeliest. Its axis must be about right; its section need not be.

    fixed : dimensions that are known, metres; they are not fitted.
    Raises EstimationError: no rays, none that hit, rays of another frame than the points, a sensor inside the member, too few rays near it.
    """
    layout = RayLayout(start.family, options.degree)
    held = {k: v for k, v in (fixed or {}).items() if k in layout.dimensions}
    data = prepared(scan, start, options.degree, options.footprint_rad)
    starts = best_starts(data.take(sampled_rows(len(data), options.n_start, options.seed)), layout, start, held)
    part = data.take(sampled_rows(len(data), min(options.n_fit, N_FIRST), options.seed))
    found = contenders(part, layout, starts, held)
    members = [_member(layout, one, start, data, part, held) for one in found]
    members = members if held else [canonical_member(one) for one in members]
    rivals = rivals_of(members, [one.log_posterior for one in found], len(data) / len(part))
    member, n_iterations = members[0], found[0].n_iterations
    _check_sensors(scan, member)
    # the second round judges which rays pass near by the fitted outline, not by the box of the points
    box = outline_box(member, BOX_MARGIN * member.sigma_m)
    data = prepared(scan, member, options.degree, options.footprint_rad, box, data.rows)
    part = data.take(sampled_rows(len(data), _draw(len(data), options), options.seed))
    scored = fitted(part, layout, of_member(data, layout, member, found[0].theta), held, tolerance=0.01)
    n_iterations += scored.n_iterations
    member = _member(layout, scored, member, data, part, held)
    _check_sensors(scan, member)
    free_edge = _sees_farther_out(part, layout, scored, held, options)
    if free_edge:
        scored = fitted(part, layout, scored.theta, held, free_edge=True)
        n_iterations += scored.n_iterations
    if len(data) > len(part):
        part = data.take(sampled_rows(len(data), options.n_polish, options.seed))
        last_step = fitted(part, layout, scored.theta, held, free_edge=free_edge, max_iterations=1)
        scored = dataclasses.replace(last_step, converged=scored.converged)
        n_iterations += scored.n_iterations
    few = part.take(sampled_rows(len(part), min(options.n_fit, N_FIRST), options.seed))
    if not data.hits_only:
        top = fitted(few, layout, scored.theta, held, free_edge=free_edge, max_iterations=8)
        thin = thinnest(few, layout, top, held, free_edge=free_edge)
        walls = [layout.place[name] for name in layout.dimensions if name in WALLS]
        if float(np.sum(thin.theta[walls])) < (1 - TOLD) * float(np.sum(top.theta[walls])):
            scored = fitted(part, layout, thin.theta, held, free_edge=free_edge)
    for _ in range(N_RESTARTS):
        final = _member(layout, scored, member, data, part, held)
        if data.hits_only:
            final = without_spread_law(final, start, few, layout, scored, held, len(part))
        trust = checked(final, few, part, layout, scored, held, free_edge, rivals)
        if trust.better is None or data.hits_only:
            break
        better = fitted(part, layout, trust.better.theta, held, free_edge=free_edge)
        if better.log_posterior < scored.log_posterior + GAIN:
            break
        scored = better  # a walk away from the top led to a higher one
        n_iterations += better.n_iterations
    trusted = trust.member if data.hits_only else _at_means(trust, part, layout, scored, held, data, free_edge)
    if free_edge:
        trusted = doubted(trusted, EDGE_DOUBT * part.edge_unit_m * abs(float(scored.theta[layout.place["edge"]])))
    return _result(layout, scored, trusted, data, n_iterations)


def _at_means(trust: Trust, part: RayData, layout: RayLayout, scored: Scored, held: Mapping[str, float], data: RayData, free_edge: bool) -> Member:
    """The trusted member with every told dimension at the mean of its profile, and all else fitted again."""
    member, theta = trust.member, scored.theta.copy()
    if not any(abs(trust.shifts.get(one.name, 0.0)) > WORTH * (one.std_m or math.inf) for one in member.parameters):
        return member
    for name, shift in trust.shifts.items():
        theta[layout.place[name]] += shift
    means = {name: float(theta[layout.place[name]]) for name in trust.shifts}
    again = fitted(part, layout, theta, {**held, **means}, free_edge=free_edge, max_iterations=12)
    moved = _member(layout, again, member, data, part, held)
    values = moved.values()
    parameters = tuple(dataclasses.replace(one, value_m=values[one.name]) for one in member.parameters)
    return dataclasses.replace(moved, parameters=parameters, covariance=member.covariance)


def _sees_farther_out(data: RayData, layout: RayLayout, scored: Scored, held: Mapping[str, float], options: RayOptions) -> bool:
    """Whether the rays prove (BIC) that the sensor does not lose an edge where half of its beam has passed it.

    A sensor that reports any light sees edges a beam's radius farther out, one that wants a strong echo farther in.
    """
    beam = math.exp(scored.theta[layout.place["log_footprint"]]) * float(np.median(data.foot_rad * data.distance))
    if data.hits_only or beam < data.least_width:  # the rays do not resolve the beam: there is no edge to move within it
        return False
    few = data.take(sampled_rows(len(data), min(options.n_fit, N_FIRST), options.seed))
    plain = fitted(few, layout, scored.theta, held, max_iterations=6)
    moved = fitted(few, layout, plain.theta, held, free_edge=True, max_iterations=12)
    gain = (moved.log_posterior - plain.log_posterior - BY_CHANCE) * len(data) / len(few)
    return gain > (1 + few.footprint_known) * 0.5 * math.log(len(data))


def _draw(n: int, options: RayOptions) -> int:
    """How many rays the second round uses: all, where that is hardly dearer than a sample and one more polish."""
    return n if n <= min(2 * options.n_fit, options.n_polish) else options.n_fit


def _member(layout: RayLayout, scored: Scored, start: Member, data: RayData, used: RayData, held: Mapping[str, float]) -> Member:
    """The member of theta: its frame has its origin on the axis at the start, z along the axis, x as the roll says."""
    theta, p = scored.theta, layout.n_values
    first, last = float(theta[layout.place["start"]]), float(theta[layout.place["end"]])
    axis = layout.axis(theta)
    t = 2 * np.linspace(first, last, 4 * layout.degree + 1) / data.ends[1] - 1
    curve = np.polynomial.legendre.legval(t, axis.T).T  # (k, 2) places of the axis between its ends
    within = np.polynomial.legendre.legfit(np.linspace(-1, 1, len(t)), curve, layout.degree)  # (degree + 1, 2)
    begin = within[0] - within[1]
    across = 2 * within[1] / (last - first)
    z = np.array([across[0], across[1], 1.0])
    length = (last - first) * float(np.linalg.norm(z))
    z /= np.linalg.norm(z)
    turn = np.eye(3)
    sine = float(np.hypot(z[0], z[1]))
    if sine > 0:
        turn = rotation_about((-z[1], z[0], 0.0), math.atan2(sine, z[2]))
    T_frame_member = compose(rigid(turn, (begin[0], begin[1], first)), rigid(rotation_about((0, 0, 1), theta[p]), (0, 0, 0)))
    c, s = math.cos(theta[p]), math.sin(theta[p])
    bow = np.array([[c, s], [-s, c]]) @ within[2:].T
    covariance, parameters = dimensions_of(layout, scored, start, length, held, len(data) / len(used))
    return dataclasses.replace(
        start,
        parameters=parameters,
        T_world_member=compose(data.T_world_frame, T_frame_member),
        bow=bow,
        covariance=covariance,
        sigma_m=math.exp(theta[layout.place["log_sigma"]]),
        outlier_share=1 / (1 + math.exp(-theta[-1])),
        catalogue=(),
        damage=(),
    )


def _check_sensors(scan: Scan, member: Member) -> None:
    """Raises EstimationError where a sensor stands inside the solid."""
    if scan.rays is None:
        return
    where = applied(inverse(member.T_world_member), scan.rays.origin)
    outline = section(member.family, member.values()).loops[0]
    low, high = np.append(outline.min(axis=0), 0.0), np.append(outline.max(axis=0), member.values()["length"])
    near = where[((where > low) & (where < high)).all(axis=1)]
    within = near[inside_outline(near[:, :2], outline)]
    if len(within):
        at = applied(member.T_world_member, within[:1])[0]
        raise EstimationError(f"the sensor at ({at[0]:.3f}, {at[1]:.3f}, {at[2]:.3f}) m lies inside the member: check its position")


def _result(layout: RayLayout, scored: Scored, member: Member, data: RayData, n_iterations: int) -> RayFit:
    hit = ~np.isnan(data.range_m)
    told = {one.name: one.observable for one in member.parameters}
    footprint = float(np.median(data.foot_rad)) if data.footprint_known else FULL_OPENING * math.exp(scored.theta[layout.place["log_footprint"]])
    return RayFit(
        member=member,
        names=layout.names,
        theta=scored.theta,
        information=scored.information,
        T_world_frame=data.T_world_frame,
        log_likelihood=scored.log_likelihood,
        sigma_m=member.sigma_m,
        footprint_rad=footprint,
        tells=told,
        n_hits=int(hit.sum()),
        n_misses=int((~hit).sum()),
        misses_known=not data.hits_only,
        converged=scored.converged,
        n_iterations=n_iterations,
    )
