"""Structured tetrahedral bars for the tests: hexahedra cut into six tets each (Kuhn), so that neighbours fit."""

import itertools

import numpy as np

from scan2fea.types import TetMesh

EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))


def kuhn(keep, x, y, z):
    """(nodes, tets) of the cells (i, j, k) with keep[i, j, k] on the grid x, y, z."""
    n = (len(x), len(y), len(z))
    nodes = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = np.argwhere(keep)
    tets = []
    for order in itertools.permutations(range(3)):
        corner = np.zeros((4, 3), int)
        for step, axis in enumerate(order):
            corner[step + 1 :, axis] += 1
        if np.linalg.det((corner[1:] - corner[0]).astype(float)) < 0:
            corner[[2, 3]] = corner[[3, 2]]
        tets.append(np.ravel_multi_index((cells[:, None] + corner[None]).transpose(2, 0, 1), n))
    tets = np.concatenate(tets)
    used, inverse = np.unique(tets, return_inverse=True)
    return nodes[used], inverse.reshape(-1, 4)


def quadratic(nodes, tets):
    """The same mesh with middle nodes on straight edges."""
    pairs = np.sort(np.concatenate([tets[:, list(e)] for e in EDGES]), axis=1)
    unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
    middle = inverse.ravel().reshape(6, -1).T + len(nodes)
    return np.concatenate([nodes, nodes[unique].mean(axis=1)]), np.concatenate([tets, middle], axis=1)


def boundary_of(tets):
    """(k, 3 or 6) outward boundary triangles."""
    corner = np.concatenate([tets[:, list(f)] for f in FACES])
    order = np.argsort(np.argsort(corner, axis=1), axis=1)  # keep the orientation, compare sorted
    assert order.shape == corner.shape
    key = np.sort(corner, axis=1)
    _, first, count = np.unique(key, axis=0, return_index=True, return_counts=True)
    rows = np.sort(first[count == 1])
    if tets.shape[1] == 4:
        return corner[rows]
    edge = {frozenset(e): 4 + k for k, e in enumerate(EDGES)}
    middle = np.concatenate([tets[:, [edge[frozenset((f[i], f[(i + 1) % 3]))] for i in range(3)]] for f in FACES])
    return np.concatenate([corner, middle], axis=1)[rows]


def tagged(nodes, tets):
    """A TetMesh whose CAD faces are its planes: one name for each (normal, offset)."""
    boundary = boundary_of(tets)
    p = nodes[boundary[:, :3]]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    size = np.ptp(nodes, axis=0).max()
    key = np.round(np.c_[normal, np.einsum("ij,ij->i", normal, p[:, 0]) / size], 6) + 0.0
    _, tag = np.unique(key, axis=0, return_inverse=True)
    names = tuple(f"FACE_{k + 1:02d}_PLANE" for k in range(tag.max() + 1))
    return TetMesh(nodes=nodes, tets=tets, boundary=boundary, face_tag=tag.ravel(), face_names=names)


def bar(size, cells, order=2, keep=None):
    """A bar of size (3,) from the origin, in cells (3,); keep(i, j, k) drops cells."""
    x, y, z = (np.linspace(0, s, c + 1) for s, c in zip(size, cells, strict=True))
    mask = np.ones(cells, bool) if keep is None else np.fromfunction(keep, cells, dtype=int)
    nodes, tets = kuhn(mask, x, y, z)
    if order == 2:
        nodes, tets = quadratic(nodes, tets)
    return tagged(nodes, tets)


def l_bar(leg, thickness, length, n_leg, n_length, order=2):
    """An angle section, the heel along z; n_leg cells over a leg, one through the thickness."""
    inner = np.linspace(thickness, leg, n_leg + 1)
    x = np.concatenate([[0.0], inner])
    keep = np.zeros((n_leg + 1, n_leg + 1, n_length), bool)
    keep[0], keep[:, 0] = True, True
    nodes, tets = kuhn(keep, x, x, np.linspace(0, length, n_length + 1))
    if order == 2:
        nodes, tets = quadratic(nodes, tets)
    return tagged(nodes, tets)
