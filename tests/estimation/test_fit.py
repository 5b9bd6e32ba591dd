"""The whole fit of a section: exact on exact points, near the bound under noise, right families, honest where the data do not tell."""

import math

import numpy as np
import pytest

from scan2fea.errors import InputError, UsageError
from scan2fea.estimation.fit import FitOptions, fit_section
from scan2fea.kernel.section_likelihood import faces, information
from scan2fea.kernel.sections import PARAMETERS, ROUND, section
from scan2fea.simulation.member import MemberScanOptions, member_points

SHAPES = {
    "L": (0.16, 0.1, 0.012),
    "I": (0.22, 0.11, 0.006, 0.0092),
    "C": (0.14, 0.06, 0.007, 0.01),
    "T": (0.1, 0.09, 0.008, 0.01),
    "RHS": (0.14, 0.08, 0.006),
    "CHS": (0.1143, 0.006),
    "rect": (0.1, 0.02),
    "round": (0.05,),
}
THIN = (0.127, 0.127, 0.00635)


def sides(family, values, n, sigma, seed, weight=None, length=2.0, turn=0.5, noise="normal"):
    """(n, 3) points on the sides (no caps) of a member, and the transform that placed its section."""
    rng = np.random.default_rng(seed)
    shape = section(family, dict(zip(PARAMETERS[family], values, strict=True)), 720)
    start = np.concatenate(shape.loops)
    step = np.concatenate([np.roll(loop, -1, axis=0) for loop in shape.loops]) - start
    names = [name for loop in shape.face_names for name in loop]
    share = np.hypot(*step.T) * (1 if weight is None else np.array([weight[faces(family).index(name)] for name in names]))
    edge = rng.choice(len(share), n, p=share / share.sum())
    xy = start[edge] + step[edge] * rng.random((n, 1))
    if family in ROUND:
        r = np.hypot(*xy.T)
        for radius in {"CHS": [values[0] / 2, values[0] / 2 - values[-1]], "round": [values[0] / 2]}[family]:
            near = abs(r - radius) < 1e-4 * radius
            xy[near] *= (radius / r[near])[:, None]
    c, s = math.cos(turn), math.sin(turn)
    placed = xy @ np.array([[c, s], [-s, c]]) + [0.03, -0.02]
    points = np.c_[placed, rng.uniform(0, length, n)]
    jitter = rng.normal(0, sigma, (n, 3)) if noise == "normal" else rng.uniform(-(3**0.5) * sigma, 3**0.5 * sigma, (n, 3))
    return points + jitter * (sigma > 0)


def capped(family, values, n, sigma, seed):
    """The same with both ends scanned as densely as the sides: what tells a bar from a tube."""
    points = sides(family, values, n, sigma, seed)
    if family not in ("rect", "round"):
        return points
    rng = np.random.default_rng(seed + 100)
    half = np.array(values if family == "rect" else (values[0], values[0])) / 2
    k = int(n / 2 * (half[0] * half[1] / (half[0] + half[1])) / 2.0) + 20
    xy = rng.uniform(-1, 1, (4 * k, 2))
    xy = (xy if family == "rect" else xy[np.hypot(*xy.T) < 1])[: 2 * k] * half
    c, s = math.cos(0.5), math.sin(0.5)
    cap = np.c_[xy @ np.array([[c, s], [-s, c]]) + [0.03, -0.02], np.where(np.arange(2 * k) % 2, 0.0, 2.0)]
    return np.concatenate([points, cap + rng.normal(0, 1, cap.shape) * sigma])


@pytest.fixture(scope="module")
def noisy_l():
    points = sides("L", SHAPES["L"], 6000, 0.002, 1)
    return points, fit_section(points)


@pytest.mark.parametrize("family", SHAPES)
def test_exact_points_give_the_exact_section(family):
    fit = fit_section(capped(family, SHAPES[family], 4000, 0.0, 7))
    assert fit.family == family and fit.converged
    assert np.abs(fit.values - SHAPES[family]).max() < 1e-8  # 0.01 mm is asked for
    assert all(fit.observable.values())


