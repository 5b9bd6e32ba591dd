"""The command as a user types it, on small scans of known solids: contract, verdicts, determinism, resume."""

import json

import jsonschema
import numpy as np
import pytest

from predicates import spiral
from scan2fea.cli.main import main
from scan2fea.io import read_mesh
from scan2fea.kernel.measures import volume
from scan2fea.kernel.topology import surface_topology
from scan2fea.report.schema import report_schema


def sphere_scan(n=2000, radius=0.1, sigma=0.0003, seed=3):
    """Points spread evenly over a sphere (golden spiral), noise along the radius."""
    k = np.arange(n) + 0.5
    polar, around = np.arccos(1 - 2 * k / n), np.pi * (1 + 5**0.5) * k
    unit = np.c_[np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)]
    return unit * (radius + sigma * np.random.default_rng(seed).standard_normal(n))[:, None]


FAST = ["--set", "remeshing.max_faces=600", "--set", "run.jobs=1"]
FACETS = ["--set", "cad.true_faces=false", "--set", "cad.patches=false", "--set", "remeshing.max_faces=400"]  # where nothing is asked of the faces


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("e2e")
    scan = folder / "ball.xyz"
    np.savetxt(scan, 1000 * sphere_scan() + [2000, -500, 300], fmt="%.4f")
    arguments = ["run", str(scan), "-o", str(folder / "OUT"), "--unit", "mm", "--seed", "5", *FAST]
    assert main(arguments) == 0
    return folder, arguments


def report_of(out):
    return json.loads((out / "report.json").read_text())


def test_report_follows_its_schema(done):
    report = report_of(done[0] / "OUT")
    jsonschema.validate(report, report_schema())
    assert report["seed"] == 5
    assert (report["inputs"][0]["unit"], report["inputs"][0]["unit_source"]) == ("mm", "option")


def test_all_files_of_the_contract_are_there(done):
    out = done[0] / "OUT"
    top = ("report.html", "report.json", "config.toml", "log.jsonl", "labels.csv", "cloud.ply", "trajectory.txt", "assembly.step")
    own = ("cloud.ply", "surface.ply", "surface.stl", "volume.vtu", "volume.msh", "model.step", "model.inp", "model.bdf")
    assert [name for name in top if not (out / name).stat().st_size] == []
    assert [name for name in own if not (out / "objects" / "01" / name).stat().st_size] == []


def test_ball_is_the_ball(done):
    row = report_of(done[0] / "OUT")["objects"][0]
    assert row["verdict"] == "converted"
    mesh = read_mesh(done[0] / "OUT" / "objects" / "01" / "surface.ply")
    topology = surface_topology(mesh)
    assert topology.is_closed and topology.is_manifold and topology.n_components == 1
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi * 0.1**3, rel=0.02)
    assert np.linalg.norm(mesh.vertices.mean(axis=0) - [2.0, -0.5, 0.3]) < 0.002
    assert row["fea"]["mass_kg"] == pytest.approx(7850 * volume(mesh), rel=1e-6)
    assert 3 * row["spacing_m"] < row["surface"]["smallest_hole_m"] < 5 * row["spacing_m"] and "closed unseen" in row["reason"]


def test_same_input_same_cloud(done, tmp_path):
    """Of the scene; that an object made again has the same bytes stands below."""
    folder, arguments = done
    again = [str(tmp_path / "OUT") if a == str(folder / "OUT") else a for a in arguments]
    assert main([*again, "--set", "select.min_points=100000"]) == 4  # no object: they take most of a run
    assert (folder / "OUT" / "cloud.ply").read_bytes() == (tmp_path / "OUT" / "cloud.ply").read_bytes()
    first, second = (without_times(report_of(f / "OUT")) for f in (folder, tmp_path))
    assert [first[name] for name in ("inputs", "registration", "spacing_m")] == [second[name] for name in ("inputs", "registration", "spacing_m")]


def without_times(node):
    if isinstance(node, dict):
        return {k: without_times(v) for k, v in node.items() if k not in ("seconds", "peak_mb")}
    return [without_times(v) for v in node] if isinstance(node, list) else node


def test_resume_makes_nothing_twice_follows_edits_and_makes_the_same_bytes_again(done):
    folder, arguments = done
    out = folder / "OUT"
    made, report = {path: path.read_bytes() for path in [*(out / "objects").rglob("*.*"), out / "assembly.step"]}, report_of(out)
    before = (out / "objects" / "01" / "surface.ply").stat().st_mtime_ns
    assert main([*arguments, "--resume"]) == 0
    assert (out / "objects" / "01" / "surface.ply").stat().st_mtime_ns == before
    table = (out / "labels.csv").read_text()
    (out / "labels.csv").write_text(table.replace(",object,", ",drop,"))
    assert main([*arguments, "--resume"]) == 4
    assert report_of(out)["objects"] == []
    assert not list((out / "objects").glob("01/*"))
    (out / "labels.csv").write_text(table)
    assert main([*arguments, "--resume"]) == 0
    events = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    again = {event["name"] for event in events if event["event"] == "end" and event["object"] and not event["kept"]}
    assert {"estimate", "reconstruct", "remesh", "faces", "patches", "tets", "solve"} <= again
    assert made == {path: path.read_bytes() for path in made}
    assert without_times(report["objects"]) == without_times(report_of(out)["objects"])


