"""How the true faces of a solid are called: FACE_01_PLANE, HOLE_03, END_A; the names go into the STEP file, the mesh and the deck."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.surfaces import CYLINDER, PLANE, Surface
from scan2fea.types import FloatArray, IntArray, TriangleMesh

LONG = 3.0  # an object this many times longer than wide has ends
SQUARE = 0.98  # cosine between the normal of an end and the axis of the object
REACH = 0.02  # of the length: an end lies this near to where the object ends
HOLE = "HOLE"
WHOLE = 0.6  # of a turn: a hollow cylinder over more than this is a hole, less is a rounded corner


def named_faces(mesh: TriangleMesh, surfaces: Sequence[Surface]) -> tuple[str, ...]:
    """Names of the faces numbered by `mesh.face_region`, in their order; surfaces : of each.

    Planes square to the axis of a long object at its ends are END_A and END_B, hollow cylinders of more than half a turn HOLE_01, ...; all others
    FACE_<number>_<KIND>.
    """
    region = np.zeros(0, np.int64) if mesh.face_region is None else mesh.face_region
    n = len(surfaces)
    ends = _ends(mesh, region, n, [surface.kind for surface in surfaces])
    width = max(2, len(str(n)))
    names, holes = [], 0
    for face, surface in enumerate(surfaces):
        if face in ends:
            names.append(ends[face])
        elif surface.kind == CYLINDER and surface.sense < 0 and _turn(mesh, region, face, surface) > WHOLE:
            holes += 1
            names.append(f"{HOLE}_{holes:02d}")
        else:
            names.append(f"FACE_{face + 1:0{width}d}_{surface.kind.upper()}")
    return tuple(names)


def _turn(mesh: TriangleMesh, region: IntArray, face: int, surface: Surface) -> float:
    """Share of a full turn that a round face covers."""
    e = surface.frame()
    corners = mesh.vertices[np.unique(mesh.faces[region == face])] - surface.point
    angle = np.sort(np.arctan2(corners @ e[1], corners @ e[0]))
    gap = np.diff(np.concatenate([angle, angle[:1] + 2 * np.pi])).max()
    return float(1 - gap / (2 * np.pi)) if gap > 0.8 else 1.0


def _ends(mesh: TriangleMesh, region: IntArray, n: int, kinds: Sequence[str]) -> dict[int, str]:
    """The plane faces that end a long object; END_A is where the axis, turned to its largest positive coordinate, begins."""
    axis, spread = _axis(mesh)
    along = (mesh.vertices @ axis)[mesh.faces].mean(1)
    used = mesh.vertices[np.unique(mesh.faces)] @ axis
    low, high = float(used.min()), float(used.max())
    if spread < LONG:
        return {}
    facing, area = face_normals(mesh) @ axis, face_areas(mesh)
    out: dict[int, str] = {}
    for name, sign, stop in (("END_A", -1.0, low), ("END_B", 1.0, high)):
        found: list[tuple[float, int]] = []
        for face in range(n):
            rows = region == face
            if kinds[face] == PLANE and (sign * facing[rows] > SQUARE).all() and abs(along[rows] - stop).max() < REACH * (high - low):
                found.append((-float(area[rows].sum()), face))
        if found:
            out[min(found)[1]] = name
    return out


def _axis(mesh: TriangleMesh) -> tuple[FloatArray, float]:
    """Direction in which the object is longest, and how many times longer it is than in the next."""
    weight = face_areas(mesh)
    middle = mesh.vertices[mesh.faces].mean(1)
    centred = middle - np.average(middle, axis=0, weights=weight)
    values, vectors = np.linalg.eigh((centred * weight[:, None]).T @ centred)
    axis = vectors[:, 2]
    if axis[np.abs(axis).argmax()] < 0:
        axis = -axis
    width = np.ptp(mesh.vertices[np.unique(mesh.faces)] @ vectors, axis=0)
    return axis, float(width[2] / max(width[1], 1e-300)) if values[2] > 0 else 1.0
