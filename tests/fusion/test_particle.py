"""The particle filter in the simulated lab: lost at the start, carried away, and what each of its parts must do."""

import numpy as np
import pytest
from scipy.stats import chi2

from scan2fea.errors import FusionError, InputError
from scan2fea.fusion import FusionOptions, particle
from scan2fea.fusion.particle import likelihood_field
from scan2fea.fusion.particle_kernels import likeness, moved_on, systematic
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.rays import first_hits, ray_scene
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation.lab import demo_lab
from scan2fea.types import RangeLog, Trajectory

HEIGHT, RATE = 0.3, 10.0
ANGLE = np.linspace(-np.pi, np.pi, 180, endpoint=False)


def lab():
    """Rays can be cast in it; and its map, points near the height of the scanner."""
    parts = [thing.mesh for thing in demo_lab().objects]
    first = np.cumsum([0] + [len(mesh.vertices) for mesh in parts])
    vertices = np.concatenate([mesh.vertices for mesh in parts])
    faces = np.concatenate([mesh.faces + k for mesh, k in zip(parts, first, strict=False)])
    points = np.concatenate([sample_surface(mesh, 40_000, seed=k)[0] for k, mesh in enumerate(parts)])
    return ray_scene(vertices, faces), points[np.abs(points[:, 2] - HEIGHT) < 0.05, :2]


SCENE, MAP = lab()


def way(seed, n):
    """(n, 3) x, y, heading of a carrier that turns about the lab."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    middle, turn = rng.uniform([1.2, 0.9], [2.2, 1.9]), rng.uniform(0, 2 * np.pi)
    around = turn + rng.choice([-1, 1]) * 0.4 * t
    return np.c_[middle + 0.5 * np.c_[np.cos(around), np.sin(around)], around + rng.uniform(0, 2 * np.pi)]


def seen(poses, seed, sigma=0.01):
    """The log of ranges along a way, and its odometry."""
    rng = np.random.default_rng([seed, 1])
    ranges = []
    for x, y, heading in poses:
        at = heading + ANGLE
        t, _ = first_hits(SCENE, np.tile([x, y, HEIGHT], (180, 1)), np.c_[np.cos(at), np.sin(at), 0 * at])
        ranges.append(np.where(np.isfinite(t) & (t > 0), t + sigma * rng.standard_normal(180), np.nan))
    n = len(poses)
    time = np.arange(n) / RATE
    log = RangeLog(
        time_s=np.repeat(time, 180), angle=np.tile(ANGLE, n), range_m=np.concatenate(ranges), first=np.arange(n + 1, dtype=np.int64) * 180
    )
    T = np.stack([rigid(rotation_about((0, 0, 1), h), [x, y, 0.0]) for x, y, h in poses])
    odometry = [np.eye(4)]
    for k in range(1, n):
        step = np.linalg.inv(T[k - 1]) @ T[k]
        turned = rotation_about((0, 0, 1), 0.002 * rng.standard_normal())
        odometry.append(odometry[-1] @ rigid(turned @ step[:3, :3], step[:3, 3] * 1.01 + [*(0.002 * rng.standard_normal(2)), 0]))
    return log, Trajectory(T_world_frame=np.stack(odometry), placed=np.ones(n, bool), time_s=time)


def off(found, poses):
    """(n, 3) metres and turn from the truth."""
    T = found.trajectory.T_world_frame
    turn = np.arctan2(T[:, 1, 0], T[:, 0, 0]) - poses[:, 2]
    return np.c_[T[:, :2, 3] - poses[:, :2], np.mod(turn + np.pi, 2 * np.pi) - np.pi]


def test_lost_at_the_start_it_is_found_within_five_seconds():
    found_in_time, inside = 0, []
    for seed in range(20):
        poses = way(seed, 60)
        located = particle(*_split(seen(poses, seed)), options=FusionOptions(seed=seed))
        error = off(located, poses)
        late = slice(50, 60)
        right = (np.linalg.norm(error[late, :2], axis=1) < 0.1).all() and (np.abs(error[late, 2]) < np.radians(5)).all()
        found_in_time += bool(right and located.trajectory.placed[late].all())
        if right:
            P = located.trajectory.covariance[late][:, [0, 1, 5]][:, :, [0, 1, 5]]
            inside.append((np.einsum("ki,kij,kj->k", error[late], np.linalg.inv(P), error[late]) < chi2.ppf(0.95, 3)).mean())
    assert found_in_time >= 19
    assert np.mean(inside) > 0.8


def _split(logs):
    return logs[0], MAP, logs[1]


def test_carried_away_it_is_found_again():
    poses = np.concatenate([way(1, 40), way(9, 80)])
    log, _ = seen(poses, 3)
    _, odometry = seen(np.concatenate([way(1, 40), way(9, 80) - way(9, 80)[0] + way(1, 40)[-1]]), 3)
    located = particle(log, MAP, odometry, FusionOptions(seed=1))
    assert located.n_redrawn > 0
    assert (np.linalg.norm(off(located, poses)[-10:, :2], axis=1) < 0.15).all()


def test_the_field_is_the_distance_to_the_nearest_point_and_the_sum_runs_over_rays():
    points = np.array([[0.0, 0.0], [1.0, 0.5]])
    field = likelihood_field(points, 0.1)
    state, angle, distance = np.array([[0.0, 0.0, 0.3], [0.9, 0.2, -1.0]]), np.array([0.2, 1.0]), np.array([1.0, 0.7])
    found = likeness(state, angle, distance, field.log, field.low, field.edge_m, field.least)
    for i, (x, y, h) in enumerate(state):
        total = 0.0
        for a, r in zip(angle, distance, strict=True):
            end = np.array([x + r * np.cos(h + a), y + r * np.sin(h + a)])
            cell = np.floor((end - field.low) / field.edge_m)
            near = np.floor((points - field.low) / field.edge_m)
            d = min(np.linalg.norm(near - cell, axis=1).min() * field.edge_m, 0.6)
            total += np.log(0.9 * np.exp(-0.5 * (d / 0.1) ** 2) + 0.1)
        assert found[i] == pytest.approx(total, abs=1e-9)


def test_systematic_resampling_keeps_shares_within_one():
    rng = np.random.default_rng(0)
    weight = rng.random(50) ** 4
    weight /= weight.sum()
    for offset in (0.0, 0.5, 0.999):
        count = np.bincount(systematic(weight, offset, 1000), minlength=50)
        assert (np.abs(count - 1000 * weight) < 1 + 1e-9).all() and count.sum() == 1000


def test_a_step_is_made_in_the_frame_of_the_particle():
    state = np.array([[1.0, 2.0, np.pi / 2]])
    np.testing.assert_allclose(moved_on(state, np.array([0.5, 0.1, 0.2]), np.zeros(3), np.zeros((1, 3))), [[0.9, 2.5, np.pi / 2 + 0.2]])


def test_the_same_seed_gives_the_same_bytes_and_empty_things_are_refused():
    poses = way(2, 8)
    log, odometry = seen(poses, 2)
    one, other = (particle(log, MAP, odometry, FusionOptions(seed=4)) for _ in range(2))
    assert one.trajectory.T_world_frame.tobytes() == other.trajectory.T_world_frame.tobytes()
    with pytest.raises(InputError, match="map holds no point"):
        particle(log, MAP[:0], odometry)
    blind = RangeLog(time_s=log.time_s, angle=log.angle, range_m=np.full(len(log.angle), np.nan), first=log.first)
    with pytest.raises(FusionError, match="no sweep"):
        particle(blind, MAP, odometry)
