"""Gmsh MSH: 4.1 binary out; 4.1 (text and binary) and 2.2 (text) in."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.io.files import replacing
from scan2fea.types import FloatArray, TetMesh

Array = npt.NDArray[Any]
# Gmsh element type -> its name in Blocks and its nodes
CELLS = {15: ("point", 1), 1: ("line", 2), 8: ("line3", 3), 2: ("triangle", 3), 9: ("triangle6", 6), 4: ("tet", 4), 11: ("tet10", 10)}
TET10_ORDER = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]  # Gmsh numbers the last two mid nodes (23, 13) the other way round than VTK; its own inverse


def write_msh(path: Path, tets: TetMesh) -> None:
    """Tets and boundary triangles with one physical group per CAD face (its name) and one for the volume (`volume`)."""
    names = [name.replace('"', "'") for name in tets.face_names]
    used = [tag for tag in range(len(names)) if bool((tets.face_tag == tag).any())]
    first_order = tets.order == 1
    triangle, volume = (2, 4) if first_order else (9, 11)
    cells = tets.tets if first_order else tets.tets[:, TET10_ORDER]
    blocks = [(2, tag + 1, triangle, tets.boundary[tets.face_tag == tag]) for tag in used] + [(3, 1, volume, cells)]
    total = sum(len(block) for *_, block in blocks)
    with replacing(path) as handle:
        handle.write(b"$MeshFormat\n4.1 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n")
        groups = [f'2 {tag + 1} "{names[tag]}"' for tag in used] + ['3 1 "volume"']
        handle.write(("$PhysicalNames\n" + "\n".join([str(len(groups)), *groups]) + "\n$EndPhysicalNames\n").encode())
        handle.write(b"$Entities\n" + _entities(tets, used) + b"\n$EndEntities\n")
        n = len(tets.nodes)
        handle.write(b"$Nodes\n" + struct.pack("<4Q", 1, n, 1, n) + struct.pack("<3iQ", 3, 1, 0, n))
        handle.write(np.arange(1, n + 1, dtype="<u8").tobytes() + tets.nodes.astype("<f8").tobytes() + b"\n$EndNodes\n")
        handle.write(b"$Elements\n" + struct.pack("<4Q", len(blocks), total, 1, total))
        number = 1
        for dimension, tag, kind, block in blocks:
            rows = np.empty((len(block), 1 + block.shape[1]), "<u8")
            rows[:, 0] = np.arange(number, number + len(block))
            rows[:, 1:] = block + 1
            handle.write(struct.pack("<3iQ", dimension, tag, kind, len(block)) + rows.tobytes())
            number += len(block)
        handle.write(b"\n$EndElements\n")


def _entities(tets: TetMesh, used: list[int]) -> bytes:
    """One surface per CAD face and the volume they bound, each in the physical group of its own number."""
    out = struct.pack("<4Q", 0, 0, len(used), 1)
    for tag in used:
        corners = tets.nodes[tets.boundary[tets.face_tag == tag]].reshape(-1, 3)
        out += struct.pack("<i", tag + 1) + _box(corners) + struct.pack("<QiQ", 1, tag + 1, 0)
    out += struct.pack("<i", 1) + _box(tets.nodes) + struct.pack("<Qi", 1, 1)
    return out + struct.pack("<Q", len(used)) + np.array([tag + 1 for tag in used], "<i4").tobytes()


def _box(points: FloatArray) -> bytes:
    return np.concatenate([points.min(axis=0), points.max(axis=0)]).astype("<f8").tobytes()
