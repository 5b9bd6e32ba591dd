"""Bends, there and back; the axis of a pipe with elbows from its points; what is none."""

from pipes import Pipe, points_of

import numpy as np
import pytest

import scan2fea.kernel.pipe_path as pipe_path_module
import scan2fea.kernel.pipe_runs as pipe_runs_module
from predicates import rotation
from scan2fea.kernel.bends import bent, pieces_of, straightened
from scan2fea.kernel.pipe_path import pipe_path
from scan2fea.types import Bend

QUARTER = np.pi / 2
STEAM = Pipe(d=0.1143, t=0.006, runs=(0.7, 1.0, 0.8), turns=((QUARTER, 0.3), (np.pi / 4, 2.0)), radius=0.171)


def test_bends_there_and_back():
    rng = np.random.default_rng(0)
    straight = np.column_stack([rng.uniform(-0.05, 0.05, (500, 2)), rng.uniform(-0.1, STEAM.length + 0.1, 500)])
    assert np.allclose(straightened(STEAM.bends, bent(STEAM.bends, straight)), straight, atol=1e-14)


def test_a_quarter_bend_in_closed_form():
    bend = Bend(start_m=1.0, angle_rad=QUARTER, radius_m=0.5, roll_rad=0.0)
    places = bent((bend,), np.array([[0.0, 0.0, 0.5], [0.1, 0.0, 1.0], [0.0, 0.0, 1.0 + 0.25 * np.pi], [0.1, 0.02, 2.0 + 0.25 * np.pi]]))
    assert np.allclose(places, [[0, 0, 0.5], [0.1, 0, 1.0], [0.5, 0, 1.5], [1.5, 0.02, 1.4]], atol=1e-15)


def test_lengths_along_the_axis_are_kept():
    z = np.linspace(0, STEAM.length, 4001)
    axis = bent(STEAM.bends, np.column_stack([np.zeros((len(z), 2)), z]))
    assert np.linalg.norm(np.diff(axis, axis=0), axis=1).sum() == pytest.approx(STEAM.length, rel=1e-6)
    assert len(pieces_of(STEAM.bends)) == 5


@pytest.mark.parametrize(("sigma", "inside"), [(0.0, True), (0.0005, True), (0.0005, False), (0.001, False)])
def test_the_axis_is_found(sigma, inside):
    points, T = points_of(STEAM, 0.006, sigma, seed=3, inside=inside)
    path = pipe_path(points)
    turns = sorted(bend.angle_rad for bend in path.bends)
    assert turns == pytest.approx(sorted(angle for angle, _ in STEAM.turns), abs=2e-3)
    assert all(abs(bend.radius_m - STEAM.radius) < 4 * bend.radius_std_m + 1e-5 for bend in path.bends)
    assert path.length_m == pytest.approx(STEAM.length, abs=0.012)
    ends = bent(STEAM.bends, np.array([[0, 0, 0], [0, 0, STEAM.length]])) @ T[:3, :3].T + T[:3, 3]
    assert np.linalg.norm(ends - path.T_world_path[:3, 3], axis=1).min() < 0.012


def test_turned_and_scaled_it_is_the_same():
    points, _ = points_of(STEAM, 0.008, 0.0003, seed=5)
    found = pipe_path(points)
    other = pipe_path(40 * points @ rotation(2).T + [5.0, -3.0, 1.0])
    assert other.length_m == pytest.approx(40 * found.length_m, rel=1e-3)
    assert [b.radius_m for b in other.bends] == pytest.approx([40 * b.radius_m for b in found.bends], rel=0.02)


def _box(rng):
    points = rng.uniform(-0.5, 0.5, (6000, 3)) * [1.0, 0.2, 0.1]
    k = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), k] = np.array([0.5, 0.1, 0.05])[k] * rng.choice([-1, 1], len(points))
    return points


def _ball(rng):
    points = rng.standard_normal((6000, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def _tee(rng):
    straight = Pipe(d=0.1, t=0.005, runs=(1.0,), turns=(), radius=1.0)
    header, _ = points_of(straight, 0.008, seed=1, inside=False, caps=False)
    branch, _ = points_of(straight, 0.008, seed=1, inside=False, caps=False)
    middle = header.mean(axis=0)
    along = np.linalg.svd(header - middle, full_matrices=False)[2]
    turn = np.stack([along[1], along[0], -along[2]])  # the branch lies along the header's second axis
    return np.concatenate([header, (branch - middle) @ along.T @ turn + middle + 0.55 * along[1]])


def _straight(rng):
    return points_of(Pipe(d=0.1, t=0.005, runs=(1.0,), turns=(), radius=1.0), 0.008, seed=2)[0]


def _mitred(rng):
    """Two pipes that meet at a corner without a bend."""
    one = points_of(Pipe(d=0.1, t=0.005, runs=(1.0,), turns=(), radius=1.0), 0.008, seed=2, inside=False, caps=False)
    local = (one[0] - one[1][:3, 3]) @ one[1][:3, :3]
    first = local[local[:, 2] < 1.0 + local[:, 0]]
    return np.concatenate([first, first[:, [2, 1, 0]] * [-1, 1, -1] + [1.0, 0.0, 1.0]])


@pytest.mark.parametrize("make", [_box, _ball, _tee, _straight, _mitred])
def test_what_is_no_pipe_with_elbows(make):
    assert pipe_path(make(np.random.default_rng(0))) is None


@pytest.mark.parametrize(("fruitless", "is_found"), [(11, True), (12, False)])
def test_a_dozen_patches_that_come_to_no_run_are_enough(monkeypatch, fruitless, is_found):
    """Of 36 pipes the first run grew after at most four patches that came to none; edges of flat faces are bent too, and cost seconds."""
    points, _ = points_of(STEAM, 0.008, 0.0003, seed=5)
    grown, calls = pipe_runs_module._grown, []

    def counted(*given):
        calls.append(1)
        return grown(*given) if len(calls) > fruitless else None

    monkeypatch.setattr(pipe_runs_module, "_grown", counted)
    runs = pipe_runs_module.runs_of(points, 0.008, 0.003, 1)
    assert bool(runs) == is_found and (is_found or len(calls) == 12)


def test_all_points_alike():
    assert pipe_path(np.zeros((100, 3))) is None


def test_a_path_that_its_points_do_not_lie_on_is_none():
    """Few points of no noise: runs through both skins gave bends that were 0.7 degrees off."""
    coarse = Pipe(d=0.2971, t=0.0231, runs=(2.4265, 0.6404, 2.2763), turns=((1.0231, 5.0851), (QUARTER / 2, 1.9063)), radius=0.7427)
    path = pipe_path(points_of(coarse, 0.0456, seed=210)[0])
    assert path is None or sorted(b.angle_rad for b in path.bends) == pytest.approx([QUARTER / 2, 1.0231], abs=2e-3)


def test_corners_far_from_all_points_are_no_path():
    """Least squares had thrown a corner far off, and the distances of no points were asked for their mode."""
    points = points_of(Pipe(d=0.1, t=0.004, runs=(0.6, 0.5), turns=((1.0, 2.0),), radius=0.15), 0.01)[0]
    assert pipe_path_module._fitted(points, np.array([[9.0, 0, 0], [9, 2, 0], [9, 2, 2]]), np.array([0.3]), 0.05, 1e-4, 0) is None
