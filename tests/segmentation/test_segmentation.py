"""Methods, radius, supports, select: on scenes whose answer is known."""

import dataclasses

import numpy as np
import pytest

from scan2fea.errors import SegmentationError, UsageError
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area
from scan2fea.kernel.neighbors import radius_components
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.transforms import random_rotation, rigid, rotation_about
from scan2fea.segmentation import METHODS, SegmentationOptions, SelectOptions, segment_scene, select
from scan2fea.segmentation.euclidean import absorbed, euclidean
from scan2fea.segmentation.planes import large_planes
from scan2fea.segmentation.radius import link_radius
from scan2fea.simulation import sampling, shapes
from scan2fea.simulation.lab17 import SPACING_M, lab17
from scan2fea.types import PointCloud, Rays, Scan, Segments

H = 0.01


def sampled(mesh, seed=0, h=H, sigma=0.0005):
    """Points on all faces of a solid, mean distance to 6 neighbours about h."""
    points, _ = sample_surface(mesh, round(area(mesh) * (0.978 / h) ** 2), seed)
    return points + sigma * np.random.default_rng(seed).standard_normal(points.shape)


def placed(mesh, t, R=None):
    return shapes.posed(mesh, rigid(np.eye(3) if R is None else R, t))


def floor(x=3.0, y=2.0, seed=7, h=H, sigma=0.0005):
    rng = np.random.default_rng(seed)
    n = round(x * y * (0.978 / h) ** 2)
    return np.c_[rng.random(n) * x, rng.random(n) * y, sigma * rng.standard_normal(n)]


def seen_from_above(points):
    """Without the resting face."""
    return points[points[:, 2] > 0.003]


def covered(points, things):
    """Floor points that no footprint hides."""
    free = np.ones(len(points), bool)
    for thing in things:
        low, high = thing[:, :2].min(axis=0), thing[:, :2].max(axis=0)
        free &= ~((points[:, :2] > low) & (points[:, :2] < high)).all(axis=1)
    return points[free]


def segmented(parts, options=SegmentationOptions(), sensor=None):
    points = np.concatenate(parts)
    cloud = PointCloud.of(points)
    rays = None
    if sensor is not None:
        away = points - sensor
        distance = np.linalg.norm(away, axis=1)
        rays = Rays(origin=np.tile(sensor, (len(points), 1)), direction=away / distance[:, None], range_m=distance)
        cloud = cloud.replaced(ray=np.arange(len(points)))
    found = segment_scene(Scan(cloud=cloud, rays=rays), options)
    truth = np.repeat(np.arange(len(parts)), [len(p) for p in parts])
    return found, truth


def label_of(found, truth, part):
    """The label most of the part's points have, and the share that has it."""
    labels = found.labels[truth == part]
    values, counts = np.unique(labels, return_counts=True)
    return int(values[counts.argmax()]), counts.max() / len(labels)


# ---- radius


def test_radius_of_even_sheets_rings_and_stripes():
    sheet = floor(1, 1)
    assert link_radius(sheet) == pytest.approx(3.4 * H, rel=0.1)
    angle = np.linspace(0, 2 * np.pi, 1500, endpoint=False)
    rings = np.concatenate([np.c_[r * np.cos(angle), r * np.sin(angle), np.zeros(1500)] for r in np.linspace(1, 2, 26)])
    radius = link_radius(rings)  # 4 mm along the rings, 40 mm across
    assert 0.04 < radius < 0.12
    assert radius_components(rings, radius).max() == 0
    assert np.isnan(link_radius(np.zeros((5, 3))))


def test_radius_follows_scale_and_ignores_motion():
    sheet = floor(1, 1)
    moved = 1000 * (sheet @ random_rotation(1).T + 3.0)
    assert link_radius(moved) == pytest.approx(1000 * link_radius(sheet), rel=0.05)


# ---- methods


def test_dense_and_sparse_parts_each_with_their_own_radius():
    dense = [sampled(placed(shapes.box(0.1, 0.1, 0.1), (x, 0, 0)), h=0.002) for x in (0.0, 0.112)]  # 12 mm apart, six spacings
    sparse = sampled(placed(shapes.box(1, 1, 1), (0.5, 0, 0)), h=0.02)
    found, truth = segmented([*dense, sparse])
    assert len(found.kinds) == 3
    assert all(label_of(found, truth, k)[1] == 1 for k in range(3))


def test_a_part_of_uneven_density_stays_whole():
    sheet = floor(1, 1, h=0.02)
    patch = floor(0.3, 0.3, h=0.002) + np.array([0.3, 0.3, 0])
    labels = euclidean(PointCloud.of(np.concatenate([sheet, patch])))
    assert np.bincount(labels).max() > 0.999 * len(labels)