@pytest.mark.parametrize("family", SHAPES)
def test_noisy_points_give_family_and_section_within_the_bound(family):
    values, n, sigma = np.array(SHAPES[family]), 5000, 0.001
    fit = fit_section(capped(family, values, n, sigma, 3))
    sd = information(family, values, sigma).sd(n)
    bound = np.array([sd[name] for name in PARAMETERS[family]])
    assert fit.family == family and fit.families[family] > 0.9
    assert (np.abs(fit.values - values) < 4 * bound).all()
    assert np.allclose(fit.std, bound, rtol=0.25)
    assert fit.sigma_m == pytest.approx(sigma, rel=0.05) and fit.outlier_share < 0.01
    assert fit.noise == "gaussian"


def test_the_section_lies_where_it_was_put(noisy_l):
    _, fit = noisy_l
    T = fit.T_points_section
    assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3)) and np.linalg.det(T[:3, :3]) > 0
    # corner at the origin, leg a along x: turned by 0.5, moved by (0.03, -0.02)
    assert np.allclose(T[:2, 3], [0.03, -0.02], atol=1e-3)
    assert np.allclose(T[:2, 0], [math.cos(0.5), math.sin(0.5)], atol=5e-3)


def test_the_longer_leg_is_a_by_a_half_turn():
    """A mirror image has no rotation: the member's axis turns about, so that the section's frame stays right-handed."""
    fit = fit_section(sides("L", (0.1, 0.16, 0.012), 5000, 0.001, 2))
    assert fit.values == pytest.approx([0.16, 0.1, 0.012], abs=1e-3)
    T = fit.T_points_section
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1) and T[2, 2] == -1
    assert np.allclose(T[:2, 3], [0.03, -0.02], atol=1e-3)
    assert np.allclose(T[:2, 0], [-math.sin(0.5), math.cos(0.5)], atol=5e-3)  # a runs where the second leg was


def test_rigid_motion_scale_and_order(noisy_l):
    points, fit = noisy_l
    c, s = math.cos(1.1), math.sin(1.1)
    moved = points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [5.0, -3.0, 10.0]
    assert np.allclose(fit_section(moved).values, fit.values, atol=0.02 * fit.std.max())
    large = fit_section(points * 100.0)
    assert large.family == "L" and np.allclose(large.values, 100 * fit.values, atol=2 * fit.std.max())
    order = np.random.default_rng(0).permutation(len(points))
    assert np.allclose(fit_section(points[order]).values, fit.values, atol=0.2 * fit.std.max())


def test_same_points_same_bytes_and_input_untouched(noisy_l):
    points, fit = noisy_l
    before = points.copy()
    points.flags.writeable = False
    again = fit_section(points)
    assert np.array_equal(points, before)
    assert again.theta.tobytes() == fit.theta.tobytes() and again.covariance.tobytes() == fit.covariance.tobytes()


def test_end_caps_do_not_count():
    """A block whose caps hold 5 % of the points: trimmed, the section is as it would be without them."""
    values = (0.1, 0.05)
    rng = np.random.default_rng(5)
    side = sides("rect", values, 6000, 0.0, 5, length=1.0, turn=0.0) - [0.03, -0.02, 0]
    cap = np.c_[rng.uniform(-0.05, 0.05, 300), rng.uniform(-0.025, 0.025, 300), rng.choice([0.0, 1.0], 300)]
    points = np.concatenate([side, cap]) + rng.normal(0, 0.0005, (6300, 3))
    fit = fit_section(points)
    assert fit.family == "rect" and (np.abs(fit.values - values) < 4 * fit.std).all() and fit.outlier_share < 0.005
    assert 0 < fit.z_range[0] < 0.05 and 0.95 < fit.z_range[1] < 1


def test_a_wall_below_the_noise_is_withheld():
    """The thesis's beam under +-20 mm of uniform noise: legs within 1.5 mm, t not observable."""
    for seed in (0, 1):
        fit = fit_section(sides("L", THIN, 20_000, 0.02 / 3**0.5, seed, length=3.048, turn=0.0, noise="box"))
        assert fit.family == "L"
        assert np.abs(fit.values[:2] - THIN[:2]).max() < 0.0015
        assert not fit.observable["t"] and "noise" in fit.why["t"]
        assert fit.noise in ("uniform", "rounded")


