"""`scan2fea check` on decks of shells and beams: our own, and what is wrong with those of others."""

import numpy as np
import pytest

from fea.test_shell import LENGTH, SHAPES, member
from fea.test_wireframe import ANGLE, BAR, portal
from scan2fea.cli.main import main
from scan2fea.errors import FormatError
from scan2fea.fea.shell import write_shell_inp
from scan2fea.fea.wireframe import write_frame_inp
from scan2fea.pipeline.check_file import inspect_file
from scan2fea.units import UNIT_SYSTEMS
from scan2fea.verification.walls_and_bars import of_walls_and_bars

HEAD = "*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 1., 1., 0.\n4, 0., 1., 0.\n5, 3., 0., 0.\n6, 4., 0., 0.\n"
TAIL = "*MATERIAL, NAME=M\n*ELASTIC\n2e11, .3\n*SHELL SECTION, ELSET=E, MATERIAL=M\n.01\n*BOUNDARY\n1, 1, 6\n5, 1, 6\n*STEP\n*STATIC\n*END STEP\n"


def found(tmp_path, text):
    path = tmp_path / "deck.inp"
    path.write_text(text)
    return inspect_file(path)


@pytest.mark.parametrize("units", UNIT_SYSTEMS)
def test_our_deck_of_shells_has_the_area_of_its_walls(units, tmp_path):
    told = found(tmp_path, write_shell_inp(member("C"), units=UNIT_SYSTEMS[units]))
    d = SHAPES["C"]
    names = ["elements.shapeless", *(f"deck.{name}" for name in ("steps", "cards", "materials", "sets", "unsupported"))]
    assert told.passed and [c.name for c in told.checks] == names
    assert told.figures["area_m2"] == pytest.approx(LENGTH * (d["h"] - d["tf"] + 2 * (d["b"] - d["tw"] / 2)), rel=1e-9)
    assert told.figures["pieces"] == 1 and "beams" not in told.figures


@pytest.mark.parametrize("section", [BAR, ANGLE])
def test_our_deck_of_a_frame_has_the_length_of_its_members(section, tmp_path):
    text = write_frame_inp(portal(section))
    told = found(tmp_path, text)
    assert told.passed and told.figures["length_m"] == pytest.approx(6.0) and told.figures["pieces"] == 1
    if section is ANGLE:  # general sections hold their own density
        bare = found(tmp_path, text.replace(", DENSITY=", ", DENSITIES="))
        assert "MEMBER_01 has no density" in next(c.says for c in bare.checks if c.name == "deck.materials")


@pytest.mark.parametrize(
    ("elements", "area", "pieces"),
    [
        ("*ELEMENT, TYPE=S4R, ELSET=E\n1, 1, 2, 3, 4\n", 1.0, 1),
        ("*ELEMENT, TYPE=S3, ELSET=E\n1, 1, 2, 3\n2, 1, 3, 4\n", 1.0, 1),
        ("*ELEMENT, TYPE=S3, ELSET=E\n1, 1, 2, 3\n*ELEMENT, TYPE=B31, ELSET=E\n2, 5, 6\n", 0.5, 2),
    ],
)
def test_open_shells_are_no_surface_with_holes(elements, area, pieces, tmp_path):
    told = found(tmp_path, HEAD + elements + TAIL)
    assert told.passed and told.figures["area_m2"] == area and told.figures["pieces"] == pieces


@pytest.mark.parametrize(
    "element",
    ["S4, ELSET=E\n1, 1, 3, 2, 4\n", "S3, ELSET=E\n1, 1, 2, 5\n", "S4, ELSET=E\n1, 1, 2, 5, 3\n", "B31, ELSET=E\n1, 2, 2\n"],
    ids=["crossed", "flat", "corner of 180 degrees", "no length"],
)
def test_elements_without_a_shape_are_told(element, tmp_path, capsys):
    path = tmp_path / "deck.inp"
    path.write_text(HEAD + "*ELEMENT, TYPE=" + element + TAIL)
    assert main(["check", str(path)]) == 4
    assert "1 shells have no area" in capsys.readouterr().out


def test_a_node_that_is_not_there(tmp_path):
    with pytest.raises(FormatError, match="refers to a node that is not there"):
        found(tmp_path, HEAD + "*ELEMENT, TYPE=S4, ELSET=E\n1, 1, 2, 3, 9\n" + TAIL)


def test_size_and_place_change_nothing():
    x = np.random.default_rng(0).normal(size=(4, 3)) * [1, 1, 0.05]
    x = x[np.argsort(np.arctan2(x[:, 1], x[:, 0]))]
    cells = [("quad", np.array([[0, 1, 2, 3]])), ("line", np.array([[0, 2]]))]
    one, other = of_walls_and_bars(x, cells), of_walls_and_bars(1e-3 * x + 5, cells)
    assert other.figures["area_m2"] == pytest.approx(1e-6 * one.figures["area_m2"]) and other.checks == one.checks
    assert other.figures["length_m"] == pytest.approx(1e-3 * one.figures["length_m"])


def test_nodes_of_a_plane_are_refused_by_name(tmp_path):
    flat = "*NODE\n1, 0., 0.\n2, 1., 0.\n3, 1., 1.\n4, 0., 1.\n*ELEMENT, TYPE=S4, ELSET=E\n1, 1, 2, 3, 4\n"
    with pytest.raises(FormatError, match="4 lines of NODE hold 12 values: plane nodes are not read"):
        found(tmp_path, flat + TAIL)
