"""`scan2fea fit`: the table, member.json, exit codes."""

import json

import numpy as np
import pytest

import real_scans
from estimation.made import made, scanned
from predicates import rotation
from scan2fea.cli.main import main
from scan2fea.io import write_cloud_ply
from scan2fea.types import PointCloud

L = {"a": 0.127, "b": 0.1, "t": 0.00635}


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """An L of 1.5 m with noise of 1 mm, in metres."""
    path = tmp_path_factory.mktemp("fit") / "beam.ply"
    member = made("L", 1.5, L, R=rotation(1), shift=(2, 1, 0), sigma=0.001)
    write_cloud_ply(path, PointCloud.of(scanned(member, 6000, 0.001, 3)), {})
    return path


def test_dimensions_with_their_errors(beam, tmp_path, capsys):
    out = tmp_path / "member.json"
    assert main(["fit", str(beam), "--unit", "m", "--family", "L", "-o", str(out)]) == 0
    told = capsys.readouterr().out
    for word in ("dimension", "observable", "the points", "sigma", "catalogue", "6 of 6 seen", "another thickness"):
        assert word in told, word
    row = json.loads(out.read_text(encoding="utf-8"))
    assert row["schema"] == "scan2fea member 1" and row["family"] == "L" and row["explains"] is True and row["n_points"] == 6000
    for name, true in {**L, "length": 1.5}.items():
        found = row["parameters"][name]
        assert found["observable"] and abs(found["value_m"] - true) < 5 * found["std_m"] + 1e-5, (name, found)
    assert row["damage"] == [] and 0.99 < sum(e["probability"] for e in row["catalogue"]) <= 1.000001


def test_the_outer_size_is_told_where_no_wall_is(tmp_path, capsys):
    """A wall of 6.35 mm under 12 mm of noise: a dozen sizes of the catalogue, of which all but one in a hundred are 127 x 127."""
    path = tmp_path / "noisy.ply"
    member = made("L", 3.0, {"a": 0.127, "b": 0.127, "t": 0.00635}, R=rotation(1), sigma=0.012)
    write_cloud_ply(path, PointCloud.of(scanned(member, 12000, 0.012, 3)), {})
    assert main(["fit", str(path), "--unit", "m", "--family", "L"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if "outer size" in line)
    assert "127 x 127 mm of the catalogue, whatever the walls" in line


def test_given_dimensions_are_kept_and_tested(beam, capsys):
    assert main(["fit", str(beam), "--unit", "m", "--member", "L127x100x6.35"]) == 0
    told = capsys.readouterr().out
    assert "given" in told and "p-value" in told and "contradict" not in told
    assert main(["fit", str(beam), "--unit", "m", "--member", "L127x100x8"]) in (0, 4)
    assert "the points contradict them" in capsys.readouterr().out


def test_a_ball_is_no_member(tmp_path, capsys):
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(800, 3))
    path = tmp_path / "ball.ply"
    write_cloud_ply(path, PointCloud.of(0.2 * ball / np.linalg.norm(ball, axis=1)[:, None]), {})
    assert main(["fit", str(path), "--unit", "m"]) == 4


RNG = np.random.default_rng(5)
BALL = RNG.normal(size=(2000, 3))
POOR = {
    "49 points are too few": RNG.random((49, 3)),
    "lie on one line": np.c_[RNG.random(300), np.zeros((300, 2))],
    "are at one place": np.ones((100, 3)),
    "on one line across its axis": np.c_[RNG.random((2000, 2)), np.zeros(2000)],  # a plane without any thickness
    "no axis do the points lie on the outline": 0.2 * BALL / np.linalg.norm(BALL, axis=1)[:, None],
}


@pytest.mark.parametrize("says", POOR)
def test_points_that_are_no_member_are_one_line(says, tmp_path, capsys):
    path = tmp_path / "poor.ply"
    write_cloud_ply(path, PointCloud.of(POOR[says]), {})
    assert main(["fit", str(path), "--unit", "m"]) in (3, 4)
    told = capsys.readouterr().err
    assert says in told, told
    assert len(told.strip().splitlines()) == 1


def test_two_members_are_said_to_be_two_and_a_stub_to_be_short(tmp_path, capsys):
    one = scanned(made("L", 1.0, L, sigma=0.0005), 2000, 0.0005, 1)
    other = scanned(made("L", 1.0, L, shift=(0.4, 0, 0), sigma=0.0005), 2000, 0.0005, 2)
    for name, points, says in (
        ("two", np.r_[one, other], "two members in one cluster (L and L, side by side"),
        ("stub", one[one[:, 2] < 0.09], "shorter than its section is wide"),
    ):
        path = tmp_path / f"{name}.ply"
        write_cloud_ply(path, PointCloud.of(points), {})
        assert main(["fit", str(path), "--unit", "m"]) == 4
        assert says in capsys.readouterr().out