def test_a_known_wall_is_kept():
    fit = fit_section(sides("L", THIN, 5000, 0.006, 0), fixed={"t": 0.00635})
    i = fit.names.index("t")
    assert fit.values[i] == 0.00635 and fit.std[i] == 0
    assert (np.abs(fit.values[:2] - THIN[:2]) < 4 * fit.std[:2]).all()


def test_a_tube_seen_from_outside_may_be_a_bar():
    weight = np.array([1.0, 1, 1, 1, 0, 0, 0, 0])
    fit = fit_section(sides("RHS", SHAPES["RHS"], 5000, 0.001, 0, weight=weight))
    assert fit.family in ("RHS", "rect") and fit.families["RHS"] > 0.02 and fit.families["rect"] > 0.02
    assert fit.values[:2] == pytest.approx([0.14, 0.08], abs=0.0005)
    if fit.family == "RHS":
        assert not fit.observable["t"]


def test_a_cap_tells_a_bar_and_its_absence_a_tube():
    bar = fit_section(capped("round", SHAPES["round"], 5000, 0.0005, 1))
    assert bar.family == "round" and bar.families["round"] > 0.99
    open_end = fit_section(sides("round", SHAPES["round"], 5000, 0.0005, 1))
    assert open_end.family == "CHS" and 0.2 < open_end.families["round"] < 0.5
    assert not open_end.observable["t"] and open_end.observable["d"]
    assert open_end.value("d") == pytest.approx(0.05, abs=1e-4)


@pytest.mark.parametrize(
    ("family", "hidden"),
    [
        ("I", ("TOP_OUTER",)),
        ("I", ("WEB_LEFT", "TOP_INNER_LEFT", "BOTTOM_INNER_LEFT")),
        ("C", ("WEB_OUTER", "BOTTOM_OUTER")),
        ("T", ("FLANGE_OUTER",)),
        ("RHS", ("RIGHT_OUTER", "LEFT_OUTER", "TOP_INNER")),  # the only face of the top that was seen is its outer one
        ("RHS", ("BOTTOM_OUTER", "LEFT_INNER", "TOP_INNER")),
        ("RHS", ("TOP_OUTER", "BOTTOM_OUTER", "LEFT_OUTER")),
    ],
)
def test_faces_that_were_not_seen(family, hidden):
    weight = np.array([0.0 if name in hidden else 1.0 for name in faces(family)])
    values = np.array(SHAPES[family])
    fit = fit_section(sides(family, values, 6000, 0.001, 4, weight=weight))
    assert fit.family == family
    assert (np.abs(fit.values - values) < 5 * np.maximum(fit.std, 2e-5)).all()
    for name in faces(family):
        assert (fit.seen[name] < 0.2) == (name in hidden)


def test_stray_points():
    rng = np.random.default_rng(6)
    points = sides("T", SHAPES["T"], 6000, 0.001, 6)
    low, high = points[:, :2].min(0) - 0.05, points[:, :2].max(0) + 0.05
    points[:900, :2] = rng.uniform(low, high, (900, 2))
    fit = fit_section(points)
    assert fit.family == "T" and (np.abs(fit.values - SHAPES["T"]) < 4 * fit.std).all()
    assert 0.1 < fit.outlier_share < 0.17


def test_a_bent_and_twisted_member():
    points = sides("C", SHAPES["C"], 8000, 0.001, 8)
    zeta = points[:, 2] - 1
    turn = 0.03 * zeta
    bent = points.copy()
    bent[:, 0] = np.cos(turn) * points[:, 0] - np.sin(turn) * points[:, 1] + 0.004 * (1.5 * zeta**2 - 0.5)
    bent[:, 1] = np.sin(turn) * points[:, 0] + np.cos(turn) * points[:, 1]
    fit = fit_section(bent, FitOptions(families=("C",), n_bow=1, n_twist=1))
    place, sd = fit.layout.place, np.sqrt(np.diag(fit.covariance))
    scale = (fit.z_range[1] - fit.z_range[0]) / 2  # zeta of the fit spans the trimmed length
    assert abs(fit.theta[place["twist1"]] - 0.03 * scale) < 4 * sd[place["twist1"]] + 1e-4
    assert abs(fit.theta[place["bow_x2"]] - 0.004 * scale**2) < 4 * sd[place["bow_x2"]] + 5e-5
    assert (np.abs(fit.values - SHAPES["C"]) < 4 * fit.std).all()


