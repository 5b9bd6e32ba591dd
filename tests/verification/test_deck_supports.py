"""Supports of decks: the rigid motion that they leave is named, and what holds by other cards is not refused."""

import numpy as np
import pytest

from fea.bars import bar
from fea.test_shell import SHAPES, member
from fea.test_wireframe import ANGLE, BAR, portal
from scan2fea.errors import FormatError
from scan2fea.fea import FeaOptions, build_model, write_inp
from scan2fea.fea.shell import write_shell_inp
from scan2fea.fea.wireframe import write_frame_inp
from scan2fea.pipeline.check_file import inspect_file

TETS = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n5,1,1,1\n*ELEMENT, TYPE=C3D4, ELSET=ALL\n1,1,2,3,4\n2,2,3,4,5\n*NSET, NSET=FOOT\n1,2,3\n"
FAR = "*NODE\n11,5,0,0\n12,6,0,0\n13,5,1,0\n14,5,0,1\n*ELEMENT, TYPE=C3D4, ELSET=ALL\n11,11,12,13,14\n"
HINGED = "*NODE\n11,5,0,0\n14,5,5,2\n*ELEMENT, TYPE=C3D4, ELSET=ALL\n11,2,5,11,14\n"
REFERENCE = "*NODE\n90,0,0,7\n91,0,0,8\n"
MATERIAL = "*MATERIAL, NAME=M\n*ELASTIC\n2e11,.3\n*SOLID SECTION, ELSET=ALL, MATERIAL=M\n"
STATIC, MODES = "*STEP\n*STATIC\n{}*END STEP\n", "*STEP\n*FREQUENCY\n4\n*END STEP\n"
LINE = "*NODE\n1,0,0,0\n2,1,0,0\n3,2,0,0\n*ELEMENT, TYPE=B31, ELSET=ALL\n1,1,2\n2,2,3\n" + MATERIAL.replace("SOLID", "BEAM")


def said(tmp_path, text):
    """The value and the words of the check of supports."""
    path = tmp_path / "deck.inp"
    path.write_text(text)
    check = next(c for c in inspect_file(path).checks if c.name == "deck.unsupported")
    if not check.passed:
        return check.says.split("singular: ")[1]
    return str(check.value) if "not told" in str(check.value) else ""


def solid(more="", boundary="", step=STATIC):
    return TETS + more + MATERIAL + (f"*BOUNDARY\n{boundary}\n" if boundary else "") + step.format("")


def test_our_decks_of_every_kind_are_held(tmp_path):
    assert not said(tmp_path, write_inp(build_model(bar((0.1, 0.1, 0.4), (1, 1, 3)))))
    floats = FeaOptions(supports=("none",), loads=("ALL gravity 0 0 -1",))  # three points hold it in the steps of its cases
    assert not said(tmp_path, write_inp(build_model(bar((0.1, 0.1, 0.4), (1, 1, 3)), floats)))
    assert not any(said(tmp_path, write_shell_inp(member(family))) for family in SHAPES)
    assert not any(said(tmp_path, write_frame_inp(portal(section))) for section in (BAR, ANGLE))


LIKE_TURNED = "*TRANSFORM, NSET=FOOT, TYPE=C\n0,0,0,0,0,1\n"
RIGID = REFERENCE + "*RIGID BODY, NSET=FOOT, REF NODE=90, ROT NODE=91\n"
UP, ANY = "free to turn about (0, 0, 1) through (0, 0, 0.4)", "free to turn about any axis through (0, 0, 0)"


@pytest.mark.parametrize(
    ("deck", "words"),
    [
        (solid(), "nothing holds it"),
        (solid(boundary="1, 1, 3"), ANY),
        (solid(boundary="1, ENCASTRE"), ANY),
        (solid(boundary="1, 1, 3\n3, 1, 3"), "free to turn about (0, 1, 0) through (0, 0.4, 0)"),
        (solid(boundary="FOOT, 3"), "free to move along (1, 0, 0), free to move along (0, 1, 0), " + UP.replace("(0, 0, 0.4)", "(0.4, 0.4, 0.4)")),
        (solid(boundary="FOOT, 1, 2\n4, 1, 2"), "free to move along (0, 0, 1)"),
        (solid(FAR, "FOOT, 1, 3"), "the part of element 11: nothing holds it"),
        (solid(HINGED, "FOOT, 1, 3"), "the part of element 11: free to turn about (0, 0.7071, 0.7071) through (1, 1.125, 1.125)"),
        (solid(LIKE_TURNED, "1, 1, 3\n2, 1\n2, 3\n3, 1\n3, 3"), UP),
        (solid("*TRANSFORM, NSET=FOOT\n0,1,0,-1,0,0\n", "FOOT, 1\nFOOT, 3"), "free to move along (1, 0, 0)"),
        (solid("*EQUATION\n2\n4, 3, 1., 1, 3, -1.\n", "FOOT, 1, 2\n4, 1, 2"), "free to move along (0, 0, 1)"),
        (solid(RIGID, "90, 1, 3\n91, 1, 2"), UP),
        (LINE + "*BOUNDARY\n1, 1, 3\n3, 2, 3\n" + STATIC.format(""), "free to turn about (1, 0, 0) through (1, 0, 0)"),
    ],
)
def test_the_motion_that_is_left_is_named(deck, words, tmp_path):
    assert said(tmp_path, deck) == f"step 1: {words}"


