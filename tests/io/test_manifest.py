"""Every real file with a suffix we read: it reads, with the count its manifest states, or is refused in one clear line."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

import real_scans
from scan2fea.errors import InputError
from scan2fea.io import read_scan
from scan2fea.io.formats import BY_SUFFIX

DATA = real_scans.DATA
FOLDERS = ("formats", "meshes", "structural", "cad_gt", "registration")

# what is no scan, or deliberately broken, and what the line must say
REFUSED = {
    "registration/small_gicp/T_target_source.txt": "4 x 4 pose",
    "registration/3dmatch_demo/gt.npy": "4 x 4 pose",
    "registration/kitti_07/graph.txt": "'v0' in column 1",
    "registration/newer_06_deskew/times_00.bin": "nothing tells that these",
    "registration/newer_06_deskew/times_01.bin": "nothing tells that these",
    "registration/libpointmatcher/carCloudList.csv": "columns named x, y and z are needed",
    "structural/pc2beam/profiles.csv": "no rows of numbers",
    "formats/pdal/las/garbage_nVariableLength.las": "promises 1069128089 variable length records",
    "formats/pdal/las/no-points.las": "promises 0 points",
    "formats/pdal/las/permutations/1.2-no-points.las": "promises 1065 points, but its 229 bytes hold at most 0",
    "formats/pdal/las/spurious.las": "degrees of longitude and latitude",
    "formats/pdal/obj/no_vertex.obj": "no vertices",
    "formats/pdal/pcd/missingheader.pcd": "begins with",
    "formats/pdal/ply/no_vertex.ply": "no element 'vertex'",
    "formats/pdal/ply/sized_dims.ply": "x, y and z are needed",
    "formats/pdal/ply/unsized_dims.ply": "x, y and z are needed",
    "formats/pdal/text/badheader.txt": "x, y and z are needed",
    "formats/pdal/text/text.txt": "no rows of numbers",
    "formats/pdal/text/utm17_3.txt": "line 6: 3 values where 4 are expected",
    "formats/e57/InvalidCVHeader.e57": "without points",
    "formats/e57/PinholeImageWithDistortionParameters.e57": "0 scans",
    "formats/e57/ZeroPoints.e57": "without points",
    "formats/e57/ZeroPointsInvalid.e57": "without points",
    "formats/e57/bad-crc.e57": "checksum mismatch",
    "formats/e57/empty.e57": "0 scans",
    "formats/trimesh/emptyIO_ply_empty_bin.ply": "no points",
    "formats/trimesh/emptyIO_stl_empty_ascii.stl": "no triangles",
    "formats/trimesh/empty.stl": "no triangles",
}
# the manifest counts lines, or vertices after another program has merged or split them; here the rows of the file are counted
OTHERWISE = {
    "registration/libpointmatcher/car_cloud401.csv": 25193,
    "meshes/cgal/elephant-with-holes.off": 2798,
    "meshes/cgal/quads_to_stitch.off": 20,
    "meshes/libigl/cylinder.obj": 220,
    "formats/pdal/obj/hyper_box.obj": 16,
    "formats/pdal/obj/simple_binary.obj": 3,
    "formats/trimesh/negative_indices.obj": 8,
}


def rows():
    if not (DATA / "MANIFEST.csv").is_file():
        return []
    with (DATA / "MANIFEST.csv").open(newline="") as handle:
        table = list(csv.DictReader(handle))
    return [row for row in table if row["file"].split("/")[0] in FOLDERS and Path(row["file"]).suffix.lower() in BY_SUFFIX]


def test_the_real_files_are_there():
    if not rows():
        assert not os.environ.get("CI"), f"{DATA} is missing: continuous integration must test the real files"
        pytest.skip(f"{DATA} is not here: the real files were not tested")


@pytest.mark.parametrize("row", rows(), ids=lambda row: row["file"])
def test_reads_or_refuses(row):
    path = DATA / row["file"]
    if row["file"] in REFUSED:
        with pytest.raises(InputError) as caught:
            read_scan(path)
        message = str(caught.value)
        assert REFUSED[row["file"]] in message and str(path) in message and "\n" not in message
        return
    raw = read_scan(path)
    stated = OTHERWISE.get(row["file"], int(row["points_or_vertices"] or 0))
    assert raw.sha256 == row["sha256"]
    assert raw.n_points == stated or not stated
    assert len(raw.scan.cloud) == raw.n_points - raw.n_dropped - raw.n_misses > 0
    assert np.isfinite(raw.scan.cloud.points).all()
    faces = int(row["faces"] or 0)
    assert (0 if raw.mesh is None else len(raw.mesh.faces)) == faces


FINITE = {"capture0001.pcd": 249647, "capture0002.pcd": 249931, "capture0003.pcd": 248494}


@pytest.mark.parametrize("name", FINITE)
def test_dropped_rows_of_organised_frames(name):
    path = DATA / "registration" / "pcl_pairwise" / name
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    assert len(read_scan(path).scan.cloud) == FINITE[name]


@pytest.mark.parametrize("name, scans", [("A_B.e57", 2), ("A_moved_B.e57", 2)])
def test_e57_equals_pye57(name, scans):
    import pye57

    path = DATA / "formats" / "pdal" / "e57" / name
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    with pye57.E57(str(path)) as file:
        parts = [file.read_scan(k, ignore_missing_fields=True) for k in range(scans)]
    expected = np.concatenate([np.stack([part[f"cartesian{axis}"] for axis in "XYZ"], axis=1) for part in parts])
    np.testing.assert_allclose(read_scan(path).scan.cloud.points, expected, atol=1e-12)


@pytest.mark.parametrize("name", ["laspy/simple.las", "laspy/simple.laz", "laspy/simple.copc.laz", "laspy/extrabytes.las", "laspy/append-bug.laz"])
def test_las_equals_laspy(name):
    import laspy

    path = DATA / "formats" / name
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    file, raw = laspy.read(path), read_scan(path)
    scale = 0.3048 if raw.unit == "ft" else 1.0
    assert (raw.scan.cloud.points == file.xyz * scale).all()
    assert (raw.scan.cloud.intensity == file.intensity).all()
