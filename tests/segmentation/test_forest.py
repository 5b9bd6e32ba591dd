"""The forest of points: its cuts and walks against brute force, features against their definition, weights that cannot be used."""

import numpy as np
import pytest

from scan2fea.errors import FormatError, InputError, SegmentationError
from scan2fea.segmentation import SegmentationOptions, segment_scene
from scan2fea.segmentation.features import EDGES, FEATURES, PER_SCALE, most_frequent, point_features
from scan2fea.segmentation.forest import _best_cut, class_probabilities, grown
from scan2fea.segmentation.learned import classes_of_points
from scan2fea.segmentation.weights import arrays_of, read_weights, shipped_weights, weights_of
from scan2fea.simulation.kind_rooms import POINT_CLASSES, classed_room
from scan2fea.types import PointCloud, Scan


def test_the_cut_is_the_best_of_all():
    rng = np.random.default_rng(0)
    binned, label = rng.integers(8, size=(60, 4)).astype(np.uint8), rng.integers(3, size=60)
    weight = np.array([1.0, 2.0, 0.5])

    def impurity(rows):
        mass = np.bincount(label[rows], weights=weight[label[rows]], minlength=3)
        return mass.sum() - (mass**2).sum() / mass.sum() if len(rows) else 0.0

    every = np.arange(60)
    gains = {}
    for f in range(4):
        for b in range(7):
            left = binned[:, f] <= b
            if left.any() and not left.all():
                gains[f, b] = (impurity(every) - impurity(every[left]) - impurity(every[~left])) / weight[label].sum()
    f, b, gain = _best_cut(binned, label, weight, every, np.arange(4), 8)
    assert gain == pytest.approx(max(gains.values())) and gains[f, b] == pytest.approx(gain)


def rings(n=3000):
    rng = np.random.default_rng(1)
    x = rng.uniform(-1, 1, (n, 3))
    return x, ((x[:, 0] ** 2 + x[:, 1] ** 2) > 0.5).astype(np.int64)


def test_it_learns_a_ring_repeats_and_walks_as_written():
    x, label = rings()
    forest = grown(x, label, ("in", "out"), seed=0, trees=8, depth=8)
    again = grown(x, label, ("in", "out"), seed=0, trees=8, depth=8)
    assert np.array_equal(forest.limit, again.limit) and np.array_equal(forest.share, again.share)
    new, truth = rings(997)
    p = class_probabilities(forest, new)
    assert p.sum(axis=1) == pytest.approx(1.0, abs=1e-5)
    assert (p.argmax(axis=1) == truth).mean() > 0.93
    row = new[0].astype(np.float32)
    shares = []
    for node in forest.root:
        while forest.feature[node] >= 0:
            node = forest.child[node] + int(row[forest.feature[node]] > forest.limit[node])
        shares.append(forest.share[node])
    assert p[0] == pytest.approx(np.mean(shares, axis=0), abs=1e-6)


@pytest.mark.parametrize(
    ("label", "classes", "told"),
    [
        (np.zeros(10, np.int64), ("a", "b"), "all points have the same label"),
        (np.arange(10), ("a", "b"), "labels run from 0 to 9, but there are 2 classes"),
        (np.full(10, -1), ("a", "b"), "labels run from -1"),
        (np.zeros(0, np.int64), ("a", "b"), "10 points have 0 labels"),
    ],
)
def test_wrong_labels_are_told(label, classes, told):
    with pytest.raises(SegmentationError, match=told):
        grown(np.random.default_rng(0).random((10, 3)), label, classes, seed=0)


def test_features_are_their_definition():
    rng = np.random.default_rng(2)
    points, h = rng.uniform(0, 1, (300, 3)) * [1, 1, 0.3], 0.05
    found = point_features(points, h)
    low = points.min(axis=0)
    for s, edge in enumerate(EDGES):
        cell = np.floor((points - low) / (edge * h)).astype(int)
        for i in rng.integers(300, size=20):
            near = points[(np.abs(cell - cell[i]) <= 1).all(axis=1)]
            values, vectors = np.linalg.eigh(np.cov(near.T, bias=True).reshape(3, 3))
            l3, l2, l1 = np.maximum(values, 0)
            if l1 < 1e-12:
                continue
            own = dict(zip(PER_SCALE, found[i, s * 6 : s * 6 + 6], strict=True))
            assert own["linearity"] == pytest.approx((l1 - l2) / l1, abs=1e-5)
            assert own["planarity"] == pytest.approx((l2 - l3) / l1, abs=1e-5)
            assert own["scatter"] == pytest.approx(l3 / l1, abs=1e-5)
            assert own["curvature"] == pytest.approx(l3 / (l1 + l2 + l3), abs=1e-5)
            if l2 - l3 > 1e-3 * l1 and l1 - l2 > 1e-3 * l1:
                assert own["verticality"] == pytest.approx(1 - abs(vectors[2, 0]), abs=1e-4)
                assert own["rise"] == pytest.approx(abs(vectors[2, 2]), abs=1e-4)


