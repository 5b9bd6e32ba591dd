"""`scan2fea check` on Nastran decks: ours, and what is wrong with those of others, in every form of its fields."""

import pytest

from fea.bars import bar
from scan2fea.cli.main import main
from scan2fea.errors import FormatError
from scan2fea.fea import build_model
from scan2fea.fea.bdf import write_bdf
from scan2fea.io.bdf import number
from scan2fea.pipeline.check_file import inspect_file

DECK = write_bdf(build_model(bar((0.1, 0.1, 0.4), (1, 1, 3))))
HEAD = "SOL 101\nCEND\nSPC = 1\nLOAD = 2\nBEGIN BULK\n"
TETS = "GRID,1\nGRID,2,,1.,0.,0.\nGRID,3,,0.,1.,0.\nGRID,4,,0.,0.,1.\nGRID,5,,1.,1.,1.\nCTETRA,1,1,1,2,3,4\nCTETRA,2,1,2,3,4,5\nPSOLID,1,1\n"
REST = "MAT1,1,2.1+11,,.3,7850.\nGRAV,2,,9.81,0.,0.,-1.\nENDDATA\n"


def failed(tmp_path, text):
    path = tmp_path / "deck.bdf"
    path.write_text(text)
    return {c.name: c.says for c in inspect_file(path).checks if c.name.startswith("deck") and not c.passed}


def supports(tmp_path, bulk, control=""):
    return failed(tmp_path, control + HEAD + TETS + bulk + REST).get("deck.unsupported", "")


def test_our_deck_passes(tmp_path, capsys):
    assert failed(tmp_path, DECK) == {}
    assert main(["check", str(tmp_path / "deck.bdf")]) == 0 and "deck.unsupported" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("bulk", "words"),
    [
        ("SPC1,1,123,1\n", "free to turn about any axis through (0, 0, 0)"),
        ("SPC1,1,3,1,THRU,3\n", "free to move along (1, 0, 0), free to move along (0, 1, 0), free to turn about (0, 0, 1)"),
        ("SPC,1,1,123,0.,3,123,0.\n", "free to turn about (0, 1, 0)"),
        ("SPC1,7,123,1,2,3\n", "nothing holds it"),
        ("SPC1           1     123       1\n", "free to turn about any axis"),
        ("GRID,9,,0.,0.,9.\nRBE2,50,9,123,1,2,3\nSPC1,1,12345,9\n", "free to turn about (0, 0, 1)"),
    ],
)
def test_the_motion_that_is_left_is_named(bulk, words, tmp_path):
    assert words in supports(tmp_path, bulk)


@pytest.mark.parametrize(
    ("bulk", "control"),
    [
        ("SPC1,1,123,1,2,3\n", ""),
        ("SPC1*,1,123,1,2\n*,3\n", ""),
        ("SPCADD,1,5,6\nSPC1,5,123,1,2\nSPC1,6,3,3\n", ""),
        ("GRID,9,,0.,0.,9.\nRBE2,50,9,123,1,2,3\nSPC1,1,123456,9\n", ""),
        ("GRID,9,,0.,0.,9.\nRBE3,50,,9,123456,1.,123,1,2,\n,3\nSPC1,1,123456,9\n", ""),
        ("MPC,8,4,3,1.,1,3,-2.\nSPC1,1,12,1,2,3,4\nSPC1,1,3,5\n", "MPC = 8\n"),
        ("PARAM,INREL,-2\nSPC1,1,3,1\n", ""),
        ("CELAS2,70,1e3,4,1\nSPC1,1,123,1\n", ""),
    ],
)
def test_what_holds_is_not_refused(bulk, control, tmp_path):
    assert supports(tmp_path, bulk, control) == ""


