"""What `io` writes is read back with all its columns; damaged files are told."""

from __future__ import annotations

import numpy as np
import pytest

from report.fake_out import angle_solid, boundary_of, scattered
from scan2fea.errors import FormatError
from scan2fea.io import write_cloud_ply, write_mesh_ply, write_vtu
from scan2fea.report.ours import read_cloud, read_solid, read_surface
from scan2fea.types import TetMesh

ANGLE = angle_solid()
SKIN = boundary_of(ANGLE)
CLOUD = scattered(SKIN, 50, 0.0, 0)


def tet_mesh(solid):
    none = np.zeros(0, np.int64)
    return TetMesh(nodes=solid.nodes, tets=solid.tets, boundary=none.reshape(0, 3), face_tag=none, face_names=())


def test_cloud(tmp_path):
    path = tmp_path / "cloud.ply"
    colour, normals = np.arange(150, dtype=np.uint8).reshape(50, 3), np.tile([0.0, 0.0, 1.0], (50, 1))
    write_cloud_ply(path, CLOUD.replaced(colour=colour, normals=normals), {"is_inferred": (np.arange(50) % 2).astype(np.uint8)})
    back = read_cloud(path)
    assert np.array_equal(back.points, CLOUD.points) and np.array_equal(back.colour, colour) and np.array_equal(back.normals, normals)
    assert back.is_inferred.tolist() == [False, True] * 25
    write_cloud_ply(path, CLOUD)
    bare = read_cloud(path)
    assert bare.colour is None and bare.is_inferred is None and bare.normals is None


def test_points_that_are_not_finite_are_left_out(tmp_path):
    points = CLOUD.points.copy()
    points[7, 1] = np.nan
    write_cloud_ply(tmp_path / "c.ply", CLOUD.replaced(points=points))
    assert len(read_cloud(tmp_path / "c.ply")) == 49


def test_surface(tmp_path):
    path = tmp_path / "surface.ply"
    write_mesh_ply(path, SKIN)
    back = read_surface(path)
    for name in ("vertices", "faces", "face_origin", "face_region", "deviation_m"):
        assert np.array_equal(getattr(back, name), getattr(SKIN, name)), name


def test_solid(tmp_path):
    path = tmp_path / "volume.vtu"
    angle = np.arange(float(len(ANGLE.tets)))
    write_vtu(path, tet_mesh(ANGLE), dict(ANGLE.point_data), {"min_dihedral_deg": angle})
    back = read_solid(path)
    assert np.array_equal(back.nodes, ANGLE.nodes) and np.array_equal(back.tets, ANGLE.tets)
    assert back.point_data.keys() == ANGLE.point_data.keys()
    assert all(np.array_equal(back.point_data[name], values) for name, values in ANGLE.point_data.items())
    assert np.array_equal(back.cell_data["min_dihedral_deg"], angle)


@pytest.mark.parametrize(("name", "reader"), [("c.ply", read_cloud), ("s.ply", read_surface), ("v.vtu", read_solid)])
def test_every_cut_and_many_flips_are_told_or_harmless(tmp_path, name, reader):
    path = tmp_path / name
    write_cloud_ply(tmp_path / "c.ply", CLOUD)
    write_mesh_ply(tmp_path / "s.ply", SKIN)
    write_vtu(tmp_path / "v.vtu", tet_mesh(ANGLE))
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for cut in [0, 3, 40, *rng.integers(0, len(whole) - 1, 30).tolist()]:
        path.write_bytes(whole[:cut])
        with pytest.raises(FormatError, match=name):
            reader(path)
    for place in [*range(0, 120, 3), *rng.integers(0, len(whole), 40).tolist()]:
        flipped = bytearray(whole)
        flipped[place] ^= 0x55
        path.write_bytes(bytes(flipped))
        try:
            reader(path)
        except FormatError as error:
            assert name in str(error)


@pytest.mark.parametrize("text", ["<VTKFile/>", "<a><UnstructuredGrid><Piece/></UnstructuredGrid></a>", "ply\nformat ascii 1.0\nend_header\n"])
def test_other_layouts_are_refused(tmp_path, text):
    path = tmp_path / "x"
    path.write_text(text, encoding="utf-8", newline="\n")
    for reader in (read_cloud, read_surface, read_solid):
        with pytest.raises(FormatError):
            reader(path)
