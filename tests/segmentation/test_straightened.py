"""The axis of a long piece, by the columns that its points fill."""

import numpy as np
import pytest

from scan2fea.kernel.transforms import rotation_about
from scan2fea.segmentation.sweeps import straightened

H = 0.02


@pytest.mark.parametrize("degrees", [0.0, 0.8, 1.5])
def test_an_axis_that_is_off_is_turned_back_along_a_beam_and_not_along_a_stub(degrees):
    """A beam of 8.4 m among 12 million points had an axis 0.8 degrees off: both its ends were cut off as places where its section is not there."""
    rng, turn = np.random.default_rng(2), rotation_about((1, 2, 3), 0.7)
    wrong = turn @ rotation_about((1, 0.3, 0), np.radians(degrees)) @ [0.0, 0, 1]
    for length, is_turned in ((8.4, True), (1.0, False)):
        n = int(0.8 * length / H**2)
        side = rng.integers(0, 2, n)
        section = np.where(side[:, None] == 0, np.c_[rng.uniform(-0.1, 0.1, n), np.full(n, 0.15)], np.c_[np.zeros(n), rng.uniform(-0.15, 0.15, n)])
        points = np.c_[section, rng.uniform(0, length, n)] @ turn.T
        off = np.degrees(np.arccos(min(1.0, abs(float(straightened(points, wrong, H) @ turn[:, 2])))))
        assert off < 0.1 if is_turned else off == pytest.approx(degrees, abs=1e-4)
