import numpy as np
import pytest

from scan2fea.errors import EstimationError
from scan2fea.estimation.axis import axes_of
from scan2fea.kernel.transforms import random_rotation
from scan2fea.simulation.member import MemberScanOptions, member_points

L = {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048}
I_BEAM = {"h": 0.22, "b": 0.11, "tw": 0.006, "tf": 0.0092, "length": 1.5}


def tilt_deg(axis, direction):
    return np.degrees(np.arcsin(np.linalg.norm(np.cross(axis.T_world_axis[:3, 2], direction))))


@pytest.mark.parametrize(("family", "values", "faces"), [("L", L, ()), ("L", L, ("A_OUTER", "B_OUTER")), ("I", I_BEAM, ("TOP_OUTER", "WEB_LEFT"))])
def test_axis_of_long_members_however_little_is_seen(family, values, faces):
    for seed in range(3):
        R = random_rotation(np.random.default_rng(seed))
        points = member_points(family, values, 4_000, MemberScanOptions(noise_m=0.002, seed=seed, faces=faces, clutter=0.15)) @ R.T
        found = axes_of(points)
        assert len(found) == 1
        assert tilt_deg(found[0], R[:, 2]) < 1.0
        assert found[0].ends[1] - found[0].ends[0] == pytest.approx(values["length"], rel=0.03)


def test_a_block_is_tried_along_three_axes_and_the_true_one_is_sharpest():
    """Fig 3.6: its 5 in are the thickness; seen along the principal axis of the points it would be off by 89 degrees."""
    values = {"a": 0.254, "b": 0.254, "t": 0.127, "length": 0.3}
    points = member_points("L", values, 6_000, MemberScanOptions(noise_m=0.002, caps=True))
    found = axes_of(points)
    assert len(found) == 3
    assert tilt_deg(found[0], np.array([0, 0, 1.0])) < 4
    assert found[0].sharpness > found[1].sharpness >= found[2].sharpness


def test_a_bow_and_a_twist_are_taken_out():
    points = member_points("L", L, 20_000, MemberScanOptions(noise_m=0.002), bow=((0.1,), (0.0, 0.02)), twist=(0.2,))
    straight = axes_of(points)[0].straightened(points)
    inside = straight[np.abs(straight[:, 2] - np.median(straight[:, 2])) < 1.4]
    thin = []
    for part in np.array_split(inside[np.argsort(inside[:, 2])], 10):
        thin.append(np.linalg.eigvalsh(np.cov(part[:, :2].T)))
    thin = np.array(thin)
    whole = np.linalg.eigvalsh(np.cov(inside[:, :2].T))
    assert np.allclose(whole, thin.mean(axis=0), rtol=0.05)  # all slices lie on one another: none adds to the spread of the whole


def test_rigid_motion_moves_the_axis_along():
    points = member_points("L", L, 3_000, MemberScanOptions(noise_m=0.002, seed=2))
    R = random_rotation(np.random.default_rng(5))
    one, two = axes_of(points)[0], axes_of(points @ R.T + [1.0, -2.0, 3.0])[0]
    assert tilt_deg(two, R @ one.T_world_axis[:3, 2]) < 0.3


def test_points_without_a_section_are_refused():
    along = np.random.default_rng(0).random((500, 1))
    with pytest.raises(EstimationError, match="one line"):
        axes_of(along * [1.0, 2.0, 3.0])
    with pytest.raises(EstimationError, match="one place"):
        axes_of(np.ones((60, 3)))