def test_a_plane_and_a_line_have_the_features_of_their_names():
    g = np.stack(np.meshgrid(np.arange(40), np.arange(40)), -1).reshape(-1, 2) * 0.01
    flat = point_features(np.c_[g, np.zeros(len(g))], 0.01)
    middle = np.flatnonzero((np.abs(g - 0.2) < 0.05).all(axis=1))
    at = FEATURES.index("planarity_3h")
    assert flat[middle, at].min() > 0.6 and flat[middle, FEATURES.index("verticality_3h")].max() < 1e-6
    line = point_features(np.c_[np.zeros((200, 2)), 0.01 * np.arange(200)], 0.01)
    assert line[:, FEATURES.index("linearity_6h")].min() > 0.999 and line[:, FEATURES.index("rise_6h")].min() > 0.999


def test_features_do_not_follow_order_or_a_turn_about_the_vertical_by_a_right_angle():
    points = np.random.default_rng(3).uniform(0, 1, (500, 3))
    found = point_features(points, 0.1)
    order = np.random.default_rng(4).permutation(500)
    assert np.allclose(point_features(points[order], 0.1), found[order], atol=1e-6)


@pytest.mark.parametrize(("points", "h", "told"), [(np.full((5, 3), np.nan), 0.1, "not finite"), (np.zeros((5, 3)), 0.0, "at one place")])
def test_points_without_features_are_told(points, h, told):
    with pytest.raises(SegmentationError, match=told):
        point_features(points, h)


def test_most_frequent_is_the_mode_and_the_lowest_of_equals():
    assert most_frequent(np.array([0, 1, 1, 2]), np.array([[0, 1, 2, 3], [0, 1, 0, 1]]), 3).tolist() == [1, 0]


def test_weights_come_back_and_damage_is_told(tmp_path):
    weights = shipped_weights()
    arrays = arrays_of(weights)
    again = arrays_of(weights_of(arrays, "again"))
    assert all(np.array_equal(arrays[name], again[name]) for name in arrays)
    wrong = {
        "child": arrays["forest_child"] * 0,
        "feature": arrays["forest_feature"] + 99,
        "share": arrays["forest_share"] * np.nan,
    }
    for name, value in wrong.items():
        with pytest.raises(FormatError, match="do not fit together"):
            weights_of({**arrays, f"forest_{name}": value}, "w.npz")
    with pytest.raises(FormatError, match="do not fit together"):
        weights_of({**arrays, "network_w3": arrays["network_w3"][:-1]}, "w.npz")
    with pytest.raises(FormatError, match="not weights of this version"):
        weights_of({**arrays, "features": arrays["features"][::-1]}, "w.npz")
    path = tmp_path / "w.npz"
    path.write_bytes(b"PK nothing")
    with pytest.raises(FormatError, match=r"w\.npz: not weights of scan2fea"):
        read_weights(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_weights(tmp_path / "missing.npz")


def test_learned_names_the_points_of_a_room_it_has_not_seen():
    points, truth = classed_room(400_000)
    forest = shipped_weights().forest
    assert forest.classes == POINT_CLASSES
    found = classes_of_points(forest, points)
    assert (found.label == truth).mean() > 0.9
    assert (found.confidence > 0).all() and (found.confidence <= 1).all()
    segments = segment_scene(Scan(cloud=PointCloud.of(points)), SegmentationOptions(method="learned"))
    named = segments.labels >= 0
    roles = np.array(segments.kinds)[segments.labels[named]]
    wanted = np.array(["support", "support", "object", "object", "clutter"])[truth[named]]
    assert named.mean() > 0.97 and (roles == wanted).mean() > 0.9
    floor = np.bincount(segments.labels[(truth == 0) & named]).argmax()
    assert segments.kinds[floor] == "support" and (segments.labels[truth == 0] == floor).mean() > 0.85
