"""`scan2fea reconstruct`: what it writes of a solid, and what it leaves of a scan that encloses none."""

import json

import numpy as np
import pytest

from predicates import box, moved, rotation
from scan2fea.cli.main import main
from scan2fea.io import read_mesh
from scan2fea.io.ply_writer import write_scan_ply
from scan2fea.kernel.measures import area, face_areas, face_normals
from scan2fea.kernel.topology import edge_table
from scan2fea.types import PointCloud, Scan
from scanned import scan_of, scanned

TURN = rotation(7)
PLATE = moved(box((1.0, 0.6, 0.05)), TURN, np.zeros(3))


def reconstructed(scan, folder):
    write_scan_ply(folder / "scan.ply", scan, lengths="metres")
    code = main(["reconstruct", str(folder / "scan.ply"), "-o", str(folder / "OUT")])
    return code, json.loads((folder / "OUT" / "report.json").read_text())


@pytest.mark.parametrize("seen", [True, False])
def test_a_single_sheet_is_no_solid_and_is_kept_as_it_is(seen, tmp_path):
    scan, _, normals = scanned(PLATE, 0.02, 0.001, seed=1)
    top = normals @ TURN[:, 2] > 0.9
    sensors = scan.sensors()[top] if seen else None
    code, report = reconstructed(scan_of(scan.cloud.points[top], sensors), tmp_path)
    assert code == 4 and report["reason"]
    sheet = read_mesh(tmp_path / "OUT" / "sheet.ply")
    assert area(sheet) == pytest.approx(0.6, rel=0.05)
    assert edge_table(sheet.faces).count.max() == 2  # manifold with a border
    up = face_normals(sheet) @ TURN[:, 2]
    share = [face_areas(sheet)[side].sum() / area(sheet) for side in (up > 0.9, up < -0.9)]
    assert (share[0] if seen else max(share)) > 0.99  # all of it turned one way; slivers between points in a row lie anyhow
    off = sheet.vertices @ TURN[:, 2] - 0.05
    assert np.sqrt((off**2).mean()) < 0.0007  # nearer than the points


def test_a_solid_has_no_sheet_and_an_old_one_goes(tmp_path):
    scan, _, _ = scanned(box((0.5, 0.4, 0.3)), 0.025, seed=1)
    (tmp_path / "OUT").mkdir()
    (tmp_path / "OUT" / "sheet.ply").write_text("of an earlier run")
    code, report = reconstructed(Scan(cloud=PointCloud.of(scan.cloud.points)), tmp_path)
    assert code == 0 and report["passed"]
    assert sorted(file.name for file in (tmp_path / "OUT").iterdir()) == ["config.toml", "report.json", "surface.ply", "surface.stl"]
