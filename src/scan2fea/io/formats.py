"""The only place where a suffix becomes a reader: one file per format, one line here.

A file is opened by its suffix and believed only where it also begins as that format does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scan2fea.errors import FormatError, require
from scan2fea.io.e57 import open_e57
from scan2fea.io.files import existing_file
from scan2fea.io.kitti import open_kitti
from scan2fea.io.las import open_las
from scan2fea.io.npy import open_npy, open_npz
from scan2fea.io.nuscenes import open_nuscenes
from scan2fea.io.obj import open_obj
from scan2fea.io.off import open_off
from scan2fea.io.pcap import MAGIC as PCAP_MAGIC
from scan2fea.io.pcd import open_pcd
from scan2fea.io.ply import open_ply
from scan2fea.io.ptx import open_ptx
from scan2fea.io.source import Source
from scan2fea.io.stl import open_stl
from scan2fea.io.text import open_text
from scan2fea.io.velodyne import open_velodyne
from scan2fea.io.vtk_legacy import open_vtk


@dataclass(frozen=True)
class Format:
    """A format of points or triangles. magic : what its files begin with, empty for text that begins with anything."""

    name: str
    suffixes: tuple[str, ...]
    open: Callable[[Path, int], Source]
    magic: tuple[bytes, ...] = ()


FORMATS = (
    Format("PLY", (".ply",), open_ply, (b"ply",)),
    Format("text", (".xyz", ".txt", ".csv", ".asc", ".pts", ".pwn", ".xyzn", ".xyzc", ".xyzi", ".xyzrgb"), open_text),
    Format("PTX", (".ptx",), open_ptx),
    Format("PCD", (".pcd",), open_pcd, (b"# .PCD", b"#.PCD", b"VERSION", b"FIELDS", b"#")),
    Format("LAS", (".las", ".laz"), open_las, (b"LASF",)),
    Format("E57", (".e57",), open_e57, (b"ASTM-E57",)),
    Format("NPY", (".npy",), open_npy, (b"\x93NUMPY",)),
    Format("NPZ", (".npz",), open_npz, (b"PK\x03\x04",)),
    Format("STL", (".stl",), open_stl),
    Format("OBJ", (".obj",), open_obj),
    Format("OFF", (".off",), open_off),
    Format("pcap", (".pcap",), open_velodyne, PCAP_MAGIC),
    Format("KITTI", (".bin",), open_kitti),
    Format("nuScenes", (".pcd.bin",), open_nuscenes),
    Format("legacy VTK", (".vtk",), open_vtk, (b"# vtk DataFile",)),
)
BY_SUFFIX = {suffix: entry for entry in FORMATS for suffix in entry.suffixes}

# what other files begin with: said in messages only
_OTHERS = (
    (b"ISO-10303-21", "STEP"),
    (b"\x89PNG", "PNG"),
    (b"\xff\xd8\xff", "JPEG"),
    (b"%PDF", "PDF"),
    (b"<?xml", "XML"),
    (b"<VTKFile", "VTK XML"),
    (b"$MeshFormat", "Gmsh"),
    (b"glTF", "glTF"),
    (b"\x0a\x0d\x0d\x0a", "pcapng"),
    (b"\x1f\x8b", "gzip"),
    (b"7z\xbc\xaf", "7-Zip"),
    (b"Rar!", "RAR"),
    (b"\x89HDF", "HDF5"),
    (b"MATLAB", "MATLAB"),
)
_SURE = tuple((start, entry.name) for entry in FORMATS for start in entry.magic if len(start) > 3) + _OTHERS


def suffix_of(path: Path) -> str:
    """The suffix of a file that is known, of two parts (.pcd.bin) where it has such a one; else its last part."""
    double = "".join(path.suffixes[-2:]).lower()
    return double if double in BY_SUFFIX else path.suffix.lower()


def format_of(path: Path) -> Format:
    """The format of a file by its suffix. Raises FormatError for an unknown suffix, or where the file begins as another format does."""
    suffix = suffix_of(path)
    if suffix not in BY_SUFFIX:
        raise FormatError(
            f"{path}: suffix {suffix or '(none)'} is not known: known are {', '.join(sorted(BY_SUFFIX))}; export the scan as one of them"
        )
    entry = BY_SUFFIX[suffix]
    with path.open("rb") as handle:
        head = handle.read(16)
    other = next((name for start, name in _SURE if head.startswith(start) and name != entry.name), None)
    if other is None and head.startswith((b"ply\n", b"ply\r")) and entry.name != "PLY":
        other = "PLY"
    if other is not None:
        raise FormatError(f"{path} is named {suffix} but begins as a {other} file does: give it the suffix of its format")
    if entry.magic and not head.lstrip(b"\xef\xbb\xbf \t\r\n" if entry.name == "PCD" else b"").startswith(entry.magic):
        raise FormatError(f"{path} is named {suffix} but begins with {head!r}, not with {entry.magic[0]!r}: it is damaged or another format")
    return entry


def open_source(path: Path) -> tuple[Format, Source]:
    """Open a file of points or triangles by its suffix. Raises InputError, FormatError or EmptyScanError in one line."""
    path = Path(path)
    if suffix_of(path) not in BY_SUFFIX and path.is_file():
        format_of(path)
    size = existing_file(path)
    entry = format_of(path)
    source = entry.open(path, size)
    require(source.n_points is None or source.n_points >= 0, FormatError, f"{path} promises {source.n_points} points: its header is damaged")
    return entry, source
