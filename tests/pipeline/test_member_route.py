"""A member goes the way of estimation, and its files say what it is; what is none is reconstructed, with the reason."""

import json
from dataclasses import replace

import jsonschema
import numpy as np
import pytest

from estimation.drilled import RADIUS, bolted
from estimation.made import made
from scan2fea.errors import UsageError
from scan2fea.estimation.member import MemberOptions
from scan2fea.io import write_scan_ply
from scan2fea.kernel.sections import section, section_area, section_area_slopes
from scan2fea.pipeline.config import load_config
from scan2fea.pipeline.members import told_after_all
from scan2fea.pipeline.part import Made, Part
from scan2fea.pipeline.results import assumed
from scan2fea.pipeline.route import RouteOptions, estimate, known_section, route_of
from scan2fea.pipeline.run import run
from scan2fea.report.schema import report_schema
from scan2fea.types import CatalogueEntry, Check, PointCloud, Route, Scan
from scan2fea.verification.member import assumed_volume_std
from scan2fea.verification.verdict import verdict

SIZES = {"a": 0.16, "b": 0.1, "t": 0.012, "length": 0.9}
SIGMA = 0.001


def angle_scan(n: int = 6000, seed: int = 3) -> Scan:
    """Points on the sides of an angle, Gaussian noise."""
    random = np.random.default_rng(seed)
    (loop,) = section("L", SIZES).loops
    way = np.roll(loop, -1, axis=0) - loop
    share = np.linalg.norm(way, axis=1)
    edge = random.choice(len(loop), n, p=share / share.sum())
    xy = loop[edge] + random.random((n, 1)) * way[edge]
    points = np.column_stack([xy, SIZES["length"] * random.random(n)]) + random.normal(0, SIGMA, (n, 3))
    return Scan(cloud=PointCloud.of(points))


def ball_scan(n: int = 3000) -> Scan:
    points = np.random.default_rng(0).normal(size=(n, 3))
    return Scan(cloud=PointCloud.of(0.2 * points / np.linalg.norm(points, axis=1, keepdims=True)))


def test_an_angle_is_estimated_and_a_ball_is_not() -> None:
    found = estimate(angle_scan(), MemberOptions(), RouteOptions())
    assert found.member is not None and found.explains and found.member.family == "L"
    for p in found.member.parameters:
        assert p.std_m is not None and abs(p.value_m - SIZES[p.name]) < 4 * p.std_m
    assert route_of(found, "auto").name == "estimation"
    ball = estimate(ball_scan(), MemberOptions(), RouteOptions())
    assert not ball.explains
    assert route_of(ball, "auto").name == "reconstruction"
    assert route_of(ball, "auto").reason.startswith("free form: ")


def test_two_faces_of_a_flat_are_told_by_the_word_that_nothing_hid_it() -> None:
    """Where one face of each pair was seen, it may be the scan that ends; the reason says what would help."""
    random = np.random.default_rng(5)
    b, t, length, n = 0.0756, 0.0122, 0.581, 6000
    on = random.random(n) < b / (b + t)
    xy = np.where(on[:, None], np.c_[b * random.random(n), np.zeros(n)], np.c_[np.full(n, b), t * random.random(n)])
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    scan = Scan(cloud=PointCloud.of((np.c_[xy, length * random.random(n)] + random.normal(0, 2e-4, (n, 3))) @ turn.T))
    found = estimate(scan, MemberOptions(), RouteOptions())
    assert found.member is None and "estimation.whole = true" in found.reason
    whole = estimate(scan, MemberOptions(whole=True), RouteOptions())
    assert whole.member is not None and whole.explains and whole.member.family == "rect"
    told = {p.name: p for p in whole.member.parameters}
    assert abs(told["b"].value_m - b) < 3 * told["b"].std_m and abs(told["t"].value_m - t) < 3 * told["t"].std_m


def test_given_dimensions_are_held_and_tested() -> None:
    right = estimate(angle_scan(), MemberOptions(), RouteOptions(member="L160x100x12"))
    assert right.member is not None and right.member.values()["a"] == pytest.approx(0.16, abs=1e-12)
    assert right.p_fixed is not None and right.p_fixed > 1e-3
    wrong = estimate(angle_scan(), MemberOptions(), RouteOptions(member="L160x100x10"))
    assert wrong.p_fixed is not None and wrong.p_fixed < 1e-6
    with pytest.raises(UsageError, match="takes 3 numbers"):
        known_section(RouteOptions(member="L12x"), None)


def test_a_member_runs_to_its_files(tmp_path) -> None:
    write_scan_ply(tmp_path / "angle.ply", angle_scan())
    report = run([tmp_path / "angle.ply"], tmp_path / "out", load_config(None, {"run.jobs": 1}))
    (row,) = report["objects"]
    assert row["verdict"] == "converted" and row["route"] == "estimation", row["reason"]
    assert row["member"]["family"] == "L" and row["cad"]["n_faces"] == 8 and row["cad"]["n_planar"] == 8
    volume = 0.012 * (0.16 + 0.1 - 0.012) * 0.9
    assert row["surface"]["volume_m3"] == pytest.approx(volume, rel=0.02)
    assert row["volume"]["quality"]["min_dihedral_deg"]["min"] > 12
    folder = tmp_path / "out" / "objects" / "01"
    told = json.loads((folder / "member.json").read_text())
    assert told["parameters"]["t"]["observable"] is True
    frame = json.loads((tmp_path / "out" / "frame.json").read_text())
    assert len(frame["members"]) == 1 and len(frame["nodes"]) == 2
    assert "A_OUTER" in (folder / "model.inp").read_text()
    assert "*SHELL SECTION" in (folder / "model_shell.inp").read_text()


