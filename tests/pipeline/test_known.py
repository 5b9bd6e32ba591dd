"""[[object]] tables: read, written, assigned to objects, held, tested and reported."""

import json
from dataclasses import replace

import jsonschema
import numpy as np
import pytest

from estimation.made import made
from predicates import rotation
from scan2fea.cad import prism_brep
from scan2fea.errors import InputError, UsageError
from scan2fea.estimation.member import MemberOptions
from scan2fea.estimation.solid import solid_of
from scan2fea.io import write_scan_ply
from scan2fea.pipeline.assigned import assigned, own_section, resolved
from scan2fea.pipeline.config import as_tree, from_tree, load_config, to_toml
from scan2fea.pipeline.known import KnownObject
from scan2fea.pipeline.member_rows import member_row
from scan2fea.pipeline.results import claimed
from scan2fea.pipeline.route import KnownSection, RouteOptions, estimate
from scan2fea.pipeline.run import run
from scan2fea.report.schema import report_schema
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan

L = {"a": 0.16, "b": 0.1, "t": 0.012, "length": 0.9}
TABLES = """
[[object]]
id = 2
member = "L160x100x12"
fixed = { length = 0.9 }

[[object]]
at = [1.0, 0.0, 0.5]
family = "I"
nominal = { tw = 0.006 }
whole = true
"""


def config_of(tmp_path, text):
    path = tmp_path / "c.toml"
    path.write_text(text)
    return load_config(path)


def angle(n=1_500, values=L, **options):
    return member_points("L", values, n, MemberScanOptions(noise_m=0.001, seed=2, **options))


def told(points, **known):
    return estimate(Scan(cloud=PointCloud.of(points)), MemberOptions(), RouteOptions(), KnownSection(**known))


def test_tables_are_read_written_and_travel(tmp_path):
    config = config_of(tmp_path, TABLES)
    first, second = config.object
    assert first == KnownObject(id=2, member="L160x100x12", fixed={"length": 0.9})
    assert second.at == (1.0, 0.0, 0.5) and second.nominal == {"tw": 0.006} and second.whole
    assert config_of(tmp_path, to_toml(config)) == config
    assert from_tree(json.loads(json.dumps(as_tree(config)))) == config


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[object]\nid = 1\n", r"not known|\[\[object\]\]"),
        ("[[object]]\nfamily = 'L'\n", "give either id or at"),
        ("[[object]]\nid = 1\nat = [0, 0, 0]\n", "give either id or at"),
        ("[[object]]\nid = 0\n", "from 1 on"),
        ("[[object]]\nid = true\n", "from 1 on"),
        ("[[object]]\nid = 1\nfamly = 'L'\n", "did you mean 'family'"),
        ("[[object]]\nid = 1\nfamily = 'Q'\n", "use one of L, I"),
        ("[[object]]\nid = 1\nat = [0, 1]\n", "three coordinates"),
        ("[[object]]\nid = 1\nfixed = { q = 1.0 }\n", "'q' is no dimension"),
        ("[[object]]\nid = 1\nfixed = { t = -1.0 }\n", "positive number of metres"),
        ("[[object]]\nid = 1\nfixed = 3\n", r"write fixed = \{"),
        ("[[object]]\nid = 1\nwhole = 1\n", "it is true or false"),
        ("[[object]]\nid = 1\nmember = 'L'\nstep = 'a.step'\n", "not both"),
    ],
)
def test_wrong_tables_are_told(tmp_path, text, says):
    with pytest.raises(UsageError, match=says):
        config_of(tmp_path, text)


@pytest.mark.parametrize(
    ("known", "error", "says"),
    [
        (KnownObject(id=1, member="X17"), UsageError, "names no section"),
        (KnownObject(id=1, member="L160x100x12", family="I"), UsageError, "family = 'I', but L160x100x12 is of family L"),
        (KnownObject(id=1, member="L160x100x12", fixed={"t": 0.01}), UsageError, "t given twice"),
        (KnownObject(id=1, family="L", fixed={"tw": 0.01}), UsageError, "family L has no dimension 'tw'"),
        (KnownObject(id=1, step="none.step"), InputError, "none.step"),
    ],
)
def test_what_means_nothing_is_told(known, error, says):
    with pytest.raises(error, match=says):
        resolved((known,), None, 0)


def test_tables_find_their_objects():
    objects = {1: np.array([[0.0, 0, 0], [1, 1, 1]]), 2: np.array([[5.0, 0, 0], [6, 1, 1]])}
    shift = np.array([1000.0, 0, 0])
    (one,) = assigned((KnownObject(at=(1005.9, 0.5, 0.5), family="L"),), objects, shift)
    assert one.id == 2 and own_section((one,), 2) == KnownSection(family="L") and own_section((one,), 1) is None
    for known, says in (
        ((KnownObject(id=3),), "no object 3; it has 2: 1, 2"),
        ((KnownObject(at=(1050.0, 0, 0)),), "no object is there"),
        ((KnownObject(id=2), KnownObject(at=(1005.5, 0.5, 0.5))), "object 2 has a table already"),
    ):
        with pytest.raises(UsageError, match=says):
            assigned(known, objects, shift)


