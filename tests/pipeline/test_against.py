"""A part against its drawing, through the command line: where it was laid, which faces are out, what both answer; sets asked for in vain."""

import json

import jsonschema
import numpy as np
import pytest

from scan2fea.cad.compared import triangles_of
from scan2fea.cad.live import parts, unified
from scan2fea.cad.step_occ import step_of_solid
from scan2fea.cli.main import main
from scan2fea.fea import FeaOptions
from scan2fea.io import write_mesh_ply
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.transforms import applied, quaternion_to_matrix, rigid
from scan2fea.pipeline.asked import asked_in_vain
from scan2fea.report.schema import report_schema
from scan2fea.types import TriangleMesh
from scan2fea.verification.drawing import as_built, general_tolerance

T = rigid(quaternion_to_matrix([0.3, -0.2, 0.5, 0.7]), [0.4, -1.0, 0.2])


def step_plate(thick_mm=12.0, hole_mm=20.0):
    """60 x 40 mm with a step of 8 mm on one side and a hole of 5 mm radius through the other."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
    from OCP.TopAbs import TopAbs_SOLID

    def box(x, y, z):
        return BRepPrimAPI_MakeBox(gp_Pnt(0, 0, 0), gp_Pnt(x, y, z)).Shape()

    whole = BRepAlgoAPI_Fuse(box(60.0, 40.0, thick_mm), box(25.0, 40.0, 24.0)).Shape()
    bore = BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(45, hole_mm, -5), gp_Dir(0, 0, 1)), 5.0, 40.0).Shape()
    return parts(unified(BRepAlgoAPI_Cut(whole, bore).Shape()), TopAbs_SOLID)[0]


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The plate was made 0.8 mm too thick; a support is asked for on a set that is not there."""
    folder = tmp_path_factory.mktemp("drawn")
    (folder / "plate.step").write_text(step_of_solid(step_plate(), 1e-6)[0])
    mesh, _ = triangles_of(step_plate(thick_mm=12.8), np.zeros(3), 1e-5)
    write_mesh_ply(folder / "made.ply", TriangleMesh(vertices=applied(T, mesh.vertices), faces=mesh.faces))
    text = f"[run]\njobs = 1\n[fea]\nsupports = ['FLOR']\n[tetmeshing]\nmax_elements = 5000\n[[object]]\nid = 1\nstep = '{folder / 'plate.step'}'\n"
    (folder / "set.toml").write_text(text)
    code = main(["run", str(folder / "made.ply"), "--unit", "m", "-c", str(folder / "set.toml"), "-o", str(folder / "out")])
    return code, json.loads((folder / "out" / "report.json").read_text()), folder / "out"


def test_the_faces_that_are_out_are_named(ran):
    _, report, out = ran
    jsonschema.validate(report, report_schema())
    (row,) = report["objects"]
    found = row["drawing"]
    assert row["verdict"] == "converted" and found["fits"] and found["tolerance_m"] == 3e-4 and found["not_seen"] == []
    np.testing.assert_allclose(np.array(found["T_scene_drawing"]), T, atol=2e-5)
    (name,) = found["out_of_tolerance"]
    (face,) = [face for face in found["faces"] if face["name"] == name]
    assert face["mean_m"] == pytest.approx(8e-4, abs=2e-5) and face["kind"] == "plane" and name in row["reason"]
    within = [face for face in found["faces"] if face["name"] != name and face["kind"] == "plane"]
    assert max(abs(face["mean_m"]) for face in within) < 6e-5
    page = (out / "report.html").read_text()
    assert {"as_built.ply", "drawing.step"} <= set(row["files"]) and "As drawn, as built" in page and "Points to drawing" in page


def test_both_solids_answer(ran):
    cases = {(c["name"], c["measure"]): c for c in ran[1]["objects"][0]["drawing"]["cases"]}
    area = 35e-3 * 40e-3 - np.pi * 25e-6
    drawn, made = (25e-3 * 40e-3 * 24e-3 + area * t for t in (12e-3, 12.8e-3))
    assert cases["mass", "mass_kg"]["difference"] == pytest.approx(made / drawn - 1, abs=1e-3)
    assert {("modal", "f7_hz"), ("modal", "f10_hz")} <= set(cases) and ("self_weight", "displacement_max_m") not in cases  # its support was named


def test_a_set_that_no_object_has_shows_in_the_exit_code(ran):
    code, report, out = ran
    assert code == 2 and report["asked_in_vain"] == ["'FLOR': no object has a set FLOR"]
    assert (out / "objects/01/model.step").exists() and (out / "objects/01/volume.vtu").exists()


def test_what_one_object_has_is_not_asked_in_vain():
    rows = [{"id": 1, "fea": {"sets": [{"name": "TOP"}]}}, {"id": 2, "fea": {"sets": [{"name": "FOOT"}]}}, {"id": 3}]
    good = FeaOptions(supports=("FOOT z", "LOWEST"), loads=("a: 1/TOP force 0 0 1", "TOP pressure 2", "ALL gravity 1 0 0"))
    assert asked_in_vain(good, rows) == [] and asked_in_vain(FeaOptions(supports=("none",)), rows) == []
    wrong = FeaOptions(loads=("2/TOP force 0 0 1", "SIDE pressure 2"))
    first = "'2/TOP force 0 0 1': object 2 was not solved, or has no set TOP"
    assert asked_in_vain(wrong, rows) == [first, "'SIDE pressure 2': no object has a set SIDE"]
    assert asked_in_vain(wrong, [{"id": 1}]) == []


def test_a_face_that_was_not_scanned_is_not_seen():
    mesh, face = triangles_of(step_plate(), np.zeros(3), 1e-5)
    points, of = sample_surface(mesh, 6_000, 0)
    n = int(face.max()) + 1
    hole = int(np.argmin([abs(np.bincount(face, minlength=n)[k] - np.bincount(face).max()) for k in range(n)]))  # the one with the most triangles
    names = [f"F{k}" for k in range(n)]
    found = as_built(points[face[of] != hole], mesh, face, names, ["plane"] * n, 3e-4, np.zeros(2))
    assert [f.name for f in found.faces if not f.is_seen] == [names[hole]] and not any(f.is_out for f in found.faces) and found.fits
    assert not as_built(points * 1.3, mesh, face, names, ["plane"] * n, 3e-4, np.zeros(2)).fits


def test_general_tolerances_are_those_of_the_standard():
    assert [general_tolerance(size) for size in (0.006, 0.03, 0.1, 0.4, 1.0, 1.5, 3.0)] == [1e-4, 2e-4, 3e-4, 5e-4, 8e-4, 1.2e-3, 2e-3]
