"""Solid or hollow, by the end faces."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import made, scanned
from scan2fea.estimation.caps import full_ends


def guessed(member):
    """The same with a wall that nobody saw."""
    return replace(member, parameters=tuple(replace(p, observable=p.name != "t") for p in member.parameters))


@pytest.mark.parametrize(("family", "bar"), [("RHS", "rect"), ("CHS", "round")])
def test_full_ends_of_a_tube_deny_it(family, bar) -> None:
    """A bar of 150 x 100 mm with one edge rounded by 40 mm had been converted as a tube with a wall of 5 mm (-84 % of its volume)."""
    member = made(family)
    sizes = {"b": 0.1, "t": 0.06} if family == "RHS" else {"d": member.values()["d"]}
    solid = scanned(made(bar, values=sizes), 6_000, 0.0005, 1)
    solid = solid[:, [1, 0, 2]] if family == "RHS" else solid  # h along y
    assert "end faces" in full_ends(solid, guessed(member))
    assert "end faces" in full_ends(solid, member)  # a wall as deep as a pocket
    below = solid[:, 2] < 0.5
    assert "end faces" in full_ends(solid[below], guessed(member))
    assert full_ends(solid[below], member) == ""  # an end that stands on something
    for one in (member, guessed(member)):
        assert full_ends(scanned(member, 6_000, 0.0005, 1), one) == ""
        assert full_ends(solid[np.abs(solid[:, 2] - 0.5) < 0.49], one) == ""  # no end was seen
    assert full_ends(solid, made("rect")) == ""
