"""Is a STEP file one closed, valid solid? Its figures come from whoever read it."""

from __future__ import annotations

from scan2fea.types import Check
from scan2fea.verification.limits import above, at_most, holds


def step_checks(n_solids: int, is_valid: bool, n_free_edges: int, volume_m3: float) -> tuple[Check, ...]:
    """One solid, valid, closed, outward."""
    return (
        holds("step.solids", n_solids == 1, float(n_solids), 1.0),
        holds("step.valid", is_valid, "valid" if is_valid else "not valid"),
        at_most("step.free_edges", n_free_edges),
        above("step.volume", volume_m3),
    )
