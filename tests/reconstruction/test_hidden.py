import numpy as np

from predicates import box, moved, rotation
from scan2fea.kernel.distances import sample_surface
from scan2fea.reconstruction.hidden import hidden_points

H = 0.03
PLATE = box((1.0, 0.8, 0.06))
EVERYWHERE = sample_surface(PLATE, 12_000, 1)[0]


def covered(points, half=0.15):
    """Points of the top under a thing that stands on its middle."""
    return (points[:, 2] > 0.059) & (np.abs(points[:, :2] - [0.5, 0.4]) < half).all(axis=1)


def test_what_is_covered_is_offered():
    seen = EVERYWHERE[~covered(EVERYWHERE)]
    found = hidden_points(PLATE, seen, H)
    assert covered(found, 0.15).all()
    top = seen[seen[:, 2] > 0.059]
    assert np.linalg.norm(top[:, None] - found, axis=2).min() > 2.5 * H  # though the underside is 2 H below
    inner = sample_surface(PLATE, 20_000, 2)[0]
    inner = inner[covered(inner, 0.15 - 3.0 * H)]
    assert len(inner) > 20
    assert np.linalg.norm(inner[:, None] - found, axis=2).min(axis=1).max() < 1.2 * H
    apart = np.linalg.norm(found[:, None] - found, axis=2) + np.eye(len(found))
    assert apart.min() > 0.8 * H


def test_nothing_where_all_is_seen_or_little_is_not():
    assert len(hidden_points(PLATE, EVERYWHERE, H)) == 0
    assert len(hidden_points(PLATE, EVERYWHERE[~covered(EVERYWHERE, 0.09)], H)) == 0  # a hole any answer closes


def test_moved_and_repeated():
    seen = EVERYWHERE[~covered(EVERYWHERE)]
    found = hidden_points(PLATE, seen, H)
    assert np.array_equal(found, hidden_points(PLATE, seen, H))
    turn, shift = rotation(2), np.array([5.0, -3.0, 1.0])
    again = hidden_points(moved(PLATE, turn, shift), seen @ turn.T + shift, H)
    assert len(again) > 0.8 * len(found)
    assert covered((again - shift) @ turn, 0.15 + 1e-9).all()