def test_a_step_that_lets_go_is_named(tmp_path):
    deck = solid(boundary="FOOT, 1, 3")
    assert said(tmp_path, deck + STATIC.format("*BOUNDARY, OP=NEW\n1, 1, 3\n") + MODES) == f"step 2: {ANY}"
    assert not said(tmp_path, deck + STATIC.format("*BOUNDARY\n1, 1, 3\n"))


SURFACES = "*NSET, NSET=OTHER\n11,12,13\n*SURFACE, NAME=A, TYPE=NODE\nOTHER\n*SURFACE, NAME=B, TYPE=NODE\nFOOT\n*SURFACE, NAME=S\n1, S1\n"
COUPLED = REFERENCE + SURFACES + "*COUPLING, REF NODE=90, SURFACE=S, CONSTRAINT NAME=C\n"


@pytest.mark.parametrize(
    "deck",
    [
        solid(boundary="FOOT, 1, 3"),
        solid(boundary="FOOT, PINNED"),
        solid(boundary="1, 1, 3\n2, 2, 3\n3, 3"),  # 3-2-1
        solid(step=MODES),  # modes of a free part
        solid(step=STATIC.format("*INERTIA RELIEF\n")),
        solid(FAR + SURFACES + "*TIE, NAME=T\nA, B\n", "FOOT, 1, 3"),
        solid(COUPLED + "*KINEMATIC\n1, 6\n", "90, 1, 6"),
        solid(COUPLED + "*DISTRIBUTING\n1, 6\n", "90, 1, 6"),
        solid(RIGID, "90, 1, 3\n91, 1, 3"),
        solid("*EQUATION\n2\n4, 3, 1., 1, 3, -2.\n", "FOOT, 1, 2\n4, 1, 2\n5, 3"),
        LINE + "*BOUNDARY\n1, 1, 4\n3, 2, 3\n" + STATIC.format(""),
    ],
)
def test_what_holds_is_not_refused(deck, tmp_path):
    assert not said(tmp_path, deck)


def test_cards_that_are_not_read_may_hold_it(tmp_path):
    spring = "*ELEMENT, TYPE=SPRING1, ELSET=SPRINGS\n50, 4\n*SPRING, ELSET=SPRINGS\n1\n1e3\n"
    found = said(tmp_path, solid(spring, "1, 1, 3"))
    assert found.startswith("not told: *SPRING, *ELEMENT, TYPE=SPRING1 may hold it; without: step 1: free to turn")
    assert said(tmp_path, solid("*MPC\nPLANE, 1, 2, 3, 4\n", "1, 1, 3")).startswith("not told: *MPC, PLANE may hold it")


@pytest.mark.parametrize(
    "cards", ["*EQUATION\ntwo\n", "*EQUATION\n2\n4, 3, 1.\n", "*TRANSFORM, NSET=FOOT\n0,1\n", "*NSET, NSET=A, GENERATE\n1, x\n"]
)
def test_cards_that_are_damaged_are_refused(cards, tmp_path):
    with pytest.raises(FormatError, match="cannot be read"):
        said(tmp_path, solid(cards, "FOOT, 1, 3"))


def test_place_and_size_change_no_verdict(tmp_path):
    for factor, shift in ((1.0, 0.0), (1e-3, 5.0), (1e3, -1e5)):
        nodes = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]) * factor + shift
        lines = "".join(f"{k}, {x!r}, {y!r}, {z!r}\n" for k, (x, y, z) in enumerate(nodes.tolist(), start=1))
        deck = solid(boundary="1, 1, 3\n3, 1, 3").replace(TETS[: TETS.index("*ELEMENT")], "*NODE\n" + lines)
        assert said(tmp_path, deck).startswith("step 1: free to turn about (0, 1, 0)")
