"""STL, text and binary. Corners with exactly the same coordinates are one vertex."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scan2fea.errors import EmptyScanError, FormatError, InputError, require
from scan2fea.io.files import replacing
from scan2fea.io.numbers import mapped, shown
from scan2fea.io.source import Piece, Source
from scan2fea.types import FloatArray, IntArray, TriangleMesh
from scan2fea.units import BYTES_PER_GIB

_LARGEST_TEXT = BYTES_PER_GIB
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_LAST_BIT = 2.0**-23  # of float32, relative
_VOLUME_TOLERANCE = 1e-5  # a tenth of what a reader of the file is asked to find
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")


def open_stl(path: Path, size: int) -> Source:
    """An STL file. Raises FormatError where it is neither text nor binary STL or is cut off, EmptyScanError without triangles."""
    with path.open("rb") as handle:
        head = handle.read(84)
    n = int.from_bytes(head[80:84], "little") if len(head) == 84 else 0
    # many binary files begin with "solid" too: a text holds no zero byte, a count of less than 2^24 triangles does; of more the size decides
    if head.lstrip().lower().startswith(b"solid") and b"\0" not in head and size != 84 + 50 * n:
        corners = _text(path, size)
    else:
        corners = _binary(path, size, n, head)
    vertices, faces = _welded(*merged(corners))

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        yield Piece(points=vertices)

    return Source(columns=("x", "y", "z"), pieces=pieces, n_points=len(vertices), faces=lambda: faces)


def merged(corners: FloatArray) -> tuple[FloatArray, IntArray]:
    """(m, 3, 3) corners of triangles to vertices, in the order they first appear, and faces."""
    flat = np.ascontiguousarray(corners.reshape(-1, 3)) + 0.0  # -0 becomes 0
    _, first, inverse = np.unique(flat.view([("x", "f8"), ("y", "f8"), ("z", "f8")]).reshape(-1), return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return flat[first[order]], rank[inverse].reshape(-1, 3).astype(np.int64)


def _welded(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Join corners on open edges that differ by the last bit of float32, where that takes no triangle away.

    STL repeats the corners of every triangle, and programs that write them from float64 round them apart.
    """
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, inverse, count = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    rim = np.unique(directed[count[inverse.reshape(-1)] == 1])
    if len(rim) < 2:
        return vertices, faces
    pairs = cKDTree(vertices[rim]).query_pairs(_LAST_BIT * float(np.abs(vertices).max()), output_type="ndarray")
    if len(pairs) == 0:
        return vertices, faces
    joined = coo_matrix((np.ones(len(pairs)), (rim[pairs[:, 0]], rim[pairs[:, 1]])), shape=(len(vertices),) * 2)
    _, group = connected_components(joined, directed=False)
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    order = np.argsort(first)  # vertices keep their order
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    welded = rank[number.reshape(-1)][faces]
    collapsed = (welded[:, [0, 1, 2]] == welded[:, [1, 2, 0]]).any(axis=1) & ~(faces[:, [0, 1, 2]] == faces[:, [1, 2, 0]]).any(axis=1)
    return (vertices, faces) if bool(collapsed.any()) else (vertices[first[order]], welded.astype(np.int64))


def _binary(path: Path, size: int, n: int, head: bytes) -> FloatArray:
    require(len(head) == 84, FormatError, f"{path} has {size} bytes, 84 are needed for a binary STL: it is cut off or another format")
    require(
        84 + 50 * n <= size,
        FormatError,
        f"{path} promises {n} triangles, but its {size} bytes hold at most {(size - 84) // 50}: it is cut off or not STL (it begins {head[:12]!r})",
    )
    if n == 0:
        raise EmptyScanError(f"{path} promises 0 triangles: export it again")
    return mapped(path)[84 : 84 + 50 * n].view(_RECORD)["corners"].astype(float)


def _text(path: Path, size: int) -> FloatArray:
    require(size <= _LARGEST_TEXT, InputError, f"{path} has {size} bytes, at most {_LARGEST_TEXT} are read as text: save it as binary STL")
    text = path.read_bytes()
    rows = _VERTEX.findall(text if b"vertex" in text else text.lower())
    if not rows:
        raise EmptyScanError(f"{path} holds no triangles: export it again")
    require(
        len(rows) % 3 == 0 and text.lower().count(b"endfacet") * 3 == len(rows),
        FormatError,
        f"{path} holds {len(rows)} corners and {text.lower().count(b'endfacet')} whole triangles: it is cut off or damaged",
    )
    try:
        return np.array(rows, dtype="S32").astype(float).reshape(-1, 3, 3)
    except ValueError as error:
        raise FormatError(f"{path}: a corner is not of numbers ({shown(str(error).encode())}): correct it") from error


def write_stl(path: Path, mesh: TriangleMesh, scale: float = 1.0) -> None:
    """Binary STL of the mesh times `scale`; as text with all digits where float32 would join vertices, turn a face over or change the volume.

    What is read back and merged on equal coordinates is the same surface: same faces, volume within 1e-4.
    """
    vertices = mesh.vertices * scale
    rounded = vertices.astype(np.float32)
    normals = _unit_normals(vertices, mesh.faces)
    with replacing(path) as handle:
        if _is_kept(vertices, rounded, mesh.faces):
            records = np.zeros(len(mesh.faces), _RECORD)
            records["normal"], records["corners"] = normals, rounded[mesh.faces]
            handle.write(b"scan2fea".ljust(80) + len(records).to_bytes(4, "little") + records.tobytes())
            return
        handle.write(b"solid scan2fea\n")
        for start in range(0, len(mesh.faces), 1 << 16):
            rows = zip(vertices[mesh.faces[start : start + (1 << 16)]].tolist(), normals[start : start + (1 << 16)].tolist(), strict=True)
            handle.write("".join(_facet(corners, normal) for corners, normal in rows).encode())
        handle.write(b"endsolid scan2fea\n")


def _facet(corners: list[list[float]], normal: list[float]) -> str:
    lines = "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in corners)
    return f"facet normal {normal[0]!r} {normal[1]!r} {normal[2]!r}\nouter loop\n{lines}endloop\nendfacet\n"


def _cross(vertices: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal: FloatArray = np.cross(b - a, c - a)
    return normal


def _unit_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    cross = _cross(vertices, faces)
    length = np.sqrt((cross**2).sum(axis=1, keepdims=True))
    unit: FloatArray = np.divide(cross, length, out=np.zeros_like(cross), where=length > 0)
    return unit


def _is_kept(vertices: FloatArray, rounded: npt.NDArray[np.float32], faces: IntArray) -> bool:
    """Whether the surface survives float32: no two distinct vertices join, no face turns over, the volume stays."""
    if not bool(np.isfinite(rounded).all()):
        return False
    exact = len(np.unique(vertices, axis=0))
    if len(np.unique(rounded, axis=0)) != exact:
        return False
    back = rounded.astype(float)
    before, after = _cross(vertices, faces), _cross(back, faces)
    turned = (before * after).sum(axis=1) <= 0
    centre = vertices.mean(axis=0) if len(vertices) else np.zeros(3)
    volumes = [float(((v[faces[:, 0]] - centre) * cross).sum()) for v, cross in ((vertices, before), (back, after))]
    return not bool(turned[(before != 0).any(axis=1)].any()) and abs(volumes[1] - volumes[0]) <= _VOLUME_TOLERANCE * abs(volumes[0])
