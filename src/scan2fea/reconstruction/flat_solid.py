"""The triangles round a set of convex cells: facets of one plane joined, corners only where planes meet, each polygon filled over its own corners."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.arrangement import Cells, boundary_facets
from scan2fea.kernel.polygons import triangulated
from scan2fea.kernel.primitives import Plane
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

ON_EDGE = 1e-7  # of the size: a vertex nearer than this to an edge lies on it
STRAIGHT = 1e-9  # 1 - cosine of two edges of one line


def flat_solid(cells: Cells, inside: BoolArray, normals: FloatArray) -> TriangleMesh:
    """The surface of the inside cells, outward; face_region is the plane of each face, doubled, plus 1 where it looks against the plane's normal.

    inside : (n_cells,).   normals : (p, 3) of the planes. Raises ReconstructionError where a face cannot be filled.
    """
    facets, along = boundary_facets(cells, inside)
    require(len(facets), ReconstructionError, "no cell between the planes is inside")
    require((cells.plane[facets] < len(normals)).all(), ReconstructionError, "the planes do not close: a side has no plane")
    loops = _with_all_corners(cells, facets, along)
    region = 2 * cells.plane[facets] + ~along
    rings: list[tuple[int, list[IntArray]]] = []
    for number in np.unique(region):
        rings += [(int(number), ring) for ring in _outlines([loops[k] for k in np.flatnonzero(region == number)])]
    keep = _true_corners(cells.vertices, rings)
    faces, label = [], []
    for number, patch in rings:
        plane = Plane(normal=normals[number // 2] * (1 - 2 * (number % 2)), offset=0.0)
        filled = triangulated([ring[keep[ring]] for ring in patch], cells.vertices @ plane.axes().T)
        if filled is None:
            raise ReconstructionError("a flat face between the planes cannot be filled: they nearly coincide")
        faces.append(filled)
        label.append(np.full(len(filled), number))
    used, packed = np.unique(np.concatenate(faces), return_inverse=True)
    return TriangleMesh(
        vertices=cells.vertices[used], faces=packed.reshape(-1, 3).astype(np.int64), face_region=np.concatenate(label).astype(np.int64)
    )


def _with_all_corners(cells: Cells, facets: IntArray, along: BoolArray) -> list[IntArray]:
    """Loops of the facets, outward, with every vertex of any of them that lies on an edge entered there."""
    places = cells.vertices
    size = float(np.linalg.norm(np.ptp(places, axis=0)))
    every = np.unique(np.concatenate([cells.loops[f] for f in facets]))
    out = []
    for f, way in zip(facets, along, strict=True):
        loop = cells.loops[f] if way else cells.loops[f][::-1]
        full: list[int] = []
        for a, b in zip(loop, np.roll(loop, -1), strict=True):
            edge = places[b] - places[a]
            length2 = float(edge @ edge)
            share = (places[every] - places[a]) @ edge / length2
            off = np.linalg.norm(places[every] - places[a] - share[:, None] * edge, axis=1)
            on = (off <= ON_EDGE * size) & (share > 0) & (share < 1) & (every != a) & (every != b)
            full += [int(a), *every[on][np.argsort(share[on], kind="stable")].tolist()]
        out.append(np.array(full, np.int64))
    return out


def _outlines(loops: list[IntArray]) -> list[list[IntArray]]:
    """The outlines of the patches that facets of one plane make up, each patch's own rings together."""
    edges = {(int(a), int(b)): k for k, loop in enumerate(loops) for a, b in zip(loop, np.roll(loop, -1), strict=True)}
    shared = [(k, edges[b, a]) for (a, b), k in edges.items() if (b, a) in edges]
    i, j = np.array(shared, np.int64).reshape(-1, 2).T
    _, patch = connected_components(coo_array((np.ones(len(i), np.int8), (i, j)), shape=(len(loops), len(loops))), directed=False)
    out = []
    for number in range(int(patch.max()) + 1):
        after: dict[int, list[int]] = {}
        for (a, b), k in edges.items():
            if patch[k] == number and (b, a) not in edges:
                after.setdefault(a, []).append(b)
        out.append(_rings(after))
    return out


def _rings(after: dict[int, list[int]]) -> list[IntArray]:
    rings = []
    while after:
        v = min(after)
        ring: list[int] = []
        while v in after:
            ring.append(v)
            goes_on = after[v]
            step = goes_on.pop()
            if not goes_on:
                del after[v]
            if step in ring:  # a ring that touches itself at a corner: what has come round is a ring of its own
                start = ring.index(step)
                rings.append(np.array(ring[start:], np.int64))
                ring = ring[:start]
            v = step
        if ring:
            raise ReconstructionError("the outline of a flat face does not close: its planes nearly coincide")
    return rings


def _true_corners(places: FloatArray, rings: list[tuple[int, list[IntArray]]]) -> BoolArray:
    """(n,) vertices at which any outline turns; the others only part straight edges."""
    keep = np.zeros(len(places), bool)
    for _, patch in rings:
        for ring in patch:
            back, on = places[ring] - places[np.roll(ring, 1)], places[np.roll(ring, -1)] - places[ring]
            cosine = np.einsum("ij,ij->i", back, on) / np.maximum(np.linalg.norm(back, axis=1) * np.linalg.norm(on, axis=1), 1e-300)
            keep[ring[cosine < 1.0 - STRAIGHT]] = True
    return keep
