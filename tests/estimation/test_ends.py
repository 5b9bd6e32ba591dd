import numpy as np
import pytest

from scan2fea.estimation.cap_law import Across
from scan2fea.estimation.ends import find_ends, rough_ends
from scan2fea.simulation.member import MemberScanOptions, member_points

L = {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048}
RATIO = 1572.58e-6 / 0.508  # area over perimeter, thesis-notes.md section 3


def ends_of(n, sigma, seed=0, slopes=((0, 0), (0, 0)), **options):
    points = member_points("L", L, n, MemberScanOptions(noise_m=sigma, seed=seed, **options), end_slopes=slopes)
    return find_ends(points, sigma, rough_ends(points[:, 2]), RATIO)


@pytest.mark.parametrize("caps", [False, True])
@pytest.mark.parametrize("sigma", [0.002, 0.02])
def test_length_is_within_its_error_bars_and_near_the_bound(sigma, caps):
    found = [ends_of(10_000, sigma, seed, caps=caps) for seed in range(6)]
    error = np.array([one.length_m - L["length"] for one in found])
    std = np.array([one.std_m for one in found])
    bound = np.sqrt(2 * sigma / (0.903 * 10_000 / L["length"]))  # shape-estimation.md: an edge carries 0.903 rho / sigma
    assert (np.abs(error) < 3.5 * std).all()
    assert (std < 2.5 * bound).all() and (std > 0.5 * bound).all()


def test_without_noise_the_outermost_points_tell_and_a_scanned_cap_tells_exactly():
    open_end, capped = ends_of(20_000, 0.0), ends_of(20_000, 0.0, caps=True)
    spacing = L["length"] / 20_000
    assert abs(open_end.length_m - L["length"]) < 5 * spacing
    assert 0.5 * spacing < open_end.low.std_m < 3 * spacing
    assert abs(capped.length_m - L["length"]) < 1e-5
    assert capped.low.cap_points > 10


def test_clutter_beyond_the_ends_is_no_member():
    found = ends_of(10_000, 0.002, clutter=0.15)
    assert abs(found.length_m - L["length"]) < 4 * found.std_m < 0.02


def test_mitred_ends_are_planes_and_square_ends_have_no_slope():
    slopes = np.array(((0.1, -0.2), (0.5, 0.3)))
    found = ends_of(20_000, 0.002, seed=1, slopes=slopes)
    assert abs(found.length_m - L["length"]) < 4 * found.std_m
    for end, slope in zip((found.low, found.high), slopes, strict=True):
        assert (np.abs(end.slope - slope) < 5 * end.slope_std).all()
        assert (end.slope_std < 0.1).all()
    for seed in range(4):
        square = ends_of(5_000, 0.005, seed=seed)
        assert not square.low.slope.any() and not square.high.slope.any()


def test_ends_move_with_the_points_scale_with_them_and_do_not_depend_on_their_order():
    points = member_points("L", L, 5_000, MemberScanOptions(noise_m=0.004, seed=3))
    base = find_ends(points, 0.004, rough_ends(points[:, 2]), RATIO)
    kept = points.copy()
    moved = find_ends(points + [0, 0, 7.0], 0.004, rough_ends(points[:, 2] + 7.0), RATIO)
    scaled = find_ends(1000 * points, 4.0, rough_ends(1000 * points[:, 2]), 1000 * RATIO)
    mixed = np.random.default_rng(0).permutation(points)
    assert moved.length_m == pytest.approx(base.length_m, abs=1e-6)
    assert scaled.length_m == pytest.approx(1000 * base.length_m, rel=1e-6)
    assert find_ends(mixed, 0.004, rough_ends(mixed[:, 2]), RATIO).length_m == pytest.approx(base.length_m, abs=1e-6)
    assert (points == kept).all()


def test_rough_ends_see_past_caps_and_clutter():
    z = np.r_[np.random.default_rng(1).uniform(0, 1, 9_000), np.zeros(2_000), np.ones(2_000), np.random.default_rng(2).uniform(-0.3, 1.3, 1_000)]
    low, high = rough_ends(z)
    assert low == pytest.approx(0, abs=0.02) and high == pytest.approx(1, abs=0.02)
    assert rough_ends(np.full(60, 2.0)) == (2.0, 2.0)


