"""Which rigid motions do the supports of a model leave free? The null space of what holds and joins its parts, six motions each, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from scan2fea.types import BoolArray, FloatArray, IntArray, Value

FREE = 1e-9  # of rows of size one, squared: a lever of 3e-5 of a part's size holds nothing (files of six digits put an edge that far off its line)
MOVES = 1e-6  # of a motion: less is rounding
LARGEST = 400  # parts joined to each other: the null space is dense
_FACES = np.array([[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]])


@dataclass(frozen=True, eq=False, kw_only=True)
class Parts(Value):
    """Bodies that move as one. centre : (b, 3).   size : (b,) farthest node from it.   named : (b,) an element of it; -1 for a lone node.

    of_node : (n,) the part that turns a node where there is such a one, else one that holds it, -1 none.   shared : (k, 3) part, part, node.
    """

    centre: FloatArray
    size: FloatArray
    named: IntArray
    of_node: IntArray
    shared: IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Rows(Value):
    """Terms of sums that are zero: `coefficients` (k, 6) times displacement and rotation of `part` (k,) at `at` (k, 3); one for each `row` (k,)."""

    row: IntArray
    part: IntArray
    at: FloatArray
    coefficients: FloatArray


def parts_of(nodes: FloatArray, solids: IntArray, turning: Sequence[IntArray], lone: IntArray) -> Parts:
    """Solids (m, 4) that share faces, shells and beams that share nodes, and a part for each node of `lone` that no shell or beam turns.

    Solids that share a node or an edge alone are hinged there. Elements are numbered in this order, solids first.
    """
    n, m = len(nodes), len(solids)
    of_solid = _joined(_sharing_faces(solids), m)
    ends = np.concatenate([np.stack([np.repeat(x[:, 0], x.shape[1]), x.ravel()], axis=1) for x in turning] or [np.zeros((0, 2), np.int64)])
    piece = _joined(ends, n)
    turned = np.zeros(n, bool)
    turned[ends.ravel()] = True
    first = int(of_solid.max()) + 1 if m else 0
    names, inverse = np.unique(piece[turned], return_inverse=True)
    second = first + len(names)
    alone = np.unique(lone[~turned[lone]])
    node = np.concatenate([solids.ravel(), np.flatnonzero(turned), alone])
    part = np.concatenate([np.repeat(of_solid, 4), first + inverse, second + np.arange(len(alone))])
    node, part = np.unique(np.stack([node, part], axis=1), axis=0).T
    of_node = np.full(n, -1)
    of_node[node] = part  # the last of a node's is its largest: what turns it
    same = np.flatnonzero(node[1:] == node[:-1])
    count = second + len(alone)
    centre = np.stack([np.bincount(part, nodes[node, k], count) for k in range(3)], axis=1) / np.bincount(part, minlength=count)[:, None]
    size = np.zeros(count)
    np.maximum.at(size, part, np.linalg.norm(nodes[node] - centre[part], axis=1))
    size[size == 0] = max(float(size.max(initial=0.0)), 1e-300)
    named = np.full(count, -1)
    named[of_solid[::-1]] = np.arange(m)[::-1]
    starts = np.concatenate([x[:, 0] for x in turning] or [np.zeros(0, np.int64)])
    named[first + np.searchsorted(names, piece[starts])[::-1]] = m + np.arange(len(starts))[::-1]
    return Parts(centre=centre, size=size, named=named, of_node=of_node, shared=np.stack([part[same], part[same + 1], node[same]], axis=1))


def _joined(pairs: IntArray, n: int) -> IntArray:
    """(n,) the group of each, from 0; `pairs` (k, 2) are in one."""
    graph = sp.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1] if n else np.zeros(0), np.int64)


def _sharing_faces(solids: IntArray) -> IntArray:
    """(k, 2) solids with a common face."""
    corners = np.sort(solids[:, _FACES].reshape(-1, 3), axis=1)
    order = np.lexsort(corners.T)
    same = np.flatnonzero((corners[order][1:] == corners[order][:-1]).all(axis=1))
    return np.stack([order[same], order[same + 1]], axis=1) // 4


def free_motions(nodes: FloatArray, parts: Parts, rows: Rows) -> tuple[dict[int, tuple[str, ...]], BoolArray]:
    """Of each part with elements that can move its free motions in words, coordinates as given; (b,) True where too many are joined to tell."""
    matrix = _matrix(nodes, parts, rows)
    count = len(parts.size)
    normal = (matrix.T @ matrix).tocsr()
    touching = normal.tocoo()
    group = _joined(np.stack([touching.row // 6, touching.col // 6], axis=1), count)
    out: dict[int, tuple[str, ...]] = {}
    untold = np.zeros(count, bool)
    for g in range(int(group.max(initial=-1)) + 1):
        own = np.flatnonzero(group == g)
        if len(own) > LARGEST:
            untold[own] = True
            continue
        columns = (6 * own[:, None] + np.arange(6)).ravel()
        values, vectors = np.linalg.eigh(normal[columns][:, columns].toarray())
        null = vectors[:, values <= FREE + 1e-13 * values[-1]]
        for k, part in enumerate(own.tolist()):
            if parts.named[part] >= 0 and null.shape[1]:
                left, strength, _ = np.linalg.svd(null[6 * k : 6 * k + 6], full_matrices=False)
                if (strength > MOVES).any():
                    out[part] = _in_words(left[:, strength > MOVES], parts.centre[part], float(parts.size[part]))
    return out, untold


def _matrix(nodes: FloatArray, parts: Parts, rows: Rows) -> sp.csr_array:
    """One row of size one for each condition, six columns a part: displacement of its centre, rotation times its size."""
    one, other, node = parts.shared.T
    k = len(node)
    joint = int(rows.row.max(initial=-1)) + 1 + np.arange(3 * k)
    along = np.tile(np.eye(3, 6), (k, 1))
    row = np.concatenate([rows.row, joint, joint])
    part = np.concatenate([rows.part, np.repeat(one, 3), np.repeat(other, 3)])
    at = np.concatenate([rows.at, np.repeat(nodes[node], 3, axis=0), np.repeat(nodes[node], 3, axis=0)])
    factor = np.concatenate([rows.coefficients, along, -along])
    arm = (at - parts.centre[part]) / parts.size[part][:, None]
    turn = np.cross(arm, factor[:, :3]) + factor[:, 3:] / parts.size[part][:, None]
    values = np.concatenate([factor[:, :3], turn], axis=1)
    columns = 6 * part[:, None] + np.arange(6)
    shape = (int(row.max(initial=-1)) + 1, 6 * len(parts.size))
    matrix = sp.coo_array((values.ravel(), (np.repeat(row, 6), columns.ravel())), shape=shape).tocsr()
    length = np.sqrt(np.asarray(matrix.multiply(matrix).sum(axis=1)).ravel())
    return sp.csr_array(sp.diags_array(1 / np.where(length > 0, length, 1.0)) @ matrix)


def _in_words(basis: FloatArray, centre: FloatArray, size: float) -> tuple[str, ...]:
    """basis : (6, k), orthonormal, of displacement of the centre and rotation times size."""
    if basis.shape[1] == 6:
        return ("nothing holds it",)
    turns, strength, back = np.linalg.svd(basis[3:])
    n_turns = int((strength > MOVES).sum())
    moves = basis[:3] @ back[n_turns:].T
    told = [f"free to move along {_shown(v)}" for v in _aligned(moves)]
    axes = _aligned(turns[:, :n_turns])
    # the motion that turns so and moves least: what moves without a turn is taken out
    carried = [basis[:3] @ (np.linalg.pinv(basis[3:], rcond=MOVES) @ v) * size for v in axes]
    if len(axes) == 3:
        point, pitch = _common_point(axes, carried)
        if pitch < MOVES * size:
            return (*told, f"free to turn about any axis through {_shown(centre + point, size)}")
    for axis, shift in zip(axes, carried, strict=True):
        advance = float(axis @ shift)
        screw = "" if abs(advance) < MOVES * size else f", moving {2 * np.pi * advance:.4g} along it a turn"
        told.append(f"free to turn about {_shown(axis)} through {_shown(centre + np.cross(axis, shift), size)}{screw}")
    return tuple(told)


def _aligned(basis: FloatArray) -> list[FloatArray]:
    """Orthonormal directions that span what `basis` (3, k), orthonormal, does: along the axes as far as they can."""
    left = basis @ basis.T
    out = []
    for _ in range(basis.shape[1]):
        v = left[:, int(np.argmax(np.diag(left)))]
        v = v / np.linalg.norm(v)
        out.append(v)
        left = left - np.outer(v, v)
    return out


def _common_point(axes: Sequence[FloatArray], carried: Sequence[FloatArray]) -> tuple[FloatArray, float]:
    """The point, from the centre, that turns about these axes leave where it is, and by how much they do not."""
    crosses = np.concatenate([np.cross(axis, np.eye(3)).T for axis in axes])
    wanted = -np.concatenate(carried)
    point = np.linalg.lstsq(crosses, wanted, rcond=None)[0]
    return point, float(np.abs(crosses @ point - wanted).max())


def _shown(v: FloatArray, size: float = 1.0) -> str:
    clean = np.where(np.abs(v) < MOVES * size, 0.0, v)
    return "(" + ", ".join(f"{x:.4g}" for x in clean.tolist()) + ")"
