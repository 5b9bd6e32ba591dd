"""Files that are not what they say: one clear line, at once, without memory for what is only promised."""

import io
import struct
import time
import tracemalloc
import zipfile

import numpy as np
import pytest

from scan2fea.errors import EmptyScanError, FormatError, InputError
from scan2fea.io import read_scan
from scan2fea.io.formats import BY_SUFFIX, suffix_of
from scan2fea.io.velodyne import write_velodyne

HUGE = 10**12


def npy(header, body=b""):
    text = header.ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + body


def npz(content, name="points.npy"):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(name, content)
    return buffer.getvalue()


def las(n=10, form=0, row=20, n_vlrs=0, start=227, size=227, scale=0.01, body=b"\0" * 200, version=2):
    head = bytearray(227)
    head[:4], head[24], head[25] = b"LASF", 1, version
    struct.pack_into("<HIIBHI", head, 94, size, start, n_vlrs, form, row, n)
    struct.pack_into("<6d", head, 131, scale, scale, scale, 0, 0, 0)
    return bytes(head) + body


def pcd(points="POINTS 3", data="ascii", body="1 2 3\n4 5 6\n7 8 9\n", fields="x y z", size="4 4 4", kind="F F F"):
    head = f"VERSION 0.7\nFIELDS {fields}\nSIZE {size}\nTYPE {kind}\nCOUNT 1 1 1\n{points}\nDATA {data}\n"
    return head.encode() + (body.encode() if isinstance(body, str) else body)


def ply(n=1, form="ascii", body=b"1 2 3\n", extra="", more=""):
    head = f"ply\nformat {form} 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\n{extra}{more}end_header\n"
    return head.encode() + body


FACE = "element face {}\nproperty list {} int vertex_indices\n"
VTK = b"# vtk DataFile Version 3.0\ntitle\n%s\n"
PTX = b"{} {}\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
E57 = b"ASTM-E57" + struct.pack("<IIQQQQ", 1, 0, 1024, 48, 100, 1024)

