"""Closed forms of the sections, and the messages for dimensions that make none."""

import math

import numpy as np
import pytest

from scan2fea.errors import UsageError
from scan2fea.kernel.sections import PARAMETERS, chords_of, corner_factors, section, section_area, section_area_slopes, section_centroid

SIZES = {
    "L": ({"a": 0.16, "b": 0.1, "t": 0.012}, 0.012 * (0.16 + 0.1 - 0.012)),
    "I": ({"h": 0.22, "b": 0.11, "tw": 0.006, "tf": 0.0092}, 2 * 0.11 * 0.0092 + 0.006 * (0.22 - 2 * 0.0092)),
    "C": ({"h": 0.14, "b": 0.06, "tw": 0.007, "tf": 0.01}, 2 * 0.06 * 0.01 + 0.007 * (0.14 - 0.02)),
    "T": ({"h": 0.1, "b": 0.12, "tw": 0.008, "tf": 0.011}, 0.12 * 0.011 + 0.008 * (0.1 - 0.011)),
    "RHS": ({"h": 0.14, "b": 0.08, "t": 0.006}, 0.14 * 0.08 - (0.14 - 0.012) * (0.08 - 0.012)),
    "rect": ({"b": 0.1, "t": 0.01}, 0.001),
    "round": ({"d": 0.05}, math.pi * 0.025**2),
    "CHS": ({"d": 0.1, "t": 0.004}, math.pi * (0.05**2 - 0.046**2)),
}


@pytest.mark.parametrize("family", PARAMETERS)
def test_area_is_the_closed_form(family: str) -> None:
    values, area = SIZES[family]
    chord = 1e-3 if family in ("round", "CHS") else 1e-12
    assert section_area(section(family, values)) == pytest.approx(area, rel=chord)


@pytest.mark.parametrize("family", [f for f in PARAMETERS if f not in ("round", "CHS")])
def test_corners_are_linear_in_the_parameters(family: str) -> None:
    values, _ = SIZES[family]
    v = np.array([values[n] for n in PARAMETERS[family]])
    for loop, factors in zip(section(family, values).loops, corner_factors(family), strict=True):
        assert np.allclose(loop, np.einsum("kcp,p->kc", factors, v), atol=1e-15)


@pytest.mark.parametrize("family", PARAMETERS)
def test_outer_loop_is_counter_clockwise_holes_clockwise_and_edges_are_named(family: str) -> None:
    shape = section(family, SIZES[family][0])
    for i, (loop, names) in enumerate(zip(shape.loops, shape.face_names, strict=True)):
        x, y = loop.T
        signed = 0.5 * (np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y))
        assert (signed > 0) == (i == 0)
        assert len(names) == len(loop)


def test_centroid_of_the_thesis_beam() -> None:
    """Thesis notes, section 3: the centroid lies 34.11 mm from the outer faces."""
    centre = section_centroid(section("L", {"a": 0.127, "b": 0.127, "t": 0.00635}))
    assert centre == pytest.approx([0.03411, 0.03411], abs=5e-6)


def test_chords_keep_the_tolerance() -> None:
    n = chords_of(0.1, 1e-5)
    assert n % 4 == 0
    assert 0.1 * (1 - math.cos(math.pi / n)) <= 1e-5 * (1 + 1e-9)
    assert 0.1 * (1 - math.cos(math.pi / (n - 4))) > 1e-5


@pytest.mark.parametrize(
    ("family", "values", "says"),
    [
        ("X", {}, "choose one of L, I"),
        ("L", {"a": 0.1, "b": 0.1}, "'t' is missing"),
        ("L", {"a": 0.1, "b": 0.1, "t": -0.01}, "must be positive"),
        ("L", {"a": 0.1, "b": 0.05, "t": 0.05}, "less than 0.05 m"),
        ("RHS", {"h": 0.1, "b": 0.1, "t": 0.05}, "0.5 of h"),
        ("CHS", {"d": 0.1, "t": float("nan")}, "must be positive"),
    ],
)
def test_bad_dimensions_are_named(family: str, values: dict[str, float], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        section(family, values)


def test_slopes_of_the_area_are_the_closed_form() -> None:
    """L: A = t (a + b - t)."""
    slopes = section_area_slopes("L", {"a": 0.16, "b": 0.1, "t": 0.012, "length": 2.0})
    assert slopes == pytest.approx({"a": 0.012, "b": 0.012, "t": 0.16 + 0.1 - 2 * 0.012}, rel=1e-9)


def test_slopes_at_the_edge_of_what_is_a_section() -> None:
    """A flange all but as thick as the T is high: the difference steps over the edge, the slope is still exact."""
    h, b, tw, tf = 0.1, 0.1, 0.01, 0.1 - 1e-9
    slopes = section_area_slopes("T", {"h": h, "b": b, "tw": tw, "tf": tf})
    assert slopes["tf"] == pytest.approx(b - tw)
    assert slopes["h"] == pytest.approx(tw)
