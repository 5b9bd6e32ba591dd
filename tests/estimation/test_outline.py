"""Distances to sections in closed form against their polygons, and their signs."""

import numpy as np
import pytest

from scan2fea.estimation.outline import outline_distance, section_distance
from scan2fea.kernel.sections import PARAMETERS, section

SIZES = {"h": 0.2, "b": 0.1, "a": 0.12, "d": 0.15, "t": 0.01, "tw": 0.006, "tf": 0.009}


@pytest.mark.parametrize("family", PARAMETERS)
def test_distance_is_that_of_the_polygon(family):
    values = {name: SIZES[name] for name in PARAMETERS[family]}
    xy = np.random.default_rng(3).uniform(-0.25, 0.25, (4_000, 2))
    fine = section(family, values, 5_000)
    assert section_distance(family, values, xy) == pytest.approx(outline_distance(fine, xy)[0], abs=1e-7)


@pytest.mark.parametrize("family", ["CHS", "RHS", "round", "L"])
def test_filled_section_has_no_opening(family):
    values = {name: SIZES[name] for name in PARAMETERS[family]}
    xy = np.random.default_rng(4).uniform(-0.25, 0.25, (1_000, 2))
    own, filled = section_distance(family, values, xy), section_distance(family, values, xy, filled=True)
    assert (filled <= own).all() and np.array_equal(filled[filled > 0], own[filled > 0])
    assert (section_distance(family, values, np.zeros((1, 2)), filled=True)[0] < -0.04) == (family != "L")
