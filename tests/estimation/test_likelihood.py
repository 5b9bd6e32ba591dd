"""The layout of the unknowns, the exact scores of the whole model, and what one section is called."""

import math

import numpy as np
import pytest

from scan2fea.errors import InputError, UsageError
from scan2fea.estimation.anneal import climbed
from scan2fea.estimation.canonical import canonical, turned_weight
from scan2fea.estimation.face_weights import seen_weights
from scan2fea.estimation.likelihood import Layout, among_more, bounds, hull_area, hull_of, model_of, prior, scales, sigma_floor, stray_area
from scan2fea.kernel.section_likelihood import faces
from scan2fea.simulation.member import MemberScanOptions, member_points

VALUES = {
    "L": (0.127, 0.1, 0.00635),
    "I": (0.2, 0.1, 0.006, 0.01),
    "RHS": (0.14, 0.08, 0.006),
    "CHS": (0.1, 0.006),
    "rect": (0.1, 0.02),
    "round": (0.05,),
}


def theta_of(layout, rng):
    values = VALUES[layout.family]
    theta = rng.uniform(-0.02, 0.02, len(layout.names))
    theta[: len(values)] = values
    theta[layout.place["log_sigma"]] = math.log(0.005)
    theta[layout.place["logit_outliers"]] = -3
    if "roll" in layout.place:
        theta[layout.place["roll"]] = 0.4
    return theta


def test_names_in_order():
    layout = Layout(family="L", tilt=True, n_bow=2, n_twist=1, free_faces=("A_TOE",))
    assert layout.names == (
        "a", "b", "t", "roll", "cx", "cy", "log_sigma", "logit_outliers", "tilt_x", "tilt_y",
        "bow_x2", "bow_y2", "bow_x3", "bow_y3", "twist1", "weight_A_TOE",
    )  # fmt: skip
    assert "roll" not in Layout(family="CHS").names
    assert len(bounds(layout, 0.1)[0]) == len(scales(layout, 0.1)) == len(prior(layout)[0]) == len(layout.names)


@pytest.mark.parametrize("noise", ["gaussian", "uniform"])
@pytest.mark.parametrize("family", VALUES)
def test_scores_are_derivatives(family, noise):
    rng = np.random.default_rng(0)
    layout = Layout(family=family, tilt=True, n_bow=2, n_twist=0 if family in ("CHS", "round") else 2, free_faces=faces(family)[1:3])
    points = np.c_[rng.uniform(-0.1, 0.1, (200, 2)), rng.uniform(0, 3, 200)]
    model = model_of(points, layout, (0.0, 3.0), noise=noise)
    theta = theta_of(layout, rng)
    _, scores = model.evaluate(theta)
    for j, name in enumerate(layout.names):
        step = np.zeros(len(theta))
        step[j] = 1e-7
        numeric = (model.evaluate(theta + step)[0] - model.evaluate(theta - step)[0]) / 2e-7
        assert np.abs(numeric - scores[:, j]).max() < 1e-4 * (1 + np.abs(scores[:, j]).max()), name


def test_an_impossible_section_is_minus_infinity():
    layout = Layout(family="L")
    model = model_of(np.random.default_rng(0).normal(0, 0.1, (60, 3)), layout, (-1.0, 1.0))
    theta = np.array([0.1, 0.1, 0.1, 0, 0, 0, -5.0, -3.0])  # t = a
    assert (model.evaluate(theta)[0] == -np.inf).all()


@pytest.mark.parametrize("family", ["I", "CHS"])
def test_sums_over_many_points_are_those_of_the_points(family):
    rng = np.random.default_rng(1)
    layout = Layout(family=family, tilt=True)
    points = np.c_[rng.uniform(-0.1, 0.1, (20_000, 2)), rng.uniform(0, 3, 20_000)]
    model = model_of(points, layout, (0.0, 3.0))
    theta = theta_of(layout, rng)
    logp, scores = model.evaluate(theta)
    total, slope, information = model.sums(theta)
    assert total == pytest.approx(logp.sum(), rel=1e-11)
    assert np.allclose(slope, scores.sum(0), rtol=1e-9, atol=1e-9 * np.abs(scores).sum(0).max())
    assert np.allclose(information, scores.T @ scores, rtol=1e-9, atol=1e-12 * information.max())


