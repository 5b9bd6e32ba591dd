"""The same triangulated surface with no edge longer than a length: what asks something of places on it may ask the middles of its faces."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.topology import edge_table
from scan2fea.types import FloatArray, IntArray, TriangleMesh


def with_short_edges(mesh: TriangleMesh, longest_m: float) -> TriangleMesh:
    """Edges longer than `longest_m` (> 0) halved, in rounds, until none is; neighbours share the new vertices. Faces lie where they lay.

    Every round cuts a face with one, two or three long edges into two, three or four.
    """
    points, faces = mesh.vertices, mesh.faces
    while True:
        table = edge_table(faces)
        ends = points[table.edges]
        long = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > longest_m
        if not long.any():
            return TriangleMesh(vertices=points, faces=faces)
        middle = np.full(len(long), -1, np.int64)
        middle[long] = len(points) + np.arange(int(long.sum()))
        points = np.concatenate([points, ends[long].mean(axis=1)])
        faces = _cut(faces, middle[table.edge_of].reshape(-1, 3), points)


def _cut(faces: IntArray, middle: IntArray, points: FloatArray) -> IntArray:
    """The faces with the middles of their long edges. middle : (m, 3) vertex in the middle of the edge that starts at each corner; -1 none."""
    count = (middle >= 0).sum(axis=1)
    # turned so that the only long edge comes first, or the only short one last
    first = np.where(count == 1, np.argmax(middle >= 0, axis=1), np.where(count == 2, (np.argmin(middle, axis=1) + 1) % 3, 0))
    turn = (first[:, None] + np.arange(3)) % 3
    (a, b, c), (ab, bc, ca) = np.take_along_axis(faces, turn, axis=1).T, np.take_along_axis(middle, turn, axis=1).T
    one, two, three = count == 1, count == 2, count == 3
    kinds = [
        (count == 0, [(a, b, c)]),
        (one, [(a, ab, c), (ab, b, c)]),
        (two, [(ab, b, bc)]),
        (three, [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]),
    ]
    near_a = np.zeros(len(faces), bool)  # of the two diagonals of what two long edges leave, the shorter
    near_a[two] = np.linalg.norm(points[a[two]] - points[bc[two]], axis=1) <= np.linalg.norm(points[ab[two]] - points[c[two]], axis=1)
    kinds += [(two & near_a, [(a, ab, bc), (a, bc, c)]), (two & ~near_a, [(a, ab, c), (ab, bc, c)])]
    return np.concatenate([np.stack(corners, axis=1)[rows] for rows, cut in kinds for corners in cut])
