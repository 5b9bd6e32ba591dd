"""Borders of planes against a plate that is cast exactly."""

import numpy as np
import pytest

from occluded import rings
from scan2fea.kernel.trajectories import between
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.registration.borders import borders, surface_ends
from scan2fea.registration.joint import joint
from scan2fea.registration.map_patches import map_surfaces
from scan2fea.registration.motion import stepped
from swept import even

LOW, HIGH, FLOOR = np.array([-2.0, 1.0]), np.array([2.5, 3.5]), -1.0
POST = (np.array([0.0, 0.6]), np.array([0.1, 0.7]))  # stands before the plate and hides a strip of it
N_COLUMNS = 360
OVER = rigid(np.eye(3), np.array([-0.5, 1.6, 0.0]))  # over the plate: its borders are seen from within


def over_a_plate(knots, sigma, seed=0, post=False, reach=30.0):
    """points, ring, sweep, share of a scanner over a level plate and nothing else, except where `post` is set."""
    rng = np.random.default_rng(seed)
    direction, ring = rings(N_COLUMNS)
    share = np.mod(-np.arctan2(direction[:, 1], direction[:, 0]), 2 * np.pi) / (2 * np.pi)
    order = np.argsort(share, kind="stable")
    direction, share, ring = direction[order], share[order], ring[order]
    told = []
    for k in range(len(knots) - 1):
        R, x = between(knots, np.full(len(share), k), share)
        ray = np.einsum("nij,nj->ni", R, direction)
        with np.errstate(divide="ignore", invalid="ignore"):
            r = np.where(ray[:, 2] < 0, (FLOOR - x[:, 2]) / ray[:, 2], np.inf)
            at = (x + ray * r[:, None])[:, :2]
            r = np.where(((at > LOW) & (at < HIGH)).all(axis=1) & (r < reach), r, np.inf)
            if post:
                near, far = (np.array(POST)[:, None] - x[:, :2]) / ray[:, :2]
                enters, leaves = np.minimum(near, far).max(axis=1), np.maximum(near, far).min(axis=1)
                r = np.where((enters < leaves) & (enters > 0), np.minimum(r, enters), r)
        hit = np.isfinite(r)
        r = r + sigma * rng.standard_normal(len(r))
        told.append(((direction * r[:, None])[hit], ring[hit], np.full(int(hit.sum()), k), share[hit]))
    return tuple(np.concatenate([one[i] for one in told]) for i in range(4))


def met(ends, knots):
    """Where the rays of ends meet the plate."""
    R, x = between(knots, ends.sweep, ends.share)
    ray = np.einsum("nij,nj->ni", R, ends.points)
    return x + ray * ((FLOOR - x[:, 2]) / ray[:, 2])[:, None]


@pytest.mark.parametrize("sigma", [0.0, 0.02])
def test_ends_lie_within_half_a_step_of_the_border_whatever_the_noise(sigma):
    knots = even(4, [0.2, 0.0, 0.0], 3.0)
    ends = surface_ends(*over_a_plate(knots, sigma), 0.02)
    assert ends.half_rad == pytest.approx(np.pi / N_COLUMNS, rel=1e-3)
    at = met(ends, knots)[:, :2]
    to_border = np.abs(np.concatenate([at - LOW, at - HIGH], axis=1)).min(axis=1)
    far = np.linalg.norm(ends.points[:, :2], axis=1)
    assert (to_border <= 1.2 * ends.half_rad * far).all() and len(at) > 100
    assert (np.diff(ends.sweep + ends.share) >= 0).all()


def test_the_shadow_of_what_stands_before_a_plane_is_no_end_of_it():
    knots = even(2, [0.2, 0.0, 0.0], 0.0)
    ends = surface_ends(*over_a_plate(knots, 0.0, post=True), 0.01)
    plain = surface_ends(*over_a_plate(knots, 0.0), 0.01)
    on_post = np.linalg.norm(ends.points[:, :2], axis=1) < 0.9
    assert on_post.any()
    near = np.linalg.norm(ends.points[~on_post][:, None] - plain.points[None], axis=2).min(axis=1)
    assert near.max() < 1e-12 and len(near) >= len(plain.points) - 2  # the post may hide an end, it makes none


def rows_of(knots, sweeps, ends):
    points, _, sweep, share = sweeps
    R, x = between(knots, sweep, share)
    arm = np.einsum("nij,nj->ni", R, points)
    planes, _ = map_surfaces(arm + x, arm / np.linalg.norm(arm, axis=1, keepdims=True), 0.06, 0.01, 0.01)
    return planes, borders(ends, knots, planes, arm + x, 0.06, 0.01)


