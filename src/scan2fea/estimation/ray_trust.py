"""How far each dimension that rays were fitted to may be trusted: its covariance, what falls when it is moved, and what rests on guesses."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.estimation.ray_data import RayData
from scan2fea.estimation.ray_model import WALLS, RayLayout
from scan2fea.estimation.ray_profile import LIMIT, walked
from scan2fea.estimation.ray_starts import fitted
from scan2fea.estimation.scoring import Scored
from scan2fea.types import FloatArray, Member, Parameter

TOLD = 1 / 6  # a wall is told if its standard deviation is below this share of it: 2 mm of a wall of 6.35 mm are then 1.9 of them
TOLD_ACROSS = 1 / 10  # the same of other dimensions: rolled sizes are a tenth apart, and a leg known no better leaves the volume open by 5 %
BY_CHANCE = 2.0  # log likelihood that an unknown which is not there may gain (1 in 20)
GAIN = 0.5  # log likelihood by which another fit is a better one
EVEN = 0.3  # a profile whose mean and deviation are so near to those of the curvature, in deviations and as a log, is a parabola
LEAST_FALL = 0.125  # that of half a standard deviation: rounding and chance
BLIND = 1e-9  # of the largest eigenvalue of the scaled information: a direction without any ray

Rivals = Sequence[tuple[Mapping[str, float], float]]  # dimensions of other fits and by how much each is less likely


def dimensions_of(
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
        elif is_told(one.name, value, sd):
            parameters.append(dataclasses.replace(one, value_m=value, std_m=sd, observable=True, source="fitted"))
        else:
            source = "fitted" if picked[row].any() else one.source
            parameters.append(dataclasses.replace(one, value_m=value, std_m=None, observable=False, source=source))
    free = np.array([one.std_m is not None for one in parameters])
    return np.where(np.outer(free, free), covariance, 0.0), tuple(parameters)


def is_told(name: str, value_m: float, std_m: float) -> bool:
    """Whether a dimension that is known so well is told at all.

    A wall is told that would be had it come out a deviation thinner: else those that come out too thick are told and the others not.
    """
    return std_m < (TOLD * (value_m - std_m) if name in WALLS else TOLD_ACROSS * value_m)


def _held(layout: RayLayout, scored: Scored, name: str) -> bool:
    """True where a dimension stopped at its bound: it has no standard deviation."""
    places = [layout.place[n] for n in (("start", "end") if name == "length" else (name,))]
    return bool(scored.at_bound[places].any())


@dataclass(frozen=True, eq=False, kw_only=True)
class Trust:
    """What `checked` found.

    member : with the standard deviations that the profiles bear out.   shifts : told dimension -> m, of its mean from where the fit has it.
    better : a likelier fit that was met on the way, or None.
    """

    member: Member
    shifts: Mapping[str, float]
    better: Scored | None


def checked(
    member: Member, few: RayData, part: RayData, layout: RayLayout, scored: Scored, held: Mapping[str, float], free_edge: bool, rivals: Rivals = ()
) -> Trust:
    """The member with the standard deviations and means that the profile of the likelihood bears out.

    Each dimension is moved both ways and the rest fitted again (`ray_profile`); where a face has left the view on the way nothing falls and nothing
    is told. What another fit that is nearly as likely says otherwise (`rivals`) is not known better than that.
    few, part : some of the rays, and all that were fitted; these are asked where the profile of the few is no parabola: fewer rays leave wider gaps.
    Where only hits were recorded, the fit took them to spread evenly over the silhouette. That is a guess (the rays of a rotating LiDAR do not),
    so here they are asked without it: what hit, hit, and nothing says that a ray farther out would not have.
    """
    still = ("start", "end", "logit_dropped") if part.hits_only else ()
    tops: dict[int, Scored] = {}
    better = None
    covariance, parameters, shifts = np.array(member.covariance, float), [], {}
    for k, one in enumerate(member.parameters):
        if one.std_m is None or one.name == "length":
            parameters.append(one)
            continue
        for rays in (few, part) if len(part) > len(few) else (part,):
            data, scale = dataclasses.replace(rays, hits_only=False), math.sqrt(len(part) / len(rays))
            if len(data) not in tops:
                tops[len(data)] = fitted(data, layout, scored.theta, held, still=still, free_edge=free_edge, max_iterations=8, tolerance=1e-2)
            top = tops[len(data)]
            walk = walked(data, layout, top, held, one.name, scale * one.std_m, still=still, free_edge=free_edge)
            if walk.best.log_posterior > top.log_posterior + GAIN / scale**2:
                better = walk.best
            if abs(walk.shift_m) < EVEN * walk.std_m and abs(math.log(walk.std_m / (scale * one.std_m))) < EVEN:
                break
        std = max(walk.std_m / scale, _apart(one, rivals))
        covariance[k] *= std / one.std_m if std < np.inf else 0.0
        covariance[:, k] *= std / one.std_m if std < np.inf else 0.0
        told = is_told(one.name, one.value_m, std)
        parameters.append(dataclasses.replace(one, std_m=std if told else None, observable=told))
        if told:
            shifts[one.name] = walk.shift_m / scale**2
    free = np.array([one.std_m is not None for one in parameters])
    trusted = dataclasses.replace(member, parameters=tuple(parameters), covariance=np.where(np.outer(free, free), covariance, 0.0))
    return Trust(member=trusted, shifts=shifts, better=better)


def rivals_of(members: Sequence[Member], levels: Sequence[float], share: float) -> Rivals:
    """Dimensions of every fit but the first that a 99 % interval holds, with its fall. share : rays there are per ray used."""
    falls = [share * (levels[0] - level) for level in levels]
    return tuple((member.values(), max(fall, LEAST_FALL)) for member, fall in list(zip(members, falls, strict=True))[1:] if fall < 0.5 * LIMIT**2)


def _apart(one: Parameter, rivals: Rivals) -> float:
    """The standard deviation that another fit asks for, which is as likely as a place so many of them away."""
    return max((abs(values[one.name] - one.value_m) / math.sqrt(2 * fall) for values, fall in rivals), default=0.0)


def doubted(member: Member, doubt_m: float) -> Member:
    """The member with an error common to all that edges tell, where the sensor's way to see edges was itself fitted."""
    told = np.array([one.std_m is not None for one in member.parameters])
    covariance = np.where(np.outer(told, told), member.covariance, 0.0) + np.diag(np.where(told, doubt_m**2, 0.0))
    parameters = tuple(
        one
        if one.std_m is None
        else dataclasses.replace(one, std_m=math.hypot(one.std_m, doubt_m))
        if is_told(one.name, one.value_m, math.hypot(one.std_m, doubt_m))
        else dataclasses.replace(one, std_m=None, observable=False)
        for one in member.parameters
    )
    free = np.array([one.std_m is not None for one in parameters])
    return dataclasses.replace(member, parameters=parameters, covariance=np.where(np.outer(free, free), covariance, 0.0))


