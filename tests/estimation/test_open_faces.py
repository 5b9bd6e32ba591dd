"""A face of the hull of which one part was seen and the rest is bare from end to end: an open section that looks like a closed one."""

import numpy as np
import pytest

from estimation.made import made, scanned
from scan2fea.estimation.open_faces import open_face

TUBE = made("RHS", 1.5, {"h": 0.2, "b": 0.08, "t": 0.003})  # h along y, b along x
BEAM = made("I", 1.5, {"h": 0.2, "b": 0.1, "tw": 0.004, "tf": 0.004})
BAR = made("rect", 1.5, {"b": 0.2, "t": 0.08})


def points_of(member, n=12_000, seed=0):
    return scanned(member, n, 0.0005, seed)


def between_lips(points, lip=0.02):
    """On the wall at +x, farther than `lip` from the corners."""
    return (points[:, 0] > 0.03) & (np.abs(points[:, 1]) < 0.1 - lip)


def test_a_whole_section_is_not_open():
    for member in (TUBE, BEAM, BAR, made("C"), made("L"), made("T"), made("CHS")):
        assert open_face(points_of(member), member) == ""


@pytest.mark.parametrize("stations", [4, 6])
def test_lines_of_scanners_along_the_member_leave_strips_between_them(stations):
    """Levelled scanners before a column: their lines run along it, and where those of all stations lie near to each other a strip is bare."""
    rng, points = np.random.default_rng(1), points_of(BAR, 20_000)
    x, station = points[:, 0] + 0.1, np.arange(len(points)) % stations
    is_lined = (np.abs(points[:, 1]) > 0.039) & (x > 0.0005) & (x < 0.1995)
    for _ in range(40):
        apart = 0.006 * np.sqrt(stations) * rng.uniform(0.9, 1.1, stations)[station]  # of the lines of one station
        first = apart * rng.random(stations)[station]
        lined = np.clip(np.round((x - first) / apart) * apart + first + rng.normal(0, 0.001, len(x)), 0.0, 0.2) - 0.1  # noise along slanting rays
        assert open_face(np.column_stack([np.where(is_lined, lined, points[:, 0]), points[:, 1:]]), BAR) == ""


@pytest.mark.parametrize("lip", [0.015, 0.04, 0.08])
def test_a_lipped_channel_is_no_tube(lip):
    points = points_of(TUBE)
    assert "RIGHT_OUTER of the RHS member is bare" in open_face(points[~between_lips(points, lip)], TUBE)
    hidden = between_lips(points, lip) | ((points[:, 0] > 0.0385) & (points[:, 0] < 0.0395))
    assert open_face(points[~hidden], TUBE)  # lips of which the outer side alone was seen


@pytest.mark.parametrize("seed", range(4))
def test_a_slit_of_a_spacing_shows_where_points_lie_in_no_lines(seed):
    """A square tube with a slit of 14 mm, points 14.5 mm apart, had been told as closed."""
    points = points_of(TUBE, 4_000, seed)  # 20 mm apart
    assert open_face(points, TUBE) == ""
    assert "is bare" in open_face(points[~between_lips(points, 0.088)], TUBE)  # 24 mm


def test_a_wall_seen_from_one_side_or_not_at_all_is_none():
    points = points_of(TUBE)
    outer = between_lips(points) & (points[:, 0] > 0.0385)
    assert open_face(points[~outer], TUBE) == ""  # its inner side was seen
    assert open_face(points[points[:, 0] < 0.035], TUBE) == ""  # it lies on the floor: no part of it was seen
    half = between_lips(points) & (points[:, 2] < 0.75)
    assert open_face(points[~half], TUBE) == ""  # bare over half of the length: `cuts.py` and `holes.py`


def test_an_inner_side_may_be_hidden_by_the_web():
    points = points_of(BEAM)
    x, y, _ = points.T
    seen = (y > 0.0985) | (x < -0.0015) & (y < 0.0985) & (y > -0.098)  # from above and from the left: of the lower flange its inner side there
    assert open_face(points[seen], BEAM) == ""


def test_what_lies_on_the_face_hides_it():
    points = points_of(TUBE)
    y, z = (g.ravel() for g in np.meshgrid(np.linspace(-0.09, 0.09, 40), np.linspace(-0.1, 1.6, 300)))
    plate = np.stack([np.full(len(y), 0.041), y, z], 1)
    assert open_face(points[~between_lips(points)], TUBE, (plate,)) == ""
    assert open_face(points[~between_lips(points)], TUBE, (plate + [0.2, 0, 0],)) != ""


def test_a_zed_is_no_beam_and_a_channel_no_bar():
    points = points_of(BEAM)
    absent = (points[:, 0] * np.sign(points[:, 1]) < -0.004) & (np.abs(points[:, 1]) > 0.09)
    assert "OUTER of the I member is bare" in open_face(points[~absent], BEAM)
    points = points_of(BAR)
    x, y = np.abs(points[:, 0]), points[:, 1]
    assert "TOP of the rect member is bare" in open_face(points[~((y > 0.035) & (x < 0.08))], BAR)


def test_lines_of_a_scanner_along_the_member_are_no_slots():
    points = points_of(TUBE, 40_000)
    x, y = points[:, 0], points[:, 1]
    on_lines = np.abs((y + 0.1) / 0.025 - np.round((y + 0.1) / 0.025)) < 0.15
    assert open_face(points[on_lines | (np.abs(x) < 0.035)], TUBE) == ""
