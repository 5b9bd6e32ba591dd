"""Outlines with true arcs, and sweeps along bent axes."""

import math

import numpy as np
import pytest

from scan2fea.errors import UsageError
from scan2fea.kernel.outline import outline, outline_area, outline_moments
from scan2fea.kernel.sections import PARAMETERS, section, section_area, section_centroid

SIZES = {
    "L": {"a": 0.16, "b": 0.1, "t": 0.012},
    "I": {"h": 0.22, "b": 0.11, "tw": 0.006, "tf": 0.0092},
    "C": {"h": 0.14, "b": 0.06, "tw": 0.007, "tf": 0.01},
    "T": {"h": 0.1, "b": 0.12, "tw": 0.008, "tf": 0.011},
    "RHS": {"h": 0.14, "b": 0.08, "t": 0.006},
    "rect": {"b": 0.1, "t": 0.01},
    "round": {"d": 0.05},
    "CHS": {"d": 0.1, "t": 0.004},
}
N_ROOTS = {"L": 1, "I": 4, "C": 2, "T": 2, "rect": 0}


@pytest.mark.parametrize("family", PARAMETERS)
def test_sharp_outline_is_the_section(family):
    sharp = outline(family, SIZES[family])
    polygon = section(family, SIZES[family], n_chords=4000)
    assert outline_area(sharp) == pytest.approx(section_area(polygon), rel=1e-6)
    area, moment = outline_moments(sharp)
    assert area == pytest.approx(outline_area(sharp), rel=1e-13)
    assert moment / area == pytest.approx(section_centroid(polygon), abs=1e-9)
    assert sharp.names == tuple(dict.fromkeys(name for loop in polygon.face_names for name in loop))


@pytest.mark.parametrize("family", N_ROOTS)
def test_each_root_adds_its_corner(family):
    """A square of side r less a quarter of a circle: (1 - pi / 4) r^2."""
    r = 0.009
    rounded = outline(family, SIZES[family], r)
    assert sum(name.startswith("ROOT_") for name in rounded.names) == N_ROOTS[family]
    more = outline_area(rounded) - outline_area(outline(family, SIZES[family]))
    assert more == pytest.approx(N_ROOTS[family] * (1 - math.pi / 4) * r**2, rel=1e-10, abs=1e-18)
    assert outline_moments(rounded)[0] == pytest.approx(outline_area(rounded), rel=1e-13)


def test_corners_of_hollow_sections_are_rounded_inside_and_outside():
    r, t = 0.009, SIZES["RHS"]["t"]
    rounded = outline("RHS", SIZES["RHS"], r)
    less = outline_area(outline("RHS", SIZES["RHS"])) - outline_area(rounded)
    assert less == pytest.approx((4 - math.pi) * (r**2 - (r - t) ** 2), rel=1e-10)
    assert len(rounded.names) == 16 and outline("RHS", SIZES["RHS"], 0.005).names[-4:] == ("LEFT_INNER", "TOP_INNER", "RIGHT_INNER", "BOTTOM_INNER")


@pytest.mark.parametrize("family", PARAMETERS)
def test_edges_form_closed_smooth_loops(family):
    for loop in outline(family, SIZES[family], 0.004).loops:
        for edge, after in zip(loop, (*loop[1:], loop[0]), strict=True):
            assert np.allclose(edge.end, after.start, atol=1e-15)
            if edge.centre is not None:
                assert np.linalg.norm(edge.end - edge.centre) == pytest.approx(edge.radius, rel=1e-12)


def test_radii_that_do_not_fit():
    with pytest.raises(UsageError, match="does not fit"):
        outline("L", SIZES["L"], 0.2)
    with pytest.raises(UsageError, match="must be 0 or more"):
        outline("L", SIZES["L"], -0.001)
