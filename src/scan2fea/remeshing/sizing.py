"""How long edges should be, vertex by vertex: short on tight curves, thin walls and narrow strips, long elsewhere, and few enough faces in all."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.measures import face_areas, face_normals, vertex_normals
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.kernel.topology import EdgeTable, edge_table
from scan2fea.remeshing.features import crease_bend, strip_width
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

CHORD = 0.05  # of the edge: how far an edge may cut a curve short
WALL_EDGES = 2.0  # of the thickness: longer edges leave flat tets in a wall
STRIP_EDGES = 2.0  # of the width between two creases: longer edges leave triangles under 27 degrees between them
GROWTH = 0.3  # of the distance: how fast the goal may change along the surface
SMOOTHING = 3  # rounds over the normals before curvature is read from them
TURN = math.radians(30.0)  # of an edge along a curve that was drawn, or fitted: a bolt hole of a few edges is none
BENT = 0.5  # of all faces: where bends take more, they give way with the rest
FACE_AREA = 3**0.5 / 4  # of an equilateral triangle of edge 1
WIDE = 8.0  # faces that a face comes to: in one of more the goal has room to grow
INSIDE = np.array([[i + 1, j + 1, 13 - i - j] for i in range(13) for j in range(13 - i)]) / 15.0  # places in a triangle, by its corners


def _smoothed_normals(mesh: TriangleMesh, table: EdgeTable, is_sharp: BoolArray) -> FloatArray:
    """Face normals averaged over neighbours by area, not across sharp edges."""
    half = np.flatnonzero((table.twin >= 0) & ~is_sharp[table.edge_of])
    f, g = half // 3, table.twin[half] // 3
    areas = face_areas(mesh)
    normal = face_normals(mesh)
    for _ in range(SMOOTHING):
        total = normal * areas[:, None]
        for k in range(3):
            total[:, k] += np.bincount(f, weights=normal[g, k] * areas[g], minlength=len(normal))
        normal = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
    return np.asarray(normal)


def curvature(mesh: TriangleMesh, is_sharp: BoolArray) -> FloatArray:
    """(n,) 1/m, the strongest bend at a vertex: angle between smoothed normals over the distance of the faces, not across sharp edges."""
    table = edge_table(mesh.faces)
    normal = _smoothed_normals(mesh, table, is_sharp)
    half = np.flatnonzero((table.twin > np.arange(len(table.twin))) & ~is_sharp[table.edge_of])
    f, g = half // 3, table.twin[half] // 3
    middle = mesh.vertices[mesh.faces].mean(1)
    angle = np.arctan2(np.linalg.norm(np.cross(normal[f], normal[g]), axis=1), (normal[f] * normal[g]).sum(1))
    ends = table.edges[table.edge_of[half]]
    # slivers put centroids arbitrarily near each other: an edge bends over at least a third of its length
    length = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    bend = angle / np.maximum(np.linalg.norm(middle[f] - middle[g], axis=1), np.maximum(length / 3, 1e-300))
    out = np.zeros(len(mesh.vertices))
    for k in range(2):
        np.maximum.at(out, ends[:, k], bend)
    return out


def thickness(mesh: TriangleMesh) -> FloatArray:
    """(n,) metres from each vertex straight inward to the other side, inf where nothing is hit."""
    inward = -vertex_normals(mesh)
    step = 1e-6 * float(np.ptp(mesh.vertices, axis=0).max(initial=0.0))
    t, _ = first_hits(scene_of(mesh), mesh.vertices + step * inward, inward)
    return np.asarray(t + step)


def graded(goal: FloatArray, mesh: TriangleMesh, edges: IntArray) -> FloatArray:
    """The goal lowered so that it grows by no more than GROWTH times the distance along edges."""
    length = GROWTH * np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    goal = goal.copy()
    for _ in range(50):
        before = goal.copy()
        np.minimum.at(goal, edges[:, 0], before[edges[:, 1]] + length)
        np.minimum.at(goal, edges[:, 1], before[edges[:, 0]] + length)
        if np.array_equal(goal, before):
            break
    return goal


def _of_planes(mesh: TriangleMesh) -> BoolArray:
    """(e,) True for edges of planes: creases in free form begin and end anywhere, and say nothing of a detail's size."""
    table = edge_table(mesh.faces)
    out = np.zeros(len(table.edges), bool)
    if mesh.face_region is not None:
        out[table.edge_of[np.repeat(mesh.face_region >= 0, 3)]] = True
    return out


def edge_goal(
    mesh: TriangleMesh, is_sharp: BoolArray, edge_m: float, finest_m: float, max_faces: int, *, is_drawn: bool = False
) -> tuple[FloatArray, float]:
    """(n,) metres: `edge_m` where nothing is tight, down to `finest_m` where it bends, is thin or narrow; longer if faces would be too many. And what
    it may grow to within wide faces, 0 where it is not to.

    is_drawn : faces are as wide as their planes, and curves are what they are drawn as, round to TURN an edge.
    Where bends take less than half of the faces they are kept, and walls and flats give way: a bolt hole in a long member would come as a square.
    """
    is_border = is_sharp & _of_planes(mesh)
    bend = np.maximum(curvature(mesh, is_sharp), crease_bend(mesh, is_border))
    wall = np.minimum(WALL_EDGES * thickness(mesh), STRIP_EDGES * strip_width(mesh, is_border))
    edges = edge_table(mesh.faces).edges
    areas = face_areas(mesh)
    is_free = np.ones(len(areas), bool) if mesh.face_region is None else mesh.face_region < 0
    finest, thinnest, chord = finest_m, finest_m, CHORD * edge_m
    for _ in range(30):
        radius = np.divide(1.0, bend, out=np.full(len(bend), np.inf), where=bend > 0)
        curved = np.minimum(np.sqrt(8 * chord * radius), TURN * radius if is_drawn else np.inf)  # sagitta = L^2 / 8 R
        others = np.clip(wall, thinnest, max(edge_m, thinnest))
        goal = graded(np.clip(curved, finest, np.maximum(others, finest)), mesh, edges)
        largest = max(edge_m, thinnest) if is_drawn else 0.0
        n_faces = _n_faces(mesh, areas, goal, largest)
        if n_faces.sum() <= max_faces:
            break
        more = max(1.03, min((n_faces.sum() / max_faces) ** 0.5, 1.5))
        edge_m *= more
        if edge_m > 4 * thinnest:
            thinnest *= 1.1  # even the fine places cost too much
        if n_faces[is_free & (curved < others)[mesh.faces].all(1)].sum() > BENT * max_faces:
            chord, finest = more * chord, max(finest, thinnest)
    return goal, largest


def _n_faces(mesh: TriangleMesh, areas: FloatArray, goal: FloatArray, largest_m: float) -> FloatArray:
    """(m,) faces that each face comes to. One much wider than the goal at its corners, between two holes of a plate, say, has other goals inside."""
    corners = goal[mesh.faces]
    out = areas / (FACE_AREA * corners.mean(1) ** 2)
    wide = np.flatnonzero((out > WIDE) & (largest_m > 0.0))
    places = np.einsum("pk,fkc->fpc", INSIDE, mesh.vertices[mesh.faces[wide]])
    away = np.linalg.norm(places[:, :, None] - mesh.vertices[mesh.faces[wide]][:, None], axis=3)
    inside = np.minimum((corners[wide][:, None] + GROWTH * away).min(axis=2), np.maximum(largest_m, corners[wide].max(axis=1))[:, None])
    out[wide] = areas[wide] / FACE_AREA * (inside**-2.0).mean(axis=1)
    return np.asarray(out)
