"""Where the rays of an object are known and the points alone do not settle its section, hits and misses are asked."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from scan2fea.errors import EstimationError, UsageError
from scan2fea.estimation.anneal import walls
from scan2fea.estimation.explain import Explanation, explanation
from scan2fea.estimation.given import Given, compared, joint_p_value, told_by
from scan2fea.estimation.outline import outline_distance
from scan2fea.estimation.ray_likelihood import RayOptions, fit_rays
from scan2fea.estimation.ray_voids import told_by_rays
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.sections import PARAMETERS, section
from scan2fea.types import Member, Parameter, Scan

_SETTLED = 0.3  # noise over wall: below, the points alone place both sides of every wall (shape-estimation.md, method 7)
_QUICK_RAYS = 3_000
_DEEP = 4.0  # sigma
_MIN_KNOWN = 0.5  # share of the points whose ray is known


def needs_rays(scan: Scan, member: Member, explains: bool) -> bool:
    """Whether rays are known for most points, and the noise is not small against the walls, or the points left something open."""
    if scan.rays is None or len(scan.cloud) == 0 or float((scan.cloud.ray >= 0).mean()) < _MIN_KNOWN:
        return False
    values = member.values()
    thinnest = min((values[name] for name in walls(member.family)), default=math.inf)
    return not explains or member.sigma_m > _SETTLED * thinnest or any(not one.observable for one in member.parameters)


def sensor_inside(scan: Scan, member: Member) -> str:
    """Why the rays cannot be believed: a sensor stood within the solid, deeper than noise; "" where none did, or where no ray is known.

    A sensor within the opening of a tube stands outside the solid.
    """
    if scan.rays is None or len(scan.rays.origin) == 0:
        return ""
    origins = np.unique(scan.rays.origin[np.unique(scan.cloud.ray[scan.cloud.ray >= 0])], axis=0)
    local = sweep_of_member(member).coordinates(origins)
    depth = -outline_distance(section(member.family, member.values()), local[:, :2])[0]
    within = (depth > _DEEP * member.sigma_m) & (local[:, 2] > 0) & (local[:, 2] < member.values()["length"])
    if not within.any():
        return ""
    at = ", ".join(f"{x:.4g}" for x in origins[int(np.argmax(depth * within))])
    return f"the sensor position ({at}) m lies within the solid, {1e3 * float(depth[within].max()):.2g} mm deep: it is not used; check it"


def refined(
    scan: Scan, member: Member, told: Explanation, fixed: Mapping[str, float], families: tuple[str, ...], seed: int
) -> tuple[Member, Explanation, str]:
    """The member by its rays where that explains the points at least as well, else the member that was; and why the rays were not used, or "".

    Rings and uneven scans mislead the density about the family: where its member does not explain the points the rays choose among `families`.
    """
    degree = min(max(member.bow.shape[1] + 1, 1), 4)
    if not told.explains and len(families) > 1:
        member = _likeliest_family(scan, member, families, degree, seed)
    try:
        fit = fit_rays(scan, member, RayOptions(degree=degree, seed=seed), {k: v for k, v in fixed.items() if k != "length"})
    except (EstimationError, UsageError) as error:
        return member, told, str(error)
    if not fit.misses_known and told.explains:
        return member, told, "only the rays that hit were recorded: they do not say where the member ends across them"
    found = dataclasses.replace(fit.member, families=member.families)
    points = scan.cloud.points if scan.cloud.is_inferred is None else scan.cloud.points[~scan.cloud.is_inferred]
    by_rays = told_by_rays(scan, found, found.sigma_m, seed, misses_known=fit.misses_known)
    local = told.local_sigma_m if told.explains else None  # of almost the same points
    judged = explanation(points, found, found.sigma_m, seed, along_rays=True, by_rays=by_rays, local_sigma_m=local)
    if not judged.explains and told.explains:  # where neither explains the points, hits and misses know more than points alone
        return member, told, f"the member that the rays prefer explains the points less well: {judged.reason}"
    return dataclasses.replace(found, seen=judged.seen), judged, ""


def compared_by_rays(scan: Scan, member: Member, fixed: Mapping[str, float], seed: int) -> tuple[float | None, tuple[Given, ...]]:
    """Dimensions that are held beside what the rays say of them, and the p-value of all together; nothing where rays fit no such section."""
    degree = min(max(member.bow.shape[1] + 1, 1), 4)
    try:
        free = fit_rays(scan, member, RayOptions(degree=degree, seed=seed)).member
    except (EstimationError, UsageError):
        return None, ()
    told = told_by(free)
    return joint_p_value(fixed, told), compared(fixed, told, member.family, held=True)


def _likeliest_family(scan: Scan, member: Member, families: tuple[str, ...], degree: int, seed: int) -> Member:
    """A start of the family whose quick fit makes the rays likeliest, at BIC's price for its unknowns; `families` of it are the posterior."""
    quick = RayOptions(degree=degree, n_start=600, n_fit=_QUICK_RAYS, n_polish=_QUICK_RAYS, seed=seed)
    levels: dict[str, float] = {}
    best = {member.family: member}
    for family in families:
        try:
            fit = fit_rays(scan, best.get(family, _as_family(member, family)), quick)
        except (EstimationError, UsageError):  # a family that the rays press flat is none
            continue
        rays = max(fit.n_hits + fit.n_misses, 1)
        levels[family] = fit.log_likelihood * max(1.0, rays / _QUICK_RAYS) - 0.5 * len(fit.names) * math.log(rays)
        best[family] = fit.member
    if not levels:
        return member
    top = max(levels.values())
    share = {family: math.exp(level - top) for family, level in levels.items()}
    total = sum(share.values())
    winner = max(levels, key=lambda family: levels[family])
    return dataclasses.replace(best[winner], families={family: value / total for family, value in share.items()})


def _as_family(member: Member, family: str) -> Member:
    """The same bar of space with another section in it: only a start."""
    values = member.values()
    across = [v for k, v in values.items() if k not in ("length", "t", "tw", "tf")]
    size = max(across)
    wall = {"t": 0.06, "tw": 0.06, "tf": 0.06}
    if family == "rect":
        wall = {"t": 1.0}
    parameters = tuple(
        Parameter(name=name, value_m=wall.get(name, 1.0) * size, std_m=None, observable=False, source="fitted") for name in PARAMETERS[family]
    )
    length = tuple(one for one in member.parameters if one.name == "length")
    n = len(parameters) + 1
    return dataclasses.replace(member, family=family, parameters=parameters + length, covariance=np.zeros((n, n)))
