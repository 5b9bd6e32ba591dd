"""The classical methods against their definitions by brute force, invariance, objectives, and what they say to bad input."""

import itertools

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from scan2fea.errors import SegmentationError
from scan2fea.kernel.spanning_tree import spanning_tree, tree_parts
from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation import METHODS, SegmentationOptions
from scan2fea.segmentation.agglomerative import joined
from scan2fea.segmentation.clusters import number_of_clusters, silhouette
from scan2fea.segmentation.divisive import diana, splinter
from scan2fea.segmentation.euclidean import euclidean
from scan2fea.segmentation.fuzzy_cmeans import converged, fuzzy, memberships
from scan2fea.segmentation.kmeans import clustered, lloyd
from scan2fea.segmentation.metrics import adjusted_rand
from scan2fea.simulation.control_sets import blobs
from scan2fea.types import PointCloud

CLUSTERING = ("kmeans", "fuzzy_cmeans", "agglomerative", "divisive")


def some(n=40, seed=0):
    return np.random.default_rng(seed).random((n, 3))


def same(a, b):
    return adjusted_rand(np.asarray(a), np.asarray(b)) == 1.0


# ---- spanning tree


def brute_tree(points):
    """Kruskal over all pairs."""
    n = len(points)
    parent = list(range(n))

    def root(i):
        while parent[i] != i:
            i = parent[i]
        return i

    total, taken = 0.0, []
    for i, j in sorted(itertools.combinations(range(n), 2), key=lambda e: np.linalg.norm(points[e[0]] - points[e[1]])):
        if root(i) != root(j):
            parent[root(i)] = root(j)
            taken.append((i, j))
            total += np.linalg.norm(points[i] - points[j])
    return total, taken


@pytest.mark.parametrize("n", [2, 3, 13, 60, 150])
def test_spanning_tree_is_the_shortest(n):
    points = some(n, n) ** 2
    edges, length = spanning_tree(points)
    total, taken = brute_tree(points)
    assert sorted(map(tuple, edges.tolist())) == sorted(taken)
    assert length.sum() == pytest.approx(total, rel=1e-12)
    assert (np.diff(length) >= 0).all()


def test_spanning_tree_across_sheets_farther_apart_than_any_neighbour():
    """All but the last edges lie within a sheet; every point asks for those that join them."""
    points = np.concatenate([some(70, 5) * [1, 1, 0] + [0, 0, 2 * k] for k in range(3)])
    length = spanning_tree(points)[1]
    assert length.sum() == pytest.approx(brute_tree(points)[0], rel=1e-12)
    assert (length[-2:] >= 2).all()
    assert length[-3] < 2


def test_spanning_tree_of_equal_points_and_equal_distances():
    grid = np.stack(np.meshgrid(*[np.arange(4.0)] * 3), -1).reshape(-1, 3)
    edges, length = spanning_tree(np.concatenate([grid, grid]))
    assert tree_parts(edges, 128).max() == 0
    assert (length == 0).sum() == 64
    assert (length == 1).sum() == 63
    assert len(spanning_tree(grid[:1])[0]) == 0


# ---- k-means


def test_kmeans_is_the_best_of_all_partitions():
    points = np.concatenate([some(4, 1), some(4, 2) + [2, 0, 0]])
    found = clustered(points, 2, 8, 0)

    def cost(labels):
        return sum(((points[labels == c] - points[labels == c].mean(axis=0)) ** 2).sum() for c in (0, 1))

    best = min(cost(np.array(p)) for p in itertools.product((0, 1), repeat=8) if 0 < sum(p) < 8)
    assert cost(found.labels) == pytest.approx(best, rel=1e-12)
    assert found.objective[-1] == pytest.approx(best, rel=1e-12)


@pytest.mark.parametrize("k", [2, 5, 17])
def test_kmeans_step_is_its_definition_and_never_rises(k):
    points = some(1000, k)
    found = lloyd(points, points[:k].copy())
    d2 = cdist(points, found.centres, "sqeuclidean")
    assert np.array_equal(found.labels, d2.argmin(axis=1))
    assert found.objective[-1] == pytest.approx(d2.min(axis=1).sum(), rel=1e-12)
    assert (np.diff(found.objective) <= 1e-12 * found.objective[0]).all()
    assert found.converged


