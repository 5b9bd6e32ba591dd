"""Cells of a mesh file to one value: tets with their boundary, or triangles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import EmptyScanError, FormatError, require
from scan2fea.types import FloatArray, IntArray, TetMesh, TriangleMesh, Value

Array = npt.NDArray[Any]
# faces of a tet, outward for a tet of positive volume, and the mid nodes of their edges 01 12 02 (VTK order)
_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
_MIDS = np.array([[6, 5, 4], [4, 8, 7], [5, 9, 8], [7, 9, 6]])


@dataclass(frozen=True, eq=False, kw_only=True)
class Blocks(Value):
    """What a volume file holds.

    cells : (kind, (m, k) node rows, (m,) tag) with kind "tet", "tet10", "triangle", "triangle6", "quad", "quad8", "line", "line3" or "point"; tets in
    VTK order, the nodes of a line along it.
    names : tag of triangles -> its name.   node_numbers, cell_numbers : those of the file, of nodes and of the cells of each block; decks alone.
    """

    path: Path
    nodes: FloatArray
    cells: tuple[tuple[str, Array, Array], ...]
    names: Mapping[int, str]
    node_numbers: Array = field(default_factory=lambda: np.zeros(0, np.int64))
    cell_numbers: tuple[Array, ...] = ()


def mesh_of(blocks: Blocks, scale: float) -> TriangleMesh | TetMesh:
    """Tets where there are any (triangles beside them name parts of the boundary), else triangles.

    Raises FormatError where nodes are missing or orders are mixed, EmptyScanError where there is nothing.
    """
    require_sound(blocks)
    path, nodes = blocks.path, blocks.nodes
    tets = [(kind, cells) for kind, cells, _ in blocks.cells if kind in ("tet", "tet10") and len(cells)]
    require(len({kind for kind, _ in tets}) <= 1, FormatError, f"{path} mixes tetrahedra of 4 and of 10 nodes: export one order")
    triangles = [(cells[:, :3], tags) for kind, cells, tags in blocks.cells if kind in ("triangle", "triangle6") and len(cells)]
    if tets:
        return _tet_mesh(nodes * scale, np.concatenate([cells for _, cells in tets]).astype(np.int64), triangles, blocks.names)
    if not triangles:
        raise EmptyScanError(f"{path} holds no triangles and no tetrahedra: export it again")
    faces = np.concatenate([cells for cells, _ in triangles]).astype(np.int64)
    used, packed = np.unique(faces, return_inverse=True)
    return TriangleMesh(vertices=nodes[used] * scale, faces=packed.reshape(-1, 3).astype(np.int64))


def require_sound(blocks: Blocks) -> None:
    """Raises FormatError for a node that is not finite, and for a cell whose node is not there."""
    path, nodes = blocks.path, blocks.nodes
    require(bool(np.isfinite(nodes).all()), FormatError, f"{path}: a node is not finite: export it again")
    for kind, cells, _ in blocks.cells:
        sound = cells.size == 0 or (int(cells.min()) >= 0 and int(cells.max()) < len(nodes))
        require(sound, FormatError, f"{path}: a cell ({kind}) refers to a node that is not there: it is cut off or damaged")


def boundary_of(tets: IntArray) -> IntArray:
    """(k, 3) or (k, 6) faces that belong to one tet only, outward where its volume is positive."""
    corners = tets[:, _FACES].reshape(-1, 3)
    key = np.sort(corners, axis=1)
    order = np.lexsort(key.T[::-1])
    ranked = key[order]
    same = (ranked[1:] == ranked[:-1]).all(axis=1)
    single = np.ones(len(order), bool)
    single[1:] &= ~same
    single[:-1] &= ~same
    rows = np.sort(order[single])
    if tets.shape[1] == 4:
        return corners[rows]
    return np.concatenate([corners[rows], tets[:, _MIDS].reshape(-1, 3)[rows]], axis=1)


def _tet_mesh(nodes: FloatArray, tets: IntArray, triangles: list[tuple[Array, Array]], names: Mapping[int, str]) -> TetMesh:
    used, packed = np.unique(tets, return_inverse=True)
    row = np.full(len(nodes), -1, np.int64)
    row[used] = np.arange(len(used))
    packed = packed.reshape(tets.shape).astype(np.int64)
    boundary = boundary_of(packed)
    tag, face_names = _tags(boundary[:, :3], [(row[cells], tags) for cells, tags in triangles], names)
    return TetMesh(nodes=nodes[used], tets=packed, boundary=boundary, face_tag=tag, face_names=face_names)


def _tags(boundary: IntArray, triangles: list[tuple[Array, Array]], names: Mapping[int, str]) -> tuple[IntArray, tuple[str, ...]]:
    """The named part each boundary triangle lies on; those that no triangle of the file names are "boundary"."""
    tag = np.full(len(boundary), -1, np.int64)
    if triangles:
        cells = np.sort(np.concatenate([c for c, _ in triangles]), axis=1)
        numbers = np.concatenate([t for _, t in triangles])
        place = {tuple(corners): k for k, corners in enumerate(np.sort(boundary, axis=1).tolist())}
        found = np.array([place.get(tuple(corners), -1) for corners in cells.tolist()], np.int64)
        tag[found[found >= 0]] = numbers[found >= 0]
    present = np.unique(tag)
    face_names = tuple(names.get(int(t), "boundary" if t <= 0 else f"face_{int(t)}") for t in present)
    return np.searchsorted(present, tag).astype(np.int64), face_names
