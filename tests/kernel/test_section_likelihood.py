"""The density of a section, its score and its information."""

import numpy as np
import pytest

from scan2fea.errors import UsageError
from scan2fea.kernel.noise_kernels import KERNELS, kernel_at, kernel_parts
from scan2fea.kernel.section_likelihood import _quadrature, face_lengths, faces, information, is_section, lines_of, log_density
from scan2fea.kernel.sections import PARAMETERS, ROUND, section

VALUES = {
    "L": (0.127, 0.1, 0.00635),
    "I": (0.2, 0.1, 0.006, 0.01),
    "C": (0.2, 0.08, 0.006, 0.01),
    "T": (0.1, 0.09, 0.006, 0.01),
    "RHS": (0.14, 0.08, 0.006),
    "CHS": (0.1, 0.006),
    "rect": (0.1, 0.02),
    "round": (0.05,),
}


def outline(family, values, n, weight=None):
    """Places evenly along the outline and what each stands for, by brute force over the polygons of kernel.sections."""
    shape = section(family, dict(zip(PARAMETERS[family], values, strict=True)), 4000)
    places, lengths = [], []
    for loop, names in zip(shape.loops, shape.face_names, strict=True):
        step = np.roll(loop, -1, axis=0) - loop
        k = max(2, n // len(loop))
        along = (np.arange(k) + 0.5) / k
        for a, d, name in zip(loop, step, names, strict=True):
            places.append(a + along[:, None] * d)
            share = 1.0 if weight is None else weight[faces(family).index(name)]
            lengths.append(np.full(k, np.hypot(*d) / k * share))
    mass = np.concatenate(lengths)
    return np.concatenate(places), mass / mass.sum()


@pytest.mark.parametrize("family", VALUES)
def test_equals_brute_force(family):
    """The convolution, summed over small pieces of the outline."""
    sigma, values = 0.004, np.array(VALUES[family])
    rng = np.random.default_rng(1)
    weight = rng.uniform(0.3, 2, len(faces(family)))
    places, mass = outline(family, values, 8000, weight)
    points = places[rng.integers(len(places), size=40)] + rng.normal(0, 1.5 * sigma, (40, 2))
    squared = ((points[:, None] - places[None]) ** 2).sum(2)
    expected = (np.exp(-squared / (2 * sigma**2)) @ mass) / (2 * np.pi * sigma**2)
    got = log_density(points, family, values, sigma, face_weight=weight).logp
    assert np.abs(got - np.log(expected)).max() < 1e-4


@pytest.mark.parametrize("noise", KERNELS)
@pytest.mark.parametrize("family", VALUES)
def test_integrates_to_one(family, noise):
    values = np.array(VALUES[family])
    points, area = _quadrature(family, values, 0.004)
    density = log_density(points, family, values, 0.004, noise)
    assert abs(np.exp(density.logp) @ area - 1) < 3e-4  # the box's edges are sharper than the panels; the Gaussian is exact:
    if noise == "gaussian":
        assert abs(np.exp(density.logp) @ area - 1) < 1e-11


@pytest.mark.parametrize("noise", KERNELS)
@pytest.mark.parametrize("family", VALUES)
def test_score_is_the_derivative(family, noise):
    rng = np.random.default_rng(2)
    values, sigma, h = np.array(VALUES[family]), 0.005, 1e-7
    weight = rng.uniform(0.5, 2, len(faces(family)))
    places, _ = outline(family, values, 500)
    points = places[rng.integers(len(places), size=60)] + rng.normal(0, sigma, (60, 2))

    def logp(p=points, v=values, s=sigma, w=weight):
        return log_density(p, family, v, s, noise, w).logp

    d = log_density(points, family, values, sigma, noise, weight)
    for j in range(len(values)):
        step = np.eye(len(values))[j] * h
        numeric = (logp(v=values + step) - logp(v=values - step)) / (2 * h)
        assert np.abs(numeric - d.d_values[:, j]).max() < 1e-3 / sigma
    for j in range(2):
        step = np.eye(2)[j] * h
        numeric = (logp(p=points + step) - logp(p=points - step)) / (2 * h)
        assert np.abs(numeric - d.d_point[:, j]).max() < 1e-3 / sigma
    numeric = (logp(s=sigma * np.exp(1e-5)) - logp(s=sigma * np.exp(-1e-5))) / 2e-5
    assert np.abs(numeric - d.d_log_sigma).max() < 1e-3
    for k in range(len(weight)):
        up, down = weight.copy(), weight.copy()
        up[k] *= np.exp(1e-5)
        down[k] *= np.exp(-1e-5)
        assert np.abs((logp(w=up) - logp(w=down)) / 2e-5 - d.d_log_weight[:, k]).max() < 1e-5


@pytest.mark.parametrize("family", VALUES)
def test_expected_score_is_zero(family):
    values = np.array(VALUES[family])
    points, area = _quadrature(family, values, 0.003)
    d = log_density(points, family, values, 0.003)
    mass = np.exp(d.logp) * area
    assert np.abs(mass @ d.d_values).max() < 1e-8 / 0.003
    assert abs(mass @ d.d_log_sigma) < 1e-8


# shape-estimation.md, "Limit": sd in mm at 3,000 points: leg, t, t with sigma known, leg with free face weights
TABLE = [
    ((0.127, 0.127, 0.00635), 0.0005, 0.087, 0.018, 0.018, 0.088),
    ((0.127, 0.127, 0.00635), 0.002, 0.36, 0.078, 0.076, 0.46),
    ((0.127, 0.127, 0.00635), 0.0067, 0.90, 1.07, 0.43, 3.2),
    ((0.127, 0.127, 0.00635), 0.010, 1.19, 2.19, 0.85, 6.6),
    ((0.127, 0.127, 0.00635), 0.020, 1.98, 6.25, 3.0, 22.0),
    ((0.254, 0.254, 0.127), 0.0005, 0.033, 0.022, 0.022, None),
    ((0.254, 0.254, 0.127), 0.002, 0.13, 0.089, 0.089, None),
    ((0.254, 0.254, 0.127), 0.0067, 0.45, 0.30, 0.30, None),
    ((0.254, 0.254, 0.127), 0.020, 1.44, 0.89, 0.89, None),
]


@pytest.mark.parametrize("row", TABLE)
def test_the_published_bound(row):
    values, sigma, leg, t, t_known, leg_free = row
    found = information("L", np.array(values), sigma)
    sd, known = found.sd(3000), found.sd(3000, known=("log_sigma",))
    assert [sd["a"] * 1e3, sd["b"] * 1e3, sd["t"] * 1e3, known["t"] * 1e3] == pytest.approx([leg, leg, t, t_known], rel=0.03)
    assert found.sd(200_000)["a"] == pytest.approx(sd["a"] * (3 / 200) ** 0.5)
    if leg_free is not None:
        free = information("L", np.array(values), sigma, free_weights=True).sd(3000)
        assert free["a"] * 1e3 == pytest.approx(leg_free, rel=0.03)


def test_information_equals_monte_carlo():
    values, sigma, n = np.array(VALUES["C"]), 0.004, 200_000
    rng = np.random.default_rng(3)
    places, mass = outline("C", values, 20_000)
    points = places[rng.choice(len(places), n, p=mass)] + rng.normal(0, sigma, (n, 2))
    d = log_density(points, "C", values, sigma)
    expected = information("C", values, sigma)
    k = len(values)
    assert np.allclose(d.d_values.T @ d.d_values / n, expected.matrix[:k, :k], rtol=0.03, atol=0.03 * np.diag(expected.matrix)[:k].min())


def test_outer_faces_alone_do_not_tell_the_wall():
    weight = np.array([1.0, 1.0, 1.0, 1.0, 0, 0, 0, 0])
    sd = information("RHS", np.array(VALUES["RHS"]), 0.002, face_weight=weight).sd(1000)
    assert np.isinf(sd["t"]) and sd["h"] < 0.001


@pytest.mark.parametrize("noise", KERNELS)
def test_kernels_are_unit_laws(noise):
    z = np.linspace(-40, 40, 400_001)
    parts = kernel_parts(noise)
    rows = np.array([[kernel_at(float(x), h, s) for x in z[::8]] for _, h, s in parts])
    density = parts[:, 0] @ rows[:, :, 0]
    step = z[8] - z[0]
    assert density.sum() * step == pytest.approx(1, abs=1e-6)
    assert (density * z[::8] ** 2).sum() * step == pytest.approx(1, abs=1e-4)
    tail = parts[:, 0] @ rows[:, :, 2]
    assert np.allclose(np.cumsum(density)[z[::8] < -0.1] * step, tail[z[::8] < -0.1], atol=2e-3)
    kurtosis = (density * z[::8] ** 4).sum() * step
    limits = {"gaussian": (2.99, 3.01), "uniform": (1.79, 1.85), "rounded": (2.32, 2.33), "laplace": (5.9, 6.1), "mixture": (8.3, 8.4)}[noise]
    assert limits[0] < kurtosis < limits[1]


def test_far_points_have_a_floor_and_no_score():
    d = log_density(np.array([[1e6, 1e6], [0.0, 0.0]]), "L", np.array(VALUES["L"]), 0.001)
    assert np.isfinite(d.logp).all() and d.logp[0] < -600
    assert not d.d_point[0].any() and not d.d_values[0].any() and d.d_log_sigma[0] == 0
    assert d.d_values[1].any()


@pytest.mark.parametrize("family", VALUES)
def test_any_scale(family):
    rng = np.random.default_rng(4)
    values, points = np.array(VALUES[family]), rng.uniform(-0.05, 0.05, (50, 2))
    small, large = (log_density(points * k, family, values * k, 0.004 * k) for k in (1.0, 1000.0))
    assert np.allclose(small.logp, large.logp + 2 * np.log(1000.0), atol=1e-6)
    assert np.allclose(small.d_values, large.d_values * 1000, rtol=1e-6, atol=1e-6)


def test_lengths_and_lines_agree_with_the_polygons():
    for family, values in VALUES.items():
        shape = section(family, dict(zip(PARAMETERS[family], values, strict=True)), 40_000)
        found = dict.fromkeys(faces(family), 0.0)
        for loop, names in zip(shape.loops, shape.face_names, strict=True):
            for name, d in zip(names, np.roll(loop, -1, axis=0) - loop, strict=True):
                found[name] += float(np.hypot(*d))
        assert np.allclose(face_lengths(family, np.array(values)), list(found.values()), rtol=1e-7)
        if family not in ROUND:
            axis, line, low, high = lines_of(family)
            v = np.array(values)
            assert np.allclose(high @ v - low @ v, face_lengths(family, v))
            assert set(axis.tolist()) == {0, 1} and len(line) == len(axis)


def test_errors_name_the_value():
    points, values = np.zeros((3, 2)), np.array(VALUES["L"])
    with pytest.raises(UsageError, match="'Z' is unknown"):
        log_density(points, "Z", values, 0.001)
    with pytest.raises(UsageError, match="it has 3: a, b, t"):
        log_density(points, "L", values[:2], 0.001)
    with pytest.raises(UsageError, match="make no section"):
        log_density(points, "L", np.array([0.1, 0.1, 0.1]), 0.001)  # t = a: the toe's inner face has no length
    with pytest.raises(UsageError, match="sigma is 0"):
        log_density(points, "L", values, 0.0)
    with pytest.raises(UsageError, match="'cosine' is unknown"):
        log_density(points, "L", values, 0.001, "cosine")
    with pytest.raises(UsageError, match="it has 6 faces"):
        log_density(points, "L", values, 0.001, face_weight=np.ones(5))
    with pytest.raises(UsageError, match="not all zero"):
        log_density(points, "L", values, 0.001, face_weight=np.zeros(6))
    assert not is_section("RHS", np.array([0.1, 0.08, 0.04])) and is_section("RHS", np.array([0.1, 0.08, 0.0399]))


def test_input_is_untouched():
    points, values, weight = np.random.default_rng(0).normal(0, 0.1, (20, 2)), np.array(VALUES["L"]), np.ones(6)
    before = points.copy(), values.copy(), weight.copy()
    for array in (points, values, weight):
        array.flags.writeable = False
    log_density(points, "L", values, 0.002, face_weight=weight)
    assert all(np.array_equal(a, b) for a, b in zip((points, values, weight), before, strict=True))
