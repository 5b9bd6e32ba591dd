"""How far each dimension that rays were fitted to may be trusted: its covariance, what falls when it is moved, and what rests on guesses."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from scan2fea.estimation.ray_data import RayData
from scan2fea.estimation.ray_model import RayLayout
from scan2fea.estimation.ray_profile import walked
from scan2fea.estimation.ray_starts import fitted
from scan2fea.estimation.scoring import Scored
from scan2fea.types import FloatArray, Member, Parameter

TOLD = 1 / 6  # a dimension is told if its standard deviation is below this share of it: 2 mm of a wall of 6.35 mm are then 1.9 of them
BY_CHANCE = 2.0  # log likelihood that an unknown which is not there may gain (1 in 20)
GAIN = 0.5  # log likelihood by which another fit is a better one
BLIND = 1e-9  # of the largest eigenvalue of the scaled information: a direction without any ray


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


def checked(
    member: Member, data: RayData, layout: RayLayout, scored: Scored, held: Mapping[str, float], n_used: int, free_edge: bool
) -> tuple[Member, Scored | None]:
    """The member with the standard deviations that the profile of the likelihood bears out, and a likelier fit where one was met on the way.

    Each dimension is moved both ways and the rest fitted again (`ray_profile`); where a face has left the view on the way nothing falls and nothing
    is told.
    Where only hits were recorded, the fit took them to spread evenly over the silhouette. That is a guess (the rays of a rotating LiDAR do not),
    so here they are asked without it: what hit, hit, and nothing says that a ray farther out would not have.
    """
    still = ("start", "end", "logit_dropped") if data.hits_only else ()
    data = dataclasses.replace(data, hits_only=False)
    top = best = fitted(data, layout, scored.theta, held, still=still, free_edge=free_edge, max_iterations=8, tolerance=1e-2)
    scale = math.sqrt(n_used / len(data))
    covariance, parameters = np.array(member.covariance, float), []
    for k, one in enumerate(member.parameters):
        if one.std_m is None or one.name == "length":
            parameters.append(one)
            continue
        std, met = walked(data, layout, top, held, one.name, scale * one.std_m, still=still, free_edge=free_edge)
        best = max(best, met, key=lambda fit: fit.log_posterior)
        wider = max(std / scale, one.std_m)
        covariance[k] *= wider / one.std_m if wider < np.inf else 0.0
        covariance[:, k] *= wider / one.std_m if wider < np.inf else 0.0
        is_told = wider < TOLD * one.value_m
        parameters.append(dataclasses.replace(one, std_m=wider if is_told else None, observable=is_told))
    free = np.array([one.std_m is not None for one in parameters])
    trusted = dataclasses.replace(member, parameters=tuple(parameters), covariance=np.where(np.outer(free, free), covariance, 0.0))
    return trusted, best if best.log_posterior > top.log_posterior + GAIN / scale**2 else None


def doubted(member: Member, doubt_m: float) -> Member:
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
        if 0 < sd[i] < TOLD * one.value_m
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