def test_a_drilled_flat_runs_to_its_files(tmp_path) -> None:
    points, member, n = bolted("rect", 9000, 3e-4, seed=4)
    write_scan_ply(tmp_path / "flat.ply", Scan(cloud=PointCloud.of(points)))
    report = run([tmp_path / "flat.ply"], tmp_path / "out", load_config(None, {"run.jobs": 1}))
    jsonschema.validate(report, report_schema())
    (row,) = report["objects"]
    assert row["verdict"] == "converted" and row["route"] == "estimation", row["reason"]
    assert f"with {n} round holes of" in row["reason"]
    assert row["cad"]["n_planar"] == 6 and row["cad"]["n_cylindrical"] == n
    b, t, length = (member.values()[name] for name in ("b", "t", "length"))
    whole = b * t * length
    assert row["surface"]["volume_m3"] == pytest.approx(whole - n * np.pi * RADIUS**2 * t, rel=0.002)
    assert sorted(hole["along_m"] for hole in row["member"]["holes"]) == pytest.approx([0.1, 0.25], abs=1e-3)
    for hole in row["member"]["holes"]:
        assert abs(hole["radius_m"] - RADIUS) < 4 * hole["std_m"] < 1e-3
    deck = (tmp_path / "out" / "objects" / "01" / "model.inp").read_text()
    assert "HOLE_01" in deck and "END_FIRST" in deck


def test_reconstruction_can_be_asked_for(tmp_path) -> None:
    write_scan_ply(tmp_path / "angle.ply", angle_scan(2000))
    config = load_config(None, {"run.jobs": 1, "route.mode": "reconstruction", "cad.true_faces": False, "cad.patches": False})
    report = run([tmp_path / "angle.ply"], tmp_path / "out", config)
    (row,) = report["objects"]
    assert row["route"] == "reconstruction" and "route.mode" in row["route_reason"]
    assert not (tmp_path / "out" / "frame.json").exists()


def _failed(says: str) -> Check:
    return Check(name="x", value=1, limit=0, unit="1", passed=False, says=says)


def test_what_is_known_of_a_member_is_told_where_nothing_could_be_built() -> None:
    found = estimate(angle_scan(1500), MemberOptions(), RouteOptions())
    made = Made(part=Part(id=1, kind="object", scan=angle_scan(1500)), estimate=found, route=Route(name="reconstruction", reason="because"))
    made.refused, made.checks = [_failed("its end was not seen")], [_failed("open on both sides")]
    assert made.member is None
    assert told_after_all(made, "") == ""
    assert made.member is found.member and made.route is not None and "open on both sides" in made.route.reason
    assert verdict(made.checks).reason == "its end was not seen"


def test_a_member_given_up_stays_so_where_free_form_serves() -> None:
    found = estimate(angle_scan(1500), MemberOptions(), RouteOptions())
    made = Made(part=Part(id=1, kind="object", scan=angle_scan(1500)), estimate=found, route=Route(name="reconstruction", reason="because"))
    made.refused = [_failed("its end was not seen")]
    assert told_after_all(made, "") == "" and made.member is None and not made.checks
    assert told_after_all(made, "stopped in the mesher") == "" and made.member is not None


@pytest.mark.parametrize(("spread", "doubts"), [(0.0012, True), (0.0001, False)])
@pytest.mark.parametrize("source", ["catalogue", "estimate"])
def test_the_verdict_says_what_an_untold_wall_was_built_with_and_how_uncertain_the_volume_is(source, spread, doubts) -> None:
    member = made("L", 3.0, {"a": 0.127, "b": 0.127, "t": 0.00794})
    untold = replace(member.parameters[2], std_m=None, observable=False, source=source, spread_m=spread)
    sizes = {name: p.value_m for name, p in zip("abt", member.parameters, strict=False)}
    entry = CatalogueEntry(name="L5X5X5/16", probability=0.4, parameters=sizes, is_standard=True)
    found = replace(member, parameters=(*member.parameters[:2], untold, *member.parameters[3:]), catalogue=(entry,))
    slope = section_area_slopes("L", found.values())["t"] / section_area(section("L", found.values()))
    assert assumed_volume_std(found) == pytest.approx(slope * spread)
    told = assumed(found)
    assert told.startswith("; not observable, built with t = 7.94 mm from ")
    assert ("the catalogue (L5X5X5/16)" in told) == (source == "catalogue") and ("cannot vouch" in told) == (source == "estimate")
    assert ("the volume is uncertain by 15%" in told) == doubts and ("at most 5%" in told) == doubts
