"""Where the fit to rays begins, and how it climbs: the section in the box of the points at eight rolls and the start that is given, each with
beam and noise widened to a share of the section and narrowed step by step, so that a misplaced edge feels rays that pass far from it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from scan2fea.estimation.ray_data import FULL_OPENING, RayData
from scan2fea.estimation.ray_model import LOG_FOOT_PRIOR, LOGIT_PRIOR, NUISANCE, WALLS, RayLayout, RayModel
from scan2fea.estimation.scoring import Scored, maximise, summed
from scan2fea.kernel.noise import sampled_rows
from scan2fea.types import FloatArray, Member

N_ROLLS = 8
ANNEALED = (0.12, 0.06, 0.03, 0.015)  # width of beam and noise, in sizes of the section
AGAIN = (0.05, 0.02, 0.008)  # the same for the second annealing
N_AGAIN = 1200  # rays of it: wide beams need no more, and what follows sharpens it with all
WALL_STARTS = (0.03, 0.1, 0.3)  # of the section's size
SAME_SECTION = 0.01  # of its size: nearer than this are two climbs of one hill
OUTRUN = 20.0  # log likelihood, of the few rays that judge the starts: what is so far behind does not come back
ALIKE = 2.0  # log likelihoods nearer than this are no reason to prefer one fit (a factor of 7)


def fitted(
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


def contenders(data: RayData, layout: RayLayout, thetas: list[FloatArray], held: Mapping[str, float]) -> list[Scored]:
    """The fits from several starts, the likeliest first, or, of those that the rays cannot tell apart, the one with the thinnest walls."""
    found: list[Scored] = []
    for theta in thetas:
        one = settled(data, layout, theta, held)
        if all(not _same(layout, one, other) for other in found):
            found.append(one)
    walls = [layout.place[n] for n in layout.dimensions if n in WALLS]
    top = max(one.log_posterior for one in found)
    return sorted(found, key=lambda one: (one.log_posterior < top - ALIKE, float(one.theta[walls].sum()), -one.log_posterior))


def _same(layout: RayLayout, one: Scored, other: Scored) -> bool:
    """Whether two climbs came to the same section, however it is written."""
    a, b = (np.sort(fit.theta[: layout.n_values]) for fit in (one, other))
    return bool(np.abs(a - b).max() < SAME_SECTION * b.max() and abs(one.log_posterior - other.log_posterior) < ALIKE)


def settled(data: RayData, layout: RayLayout, theta: FloatArray, held: Mapping[str, float]) -> Scored:
    """The better of the fit from theta and of that from theta annealed once more: sharp edges may lock a section before its planes are right."""
    direct = fitted(data, layout, theta, held, tolerance=0.2)
    soft, few = direct.theta, data.take(sampled_rows(len(data), N_AGAIN, 0))
    for width in AGAIN:
        soft = fitted(few, layout, soft, held, still=("log_footprint",), least_m=width * data.size, max_iterations=20, tolerance=0.05).theta
    again = fitted(data, layout, soft, held, tolerance=0.2)
    return max((direct, again), key=lambda one: one.log_posterior)


def best_starts(data: RayData, layout: RayLayout, start: Member, held: Mapping[str, float]) -> list[FloatArray]:
    """Every start annealed; half of them are dropped at each width. The likeliest first, with walls as thin as the rays allow."""
    thetas = [*_boxed(data, layout, start), of_member(data, layout, start)]
    still: tuple[str, ...] = (*NUISANCE, "start", "end")
    for step, width in enumerate(ANNEALED):
        done = [fitted(data, layout, t, held, still=still, least_m=width * data.size, max_iterations=6, tolerance=0.1) for t in thetas]
        done.sort(key=lambda one: -one.log_posterior)
        thetas = [one.theta for one in done[: max(3, len(done) // 2)]]
        if step:
            still = NUISANCE
    final = [fitted(data, layout, t, held, max_iterations=15, tolerance=1e-2) for t in thetas]
    final.sort(key=lambda one: -one.log_posterior)
    apart = [one for k, one in enumerate(final) if not any(_same(layout, one, other) for other in final[:k])]
    rest = [one.theta for one in apart[1:] if one.log_posterior > final[0].log_posterior - OUTRUN]
    return [thinnest(data, layout, final[0], held).theta, *rest]


def thinnest(data: RayData, layout: RayLayout, best: Scored, held: Mapping[str, float], *, free_edge: bool = False) -> Scored:
    """The walls started again from thin to thick: of fits that the rays cannot tell apart, the one with the thinnest walls."""
    walls = [layout.place[n] for n in layout.dimensions if n in WALLS]
    if not walls or set(layout.dimensions[i] for i in walls) <= set(held):
        return best
    found = [best]
    for share in WALL_STARTS:
        theta = best.theta.copy()
        theta[walls] = share * data.size
        found.append(fitted(data, layout, theta, held, free_edge=free_edge, max_iterations=15, tolerance=1e-2))
    top = max(one.log_posterior for one in found)
    alike = [one for one in found if one.log_posterior > top - ALIKE]
    return min(alike, key=lambda one: float(one.theta[walls].sum()))


def _boxed(data: RayData, layout: RayLayout, start: Member) -> list[FloatArray]:
    """A section that fills the box of the hits, at each of eight rolls."""
    out = []
    base = of_member(data, layout, start)
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


def of_member(data: RayData, layout: RayLayout, member: Member, nuisance: FloatArray | None = None) -> FloatArray:
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
