"""A member that another object goes on with does not end there."""

import numpy as np
import pytest

from estimation.made import made, scanned
from scan2fea.estimation.going_on import going_on

SIGMA = 1e-3


@pytest.mark.parametrize("family", ["I", "RHS", "CHS", "L", "rect"])
def test_another_object_with_the_same_section_behind_an_end_is_the_same_member(family):
    member = made(family, sigma=SIGMA)
    own = scanned(member, 40_000, SIGMA, 0)
    for shift in (1.0, -1.0, 1.002):
        assert "goes on with the same section" in going_on(own, member, [scanned(member, 40_000, SIGMA, 1) + [0, 0, shift]])
    assert going_on(own, member, [scanned(member, 40_000, SIGMA, 1) + [0, 0, 1.1]]) == ""  # another member, past a gap


@pytest.mark.parametrize("family", ["I", "RHS", "CHS", "L"])
def test_what_an_end_touches_is_another_object(family):
    member = made(family, sigma=SIGMA)
    own, rng = scanned(member, 40_000, SIGMA, 0), np.random.default_rng(3)
    for at in (1.0, 1.002, 1.008):  # a flange, or an end plate
        plane = np.stack([*rng.uniform(-0.15, 0.15, (2, 40_000)), at + SIGMA * rng.standard_normal(40_000)], 1)
        assert going_on(own, member, [plane]) == ""
    turn, along = rng.uniform(0, 2 * np.pi, 60_000), rng.uniform(-0.2, 0.2, 60_000)
    off = 0.15 + SIGMA * rng.standard_normal(60_000)
    chord = np.stack([along, off * np.cos(turn), 1.13 + off * np.sin(turn)], 1)
    assert going_on(own, member, [chord]) == ""