def test_half_a_ball_fails_with_its_reason_and_keeps_what_was_made(tmp_path):
    points = sphere_scan(1000)
    np.savetxt(tmp_path / "half.xyz", points[points[:, 2] > 0], fmt="%.6f")
    assert main(["run", str(tmp_path / "half.xyz"), "-o", str(tmp_path / "OUT"), *FAST]) == 4
    row = report_of(tmp_path / "OUT")["objects"][0]
    assert row["verdict"] == "failed"
    assert len(row["reason"]) > 20
    assert "cloud.ply" in row["files"]
    assert (tmp_path / "OUT" / "report.html").exists()
    jsonschema.validate(report_of(tmp_path / "OUT"), report_schema())


def test_agreement_of_two_inputs_is_in_the_report(tmp_path):
    points = sphere_scan(4000)
    for k in range(2):
        np.savetxt(tmp_path / f"{k}.xyz", points[k::2], fmt="%.6f")
    main(["run", *(str(tmp_path / f"{k}.xyz") for k in range(2)), "-o", str(tmp_path / "OUT"), *FAST, "--set", "select.min_points=100000"])
    frames = report_of(tmp_path / "OUT")["registration"]["frames"]
    assert all(0 < frame["agreement_m"] < 0.01 for frame in frames)
    jsonschema.validate(report_of(tmp_path / "OUT"), report_schema())


def test_bad_input_beside_a_good_one(tmp_path):
    np.savetxt(tmp_path / "good.xyz", sphere_scan(1500), fmt="%.6f")
    (tmp_path / "bad.las").write_bytes(b"LASF" + bytes(50))
    assert main(["run", str(tmp_path / "bad.las"), str(tmp_path / "good.xyz"), "-o", str(tmp_path / "OUT"), *FAST, *FACETS]) == 0
    bad, good = report_of(tmp_path / "OUT")["inputs"]
    assert not bad["used"] and "bad.las" in bad["reason"]
    assert good["used"]


def test_closed_mesh_enters_at_repair(tmp_path, done):
    stl = done[0] / "OUT" / "objects" / "01" / "surface.stl"
    assert main(["run", str(stl), "-o", str(tmp_path / "OUT"), *FAST, *FACETS]) == 0
    report = report_of(tmp_path / "OUT")
    jsonschema.validate(report, report_schema())
    assert next(s["name"] for s in report["stages"] if s["object"]) == "repair"


def test_a_mesh_that_crosses_itself(tmp_path):
    given = spiral()
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*v) for v in given.vertices] + ["f {} {} {}".format(*(f + 1)) for f in given.faces]
    (tmp_path / "wound.obj").write_text("\n".join(lines))
    assert main(["run", str(tmp_path / "wound.obj"), "-o", str(tmp_path / "OUT"), "--unit", "m", *FAST, *FACETS]) == 0
    row = report_of(tmp_path / "OUT")["objects"][0]
    assert row["verdict"] == "converted"
    assert "could not be repaired" in row["reason"] and "fTetWild" in row["reason"]
    steps = [step["step"] for step in row["drift"]]
    assert steps.index("new boundary") < steps.index("repair")
    assert 7.6e-5 <= row["volume"]["volume_m3"] <= 8.9e-5  # the ring, and the 3.2 mm of 20 that its turns climb


POOR = {
    "one point": ([[0, 0, 0]], 3),
    "one place": ([[1, 2, 3]] * 50, 3),
    "one line": ([[x, 2 * x, 0] for x in range(60)], 3),
    "one plane": ([[x, y, 0] for x in range(9) for y in range(9)], 4),
}


@pytest.mark.parametrize("name", POOR)
def test_no_solid_in_it_ends_honestly(name, tmp_path, capsys):
    points, code = POOR[name]
    np.savetxt(tmp_path / "poor.xyz", np.asarray(points, float))
    assert main(["run", str(tmp_path / "poor.xyz"), "-o", str(tmp_path / "OUT"), *FAST, "--set", "select.min_points=4"]) == code
    told = capsys.readouterr().err
    assert "Traceback" not in told
    if code == 3:
        assert len([line for line in told.splitlines() if line.startswith("scan2fea:")]) == 1
