"""What users write for a section."""

import pytest

from scan2fea.errors import UsageError
from scan2fea.estimation.designation import parse_designation


@pytest.mark.parametrize(
    ("text", "family", "millimetres"),
    [
        ("L127x127x6.35", "L", {"a": 127, "b": 127, "t": 6.35}),
        ("l 127X6.35", "L", {"a": 127, "b": 127, "t": 6.35}),
        ("L5x5x1/4 in", "L", {"a": 127, "b": 127, "t": 6.35}),
        ('L 5x3-1/2x1/4"', "L", {"a": 127, "b": 88.9, "t": 6.35}),
        ("I200x100x5.6x8.5", "I", {"h": 200, "b": 100, "tw": 5.6, "tf": 8.5}),
        ("C 200 x 75 x 8.5 x 11.5 mm", "C", {"h": 200, "b": 75, "tw": 8.5, "tf": 11.5}),
        ("T100x120x10x11", "T", {"h": 100, "b": 120, "tw": 10, "tf": 11}),
        ("RHS100x60x5", "RHS", {"h": 100, "b": 60, "t": 5}),
        ("SHS 100x5", "RHS", {"h": 100, "b": 100, "t": 5}),
        ("CHS 0.1143x0.006 m", "CHS", {"d": 114.3, "t": 6}),
        ("FL100x10", "rect", {"b": 100, "t": 10}),
        ("RD 5 cm", "round", {"d": 50}),
        ("HE 140 A", "I", {"h": 133, "b": 140, "tw": 5.5, "tf": 8.5}),
        ("w8x31", "I", {"h": 203, "b": 203, "tw": 7.24, "tf": 11}),
        ("L5X5X5/16", "L", {"a": 127, "b": 127, "t": 7.94}),
    ],
)
def test_designations(text, family, millimetres):
    found = parse_designation(text)
    assert found.family == family
    assert {k: 1e3 * v for k, v in found.parameters.items()} == pytest.approx(millimetres)


def test_letters_alone_are_a_family():
    assert parse_designation("L").parameters == {}
    assert parse_designation("HE 140 A").shape.root_radius_m == pytest.approx(0.012)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("HE 140 XX", "did you mean HE 140"),
        ("X33", "names no section"),
        ("", "names no section"),
        ("L1x2x3x4", "L takes 3 numbers, a x b x t; there are 4"),
        ("L10x10", "t is 0.01 m; it must be less than 0.01 m"),
        ("L5x5x1/4", "a fraction but no unit"),
        ("L5x5x1/0 in", "'1/0' is not a number"),
        ("L100x1.2.3x4", r"'1\.2\.3' is not a number"),
        ("CHS -5x1", "not a number|names no section|must be positive"),
    ],
)
def test_what_is_wrong_is_said(text, says):
    with pytest.raises(UsageError, match=says):
        parse_designation(text)
