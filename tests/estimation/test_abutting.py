"""An end that another object touches is known to where that one is."""

import math

import numpy as np
import pytest

from estimation.made import made
from scan2fea.estimation.resting import abutting


def test_the_length_of_a_column_under_a_beam_is_known_to_the_beams_flange():
    """Columns of 2.6 m under narrower beams had been told as 2594.9 +- 0.4 mm."""
    column, rng = made("I", sigma=0.001), np.random.default_rng(1)
    flange = np.stack([rng.uniform(-0.5, 0.5, 4000), rng.uniform(-0.04, 0.04, 4000), 1.005 + 0.001 * rng.standard_normal(4000)], 1)
    got = abutting(column, 0.004, [flange], (True, True))
    assert got.values() == column.values()
    assert got.parameters[-1].std_m == pytest.approx(0.005 / math.sqrt(3), rel=0.05)
    assert got.covariance[-1, -1] == pytest.approx(got.parameters[-1].std_m ** 2)
    assert abutting(column, 0.004, [flange], (True, False)) is column  # its face there was seen
    for covers in ([flange + [0, 0, 0.1]], [flange + [0, 0.5, 0]], []):
        assert abutting(column, 0.004, covers, (True, True)) is column
