import numpy as np
import pytest
from scipy.spatial import cKDTree

from predicates import rotation
from scan2fea.kernel.side_normals import near_lists, opposed_evidence, side_normals, spread_evidence, wall_depth


def plate(h=1.0, t=2.0, sigma=0.0, n=24, seed=0):
    """Two parallel sheets of n x n jittered points, t apart, and their outward normals."""
    rng = np.random.default_rng(seed)
    x, y = (a.ravel() * h for a in np.meshgrid(np.arange(n), np.arange(n)))
    sheets = [np.column_stack([x, y, np.full(n * n, z)]) + rng.uniform(-0.3, 0.3, (n * n, 3)) * [h, h, 0] for z in (0.0, t)]
    normals = np.repeat([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], n * n, axis=0)
    points = np.vstack(sheets)
    return points + sigma * rng.normal(size=points.shape), normals


def test_lists_are_brute_force():
    points = np.random.default_rng(0).uniform(size=(400, 3))
    points[1] = points[0] + [0.1, 0, 0]  # on the radius
    near = near_lists(points, 0.1)
    for p, wanted in enumerate(cKDTree(points).query_ball_point(points, 0.1)):
        found = near.index[near.first[p] : near.first[p + 1]]
        assert set(found) == set(wanted) and len(found) == len(wanted)


@pytest.mark.parametrize("t", [2.0, 1.0, 0.5])
def test_a_wall_thinner_than_the_spacing_keeps_two_sides(t):
    points, normals = plate(t=t)
    turn = rotation(3)
    found = side_normals(near_lists(points @ turn.T + 100, 2.5), normals @ turn.T) @ turn
    middle = (np.abs(points[:, :2] - 11.5) < 9).all(1)  # at the rim a plane through both sheets fits as well
    assert np.einsum("ij,ij->i", found, normals)[middle].min() > 0.999


def test_wall_depth_is_the_thickness_and_the_gap():
    points, normals = plate(t=3.0)
    middle = (np.abs(points[:, :2] - 11.5) < 8).all(1)
    assert wall_depth(points, normals, 1.0, 12.0)[middle] == pytest.approx(3.0)
    assert np.isnan(wall_depth(points, normals, 1.0, 12.0, outward=True)).all()
    assert wall_depth(points, -normals, 1.0, 12.0, outward=True)[middle] == pytest.approx(3.0)
    assert np.isnan(wall_depth(points, normals, 1.0, 2.9)).all()


def test_a_grazed_sheet_hears_its_neighbours_but_not_the_other_sheet():
    points, normals = plate(t=4.0)
    rng = np.random.default_rng(1)
    wrong = rng.uniform(size=len(points)) < 0.4
    axes = np.where(wrong[:, None], -normals, normals)
    own = np.where(wrong, -1.0, 1.0) * 0.5
    heard = spread_evidence(near_lists(points, 2.5), axes, own, np.zeros(len(points), bool), 0.5)
    assert ((heard < 0) == wrong).all()
    kept = spread_evidence(near_lists(points, 2.5), axes, -own, np.ones(len(points), bool), 0.5)
    assert (kept == -own).all()


def test_the_next_face_met_looks_the_other_way():
    points, normals = plate(t=4.0)
    sure = normals[:, 2] > 0
    wrong = ~sure & (np.arange(len(points)) % 3 == 0)
    evidence = opposed_evidence(points, np.where(wrong[:, None], -normals, normals), sure, 1.0, 12.0, 0.5)
    assert (evidence[sure] == 0).all()
    told = ~sure & (evidence != 0)
    assert told.sum() > 0.9 * (~sure).sum() and ((evidence[told] < 0) == wrong[told]).all()
