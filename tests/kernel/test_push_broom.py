"""Where a swept stripe saw its points from: told exactly by exact images, and by none that do not tell it."""

import numpy as np
import pytest

from scan2fea.kernel.push_broom import seen_from
from scan2fea.kernel.transforms import rotation_about

STEP, AWAY, HIGH = 0.5e-3, 1.3, 0.1
RNG = np.random.default_rng(5)


def image(columns=200, rows=120, noise=0.0, away=AWAY, deep=0.04):
    """Points, rows and columns of a bumpy surface seen from a line (y HIGH, z `away`) along x; each row at one angle."""
    row, column = (v.ravel() for v in np.mgrid[:rows, :columns])
    x = STEP * column
    slope = (row - 0.3 * rows) * 0.12 / rows
    z = deep * np.sin(30 * x + 0.05 * row) + noise * RNG.normal(size=len(x))
    points = np.column_stack([x, HIGH + slope * (away - z), z])
    return points, row, column, np.column_stack([x, np.full(len(x), HIGH), np.full(len(x), away)])


def test_the_track_is_found_in_any_pose_and_scale():
    points, row, column, track = image()
    np.testing.assert_allclose(seen_from(points, row, column), track, atol=1e-9)
    turn = rotation_about(np.array([0.3, -1.0, 0.5]), 1.1)
    moved = 1000.0 * points @ turn.T + 7.0
    np.testing.assert_allclose(seen_from(moved, row, column), 1000.0 * track @ turn.T + 7.0, atol=1e-5)


def test_the_order_of_points_and_cells_without_any_do_not_matter():
    points, row, column, track = image()
    rows = RNG.permutation(len(points))[: len(points) * 2 // 3]
    np.testing.assert_allclose(seen_from(points[rows], row[rows], column[rows]), track[rows], atol=1e-9)
    outside = row.copy()
    outside[::7] = -1
    found = seen_from(points, outside, column)
    assert np.isnan(found[::7]).all()
    np.testing.assert_allclose(np.delete(found, np.s_[::7], 0), np.delete(track, np.s_[::7], 0), atol=1e-9)


def test_noise_along_the_sight_and_interlaced_columns_leave_the_track_within_a_tenth_of_the_fan():
    points, row, column, track = image(noise=0.2e-3)
    points[:, 0] += np.where(row % 2, 0.25, -0.25) * STEP
    points += 5e-6 * RNG.normal(size=points.shape)
    off = np.linalg.norm((seen_from(points, row, column) - track)[:, 1:], axis=1)
    assert off.max() < 0.03 * AWAY


@pytest.mark.parametrize(
    "change",
    [
        lambda p, r, c: (p[:400], r[:400], c[:400]),
        lambda p, r, c: (p, RNG.permutation(r), c),
        lambda p, r, c: (p, r, RNG.permutation(c)),
        lambda p, r, c: (p + 1e-3 * RNG.normal(size=p.shape), r, c),
        lambda p, r, c: (np.column_stack([p[:, 0], 0.5e-3 * r, p[:, 2]]), r, c),  # seen along parallel lines: from either side
        lambda p, r, c: (np.column_stack([p[:, :2], 0 * p[:, 2]]), r, c),  # a flat plate square to the view
    ],
)
def test_no_answer_where_the_grid_does_not_tell(change):
    points, row, column, _ = image()
    assert seen_from(*change(points, row, column)) is None


def test_a_view_from_one_place_is_no_sweep():
    """Columns of a camera's image fan out too: its points do not stand at one place along any line."""
    points, row, column, _ = image()
    depth = AWAY - points[:, 2]
    points[:, 0] = (STEP * column - 0.05) / AWAY * depth
    assert seen_from(points, row, column) is None
