"""What Lloyd and ODT on a surface share: vertices slide on the surface they came from, creases on their curves, corners stay."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scan2fea.kernel.relaxation import Relaxed, relax
from scan2fea.kernel.topology import edge_table, face_components, vertex_faces
from scan2fea.remeshing.isotropic import sharp_edges
from scan2fea.remeshing.surface_kernels import flip_to_delaunay, half_shortest_edges, slide, slide_along, turned
from scan2fea.types import BoolArray, ByteArray, FloatArray, IntArray, TriangleMesh

FLOOR = 0.35  # shape of a face, 1 is equilateral, that a step may not go below unless it was worse
TURN = 0.5  # cosine of what a face may turn by in one step
CREASE_DEG = 20.0  # facets of smooth surfaces meet at less; with 40 a round of fandisk lost a tenth of an edge
DRIFT = 0.05  # of the median edge: how far turning an edge may move the surface


@dataclass(frozen=True, eq=False, kw_only=True)
class OnSurface:
    """Half of a method for `kernel.relaxation`; the arrays beside, sharp, faces, face_at and edge_at change as it goes.

    reference : what is slid on, None for the form without constraints.   label : of the reference faces, not joined across creases.
    free, crease : vertices that slide on faces and along creases; the others are held.
    """

    kind: int
    faces: IntArray
    beside: IntArray
    sharp: ByteArray
    held: BoolArray
    drift_m: float
    reference: TriangleMesh | None
    label: IntArray
    first: IntArray
    around: IntArray
    free: IntArray
    crease: IntArray
    crease_edges: IntArray
    crease_beside: IntArray
    face_at: IntArray
    edge_at: IntArray

    def reach(self, points: FloatArray) -> FloatArray:
        return half_shortest_edges(points, self.faces, self.held)

    def projected(self, points: FloatArray, trial: FloatArray) -> FloatArray:
        trial = np.where(self.held[:, None], points, trial)
        if self.reference is not None:
            slide(trial, self.free, self.face_at, self.reference.vertices, self.reference.faces, self.first, self.around, self.label)
            slide_along(trial, self.crease, self.edge_at, self.reference.vertices, self.crease_edges, self.crease_beside)
        return trial

    def spoiled(self, points: FloatArray, trial: FloatArray) -> BoolArray:
        return turned(points, trial, self.faces, FLOOR, TURN)

    def reconnected(self, points: FloatArray) -> bool:
        return flip_to_delaunay(points, self.faces, self.beside, self.sharp, self.kind, self.drift_m, TURN) > 0


def opened(mesh: TriangleMesh, kind: int, crease_deg: float, drift_m: float | None, constrained: bool) -> dict[str, object]:
    """The fields of OnSurface for a manifold, oriented mesh; its borders are held. Without constraints nothing is, and there are no creases."""
    table = edge_table(mesh.faces)
    is_sharp = sharp_edges(mesh, crease_deg) if constrained else np.zeros(len(table.edges), bool)
    half_sharp = is_sharp[table.edge_of].reshape(-1, 3)
    beside = np.where(table.twin >= 0, table.twin // 3, -1).reshape(-1, 3)
    creases = np.bincount(table.edges[is_sharp].ravel(), minlength=len(mesh.vertices))
    held = (creases != 0) & (creases != 2) if constrained else np.zeros(len(mesh.vertices), bool)
    if constrained:
        ends = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2)
        held[ends[beside < 0]] = True
    _, label = face_components(mesh.faces, ~is_sharp)
    first, around = vertex_faces(mesh.faces, len(mesh.vertices))
    edges = table.edges[is_sharp]
    edge_at, crease_beside = _along(edges, len(mesh.vertices))
    edge = np.linalg.norm(mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, -1, axis=1)], axis=2)
    return {
        "kind": kind, "faces": np.array(mesh.faces, np.int64), "beside": beside.astype(np.int64), "sharp": half_sharp.astype(np.uint8), "held": held,
        "drift_m": DRIFT * float(np.median(edge)) if drift_m is None else drift_m, "reference": mesh if constrained else None,
        "label": np.asarray(label, np.int64), "first": first, "around": around, "free": np.flatnonzero((creases == 0) & ~held),
        "crease": np.flatnonzero((creases == 2) & ~held), "crease_edges": edges, "crease_beside": crease_beside,
        "face_at": around[np.minimum(first[:-1], max(len(around) - 1, 0))].astype(np.int64), "edge_at": edge_at,
    }  # fmt: skip


def _along(edges: IntArray, n_vertices: int) -> tuple[IntArray, IntArray]:
    """(n,) one crease edge of each vertex, and (e, 2) the next edge over either end, -1 where three or more meet or the crease ends."""
    count = np.bincount(edges.ravel(), minlength=n_vertices)
    total = np.zeros(n_vertices, np.int64)
    np.add.at(total, edges.ravel(), np.repeat(np.arange(len(edges)), 2))
    at = np.full(n_vertices, -1, np.int64)
    at[edges.ravel()[::-1]] = np.repeat(np.arange(len(edges)), 2)[::-1]
    beside = np.where(count[edges] == 2, total[edges] - np.arange(len(edges))[:, None], -1)
    return at, beside.reshape(-1, 2).astype(np.int64)


def run(mesh: TriangleMesh, method: OnSurface, iterations: int) -> tuple[TriangleMesh, Relaxed]:
    """The mesh with its vertices moved and its edges turned by the method (which must be one of the kernel's methods); regions go with the faces."""
    points = np.array(mesh.vertices)  # a copy: numba compiles kernels anew for arrays that are read-only, as those of a mesh are
    method.reconnected(points)
    found = relax(points, method, iterations=iterations)  # type: ignore[arg-type]
    region = mesh.face_region if method.reference is not None else None
    return replace(mesh, vertices=found.points, faces=method.faces, face_region=region, face_origin=None, deviation_m=None), found
