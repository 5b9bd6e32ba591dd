"""Motion within and between sweeps of one scanner."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from occluded import rings, seen
from scan2fea.errors import InputError
from scan2fea.io import read_scan, write_trajectory
from scan2fea.io.velodyne import write_velodyne
from scan2fea.kernel.lidar_units import HDL32E
from scan2fea.kernel.transforms import applied, inverse, rigid, rotation_about
from scan2fea.pipeline.config import load_config
from scan2fea.pipeline.register import register_files
from scan2fea.registration import at_times, deskewed, deskewed_by
from scan2fea.registration.joint import joint
from scan2fea.registration.motion import between, stepped
from scan2fea.types import Trajectory

RNG = np.random.default_rng(6)
KNOTS = np.stack([rigid(rotation_about((0.1, 0.2, 1.0), 0.3 * t), [2.0 * t, 0.3 * t**2, 0.1 * t]) for t in np.linspace(0, 1, 6)])


def test_an_even_motion_is_undone_exactly():
    world, share = RNG.uniform(-5, 5, (400, 3)), RNG.random(400)
    T = rigid(rotation_about((1.0, -2.0, 0.5), 0.2), [0.4, -0.1, 0.05])
    turn = Rotation.from_matrix(T[:3, :3]).as_rotvec()
    poses = [rigid(Rotation.from_rotvec(s * turn).as_matrix(), s * T[:3, 3]) for s in share]
    skewed = np.array([applied(inverse(pose), point[None])[0] for pose, point in zip(poses, world, strict=True)])
    np.testing.assert_allclose(deskewed(skewed, share, T), world, atol=1e-12)
    assert np.abs(deskewed(skewed, share, np.eye(4)) - skewed).max() == 0


def test_knots_are_met_and_a_timed_trajectory_is_followed():
    R, x = between(KNOTS, np.array([0, 2, 4, 4]), np.array([0.0, 0.0, 0.0, 1.0]))
    np.testing.assert_allclose(R, KNOTS[[0, 2, 4, 5], :3, :3], atol=1e-12)
    np.testing.assert_allclose(x, KNOTS[[0, 2, 4, 5], :3, 3], atol=1e-12)
    time = np.array([10.0, 10.1, 10.2, 10.35, 10.4, 10.6])
    way = Trajectory(T_world_frame=KNOTS, placed=np.ones(6, bool), time_s=time)
    first, share = at_times(way, np.array([10.0, 10.275, 10.6]))
    assert first.tolist() == [0, 2, 4] and share == pytest.approx([0.0, 0.5, 1.0])
    at_knots = deskewed_by(np.tile([1.0, 2.0, 3.0], (6, 1)), time, way)
    np.testing.assert_allclose(at_knots, [applied(T, np.array([[1.0, 2, 3]]))[0] for T in KNOTS], atol=1e-12)
    with pytest.raises(InputError, match="they are of another scan"):
        at_times(way, np.array([10.0, 12.0]))
    with pytest.raises(InputError, match="has no times, or they do not rise"):
        at_times(Trajectory(T_world_frame=KNOTS, placed=np.ones(6, bool), time_s=time[::-1].copy()), time)


def swept(knots, n_columns=240, sigma=0.0):
    """Points of a room, in the frame of a scanner that moves along knots while it turns; sweep and share of each."""
    direction, _ = rings(n_columns)
    azimuth = np.arctan2(direction[:, 1], direction[:, 0])
    points, sweep, share = [], [], []
    for k in range(len(knots) - 1):
        s = np.mod(-azimuth, 2 * np.pi) / (2 * np.pi)
        R, x = between(knots, np.full(len(s), k), s)
        ray = np.einsum("nij,nj->ni", R, direction)
        low, high = np.array([-6.0, -5.0, -1.6]), np.array([7.0, 5.0, 2.4])
        distance = np.min(np.where(ray > 0, (high - x) / ray, (low - x) / ray), axis=1) + sigma * RNG.standard_normal(len(s))
        points.append(direction * distance[:, None])
        sweep.append(np.full(len(s), k))
        share.append(s)
    return np.concatenate(points), np.concatenate(sweep), np.concatenate(share)


def test_planes_that_are_free_bring_all_poses_to_the_truth():
    """A room of six planes: from poses that are off by centimetres every pose comes within the noise, in the frame of the first."""
    points, sweep, share = swept(KNOTS, 120, 0.01)
    step = np.zeros((6, 6))
    step[1:, :3], step[1:, 3:] = 0.004 * RNG.standard_normal((5, 3)), 0.02 * RNG.standard_normal((5, 3))
    T = stepped(KNOTS, step)
    for _ in range(8):
        found = joint(points, sweep, share, T, 0.25, 0.02, 0.01, (1.0, 1.0))
        T = found.T_world_knot
    assert found.used > 0.9
    np.testing.assert_allclose(T[0], KNOTS[0], atol=1e-12)
    error = np.linalg.norm(T[:, :3, 3] - KNOTS[:, :3, 3], axis=1)
    assert error.max() < 0.01 and (error[1:] < 4 * np.sqrt(np.diag(found.covariance).reshape(-1, 6)[:, 3:].sum(axis=1))).all()
    turned = np.linalg.norm(Rotation.from_matrix(T[:, :3, :3] @ KNOTS[:, :3, :3].transpose(0, 2, 1)).as_rotvec(), axis=1)
    assert np.degrees(turned.max()) < 0.1


def capture(path, knots, period=0.05):
    """A capture of an HDL-32E that moves through a room, and the times of the knots."""
    n = round(period / (HDL32E.firing_us * 1e-6))
    elevation = np.radians(HDL32E.elevations_deg)
    time, azimuth, ranges = [], [], []
    low, high = np.array([-6.0, -5.0, -1.6]), np.array([7.0, 5.0, 2.4])
    begun = 10.0
    for k in range(len(knots) - 1):
        t = begun + HDL32E.firing_us * 1e-6 * (k * n + np.arange(n))
        a = 2 * np.pi * (np.arange(n) + 0.37) / n  # along no axis
        each = np.repeat(np.arange(n), 32)
        late = np.tile(np.arange(32), n) * HDL32E.laser_us / HDL32E.firing_us
        at = a[each] + 2 * np.pi / n * late
        w = np.tile(elevation, n)
        direction = np.stack([np.cos(w) * np.cos(at), -np.cos(w) * np.sin(at), np.sin(w)], axis=1)
        R, x = between(knots, np.full(32 * n, k), (each + late) / n)
        own = np.zeros_like(direction)
        own[:, 2] = -HDL32E.focal_m * np.tan(w)
        ray, start = np.einsum("nij,nj->ni", R, direction), x + np.einsum("nij,nj->ni", R, own)
        with np.errstate(divide="ignore", over="ignore"):
            reach = np.where(ray > 0, (high - start) / ray, (low - start) / ray)
        ranges.append(np.min(reach, axis=1).reshape(n, 32))
        time.append(t)
        azimuth.append(np.degrees(a))
    whole = np.concatenate(time)
    write_velodyne(path, whole, np.concatenate(azimuth), np.concatenate(ranges), np.ones((len(whole), 32)))
    return begun + HDL32E.firing_us * 1e-6 * n * np.arange(len(knots))


def off_room(points):
    return np.min([np.abs(points - [-6.0, -5.0, -1.6]).min(axis=1), np.abs(points - [7.0, 5.0, 2.4]).min(axis=1)], axis=0)


def test_a_capture_is_put_together_by_its_trajectory(tmp_path):
    knots = KNOTS[:4]
    time = capture(tmp_path / "a.pcap", knots)
    write_trajectory(tmp_path / "way.txt", Trajectory(T_world_frame=knots, placed=np.ones(4, bool), time_s=time))
    smeared = register_files([tmp_path / "a.pcap"], tmp_path / "as_it_lies", load_config(None, {"registration.sweeps": "as_they_lie"}))
    assert "sweeps" not in smeared["registration"]
    report = register_files([tmp_path / "a.pcap"], tmp_path / "out", load_config(None, {"registration.poses": str(tmp_path / "way.txt")}))
    before, after = (off_room(read_scan(tmp_path / name / "cloud.ply").scan.cloud.points) for name in ("as_it_lies", "out"))
    assert np.sqrt((before**2).mean()) > 0.1
    assert np.sqrt((after**2).mean()) < 0.003 and np.quantile(after, 0.999) < 0.01  # ranges are in 2 mm, azimuths in 0.01 degrees
    np.testing.assert_allclose(np.loadtxt(tmp_path / "out" / "trajectory.txt")[:, 1:4], knots[:, :3, 3], atol=1e-9)
    assert report["registration"]["sweeps"][0]["path"] == "a.pcap"
    write_trajectory(tmp_path / "other.txt", Trajectory(T_world_frame=knots, placed=np.ones(4, bool), time_s=time + 500))
    with pytest.raises(InputError, match="they are of another scan"):
        register_files([tmp_path / "a.pcap"], tmp_path / "no", load_config(None, {"registration.poses": str(tmp_path / "other.txt")}))


def test_the_room_of_these_tests_is_that_of_the_others():
    direction, _ = rings(120)
    assert off_room(seen(direction, 0.0, boxes=())[0]).max() < 1e-9