def test_given_radius_equals_brute_force_and_is_checked():
    points = np.concatenate([floor(0.2, 0.2), floor(0.2, 0.2) + np.array([0, 0, 0.05])])
    labels = euclidean(PointCloud.of(points), SegmentationOptions(radius_m=0.03))
    assert len(np.unique(labels)) == 2
    assert len(np.unique(euclidean(PointCloud.of(points), SegmentationOptions(radius_m=0.06)))) == 1
    for radius in (-1.0, float("nan"), 10.0):
        with pytest.raises(SegmentationError, match=r"segmentation\.radius_m"):
            euclidean(PointCloud.of(points), SegmentationOptions(radius_m=radius))


def test_absorbed_joins_what_is_near_and_drops_what_is_far():
    points = np.array([[x, 0, 0] for x in (0, 1, 2, 3)] + [[4.9, 0, 0]] + [[9.0, 0, 0]], float)
    labels = absorbed(points, radius_components(points, 1.0), 1.0, 3)
    assert labels.tolist() == [0, 0, 0, 0, 0, -1]
    on_limit = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [4.0, 0, 0]], float)
    assert absorbed(on_limit, radius_components(on_limit, 1.0), 1.0, 3).tolist() == [0, 0, 0, 0]


def test_given_labels_and_single():
    cloud = PointCloud.of(np.zeros((5, 3)), label=np.array([7, -1, 3, 7, 3]))
    found = segment_scene(Scan(cloud=cloud), SegmentationOptions(method="given"))
    assert found.labels.tolist() == [1, -1, 0, 1, 0]
    assert found.kinds == ("object", "object")
    with pytest.raises(SegmentationError, match="--labels"):
        segment_scene(Scan(cloud=PointCloud.of(np.zeros((5, 3)))), SegmentationOptions(method="given"))
    assert segment_scene(Scan(cloud=cloud), SegmentationOptions(method="single")).labels.tolist() == [0] * 5
    with pytest.raises(UsageError, match="euclidean, kmeans, fuzzy_cmeans, agglomerative, divisive, learned, primitives, given, single"):
        segment_scene(Scan(cloud=cloud), SegmentationOptions(method="eucledean"))
    assert set(METHODS) == {"euclidean", "kmeans", "fuzzy_cmeans", "agglomerative", "divisive", "learned", "primitives", "given", "single"}


# ---- what is one object stays one object, whatever its planes


BODIES = {
    "l_beam": shapes.l_beam(0.12, 0.12, 0.02, 1.0),
    "i_beam": shapes.i_beam(0.2, 0.15, 0.02, 0.02, 0.8),
    "plate": shapes.plate(0.4, 0.02, 0.6),
    "box": shapes.box(0.3, 0.2, 0.1),
    "rhs": shapes.rhs(0.2, 0.15, 0.02, 0.6),
    "bracket": shapes.bracket(0.3, 0.3, 0.02, 0.3, [("a", 0.15, 0.15, 0.05), ("b", 0.15, 0.15, 0.04)]),
    "table": shapes.table(0.8, 0.6, 0.5, 0.04, 0.08, 0.05),
    "tank": shapes.tank(0.2, 0.4, 0.03),
}


@pytest.mark.parametrize("name", BODIES)
def test_one_object_with_all_its_points(name):
    found, _ = segmented([sampled(placed(BODIES[name], (5, 1, 2), random_rotation(3)))])
    assert found.kinds == ("object",)
    assert (found.labels == 0).all()


def test_open_scans_are_no_support():
    """A sheet seen from one side; an angle seen from inside; a box without its bottom; the other leg of a one-sided T."""
    sheet = floor(1, 1)
    wall = floor(1, 1, seed=8)[:, [0, 2, 1]]
    rib = floor(1, 0.2, seed=9)[:, [0, 2, 1]] + [0, 0.5, 0]
    box = sampled(shapes.box(0.6, 0.5, 0.4))
    for parts in ([sheet], [sheet, wall], [sheet, rib], [box[box[:, 2] > 0.003]]):
        found, _ = segmented(parts)
        assert found.kinds == ("object",)


@pytest.mark.parametrize(("length", "is_floor"), [(0.44, True), (0.54, False)])
def test_what_follows_half_of_a_border_is_a_leg_and_no_floor_is_left(length, is_floor):
    """A bent profile of which a scanner saw the leg in part: the ends of the leg are not those of the plane, but the leg follows it."""
    leg = seen_from_above(sampled(placed(shapes.box(length, 0.04, 0.1), (0.1, 0, 0))))
    found, _ = segmented([covered(floor(1.0, 0.3), [leg]), leg])
    assert ("support" in found.kinds) == is_floor


