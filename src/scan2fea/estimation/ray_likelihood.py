"""The member that the rays saw: what came back, from how far, and what passed beside it.

A ray that hits tells the distance of one face, a ray that passes tells that there is nothing in its way; together they place the outline to a
fraction of the noise, because the noise lies along the ray and the outline across it. `rays_of_member` has the likelihood of one ray; here
it is maximised over the section, the pose, the curve of the axis, the ends, the noise and the width of the beam.

Start: the section in the box of the points at eight rolls, and the start that is given, each with beam and noise widened to a share of the
section and narrowed step by step, so that a misplaced edge feels rays that pass far from it. Two planes that meet away from the sensor and
two that meet towards it are both among the starts, and the rays choose.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import EstimationError
from scan2fea.estimation.ray_data import FULL_OPENING, RayData, outline_box, prepared
from scan2fea.estimation.ray_model import LOG_FOOT_PRIOR, LOGIT_PRIOR, NUISANCE, WALLS, RayLayout, RayModel
from scan2fea.estimation.ray_pose import canonical_member
from scan2fea.estimation.rays_of_member import inside_outline
from scan2fea.estimation.scoring import Scored, maximise, summed
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.sections import section
from scan2fea.kernel.transforms import applied, compose, inverse, rigid, rotation_about
from scan2fea.options import option
from scan2fea.types import FloatArray, Member, Parameter, Scan, Value

N_ROLLS = 8
ANNEALED = (0.12, 0.06, 0.03, 0.015)  # width of beam and noise, in sizes of the section
AGAIN = (0.05, 0.02, 0.008)  # the same for the second annealing
TOLD = 1 / 6  # a dimension is told if its standard deviation is below this share of it: 2 mm of a wall of 6.35 mm are then 1.9 of them
WALL_STARTS = (0.03, 0.1, 0.3)  # of the section's size
ALIKE = 2.0  # log likelihoods nearer than this are no reason to prefer one fit (a factor of 7)
N_ROUNDS = 2  # the second judges which rays pass near by the fitted outline, not by the box of the points
BLIND = 1e-9  # of the largest eigenvalue of the scaled information: a direction without any ray
EDGE_DOUBT = 0.5  # of how far edges were moved (simulated beams that report any light: legs 1.5 to 3 mm wrong where edges moved by 3)
BY_CHANCE = 2.0  # log likelihood that an unknown which is not there may gain (1 in 20)
N_FIRST = 5000  # rays of the first round and of the check
CHECK_STEPS, CHECK_SHARE = 3.0, 0.1  # standard deviations, and the least share of the fall in log likelihood that they foretell
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
    theta = _best_start(data.take(sampled_rows(len(data), options.n_start, options.seed)), layout, start, held)
    n_iterations = 0
    member = start
    for round_ in range(N_ROUNDS):
        last = round_ + 1 == N_ROUNDS
        part = data.take(sampled_rows(len(data), _draw(len(data), options) if last else min(options.n_fit, N_FIRST), options.seed))
        scored = _fitted(part, layout, theta, held, tolerance=0.01) if last else _settled(part, layout, theta, held)
        n_iterations += scored.n_iterations
        member = _member(layout, scored, member, data, part, held)
        _check_sensors(scan, member)
        if not last:
            member = member if held else canonical_member(member)
            box = outline_box(member, BOX_MARGIN * member.sigma_m)
            data = prepared(scan, member, options.degree, options.footprint_rad, box, data.rows)
            theta = _of_member(data, layout, member, scored.theta)
    free_edge = _sees_farther_out(part, layout, scored, held, options)
    if free_edge:
        scored = _fitted(part, layout, scored.theta, held, free_edge=True)
        n_iterations += scored.n_iterations
    if len(data) > len(part):
        part = data.take(sampled_rows(len(data), options.n_polish, options.seed))
        last_step = _fitted(part, layout, scored.theta, held, free_edge=free_edge, max_iterations=1)
        scored = dataclasses.replace(last_step, converged=scored.converged)
        n_iterations += scored.n_iterations
    final = _member(layout, scored, member, data, part, held)
    few = part.take(sampled_rows(len(part), min(options.n_fit, N_FIRST), options.seed))
    if data.hits_only:
        final = _without_spread_law(final, few, layout, scored, held, len(part))
    checked = _checked(final, few, layout, scored, held, len(part), free_edge)
    if free_edge:
        checked = _doubted(checked, EDGE_DOUBT * part.edge_unit_m * abs(float(scored.theta[layout.place["edge"]])))
    return _result(layout, scored, checked, data, n_iterations)


def _sees_farther_out(data: RayData, layout: RayLayout, scored: Scored, held: Mapping[str, float], options: RayOptions) -> bool:
    """Whether the rays prove (BIC) that the sensor does not lose an edge where half of its beam has passed it.

    A sensor that reports any light sees edges a beam's radius farther out, one that wants a strong echo farther in.
    """
    beam = math.exp(scored.theta[layout.place["log_footprint"]]) * float(np.median(data.foot_rad * data.distance))
    if data.hits_only or beam < data.least_width:  # the rays do not resolve the beam: there is no edge to move within it
        return False
    few = data.take(sampled_rows(len(data), min(options.n_fit, N_FIRST), options.seed))
    plain = _fitted(few, layout, scored.theta, held, max_iterations=6)
    moved = _fitted(few, layout, plain.theta, held, free_edge=True, max_iterations=12)
    gain = (moved.log_posterior - plain.log_posterior - BY_CHANCE) * len(data) / len(few)
    return gain > (1 + few.footprint_known) * 0.5 * math.log(len(data))


def _settled(data: RayData, layout: RayLayout, theta: FloatArray, held: Mapping[str, float]) -> Scored:
    """The better of the fit from theta and of that from theta annealed once more: sharp edges may lock a section before its planes are right."""
    direct = _fitted(data, layout, theta, held, tolerance=0.2)
    soft = direct.theta
    for width in AGAIN:
        soft = _fitted(data, layout, soft, held, still=("log_footprint",), least_m=width * data.size, max_iterations=20, tolerance=0.05).theta
    again = _fitted(data, layout, soft, held, tolerance=0.2)
    return max((direct, again), key=lambda one: one.log_posterior)


def _draw(n: int, options: RayOptions) -> int:
    """How many rays the second round uses: all, where that is hardly dearer than a sample and one more polish."""
    return n if n <= min(2 * options.n_fit, options.n_polish) else options.n_fit


def _fitted(
    data: RayData,
    layout: RayLayout,
    theta: FloatArray,
    held: Mapping[str, float],
    *,
    still: tuple[str, ...] = (),
    free_edge: bool = False,
    least_m: float = 0.0,
    max_iterations: int = 40,
    tolerance: float = 0.01,
) -> Scored:
    """Scoring from theta. held : name -> value.   still : names that keep the value they have in theta."""
    if not free_edge:
        still = (*still, "edge", *(("log_footprint",) if data.footprint_known else ()))
    if data.hits_only:
        still = (*still, "edge", "logit_dropped", "start", "end")
    fixed = {**{name: float(theta[layout.place[name]]) for name in still}, **held}
    lower, upper = layout.bounds(theta, data.size, data.footprint_known, fixed)
    return maximise(
        summed(RayModel(layout, data, least_m).evaluate),
        theta,
        scale=layout.scale(data.size),
        lower=lower,
        upper=upper,
        prior=layout.prior(data.size, data.footprint_known),
        max_iterations=max_iterations,
        tolerance=tolerance,
        least_gain=2 * tolerance,
    )


def _best_start(data: RayData, layout: RayLayout, start: Member, held: Mapping[str, float]) -> FloatArray:
    """Every start annealed; half of them are dropped at each width."""
    thetas = [*_boxed(data, layout, start), _of_member(data, layout, start)]
    still: tuple[str, ...] = (*NUISANCE, "start", "end")
    for step, width in enumerate(ANNEALED):
        done = [_fitted(data, layout, t, held, still=still, least_m=width * data.size, max_iterations=6, tolerance=0.1) for t in thetas]
        done.sort(key=lambda one: -one.log_posterior)
        thetas = [one.theta for one in done[: max(3, len(done) // 2)]]
        if step:
            still = NUISANCE
    final = [_fitted(data, layout, t, held, max_iterations=15, tolerance=1e-2) for t in thetas]
    best = max(final, key=lambda one: one.log_posterior)
    return _thinnest(data, layout, best, held).theta


def _thinnest(data: RayData, layout: RayLayout, best: Scored, held: Mapping[str, float]) -> Scored:
    """The walls started again from thin to thick: of fits that the rays cannot tell apart, the one with the thinnest walls."""
    walls = [layout.place[n] for n in layout.dimensions if n in WALLS]
    if not walls or set(layout.dimensions[i] for i in walls) <= set(held):
        return best
    found = [best]
    for share in WALL_STARTS:
        theta = best.theta.copy()
        theta[walls] = share * data.size
        found.append(_fitted(data, layout, theta, held, max_iterations=15, tolerance=1e-2))
    top = max(one.log_posterior for one in found)
    alike = [one for one in found if one.log_posterior > top - ALIKE]
    return min(alike, key=lambda one: float(one.theta[walls].sum()))


def _boxed(data: RayData, layout: RayLayout, start: Member) -> list[FloatArray]:
    """A section that fills the box of the hits, at each of eight rolls."""
    out = []
    base = _of_member(data, layout, start)
    p, n = layout.n_values, layout.degree + 1
    for turn in range(N_ROLLS):
        roll = turn * 2 * np.pi / N_ROLLS
        c, s = math.cos(roll), math.sin(roll)
        R = np.array([[c, -s], [s, c]])
        low, high = np.quantile(data.hits_2d @ R, [0.02, 0.98], axis=0)
        width, height = np.maximum(high - low, 0.05 * data.size)
        middle = (low + high) / 2
        thin = 0.1 * min(width, height)
        values, origin = {
            "L": ((width, height, thin), low),
            "I": ((height, width, thin, thin), middle),
            "C": ((height, width, thin, thin), np.array([low[0], middle[1]])),
            "T": ((height, width, thin, thin), np.array([middle[0], high[1]])),
            "RHS": ((height, width), middle),
            "rect": ((width, height), middle),
            "CHS": ((max(width, height),), middle),
            "round": ((max(width, height),), middle),
        }[layout.family]
        theta = base.copy()
        theta[:p], theta[p] = values, roll
        theta[p + 1], theta[p + 1 + n] = R @ origin
        out.append(theta)
    return out


def _of_member(data: RayData, layout: RayLayout, member: Member, nuisance: FloatArray | None = None) -> FloatArray:
    """theta of the member in whose frame the rays are given; the noise, beam and shares of another theta, if there is one."""
    theta = np.zeros(len(layout.names))
    values = member.values()
    theta[: layout.n_values] = [values[n] for n in layout.dimensions]
    axis = layout.axis(theta)
    n = min(member.bow.shape[1], layout.degree - 1)
    axis[:, 2 : 2 + n] = member.bow[:, :n]
    theta[layout.place["start"]], theta[layout.place["end"]] = data.ends
    theta[layout.place["log_sigma"]] = math.log(max(member.sigma_m, 1e-4 * data.size))
    theta[layout.place["log_footprint"]] = -math.log(FULL_OPENING) if data.footprint_known else LOG_FOOT_PRIOR[0]
    theta[-2:] = LOGIT_PRIOR[0]
    if nuisance is not None:
        theta[-len(NUISANCE) :] = nuisance[-len(NUISANCE) :]
    return theta


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
    covariance, parameters = _dimensions(layout, scored, start, length, held, len(data) / len(used))
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


def _dimensions(
    layout: RayLayout, scored: Scored, start: Member, length: float, held: Mapping[str, float], share: float
) -> tuple[FloatArray, tuple[Parameter, ...]]:
    """Covariance of the member's parameters in their order, and the parameters. share : rays there are per ray used."""
    names = tuple(one.name for one in start.parameters)
    picked = np.zeros((len(names), len(scored.theta)))
    for row, name in enumerate(names):
        if name in layout.dimensions:
            picked[row, layout.place[name]] = 1
        elif name == "length":
            picked[row, layout.place["end"]], picked[row, layout.place["start"]] = 1, -1
    covariance = _covariance(scored, picked)
    parameters = []
    for row, one in enumerate(start.parameters):
        value = length if one.name == "length" else float(picked[row] @ scored.theta) if picked[row].any() else one.value_m
        sd = float(np.sqrt(covariance[row, row])) if picked[row].any() and not _held(layout, scored, one.name) else math.inf
        if one.name in held:
            parameters.append(dataclasses.replace(one, value_m=held[one.name], std_m=None, observable=True, source="fixed"))
        elif np.isfinite(sd) and sd < TOLD * value:
            parameters.append(dataclasses.replace(one, value_m=value, std_m=sd, observable=True, source="fitted"))
        else:
            source = "fitted" if picked[row].any() else one.source
            parameters.append(dataclasses.replace(one, value_m=value, std_m=None, observable=False, source=source))
    free = np.array([one.std_m is not None for one in parameters])
    return np.where(np.outer(free, free), covariance, 0.0), tuple(parameters)


