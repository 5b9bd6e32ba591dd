import numpy as np
import pytest

from predicates import rotation
from scan2fea.kernel.frame_noise import frame_noise, sigma_of_scans

SIGMA, APART = 0.0002, 0.001


def sheets(shifts, seed=0, n=1500, sigma=SIGMA, bend=0.0, wall=None):
    """Points, outward normals and frames of a sheet that each of len(shifts) scans saw, moved by its shift in z; with `wall` its other skin too."""
    rng = np.random.default_rng(seed)
    points, normals, frame = [], [], []
    for k, shift in enumerate(shifts):
        for side in (1.0,) if wall is None else (1.0, -1.0):
            xy = rng.uniform(-0.05, 0.05, (n, 2))
            z = bend * (xy**2).sum(axis=1) + shift + (0.0 if side > 0 else -wall) + sigma * rng.normal(size=n)
            points.append(np.column_stack([xy, z]))
            slope = np.column_stack([-2 * bend * xy, np.ones(n)])
            normals.append(side * slope / np.linalg.norm(slope, axis=1)[:, None])
            frame.append(np.full(n, k))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(frame)


def test_places_of_scans_are_told_from_their_noise():
    shifts = np.random.default_rng(3).normal(0, APART, 12)
    told = frame_noise(*sheets(shifts, n=400))
    assert told.within == pytest.approx(SIGMA, rel=0.1)
    assert told.between == pytest.approx(shifts.std(ddof=1), rel=0.35)  # of twelve


@pytest.mark.parametrize("bend", [0.0, 3.0])
def test_scans_that_agree_tell_nothing(bend):
    for seed in range(6):
        told = frame_noise(*sheets(np.zeros(3), seed, bend=bend))
        assert told.between == 0.0 and told.within == pytest.approx(SIGMA, rel=0.15)


def test_scans_side_by_side_on_a_bend_are_not_compared():
    points, normals, frame = sheets([0.0], n=3000, bend=5.0)
    told = frame_noise(points, normals, (points[:, 0] > 0).astype(np.int64) + frame)
    assert told is None or told.between == 0.0


def test_the_other_skin_of_a_wall_is_no_other_scan():
    points, normals, frame = sheets(np.zeros(2), wall=2 * APART)
    own = np.where(normals[:, 2] > 0, 0, 1) == frame  # each scan sees one skin only
    assert frame_noise(points[own], normals[own], frame[own]) is None
    assert frame_noise(points, normals, frame).between == 0.0


def test_a_sliver_that_two_scans_share_tells_nothing():
    points, normals, frame = sheets([0.0, APART], n=6000)
    seen = (frame == 0) | (points[:, 0] > 0.049)
    assert frame_noise(points[seen], normals[seen], frame[seen]) is None


def test_one_scan_changes_nothing():
    points, normals, frame = sheets([0.0])
    assert frame_noise(points, normals, frame) is None
    assert sigma_of_scans(points, normals, frame, 0.5) == (0.5, 0.0) == sigma_of_scans(points, normals, None, 0.5)
    assert frame_noise(points, normals, np.arange(len(frame)) % 2 - 1) is None  # the others were put there by a stage
    assert np.isnan(sigma_of_scans(points, normals, np.arange(len(frame)) % 2, np.nan)[0])


def test_motion_scale_and_order():
    points, normals, frame = sheets([0.0, APART, -APART], n=500)
    before, turn = frame_noise(points, normals, frame), rotation(5)
    after = frame_noise(7.0 * points @ turn.T + 3.0, normals @ turn.T, 9 - frame)
    assert np.allclose(after, 7.0 * np.array(before), rtol=1e-6)
    assert sigma_of_scans(points, normals, frame, SIGMA) == (np.hypot(*before), before.between)