def test_a_column_on_its_base_plate_is_one_object():
    plate = floor(0.3, 0.3)
    column = sampled(placed(shapes.rhs(0.1, 0.1, 0.02, 1.5), (0.1, 0.1, 0.0)))
    found, _ = segmented([covered(plate, [column]), seen_from_above(column)])
    assert found.kinds == ("object",)


# ---- floors


def things():
    box = placed(shapes.box(0.4, 0.3, 0.3), (0.5, 0.5, 0), rotation_about((0, 0, 1), 0.3))
    drum = placed(shapes.cylinder(0.15, 0.4), (1.5, 1.0, 0))
    post = placed(shapes.rhs(0.1, 0.1, 0.01, 1.2), (2.3, 1.4, 0))
    return [seen_from_above(sampled(mesh, seed)) for seed, mesh in enumerate((box, drum, post))]


@pytest.mark.parametrize("sensor", [None, (1.0, 1.0, 5.0)])
@pytest.mark.parametrize("seed", [0, 4])
def test_things_on_a_floor_part_from_it_and_keep_their_points(sensor, seed):
    scene = things()
    parts = [covered(floor(), scene), *scene]
    T = rigid(random_rotation(seed), [10, -3, 2]) if seed else np.eye(4)
    moved = [p @ T[:3, :3].T + T[:3, 3] for p in parts]
    found, truth = segmented(moved, sensor=None if sensor is None else T[:3, :3] @ np.array(sensor) + T[:3, 3])
    assert sorted(found.kinds) == ["object"] * 3 + ["support"]
    for part, points in enumerate(parts):
        label, share = label_of(found, truth, part)
        assert (found.labels[truth != part] == label).mean() < 1e-3
        # what lies in the floor's band of 4 sigma may go with it, nothing more
        assert share > 0.999 if part == 0 else share >= (points[:, 2] > 0.0035).mean() - 1e-9


def test_the_tails_of_a_floors_noise_stay_with_it():
    """A small thing amid a large floor that is noisier in the middle: what strays beyond the floor's band had joined it from metres away."""
    ground = floor(6.0, 6.0, h=0.02, sigma=1.0)
    near = 1.0 / (1.0 + np.linalg.norm(ground[:, :2] - 3.0, axis=1))
    ground[:, 2] *= 0.0012 * near
    thing = seen_from_above(sampled(placed(shapes.cylinder(0.08, 0.2), (3.0, 3.0, 0.0)), h=0.007))
    found, truth = segmented([covered(ground, [thing]), thing])
    assert found.kinds == ("support", "object")
    assert (found.labels[truth == 0] == 1).sum() < 30
    assert found.how["radius_m"] < 0.05


def test_a_floor_seen_from_the_wrong_side_is_kept():
    """With the sensor below, what sticks up are pockets of a body seen from its open side."""
    scene = things()
    found, _ = segmented([covered(floor(), scene), *scene], sensor=(1.0, 1.0, -5.0))
    assert "support" not in found.kinds


def test_a_box_on_a_table_on_a_floor():
    table = sampled(placed(shapes.table(1.0, 0.8, 0.6, 0.04, 0.08, 0.05), (1, 0.5, 0)))
    box = sampled(placed(shapes.box(0.25, 0.2, 0.15), (1.3, 0.8, 0.6)), 3)
    box = box[box[:, 2] > 0.603]
    top = (np.abs(table[:, 2] - 0.6) < 0.003) & (table[:, 0] > 1.3) & (table[:, 0] < 1.55) & (table[:, 1] > 0.8) & (table[:, 1] < 1.0)
    table = seen_from_above(table[~top])
    found, truth = segmented([floor(), table, box])
    assert found.kinds == ("support", "object", "object")
    assert label_of(found, truth, 1)[1] > 0.999
    assert label_of(found, truth, 2)[1] > 0.97


def test_slabs_that_touch_nothing_are_floor_and_wall():
    ground = sampled(placed(shapes.box(2, 2, 0.07), (0, 0, -0.1)))
    wall = sampled(placed(shapes.box(0.07, 2, 1.5), (-0.2, 0, 0.06)))
    beam = sampled(placed(shapes.l_beam(0.15, 0.15, 0.02, 1.2), (0.3, 0.4, 0.2)))
    crate = sampled(placed(shapes.box(0.3, 0.3, 0.3), (1.2, 1.2, 0.2)))
    found, truth = segmented([ground, wall, beam, crate])
    kind = [found.kinds[label_of(found, truth, part)[0]] for part in range(4)]
    assert kind == ["support", "support", "object", "object"]
    assert min(label_of(found, truth, part)[1] for part in range(4)) == 1


