"""What `read_scan` makes of files of every format: coordinates, columns, sensors, misses, labels, units."""

import struct

import numpy as np
import pytest

from scan2fea.errors import EmptyScanError, InputError, UsageError
from scan2fea.io import InputOptions, read_scan

RNG = np.random.default_rng(11)
POINTS = RNG.normal(size=(40, 3)).round(4) + np.array([100, 200, 5])


def text_file(path, rows, head="", sep=" "):
    path.write_text(head + "".join(sep.join(repr(v) for v in row) + "\n" for row in np.asarray(rows).tolist()))
    return path


def unit_vectors(n):
    v = RNG.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


# ---- text


@pytest.mark.parametrize(
    "head, sep", [("", " "), ("x y z\n", " "), ("# x y z\n", "\t"), ("//X,Y,Z\n", ","), ('"X";"Y";"Z"\n', ";"), ("X[m], Y[m], Z[m]\n", ", ")]
)
def test_bare_points_as_text(head, sep, tmp_path):
    raw = read_scan(text_file(tmp_path / "a.txt", POINTS, head, sep))
    assert raw.scan.cloud.points.tobytes() == POINTS.tobytes()
    stated = "format" if "[m]" in head else "assumed"
    assert (raw.n_points, raw.n_dropped, raw.unit, raw.unit_source, raw.sensor, raw.mesh) == (40, 0, "m", stated, "unknown", None)
    assert raw.scan.cloud.raw_index.tolist() == list(range(40)) and (raw.scan.cloud.frame == 0).all() and (raw.scan.cloud.ray == -1).all()


def test_columns_by_name_in_any_order_and_case(tmp_path):
    normals, n = unit_vectors(40), 40
    rows = np.column_stack([np.arange(n), POINTS[:, [2, 0, 1]], normals, RNG.integers(0, 256, (n, 3)), RNG.random(n), np.arange(n) % 3])
    raw = read_scan(text_file(tmp_path / "a.csv", rows, "id,Z,X,Y,NX,ny,Normal_Z,R,Green,b,scalar_Intensity,LABEL\n", ","))
    cloud = raw.scan.cloud
    assert (cloud.points == POINTS).all() and (cloud.colour == rows[:, 7:10]).all() and (cloud.intensity == rows[:, 10]).all()
    assert (cloud.label == rows[:, 11]).all()
    np.testing.assert_allclose(cloud.normals, normals, atol=1e-15)


@pytest.mark.parametrize("extra, names", [
    (np.zeros((40, 0)), "x y z"), (RNG.random((40, 1)), "x y z intensity"), (unit_vectors(40), "x y z nx ny nz"),
    (RNG.integers(0, 256, (40, 3)), "x y z red green blue"), (np.column_stack([unit_vectors(40), np.arange(40)]), "x y z nx ny nz label"),
    (RNG.random((40, 3)), "x y z c4 c5 c6"), (RNG.random((40, 4)), "x y z c4 c5 c6 c7"), (RNG.random((40, 2)), "x y z c4 c5"),
    (np.column_stack([RNG.random(40), RNG.integers(0, 256, (40, 3))]), "x y z intensity red green blue"),
    (np.column_stack([RNG.integers(0, 256, (40, 3)), unit_vectors(40)]), "x y z red green blue nx ny nz"),
])  # fmt: skip
def test_unnamed_columns(extra, names, tmp_path):
    raw = read_scan(text_file(tmp_path / "a.xyz", np.column_stack([POINTS, extra])))
    assert raw.columns == tuple(names.split())
    assert (raw.scan.cloud.points == POINTS).all()


