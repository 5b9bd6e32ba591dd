"""Sections whose faces lie on the lines of the points: found where a search from afar closes a wall up."""

import math

import numpy as np
import pytest

from scan2fea.estimation.fit import fit_section
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.on_lines import densest_run, lines, sections_on_lines
from scan2fea.estimation.plausible import implausible_price
from scan2fea.kernel.sections import PARAMETERS, edge_names, section
from scan2fea.types import PointCloud, Scan

SIZES = {
    "L": {"a": 0.152, "b": 0.102, "t": 0.0159},
    "C": {"h": 0.2, "b": 0.075, "tw": 0.0085, "tf": 0.0115},
    "I": {"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085},
    "T": {"h": 0.1, "b": 0.12, "tw": 0.01, "tf": 0.011},
    "RHS": {"h": 0.1, "b": 0.06, "t": 0.005},
}


def outline(family, n, rng, hidden=(), thin=()):
    """(m, 2) points spread evenly along the faces but the hidden ones; of the thin ones the outer half of a quarter of the points."""
    shape = section(family, SIZES[family])
    found = []
    for loop, names in zip(shape.loops, edge_names(family), strict=True):
        for a, b, name in zip(loop, np.roll(loop, -1, axis=0), names, strict=True):
            count = 0 if name in hidden else round(n * np.linalg.norm(b - a)) // (4 if name in thin else 1)
            at = rng.random(count) * (0.5 if name in thin else 1.0)
            found.append(a + at[:, None] * (b - a))
    return np.concatenate(found)


def turned(xy, roll):
    c, s = math.cos(roll), math.sin(roll)
    return xy @ np.array([[c, s], [-s, c]])


def test_lines_are_where_points_crowd():
    rng = np.random.default_rng(1)
    at = np.concatenate([place + 0.001 * rng.normal(size=400) for place in (0.0, 0.02, 0.1)] + [rng.uniform(-0.05, 0.15, 1000)])
    places, weights = lines(at, 0.001)
    assert places == pytest.approx([0.0, 0.02, 0.1], abs=3e-4)
    assert (weights > 300).all() and (weights < 500).all()


def test_no_lines_among_even_points():
    assert len(lines(np.random.default_rng(2).uniform(0, 1, 3000), 0.01)[0]) == 0


@pytest.mark.parametrize("family", SIZES)
@pytest.mark.parametrize("roll", [0.0, 0.3, 1.4])
def test_whole_outlines_give_their_sections_at_every_roll(family, roll):
    rng = np.random.default_rng(3)
    xy = turned(outline(family, 8_000, rng), roll) + 3e-4 * rng.normal(size=2) + [0.5, -0.2]
    xy = xy + 3e-4 * rng.normal(size=xy.shape)
    found = sections_on_lines(xy, family, roll, 3e-4)
    true = np.array([SIZES[family][name] for name in PARAMETERS[family]])
    assert min(float(np.abs(values - true).max()) for values, _, _ in found) < 1e-3
    for values, turn, place in found:
        if np.abs(values - true).max() < 1e-3 and family in "CLT":  # which way they face is told
            assert math.cos(turn - roll) == pytest.approx(1.0)
            assert place == pytest.approx([0.5, -0.2], abs=3e-3)


def test_one_direction_tells_the_wall_of_both_legs():
    rng = np.random.default_rng(4)
    xy = outline("L", 20_000, rng, hidden=("B_INNER",), thin=("A_INNER",))
    xy += 3e-4 * rng.normal(size=xy.shape)
    values = sections_on_lines(xy, "L", 0.0, 3e-4)[0][0]
    assert values == pytest.approx([0.152, 0.102, 0.0159], abs=5e-4)


def one_leg_and_a_toe(rng, strays=0.15):
    """(n, 2) points of both faces of one leg of the angle and of the other leg's toe, among even strays: no face across x was seen."""
    xy = outline("L", 8_000, rng, hidden=("A_OUTER", "A_INNER", "B_TOE"))
    xy = xy + 1e-3 * rng.normal(size=xy.shape)
    low, high = xy.min(axis=0), xy.max(axis=0)
    return np.concatenate([xy, rng.uniform(low - 0.01, high + 0.01, (round(strays / (1 - strays) * len(xy)), 2))])


def test_a_run_is_where_points_are_dense():
    rng = np.random.default_rng(7)
    along = np.sort(np.concatenate([rng.uniform(0.2, 0.5, 300), rng.uniform(0.0, 1.0, 100)]))
    low, high = densest_run(along)
    assert along[[low, high]] == pytest.approx([0.2, 0.5], abs=0.01)
    assert densest_run(np.array([0.3])) == (0, 0)


@pytest.mark.parametrize("roll", [0.0, 2.2])
def test_where_no_face_was_seen_its_neighbours_end(roll):
    xy = turned(one_leg_and_a_toe(np.random.default_rng(8)), roll)
    found = sections_on_lines(xy, "L", roll, 1e-3)
    assert min(float(np.abs(values - [0.152, 0.102, 0.0159]).max()) for values, _, _ in found) < 3e-3


def test_sections_on_lines_alone_stay_where_ends_stand_in():
    """Ends had taken their place: a real girder, seen like this, was told as an angle that does not explain its points."""
    hidden = ("BOTTOM_OUTER", "BOTTOM_TOE_LEFT", "BOTTOM_TOE_RIGHT", "TOP_INNER_LEFT", "TOP_INNER_RIGHT", "TOP_TOE_RIGHT")
    rng = np.random.default_rng(12)
    xy = outline("I", 8_000, rng, hidden=hidden)
    found = [values for values, _, _ in sections_on_lines(xy + 4e-4 * rng.normal(size=xy.shape), "I", 0.0, 4e-4)]
    assert found[0] == pytest.approx([0.1915, 0.1, 0.0056, 0.0056], abs=5e-4)  # as deep as the faces that were seen, its flange as thick as its web


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_one_leg_and_the_toe_of_the_other_are_an_angle(seed):
    """They were a channel or an I with a belief of 1: the search never came to the angle, likelier by hundreds of units."""
    rng = np.random.default_rng([9, seed])
    xy = one_leg_and_a_toe(rng)
    fit = fit_section(np.column_stack([xy, rng.uniform(0, 1.5, len(xy))]), z_range=(0.0, 1.5))
    assert fit.family == "L" and fit.families["L"] > 0.99
    assert fit.value("a") == pytest.approx(0.152, abs=1e-3) and fit.value("t") == pytest.approx(0.0159, abs=5e-4)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_wall_whose_faces_lie_on_one_line_is_begun_at_two_sigma(seed):
    """A wall of 2.7 sigma: lines told none, so that the angle was no hypothesis, and an I or a flat won."""
    rng = np.random.default_rng([13, seed])
    xy = outline("L", 8_000, rng, hidden=("A_OUTER", "A_INNER", "B_TOE"))
    found = sections_on_lines(xy + 6e-3 * rng.normal(size=xy.shape), "L", 0.0, 6e-3)
    assert any(values[2] == pytest.approx(0.012) and values[:2] == pytest.approx([0.152, 0.102], abs=0.012) for values, _, _ in found)


@pytest.mark.parametrize("angle", [3.5, 4.0, 4.5])
def test_where_faces_were_cut_they_tell_no_wall(angle):
    """Half a box tube had been an angle of which the wall was what was left of a side; it was built."""
    rng = np.random.default_rng(14)
    xy = outline("RHS", 20_000, rng, hidden=("LEFT_INNER", "BOTTOM_INNER"))
    xy = (xy + 4e-4 * rng.normal(size=xy.shape))[(xy - xy.mean(axis=0)) @ [math.cos(angle), math.sin(angle)] > 0]
    assert all(values[2] < 0.01 for values, _, _ in sections_on_lines(xy, "L", 0.0, 4e-4))


def test_three_outer_faces_are_a_tube_s_as_well_as_a_bar_s():
    """The bar had a belief of 0.9997."""
    rng = np.random.default_rng(10)
    xy = outline("RHS", 20_000, rng, hidden=("TOP_OUTER", "TOP_INNER", "BOTTOM_INNER", "LEFT_INNER", "RIGHT_INNER"))
    xy = xy + 5e-4 * rng.normal(size=xy.shape)
    fit = fit_section(np.column_stack([xy, rng.uniform(0, 1.5, len(xy))]), z_range=(0.0, 1.5))
    assert 0.2 < fit.families["RHS"] < 0.8 and 0.2 < fit.families["rect"] < 0.8


def test_round_sections_and_flats_have_none():
    xy = np.random.default_rng(5).normal(size=(500, 2))
    assert not any(sections_on_lines(xy, family, 0.0, 0.01) for family in ("CHS", "round", "rect"))


def test_an_angle_whose_legs_shade_each_other_is_no_channel():
    """From three stations: of the inner faces one was not seen, the other in part and a quarter as densely. It was a channel with 10 % strays."""
    rng = np.random.default_rng(6)
    xy = outline("L", 28_000, rng, hidden=("B_INNER",), thin=("A_INNER",))
    points = np.column_stack([xy, rng.uniform(0, 1.12, len(xy))])
    points = points + 3e-4 * rng.normal(size=points.shape)
    found = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions())
    assert found.explains and found.member.family == "L"
    for name, value in SIZES["L"].items():
        told = next(p for p in found.member.parameters if p.name == name)
        assert told.observable and abs(told.value_m - value) < 4 * told.std_m


@pytest.mark.parametrize(("tw", "b", "is_none"), [(0.0345, 0.07, False), (0.0355, 0.07, True), (0.0345, 0.068, True)])
def test_a_web_of_three_flanges_or_half_the_width_is_not_made(tw, b, is_none):
    assert (implausible_price("C", {"h": 0.2, "b": b, "tw": tw, "tf": 0.0117}) > 0) == is_none
