"""The way of a scanner from its sweeps alone, against exact truth."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2fea.kernel.transforms import inverse
from scan2fea.registration.agreement import Agreement
from scan2fea.registration.joint import joint
from scan2fea.registration.map_patches import FLATTEST, map_surfaces
from scan2fea.registration.motion import moved, stepped
from scan2fea.registration.odometry import Odometry, _each, _mean, _reversed, _strided, _turned, odometry
from scan2fea.registration.sweeps import VISIBLE, changed, has_changed
from scan2fea.registration.told import poses_at
from swept import PERIOD, even, swept


def errors(T, truth):
    """m and degrees per knot, relative to the first."""
    off = np.array([inverse(inverse(truth[0]) @ a) @ b for a, b in zip(truth, T, strict=True)])
    return np.linalg.norm(off[:, :3, 3], axis=1), np.degrees(np.linalg.norm(Rotation.from_matrix(off[:, :3, :3]).as_rotvec(), axis=1))


def test_a_way_is_found_within_the_noise_and_its_deviation_is_told():
    truth = even(8, [0.15, 0.02, 0.0], 1.0)
    found = odometry(swept(truth, 0.01), 0.01)
    off_m, off_deg = errors(found.T_world_sweep, poses_at(truth, found.middle))
    assert off_m.max() < 0.005 and off_deg.max() < 0.1
    assert (off_m <= 4 * found.std_m + 1e-12).all()
    assert found.is_sure and not found.stands and not found.is_open
    assert found.disagreement_m < 0.005 and found.used > 0.9


def test_a_scanner_that_stands_is_told_to_stand():
    found = odometry(swept(even(7, [0, 0, 0], 0), 0.01), 0.01)
    assert found.stands and found.is_sure and not found.is_stuck
    assert np.linalg.norm(found.T_world_knot[:, :3, 3], axis=1).max() < 0.005 and abs(found.changed) <= VISIBLE


@pytest.mark.parametrize(("step", "turn_deg", "n"), [((0, 0, 0), 0, 7), ((0.15, 0.02, 0), 1.0, 8), ((0, 0, 0), 2.0, 7), ((0.15, 0, 0), 0, 4)])
def test_whether_a_motion_is_worth_a_search(step, turn_deg, n):
    """A step or a turn is; chance is not, and a few sweeps tell nothing."""
    assert has_changed(swept(even(n, step, turn_deg), 0.01), 0.01) == (n > 5 and (any(step) or turn_deg > 0))


def test_a_corridor_without_ends_leaves_its_own_direction_open():
    """Walls, floor and ceiling along x say nothing of x: the surfaces' share of the information of a drift along it is naught."""
    truth = even(5, [0.1, 0.0, 0.0], 0)
    sweeps = swept(truth, 0.01, low=np.array([-1e3, -2.0, -1.6]), high=np.array([1e3, 2.0, 1.4]), boxes=())
    found = joint(sweeps.points, sweeps.sweep, sweeps.share, truth, 0.25, 0.01, 0.01, (0.04, 0.03))
    assert abs(found.slide[0]) > 0.999
    closed = swept(truth, 0.01)
    held = joint(closed.points, closed.sweep, closed.share, truth, 0.25, 0.01, 0.01, (0.04, 0.03))
    assert held.slide_m < 0.005 and found.slide_m > 20 * held.slide_m


def test_how_evenly_a_scanner_moves_is_learned():
    """An even motion is told to be even; one of known random changes has their standard deviation (60 of each axis: within a quarter)."""
    rng = np.random.default_rng(3)
    even_way = even(20, [0.1, 0, 0], 0)
    shaken = even_way.copy()
    shaken[:, :3, 3] += np.cumsum(np.cumsum(0.004 * rng.standard_normal((21, 3)), axis=0), axis=0)
    freedom = (0.04, 0.03)
    learned = []
    for way in (even_way, shaken):
        sweeps, own, T = swept(way, 0.01, 60), freedom, way
        for _ in range(3):
            found = joint(sweeps.points, sweeps.sweep, sweeps.share, T, 0.25, 0.01, 0.01, own, most=freedom)
            T, own = found.T_world_knot, found.freedom
        learned.append(own)
    true = float(np.sqrt((np.diff(shaken[:, :3, 3], n=2, axis=0) ** 2).mean()))
    assert learned[0][1] < 0.1 * true
    assert learned[1][1] == pytest.approx(true, rel=0.25)