def test_an_end_with_a_hidden_stretch_and_few_points_is_still_an_end():
    rng = np.random.default_rng(4)
    for n_near in (0, 3, 7, 9, 30):  # so many within the stretch in which the edge is looked at a second time
        z = np.r_[rng.uniform(0.0, 0.002, n_near), rng.uniform(0.3, 3.0, 4_000)]
        points = np.c_[rng.uniform(-0.05, 0.05, (len(z), 2)), z]
        found = find_ends(points, 1e-5, (0.0, 3.0), RATIO)
        assert np.isfinite([found.length_m, found.std_m, found.low.std_m]).all() and 2.6 < found.length_m < 3.1


@pytest.mark.parametrize("along, caps", [(0.1, False), (0.1, True), (1.0, False), (1.7, True), (2.0, False)])
def test_ends_that_are_sharper_or_wider_than_the_noise_across_are_told_so(along, caps):
    """A scanner's noise acts along its rays: sharp ends had been found 10 of their standard deviations within the member."""
    sigma, off = 0.01, []
    for seed in range(8):
        exact = member_points("L", L, 10_000, MemberScanOptions(seed=seed, caps=caps))
        points = exact + np.random.default_rng([seed, 1]).normal(0, 1, exact.shape) * sigma * np.array([1, 1, along])
        found = find_ends(points, sigma, rough_ends(points[:, 2]), RATIO)
        off.append((found.length_m - L["length"]) / found.std_m)
    assert np.abs(off).max() < 4.5 and np.sqrt(np.mean(np.square(off))) < 2


def test_what_is_seen_through_an_open_end_is_no_cap():
    """The inner face of a tube, some way in, lies within the section as a cap does, but not in one plane."""
    rng, n, reach, sigma = np.random.default_rng(2), 8_000, 0.015, 0.0006
    z = np.concatenate([rng.uniform(0, 1.7, n), rng.uniform(0, reach, 150), 1.7 - rng.uniform(0, reach, 150)])
    radius = np.where(np.arange(len(z)) < n, 0.084, 0.075)
    angle = rng.uniform(0, 2 * np.pi, len(z))
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1) + sigma * rng.standard_normal((len(z), 3))

    def look(xy):  # the wall is not known: all that lies inside may be a cap
        r = np.hypot(*xy.T)
        side = np.exp(-0.5 * ((r - 0.084) / sigma) ** 2) / (2 * np.pi * 0.084 * sigma * np.sqrt(2 * np.pi))
        return Across(side=side + 1e-30, cap=np.where(r < 0.084, 1 / (np.pi * 0.084**2), 1e-30), stray=np.full(len(r), 1 / 0.17**2))

    found = find_ends(points, sigma, rough_ends(z), 0.042, look, vague=True)
    assert abs(found.length_m - 1.7) < 4 * found.std_m < 0.004


@pytest.mark.parametrize(("n", "seed"), [(3_000, 912), (3_000, 933), (8_000, 919)])
def test_strays_do_not_tilt_a_square_end(n, seed):
    flat = {"b": 0.12, "t": 0.02, "length": 1.2}
    points = member_points("rect", flat, n, MemberScanOptions(noise_m=0.0012, clutter=0.15, caps=True, seed=seed))
    found = find_ends(points, 0.0012, rough_ends(points[:, 2]), 0.0024 / 0.28)
    assert not found.low.slope.any() and not found.high.slope.any()
    assert abs(found.length_m - flat["length"]) < 3 * found.std_m < 0.012


def test_noise_along_the_axis_that_differs_from_that_across_it_is_held_by_the_spread():
    """The faces scatter by 3 mm, the ends by 0.6 (rays cross the member) or by 5 mm (rays run along it)."""
    rng = np.random.default_rng(5)
    for along in (0.0006, 0.005):
        for _ in range(6):
            z = rng.uniform(0, 1.5, 6_000) + rng.normal(0, along, 6_000)
            points = np.column_stack([rng.uniform(-0.05, 0.05, 6_000), np.full(6_000, 0.05), z])
            found = find_ends(points, 0.003, rough_ends(z), 0.01)
            assert abs(found.length_m - 1.5) < 3.5 * found.std_m
