"""Solid or hollow, by the end faces."""

from dataclasses import replace

import pytest

from estimation.made import made
from scan2fea.estimation.caps import HOLLOW, SOLID, UNKNOWN, full_ends


def guessed(member, inside):
    """The same with a wall that nobody saw."""
    return replace(member, parameters=tuple(replace(p, observable=p.name != "t") for p in member.parameters), inside=inside)


@pytest.mark.parametrize("family", ["RHS", "CHS"])
def test_full_ends_of_a_tube_whose_inside_nobody_saw_deny_it(family) -> None:
    """A bar of 150 x 100 mm with one edge rounded by 40 mm had been converted as a tube with a wall of 5 mm (-84 % of its volume)."""
    assert "end faces" in full_ends(guessed(made(family), SOLID))
    for member in (guessed(made(family), HOLLOW), guessed(made(family), UNKNOWN), replace(made(family), inside=SOLID)):
        assert full_ends(member) == ""
    assert full_ends(replace(made("rect"), inside=SOLID)) == ""
