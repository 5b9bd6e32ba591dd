"""Pictures of clouds, surfaces and scenes: what they say, and that nothing is invented where nothing is known."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from report.fake_out import angle_solid, boundary_of, plane, ring, scattered
from scan2fea.report.camera import look_at
from scan2fea.report.colours import BACKDROP, CATEGORIES, ORIGIN_COLOURS
from scan2fea.report.figures import PIN_SHARE, apart, camera_for, deviation_figure, origin_figure, points_figure, regions_figure, scene_figure
from scan2fea.types import PointCloud

RING = ring()
CAMERA = look_at(RING.vertices, width_px=200, height_px=128)


def pixels(figure):
    return np.asarray(Image.open(io.BytesIO(figure.png)).convert("RGB")).astype(int)


def near(picture, colour, tolerance=40):
    return (np.abs(picture - np.asarray(colour, int)).max(axis=2) < tolerance).sum()


def test_shares_of_the_origin_are_those_of_the_area():
    figure = origin_figure(RING, CAMERA)
    area = np.linalg.norm(np.cross(*(RING.vertices[RING.faces[:, k]] - RING.vertices[RING.faces[:, 0]] for k in (1, 2))), axis=1)
    share = 100 * area[RING.face_origin == 2].sum() / area.sum()
    assert f"invented {share:.3g} %" in figure.legend and "interpolated 0 %" in figure.legend
    assert figure.legend.count("hatched") == 1
    assert origin_figure(replace(RING, face_origin=None), CAMERA) is None


def test_measured_and_invented_show_in_their_colours():
    below = replace(CAMERA, axes=np.diag([1.0, -1.0, -1.0]))  # from below: the invented part
    above = replace(CAMERA, axes=np.eye(3))
    seen_above, seen_below = (pixels(origin_figure(RING, camera)) for camera in (above, below))
    assert near(seen_above, ORIGIN_COLOURS[0]) > 1000 and near(seen_above, ORIGIN_COLOURS[2]) == 0
    assert near(seen_below, ORIGIN_COLOURS[2]) > 500


def test_deviation_limits():
    figure = deviation_figure(RING, CAMERA, 0.0005)
    assert "limits 3 \u03c3" in figure.legend and "1.5 mm" in figure.legend and "no point near" in figure.legend
    assert "robust" in deviation_figure(RING, CAMERA, None).legend
    assert "robust" in deviation_figure(RING, CAMERA, 1e-6).legend  # three sigma would show one saturated colour
    assert "3 robust \u03c3" in deviation_figure(RING, CAMERA, None).chart


@pytest.mark.parametrize("values", [None, np.full(len(RING.vertices), np.nan)])
def test_no_deviation_no_figure(values):
    assert deviation_figure(replace(RING, deviation_m=values), CAMERA, 0.001) is None


def test_nothing_measured_has_no_deviation_and_zero_deviation_has_a_picture():
    assert deviation_figure(replace(RING, face_origin=np.full(len(RING.faces), 2)), CAMERA, 0.001) is None
    flat = deviation_figure(replace(RING, deviation_m=np.zeros(len(RING.vertices))), CAMERA, None)
    assert near(pixels(flat), [255, 255, 255], 60) > 1000


def test_cad_faces_largest_first():
    skin = boundary_of(angle_solid())
    camera = look_at(skin.vertices, width_px=200, height_px=128)
    figure = regions_figure(skin, camera, {"face_names": [f"web<{k}" for k in range(6)]})
    assert "web&lt;" in figure.legend and "6 faces" in figure.caption and figure.legend.count("<li>") == 6
    shares = [float(share) for share in re.findall(r"\(([0-9.]+) %\)", figure.legend)]
    assert shares == sorted(shares, reverse=True) and sum(shares) == pytest.approx(100, abs=0.2)
    assert "face 1" in regions_figure(skin, camera, {}).legend
    assert regions_figure(replace(skin, face_region=None), camera, {}) is None
    assert regions_figure(replace(skin, face_region=np.full(len(skin.faces), -1)), camera, {}) is None
    assert regions_figure(replace(skin, face_region=np.arange(len(skin.faces))), camera, {}) is None  # facets only: nothing to tell apart
    half = replace(skin, face_region=np.where(skin.face_region == 0, np.arange(len(skin.faces)) + 10, skin.face_region))
    assert "small faces and facets" in regions_figure(half, camera, {}).legend


def test_points_keep_the_colours_of_the_scan_and_show_what_was_inferred():
    cloud = scattered(RING, 3000, 0.0, 1)
    assert "3,000" in points_figure(cloud, CAMERA).caption
    red = cloud.replaced(colour=np.tile(np.array([250, 0, 0], np.uint8), (3000, 1)))
    assert near(pixels(points_figure(red, CAMERA)), [250, 0, 0], 90) > 500
    some = cloud.replaced(is_inferred=np.arange(3000) < 300)
    assert "10 %" in points_figure(some, CAMERA).legend and points_figure(cloud, CAMERA).legend == ""
    assert cloud.colour is None and red.colour.max() == 250


def test_camera_for_what_there_is():
    cloud = scattered(RING, 300, 0.0, 1)
    assert camera_for(None, None, 200) is None
    assert camera_for(PointCloud.of(np.zeros((0, 3))), None, 200) is None
    assert camera_for(cloud, None, 200).width_px == 200
    assert camera_for(None, RING, 200).width_px == 200
    with_nan = cloud.replaced(normals=np.full((300, 3), np.nan))
    assert np.isfinite(camera_for(with_nan, None, 200).axes).all()


def test_scene_has_a_pin_on_each_object():
    cloud, floor = scattered(RING, 4000, 0.0, 1), plane(np.array([1.6, 2.5, 0.7]), 1.0, 1.0, 4000, 2)
    both = PointCloud.of(np.concatenate([floor.points, cloud.points]))
    figure, pins = scene_figure(both, [None, cloud], width_px=300)
    assert set(pins) == {1} and 0.3 < pins[1][0] < 0.7 and 0.2 < pins[1][1] < 0.8
    assert near(pixels(figure), CATEGORIES[1]) > 1000 and near(pixels(figure), BACKDROP) > 1000
    figure, pins = scene_figure(both, [], width_px=300)
    assert not pins and near(pixels(figure), BACKDROP) > 1000
    assert scene_figure(None, [cloud], width_px=300)[1].keys() == {0}
    assert scene_figure(None, []) is None and scene_figure(PointCloud.of(np.zeros((0, 3))), [None]) is None


def test_pins_do_not_cover_each_other():
    crowd = {k: (0.5 + 0.001 * k, 0.5) for k in range(6)} | {9: (0.02, 0.03), 10: (0.02, 0.03)}
    found = apart(crowd, 0.56)
    at = np.array(list(found.values())) * [1.0, 0.56]
    gaps = np.linalg.norm(at[:, None] - at[None], axis=2)[np.triu_indices(len(at), 1)]
    assert list(found) == list(crowd) and gaps.min() > 0.9 * PIN_SHARE
    assert (at >= 0).all() and (at <= [1.0, 0.56]).all()
    lone = {1: (0.2, 0.2), 2: (0.8, 0.8)}
    assert {k: pytest.approx(v) for k, v in apart(lone, 0.5).items()} == lone and apart({}, 0.5) == {}
