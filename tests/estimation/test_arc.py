import numpy as np
import pytest

from scan2fea.estimation.arc import Arc, seen_arc
from scan2fea.estimation.fit import FitOptions, fit_section

R = 0.02125


def arc_points(n, low, high, sigma, seed, wall=None):
    rng = np.random.default_rng(seed)
    radius = np.where(rng.random(n) < 0.45, R - wall, R) if wall else np.full(n, R)
    turn = np.radians(rng.uniform(low, high, n))
    points = np.c_[radius * np.cos(turn), radius * np.sin(turn), rng.uniform(0, 0.3, n)]
    return points + rng.normal(0, sigma, (n, 3))


def seen(points, centre=(0.0, 0.0)):
    return seen_arc(points[:, :2] - centre, np.array([R]), 0.001, np.array(centre))


def test_gaps_lie_where_no_points_are_wherever_zero_degrees_is():
    for low, high in ((0, 180), (-90, 90), (100, 400), (200, 380)):
        arc = seen(arc_points(4_000, low, high, 2e-4, 1))
        assert arc.gaps.shape == (1, 2, 2)
        at = np.degrees(np.arctan2(arc.gaps[0, :, 1], arc.gaps[0, :, 0]))
        assert np.abs((at - [high, low] + 180) % 360 - 180).max() < 3.0
        assert arc.log_share(np.zeros(2))[0] == pytest.approx(np.log(360 / (high - low)), abs=0.05)
    assert seen(arc_points(4_000, 0, 360, 2e-4, 1)) is None
    assert seen(arc_points(100, 0, 180, 2e-4, 1)) is None
    two = np.r_[arc_points(2_000, 0, 100, 2e-4, 1), arc_points(2_000, 150, 300, 2e-4, 2)]
    assert len(seen(two).gaps) == 2
    stray = np.random.default_rng(3).uniform(-2 * R, 2 * R, (400, 2))
    assert seen(np.r_[arc_points(4_000, 0, 180, 2e-4, 1)[:, :2], stray]).gaps.shape == (1, 2, 2)


def test_the_slope_is_that_of_the_share():
    arc = Arc(gaps=R * np.array([[[0.0, 1.0], [-1.0, 0.2]], [[-0.6, -0.8], [0.1, -1.0]]]))
    at, step = np.array([0.002, -0.001]), 1e-8
    slope = arc.log_share(at)[1]
    for axis in np.eye(2):
        assert slope @ axis == pytest.approx((arc.log_share(at + step * axis)[0] - arc.log_share(at - step * axis)[0]) / (2 * step), rel=1e-5)


@pytest.mark.parametrize(("family", "wall"), [("round", None), ("CHS", 0.005)])
@pytest.mark.parametrize(("low", "high"), [(0, 180), (20, 300)])
def test_a_part_of_a_circle_is_as_wide_as_the_whole(family, wall, low, high):
    z = []
    for seed in range(4):
        fit = fit_section(arc_points(4_000, low, high, 0.001, seed, wall), FitOptions(families=(family,), noise="gaussian"))
        z.append((fit.value("d") - 2 * R) / fit.std[0])
    # taken for a whole circle the half is 7 standard deviations too small
    assert np.abs(z).max() < 3.5 and abs(np.mean(z)) < 1.7
