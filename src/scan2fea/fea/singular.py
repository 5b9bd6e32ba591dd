"""Where the true stress has no limit, so that no mesh says what it is: re-entrant edges without a fillet, tips, the rims of supports.

Peaks are given outside the elements that touch such places (thesis, 2.5.1; Williams 1952: stress grows without bound towards a re-entrant corner).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.types import BoolArray, FEModel, FloatArray, IntArray, TetMesh, Value

REENTRANT_DEG = 20.0  # beyond a straight angle: chords of a circle of 18 or more, of facets or TET4, are no corner
TIP_SR = 0.3  # solid angle below which a corner of the surface is a tip (an eighth of space is 1.57)


@dataclass(frozen=True, eq=False, kw_only=True)
class Singular(Value):
    """nodes : all that lie on such places, rising.   length_m : of the re-entrant edges.   n_edges : number of them as sides of elements.

    n_tips : corners sharper than TIP_SR.   rim : (r,) nodes on the border of the held faces.
    """

    nodes: IntArray
    length_m: float
    n_edges: int
    n_tips: int
    rim: IntArray


def singular_places(model: FEModel) -> Singular:
    """Of the mesh and its supports."""
    mesh = model.mesh
    ends, angle = edge_angles(mesh)
    back = angle < -np.radians(REENTRANT_DEG)
    corner = ends[back]
    length = float(np.linalg.norm(mesh.nodes[corner[:, 1]] - mesh.nodes[corner[:, 0]], axis=1).sum())
    tips = np.flatnonzero(_solid_angles(mesh) < TIP_SR)
    rim = _rim(model)
    nodes = np.unique(np.concatenate([corner.ravel(), tips, rim]))
    return Singular(nodes=nodes.astype(np.int64), length_m=length, n_edges=int(back.sum()), n_tips=len(tips), rim=rim)


def outside_ring(mesh: TetMesh, singular: Singular) -> BoolArray:
    """(m,) elements that touch no such place."""
    touched = np.zeros(len(mesh.nodes), bool)
    touched[singular.nodes] = True
    return np.asarray(~touched[mesh.tets[:, :4]].any(axis=1))


def edge_angles(mesh: TetMesh) -> tuple[IntArray, FloatArray]:
    """((e, 2) corner nodes of each edge of the surface, (e,) by how much its faces turn, radians: positive outward, negative re-entrant).

    At the middle of the edge: faces of TET10 are curved, so that a smooth hole has no edges however few it is made of.
    """
    corner = mesh.boundary[:, :3]
    sides = np.concatenate([corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]])
    normals = np.concatenate([_normal_beside(mesh, k) for k in range(3)])
    n = len(mesh.nodes)
    low, high = np.sort(sides, axis=1).T
    order = np.argsort(low * n + high, kind="stable")
    key = (low * n + high)[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]) & np.concatenate([key[1:] == key[:-1], [False]]))
    one, two = order[first], order[first + 1]
    a, b = normals[one], normals[two]
    along = mesh.nodes[sides[one, 1]] - mesh.nodes[sides[one, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    turn = np.arctan2(np.einsum("ec,ec->e", np.cross(a, b), along), np.einsum("ec,ec->e", a, b))
    return np.sort(sides[one], axis=1), turn


def _normal_beside(mesh: TetMesh, side: int) -> FloatArray:
    """(k, 3) unit normal of each boundary face at the middle of its side 01, 12 or 20; of faces with six nodes by their shape functions."""
    i, j, k = side, (side + 1) % 3, (side + 2) % 3
    x = mesh.nodes[mesh.boundary]
    along, inward = x[:, j] - x[:, i], x[:, k] - (x[:, i] + x[:, j]) / 2
    if x.shape[1] == 6:  # nodes 3, 4, 5 lie between 01, 12, 20
        inward = 2 * (x[:, 3 + j] + x[:, 3 + k] - x[:, 3 + i]) - x[:, k] - (x[:, i] + x[:, j]) / 2
    normal = np.cross(along, inward)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None])


def _solid_angles(mesh: TetMesh) -> FloatArray:
    """(n,) of the material at each corner node on the surface, 4 pi elsewhere: sums over tets (van Oosterom and Strackee 1983)."""
    total = np.zeros(len(mesh.nodes))
    x = mesh.nodes[mesh.tets[:, :4]]
    for k in range(4):
        a, b, c = (x[:, j] - x[:, k] for j in range(4) if j != k)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        top = np.abs(np.einsum("ec,ec->e", a, np.cross(b, c)))
        below = la * lb * lc + np.einsum("ec,ec->e", a, b) * lc + np.einsum("ec,ec->e", a, c) * lb + np.einsum("ec,ec->e", b, c) * la
        total += np.bincount(mesh.tets[:, k], 2 * np.arctan2(top, below), len(total))
    inner = np.ones(len(total), bool)
    inner[np.unique(mesh.boundary[:, :3])] = False
    total[inner] = 4 * np.pi
    return total


def _rim(model: FEModel) -> IntArray:
    """Corner nodes on the border of the held faces: there the support ends at once."""
    corner = model.mesh.boundary[:, :3]
    held = np.zeros(len(corner), bool)
    for name in model.supports:
        held[model.surfaces.get(name, np.zeros(0, np.int64))] = True
    if not held.any():
        return np.unique(np.concatenate([model.node_sets[name] for name in model.supports])) if model.supports else np.zeros(0, np.int64)
    own = np.unique(corner[held])
    return np.asarray(own[np.isin(own, np.unique(corner[~held]))], np.int64)
