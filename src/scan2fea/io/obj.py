"""Wavefront OBJ: the lines `v` and `f`; materials, texture and normals are passed over."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scan2fea.errors import EmptyScanError, FormatError, InputError, require
from scan2fea.io.polygons import triangulated
from scan2fea.io.source import Column, Piece, Source
from scan2fea.io.text import require_text
from scan2fea.types import FloatArray, IntArray
from scan2fea.units import BYTES_PER_GIB

_LARGEST = BYTES_PER_GIB  # the text is held in memory
_VERTEX = re.compile(rb"^[ \t]*v[ \t]+(.*?)[ \t\r]*$", re.MULTILINE)
_FACE = re.compile(rb"^[ \t]*f[ \t]+(.*?)[ \t\r]*$", re.MULTILINE)
_BESIDE = re.compile(rb"/\S*")


def open_obj(path: Path, size: int) -> Source:
    """An OBJ file. Raises FormatError where a line is not sound, EmptyScanError without vertices."""
    require(size <= _LARGEST, InputError, f"{path} has {size} bytes, at most {_LARGEST} are read as OBJ: convert it to PLY")
    with path.open("rb") as handle:
        require_text(path, handle.read(1 << 16), size)
    text = path.read_bytes().replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")  # a backslash carries a line on
    rows = _VERTEX.findall(text)
    if not rows:
        raise EmptyScanError(f"{path} has no vertices (lines 'v x y z'): export it again")
    vertices = _vertices(path, rows)
    has_colours = vertices.shape[1] in (6, 7)
    names = ("x", "y", "z", "red", "green", "blue") if has_colours else ("x", "y", "z")

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        beside: dict[str, Column] = {name: vertices[:, k] for k, name in enumerate(names) if name in wanted}
        yield Piece(points=vertices[:, :3], columns=beside)

    has_faces = _FACE.search(text) is not None
    return Source(columns=names, pieces=pieces, n_points=len(vertices), faces=(lambda: _faces(path, text, len(vertices))) if has_faces else None)


def _vertices(path: Path, rows: list[bytes]) -> FloatArray:
    width = len(rows[0].split())
    require(width >= 3, FormatError, f"{path}: its first vertex has {width} coordinates, 3 are needed: it is cut off or damaged")
    try:
        flat = np.array(b" ".join(rows).split(), dtype="S32").astype(float)
    except ValueError as error:
        raise FormatError(f"{path}: a vertex is not of numbers ({error}): correct it") from error
    require(len(flat) == width * len(rows), FormatError, f"{path}: its vertices have different numbers of coordinates: it is cut off or damaged")
    return flat.reshape(-1, width)


def _faces(path: Path, text: bytes, n_vertices: int) -> IntArray:
    rows = _FACE.findall(text)
    try:
        # a corner is vertex[/texture[/normal]]; one that refers backwards counts from the vertices read so far
        corners = np.array(_BESIDE.sub(b"", b" ".join(rows)).split(), dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise FormatError(f"{path}: a face refers to a vertex that is not a whole number ({error}): correct it") from error
    counts = np.array([len(row.split()) for row in rows])
    require(not bool((corners == 0).any()), FormatError, f"{path}: a face refers to vertex 0, but OBJ counts from 1: export it again")
    if bool((corners < 0).any()):
        corners = np.where(corners < 0, corners + np.repeat(_vertices_before(text), counts), corners - 1)
    else:
        corners = corners - 1
    return triangulated(corners, counts)


def _vertices_before(text: bytes) -> IntArray:
    """How many vertices stand before each face."""
    vertices = np.array([m.start() for m in _VERTEX.finditer(text)])
    faces = np.array([m.start() for m in _FACE.finditer(text)])
    return np.searchsorted(vertices, faces).astype(np.int64)
