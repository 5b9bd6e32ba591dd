import numpy as np
import pytest

from scan2fea.errors import EstimationError
from scan2fea.estimation.orientation import alternatives, oriented

L = {"a": 0.127, "b": 0.1, "t": 0.00635}


def placed(angle, x, y):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, x], [s, c, y], [0, 0, 1]])


def seen(T, side, sigma, n=4000, seed=0):
    """Points on the two outer (side -1) or inner (side +1) planes, in the plane, and the sensors that see them; noise along the rays."""
    rng = np.random.default_rng(seed)
    low = 0.0 if side < 0 else L["t"]
    on_a = rng.random(n) < 0.5
    p = np.where(
        on_a[:, None], np.stack([rng.uniform(low, L["a"], n), np.full(n, low)], 1), np.stack([np.full(n, low), rng.uniform(low, L["b"], n)], 1)
    )
    sensors = side * np.array([2.0, 2.2]) + rng.uniform(-0.5, 0.5, (n, 2))
    to = sensors - p
    p = p + sigma * rng.standard_normal(n)[:, None] * to / np.linalg.norm(to, axis=1)[:, None]
    move = lambda x: x @ T[:2, :2].T + T[:2, 2]  # noqa: E731
    return move(p), move(sensors)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("sigma", [0.0, 0.002, 0.02])
def test_the_sensors_tell_convex_from_concave(side, sigma):
    T = placed(0.7, 3.0, -2.0)
    points, sensors = seen(T, side, sigma)
    truth = (L, T)
    for values, start in alternatives("L", *truth):  # whichever of the placements the fit came with
        best = oriented("L", values, start, points, sensors)[0]
        assert np.allclose(best.T_plane_section, T, atol=1e-12)
        assert best.values == pytest.approx(L)


def test_the_steel_of_a_flat_bar_lies_behind_the_plane_that_was_seen():
    bar = {"b": 0.1, "t": 0.01}
    rng = np.random.default_rng(0)
    points = np.stack([rng.uniform(-0.05, 0.05, 500), np.full(500, 0.005)], 1)
    above = np.tile([0.0, 2.0], (500, 1))
    assert np.allclose(oriented("rect", bar, np.eye(3), points, above)[0].T_plane_section, np.eye(3))
    from_below = oriented("rect", bar, np.eye(3), points, -above)[0]
    assert np.allclose(from_below.T_plane_section[:2, 2], [0, 0.01])


def test_alternatives_put_another_face_on_the_same_plane():
    own, grown, shrunk = alternatives("L", L, np.eye(3))
    assert own[0] == L
    assert np.allclose(grown[1][:2, 2] + grown[0]["t"], 0)  # its inner planes are the old outer ones
    assert np.allclose(shrunk[1][:2, 2], L["t"])  # its outer planes are the old inner ones
    assert grown[0]["a"] - grown[0]["t"] == pytest.approx(L["a"]) and shrunk[0]["a"] == pytest.approx(L["a"] - L["t"])
    assert len(alternatives("I", {"h": 0.2, "b": 0.1, "tw": 0.01, "tf": 0.01}, np.eye(3))) == 1


def test_what_cannot_be_told_is_said():
    points, sensors = seen(np.eye(3), -1, 0.001)
    with pytest.raises(EstimationError, match="no sensor position is known"):
        oriented("L", L, np.eye(3), points, np.full_like(sensors, np.nan))
    in_the_plane = np.tile([5.0, 0.005], (100, 1))
    bar = np.stack([np.linspace(-0.05, 0.04, 100), np.full(100, 0.005)], 1)
    with pytest.raises(EstimationError, match=r"only 0% of the points .* check the sensor positions"):
        oriented("rect", {"b": 0.1, "t": 0.01}, np.eye(3), bar, in_the_plane)


def test_input_stays():
    points, sensors = seen(np.eye(3), 1, 0.001)
    before = points.copy(), sensors.copy(), dict(L)
    oriented("L", L, np.eye(3), points, sensors)
    assert np.array_equal(points, before[0]) and np.array_equal(sensors, before[1]) and before[2] == L