def test_kmeans_gives_a_lost_centre_points_again():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [10, 0, 0], [11, 0, 0]])
    found = lloyd(points, np.array([[0.5, 0, 0], [10.5, 0, 0], [500, 0, 0]]))
    assert len(np.unique(found.labels)) == 3


# ---- fuzzy c-means


@pytest.mark.parametrize("m", [1.5, 2.0, 3.0])
def test_fuzzy_step_is_its_definition_and_never_rises(m):
    points = some(200, 3)
    first = points[:4] + 0.01
    found = converged(points, first, m)
    assert (np.diff(found.objective) <= 1e-12 * found.objective[0]).all()
    w = memberships(points, first, m)
    d = cdist(points, first)
    brute = 1.0 / ((d[:, :, None] / d[:, None, :]) ** (2 / (m - 1))).sum(axis=2)
    np.testing.assert_allclose(w, brute, rtol=1e-9)
    np.testing.assert_allclose(w.sum(axis=1), 1.0, rtol=1e-12)
    assert found.objective[0] == pytest.approx((w**m * d**2).sum(), rel=1e-10)
    end = memberships(points, found.centres, m) ** m
    np.testing.assert_allclose(found.centres, (end.T @ points) / end.sum(axis=0)[:, None], atol=2e-4)  # a fixed point of eq 2.14


def test_fuzzy_point_on_a_centre_belongs_to_it_alone():
    w = memberships(np.zeros((1, 3)), np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 0]]))
    assert w.tolist() == [[0.5, 0.0, 0.5]]


def test_fuzzy_with_little_fuzziness_is_kmeans():
    points, truth = blobs()
    found = fuzzy(points, 3, 4, 1.05, 0)
    assert same(memberships(points, found.centres, 1.05).argmax(axis=1), truth)
    np.testing.assert_allclose(sorted(found.centres[:, 0]), sorted(clustered(points, 3, 4, 0).centres[:, 0]), atol=1e-3)


# ---- hierarchies


def brute_agglomerative(points, how, k):
    distance = cdist(points, points)
    clusters = [[i] for i in range(len(points))]

    def between(a, b):
        if how == "ward":
            gap = points[a].mean(axis=0) - points[b].mean(axis=0)
            return len(a) * len(b) / (len(a) + len(b)) * (gap @ gap)
        return {"single": np.min, "complete": np.max, "average": np.mean}[how](distance[np.ix_(a, b)])

    while len(clusters) > k:
        i, j = min(itertools.combinations(range(len(clusters)), 2), key=lambda ij: between(clusters[ij[0]], clusters[ij[1]]))
        clusters[i] = clusters[i] + clusters.pop(j)
    labels = np.zeros(len(points), int)
    for c, rows in enumerate(clusters):
        labels[rows] = c
    return labels


@pytest.mark.parametrize("how", ["single", "complete", "average", "ward"])
@pytest.mark.parametrize("k", [2, 4, 9])
def test_agglomerative_is_its_definition(how, k):
    points = some(30, k)
    found = METHODS["agglomerative"](PointCloud.of(points), SegmentationOptions(linkage=how, clusters=k))
    assert len(np.unique(found)) == k
    assert same(found, brute_agglomerative(points, how, k))


def test_single_linkage_cut_at_a_radius_is_euclidean():
    points = some(2000, 5)
    for radius in (0.05, 0.08):
        options = SegmentationOptions(radius_m=radius, min_points=3)
        assert same(METHODS["agglomerative"](PointCloud.of(points), options), euclidean(PointCloud.of(points), options))


def test_splinter_is_its_definition():
    """Step by step over sets."""
    points = some(15, 8)
    d = cdist(points, points)
    rest, left = list(range(15)), []
    left.append(rest.pop(int(np.argmax(d.sum(axis=1)))))
    while len(rest) > 1:
        gain = [d[i, [j for j in rest if j != i]].mean() - d[i, left].mean() for i in rest]
        if max(gain) <= 0:
            break
        left.append(rest.pop(int(np.argmax(gain))))
    assert sorted(np.flatnonzero(splinter(d)).tolist()) == sorted(left)


