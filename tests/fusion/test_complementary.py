"""The alpha filter: closed forms, invariance, rest, gaps, disturbed fields."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2fea.errors import InputError
from scan2fea.fusion import FusionOptions, complementary
from scan2fea.kernel.quaternions import between_samples, matrices_of, of_vector, product
from scan2fea.types import InertialLog

UP, NORTH = np.array([0.0, 0.0, 9.80665]), np.array([0.0, 20.0, -40.0])


def log_of(time_s, attitude, rate, *, field=True, force=UP, gap=None):
    """What a perfect unit records. attitude : Rotation of the body."""
    back = attitude.inv()
    is_gap = np.zeros(len(time_s), bool) if gap is None else gap
    return InertialLog(time_s=time_s, rate=rate, force=back.apply(force), magnetic=back.apply(NORTH) if field else None, is_gap=is_gap)


def off(result, truth):
    """(k,) radians between the attitudes."""
    return (Rotation.from_matrix(result.trajectory.T_world_frame[:, :3, :3]).inv() * truth).magnitude()


@pytest.mark.parametrize("axis", [[0, 0, 1.0], [1.0, 0, 0], [0.3, -0.5, 0.8]])
def test_a_constant_rate_is_exact(axis):
    time = np.arange(4000) / 200.0
    w = 0.7 * np.array(axis) / np.linalg.norm(axis)
    truth = Rotation.from_euler("zyx", [0.4, 0.2, -0.3]) * Rotation.from_rotvec(time[:, None] * w)
    assert off(complementary(log_of(time, truth, np.tile(w, (4000, 1)))), truth).max() < 1e-7


def test_coning_is_of_second_order_and_half_as_wrong_as_by_mean_rates():
    """A body whose axis runs round a cone: attitude and rate in closed form."""
    cone, spin = 0.3, 9.0
    errors, plain = [], []
    for n in (100, 200, 400):
        t = np.linspace(0.0, 2.0, n + 1)
        axis = np.c_[np.cos(spin * t), np.sin(spin * t), 0 * t]
        truth = Rotation.from_rotvec(cone * axis)
        rate = np.c_[-spin * np.sin(cone) * np.sin(spin * t), spin * np.sin(cone) * np.cos(spin * t), spin * (np.cos(cone) - 1) + 0 * t]
        q = p = tuple(truth[0].as_quat())
        for k in range(n):
            q = product(q, between_samples(tuple(rate[k]), tuple(rate[k + 1]), t[k + 1] - t[k]))
            p = product(p, of_vector(tuple(0.5 * (t[k + 1] - t[k]) * (rate[k] + rate[k + 1]))))
        plain.append((Rotation.from_quat(p).inv() * truth[-1]).magnitude())
        errors.append((Rotation.from_quat(q).inv() * truth[-1]).magnitude())
    slope = np.polyfit(np.log([1, 0.5, 0.25]), np.log(errors), 1)[0]
    assert abs(slope - 2.0) < 0.1
    assert (np.array(errors) < 0.51 * np.array(plain)).all()


def test_bias_is_found_and_leaves_the_attitude():
    time = np.arange(300 * 50) / 50.0
    w = np.c_[0.4 * np.sin(time), 0.3 * np.cos(0.7 * time), 0.5 * np.sin(0.31 * time)]
    steps = Rotation.from_rotvec(np.diff(time, prepend=0.0)[:, None] * 0.5 * (w + np.roll(w, 1, axis=0)))
    truth = [Rotation.identity()]
    for k in range(1, len(time)):
        truth.append(truth[-1] * steps[k])
    truth = Rotation.concatenate(truth)
    bias = np.array([0.01, -0.02, 0.015])
    result = complementary(log_of(time, truth, w + bias))
    assert np.abs(result.bias[-1] - bias).max() < 2e-3
    assert off(result, truth)[-2000:].max() < np.radians(0.5)
    assert not result.is_rest.any()


def test_at_rest_the_mean_rate_is_the_bias():
    rng = np.random.default_rng(0)
    time = np.arange(3000) / 100.0
    rate = np.array([0.004, -0.003, 0.002]) + rng.normal(0, 1e-3, (3000, 3))
    result = complementary(log_of(time, Rotation.identity(3000), rate, field=False))
    assert result.is_rest[200:].all() and result.heading == "the start"
    np.testing.assert_allclose(result.bias[-1], [0.004, -0.003, 0.002], atol=3e-4)
    assert off(result, Rotation.identity(3000)).max() < np.radians(0.5)


def test_the_axes_of_the_unit_do_not_matter():
    rng = np.random.default_rng(1)
    time = np.arange(1500) / 100.0
    rate, force, field = rng.normal(0, 0.5, (1500, 3)), UP + rng.normal(0, 1, (1500, 3)), NORTH + rng.normal(0, 3, (1500, 3))
    plain = InertialLog(time_s=time, rate=rate, force=force, magnetic=field, is_gap=np.zeros(1500, bool))
    M = Rotation.from_rotvec([0.5, 1.0, -0.7]).as_matrix()
    turned = InertialLog(time_s=time, rate=rate @ M.T, force=force @ M.T, magnetic=field @ M.T, is_gap=np.zeros(1500, bool))
    one, other = complementary(plain), complementary(turned)
    # rest is judged axis by axis, but nothing rests here
    np.testing.assert_allclose(other.trajectory.T_world_frame[:, :3, :3], one.trajectory.T_world_frame[:, :3, :3] @ M.T, atol=1e-9)


def test_accelerations_that_swing_vanish():
    time = np.arange(6000) / 100.0
    force = UP + np.c_[3.0 * np.sin(2 * np.pi * time), np.zeros(6000), np.zeros(6000)]
    result = complementary(log_of(time, Rotation.identity(6000), np.zeros((6000, 3)), force=force, field=False))
    assert np.degrees(off(result, Rotation.identity(6000))[3000:].max()) < 0.25  # of 17; two means of 1.5 s leave a ninetieth


def test_a_disturbed_field_is_not_believed_and_a_gap_begins_anew():
    time = np.arange(6000) / 100.0
    log = log_of(time, Rotation.identity(6000), np.zeros((6000, 3)))
    field = log.magnetic.copy()
    field[4000:4500] += (30.0, 0.0, 0.0)
    result = complementary(InertialLog(time_s=time, rate=log.rate, force=log.force, magnetic=field, is_gap=log.is_gap))
    assert result.n_disturbed == 500
    assert off(result, Rotation.identity(6000)).max() < 1e-9
    gap = np.zeros(6000, bool)
    gap[3000] = True
    truth = Rotation.concatenate([Rotation.identity(3000), Rotation.from_rotvec(np.tile([0.5, 0.2, 1.0], (3000, 1)))])
    assert off(complementary(log_of(time, truth, np.zeros((6000, 3)), gap=gap)), truth).max() < 1e-6


def test_one_row_is_too_few():
    with pytest.raises(InputError, match="two rows"):
        complementary(log_of(np.zeros(1), Rotation.identity(1), np.zeros((1, 3))), FusionOptions())


def test_matrices_are_those_of_scipy():
    q = Rotation.random(5, rng=np.random.default_rng(0)).as_quat()
    np.testing.assert_allclose(matrices_of(q), Rotation.from_quat(q).as_matrix(), atol=1e-15)
