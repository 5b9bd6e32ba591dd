"""Creases that a hole has cut: each is led on across the hole, and the hole filled on its two sides apart, so that the edge stays an edge."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.topology import EdgeTable, half_edges
from scan2fea.types import FloatArray, IntArray

SHARP = np.cos(np.radians(40.0))  # normals that turn by more make an edge; as much as the remesher calls a crease
BENT = 0.7  # length of the sum of two unit vectors: a crease that turns by more than 40 degrees ends there
TOWARD = 0.5  # cosine between the way a crease comes in and the way to the other end


def crease_ends(vertices: FloatArray, faces: IntArray, table: EdgeTable, normals: FloatArray, on_rim: IntArray) -> dict[int, FloatArray]:
    """Vertices of rims where exactly one crease of the mesh ends, one of two edges in line at least, with the unit vector in which it goes on.

    normals : (m, 3) of the faces.   on_rim : (k,) vertices of all rims.
    """
    ends = half_edges(faces)
    one = np.flatnonzero(table.twin > np.arange(len(table.twin)))
    two = table.twin[one]
    sharp = np.einsum("ij,ij->i", normals[one // 3], normals[two // 3]) < SHARP
    edges = ends[one[sharp]]
    rim = np.zeros(len(vertices), bool)
    rim[on_rim] = True
    edges = np.concatenate([edges, edges[:, ::-1]])
    sharp_at = np.bincount(edges[:, 0], minlength=len(vertices))
    way = vertices[edges[:, 0]] - vertices[edges[:, 1]]
    way /= np.maximum(np.linalg.norm(way, axis=1), np.finfo(float).tiny)[:, None]
    onward = np.zeros((len(vertices), 3))
    np.add.at(onward, edges[:, 0], way)  # where two sharp edges meet in line their ways cancel
    v, w = edges[:, 0], edges[:, 1]
    in_line = np.linalg.norm(onward[w], axis=1) < BENT
    fits = rim[v] & ~rim[w] & (sharp_at[v] == 1) & (sharp_at[w] == 2) & in_line
    return {int(a): b for a, b in zip(v[fits], way[fits], strict=True)}


def chords(vertices: FloatArray, loop: IntArray, ends: dict[int, FloatArray]) -> list[tuple[int, int]]:
    """Places (i, j) in the loop between which a crease is led on: ends that point at each other, nearest first, none across another."""
    places = [i for i, v in enumerate(loop.tolist()) if v in ends]
    pairs = []
    for a, i in enumerate(places):
        for j in places[a + 1 :]:
            if min(j - i, len(loop) - j + i) < 2:
                continue
            way = vertices[loop[j]] - vertices[loop[i]]
            length = float(np.linalg.norm(way))
            if length > 0 and ends[int(loop[i])] @ way > TOWARD * length and -(ends[int(loop[j])] @ way) > TOWARD * length:
                pairs.append((length, i, j))
    taken: list[tuple[int, int]] = []
    for _, i, j in sorted(pairs):
        if all(not {i, j} & {a, b} and ((a < i < b) == (a < j < b)) for a, b in taken):
            taken.append((i, j))
    return taken


def bridge(p: FloatArray, q: FloatArray, out_of_p: FloatArray, out_of_q: FloatArray, step: float) -> FloatArray:
    """(k, 3) points between p and q, about `step` apart, on the cubic that leaves both as their creases do."""
    length = float(np.linalg.norm(q - p))
    k = max(round(length / step) - 1, 1)
    t = (np.arange(k) + 1.0)[:, None] / (k + 1)
    return np.asarray(
        (2 * t**3 - 3 * t**2 + 1) * p + (t**3 - 2 * t**2 + t) * length * out_of_p + (3 * t**2 - 2 * t**3) * q - (t**3 - t**2) * length * out_of_q
    )


def parts_of(loop: list[int], taken: list[tuple[int, int]], chains: list[list[int]]) -> list[list[int]]:
    """The loop cut along its chords: loops that run as it does.

    taken : places (i, j), i < j, that do not cross.   chains : chain k leads from place i to place j of chord k.
    """
    if not taken:
        return [loop]
    (i, j), chain, n = taken[0], chains[0], len(loop)
    rest = list(zip(taken[1:], chains[1:], strict=True))
    inside = [((a - i, b - i), c) for (a, b), c in rest if i < a < j]
    outside = [(((a - j) % n, (b - j) % n), c) for (a, b), c in rest if not i < a < j]
    turned = [((a, b), c) if a < b else ((b, a), c[::-1]) for (a, b), c in outside]
    one = parts_of(loop[i : j + 1] + chain[::-1], [k for k, _ in inside], [c for _, c in inside])
    two = parts_of(loop[j:] + loop[: i + 1] + chain, [k for k, _ in turned], [c for _, c in turned])
    return one + two