BAD = {
    # name: (content, what the message must say)
    "empty.ply": (b"", "0 bytes"),
    "empty.xyz": (b"", "0 bytes"),
    "empty.las": (b"", "0 bytes"),
    "empty.e57": (b"", "0 bytes"),
    # not what the suffix says
    "png.ply": (b"\x89PNG\r\n\x1a\n" + b"\0" * 99, "begins as a PNG file"),
    "las.xyz": (las(), "begins as a LAS file"),
    "ply.txt": (ply(), "begins as a PLY file"),
    "step.stl": (b"ISO-10303-21;\n", "begins as a STEP file"),
    "junk.las": (b"junk" * 99, "begins with"),
    "junk.e57": (b"junk" * 99, "begins with"),
    "junk.npy": (b"junk" * 99, "begins with"),
    "zip.xyz": (b"PK\x03\x04" + b"\0" * 50, "begins as a NPZ file"),
    "blob.xyz": (bytes(range(256)) * 40, "not text"),
    "blob.csv": (np.random.default_rng(0).bytes(9999), "not text"),
    "blob.ptx": (b"\x01\x02" * 99, "not text"),
    "blob.obj": (bytes(range(256)), "not text"),
    "blob.off": (b"OFF\0\1", "is not a number|damaged"),
    "blob.stl": (bytes(range(200)), "promises"),
    "utf16.txt": ("1 2 3\n4 5 6\n".encode("utf-16"), "UTF-16"),
    "utf16le.csv": ("1,2,3\n4,5,6\n".encode("utf-16-le"), "UTF-16"),
    # text
    "prose.txt": (b"This is a letter.\n", "no rows of numbers"),
    "names.csv": (b"x,y,z\n", "line of names, but no rows"),
    "blank.xyz": (b"\n \n# c\n", "no rows"),
    "two.xyz": (b"1 2\n3 4\n", "no rows of numbers"),
    "badname.csv": (b"x,y,w\n1,2,3\n", "columns named x, y and z are needed"),
    "cut.xyz": (b"1 2 3\n4 5\n", "line 2"),
    "word.xyz": (b"1 2 3\n1 2 three\n", "line 2: 'three'"),
    "noline.xyz": (b"1 2 3 " * 20000, "no line ends within its first 65536 bytes"),
    "mac.xyz": (b"1 2 3\r4 5 6\r", "CR alone"),
    "neg.pts": (b"-5\n1 2 3\n", "promises -5 points"),
    "huge.pts": (b"1000000000000\n1 2 3\n", "promises 1000000000000"),
    "cut.pts": (b"3\n1 2 3\n4 5 6\n", "promises 3 points, but holds 2"),
    "zero.pts": (b"0\n", "promises 0 points"),
    "pose.txt": (b"1 0 0 5\n0 1 0 5\n0 0 1 5\n0 0 0 1\n", "4 x 4 pose"),
    # PLY
    "cut.ply": (b"ply\nformat ascii 1.0\nelement vertex 3\n", "no end_header"),
    "nofmt.ply": (b"ply\nelement vertex 3\nend_header\n", "no line 'format'"),
    "junk.ply": (b"ply\nformat ascii 1.0\nhello\nend_header\n", "'hello', which is not PLY"),
    "short.ply": (ply(2), "promises 2"),
    "huge.ply": (ply(HUGE), f"promises {HUGE}"),
    "hugebin.ply": (ply(HUGE, "binary_little_endian"), f"promises {HUGE}"),
    "neg.ply": (ply(-4), "promises -4"),
    "zero.ply": (ply(0, body=b""), "no points"),
    "list.ply": (ply(1, "binary_little_endian", b"\0" * 12 + b"\xff\xff\xff\x7f", more=FACE.format(1, "int")), "a list is longer"),
    "neglist.ply": (ply(1, "binary_big_endian", b"\0" * 12 + b"\xff\xff\xff\xff", more=FACE.format(1, "int")), "a list is longer"),
    "hugeface.ply": (ply(1, "binary_little_endian", b"\0" * 20, more=FACE.format(HUGE, "uchar")), f"promises {HUGE} rows of face"),
    "alist.ply": (ply(1, body=b"1 2 3\n1e9 0 1\n", more=FACE.format(1, "int")), "a list is longer"),
    "face.ply": (ply(1, body=b"1 2 3\n3 0 0 9\n", more=FACE.format(1, "uchar")), "vertex 9"),
    "negface.ply": (ply(1, body=b"1 2 3\n3 0 0 -1\n", more=FACE.format(1, "uchar")), "vertex -1"),
    "nan.ply": (ply(1, body=b"1 nan 3\n3 0 0 0\n", more=FACE.format(1, "uchar")), "not finite"),
    "type.ply": (ply(extra="property quad w\n"), "which is not PLY"),
    "noxyz.ply": (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty int a\nend_header\n1\n", "x, y and z are needed"),
    # PCD
    "huge.pcd": (pcd(f"POINTS {HUGE}"), f"promises {HUGE}"),
    "hugebin.pcd": (pcd(f"WIDTH {HUGE}\nHEIGHT {HUGE}", "binary"), "promises"),
    "neg.pcd": (pcd("POINTS -1"), "promises -1"),
    "zero.pcd": (pcd("POINTS 0"), "promises 0"),
    "cut.pcd": (pcd("POINTS 4"), "promises 4"),
    "data.pcd": (pcd(data="zipped"), "DATA 'zipped'"),
    "nodata.pcd": (b"VERSION 0.7\nFIELDS x y z\n", "no line DATA"),
    "size.pcd": (pcd(size="4 4 3"), "SIZE 3"),
    "noxyz.pcd": (pcd(fields="x y q"), "x, y and z are needed"),
    "entries.pcd": (pcd(size="4 4"), "have 3, 2, 3 and 3 entries"),
    "lzf.pcd": (pcd(data="binary_compressed", body=struct.pack("<II", 4, 36) + b"\xff\xff\xff\xff"), "compressed points are damaged"),
    "lzfsize.pcd": (pcd(data="binary_compressed", body=struct.pack("<II", 2**31, 2**32 - 1)), "it is damaged|hold at most"),
    "nopoints.pcd": (pcd(""), "no number of POINTS"),
    # LAS
    "short.las": (b"LASF" + b"\0" * 50, "a LAS header has 227"),
    "cut.las": (las(11), "promises 11 points, but its 427 bytes hold at most 10"),
    "huge.las": (las(2**32 - 1), "promises 4294967295"),
    "vlrs.las": (las(n_vlrs=1069128089), "promises 1069128089 variable length records"),
    "start.las": (las(start=10**6), "puts the points at byte 1000000"),
    "format.las": (las(form=33), "point format 33"),
    "row.las": (las(row=3), "records have 3 bytes"),
    "scale.las": (las(scale=float("nan")), "not usable"),
    "zero.las": (las(0), "promises 0 points"),
    "version.las": (las(version=9), "LAS 1.9"),
    "nozip.laz": (las(form=128), "LASzip record is missing"),
    # E57
    "short.e57": (b"ASTM-E57", "an E57 header has 48"),
    "cut.e57": (E57, "promises 1024 bytes, but has 48"),
    "sum.e57": (E57.ljust(1024, b"\0"), "no sound E57"),
    "page.e57": (b"ASTM-E57" + struct.pack("<IIQQQQ", 1, 0, 48, 48, 0, 7), "pages of 7 bytes"),
    "xml.e57": ((b"ASTM-E57" + struct.pack("<IIQQQQ", 1, 0, 1024, 2**60, 2**60, 1024)).ljust(1024, b"\0"), "description of"),
    # PTX
    "huge.ptx": (PTX.replace(b"{}", b"1000000"), "1e\\+06 columns of 1e\\+06"),
    "neg.ptx": (PTX.replace(b"{}", b"-2"), "-2 columns"),
    "cut.ptx": (PTX.replace(b"{}", b"1") + b"", "at most|0 values"),
    "rows.ptx": (PTX.replace(b"{}", b"2") + b"1 1 1 1\n" * 3, "promises 4 points"),
    "head.ptx": (b"4 4\n0 0 0\n", "ends too early"),
    "misses.ptx": (PTX.replace(b"{}", b"2") + b"0 0 0 1\n" * 4, "4 are rays without return"),
    # NumPy
    "huge.npy": (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3)}"), "promises an array of"),
    "neg.npy": (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 3)}"), "damaged"),
    "object.npy": (npy("{'descr': '|O', 'fortran_order': False, 'shape': (1,)}", b"cos\nsystem\n"), "never loaded"),
    "code.npy": (npy("__import__('os').system('true')"), "no sound NPY"),
    "text.npy": (npy("{'descr': '<U1', 'fortran_order': False, 'shape': (1, 3)}", b"\0" * 12), "not numbers"),
    "cube.npy": (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 1, 3)}", b"\0" * 24), "shape"),
    "pair.npy": (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 2)}", b"\0" * 16), "x, y and z, are needed"),
    "zero.npy": (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (0, 3)}"), "no points"),
    "cut.npz": (npz(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 3)}", b"\0" * 24))[:80], "no sound archive"),
    "none.npz": (npz(b"x", "a.txt"), "holds no arrays"),
    "huge.npz": (npz(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3)}")), "promises an array of"),
    # meshes
    "short.stl": (b"x" * 50, "84 are needed"),
    "cut.stl": (b"\0" * 80 + struct.pack("<I", 9) + b"\0" * 50, "promises 9 triangles"),
    "solid.stl": (b"solid plate".ljust(80) + struct.pack("<I", 9) + b"1" * 50, "promises 9 triangles"),
    "zero.stl": (b"\0" * 84, "promises 0 triangles"),
    "empty.stl": (b"solid a\nendsolid a\n", "no triangles"),
    "open.stl": (b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n", "2 corners and 0 whole"),
    "word.stl": (
        b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex a b c\nendloop\nendfacet\nendsolid\n",
        "not of numbers",
    ),
    "none.obj": (b"# nothing\n", "no vertices"),
    "zero.obj": (b"v 0 0 0\nf 0 0 0\n", "vertex 0"),
    "word.obj": (b"v 0 0 a\n", "not of numbers"),
    "beyond.obj": (b"v 0 0 0\nf 1 1 2\n", "vertex 1"),
    "mixed.obj": (b"v 0 0 0\nv 0 0\n", "different numbers"),
    "none.off": (b"hello\n", "not with OFF"),
    "huge.off": (b"OFF\n1000000000000 1 0\n", "promises 1000000000000"),
    "cut.off": (b"OFF\n2 0 0\n0 0 0\n0 0\n", "ends within them"),
    "face.off": (b"OFF\n1 1 0\n0 0 0\n9 0 0\n", "fewer corners"),
    "zero.off": (b"OFF\n0 0 0\n", "promises 0 vertices"),
    "neg.off": (b"OFF\n-1 0 0\n", "damaged"),
    "beyond.off": (b"OFF\n1 1 0\n0 0 0\n3 0 0 7\n", "vertex 7"),
    "nofaces.off": (b"OFF\n1 2 0\n0 0 0\n3 0 0 0 # a comment\n", "holds 1"),
    # suffixes
    "scan.xyz.gz": (b"\x1f\x8b", "suffix .gz is not known"),
    "scan": (b"1 2 3\n", "suffix .none. is not known"),
    # bare floats
    "odd.bin": (b"\0" * 4003, "no whole 32-bit floats"),
    "one.bin": (np.arange(6000, dtype="<f4").tobytes(), "nothing tells that these 24000 bytes are rows"),
    "nan.bin": (np.full(6000, np.nan, "<f4").tobytes(), "nothing tells"),
    "cut.pcd.bin": (b"\0" * 39, "no whole rows of x y z intensity ring"),
    "ring.pcd.bin": (np.full(50, 0.5, "<f4").tobytes(), "no ring numbers"),
    # legacy VTK
    "junk.vtk": (b"# vtk", "begins with"),
    "kind.vtk": (b"# vtk DataFile Version 3.0\nt\nzipped\n", "not ASCII or BINARY"),
    "grid.vtk": (VTK % b"ASCII" + b"DATASET STRUCTURED_POINTS\n", "STRUCTURED_POINTS"),
    "none.vtk": (VTK % b"ASCII" + b"DATASET POLYDATA\n", "no POINTS"),
    "huge.vtk": (VTK % b"ASCII" + b"DATASET POLYDATA\nPOINTS 1000000000000 float\n1 2 3\n", "line 5: 1000000000000 rows of 3"),
    "hugebin.vtk": (VTK % b"BINARY" + b"DATASET POLYDATA\nPOINTS 1000000000000 float\n", "1000000000000 rows of 3"),
    "neg.vtk": (VTK % b"ASCII" + b"DATASET POLYDATA\nPOINTS -1 float\n", "'-1' after POINTS is no count"),
    "type.vtk": (VTK % b"ASCII" + b"DATASET POLYDATA\nPOINTS 1 quad\n1 2 3\n", "'quad' is no type"),
    "word.vtk": (VTK % b"ASCII" + b"DATASET POLYDATA\nPOINTS 1 float\n1 2 x\n", "line 6: 'x' is not a number"),
    "cut.vtk": (VTK % b"ASCII" + b"DATASET POLYDATA\nPOINTS 3 float\n1.5 2.5 3.5 4.5 5.5 6.5 7.5 8.5\n", "ends within an array"),
    "key.vtk": (VTK % b"ASCII" + b"DATASET POLYDATA\nPOINTS 1 float\n1 2 3\nHELLO 3\n", "'HELLO' is no keyword"),
    "face.vtk": (VTK % b"ASCII" + b"DATASET POLYDATA\nPOINTS 1 float\n1 2 3\nPOLYGONS 1 4\n3 0 0 9\n", "vertex 9"),
    "corners.vtk": (VTK % b"ASCII" + b"DATASET POLYDATA\nPOINTS 1 float\n1 2 3\nPOLYGONS 1 4\n9 0 0 0\n", "a cell has 9 corners"),
    "rows.vtk": (VTK % b"ASCII" + b"DATASET POLYDATA\nPOINTS 1 float\n1 2 3\nPOINT_DATA 2\nSCALARS a float\n1 2\n", "a has 2 rows"),
    # one beam
    "far.csv": (b"time,angle,range\n0,90,1\n0,180,1\n", "180 rad, beyond 3 turns: name the column angle_deg"),
    "nan.csv": (b"time,angle,range\n0,nan,1\n", "angle that is not finite"),
    "missed.csv": (b"time,angle,range\n0,0.1,0\n", "1 are rays without return"),
    "range.csv": (b"time,range,q\n0,1,1\n", "or angle and range"),
}


