import numpy as np
import pytest

from scan2fea.errors import InputError, UsageError
from scan2fea.estimation.closest_point import _residuals, closest_point
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.simulation.member import MemberScanOptions, member_points

VALUES = {
    "L": {"a": 0.127, "b": 0.127, "t": 0.00635},
    "I": {"h": 0.22, "b": 0.11, "tw": 0.006, "tf": 0.0092},
    "C": {"h": 0.14, "b": 0.06, "tw": 0.007, "tf": 0.01},
    "T": {"h": 0.1, "b": 0.12, "tw": 0.008, "tf": 0.01},
    "RHS": {"h": 0.14, "b": 0.08, "t": 0.006},
    "CHS": {"d": 0.168, "t": 0.01},
    "rect": {"b": 0.1, "t": 0.02},
    "round": {"d": 0.05},
}


def scan(family, n=2_000, **options):
    return member_points(family, {**VALUES[family], "length": 1.0}, n, MemberScanOptions(**options))


@pytest.mark.parametrize("family", list(VALUES))
def test_exact_without_noise(family):
    start = {name: 0.93 * value for name, value in VALUES[family].items()}
    found = closest_point(scan(family), family, start, np.array([0.001, -0.002, 0.02]))
    assert found.converged
    for name, value in VALUES[family].items():
        assert found.values[name] == pytest.approx(value, abs=1e-8)
    assert found.rms_m < 1e-9


@pytest.mark.parametrize("family", list(VALUES))
def test_derivatives(family):
    xy = scan(family, 300, noise_m=0.003, seed=1)[:, :2]
    theta = np.array([*VALUES[family].values(), 0.001, -0.002, 0.1])
    distance, slope = _residuals(xy, None, family, theta, 0.5)
    step = 1e-7
    for k in range(len(theta)):
        change = np.zeros(len(theta))
        change[k] = step
        ahead, behind = (_residuals(xy, None, family, theta + sign * change, 0.5)[0] for sign in (1, -1))
        same = np.abs(ahead - behind) < 4 * step  # where no other face has become the nearest
        assert same.mean() > 0.95
        assert np.allclose(((ahead - behind) / (2 * step))[same], slope[same, k], atol=2e-5)
    assert (np.abs(distance) < 0.02).all()


def test_it_is_biased_where_the_noise_is_as_thick_as_the_wall():
    """shape-estimation.md, finding 1: legs come out 13 to 23 mm long and walls 5 mm thick at 6.7 mm of noise."""
    start = {name: 0.9 * value for name, value in VALUES["L"].items()}
    found = closest_point(scan("L", 3_000, noise_m=0.0067, seed=1), "L", start)
    assert 0.005 < found.values["a"] - 0.127 < 0.03
    assert 0.003 < found.values["t"] - 0.00635 < 0.008


def test_normals_keep_points_on_their_own_side():
    rng = np.random.default_rng(0)
    points = scan("rect", 4_000, faces=("TOP", "BOTTOM", "LEFT", "RIGHT"))
    top, bottom = np.abs(points[:, 1] - 0.01) < 1e-12, np.abs(points[:, 1] + 0.01) < 1e-12
    normals = np.zeros_like(points)
    normals[:, 0] = np.sign(points[:, 0])
    normals[top], normals[bottom] = [0, 1, 0], [0, -1, 0]
    noisy = points + 0.012 * rng.standard_normal(points.shape)
    start = {"b": 0.09, "t": 0.018}
    with_normals = closest_point(noisy, "rect", start, normals=normals).values["t"]
    without = closest_point(noisy, "rect", start).values["t"]
    assert abs(with_normals - 0.02) < 0.001
    assert abs(with_normals - 0.02) < abs(without - 0.02)


def test_bad_input():
    points = scan("L", 60)
    with pytest.raises(UsageError, match="family"):
        closest_point(points, "Z", {})
    with pytest.raises(InputError, match="at least 50"):
        closest_point(points[:49], "L", VALUES["L"])
    with pytest.raises(UsageError, match="no section to start from"):
        closest_point(points, "L", {"a": 0.1, "b": 0.1, "t": 0.2})
    assert closest_point(points[:50], "L", VALUES["L"]).slabs.shape == (1, len(PARAMETERS["L"]))
