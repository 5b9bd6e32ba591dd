"""Distant sweeps under right and wrong motions: on other ways, seeds and arrangements of the simulated lab than the limit was looked at with."""

import numpy as np
import pytest

from scan2fea.kernel.transforms import inverse, rigid, rotation_about
from scan2fea.registration.agreement import CONTRADICTED, Agreement, Fans, agreement
from scan2fea.registration.sweeps import Sweeps
from scan2fea.simulation.lab17 import lab17
from scan2fea.simulation.motion import as_measured, path_of, trajectory_at
from scan2fea.simulation.sensors import SENSORS
from swept import even, swept

GAP = np.radians(3.0)  # columns of `swept`; its rings are closer
HDL_GAP = np.radians(4 / 3)


def of_lab(swing, seed, lab, y=-1.5, z=1.2, n=10):
    """Sweeps of an HDL-32E that swings past the lab at 0.92 m/s, one kept of ten, and their true poses."""
    t = np.linspace(0, 5, 41)
    way = np.c_[np.linspace(-0.6, 4.0, 41), y + swing * np.sin(2 * np.pi * t / 1.3), np.full(41, z)]
    options = SENSORS["hdl32e"].options(positions_m=tuple(map(tuple, way)), times_s=tuple(t), keep_every=100 // n)
    scans = SENSORS["hdl32e"].scan(lab17(lab), options, seed)
    path = path_of(options, "hdl32e")
    points, sweep, share = [], [], []
    for k, scan in enumerate(scans):
        points.append(as_measured(scan, path).cloud.points)
        sweep.append(np.full(len(points[-1]), k))
        share.append((scan.rays.time_s[scan.cloud.ray] / 0.05 - k * (100 // n)) / (100 // n))
    times = 0.05 * (100 // n) * np.arange(n + 1)
    made = Sweeps(points=np.concatenate(points), sweep=np.concatenate(sweep), share=np.concatenate(share), period_s=0.25, gap_rad=HDL_GAP)
    return made, trajectory_at(path, times).T_world_frame


def fans(sweeps, sigma=0.02):
    return Fans(sweeps.points, sweeps.sweep, sweeps.share, sigma, sweeps.gap_rad)


def stretched(T, by, along=0):
    """Poses whose way along an axis is `by` of the true one."""
    wrong = T.copy()
    wrong[:, along, 3] = T[0, along, 3] + by * (T[:, along, 3] - T[0, along, 3])
    return wrong


@pytest.mark.parametrize(("swing", "seed", "lab", "y"), [(0.15, 21, 4, -1.5), (0.15, 22, 9, 2.8), (0.05, 23, 6, -2.3)])
def test_the_true_way_agrees_and_one_that_stays_or_falls_short_does_not(swing, seed, lab, y):
    sweeps, truth = of_lab(swing, seed, lab, y)
    beams = fans(sweeps)
    right = agreement(beams, truth)
    assert right.contradicted < 0.01 and right.holds
    for share in (0.0, 0.3, 0.8):
        wrong = agreement(beams, stretched(truth, share))
        assert wrong.contradicted > wrong.limit and not wrong.holds
        assert CONTRADICTED <= wrong.limit <= 2 * CONTRADICTED
    assert agreement(beams, stretched(truth, 0.02)).contradicted > 0.5


def test_a_room_without_gaps_contradicts_by_what_stands_in_the_way():
    """No beam is without a return: a wrong way is told by rays that went through what another sweep saw."""
    truth = even(10, [0.15, 0.05, 0.0], 2.0)
    sweeps = swept(truth, 0.01)
    beams = Fans(sweeps.points, sweeps.sweep, sweeps.share, 0.01, GAP)
    assert agreement(beams, truth).contradicted < 0.02
    assert not agreement(beams, np.tile(np.eye(4), (11, 1, 1))).holds


def test_the_frame_of_the_world_does_not_matter_and_the_worst_pair_is_named():
    truth = even(6, [0.2, 0.0, 0.0], 0.0)
    sweeps = swept(truth, 0.01)
    beams = Fans(sweeps.points, sweeps.sweep, sweeps.share, 0.01, GAP)
    wrong = np.tile(np.eye(4), (7, 1, 1))
    T = rigid(rotation_about((1, 2, 3), 1.0), np.array([5.0, -3.0, 2.0]))
    here, there = agreement(beams, wrong), agreement(beams, T @ wrong)
    assert here == there
    n, share = beams.contradicted(*here.pair, wrong)
    assert share == here.contradicted and n > 50
    assert beams.contradicted(0, 0, wrong)[1] == 0.0
    np.testing.assert_allclose(inverse(T) @ T @ wrong, wrong, atol=1e-12)


def test_what_no_sweeps_share_is_not_agreement():
    """Two sweeps back to back share nothing: that is not agreement."""
    rng = np.random.default_rng(0)
    way = np.c_[np.ones(400), 0.1 * rng.standard_normal((400, 2))]
    one = 3.0 * way / np.linalg.norm(way, axis=1, keepdims=True)
    sweep = np.repeat([0, 1], 400)
    turned = np.stack([np.eye(4), rigid(rotation_about((0, 0, 1), np.pi), np.zeros(3)), rigid(rotation_about((0, 0, 1), np.pi), np.zeros(3))])
    told = agreement(Fans(np.concatenate([one, one]), sweep, np.where(sweep == 0, 0.0, 0.5), 0.01, 0.1), turned)
    assert np.isnan(told.contradicted) and not told.holds
    assert Agreement(contradicted=0.05, limit=0.05, pair=(0, 1)).holds
