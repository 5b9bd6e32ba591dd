import numpy as np
import pytest
from scipy.spatial import cKDTree

from scan2fea.estimation.holes import occupied
from scan2fea.estimation.outline import edge_lengths
from scan2fea.kernel.sections import section
from scan2fea.verification.tellable import smallest_hole_m, smallest_hole_of_member_m

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


def test_a_face_alone_shows_holes_from_the_size_that_is_told_on():
    """A bar's side of 0.2 x 1 m without the points of a circle, which lies anywhere on it."""
    shape, h = section("rect", {"b": 0.2, "t": 0.05}), 0.008
    told, wide = smallest_hole_of_member_m(0.5, h, 0.0, both_sides=False), int(np.argmax(edge_lengths(shape)))
    assert told > 1.5 * smallest_hole_of_member_m(0.5, h, 0.0, both_sides=True)
    found = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        edge = rng.choice(4, int(0.5 / h**2), p=edge_lengths(shape) / 0.5)
        along, z = rng.uniform(0, edge_lengths(shape)[edge]), rng.uniform(0, 1.0, len(edge))
        middle = rng.uniform([0.07, 0.2], [0.13, 0.8])
        for size in (told, 0.4 * told):
            left = (edge != wide) | (np.hypot(along - middle[0], z - middle[1]) > size / 2)
            found.append(len(occupied(shape, edge[left], along[left], z[left], 1.0, 0.0)[1]))
    assert sum(found[::2]) >= 27
    assert not any(found[1::2])
