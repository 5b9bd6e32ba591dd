"""The axis of a member: its sag is drawn to the stated factor, damage stands where it is, broken records draw nothing."""

import re

import numpy as np
import pytest
from numpy.polynomial import legendre

from scan2fea.report.axis import DRAWN_SAG, LEFT, RIGHT, WIDTH, axis_drawing


def member(**more):
    return {"parameters": {"length": {"value_m": 4.0}}, "bow_m": [[0.004], [0.0]], "T_world_member": np.eye(4).tolist(), "damage": [], **more}


def lines(drawing):
    return [np.array([p.split(",") for p in found.split()], float) for found in re.findall(r'<polyline points="([^"]+)"', drawing)]


def test_the_sag_is_that_of_the_series_from_the_line_between_the_ends():
    drawing = str(axis_drawing(member()))
    x, y = lines(drawing)
    # P2 is 1 at the ends and -1/2 in the middle: 1.5 x 4 mm
    assert "largest sag 6 mm" in drawing and legendre.legval(0.0, [0, 0, 0.004]) - 0.004 == pytest.approx(-0.006)
    factor = float(re.search(r"drawn ([\d\u202f]+) times", drawing)[1].replace("\u202f", ""))
    scale = (WIDTH - LEFT - RIGHT) / 4.0
    assert np.ptp(x[:, 1]) == pytest.approx(factor * scale * 0.006, abs=0.2) and np.ptp(x[:, 1]) <= DRAWN_SAG + 0.1
    assert np.ptp(y[:, 1]) == 0.0 and x[0, 1] == x[-1, 1]


def test_a_straight_whole_member_needs_no_drawing():
    assert axis_drawing(member(bow_m=[[], []])) == ""


def test_damage_stands_where_it_is():
    drawing = str(axis_drawing(member(bow_m=[[], []], damage=[{"position_m": [0.1, 0.0, 1.0]}])))
    x = float(re.search(r'<path d="M([\d.]+)', drawing)[1]) + 4
    assert x == pytest.approx(LEFT + (WIDTH - LEFT - RIGHT) / 4, abs=0.1) and "1 places of damage" in drawing


@pytest.mark.parametrize(
    "broken", [{"bow_m": "x"}, {"bow_m": [[1, 2], [3]]}, {"bow_m": [[float("nan")], [0.0]]}, {"damage": [{"position_m": "x"}]}, {"T_world_member": 3}]
)
def test_broken_records_do_not_stop_the_page(broken):
    axis_drawing(member(**broken))
    assert axis_drawing({"parameters": {"length": {"value_m": "long"}}}) == ""