def test_the_objects_of_a_file_that_is_no_member_are_told_one_by_one(tmp_path, capsys):
    """A brace and a girder that stand apart had been one tube, a quarter as long as it is wide."""
    one = made("L", 1.2, L, R=rotation(1), shift=(2, 1, 0), sigma=0.001)
    other = made("RHS", 0.9, R=rotation(2), shift=(2, 3, 0.5), sigma=0.001)
    path, out = tmp_path / "two.ply", tmp_path / "member.json"
    write_cloud_ply(path, PointCloud.of(np.concatenate([scanned(one, 3000, 0.001, 3), scanned(other, 3000, 0.001, 4)])), {})
    assert main(["fit", str(path), "--unit", "m", "-o", str(out)]) == 4
    told = capsys.readouterr().out
    assert "2 objects found in it" in told and told.count("explains the points") == 2
    if out.exists():
        objects = json.loads(out.read_text(encoding="utf-8"))["objects"]
        assert sorted(o["family"] for o in objects) == ["L", "RHS"] and all(o["explains"] for o in objects)
        assert abs(next(o for o in objects if o["family"] == "L")["parameters"]["a"]["value_m"] - 0.127) < 1e-3


@real_scans.needs("structural", "steel_tee")
def test_a_welded_node_of_stubs_is_told_tube_by_tube(tmp_path, capsys):
    """Two sides of each 2 in tube were scanned: its outer sizes are told if the user says that nothing was cut off, the wall never."""
    tee = real_scans.DATA / "structural" / "steel_tee" / "table_8in10in_tee_x4y24_45.pcd_part1.pcd"
    for whole in (True, False):
        out = tmp_path / f"{whole}.json"
        assert main(["fit", str(tee), "--family", "RHS", "--set", f"estimation.whole={str(whole).lower()}", "-o", str(out)]) == 4
        told = capsys.readouterr().out
        row = next(one for one in json.loads(out.read_text(encoding="utf-8"))["objects"] if "parameters" in one)
        assert row["explains"] is whole and not row["parameters"]["t"]["observable"]
        for name in ("h", "b"):
            size = row["parameters"][name]
            assert size["observable"] is whole and abs(size["value_m"] - 0.0508) < (3 * size["std_m"] if whole else 0.003), (whole, name, size)
        assert ("how far the scan reaches" in told) is not whole


def test_a_sensor_within_the_solid_is_not_believed(tmp_path, capsys):
    path = tmp_path / "beam.ply"
    write_cloud_ply(path, PointCloud.of(scanned(made("rect", 1.0, {"b": 0.1, "t": 0.06}, sigma=0.0005), 3000, 0.0005, 1)), {})
    assert main(["fit", str(path), "--unit", "m", "--family", "rect", "--sensor-position", "0", "0", "0.5"]) == 0
    assert "lies within the solid" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "says"),
    [("family,name,a_mm,t_mm\nL,x,100,8\n", "needs the column 'b_mm'"), ("family,name,a_mm,b_mm,t_mm\nL,x,5,5,0.25\n", "look like inches")],
)
def test_a_catalogue_that_cannot_be_used_is_one_line(beam, text, says, tmp_path, capsys):
    path = tmp_path / "mine.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["fit", str(beam), "--unit", "m", "--catalogue", str(path)]) == 3
    told = capsys.readouterr().err
    assert says in told and "mine.csv" in told and len(told.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["none.ply"], 3, "none.ply"),
        (["BEAM", "--member", "X17"], 2, "names no section"),
        (["BEAM", "--family", "Q"], 2, "estimation.family"),
        (["BEAM", "--catalogue", "none.csv"], 3, "none.csv"),
        (["BEAM", "--unit", "furlong"], 2, "furlong"),
        (["BEAM", "--set", "estimation.famly=L"], 2, "did you mean"),
    ],
)
def test_what_is_wrong_is_one_line(beam, arguments, code, says, capsys):
    assert main(["fit", *(str(beam) if word == "BEAM" else word for word in arguments)]) == code
    told = capsys.readouterr().err
    assert says in told and len(told.strip().splitlines()) == 1


def test_too_few_points(tmp_path, capsys):
    path = tmp_path / "few.ply"
    write_cloud_ply(path, PointCloud.of(np.random.default_rng(1).random((20, 3))), {})
    assert main(["fit", str(path), "--unit", "m"]) in (3, 4)
    assert "20 points" in capsys.readouterr().err
