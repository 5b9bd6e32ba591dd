import numpy as np
import pytest

from scan2fea.kernel.polylines import evenly, length_of


@pytest.mark.parametrize("dimensions", [2, 3])
def test_points_lie_at_even_steps_along_the_line_in_any_dimension(dimensions):
    line = np.zeros((4, dimensions))
    line[:, 0], line[:, 1] = [0.0, 1.0, 1.0, 4.0], [0.0, 0.0, 2.0, 2.0]  # 1 along, 2 up, 3 along
    assert length_of(line) == pytest.approx(6.0)
    found = evenly(line, 7)
    want = np.zeros((7, dimensions))
    want[:, 0], want[:, 1] = [0, 1, 1, 1, 2, 3, 4], [0, 0, 1, 2, 2, 2, 2]
    assert found == pytest.approx(want)
