import numpy as np
import pytest
from scipy.spatial import cKDTree

from scan2fea.verification.tellable import smallest_hole_m

H, SIDE = 0.005, 0.3


def widest_empty(seed):
    """Diameter of the widest circle that both faces of a square wall leave empty, its middle on a fine grid clear of the border."""
    rng = np.random.default_rng(seed)
    at = np.arange(4 * H, SIDE - 4 * H, 0.2 * H)
    middle = np.stack(np.meshgrid(at, at), -1).reshape(-1, 2)
    clear = [cKDTree(rng.uniform(0, SIDE, (int((SIDE / H) ** 2), 2))).query(middle)[0] for _ in range(2)]
    return 2 * float(np.minimum(*clear).max())


def test_chance_leaves_no_such_hole_and_nearly_does():
    limit = smallest_hole_m(2 * SIDE**2, H, float("nan"))
    widest = np.array([widest_empty(seed) for seed in range(30)])
    assert widest.max() < limit < 1.4 * np.median(widest)


def test_noise_and_size_widen_it():
    assert smallest_hole_m(0.1, H, 0.001) == pytest.approx(smallest_hole_m(0.1, H, 0.0) + 0.002)
    assert smallest_hole_m(0.2, H, 0.0) > smallest_hole_m(0.1, H, 0.0)
    assert smallest_hole_m(0.4, 2 * H, 0.002) == pytest.approx(2 * smallest_hole_m(0.1, H, 0.001))
