"""A fitted member with what the catalogue says: its posterior, and stand-ins for dimensions that the data do not tell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from scan2fea.errors import EstimationError, UsageError
from scan2fea.estimation.anneal import walls
from scan2fea.estimation.catalogue import OTHER, PriorThickness, posterior, prior_thickness, standard_odds
from scan2fea.estimation.table import Table, shipped_table
from scan2fea.kernel.pinned import SEEN, pinned
from scan2fea.kernel.section_likelihood import face_lengths, faces
from scan2fea.kernel.sections import PARAMETERS, check_section
from scan2fea.types import CatalogueEntry, Member, Parameter

CATALOGUE, ESTIMATED = "catalogue", "estimate"
_WITHIN = 3.0  # standard deviations of the noise, by which the points may reach beyond an edge
OFFSET = 1.0  # of the noise: what sensors state as their accuracy is one to three times their scatter, and no number of points cures it
LAW_KURTOSIS = 0.6 / math.sqrt(12)  # standard deviation of what the likeliest law is off by: box, rounded box and Gauss lie 0.5 to 0.7 apart


def catalogued(member: Member, table: Table | None = None) -> Member:
    """The member with `catalogue` filled; dimensions of the section that are not observable take the value of the size nearest to what the points
    make likely of them (`Parameter.spread_m`), or that estimate itself; one entry names which.

    Observed dimensions then are those estimated at the assumed ones. What the user fixed stays. A table without sizes of the family leaves the values
    as they are. Raises UsageError where no dimension of the section was observed, EstimationError where no size of the table goes with those.
    """
    names = PARAMETERS[member.family]
    rows = [k for k, p in enumerate(member.parameters) if p.name in names]
    values = {member.parameters[k].name: member.parameters[k].value_m for k in rows}
    known = {member.parameters[k].name: member.parameters[k].observable or member.parameters[k].source == "fixed" for k in rows}
    covariance = np.asarray(member.covariance, float)[np.ix_(rows, rows)]
    sizes = shipped_table() if table is None else table
    entries = posterior(member.family, values, covariance, known, sizes, OFFSET * member.sigma_m)
    if all(known.values()) or not sizes.of(member.family):
        return replace(member, catalogue=entries)
    with_guess = covariance.copy()
    for i, k in enumerate(rows):
        if not known[member.parameters[k].name]:
            with_guess[i, i] = (member.parameters[k].spread_m or 0.0) ** 2
    prior = prior_thickness(member.family, values, with_guess, known, sizes, _reaches(member, values, known))
    built = _built_with(member, prior, known)
    built = replace(built, parameters=tuple(map(partial(_under_any_law, member), built.parameters, member.parameters)))
    try:
        check_section(built.family, built.values())
    except UsageError as error:
        says = f"no size of the table goes with what was seen of the {member.family} member ({prior.name} would be: {error})"
        raise EstimationError(says) from error
    return replace(built, catalogue=_with_prior(entries, prior))


def _reaches(member: Member, values: Mapping[str, float], known: Mapping[str, bool]) -> dict[str, float]:
    """Hidden outer dimension -> how far the points reach along it at least, m, where a face that spans it was seen."""
    names = PARAMETERS[member.family]
    seen = np.array([member.seen.get(name, 0.0) >= SEEN for name in faces(member.family)])
    outer = [name for name in names if name not in walls(member.family) and not known[name]]
    spanned = [name for name in outer if (seen & (face_lengths(member.family, np.eye(len(names))[names.index(name)]) > 0)).any()]
    return {name: values[name] - _WITHIN * member.sigma_m for name in spanned}


def with_standard_odds(member: Member, alternatives: Mapping[str, Mapping[str, float]], table: Table | None = None) -> Member:
    """The member whose families' posterior knows which outer dimensions are standard: an angle of 5 x 5 in is likelier than a bar of that size.

    Only where a wall is not observable, since then families look alike.   alternatives : family -> dimensions of its best fit, metres.
    """
    told = [p.std_m for p in member.parameters if p.observable and p.std_m is not None and p.name in PARAMETERS[member.family]]
    if all(p.observable for p in member.parameters) or not told:
        return member
    odds = {family: standard_odds(family, values, max(told), table) for family, values in alternatives.items() if member.families.get(family, 0) > 0}
    weight = {family: p * odds.get(family, 1.0) for family, p in member.families.items()}
    total = sum(weight.values())
    return replace(member, families={family: w / total for family, w in sorted(weight.items(), key=lambda item: -item[1])})


def _built_with(member: Member, prior: PriorThickness, known: dict[str, bool]) -> Member:
    parameters = tuple(_moved(p, prior, known) for p in member.parameters)
    covariance = np.array(member.covariance, float)
    hidden = [k for k, p in enumerate(parameters) if not known.get(p.name, True)]
    for k, p in enumerate(parameters):  # conditional standard deviations; correlations stay
        if k not in hidden and p.std_m is not None and covariance[k, k] > 0:
            shrink = p.std_m / np.sqrt(covariance[k, k])
            covariance[k] *= shrink
            covariance[:, k] *= shrink
    covariance[hidden], covariance[:, hidden] = 0.0, 0.0
    return replace(member, parameters=parameters, covariance=covariance)


def _moved(p: Parameter, prior: PriorThickness, known: dict[str, bool]) -> Parameter:
    if p.name not in known or p.source == "fixed":
        return p
    if not known[p.name]:
        source = ESTIMATED if p.name in prior.estimated else CATALOGUE
        return replace(p, value_m=prior.values[p.name], std_m=None, source=source, spread_m=prior.std_m[p.name])
    return replace(p, value_m=prior.values[p.name], std_m=p.std_m if p.std_m is None else min(p.std_m, prior.std_m[p.name]))


def _under_any_law(member: Member, built: Parameter, estimate: Parameter) -> Parameter:
    """An assumed wall with a spread that holds for laws of noise between those that were tried, too; other dimensions as they are.

    Two faces that were seen under noise are one hump, told from one face by its kurtosis -t^4 / 8 v^2, v = sigma^2 + t^2 / 4 its variance. A law
    that is off by d in kurtosis moves t^4 by 8 d v^2. Which size is built follows the likelihood; how far it may be off also follows this.
    """
    seen = [name for name, share in member.seen.items() if share >= SEEN]
    by_faces = estimate.spread_m is not None and built.name in walls(member.family) and built.name in pinned(member.family, seen)
    if built.spread_m is None or not by_faces:
        return built
    t4, moved = estimate.value_m**4, 8 * LAW_KURTOSIS * (member.sigma_m**2 + estimate.value_m**2 / 4) ** 2
    law = ((t4 + moved) ** 0.25 - max(t4 - moved, 0.0) ** 0.25) / 2
    return replace(built, spread_m=max(built.spread_m, math.hypot(law, built.value_m - estimate.value_m)))


def _with_prior(entries: tuple[CatalogueEntry, ...], prior: PriorThickness) -> tuple[CatalogueEntry, ...]:
    """One entry says what the member is built with: the size itself, or "no size of the table" with the size that was scaled or the estimate."""
    if any(entry.name == prior.name for entry in entries):
        return entries
    told = {entry.name: entry for entry in entries}
    scaled = replace(told[OTHER], name=f"{OTHER}: {prior.name}", parameters=prior.values)
    return tuple(scaled if entry.name == OTHER else entry for entry in entries)
