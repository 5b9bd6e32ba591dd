"""Neighbouring patches that pass into each other without an angle: each face goes to the surface that is nearer, and the surfaces are fitted again.

What is grown first takes what lies within the tolerance of it: a flat side and a part of the arcs at its ends become one wide cylinder, and of the
arcs the middles are left. Where two meet at an angle the tolerance is passed within a step; where they touch it is not (r = 3 mm and 0.3 mm: 1.3 mm).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scan2fea.kernel.measures import face_areas
from scan2fea.kernel.surfaces import CYLINDER, FREEDOMS, PLANE, Surface, fit_surface, fitted
from scan2fea.types import FloatArray, IntArray, TriangleMesh

ROUNDS = 20
RINGS = 2  # over which squared distances are averaged: of one face they are mostly noise
LEAST_FACES = 4  # of a patch that still tells its surface
LEAST_CORNERS = 12  # for another kind
FLAT = 0.5  # of its area, the sum of the normals of a patch that may be a plane, or less than half a turn
FACING = float(np.cos(np.radians(30.0)))


def competed(
    mesh: TriangleMesh, of: IntArray, normals: FloatArray, label: IntArray, surfaces: Sequence[Surface], n_known: int = 0
) -> tuple[IntArray, list[Surface]]:
    """Labels and surfaces once no face changes. of : (m, 3) neighbours of each face.   normals : (m, 3) smoothed.   label : (m,), -1 stays.

    A surface whose patch has changed may become a plane or a cylinder; the first n_known stay as they are: the corners of an exact plane that one
    face of the arc beside it joins hold nothing but that face's distance, and a cylinder of 950 mm explains it.
    """
    label, out = label.copy(), list(surfaces)
    if not out:
        return label, out
    areas, centres = face_areas(mesh), mesh.vertices[mesh.faces].mean(1)
    rings: dict[int, IntArray] = {}
    for _ in range(ROUNDS):
        moves = _moves(mesh, of, normals, centres, label, out, rings)
        after = label.copy()
        after[list(moves)] = list(moves.values())
        lost = np.bincount(after[after >= 0], minlength=len(out)) < LEAST_FACES
        after = np.where(lost[label] & (label >= 0), label, after)  # what few faces are left of keeps them
        is_new = after != label
        if not is_new.any():
            break
        touched = np.unique(np.concatenate([label[is_new], after[is_new]]))
        label = after
        for k in touched[touched >= n_known].tolist():
            out[k] = _again(mesh, normals, areas, np.flatnonzero(label == k), out[k])
    return label, out


def _moves(
    mesh: TriangleMesh, of: IntArray, normals: FloatArray, centres: FloatArray, label: IntArray, surfaces: Sequence[Surface],
    rings: dict[int, IntArray],
) -> dict[int, int]:  # fmt: skip
    """The new label of each face at a border that lies nearer to the surface next to it and looks its way. rings : known so far."""
    face, side = np.nonzero((label[:, None] >= 0) & (label[of] >= 0) & (label[of] != label[:, None]))
    other = label[of[face, side]]
    best: dict[int, tuple[float, int]] = {}
    for k in np.unique(other).tolist():
        rows = np.unique(face[other == k])
        looks = np.einsum("ij,ij->i", surfaces[k].normals(centres[rows]), normals[rows]) >= FACING
        for f in rows[looks].tolist():
            if f not in rings:
                rings[f] = _around(of, f)
            corners = mesh.vertices[mesh.faces[rings[f]]].reshape(-1, 3)
            if f not in best:
                best[f] = float(np.mean(surfaces[label[f]].distance(corners) ** 2)), int(label[f])
            best[f] = min(best[f], (float(np.mean(surfaces[k].distance(corners) ** 2)), k), key=lambda found: found[0])
    return {f: k for f, (_, k) in best.items() if k != label[f]}


def _around(of: IntArray, face: int) -> IntArray:
    """A face and those within RINGS of it."""
    ring = np.array([face])
    for _ in range(RINGS):
        ring = np.unique(np.concatenate([ring, of[ring].ravel()]))
    return ring


def _again(mesh: TriangleMesh, normals: FloatArray, areas: FloatArray, rows: IntArray, surface: Surface) -> Surface:
    """The surface fitted to the corners of its faces; of a plane, a cylinder and its own kind the one with the least n log(variance) + k log(n)."""
    used, index = np.unique(mesh.faces[rows], return_inverse=True)
    corners = mesh.vertices[used]
    if len(corners) < LEAST_CORNERS:
        return surface
    weight = np.repeat(areas[rows], 3)
    mean = np.stack([np.bincount(index.ravel(), weights=weight * np.repeat(normals[rows, k], 3)) for k in range(3)], axis=1).astype(float)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    found = [fitted(surface, corners) or surface]
    if float(np.linalg.norm(areas[rows] @ normals[rows])) > FLAT * float(areas[rows].sum()):
        found += [f for kind in (PLANE, CYLINDER) if kind != surface.kind and (f := fit_surface(kind, corners, mean)) is not None]
    n = len(corners)
    floor = (1e-9 * float(np.linalg.norm(np.ptp(corners, axis=0)))) ** 2
    return min(found, key=lambda f: n * np.log(float(np.mean(f.distance(corners) ** 2)) + floor) + FREEDOMS[f.kind] * np.log(n))
