"""Interpolation on SE(3)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2fea.errors import InputError
from scan2fea.kernel.trajectories import interpolated
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.types import Trajectory

TIME = np.array([0.0, 1.0, 3.0])
POSES = np.stack([rigid(rotation_about((0, 0, 1), a), [a, 2 * a, 0]) for a in (0.0, 1.0, 3.0)])
WAY = Trajectory(T_world_frame=POSES, placed=np.ones(3, bool), time_s=TIME, covariance=np.stack([k * np.eye(6) for k in (1.0, 2.0, 4.0)]))


def test_an_even_motion_is_exact_and_knots_are_kept():
    at = np.array([0.0, 0.3, 1.0, 2.5, 3.0])
    found = interpolated(WAY, at)
    np.testing.assert_allclose(found.T_world_frame, [rigid(rotation_about((0, 0, 1), a), [a, 2 * a, 0]) for a in at], atol=1e-12)
    np.testing.assert_allclose(found.covariance[:, 0, 0], [1, 1.3, 2, 3.5, 4])
    assert found.placed.all() and found.time_s is not WAY.T_world_frame


def test_the_frame_of_the_world_does_not_matter():
    G = rigid(Rotation.from_rotvec([0.3, 1.0, -2.0]).as_matrix(), [5, -3, 8])
    moved = Trajectory(T_world_frame=G @ POSES, placed=np.ones(3, bool), time_s=TIME)
    at = np.linspace(0, 3, 13)
    np.testing.assert_allclose(interpolated(moved, at).T_world_frame, G @ interpolated(WAY, at).T_world_frame, atol=1e-12)


def test_beside_a_pose_that_was_left_out_nothing_is_placed():
    poses = np.where(np.array([1, 0, 1])[:, None, None] > 0, POSES, np.nan)
    holed = Trajectory(T_world_frame=poses, placed=np.array([True, False, True]), time_s=TIME)
    np.testing.assert_array_equal(interpolated(holed, np.array([0.0, 0.5, 1.0, 3.0])).placed, [True, False, False, True])


def test_moments_outside_and_times_that_fall_are_refused():
    with pytest.raises(InputError, match=r"from 0.000 to 3.500 s, the trajectory is of 0.000 to 3.000 s"):
        interpolated(WAY, np.array([0.0, 3.5]))
    with pytest.raises(InputError, match="times rise"):
        interpolated(Trajectory(T_world_frame=POSES, placed=np.ones(3, bool), time_s=TIME[::-1].copy()), TIME)
