"""Is the solver's answer one? Equilibrium, energy, six rigid-body modes, and figures that a real part can have."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from scan2fea.types import CaseField, CaseResult, Check, FEModel, FEResult
from scan2fea.verification.limits import above, at_most, holds


def _error(result: FEResult, name: str, measure: str) -> float:
    found = next((c.relative_error for c in result.cases if (c.name, c.measure) == (name, measure)), None)
    return math.nan if found is None else found


def response_checks(model: FEModel, result: FEResult, *, is_prism: bool = True) -> tuple[Check, ...]:
    """The checks `response.*` of limits.toml; every figure is taken from the result and the model, nothing is solved again.

    Equilibrium, energy and residual of the worst case. A figure that is missing or not a number fails. Modes: with f in rising order, |f1| ... |f6|
    must lie below 1e-3 f7. A mesh in two pieces has twelve such modes: then f7 is zero and `response.elastic_mode` fails. Members: where a figure
    stands beside that of beam theory, see `member_response_checks`; not where holes make the solid another body than the prism (is_prism).
    """
    frequencies = result.frequencies_hz
    rigid = float(np.abs(frequencies[:6]).max()) if len(frequencies) > 6 else math.nan
    first = float(frequencies[6]) if len(frequencies) > 6 else math.nan
    extent = float(np.ptp(model.mesh.nodes, axis=0).max())
    largest = float(np.linalg.norm(result.displacement_m, axis=1).max())
    # the lowest elastic mode of a solid of this size cannot be faster than a compression wave across it there and back
    fastest = math.sqrt(model.material.youngs_pa / model.material.density_kg_m3) / float(np.ptp(model.mesh.nodes, axis=0).min())
    return (
        at_most("response.reaction", max((_unbalanced(field) for field in result.fields), key=_worst, default=math.nan)),
        at_most("response.weight", _error(result, "self_weight", "reaction_n")),
        at_most("response.energy", _worst_of(result, "strain_energy_j", lambda case: case.relative_error)),
        at_most("response.residual", _worst_of(result, "residual", lambda case: case.value, skip="modal")),
        at_most("response.rigid_modes", rigid / first if first > 0 else math.inf),
        holds("response.elastic_mode", math.isfinite(first) and rigid < first < fastest, first, fastest),
        at_most("response.displacement", largest / extent),
        above("response.moves", largest),
        *_calculix(result),
        *(member_response_checks(result) if is_prism else ()),
    )


def _calculix(result: FEResult) -> tuple[Check, ...]:
    """Where it was asked: its loads on curved elements are summed at 4 points, ours at 14, 5e-4 of what a plate with holes moves."""
    found = [c.value for c in result.cases if c.measure == "calculix_difference"]
    return (at_most("response.calculix", max(found, key=_worst)),) if found else ()


MEMBER_CHECKS = (
    ("response.member_deflection", ("tension", "bend_x", "bend_y"), ("tip_x_m", "tip_y_m", "tip_z_m")),
    ("response.member_twist", ("torsion", "bend_x", "bend_y"), ("twist_rad",)),
    ("response.member_frequency", ("modal",), ("f7_hz",)),
)


def member_response_checks(result: FEResult) -> tuple[Check, ...]:
    """Of a slender member: how far the solid's answers leave those of beam theory. None where nothing was compared.

    Buckling is told but not checked: thin walls may buckle by themselves before the member does.
    """
    checks = []
    for name, cases, measures in MEMBER_CHECKS:
        found = [c.relative_error for c in result.cases if c.name in cases and c.measure in measures and c.expected is not None]
        if found:
            checks.append(at_most(name, max((math.nan if e is None else e for e in found), key=_worst)))
    return tuple(checks)


def _unbalanced(field: CaseField) -> float:
    """What the supports carry more or less than the loads, over the size of the loads."""
    return float(np.linalg.norm(field.applied_n + field.reaction_n)) / field.load_n if field.load_n > 0 else math.nan


def _worst(value: float) -> float:
    """Order in which not a number is the worst."""
    return math.inf if math.isnan(value) else value


def _worst_of(result: FEResult, measure: str, figure: Callable[[CaseResult], float | None], skip: str = "") -> float:
    found = [figure(c) for c in result.cases if c.measure == measure and c.name != skip]
    return max((math.nan if x is None else x for x in found), key=_worst, default=math.nan)
