"""Do the points deny what the user said of a member? Then building with it would be a solid of something else."""

from __future__ import annotations

from scan2fea.types import Check
from scan2fea.verification.limits import at_most


def given_checks(n_contradicted: int) -> tuple[Check, ...]:
    """n_contradicted : dimensions that were held though the points deny them, beyond chance and beyond mill tolerance."""
    return (at_most("member.contradicted", n_contradicted),)
