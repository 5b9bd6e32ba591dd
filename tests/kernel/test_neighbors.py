import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scan2fea.errors import InternalError
from scan2fea.kernel.near_tree import near_tree, nearest_marked
from scan2fea.kernel.neighbors import k_nearest, radius_components
from scan2fea.kernel.transforms import random_rotation


def brute_force(points, radius):
    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    return connected_components(graph, directed=False)[1]


def assert_same_partition(a, b):
    pairs = len(set(zip(a.tolist(), b.tolist(), strict=True)))
    assert pairs == len(set(a.tolist())) == len(set(b.tolist()))


@pytest.mark.parametrize("radius", [0.02, 0.05, 0.07, 0.1, 0.3])
def test_components_equal_brute_force(radius):
    points = np.random.default_rng(1).random((1500, 3))
    assert_same_partition(radius_components(points, radius), brute_force(points, radius))


def test_radius_is_inclusive():
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), -1).reshape(-1, 3)
    assert radius_components(grid, 1.0).max() == 0
    assert radius_components(grid, np.nextafter(1.0, 0.0)).max() == 124


def test_diagonal_of_a_cell_is_no_shortcut():
    """Two points just farther than the radius along the diagonal, where a cell of r / sqrt(3) could hold both."""
    radius = 1.0
    for corner in (np.ones(3), np.array([1.0, 1.0, 0.0])):
        step = corner / np.linalg.norm(corner)
        assert radius_components(np.array([[0, 0, 0], step * radius * (1 + 1e-6)]), radius).tolist() == [0, 1]
        assert radius_components(np.array([[0, 0, 0], step * radius * (1 - 1e-6)]), radius).tolist() == [0, 0]


def test_labels_are_numbered_by_first_point_and_follow_motion_and_order():
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.random((40, 3)) + 5 * k for k in (2, 0, 1)])
    labels = radius_components(points, 1.0)
    assert labels.tolist() == [0] * 40 + [1] * 40 + [2] * 40
    order = rng.permutation(120)
    assert_same_partition(radius_components(points[order], 1.0), labels[order])
    assert_same_partition(radius_components(points @ random_rotation(4).T + 1e6, 1.0), labels)
    assert_same_partition(radius_components(points * 1e-4, 1e-4), labels)


def test_bad_radius_and_no_point():
    for radius in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InternalError, match="radius"):
            radius_components(np.zeros((2, 3)), radius)
    assert radius_components(np.zeros((0, 3)), 1.0).shape == (0,)


def test_k_nearest_equals_brute_force_and_never_pads():
    points = np.random.default_rng(2).random((50, 3))
    queries = np.random.default_rng(3).random((7, 3))
    distance, index = k_nearest(points, 4, queries)
    true = np.linalg.norm(queries[:, None] - points[None], axis=2)
    np.testing.assert_allclose(distance, np.sort(true, axis=1)[:, :4])
    np.testing.assert_array_equal(index, np.argsort(true, axis=1)[:, :4])
    assert k_nearest(points[:3], 10)[0].shape == (3, 3)
    assert k_nearest(points, 1)[1][:, 0].tolist() == list(range(50))
    flat = np.random.default_rng(4).random((60, 2))
    np.testing.assert_array_equal(k_nearest(flat, 5)[1], np.argsort(np.linalg.norm(flat[:, None] - flat[None], axis=2), axis=1)[:, :5])
    assert k_nearest(points, 2, points[:0])[0].shape == (0, 2)
    with pytest.raises(InternalError, match="not finite"):
        k_nearest(np.array([[0.0, 0.0, np.nan]]), 1)
    with pytest.raises(InternalError, match="at least one point"):
        k_nearest(points[:0], 1)


@pytest.mark.parametrize(("n", "m", "k"), [(1, 3, 1), (17, 17, 17), (4000, 0, 16), (4000, 4000, 3), (4000, 9, 40), (33, 2000, 5), (70_000, 0, 7)])
def test_k_nearest_equals_a_search_query_by_query(n, m, k):
    """Sheets, a line and crowded spots: leaves of every shape. More than one block at the last."""
    rng = np.random.default_rng(n + m + k)
    row = np.arange(n)[:, None]
    points = rng.normal(size=(n, 3)) * np.where(row % 3 == 0, [5.0, 1e-3, 0.0], [1.0, 1.0, 1e-2]) * 10.0 ** (row % 5 - 2)
    queries = None if m == 0 else rng.normal(size=(m, 3)) * [4.0, 1.0, 2.0]
    distance, index = k_nearest(points, k, queries)
    known = cKDTree(points).query(points if queries is None else queries, k=[*range(1, k + 1)])
    np.testing.assert_array_equal(distance, known[0])
    np.testing.assert_array_equal(index, known[1])


def test_neighbours_equally_far_come_by_row():
    grid = np.stack(np.meshgrid(*[np.arange(6.0)] * 3), -1).reshape(-1, 3)
    grid = np.concatenate([grid, grid])[np.random.default_rng(0).permutation(432)]
    distance, index = k_nearest(grid, 30)
    true = ((grid[:, None] - grid[None]) ** 2).sum(axis=2)
    np.testing.assert_array_equal(index, np.argsort(true, axis=1, kind="stable")[:, :30])
    np.testing.assert_array_equal(distance, np.sqrt(np.sort(true, axis=1)[:, :30]))


def test_components_of_sheets_lines_and_crowds():
    rng = np.random.default_rng(5)
    points = rng.normal(size=(6000, 3)) * np.where(np.arange(6000)[:, None] % 3 == 0, [5.0, 1e-3, 0.0], [1.0, 1.0, 1e-2])
    points = np.concatenate([points, points[:50]])
    for radius in (1e-9, 3e-3, 0.02, 0.05, 0.2, 50.0):
        assert_same_partition(radius_components(points, radius), brute_force(points, radius) if radius < 50 else np.zeros(6050, int))


@pytest.mark.parametrize("k", [1, 2, 27, 79, 80, 81, 200, 512])
def test_ties_come_by_row_whether_few_or_many_are_asked_for(k):
    """On a grid most distances are shared by many points; few neighbours are kept in a list, many in a heap."""
    grid = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), -1).reshape(-1, 3)[np.random.default_rng(5).permutation(512)]
    queries = grid[::37] + 0.25 * (np.arange(14) % 2)[:, None]
    squared = ((queries[:, None] - grid[None]) ** 2).sum(axis=2)
    ranked = np.argsort(squared, axis=1, kind="stable")[:, :k]
    for tree in (None, near_tree(grid)):
        distance, index = k_nearest(grid, k, queries, tree)
        np.testing.assert_array_equal(index, ranked)
        np.testing.assert_array_equal(distance, np.sqrt(np.take_along_axis(squared, ranked, 1)))


def test_nearest_marked_equals_brute_force():
    rng = np.random.default_rng(6)
    points = rng.integers(0, 12, (400, 3)).astype(float)
    queries, marked = rng.integers(0, 12, (60, 3)).astype(float), rng.random(400) < 0.05
    true = np.where(marked, np.linalg.norm(queries[:, None] - points[None], axis=2), np.inf)
    for reach in (0.5, 2.0, 3.0, 50.0):  # distances of whole numbers: some lie on the limit, and what does is not nearer
        distance, row = nearest_marked(near_tree(points), queries, marked, reach)
        is_near = true.min(axis=1) < reach
        np.testing.assert_array_equal(row, np.where(is_near, true.argmin(axis=1), -1))
        np.testing.assert_array_equal(distance, np.where(is_near, true.min(axis=1), np.inf))