@pytest.mark.parametrize("turn", [0, 1])
def test_an_angle_of_unequal_legs_is_held_whichever_way_its_axis_runs(turn):
    points = angle() * (np.array([1.0, -1.0, -1.0]) if turn else 1.0)
    found = told(points @ rotation(3).T, family="L", fixed={"a": 0.16, "b": 0.1, "t": 0.012})
    assert found.explains and found.p_fixed is not None and found.p_fixed > 1e-3, found.reason
    assert {g.name: g.is_contradicted for g in found.given} == {"a": False, "b": False, "t": False}
    assert all(p.source == "fixed" for p in found.member.parameters if p.name != "length")


def test_one_leg_and_the_length_are_held():
    found = told(angle(), family="L", fixed={"a": 0.1, "length": 0.9})
    assert found.explains and found.member.values()["a"] == 0.1 and found.member.values()["length"] == 0.9
    assert found.member.values()["b"] == pytest.approx(0.16, abs=5e-4)
    wrong = told(angle(), family="L", fixed={"length": 0.95})
    (row,) = wrong.given
    assert row.is_contradicted and row.p_value < 1e-6 and wrong.n_contradicted == 1 and "length is given as 950 mm" in wrong.reason


def test_what_was_not_seen_contradicts_nothing():
    points = member_points("L", L, 1_500, MemberScanOptions(noise_m=0.001, seed=2, faces=("A_OUTER", "B_OUTER")))
    found = told(points, family="L", fixed={"a": 0.16, "b": 0.1, "t": 0.02})
    rows = {g.name: g for g in found.given}
    assert rows["t"].p_value is None and not rows["t"].is_contradicted and rows["a"].p_value is not None


def test_nominal_dimensions_are_measured_and_compared():
    found = told(angle(), nominal={"t": 0.012, "a": 0.165, "tw": 0.01})
    rows = {g.name: g for g in found.given}
    assert set(rows) == {"t", "a"} and not rows["t"].is_contradicted and rows["a"].is_contradicted
    assert found.n_contradicted == 0 and found.p_fixed is None
    assert found.member.values()["a"] == pytest.approx(0.16, abs=1e-3)


def test_a_nominal_part_gives_the_section(tmp_path):
    solid = solid_of(made("L", 0.9, {"a": 0.16, "b": 0.1, "t": 0.012}, R=rotation(5), shift=(3, 2, 1)))
    path = tmp_path / "nominal.step"
    path.write_text(prism_brep(solid.shape, solid.sweep).step)
    (known,) = resolved((KnownObject(id=1, step=str(path)),), None, 0)
    assert known.family == "L" and known.nominal == {"length": pytest.approx(0.9, abs=1e-4)}
    assert known.fixed == {name: pytest.approx(L[name], abs=2e-5) for name in ("a", "b", "t")}
    (tmp_path / "bad.step").write_text("no step")
    with pytest.raises(InputError, match="no STEP file"):
        resolved((KnownObject(id=1, step=str(tmp_path / "bad.step")),), None, 0)


def test_a_denied_table_stops_the_member(tmp_path):
    write_scan_ply(tmp_path / "angle.ply", Scan(cloud=PointCloud.of(angle())))
    config = config_of(tmp_path, "[run]\njobs = 1\n[route]\nmode = 'estimation'\n[[object]]\nid = 1\nmember = 'L160x100x10'\n")
    (row,) = (report := run([tmp_path / "angle.ply"], tmp_path / "out", config))["objects"]
    assert row["verdict"] == "failed"
    assert [g["name"] for g in row["member"]["given"] if g["contradicted"]] == ["t"]
    jsonschema.validate(report, report_schema())
    failed = [check for check in row["checks"] if not check["passed"]]
    assert "member.contradicted" in {check["name"] for check in failed}


TUBE = {"h": 0.1, "b": 0.06, "t": 0.005, "length": 0.8}


def tube_corner():
    """One corner of a tube, askew."""
    seen = ("BOTTOM_OUTER", "LEFT_OUTER")
    return member_points("RHS", TUBE, 4_000, MemberScanOptions(noise_m=3e-4, seed=2, faces=seen)) @ rotation(3).T


def test_how_far_a_face_was_scanned_denies_nothing():
    """A tube wider than what was seen of it: nothing of its sizes is told, so none is denied."""
    found = told(tube_corner(), family="RHS", fixed={"h": 0.11, "b": 0.07, "t": 0.005})
    assert found.explains and found.n_contradicted == 0 and found.p_fixed is None, found.reason
    assert found.untold == ("h", "b", "t") and all(g.measured_m is None for g in found.given)


def test_what_was_given_is_told_as_given_and_not_measured():
    found = told(tube_corner(), family="RHS", fixed={"t": 0.005}, whole=True)
    assert found.whole and found.untold == ("t",) and len(found.member.reached) == 2
    row = member_row(found.member, found.p_fixed, found.given)
    assert {name: p["observable"] for name, p in row["parameters"].items()} == {"h": True, "b": True, "t": False, "length": True}
    assert row["parameters"]["t"]["source"] == "fixed" and row["parameters"]["t"]["value_m"] == 0.005
    says = claimed(found.member, found)
    assert "t = 5 mm as given, not measured" in says and "TOP_OUTER" in says and "whole" in says
    assert claimed(found.member, replace(found, whole=False, given=())) == ""
