import itertools

import numpy as np
import pytest

from scan2fea.kernel.polygons import crossing_corners, signed_area, triangulated


def loops_of(*rings):
    xy = np.concatenate(rings)
    starts = np.cumsum([0, *[len(r) for r in rings]])
    return [np.arange(a, b) for a, b in itertools.pairwise(starts)], xy


def circle(n, radius=1.0, centre=(0.0, 0.0), clockwise=False):
    t = np.linspace(0, 2 * np.pi, n, endpoint=False) * (-1 if clockwise else 1)
    return np.column_stack([np.cos(t), np.sin(t)]) * radius + centre


def assert_fills(loops, xy, triangles):
    """Each border edge once, inner edges once each way, area adds up, all counter-clockwise."""
    u, v = xy[triangles[:, 1]] - xy[triangles[:, 0]], xy[triangles[:, 2]] - xy[triangles[:, 0]]
    twice = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    assert (twice > 0).all()
    assert twice.sum() / 2 == pytest.approx(sum(signed_area(xy[loop]) for loop in loops), rel=1e-9)
    directed = {(int(a), int(b)) for t in triangles for a, b in zip(t, np.roll(t, -1), strict=True)}
    assert len(directed) == 3 * len(triangles)
    border = {(int(a), int(b)) for loop in loops for a, b in zip(loop, np.roll(loop, -1), strict=True)}
    assert {e for e in directed if e[::-1] not in directed} == border


def square(n):
    side = np.linspace(0, 1, n + 1)[:-1]
    zero, one = np.zeros(n), np.ones(n)
    return np.concatenate([np.column_stack(c) for c in ((side, zero), (one, side), (1 - side, one), (zero, 1 - side))])


@pytest.mark.parametrize("n", [1, 2, 7, 40])
def test_square_with_points_on_its_sides(n):
    loops, xy = loops_of(square(n))
    assert_fills(loops, xy, triangulated(loops, xy))


def test_long_strip():
    n = 300
    top = np.column_stack([np.linspace(3, 0, n), np.full(n, 0.006)])
    loops, xy = loops_of(np.concatenate([np.column_stack([np.linspace(0, 3, n), np.zeros(n)]), top]))
    assert_fills(loops, xy, triangulated(loops, xy))


def test_star_with_holes():
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    star = np.column_stack([np.cos(t), np.sin(t)]) * (1 + 0.3 * np.sin(7 * t))[:, None]
    holes = [circle(50, 0.1, c, clockwise=True) for c in ((0, 0), (0.4, 0.1), (-0.3, -0.4), (0.05, 0.45))]
    loops, xy = loops_of(star, *holes)
    assert_fills(loops, xy, triangulated(loops, xy))


def test_l_and_rotations():
    corners = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4.0]])
    for angle in np.linspace(0, 2 * np.pi, 9):
        R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        loops, xy = loops_of(corners @ R.T * 1e-3)
        assert_fills(loops, xy, triangulated(loops, xy))


def test_what_bounds_nothing_is_none():
    eight = np.array([[0, 0], [1, 1], [1, 0], [0, 1.0]])
    assert triangulated(*loops_of(eight)) is None
    assert triangulated(*loops_of(square(3)[::-1])) is None  # only a hole
    assert triangulated(*loops_of(square(1), square(1) + 5)) is None  # two outer loops
    assert triangulated(*loops_of(np.array([[0, 0], [1, 0.0]]))) is None


def test_crossing_corners_tells_where():
    loops, xy = loops_of(np.array([[0, 0], [1, 1], [1, 0], [0, 1.0]]), circle(20, 0.1, (5, 5)))
    assert set(crossing_corners(loops, xy).tolist()) == {0, 1, 2, 3}
    assert not len(crossing_corners(*loops_of(square(5))))