def test_moving_the_points_moves_only_the_place():
    rng = np.random.default_rng(2)
    layout = Layout(family="L")
    points = np.c_[rng.uniform(-0.1, 0.1, (200, 2)), rng.uniform(0, 3, 200)]
    theta = theta_of(layout, rng)
    turn, shift = 0.7, np.array([0.3, -0.2])
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    moved = np.c_[points[:, :2] @ rotation.T + shift, points[:, 2]]
    other = theta.copy()
    other[layout.place["roll"]] += turn
    other[[layout.place["cx"], layout.place["cy"]]] = rotation @ theta[[layout.place["cx"], layout.place["cy"]]] + shift
    before = model_of(points, layout, (0.0, 3.0)).evaluate(theta)[0]
    after = model_of(moved, layout, (0.0, 3.0)).evaluate(other)[0]
    assert np.allclose(before, after, atol=1e-9)


@pytest.mark.parametrize("family", ["L", "RHS", "rect"])
def test_the_other_name_of_a_section_has_the_same_likelihood(family):
    rng = np.random.default_rng(3)
    layout = Layout(family=family, tilt=True, n_bow=2, n_twist=2, free_faces=faces(family)[1:3])
    theta = theta_of(layout, rng)
    theta[[0, 1]] = theta[[1, 0]]  # the shorter first
    points = np.c_[rng.uniform(-0.1, 0.1, (300, 2)), rng.uniform(0, 3, 300)]
    before = model_of(points, layout, (0.0, 3.0)).evaluate(theta)[0]
    renamed, other, turned = canonical(layout, theta)
    assert turned and other[0] > other[1]
    flip = np.array([1.0, -1.0, -1.0]) if family == "L" else np.ones(3)
    z_range = (-3.0, 0.0) if family == "L" else (0.0, 3.0)
    after = model_of(points * flip, renamed, z_range, area_m2=hull_area(points[:, :2])).evaluate(other)[0]
    assert np.allclose(before, after, atol=1e-8)
    again = canonical(renamed, other)
    assert not again[2] and np.allclose(again[1], other)
    weight = np.arange(1.0, len(faces(family)) + 1)
    plain = Layout(family=family)
    base, twin = plain_theta(plain, theta, layout), None
    _, twin, _ = canonical(plain, base)
    first = model_of(points, plain, (0.0, 3.0), face_weight=weight).evaluate(base)[0]
    second = model_of(points * flip, plain, z_range, area_m2=hull_area(points[:, :2]), face_weight=turned_weight(family, weight)).evaluate(twin)[0]
    assert np.allclose(first, second, atol=1e-8)


def plain_theta(plain, theta, layout):
    return layout.moved(theta, plain)


def test_seen_weights_finds_what_was_drawn():
    rng = np.random.default_rng(4)
    layout = Layout(family="rect")
    true = np.array([1.0, 0.0, 0.5, 1.0])  # BOTTOM RIGHT TOP LEFT
    n = (np.array([0.1, 0.05, 0.1, 0.05]) * true * 40_000).astype(int)
    along = [rng.uniform(-0.05, 0.05, n[0]), rng.uniform(-0.025, 0.025, n[1]), rng.uniform(-0.05, 0.05, n[2]), rng.uniform(-0.025, 0.025, n[3])]
    xy = np.concatenate([
        np.c_[along[0], np.full(n[0], -0.025)], np.c_[np.full(n[1], 0.05), along[1]],
        np.c_[along[2], np.full(n[2], 0.025)], np.c_[np.full(n[3], -0.05), along[3]],
    ])  # fmt: skip
    xy += rng.normal(0, 0.002, xy.shape)
    model = model_of(np.c_[xy, rng.uniform(0, 1, len(xy))], layout, (0.0, 1.0))
    theta = np.array([0.1, 0.05, 0, 0, 0, math.log(0.002), -6])
    weight = seen_weights(model, theta)
    assert np.allclose(weight / weight.max(), true, atol=0.04)