def test_residuals_are_steps_and_their_derivative_is_that_of_differences():
    knots = OVER @ even(4, [0.3, 0.0, 0.0], 2.0)
    sweeps = over_a_plate(knots, 0.01)
    ends = surface_ends(*sweeps, 0.01)
    planes, found = rows_of(knots, sweeps, ends)
    assert found.n >= 2
    assert np.abs(found.across).max() < 0.05 and np.median(np.abs(found.across) / found.deviation) == pytest.approx(0.67, abs=0.25)
    h = 0.02 * np.tile([0.002, -0.001, 0.0015, 0.004, -0.003, 0.002], (len(knots), 1))
    world = moved_by(knots, sweeps)
    moved = [borders(ends, stepped(knots, s * h), planes, world, 0.06, 0.01) for s in (-0.5, 0.5)]
    assert all(len(m.across) == len(found.across) for m in moved)
    # of one border: its own fit is free, so what is left of both is compared
    change, told = moved[1].across - moved[0].across, found.own @ h[0]
    for k in range(found.n):
        rows = found.label == k
        free = np.linalg.lstsq(found.terms[rows][:, :2], np.c_[change[rows], told[rows]], rcond=None)[0]
        left = np.c_[change[rows], told[rows]] - found.terms[rows][:, :2] @ free
        np.testing.assert_allclose(left[:, 0], left[:, 1], atol=1e-6)


def moved_by(knots, sweeps):
    R, x = between(knots, sweeps[2], sweeps[3])
    return np.einsum("nij,nj->ni", R, sweeps[0]) + x


def test_borders_hold_the_way_over_a_plate_that_its_plane_leaves_free():
    truth = OVER @ even(6, [0.25, 0.1, 0.0], 1.0)
    points, ring, sweep, share = over_a_plate(truth, 0.01)
    ends = surface_ends(points, ring, sweep, share, 0.01)
    ramp = np.linspace(0, 1, 7)[:, None]
    start = truth.copy()
    start[:, :3, 3] += ramp * [0.02, -0.015, 0.0]
    start = np.array([T @ rigid(rotation_about((0, 0, 1), 0.004 * r[0]), np.zeros(3)) for T, r in zip(start, ramp, strict=True)])
    T, freedom = start, (0.04, 0.03)
    for _ in range(4):
        found = joint(points, sweep, share, T, 0.06, 0.01, 0.01, freedom, most=(0.04, 0.03), ends=ends)
        T, freedom = found.T_world_knot, found.freedom
    assert np.linalg.norm(T[:, :3, 3] - truth[:, :3, 3], axis=1).max() < 0.003
    assert found.slide_m < 0.01
    without = joint(points, sweep, share, truth, 0.06, 0.01, 0.01, (0.04, 0.03))
    assert without.slide_m > 100 * found.slide_m


def test_the_end_of_the_reach_is_no_border():
    """A floor that goes on, seen as far as the reach: what ends stays with the scanner, and the way remains open."""
    knots = even(4, [0.02, 0.0, 0.0], 0.0)
    sweeps = over_a_plate(knots, 0.0, reach=2.2)
    ends = surface_ends(*sweeps, 0.01)
    _, found = rows_of(knots, sweeps, ends)
    held = np.zeros((0, 2)) if found is None else met(ends, knots)[np.isin(ends.sweep + ends.share, found.first + found.share)][:, :2]
    assert (np.abs(np.c_[held - LOW, held - HIGH]).min(axis=1) < 0.05).all()


def test_a_border_seen_from_beyond_is_not_used():
    """Beside the plate the nearest border is met first from outside: were the plate thick, its side face would end there, not its top."""
    knots = rigid(np.eye(3), np.array([LOW[0] - 3.0, 2.2, 0.0])) @ even(12, [0.1, 0.0, 0.0], 2.0)
    sweeps = over_a_plate(knots, 0.0)
    ends = surface_ends(*sweeps, 0.01)
    at = met(ends, knots)[:, :2]
    near = (np.abs(at[:, 0] - LOW[0]) < 0.1) & (np.abs(at[:, 1] - 2.2) < 0.9)
    assert near.sum() > 20  # enough for a border
    assert rows_of(knots, sweeps, ends)[1].n == 1  # one of the two long ones; 2 with the near one


def test_backwards_in_time_the_same_ends():
    ends = surface_ends(*over_a_plate(even(3, [0.2, 0.0, 0.0], 0.0), 0.0), 0.01)
    back = ends.reversed(3)
    np.testing.assert_allclose(back.sweep + back.share, 3 - (ends.sweep + ends.share)[::-1])
    np.testing.assert_array_equal(back.reversed(3).points, ends.points)


def test_beams_without_neighbours_tell_no_step():
    one = np.arange(5)
    assert surface_ends(np.ones((5, 3)), one, np.zeros(5, np.int64), np.linspace(0, 0.9, 5), 0.01) is None