def test_labels_by_name_by_number_and_counted_from_0(tmp_path):
    rows = np.column_stack([POINTS, unit_vectors(40), np.arange(40) // 7])
    path = text_file(tmp_path / "a.txt", rows)
    by_default, by_name, from_1, from_0 = (read_scan(path, InputOptions(labels=spec)) for spec in ("", "Label", "7", "6"))
    for raw in (by_default, by_name, from_1, from_0):
        assert (raw.scan.cloud.label == rows[:, 6]).all()
    assert from_1.notes == () and "counted from 0 (label)" in from_0.notes[0]
    with pytest.raises(InputError, match="no whole numbers"):
        read_scan(path, InputOptions(labels="4"))
    with pytest.raises(InputError, match="no column 'part' for the labels: its columns are x, y, z"):
        read_scan(path, InputOptions(labels="part"))
    with pytest.raises(InputError, match="no column '9'"):
        read_scan(path, InputOptions(labels="9"))


def test_a_point_without_a_label_has_minus_one(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z,label\n0,0,0,3\n1,0,0,\n2,0,0,0\n")
    assert read_scan(tmp_path / "a.csv").scan.cloud.label.tolist() == [3, -1, 0]


def test_pts_counts_blocks_and_bom(tmp_path):
    (tmp_path / "a.pts").write_bytes(b"\xef\xbb\xbf2\r\n0 0 0 -12 1 2 3\r\n1 0 0 -11 4 5 6\r\n1\r\n2 0 0 0 7 8 9\r\n")
    raw = read_scan(tmp_path / "a.pts")
    assert raw.n_points == 3 and raw.scan.cloud.colour.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


def test_rows_beyond_the_count_are_read_and_told(tmp_path):
    (tmp_path / "a.pts").write_text("2\n0 0 0\n1 0 0\n2 0 0\n")
    raw = read_scan(tmp_path / "a.pts")
    assert raw.n_points == 3 and raw.notes == ("the file promises 2 points and holds 3: all were read",)


def test_prose_above_the_rows_is_passed_over_and_told(tmp_path):
    (tmp_path / "a.txt").write_text("Exported by a scanner on Monday\n0 0 0\n1 1 1\n")
    raw = read_scan(tmp_path / "a.txt")
    assert raw.n_points == 2 and "line 1 ('Exported by a scanner on Monday') was passed over" in raw.notes


@pytest.mark.parametrize("far, precision, told", [
    (5.4e6, "<f4", "steps of 500 mm"), (16500.0, "<f4", "steps of 1.95 mm"), (5.4e6, "<f8", ""), (4000.0, "<f4", ""),
])  # fmt: skip
def test_single_precision_far_from_the_origin_is_told(far, precision, told, tmp_path):
    np.save(tmp_path / "a.npy", (POINTS + np.array([far / 100, far, 0])).astype(precision))
    assert [told for note in read_scan(tmp_path / "a.npy").notes if told and told in note] == [told] * bool(told)
    assert len(read_scan(tmp_path / "a.npy").notes) == bool(told)


# ---- units, dropping


@pytest.mark.parametrize("rows, columns, x", [
    ("1 2.5 3.5 4.5\n2 2.6 3.5 4.5\n3 2.7 3.5 4.6\n", "number x y z", 2.7),
    ("1 2 3 4.5\n2 2 3 4.5\n3 2 3 4.6\n", "x y z intensity", 3.0),  # a range image in whole steps
    ("2.5 3.5 4.5 1\n2.6 3.5 4.5 2\n2.7 3.5 4.6 3\n", "x y z intensity", 2.7),
])  # fmt: skip
def test_number_of_the_point_is_no_coordinate(rows, columns, x, tmp_path):
    (tmp_path / "a.txt").write_text(rows)
    raw = read_scan(tmp_path / "a.txt")
    assert list(raw.columns) == columns.split() and raw.scan.cloud.points[2, 0] == x
    assert [note.startswith("column 1 goes up by one") for note in raw.notes] == [True] * columns.count("number")


@pytest.mark.parametrize("titles, unit", [
    ("X [mm] Y [mm] Z [mm] Intensity", "mm"), ("# x(ft) y(ft) z(ft) i", "ft"), ("X [m] Y [m] Z [mm] i", ""), ("x [px] y [px] z [px] i", ""),
    ("Intensity [m] X Y Z", ""), ("E [US ft] x [US ft] y [US ft] z [US ft]", "ft_us"),
])  # fmt: skip
def test_titles_state_the_unit(titles, unit, tmp_path):
    (tmp_path / "a.xyz").write_text(f"{titles}\n1 2 3 4\n5 6 7 9\n")
    raw = read_scan(tmp_path / "a.xyz")
    assert (raw.unit, raw.unit_source) == (unit or "m", "format" if unit else "assumed")


def test_separators_of_thousands_are_refused(tmp_path):
    (tmp_path / "a.csv").write_text('X,Y,Z\n"1,431.5","2,345.5","12.5"\n')
    with pytest.raises(InputError, match=r'line 2: "1,431\.5" has separators of thousands'):
        read_scan(tmp_path / "a.csv")


@pytest.mark.parametrize("unit, metres", [("mm", 1e-3), ("in", 0.0254), ("m", 1.0)])
def test_unit_option(unit, metres, tmp_path):
    raw = read_scan(text_file(tmp_path / "a.xyz", POINTS), InputOptions(unit=unit, sensor_position=(1.0, 2.0, 3.0)))
    assert (raw.scan.cloud.points == POINTS * metres).all() and (raw.unit, raw.unit_source) == (unit, "option")
    np.testing.assert_allclose(raw.scan.sensors(), np.tile(np.array([1.0, 2, 3]) * metres, (40, 1)), rtol=1e-15)
    with pytest.raises(UsageError, match="did you mean mm"):
        read_scan(tmp_path / "a.xyz", InputOptions(unit="mmm"))


def test_rows_that_are_not_finite_are_dropped_and_counted(tmp_path):
    (tmp_path / "a.xyz").write_text("0 0 0\nnan 1 1\n1 inf 0\n2 0 0\n-inf 0 nan\n")
    raw = read_scan(tmp_path / "a.xyz")
    assert (raw.n_points, raw.n_dropped, raw.scan.cloud.raw_index.tolist()) == (5, 3, [0, 3])
    assert raw.notes == ("3 of 5 rows are not finite and were dropped",)
    (tmp_path / "b.xyz").write_text("nan nan nan\n")
    with pytest.raises(EmptyScanError, match="no usable point: of 1 rows 1 are not finite"):
        read_scan(tmp_path / "b.xyz")


@pytest.mark.parametrize("x, is_read", [(1e12, True), (-1e12, True), (1.0000001e12, False), (-1e300, False), (1.7e308, False)])
def test_coordinates_that_are_none(x, is_read, tmp_path):
    path = text_file(tmp_path / "a.xyz", [[x, 0, 0], [x, 1, 0]])
    if is_read:
        assert read_scan(path).n_points == 2
    else:
        with pytest.raises(InputError, match=r"has a coordinate of .* m, at most 1e\+12 m is read: it is damaged"):
            read_scan(path)


@pytest.mark.parametrize("rows", [[[1, 2, 3]], [[1, 2, 3]] * 9, [[k, 2 * k, 0] for k in range(9)]])
def test_few_equal_and_collinear_points_are_read(rows, tmp_path):
    assert read_scan(text_file(tmp_path / "a.xyz", rows)).n_points == len(rows)


def test_rays_of_a_given_sensor(tmp_path):
    points = np.array([[3.0, 0, 0], [0, 4.0, 0], [1.0, 1, 1]])
    raw = read_scan(text_file(tmp_path / "a.xyz", points), InputOptions(sensor_position=(1.0, 1.0, 1.0)))
    assert raw.sensor == "known" and raw.scan.cloud.ray.tolist() == [0, 1, -1]  # a point at the sensor itself has no ray
    rays = raw.scan.rays
    np.testing.assert_allclose(rays.origin + rays.direction * rays.range_m[:, None], points[:2], atol=1e-15)


# ---- PLY


def ply(path, form, vertices, faces=None, before=""):
    head = f"ply\nformat {form} 1.0\ncomment x\n{before}element vertex {len(vertices)}\nproperty float x\nproperty double y\nproperty int z\n"
    head += "" if faces is None else f"element face {len(faces)}\nproperty list uchar ushort vertex_index\nproperty short q\n"
    body = b""
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    for x, y, z in vertices:
        body += struct.pack(order + "fdi", x, y, z) if order else f"{x} {y!r} {z}\n".encode()
    for face in faces or []:
        n = len(face)
        body += struct.pack(f"{order}B{n}Hh", n, *face, 7) if order else (" ".join(map(str, [n, *face, 7])) + "\n").encode()
    path.write_bytes(head.encode() + b"end_header\n" + body)
    return path


VERTICES = [(0.5, 1 / 3, 0), (1.5, 0.1, 0), (1.5, 1.0, 2), (0.5, 1.25, -7)]


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("faces", [None, [], [[0, 1, 2], [2, 3, 0]], [[0, 1, 2, 3]], [[0, 1, 2], [0, 1, 2, 3], [1, 2]]])
def test_ply_in_every_encoding(form, faces, tmp_path):
    raw = read_scan(ply(tmp_path / "a.ply", form, VERTICES, faces))
    assert raw.scan.cloud.points.tolist() == [list(v) for v in VERTICES]
    if not faces:
        assert raw.mesh is None
    else:
        cut = [[f[0], f[k], f[k + 1]] for f in faces for k in range(1, len(f) - 1)]
        assert raw.mesh.faces.tolist() == cut and (raw.mesh.vertices == raw.scan.cloud.points).all()


@pytest.mark.parametrize("order", ["", "<", ">"])
def test_ply_with_lists_before_and_in_the_vertices(order, tmp_path):
    form = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = (
        f"ply\r\nformat {form} 1.0\r\nelement first 2\r\nproperty list ushort float a\r\nproperty uchar b\r\nelement vertex 2\r\nproperty float x\r\n"
        "property list uchar double w\r\nproperty float y\r\nproperty float z\r\nend_header\r\n"
    )
    if order:
        body = struct.pack(order + "H2fB", 2, 1, 2, 3) + struct.pack(order + "HB", 0, 3)
        body += struct.pack(order + "fB1d2f", 1, 1, 9, 2, 3) + struct.pack(order + "fB2d2f", 4, 2, 9, 9, 5, 6)
    else:
        body = b"2 1 2 3\r\n0 3\r\n1 1 9 2 3\r\n4 2 9 9 5 6\r\n"
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    assert read_scan(tmp_path / "a.ply").scan.cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_ply_sensor_columns_where_some_are_unknown(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty float sensor_x\n"
        "property float sensor_y\nproperty float sensor_z\nend_header\n1 0 0 0 0 0\n2 0 0 nan nan nan\n"
    )
    raw = read_scan(tmp_path / "a.ply", InputOptions(sensor_position=(9.0, 9.0, 9.0)))
    assert raw.scan.cloud.ray.tolist() == [0, -1] and raw.scan.rays.direction.tolist() == [[1, 0, 0]]


# ---- PCD


def lzf_literals(data):
    return b"".join(bytes([len(part) - 1]) + part for part in (data[k : k + 32] for k in range(0, len(data), 32)))


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_pcd_encodings_viewpoint_and_packed_colour(encoding, tmp_path):
    xyz = POINTS.astype(np.float32)
    bits = np.array([(k << 16) | (2 * k << 8) | 255 for k in range(40)], np.uint32)
    head = (
        "# .PCD v0.7\nVERSION 0.7\n"
        "FIELDS x y z _ rgb\nSIZE 4 4 4 1 4\nTYPE F F F U F\nCOUNT 1 1 1 3 1\nWIDTH 8\nHEIGHT 5\nVIEWPOINT 1 2 3 0 1 0 0\n"
        f"POINTS 40\nDATA {encoding}\n"
    ).encode()
    if encoding == "ascii":
        body = "".join(f"{x!r} {y!r} {z!r} 0 0 0 {c!r}\n" for (x, y, z), c in zip(xyz.tolist(), bits.view(np.float32).tolist(), strict=True)).encode()
    else:
        table = np.zeros(40, [("p", "<f4", 3), ("_", "u1", 3), ("c", "<u4")])
        table["p"], table["c"] = xyz, bits
        body = table.tobytes()
        if encoding == "binary_compressed":
            flat = b"".join([*(xyz[:, k].tobytes() for k in range(3)), table["_"].tobytes(), bits.tobytes()])
            packed = lzf_literals(flat)
            body = struct.pack("<II", len(packed), len(flat)) + packed
    (tmp_path / "a.pcd").write_bytes(head + body)
    raw = read_scan(tmp_path / "a.pcd")
    assert (raw.scan.cloud.points == xyz).all() and raw.sensor == "known"
    assert (raw.scan.sensors() == [1, 2, 3]).all()
    assert raw.scan.cloud.colour.tolist() == [[k, 2 * k, 255] for k in range(40)]


def test_pcd_viewpoint_of_zero_is_unknown(tmp_path):
    (tmp_path / "a.pcd").write_text(
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nDATA ascii\n1 2 3\n"
    )
    assert read_scan(tmp_path / "a.pcd").sensor == "unknown"


# ---- LAS


def las(path, xyz, scale=0.001, offset=(0.0, 0.0, 0.0), vlrs=b"", n_vlrs=0, promised=None, version=2):
    whole = np.rint((xyz - np.array(offset)) / scale).astype("<i4")
    head = bytearray(227)
    head[:4], head[24], head[25] = b"LASF", 1, version
    struct.pack_into("<HIIBHI", head, 94, 227, 227 + len(vlrs), n_vlrs, 0, 20, len(xyz) if promised is None else promised)
    struct.pack_into("<6d", head, 131, scale, scale, scale, *offset)
    table = np.zeros(len(xyz), [("p", "<i4", 3), ("i", "<u2"), ("r", "u1"), ("c", "u1"), ("rest", "V4")])
    table["p"], table["i"], table["c"] = whole, np.arange(len(xyz)), 0xE0 + np.arange(len(xyz)) % 5
    path.write_bytes(bytes(head) + vlrs + table.tobytes())
    return path


def vlr(number, content, user=b"LASF_Projection"):
    return b"\0\0" + user.ljust(16, b"\0") + struct.pack("<HH", number, len(content)) + b"\0" * 32 + content


def geokeys(*keys):
    return vlr(34735, struct.pack("<4H", 1, 1, 0, len(keys)) + b"".join(struct.pack("<4H", key, 0, 1, value) for key, value in keys))


def test_las_keeps_millimetres_at_utm_coordinates(tmp_path):
    xyz = POINTS + np.array([450_000, 5_400_000, 0])
    raw = read_scan(las(tmp_path / "a.las", xyz, 1e-4, (450_000.0, 5_400_000.0, 0.0)), InputOptions(labels="classification"))
    assert np.abs(raw.scan.cloud.points - xyz).max() <= 1e-9
    assert raw.scan.cloud.intensity.tolist() == list(range(40)) and raw.scan.cloud.label.tolist() == [k % 5 for k in range(40)]
    assert raw.unit_source == "assumed"


WKT = 'PROJCS["a",GEOGCS["b",UNIT["degree",0.0174532925199433]],UNIT["{}",{}]]'


@pytest.mark.parametrize("record, unit", [
    (geokeys((1024, 1), (3076, 9001)), "m"), (geokeys((1024, 1), (3076, 9002)), "ft"), (geokeys((1024, 1), (3076, 9003)), "ft_us"),
    (geokeys((1024, 1), (3072, 32632)), "m"), (vlr(2112, WKT.format("metre", 1).encode()), "m"),
    (vlr(2112, WKT.format("US survey foot", 0.3048006096012192).encode() + b"\0"), "ft_us"), (vlr(2112, WKT.format("foot", 0.3048).encode()), "ft"),
])  # fmt: skip
def test_las_states_its_unit(record, unit, tmp_path):
    raw = read_scan(las(tmp_path / "a.las", POINTS, vlrs=record, n_vlrs=1))
    assert (raw.unit, raw.unit_source) == (unit, "format")
    assert read_scan(tmp_path / "a.las", InputOptions(unit="cm")).unit_source == "option"


@pytest.mark.parametrize("record", [geokeys((1024, 2)), vlr(2112, b'GEOGCS["WGS 84",UNIT["degree",0.0174532925199433]]')])
def test_las_in_degrees_is_refused(record, tmp_path):
    with pytest.raises(InputError, match="degrees of longitude"):
        read_scan(las(tmp_path / "a.las", POINTS, vlrs=record, n_vlrs=1))


def test_laz_equals_las(tmp_path):
    import laspy

    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [100, 200, 0]
    file = laspy.LasData(header)
    file.x, file.y, file.z = POINTS.T
    file.red = file.green = file.blue = np.arange(40) * 257
    file.add_extra_dim(laspy.ExtraBytesParams("part", "int16"))
    file["part"] = np.arange(40) // 9
    file.write(tmp_path / "a.las")
    file.write(tmp_path / "a.laz")
    a, b = (read_scan(tmp_path / name, InputOptions(labels="part")) for name in ("a.las", "a.laz"))
    for raw in (a, b):
        assert np.abs(raw.scan.cloud.points - POINTS).max() < 0.00051
        assert raw.scan.cloud.colour[:, 0].tolist() == list(range(40)) and raw.scan.cloud.label.tolist() == [k // 9 for k in range(40)]
    assert a.scan.cloud.points.tobytes() == b.scan.cloud.points.tobytes()


# ---- NumPy


@pytest.mark.parametrize("array", [POINTS, np.asfortranarray(POINTS), POINTS.astype(">f8"), np.round(POINTS).astype(np.int16)])
def test_npy(array, tmp_path):
    np.save(tmp_path / "a.npy", array)
    assert (read_scan(tmp_path / "a.npy").scan.cloud.points == array).all()


def test_npy_records_and_npz(tmp_path):
    table = np.zeros(40, [("label", "i4"), ("xyz", "f8", 3)])
    table["xyz"], table["label"] = POINTS, np.arange(40)
    np.save(tmp_path / "a.npy", table)
    np.savez_compressed(
        tmp_path / "a.npz",
        points=POINTS,
        label=np.arange(40),
        sensor_x=np.zeros(40),
        sensor_y=np.ones(40),
        sensor_z=np.ones(40),
        part=np.arange(40) // 2,
    )
    for raw in (read_scan(tmp_path / "a.npy"), read_scan(tmp_path / "a.npz")):
        assert (raw.scan.cloud.points == POINTS).all() and raw.scan.cloud.label.tolist() == list(range(40))
    raw = read_scan(tmp_path / "a.npz", InputOptions(labels="part"))
    assert raw.scan.cloud.label.tolist() == [k // 2 for k in range(40)] and (raw.scan.sensors() == [0, 1, 1]).all()


# ---- OBJ, OFF, STL


def test_obj_polygons_back_references_and_colours(tmp_path):
    (tmp_path / "a.obj").write_text(
        "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 .5\nf -3//1 -2//1 -1//1\nv 0 1 0 1 1 1\nvn 0 0 1\nf 1/2/3 2 \\\n 3 4\n"
    )
    raw = read_scan(tmp_path / "a.obj")
    assert raw.mesh.faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]
    assert raw.scan.cloud.colour.tolist() == [[255, 0, 0], [0, 255, 0], [0, 0, 128], [255, 255, 255]]


@pytest.mark.parametrize("head", ["OFF\n4 2 0\n", "OFF 4 2 0 # c\n\n", "# c\nOFF\n# d\n4 2 5\n"])
def test_off(head, tmp_path):
    (tmp_path / "a.off").write_text(head + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 255 0 0\n4 0 1 2 3\n")
    assert read_scan(tmp_path / "a.off").mesh.faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]


def test_stl_welds_corners_that_float32_tore_apart(tmp_path):
    corners = np.array(
        [[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 0, 0], [0, 0, 1], [1, 0, 0]], [[1, 0, 0], [0, 0, 1], [0, 1, 0]]],
        np.float32,
    )
    corners[3, 0, 0] = np.nextafter(np.float32(1), np.float32(2))
    table = np.zeros(4, [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    table["c"] = corners
    (tmp_path / "a.stl").write_bytes(b"solid but binary".ljust(80) + struct.pack("<I", 4) + table.tobytes())
    raw = read_scan(tmp_path / "a.stl")
    assert len(raw.mesh.vertices) == 4 and raw.mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]


# ---- range images