@pytest.mark.parametrize(
    ("old", "new", "name", "says"),
    [
        ("SPC = 1", "SPC = 4", "deck.sets", "SPC_4 (*BOUNDARY)"),
        ("LOAD = 2", "LOAD = 5", "deck.sets", "LOAD_5 (*CLOAD)"),
        (",7850.", "", "deck.materials", "MAT_1 has no density"),
        ("PSOLID,1,1", "PSOLID,1,3", "deck.materials", "no material MAT_3"),
        ("PSOLID,1,1", "PSOLID,2,1", "deck.materials", "no material OF PROPERTY 1"),
        ("SOL 101\n", "", "deck.steps", "0 steps"),
        ("CTETRA,2", "CTETAR,2", "deck.cards", "CTETAR: is CTETRA meant?"),
        ("SPC1,1,123", "SCP1,1,123", "deck.cards", "SCP1: is SPC1 meant?"),
        ("MAT1,1", "MTA1,1", "deck.cards", "MTA1: is MAT1 meant?"),
    ],
)
def test_what_is_missing_is_named(old, new, name, says, tmp_path):
    assert says in failed(tmp_path, (HEAD + TETS + "SPC1,1,123,1,2,3\n" + REST).replace(old, new))[name]


def test_other_cards_are_not_taken_for_misspelt_ones(tmp_path):
    bulk = "SPC1,1,123,1,2,3\nRBAR,70,1,2,123456,,,123456\nDLOAD,9,1.,1.,8\nPLOAD2,8,1.,1\nCORD2R,7\nMAT8,5\nEPOINT,80\nTEMP,1,1,20.\nGRDSET\n"
    assert failed(tmp_path, HEAD + TETS + bulk + REST) == {}


def test_subcases_hold_by_themselves_and_modes_need_nothing(tmp_path):
    cases = HEAD.replace("BEGIN", "SUBCASE 1\nSPC = 1\nSUBCASE 2\nSPC = 3\nBEGIN")
    bulk = TETS + "SPC1,1,123,1,2,3\nSPC1,3,123,1\n" + REST
    assert failed(tmp_path, cases + bulk)["deck.unsupported"].endswith("step 2: free to turn about any axis through (0, 0, 0)")
    assert failed(tmp_path, cases.replace("SOL 101", "SOL 103") + bulk) == {}


def test_reals_without_their_letter():
    assert [number(w) for w in ("7.85-9", "-1.+3", "2.1E+11", "1.D3", "-.5")] == [7.85e-9, -1e3, 2.1e11, 1e3, -0.5]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("GRID,1\n", "no BEGIN BULK"),
        (HEAD + "INCLUDE 'mesh.bdf'\n", "includes another file"),
        (HEAD + "CHEXA,1,1,1,2,3,4,5,6,\n,7,8\n", "elements CHEXA"),
        (HEAD + TETS.replace("GRID,2,,", "GRID,2,7,"), "node 2 is given in a system of its own"),
        (HEAD + TETS.replace("1,1,2,3,4", "1,1,2,3"), "CTETRA 1 has 3 nodes"),
        (HEAD + TETS.replace("GRID,2,,1.", "GRID,2,,x"), "a card GRID cannot be read"),
        (HEAD + "ENDDATA\n", "it is no mesh"),
        (HEAD + TETS + REST.replace("ENDDATA\n", ""), "no ENDDATA"),
        (HEAD + TETS + "SPC1,1,123,1,THRU,x\n" + REST, "cannot be read"),
        ("SOL\n" + HEAD[8:] + TETS + "RBE2\n" + REST, "cannot be read"),
    ],
)
def test_what_cannot_be_read_is_refused(text, says, tmp_path):
    with pytest.raises(FormatError, match=says):
        failed(tmp_path, text)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("2.1+11", "-2.1+11", "MAT_1 has a Young's modulus of -2.1e+11"),
        (",.3,", ",.7,", "MAT_1 has a Poisson's ratio of .7"),
        ("GRAV,2,,9.81,0.,0.,-1.", "FORCE,2,77,,9.,0.,0.,-1.", "node 77 (*CLOAD)"),
    ],
)
def test_numbers_that_no_solver_takes_are_named(old, new, words, tmp_path):
    deck = HEAD + TETS + "SPC1,1,123,1,2,3\n" + REST
    for sound in (deck, deck.replace("GRAV,2,,9.81", "FORCE,2,5,,9."), deck.replace(",.3,", ",,")):
        assert failed(tmp_path, sound) == {}
    assert words in " ".join(failed(tmp_path, deck.replace(old, new)).values())


def test_an_element_that_is_numbered_twice(tmp_path):
    with pytest.raises(FormatError, match="numbers element 1 twice"):
        failed(tmp_path, HEAD + TETS.replace("CTETRA,2,", "CTETRA,1,") + REST)
