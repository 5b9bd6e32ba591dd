"""Bare floats (KITTI, nuScenes), legacy VTK and scanners of one beam."""

import numpy as np
import pytest

from scan2fea.errors import FormatError
from scan2fea.io import InputOptions, read_scan

RNG = np.random.default_rng(3)
N = 500


def lidar(n=N):
    """Points as a rotating scanner on a car sees them."""
    a, r = RNG.uniform(0, 2 * np.pi, n), RNG.uniform(3, 60, n)
    return np.column_stack([r * np.cos(a), r * np.sin(a), RNG.normal(-1.5, 0.3, n)]).astype("<f4")


ROWS = {
    3: lambda: lidar(),
    4: lambda: np.column_stack([lidar(), RNG.random(N)]),
    5: lambda: np.column_stack([lidar(), RNG.integers(0, 256, N), RNG.integers(0, 32, N)]),
    6: lambda: np.column_stack([lidar(), RNG.random(N), RNG.integers(0, 32, N), np.linspace(0, 0.1, N)]),
}


@pytest.mark.parametrize("width", ROWS)
@pytest.mark.parametrize("order", ["scan", "shuffled"])
def test_the_width_of_bare_rows_is_told_from_the_values(width, order, tmp_path):
    rows = ROWS[width]().astype("<f4")
    rows = rows if order == "scan" else rows[RNG.permutation(len(rows))]
    (tmp_path / "000000.bin").write_bytes(rows.tobytes())  # 500 rows: 6000, 8000, 10000, 12000 bytes, most widths fit
    raw = read_scan(tmp_path / "000000.bin")
    assert len(raw.columns) == width
    assert (raw.scan.cloud.points == rows[:, :3]).all()
    assert raw.sensor == ("known" if width == 4 else "unknown")
    if width >= 4:
        assert (raw.scan.cloud.intensity == rows[:, 3]).all()


def test_a_kitti_frame_is_seen_from_the_origin_of_its_sensor(tmp_path):
    (tmp_path / "a.bin").write_bytes(np.column_stack([lidar(), RNG.random(N)]).astype("<f4").tobytes())
    scan = read_scan(tmp_path / "a.bin").scan
    assert (scan.sensors() == 0).all()
    np.testing.assert_allclose(scan.rays.range_m, np.linalg.norm(scan.cloud.points, axis=1), rtol=1e-12)


def test_isotropic_values_are_refused_rather_than_guessed(tmp_path):
    (tmp_path / "a.bin").write_bytes(RNG.normal(size=6000).astype("<f4").tobytes())
    with pytest.raises(FormatError, match="convert it to PLY or NPY"):
        read_scan(tmp_path / "a.bin")


def test_nuscenes(tmp_path):
    rows = np.column_stack([lidar(), RNG.integers(0, 256, N), RNG.integers(0, 32, N)]).astype("<f4")
    (tmp_path / "x__LIDAR_TOP__1.pcd.bin").write_bytes(rows.tobytes())
    raw = read_scan(tmp_path / "x__LIDAR_TOP__1.pcd.bin")
    assert (raw.format, raw.columns, raw.sensor) == ("nuScenes", ("x", "y", "z", "intensity", "ring"), "known")
    assert (raw.scan.cloud.points == rows[:, :3]).all() and (raw.scan.cloud.intensity == rows[:, 3]).all()


