"""What can be no member is told before the search; what may be one never is."""

import numpy as np
import pytest

from predicates import rotation
from scan2fea.errors import EstimationError
from scan2fea.estimation.axis import axes_of
from scan2fea.estimation.member import fit_member
from scan2fea.estimation.prismatic import dimension, is_prismatic
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan

SECTIONS = {
    "L": {"a": 0.1, "b": 0.08, "t": 0.008}, "I": {"h": 0.2, "b": 0.1, "tw": 0.006, "tf": 0.009}, "RHS": {"h": 0.1, "b": 0.06, "t": 0.005},
    "CHS": {"d": 0.1, "t": 0.005}, "rect": {"b": 0.1, "t": 0.02}, "round": {"d": 0.08},
}  # fmt: skip


def sphere(n=4000, sigma=0.0005):
    p = np.random.default_rng(2).standard_normal((n, 3))
    return p / np.linalg.norm(p, axis=1, keepdims=True) * (0.2 + sigma * np.random.default_rng(3).standard_normal((n, 1)))


def test_dimension_of_a_line_and_of_an_area():
    rng = np.random.default_rng(0)
    ring = np.exp(2j * np.pi * rng.random(6000))
    assert dimension(np.c_[ring.real, ring.imag], 2.0) == pytest.approx(1.0, abs=0.05)
    assert dimension(rng.random((6000, 2)), 1.4) == pytest.approx(2.0, abs=0.1)
    assert dimension(1000 * rng.random((6000, 2)), 1400.0) == pytest.approx(2.0, abs=0.1)


def test_a_sphere_is_refused_at_once_and_says_why():
    assert not is_prismatic(sphere(), axes_of(sphere()))
    with pytest.raises(EstimationError, match="along no axis do the points lie on the outline of a section"):
        fit_member(Scan(cloud=PointCloud.of(sphere())))


@pytest.mark.parametrize("clutter", [0.0, 0.28])
@pytest.mark.parametrize("family", SECTIONS)
def test_members_pass_long_and_short_with_clutter(family, clutter):
    for length in (0.15, 1.5):
        values = {**SECTIONS[family], "length": length}
        for sigma in (0.0, 0.0008):
            points = member_points(family, values, 5000, MemberScanOptions(noise_m=sigma, seed=1, clutter=clutter, caps=True)) @ rotation(4).T
            assert is_prismatic(points, axes_of(points)), (length, sigma)


def test_tapers_and_wide_noise_are_left_to_the_fit():
    rng = np.random.default_rng(1)
    z, t = rng.random(5000), 2 * np.pi * rng.random(5000)
    r = 0.1 + 0.05 * z
    cone = np.c_[r * np.cos(t), r * np.sin(t), 2 * z]
    assert is_prismatic(cone, axes_of(cone))
    wide = sphere(sigma=0.03)
    assert is_prismatic(wide, axes_of(wide))
