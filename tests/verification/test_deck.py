import pytest

from fea.bars import bar
from scan2fea.cli.main import main
from scan2fea.errors import FormatError
from scan2fea.fea import build_model, write_inp
from scan2fea.pipeline.check_file import inspect_file
from scan2fea.verification.cards import cards_of
from scan2fea.verification.deck import _misspelt, missing_sets

DECK = write_inp(build_model(bar((0.1, 0.1, 0.4), (1, 1, 3))))


def failed(text, tmp_path):
    path = tmp_path / "model.inp"
    path.write_text(text)
    return {c.name: c.says for c in inspect_file(path).checks if not c.passed}


def test_our_deck_passes(tmp_path):
    assert failed(DECK, tmp_path) == {}


@pytest.mark.parametrize(
    ("old", "new", "name", "says"),
    [
        ("LOWEST, 1, 3", "FLOOR, 1, 3", "deck.sets", "FLOOR (*BOUNDARY)"),
        ("ELSET=BODY, MATERIAL=MATERIAL", "ELSET=BODI, MATERIAL=MATERIAL", "deck.sets", "BODI (*SOLID SECTION)"),
        ("MATERIAL=MATERIAL", "MATERIAL=IRON", "deck.materials", "no material IRON"),
        ("*DENSITY", "*CONDUCTIVITY", "deck.materials", "MATERIAL has no density"),
        ("*ELASTIC", "*PLASTIC", "deck.materials", "MATERIAL is not elastic"),
        ("*STEP", "*STOP", "deck.steps", "0 steps"),
        ("*STEP", "*STOP", "deck.cards", "*STOP: is *STEP meant?"),
        ("*BOUNDARY", "*BUONDARY", "deck.cards", "*BUONDARY: is *BOUNDARY meant?"),
        ("*END STEP", "", "deck.cards", "0 *END STEP"),
        ("*SOLID SECTION, ELSET=BODY", "*ELSET, ELSET=ONE\n1\n*SOLID SECTION, ELSET=ONE", "deck.materials", "the first is 2"),
        ("*ELASTIC\n", "*ELASTIC\n-", "deck.materials", "MATERIAL has a Young's modulus of -"),
        ("*DENSITY\n", "*DENSITY\nheavy", "deck.materials", "MATERIAL has a density of heavy"),
        ("*BOUNDARY", "** nothing", "deck.unsupported", "nothing holds it"),
    ],
)
def test_what_is_missing_is_named(old, new, name, says, tmp_path):
    assert says in failed(DECK.replace(old, new), tmp_path)[name]


def test_what_one_letter_makes_of_a_card():
    def told(word):
        return _misspelt(cards_of(f"*{word}\n"))

    assert all(told(word) for word in ("CLAOD", "BUONDARY", "NOD", "STEPP", "DENSITE", "ENDSTEP"))
    assert not any(told(word) for word in ("CLOAD", "DLOAD", "PLASTIC", "NODE FILE", "EL FILE", "TIE", "SHELL GENERAL SECTION", "HEADING"))


def test_a_load_on_a_node_that_is_not_there(tmp_path):
    assert "node 77777 (*CLOAD)" in failed(DECK.replace("*DLOAD", "*CLOAD\n77777, 3, -1.\n1, 3, -1.\n*DLOAD", 1), tmp_path)["deck.sets"]


def test_an_element_that_is_numbered_twice(tmp_path):
    with pytest.raises(FormatError, match="numbers element 1 twice"):
        failed(DECK.replace("*NSET", "*ELEMENT, TYPE=C3D10\n1,1,2,3,4,5,6,7,8,9,10\n*NSET", 1), tmp_path)


def test_cards_go_on_over_lines_and_forget_comments():
    cards = cards_of("** a\n*Elset, elset=A,\n generate\n 1, 5, 1\n\n*Cload\nN1, 2, -1.\n12, 3, 4.\n")
    assert [c.word for c in cards] == ["ELSET", "CLOAD"] and cards[0].options == {"ELSET": "A", "GENERATE": ""}
    assert cards[0].data == (("1", "5", "1"),) and missing_sets(cards) == ["N1 (*CLOAD)"]


def test_a_set_that_holds_nothing_is_none():
    deck = "*ELEMENT, TYPE=C3D4, ELSET=ALL\n1,1,2,3,4\n*NSET, NSET=TIP\n*NSET, NSET=BODY, ELSET=ALL\n*CLOAD\nTIP,3,-1.\nBODY,3,-1.\n"
    assert missing_sets(cards_of(deck)) == ["TIP (*CLOAD)"]
    assert missing_sets(cards_of(deck + "*NSET, NSET=TIP\n4\n")) == [] == missing_sets(cards_of(deck + "*NSET, NSET=TIP, INPUT=tip.txt\n"))


def test_the_command(tmp_path, capsys):
    path = tmp_path / "model.inp"
    path.write_text(DECK)
    assert main(["check", str(path)]) == 0 and "deck.sets" in capsys.readouterr().out
    path.write_text(DECK.replace("LOWEST, 1, 3", "FLOOR, 1, 3"))
    assert main(["check", str(path)]) == 4 and "FLOOR (*BOUNDARY)" in capsys.readouterr().out
    path.write_text("*INCLUDE, INPUT=mesh.inp\n" + DECK)
    assert main(["check", str(path)]) == 3 and "mesh.inp is not there" in capsys.readouterr().err


def test_a_step_file(tmp_path, capsys):
    pytest.importorskip("OCP")
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    def write(*shapes):
        writer = STEPControl_Writer()
        for shape in shapes:
            writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
        writer.Write(str(tmp_path / "part.step"))
        return str(tmp_path / "part.step")

    box = BRepPrimAPI_MakeBox(10.0, 20.0, 30.0).Shape()
    assert main(["check", write(box)]) == 0 and "6e-06" in capsys.readouterr().out
    assert main(["check", write(box, BRepPrimAPI_MakeBox(1.0, 1.0, 1.0).Shape())]) == 4 and "holds 2 solids" in capsys.readouterr().out
    (tmp_path / "part.step").write_text("no step")
    assert main(["check", str(tmp_path / "part.step")]) == 3 and "is no STEP file" in capsys.readouterr().err