def test_diana_splits_the_widest_first():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [100, 0, 0], [103, 0, 0]])
    assert same(diana(points, 2), [0, 0, 1, 1])
    assert same(diana(points, 3), [0, 0, 1, 2])
    assert diana(points, 4).tolist() and len(np.unique(diana(points, 4))) == 4


# ---- all of them


@pytest.mark.parametrize("method", CLUSTERING)
def test_blobs_are_found_whatever_their_number_motion_scale_and_order(method):
    points, truth = blobs(100)
    order = np.random.default_rng(1).permutation(len(points))
    moved = 100.0 * (points @ random_rotation(3).T) + [5, 6, 7]
    for xyz, labels in ((points, truth), (moved, truth), (points[order], truth[order])):
        before = xyz.copy()
        options = SegmentationOptions(method=method, linkage="average")
        assert same(METHODS[method](PointCloud.of(xyz), options), labels)
        assert np.array_equal(xyz, before)
        assert same(METHODS[method](PointCloud.of(xyz), SegmentationOptions(method=method, linkage="ward", clusters=3)), labels)


def test_silhouette_is_its_definition():
    points, labels = some(20, 4), np.arange(20) % 3
    d = cdist(points, points)
    brute = []
    for i in range(20):
        a = np.mean([d[i, j] for j in range(20) if j != i and labels[j] == labels[i]])
        b = min(np.mean([d[i, j] for j in range(20) if labels[j] == c]) for c in range(3) if c != labels[i])
        brute.append((b - a) / max(a, b))
    assert silhouette(d, labels) == pytest.approx(np.mean(brute), rel=1e-12)


def test_one_even_cloud_is_one_cluster():
    def cut(points, k):
        return clustered(points, k, 2, 0).labels

    assert number_of_clusters(some(500, 2) * [5, 1, 1], cut, 6, 0) == 1
    assert number_of_clusters(np.zeros((50, 3)), cut, 6, 0) == 1


@pytest.mark.parametrize("method", CLUSTERING)
@pytest.mark.parametrize(
    ("points", "options", "told"),
    [
        (some(5), {"clusters": 6}, r"segmentation\.clusters is 6, but the cloud has 5 points"),
        (some(5), {"clusters": 1}, r"segmentation\.clusters is 1: the least is 2; .*single"),
        (np.ones((9, 3)), {"clusters": 2}, r"segmentation\.clusters is 2, but the points lie at 1 different place:"),
        (np.full((9, 3), np.nan), {}, "not finite"),
    ],
)
def test_bad_input_is_told(method, points, options, told):
    with pytest.raises(SegmentationError, match=told):
        METHODS[method](PointCloud.of(points), SegmentationOptions(**options))


@pytest.mark.parametrize("method", CLUSTERING)
def test_limits_and_nothing(method):
    points = some(5)
    assert len(np.unique(METHODS[method](PointCloud.of(points), SegmentationOptions(clusters=5)))) == 5
    assert METHODS[method](PointCloud.of(np.zeros((0, 3))), SegmentationOptions()).shape == (0,)
    assert METHODS[method](PointCloud.of(np.ones((9, 3))), SegmentationOptions()).tolist() == [0] * 9


def test_agglomerative_knows_its_linkages():
    with pytest.raises(SegmentationError, match="single, complete, average, ward"):
        METHODS["agglomerative"](PointCloud.of(some()), SegmentationOptions(linkage="centroid"))
    for radius in (0.0, 99.0):
        with pytest.raises(SegmentationError, match=r"segmentation\.radius_m"):
            METHODS["agglomerative"](PointCloud.of(some()), SegmentationOptions(radius_m=radius))


def test_joined_needs_no_more_clusters_than_points():
    assert joined(some(3), "ward", 3).tolist() == [0, 1, 2]


def test_euclidean_leaves_out_what_is_larger_than_max_points():
    line = np.c_[np.r_[np.arange(10.0), 100 + np.arange(5.0)], np.zeros((15, 2))]
    found = euclidean(PointCloud.of(line), SegmentationOptions(radius_m=1.5, min_points=3, max_points=9))
    assert found.tolist() == [-1] * 10 + [0] * 5
    found = euclidean(PointCloud.of(line), SegmentationOptions(radius_m=1.5, min_points=3, max_points=10))
    assert found.tolist() == [0] * 10 + [1] * 5