def test_bounds_fix_and_refuse():
    layout = Layout(family="L")
    lower, upper = bounds(layout, 0.2, {"t": 0.006})
    assert lower[2] == upper[2] == 0.006 and lower[0] < upper[0]
    assert lower[layout.place["log_sigma"]] == math.log(sigma_floor(0.2))
    with pytest.raises(UsageError, match="'tf' is no unknown of a L"):
        bounds(layout, 0.2, {"tf": 0.006})
    with pytest.raises(UsageError, match="cannot become"):
        layout.moved(np.zeros(8), Layout(family="I"))


def test_points_on_a_line_are_refused():
    with pytest.raises(InputError, match="lie on one line"):
        hull_area(np.c_[np.linspace(0, 1, 60), np.linspace(0, 2, 60)])


def test_the_hull_of_strays_is_widened_by_what_it_lacks():
    """A hull of m even points lacks corners / m of their area on average; where none is a stray, four times the hull is enough."""
    rng = np.random.default_rng(3)
    for m in (200, 1_000):
        found = [stray_area(hull_of(rng.random((m, 2))), m) for _ in range(300)]
        assert np.mean(found) == pytest.approx(1.0, abs=0.01)
    assert stray_area((2.0, 10), 0.0) == stray_area((2.0, 10), 1.0) == 8.0
    assert stray_area((2.0, 10), 20.0) == pytest.approx(3.0)


def test_the_far_ends_of_the_noise_are_no_strays():
    """Without strays a law that ends at the hull takes some of the noise's tail for strays; over a wider area it does not, and walls stay."""
    values, sigma = {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.0}, 0.02
    layout, start = Layout(family="L"), np.array([0.127, 0.127, 0.00635, 0, 0, 0, np.log(sigma), -8.0])
    thicker, shares = [], []
    for seed in range(3):
        points = member_points("L", values, 60_000, MemberScanOptions(noise_m=sigma, seed=seed))
        hull = hull_of(points[:, :2])
        tight, wide = (climbed(model_of(points, layout, (0.0, 3.0), area_m2=area), start, 0.3) for area in (hull[0], stray_area(hull, 5.0)))
        thicker.append(tight.theta[2] - wide.theta[2])
        shares.append([layout.outlier_share(fit.theta) for fit in (tight, wide)])
    assert min(thicker) > 0
    tight, wide = np.mean(shares, axis=0)
    assert wide < 0.3 * tight


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_the_share_of_strays_of_more_points_is_foretold(share):
    """From the optimum on 2,000 points to that on 20,000 of the same: without strays the prior's hold falls tenfold, with strays nothing changes."""
    layout = Layout(family="round")
    rng = np.random.default_rng(6)
    turn = rng.uniform(0, 2 * np.pi, 20_000)
    xy = 0.03 * np.c_[np.cos(turn), np.sin(turn)] + rng.normal(0, 5e-4, (20_000, 2))
    stray = rng.random(20_000) < share
    xy[stray] = rng.uniform(-0.05, 0.05, (int(stray.sum()), 2))
    points = np.c_[xy, rng.uniform(-0.5, 0.5, 20_000)]
    few, many = (model_of(points[:n], layout, (-0.5, 0.5), area_m2=0.01) for n in (2_000, 20_000))
    theta = np.array([0.06, 0.0, 0.0, np.log(5e-4), -5.0])
    first, last = (climbed(model, theta, 0.06, tolerance=1e-9) for model in (few, many))
    begun, told, true = (t[layout.place["logit_outliers"]] for t in (first.theta, among_more(layout, first.theta, 2_000, 20_000), last.theta))
    assert abs(told - true) < 0.5 * abs(begun - true) + 0.1