def _held(layout: RayLayout, scored: Scored, name: str) -> bool:
    """True where a dimension stopped at its bound: it has no standard deviation."""
    places = [layout.place[n] for n in (("start", "end") if name == "length" else (name,))]
    return bool(scored.at_bound[places].any())


def _checked(member: Member, data: RayData, layout: RayLayout, scored: Scored, held: Mapping[str, float], n_used: int, free_edge: bool) -> Member:
    """The member without the standard deviations that do not hold: each dimension is moved three of them both ways and the rest fitted again.

    Where the rays hold it the log likelihood falls by 4.5; where a face has left the view on the way it does not fall, and nothing is told.
    Where only hits were recorded, the fit took them to spread evenly over the silhouette. That is a guess (the rays of a rotating LiDAR do not),
    so here they are asked without it: what hit, hit, and nothing says that a ray farther out would not have.
    """
    still = ("start", "end", "logit_dropped") if data.hits_only else ()
    data = dataclasses.replace(data, hits_only=False)
    here = _fitted(data, layout, scored.theta, held, still=still, free_edge=free_edge, max_iterations=8, tolerance=1e-2)
    parameters = []
    for one in member.parameters:
        if one.std_m is None or one.name == "length":
            parameters.append(one)
            continue
        step = CHECK_STEPS * one.std_m * math.sqrt(n_used / len(data))
        at = float(here.theta[layout.place[one.name]])
        holds = True
        for moved in (at - step, at + step):
            if not 0.25 * at < moved:
                moved = 0.25 * at
            theta = here.theta.copy()
            theta[layout.place[one.name]] = moved
            there = _fitted(data, layout, theta, {**held, one.name: moved}, still=still, free_edge=free_edge, max_iterations=8, tolerance=1e-2)
            expected = 0.5 * ((moved - at) / (step / CHECK_STEPS)) ** 2
            holds = holds and here.log_posterior - there.log_posterior > CHECK_SHARE * expected
        parameters.append(one if holds else dataclasses.replace(one, std_m=None, observable=False))
    free = np.array([one.std_m is not None for one in parameters])
    return dataclasses.replace(member, parameters=tuple(parameters), covariance=np.where(np.outer(free, free), member.covariance, 0.0))