# ---- legacy VTK

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def vtk(is_text, version, *, cells=True, grid=False):
    def numbers(values, code):
        values = np.asarray(values)
        return (" ".join(map(repr, values.ravel().tolist())) if is_text else values.astype(code).tobytes().decode("latin-1")) + "\n"

    head = f"# vtk DataFile Version {version}\nt\n{'ASCII' if is_text else 'BINARY'}\nDATASET {'UNSTRUCTURED_GRID' if grid else 'POLYDATA'}\n"
    text = head + "POINTS 8 double\n" + numbers(CUBE, ">f8")
    if cells:
        text += "METADATA\nINFORMATION 0\n\n"
        key = "CELLS" if grid else "POLYGONS"
        if version == "5.1":
            text += f"{key} 7 24\nOFFSETS vtktypeint64\n" + numbers(np.arange(0, 25, 4), ">i8")
            text += "CONNECTIVITY vtktypeint64\n" + numbers(QUADS, ">i8")
        else:
            text += f"{key} 6 30\n" + numbers(np.column_stack([np.full(6, 4), QUADS]), ">i4")
        if grid:
            text += "CELL_TYPES 6\n" + numbers(np.full(6, 9), ">i4")
        text += "CELL_DATA 6\nSCALARS quality float 1\nLOOKUP_TABLE default\n" + numbers(np.linspace(0, 1, 6), ">f4")
    text += "POINT_DATA 8\nSCALARS intensity float\nLOOKUP_TABLE own\n" + numbers(np.arange(8.0) / 8, ">f4")
    text += "LOOKUP_TABLE own 2\n" + (numbers(np.linspace(0, 1, 8), ">f4") if is_text else "\x00\x01\x02\x03\x04\x05\x06\x07\n")
    text += "NORMALS n float\n" + numbers(np.tile([0.0, 0.6, 0.8], (8, 1)), ">f4")
    text += "FIELD FieldData 1\nlabel 1 8 int\n" + numbers(np.arange(8) % 3, ">i4")
    return text.encode("latin-1")


@pytest.mark.parametrize("is_text", [True, False])
@pytest.mark.parametrize("version, grid", [("3.0", False), ("5.1", False), ("3.0", True), ("5.1", True)])
def test_legacy_vtk(is_text, version, grid, tmp_path):
    (tmp_path / "a.vtk").write_bytes(vtk(is_text, version, grid=grid))
    raw = read_scan(tmp_path / "a.vtk", InputOptions(labels="label"))
    cloud = raw.scan.cloud
    assert (cloud.points == CUBE).all() and (cloud.intensity == np.arange(8) / 8).all() and (cloud.label == np.arange(8) % 3).all()
    np.testing.assert_allclose(cloud.normals, np.tile([0.0, 0.6, 0.8], (8, 1)), atol=1e-7)
    corner = CUBE[raw.mesh.faces]
    assert len(corner) == 12
    assert np.einsum("fi,fi->f", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum() / 6 == pytest.approx(1.0)


def test_legacy_vtk_without_cells_is_a_cloud(tmp_path):
    (tmp_path / "a.vtk").write_bytes(vtk(True, "3.0", cells=False))
    assert read_scan(tmp_path / "a.vtk").mesh is None


# ---- one beam


@pytest.mark.parametrize("head, factor", [("time,angle,range", 1), ("Time [s], Angle [rad], Range [m]", 1), ("t,angle_deg,range_m", 180 / np.pi)])
def test_one_beam(head, factor, tmp_path):
    angle = np.linspace(-np.pi / 2, np.pi / 2, 11)
    distance = np.where(np.arange(11) % 5 == 0, 0.0, 2.0 + angle**2)  # rows 0, 5 and 10 bring nothing back
    lines = "".join(f"{k * 1e-3},{float(a) * factor!r},{float(r)!r}\n" for k, (a, r) in enumerate(zip(angle, distance, strict=True)))
    (tmp_path / "a.csv").write_text(head + "\n" + lines)
    raw = read_scan(tmp_path / "a.csv")
    hit = distance > 0
    truth = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), 0 * angle])[hit]
    np.testing.assert_allclose(raw.scan.cloud.points, truth, atol=1e-12)
    assert (raw.n_misses, raw.sensor, raw.n_points) == (3, "known", 11)
    np.testing.assert_allclose(raw.scan.rays.range_m[raw.scan.cloud.ray], distance[hit])
    assert any("radians" in note for note in raw.notes) == (head == "time,angle,range")


def test_columns_named_x_y_z_are_believed_before_angle_and_range(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z,angle,range\n1,2,3,0.5,9\n4,5,6,0.6,9\n")
    assert read_scan(tmp_path / "a.csv").scan.cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
