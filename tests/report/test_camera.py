"""The view: orthonormal, everything inside, long things across, the measured side in front."""

from __future__ import annotations

import numpy as np
import pytest

from report.fake_out import turned
from scan2fea.report.camera import MARGIN, look_at, look_down

RNG = np.random.default_rng(0)
BEAM = RNG.uniform(-0.5, 0.5, (500, 3)) * [3.0, 0.2, 0.1]


def inside(camera, points):
    x, y = camera.project(points)[:, :2].T
    edge = MARGIN * 0.9
    return (
        x.min() >= edge * camera.width_px
        and x.max() <= (1 - edge) * camera.width_px
        and y.min() >= edge * camera.height_px
        and y.max() <= (1 - edge) * camera.height_px
    )


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("turn", range(6))
def test_everything_is_inside_and_a_beam_lies_across(scale, turn):
    rotation = turned(RNG.normal(size=3), float(turn))
    points = scale * BEAM @ rotation.T + [1e5, -3e4, 12.0]
    camera = look_at(points)
    assert np.allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.axes) == pytest.approx(1)
    assert inside(camera, points)
    along = camera.turned(rotation[:, 0])
    assert abs(along[0]) > 0.75  # the beam lies across the picture
    assert 0.42 * 450 - 1 <= camera.height_px <= 450  # and the picture is as low as it may be


def test_up_stays_up_and_nearness_grows_towards_the_viewer():
    camera = look_at(BEAM)
    assert camera.axes[1] @ [0, 0, 1] > 0.85
    ends = camera.project(np.array([camera.centre, camera.centre + camera.axes[2], camera.centre + camera.axes[1], camera.centre + camera.axes[0]]))
    assert ends[0, 0] == pytest.approx(camera.width_px / 2) and ends[0, 1] == pytest.approx(camera.height_px / 2)
    assert ends[1, 2] > ends[0, 2]
    assert ends[2, 1] < ends[0, 1] and ends[3, 0] > ends[0, 0]
    assert ends[3, 0] - ends[0, 0] == pytest.approx(1 / camera.m_per_px)


def test_a_column_is_laid_down():
    assert abs(look_at(BEAM[:, [2, 1, 0]]).turned(np.array([0.0, 0.0, 1.0]))[0]) > 0.75


def test_the_measured_side_is_shown():
    plate = RNG.uniform(-0.5, 0.5, (400, 3)) * [1.0, 0.7, 0.01]
    for side in (np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])):
        assert look_at(plate, normals=np.tile(side, (10, 1))).axes[2] @ side > 0
    everywhere = np.concatenate([np.eye(3), -np.eye(3)])
    assert np.array_equal(look_at(plate, normals=everywhere).axes, look_at(plate).axes)  # nothing to choose: from above


@pytest.mark.parametrize(
    "points", [np.zeros((1, 3)), np.ones((5, 3)), np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.array([[0.0, 0, 0], [0, 0, 1.0], [0, 0, 2.0]])]
)
def test_degenerate_things_have_a_view(points):
    for camera in (look_at(points), look_down(points)):
        assert np.isfinite(camera.project(points)).all() and camera.m_per_px > 0
        assert np.allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)


def test_a_scene_is_framed_without_its_lone_points():
    scene = np.concatenate([RNG.uniform(0, 1, (5000, 3)), [[1000.0, 0.0, 0.0]]])
    assert look_down(scene).width_m < 5