def on_slab(height, *, n_beside=2, thick=0.07):
    """A slab of which both faces are there, a crate that stands on it and touches it, and other things above it."""
    parts = [sampled(placed(shapes.box(3, 2, thick), (0, 0, -thick)), 1), sampled(placed(shapes.box(0.3, 0.4, height), (1.2, 1.1, 0.0)), 2)]
    top = parts[0][:, 2] > -0.01
    parts = [np.concatenate([covered(parts[0][top], [parts[1]]), parts[0][~top]]), seen_from_above(parts[1])]
    beside = (shapes.l_beam(0.15, 0.15, 0.02, 1.2), (0.3, 0.3, 0.2)), (shapes.box(0.2, 0.2, 0.2), (0.5, 1.4, 0.3))
    return parts + [sampled(placed(*one), 3 + k) for k, one in enumerate(beside[:n_beside])]


def test_what_stands_on_a_slab_and_touches_it_is_a_thing_of_its_own():
    """The slab with the crate was one object, built as a flat."""
    found, truth = segmented(on_slab(0.5))
    kind = [found.kinds[label_of(found, truth, part)[0]] for part in range(4)]
    assert kind == ["support", "object", "object", "object"]
    assert min(label_of(found, truth, part)[1] for part in range(4)) > 0.98
    turn = random_rotation(5)
    again, _ = segmented([points @ turn.T + [3, 1, -2] for points in on_slab(0.5)])
    assert again.kinds == found.kinds


@pytest.mark.parametrize(("height", "n_beside", "thick"), [(1.2, 2, 0.07), (0.5, 1, 0.07), (0.5, 2, 0.12)])
def test_a_tall_thing_on_a_plate_or_a_plate_alone_or_a_thick_one_is_one_body(height, n_beside, thick):
    """A column on its base plate; a boss on a flange; a block."""
    found, truth = segmented(on_slab(height, n_beside=n_beside, thick=thick))
    assert label_of(found, truth, 0)[0] == label_of(found, truth, 1)[0]
    assert found.kinds[label_of(found, truth, 0)[0]] == "object"


def test_supports_can_be_switched_off():
    scene = things()
    found, _ = segmented([covered(floor(), scene), *scene], SegmentationOptions(supports=False))
    assert found.kinds == ("object",)


def test_same_bytes_again_and_input_untouched():
    scene = things()
    points = np.concatenate([covered(floor(), scene), *scene])
    cloud = PointCloud.of(points)
    before = cloud.points.tobytes()
    a, b = segment_scene(Scan(cloud=cloud)), segment_scene(Scan(cloud=cloud))
    assert a.labels.tobytes() == b.labels.tobytes()
    assert a.how == b.how
    assert cloud.points.tobytes() == before


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((1, 3)), np.ones((500, 3)), np.c_[np.arange(500.0), np.zeros((500, 2))]])
def test_degenerate_clouds_do_not_break(points):
    found = segment_scene(Scan(cloud=PointCloud.of(points)))
    assert len(found.labels) == len(points)
    assert found.labels.max(initial=-1) + 1 == len(found.kinds)


# ---- select


def test_select_orders_by_size_then_first_point_and_says_what_it_left_out():
    labels = np.array([0] * 5 + [1] * 600 + [2] * 900 + [3] * 600 + [-1] * 3 + [4] * 2000)
    segments = Segments(labels=labels, kinds=("object", "object", "object", "object", "support"), how={})
    cloud = PointCloud.of(np.zeros((len(labels), 3)))
    chosen = select(cloud, segments)
    assert chosen.labels == (2, 1, 3)
    assert any("a support, which carries or bounds the rest (select.kinds) (1 segment, label 4)" in note for note in chosen.notes)
    assert any("fewer than 500 points" in note and "label 0)" in note for note in chosen.notes)
    assert select(cloud, segments, given={0}).labels == (2, 1, 3, 0)  # a segment with faces may have any number of vertices
    assert select(cloud, segments, SelectOptions(max_objects=1)).labels == (2,)
    assert select(cloud, segments, SelectOptions(kinds=("support",))).labels == (4,)
    assert select(cloud, segments, SelectOptions(min_points=600)).labels == (2, 1, 3)  # on the limit
    assert select(cloud, segments, SelectOptions(min_points=601)).labels == (2,)
    assert select(cloud, segments, dataclasses.replace(SelectOptions(), min_share=0.7)).labels == (2,)


def test_every_plane_has_points_in_its_band():
    """Few exact points of thin-walled bodies: a plane of least squares may lie between two sheets, on neither (it was a fault inside)."""
    cloud = sampling.sampled(lab17(), sampling.SamplingOptions(method="grid", spacing_m=SPACING_M), 0).cloud
    drawn = cloud.take(sampled_rows(len(cloud), 40_000, 0))
    for body in (2, 5, 9):
        points = drawn.points[drawn.label == body]
        assert all((np.abs(plane.height(points)) <= plane.band_m).any() for plane in large_planes(points, 4, 0.05))