def test_errors_name_what_is_wrong():
    points = sides("L", SHAPES["L"], 100, 0.001, 0)
    with pytest.raises(InputError, match="49 points are too few for a member: at least 50"):
        fit_section(points[:49])
    with pytest.raises(InputError, match="three coordinates"):
        fit_section(points[:, :2])
    with pytest.raises(InputError, match="must be finite"):
        fit_section(np.where(np.arange(100)[:, None] == 3, np.nan, points))
    with pytest.raises(InputError, match="lie on one line"):
        fit_section(np.linspace(0, 1, 60)[:, None] * np.ones(3))
    with pytest.raises(UsageError, match="'Z' is unknown"):
        fit_section(points, FitOptions(families=("Z",)))
    with pytest.raises(UsageError, match="name at least one family"):
        fit_section(points, FitOptions(families=()))
    with pytest.raises(UsageError, match="'cosine' is unknown"):
        fit_section(points, FitOptions(noise="cosine"))
    with pytest.raises(UsageError, match="fixed dimension 'q'"):
        fit_section(points, fixed={"q": 1.0})
    with pytest.raises(UsageError, match="must be positive"):
        fit_section(points, fixed={"t": 0.0})
    with pytest.raises(InputError, match=r"only \d+ points lie in z"):
        fit_section(points, z_range=(0.0, 0.1))
    assert fit_section(points[:50], FitOptions(families=("L",))).n_used >= 40  # the threshold itself


def test_a_flat_bar_under_uniform_noise_is_no_thin_tube():
    """Two faces 3.5 sigma apart under Gauss's law look like one face under uniform noise: the bar must be asked under that law as well."""
    values = {"b": 0.12, "t": 0.012, "length": 1.2}
    points = member_points("rect", values, 6000, MemberScanOptions(noise_m=0.0012, noise="uniform", seed=0))
    found = fit_section(points, FitOptions(families=("rect", "RHS", "C")))
    assert found.family == "rect" and found.noise == "uniform" and found.families["rect"] > 0.99
    assert abs(found.value("t") - 0.012) < 4 * found.std[1]


class TestStatedNoise:
    """A wall of one sigma: only where the noise is known does the spread of the points tell it."""

    SIGMA = 6.67e-3

    @pytest.fixture(scope="class")
    @staticmethod
    def points():
        return sides("L", THIN, 15_000, TestStatedNoise.SIGMA, 3)

    @staticmethod
    def fitted(points, **stated):
        return fit_section(points, FitOptions(families=("L",), noise="gaussian", hidden_faces=False, **stated))

    def test_tells_a_wall_that_is_as_thin_as_the_noise(self, points):
        blind, told = self.fitted(points), self.fitted(points, sigma_m=self.SIGMA, sigma_error=0.0)
        assert not blind.observable["t"] and told.observable["t"] and "sigma" not in told.why
        # t^2 / 4 is the variance across a leg less that of the noise: d t = 4 sigma^2 / t x the relative error of that variance's root
        bound = 4 * self.SIGMA**2 / THIN[2] / math.sqrt(2 * 15_000)
        std = told.std[told.names.index("t")]
        assert 0.5 * bound < std < 2 * bound
        assert abs(told.value("t") - THIN[2]) < 3.3 * std

    def test_how_well_it_is_known_widens_the_wall(self, points):
        rough = self.fitted(points, sigma_m=self.SIGMA, sigma_error=0.02)
        assert rough.std[rough.names.index("t")] > 1.5 * self.fitted(points, sigma_m=self.SIGMA, sigma_error=0.0).std[rough.names.index("t")]

    @pytest.mark.parametrize("factor", [0.85, 1.2])
    def test_one_that_the_points_deny_is_not_used(self, points, factor):
        found = self.fitted(points, sigma_m=factor * self.SIGMA, sigma_error=0.01)
        assert not found.observable["t"] and found.sigma_m == pytest.approx(self.SIGMA, rel=0.05)
        assert f"deny the stated noise of {1e3 * factor * self.SIGMA:.3g} mm" in found.why["sigma"]