def test_residuals_are_measured_along_the_rays():
    """Of a floor seen at a flat angle the deviation across is sigma times the cosine, never less than the limit."""
    rng = np.random.default_rng(0)
    floor = np.c_[rng.uniform(2, 8, (6000, 1)), rng.uniform(-3, 3, (6000, 1)), np.zeros((6000, 1))]
    away = floor - [0.0, 0.0, 1.0]
    ray = away / np.linalg.norm(away, axis=1, keepdims=True)
    noisy = floor + 0.02 * rng.standard_normal((6000, 1)) * ray
    planes, deviation = map_surfaces(noisy, ray, 0.1, 0.02, 0.02)
    assert len(planes) == 1 and (planes.label >= 0).mean() > 0.99
    assert abs(planes.normal[0, 2]) > 1 - 1e-5
    np.testing.assert_allclose(deviation[planes.label >= 0], 0.02 * np.maximum(np.abs(ray[planes.label >= 0, 2]), FLATTEST), rtol=0.1)


def test_what_lies_on_no_plane_becomes_patches():
    rng = np.random.default_rng(1)
    way = rng.standard_normal((20000, 3))
    ball = 0.5 * way / np.linalg.norm(way, axis=1, keepdims=True)
    seen = ball[ball[:, 0] < -0.1]
    ray = (seen - [-4.0, 0, 0]) / np.linalg.norm(seen - [-4.0, 0, 0], axis=1, keepdims=True)
    planes, _ = map_surfaces(seen, ray, 0.1, 0.002, 0.002)
    assert (planes.label >= 0).mean() > 0.9 and len(planes) > 20
    outward = planes.centre / np.linalg.norm(planes.centre, axis=1, keepdims=True)
    assert np.quantile(np.abs((planes.normal * outward).sum(axis=1)), 0.1) > 0.95


def test_beams_tell_whether_anything_changed():
    still, gone = swept(even(3, [0, 0, 0], 0), 0.01), swept(even(3, [0.4, 0, 0], 0), 0.01)
    assert changed(still, 0, 2, 0.01) < 0.02
    assert changed(gone, 0, 2, 0.01) > 0.3


def test_reversal_strides_and_means():
    truth = even(8, [0.1, 0.05, 0.01], 1.0)
    sweeps = swept(truth, 0.0, 24)
    back = _reversed(sweeps)
    assert (np.diff(back.sweep) >= 0).all() and len(back) == 8
    there = moved(sweeps.points, truth, sweeps.sweep, sweeps.share)
    again = moved(back.points, truth[::-1], back.sweep, back.share)
    np.testing.assert_allclose(again[::-1], there, atol=1e-12)
    np.testing.assert_allclose(_turned(truth[::-1]), inverse(truth[0]) @ truth, atol=1e-12)
    by_two = _strided(sweeps, 2)
    assert by_two.period_s == 2 * PERIOD and by_two.share.max() <= 0.5
    np.testing.assert_allclose(moved(by_two.points, truth[[0, 2, 4, 6, 8]], by_two.sweep, by_two.share), there[sweeps.sweep % 2 == 0], atol=2e-3)
    np.testing.assert_allclose(_each(truth[[0, 2, 4, 6, 8]], 2, 8), truth, atol=2e-3)
    step = np.zeros((9, 6))
    step[3, 3:] = [0.02, 0, 0]
    np.testing.assert_allclose(_mean(np.array([stepped(truth, step), stepped(truth, -step)])), truth, atol=1e-12)


def test_no_motion_is_not_believed_where_the_ranges_changed():
    still = {"T_world_knot": np.tile(np.eye(4), (3, 1, 1)), "T_world_sweep": np.tile(np.eye(4), (2, 1, 1)), "middle": np.full(2, 0.5)}
    still |= {"std_m": np.full(2, 0.001), "std_rad": np.full(2, 0.001), "disagreement_m": 0.0}
    agreed = Agreement(contradicted=0.0, limit=0.05, pair=(0, 1))
    rest = {"slide_m": 0.001, "slide": np.array([1.0, 0, 0]), "open_m": 0.1, "stride": 1, "used": 1.0, "agreement": agreed}
    stuck = Odometry(changed=0.5, **still, **rest)
    assert stuck.is_stuck and not stuck.stands and not stuck.is_sure
    assert Odometry(changed=0.0, **still, **rest).stands
    assert not Odometry(changed=0.0, **still, **{**rest, "slide_m": 1.0}).is_sure
    for share, sure in ((0.05, True), (0.0501, False), (np.nan, False)):
        told = Agreement(contradicted=share, limit=0.05, pair=(0, 1))
        assert Odometry(changed=0.0, **still, **{**rest, "agreement": told}).is_sure == sure