def without_spread_law(
    member: Member, start: Member, data: RayData, layout: RayLayout, scored: Scored, held: Mapping[str, float], n_used: int
) -> Member:
    """The member fitted to hits alone with the standard deviations of a fit that does not take them to spread evenly over the silhouette.

    The difference between the two fits is added: what stands on that guess gets an error as large as the guess matters. Without misses no ray
    tells where the member ends; the points do, so the length has the error it had in `start`, which was fitted to their density along the axis.
    """
    other = fitted(dataclasses.replace(data, hits_only=False), layout, scored.theta, held, still=("start", "end", "logit_dropped"), max_iterations=8)
    names = [one.name for one in member.parameters]
    picked = np.array([[float(n == name and name in layout.dimensions) for n in layout.names] for name in names])
    away = picked @ (other.theta - scored.theta)
    covariance = _covariance(other, picked) * len(data) / n_used + np.diag(away**2 + _of_length(member, start))
    sd = np.sqrt(np.diag(covariance))
    parameters = tuple(
        one
        if one.std_m is None and (one.name != "length" or one.source == "fixed")
        else dataclasses.replace(one, std_m=float(sd[i]), observable=True)
        if sd[i] > 0 and is_told(one.name, one.value_m, float(sd[i]))
        else dataclasses.replace(one, std_m=None, observable=False)
        for i, one in enumerate(member.parameters)
    )
    free = np.array([one.std_m is not None for one in parameters])
    return dataclasses.replace(member, parameters=parameters, covariance=np.where(np.outer(free, free), covariance, 0.0))


def _of_length(member: Member, start: Member) -> FloatArray:
    """(k,) variance of the length in its place, as `start` has it and by how far the two are apart; zero elsewhere, and where it was not told."""
    before = next(one for one in start.parameters if one.name == "length")
    std = 0.0 if before.std_m is None else before.std_m
    return np.array([std**2 + (one.value_m - before.value_m) ** 2 if one.name == "length" and std > 0 else 0.0 for one in member.parameters])


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
