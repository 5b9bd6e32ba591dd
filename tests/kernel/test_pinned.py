"""What seen faces fix: every face together all of it, and by hand which two faces fix which dimension."""

import pytest

from scan2fea.kernel.pinned import pinned
from scan2fea.kernel.sections import PARAMETERS, edge_names


@pytest.mark.parametrize("family", list(PARAMETERS))
def test_all_faces_fix_every_dimension_and_none_fixes_nothing(family):
    faces = [name for loop in edge_names(family) for name in loop]
    assert pinned(family, faces) == set(PARAMETERS[family])
    assert pinned(family, []) == set()


@pytest.mark.parametrize(
    ("family", "seen", "fixed"),
    [
        ("L", ("A_OUTER", "B_OUTER", "A_TOE", "B_TOE"), {"a", "b"}),  # four sides of a box: no wall was seen from both sides
        ("L", ("A_OUTER", "A_INNER", "B_OUTER"), {"t"}),
        ("L", ("A_OUTER", "A_INNER", "B_INNER", "B_TOE", "A_TOE"), {"a", "b", "t"}),  # the back of one leg follows from the other's wall
        ("T", ("FLANGE_OUTER", "FLANGE_INNER_LEFT", "WEB_LEFT", "WEB_RIGHT"), {"tw", "tf"}),  # an I of which half was seen: h is open
        ("I", ("TOP_OUTER", "TOP_INNER_LEFT", "BOTTOM_INNER_LEFT", "TOP_TOE_LEFT", "TOP_TOE_RIGHT", "WEB_LEFT"), {"h", "b", "tw", "tf"}),
        ("I", ("TOP_OUTER", "TOP_INNER_LEFT", "BOTTOM_INNER_LEFT", "TOP_TOE_LEFT", "BOTTOM_TOE_LEFT"), {"h", "tf"}),
        ("C", ("TOP_OUTER", "TOP_INNER", "WEB_OUTER", "WEB_INNER", "TOP_TOE"), {"b", "tw", "tf"}),
        ("rect", ("LEFT", "RIGHT"), {"b"}),
        ("rect", ("LEFT", "TOP"), set()),
        ("RHS", ("LEFT_OUTER", "RIGHT_OUTER", "TOP_OUTER", "BOTTOM_OUTER"), {"h", "b"}),
        ("CHS", ("OUTER",), {"d"}),
        ("CHS", ("INNER",), set()),
        ("round", ("OUTER",), {"d"}),
    ],
)
def test_by_hand(family, seen, fixed):
    assert pinned(family, seen) == fixed