def _doubted(member: Member, doubt_m: float) -> Member:
    """The member with an error common to all that edges tell, where the sensor's way to see edges was itself fitted."""
    told = np.array([one.std_m is not None for one in member.parameters])
    covariance = np.where(np.outer(told, told), member.covariance, 0.0) + np.diag(np.where(told, doubt_m**2, 0.0))
    parameters = tuple(
        one
        if one.std_m is None
        else dataclasses.replace(one, std_m=math.hypot(one.std_m, doubt_m))
        if math.hypot(one.std_m, doubt_m) < TOLD * one.value_m
        else dataclasses.replace(one, std_m=None, observable=False)
        for one in member.parameters
    )
    free = np.array([one.std_m is not None for one in parameters])
    return dataclasses.replace(member, parameters=parameters, covariance=np.where(np.outer(free, free), covariance, 0.0))


def _without_spread_law(member: Member, data: RayData, layout: RayLayout, scored: Scored, held: Mapping[str, float], n_used: int) -> Member:
    """The member fitted to hits alone with the standard deviations of a fit that does not take them to spread evenly over the silhouette.

    The difference between the two fits is added: what stands on that guess gets an error as large as the guess matters.
    """
    other = _fitted(dataclasses.replace(data, hits_only=False), layout, scored.theta, held, still=("start", "end", "logit_dropped"), max_iterations=8)
    names = [one.name for one in member.parameters]
    picked = np.array([[float(n == name and name in layout.dimensions) for n in layout.names] for name in names])
    away = picked @ (other.theta - scored.theta)
    covariance = _covariance(other, picked) * len(data) / n_used + np.diag(away**2)
    sd = np.sqrt(np.diag(covariance))
    parameters = tuple(
        one
        if one.std_m is None
        else dataclasses.replace(one, std_m=float(sd[i]))
        if 0 < sd[i] < TOLD * one.value_m
        else dataclasses.replace(one, std_m=None, observable=False)
        for i, one in enumerate(member.parameters)
    )
    free = np.array([one.std_m is not None for one in parameters])
    return dataclasses.replace(member, parameters=parameters, covariance=np.where(np.outer(free, free), covariance, 0.0))


def _covariance(scored: Scored, picked: FloatArray) -> FloatArray:
    """(k, k) covariance of picked @ theta, over the unknowns that were free; inf on the diagonal where the rays say nothing."""
    free = ~scored.at_bound
    information, rows = scored.information[np.ix_(free, free)], picked[:, free]
    scale = 1 / np.sqrt(np.where(np.diag(information) > 0, np.diag(information), 1.0))
    value, vector = np.linalg.eigh(information * np.outer(scale, scale))
    blind = value < BLIND * value[-1]
    scaled = rows * scale
    seen = scaled @ vector[:, ~blind]
    covariance: FloatArray = (seen / value[~blind]) @ seen.T
    unseen = np.linalg.norm(scaled @ vector[:, blind], axis=1) > 1e-3 * np.linalg.norm(scaled, axis=1)
    covariance[unseen, unseen] = np.inf
    return covariance


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
