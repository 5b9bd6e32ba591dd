"""Estimation or reconstruction? A member that explains its points within their noise needs a dozen numbers where a free surface needs thousands:
it is tried first, and whatever it does not explain is reconstructed. Why is told either way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from scan2fea.errors import EstimationError, InputError
from scan2fea.estimation.catalogued import catalogued
from scan2fea.estimation.damage import damages
from scan2fea.estimation.designation import parse_designation
from scan2fea.estimation.member import MemberFit, MemberOptions, fit_member
from scan2fea.estimation.resting import rested
from scan2fea.estimation.table import Table, read_table
from scan2fea.kernel.noise import spacing
from scan2fea.options import option
from scan2fea.types import Member, Route, Scan, Value

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

    p_fixed : probability of data as far from the given dimensions as these if those were true; None where none was given.
    """

    member: Member | None
    explains: bool
    reason: str
    p_fixed: float | None = None


def estimate(scan: Scan, options: MemberOptions, route: RouteOptions) -> Estimate:
    """The member of the points, with its catalogue and damage. A bad designation or table raises; an object that is no member does not."""
    table = table_of(route)
    known = known_section(options, route, table)
    try:
        fit = fit_member(scan, *known)
    except (EstimationError, InputError) as error:
        return Estimate(member=None, explains=False, reason=str(error))
    member, inferred = fit.member, scan.cloud.is_inferred
    if inferred is not None:
        member = rested(member, scan.cloud.points[inferred], spacing(scan.cloud.points[~inferred]))
    if not any(p.observable or p.source == "fixed" for p in member.parameters if p.name != "length"):
        return Estimate(member=None, explains=False, reason=f"no dimension of a {member.family} member was seen")
    member = catalogued(member, table)
    if fit.explains:
        member = replace(member, damage=damages(scan.cloud.points, member, member.sigma_m, options.seed))
    return Estimate(member=member, explains=fit.explains, reason=_reason(fit), p_fixed=fit.p_fixed)


def table_of(route: RouteOptions) -> Table | None:
    """The user's table of sections; None for the shipped one. Raises InputError or UsageError for a table that cannot be used."""
    return read_table(Path(route.catalogue)) if route.catalogue else None


def known_section(options: MemberOptions, route: RouteOptions, table: Table | None) -> tuple[MemberOptions, Mapping[str, float]]:
    """The options with the family of the designation, and the dimensions it fixes. Raises UsageError for a designation that names no section."""
    if not route.member:
        return options, {}
    given = parse_designation(route.member, table)
    return replace(options, family=given.family), given.parameters


def _reason(fit: MemberFit) -> str:
    return fit.reason if fit.p_fixed is None else f"{fit.reason}; the dimensions given have a p-value of {fit.p_fixed:.3g}"


def route_of(found: Estimate, mode: str) -> Route:
    """The way to go after estimation was tried."""
    if found.member is not None and (found.explains or mode == ESTIMATION):
        return Route(name="estimation", reason=found.reason)
    return Route(name="reconstruction", reason=f"free form: {found.reason}")