@pytest.mark.parametrize("name", BAD)
def test_one_clear_line(name, tmp_path):
    content, said = BAD[name]
    path = tmp_path / name
    path.write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=said) as caught:
            read_scan(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    message = str(caught.value)
    assert str(path) in message and "\n" not in message and len(message) < 400 + len(str(path))
    assert peak < 100e6


def test_missing_and_folder(tmp_path):
    with pytest.raises(InputError, match=r"none\.ply cannot be read"):
        read_scan(tmp_path / "none.ply")
    (tmp_path / "a.ply").mkdir()
    with pytest.raises(InputError, match="is a folder: name the files in it"):
        read_scan(tmp_path / "a.ply")


def test_a_gigabyte_without_a_line_end(tmp_path):
    with (tmp_path / "a.xyz").open("wb") as handle:
        handle.write(b"1 2 3\n")
        handle.truncate(2**30)  # zeros, not on disk
    started = time.monotonic()
    with pytest.raises(FormatError):
        read_scan(tmp_path / "a.xyz")
    with (tmp_path / "b.xyz").open("wb") as handle:
        handle.write(b"1 2 3\n4 5 6 ")
        for _ in range(64):
            handle.write(b"7 " * 2**19)
    with pytest.raises(FormatError, match=r"line 2: .* values where 3 are expected, too many"):
        read_scan(tmp_path / "b.xyz")
    assert time.monotonic() - started < 30


def sound_files(folder):
    """One small sound file per format."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(60, 3))
    text = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
    (folder / "a.xyz").write_text(text)
    (folder / "a.pts").write_text("60\n" + text)
    (folder / "a.ptx").write_bytes(PTX.replace(b"{}", b"6", 1).replace(b"{}", b"10") + text.replace("\n", " 1\n").encode())
    (folder / "a.ply").write_bytes(
        ply(60, "binary_big_endian", points.astype(">f4").tobytes() + struct.pack(">B3i", 3, 0, 1, 2), more=FACE.format(1, "uchar"))
    )
    (folder / "b.ply").write_bytes(ply(60, body=text.encode() + b"4 0 1 2 3\n", more=FACE.format(1, "uchar")))
    (folder / "a.pcd").write_bytes(pcd("POINTS 60", "binary", points.astype("<f4").tobytes()))
    (folder / "a.las").write_bytes(las(60, body=rng.bytes(1200)))
    np.save(folder / "a.npy", points)
    np.savez_compressed(folder / "a.npz", points=points)
    (folder / "a.obj").write_text("v " + text.strip().replace("\n", "\nv ") + "\nf 1 2 3\n")
    (folder / "a.off").write_text(f"OFF\n60 1 0\n{text}3 0 1 2\n")
    table = np.zeros(4, [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    table["c"] = rng.normal(size=(4, 3, 3))
    (folder / "a.stl").write_bytes(b"\0" * 80 + struct.pack("<I", 4) + table.tobytes())
    import laspy
    import pye57

    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales = [0.001] * 3
    file = laspy.LasData(header)
    file.x, file.y, file.z = points.T
    file.write(folder / "a.laz")
    with pye57.E57(str(folder / "a.e57"), "w") as e57:
        e57.write_scan_raw({f"cartesian{axis}": points[:, k].copy() for k, axis in enumerate("XYZ")})
    (folder / "a.vtk").write_bytes(VTK % b"BINARY" + b"DATASET POLYDATA\nPOINTS 60 double\n" + points.astype(">f8").tobytes())
    (folder / "b.vtk").write_text((VTK % b"ASCII").decode() + f"DATASET POLYDATA\nPOINTS 60 float\n{text}POLYGONS 1 4\n3 0 1 2\n")
    (folder / "a.bin").write_bytes(np.column_stack([5 + points, rng.random(60)]).astype("<f4").tobytes())
    (folder / "a.pcd.bin").write_bytes(np.column_stack([points, rng.random(60), np.arange(60) % 32]).astype("<f4").tobytes())
    (folder / "planar.csv").write_text("time,angle,range\n" + "".join(f"{k},{0.1 * k!r},{2.5 + k}\n" for k in range(20)))
    turn = 46.08e-6 * np.arange(30)
    write_velodyne(folder / "a.pcap", turn, 360 * 20 * turn, rng.uniform(1, 100, (30, 32)), np.ones((30, 32)))
    return sorted(folder.iterdir())


def test_cut_and_garbled_files_of_every_format_never_escape(tmp_path):
    """Cut anywhere, or with bytes changed: read, or refused in one line that names the file; nothing else is raised."""
    folder = tmp_path / "sound"
    folder.mkdir()
    files = sound_files(folder)
    assert {suffix_of(path) for path in files} >= {suffix for suffix in BY_SUFFIX if suffix not in (".txt", ".csv", ".asc", ".pwn")} - {
        ".xyzn", ".xyzc", ".xyzi", ".xyzrgb",
    }  # fmt: skip
    rng = np.random.default_rng(1)
    for path in files:
        assert read_scan(path).n_points >= 4
        whole = path.read_bytes()
        target = tmp_path / f"bad{suffix_of(path)}"
        cuts = [whole[:n] for n in rng.integers(1, len(whole), 15)]
        garbled = []
        for k in range(40):
            copy = bytearray(whole)
            for place in rng.integers(0, len(whole) if k % 2 else min(len(whole), 300), 3):
                copy[place] = int(rng.integers(0, 256))
            garbled.append(bytes(copy))
        for content in cuts + garbled:
            target.write_bytes(content)
            try:
                raw = read_scan(target)
                assert np.isfinite(raw.scan.cloud.points).all()
            except InputError as error:
                assert str(target) in str(error) and "\n" not in str(error), str(error)


def test_empty_scan_error_is_raised_where_the_file_is_sound(tmp_path):
    (tmp_path / "a.pcd").write_bytes(pcd("POINTS 0"))
    with pytest.raises(EmptyScanError):
        read_scan(tmp_path / "a.pcd")
