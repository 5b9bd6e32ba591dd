"""Is the solver's answer one? Equilibrium, energy, six rigid-body modes, and figures that a real part can have."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.types import Check, FEModel, FEResult
from scan2fea.verification.limits import above, at_most, holds


def _value(result: FEResult, name: str, measure: str) -> float:
    """The figure of a case, nan where the solver gave none."""
    return next((c.value for c in result.cases if (c.name, c.measure) == (name, measure)), math.nan)


def _error(result: FEResult, name: str, measure: str) -> float:
    found = next((c.relative_error for c in result.cases if (c.name, c.measure) == (name, measure)), None)
    return math.nan if found is None else found


def response_checks(model: FEModel, result: FEResult) -> tuple[Check, ...]:
    """The checks `response.*` of limits.toml; every figure is taken from the result and the model, nothing is solved again.

    A figure that is missing or not a number fails. Modes: with f in rising order, |f1| ... |f6| must lie below 1e-3 f7. A mesh in
    two pieces has twelve such modes: then f7 is zero and `response.elastic_mode` fails.
    """
    applied, reaction = result.applied_n, result.reaction_n
    size = float(np.linalg.norm(applied))
    unbalanced = float(np.linalg.norm(applied + reaction)) / size if size > 0 else math.nan
    frequencies = result.frequencies_hz
    rigid = float(np.abs(frequencies[:6]).max()) if len(frequencies) > 6 else math.nan
    first = float(frequencies[6]) if len(frequencies) > 6 else math.nan
    extent = float(np.ptp(model.mesh.nodes, axis=0).max())
    largest = float(np.linalg.norm(result.displacement_m, axis=1).max())
    # the lowest elastic mode of a solid of this size cannot be faster than a compression wave across it there and back
    fastest = math.sqrt(model.material.youngs_pa / model.material.density_kg_m3) / float(np.ptp(model.mesh.nodes, axis=0).min())
    return (
        at_most("response.reaction", unbalanced),
        at_most("response.weight", _error(result, "self_weight", "reaction_n")),
        at_most("response.energy", _error(result, "self_weight", "strain_energy_j")),
        at_most("response.residual", _value(result, "self_weight", "residual")),
        at_most("response.rigid_modes", rigid / first if first > 0 else math.inf),
        holds("response.elastic_mode", math.isfinite(first) and rigid < first < fastest, first, fastest),
        at_most("response.displacement", largest / extent),
        above("response.moves", largest),
    )
