"""A drawing as the solid of its true faces: the surfaces that its corners lie on, trimmed where its triangles change from one to the other."""

from __future__ import annotations

import numpy as np

from scan2fea.cad.compared import Compared, Scale, triangles_of
from scan2fea.cad.drawn import EXACT, drawn_patches
from scan2fea.cad.live import is_valid, parts
from scan2fea.cad.patches import Patches
from scan2fea.cad.readback import volume_of
from scan2fea.cad.traced import MOST_FACETS, traced_solid
from scan2fea.cad.trued import Trued, in_mm, no_solid, trued
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import extent, face_areas
from scan2fea.kernel.measures import volume as enclosed_volume
from scan2fea.kernel.surfaces import PLANE, covariance
from scan2fea.kernel.topology import edge_table, surface_topology
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh
from scan2fea.units import MILLIMETRES_PER_METRE

MOST_SURFACES = 400
FREE = 0.05  # share of the area that may lie on no surface: its triangles are faces
FINE = 60.0  # of the size: edges inside faces, and those of straight lines, are cut into pieces no longer than a part of it
TOUCHES = 50.0  # times the exactness: surfaces that miss each other by less touch
STRAIGHT = 5.0  # times the exactness: edges nearer to a line or an arc are one
JOINED = 50.0  # times the exactness: corners of triangles that are one
ROUNDS = 12  # of halving


def drawn_solid(mesh: TriangleMesh) -> Trued:
    """The solid of a closed manifold mesh as a CAD program writes it, the triangles of what is free form among its faces; or why it is none."""
    patches = drawn_patches(mesh)
    area, is_free = face_areas(mesh), patches.label < 0
    share = float(area[is_free].sum()) / float(area.sum())
    if share > FREE or is_free.sum() > MOST_FACETS or not 2 <= len(patches.surfaces) <= MOST_SURFACES:
        return no_solid(f"as drawn {share:.1%} of the area lies on none of {len(patches.surfaces)} surfaces through the corners of the file")
    size = extent(mesh.vertices)
    fine, label = finer(mesh, patches, size / FINE)
    mm, middle = MILLIMETRES_PER_METRE, (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2
    local = TriangleMesh(vertices=(fine.vertices - middle) * mm, faces=fine.faces)
    surfaces = [in_mm(s, middle) for s in patches.surfaces]
    exact = EXACT * size * mm
    near = [local.vertices[np.unique(local.faces[label == k])] for k in range(len(surfaces))]
    told = [covariance(s, v, exact) for s, v in zip(surfaces, near, strict=True)]
    made = traced_solid(local, label, surfaces, told, TOUCHES * exact, _shortest(local, label), free=label < 0, exact=STRAIGHT * exact)
    if made.solid is None or not is_valid(made.solid):
        return no_solid("the faces as drawn close no valid solid")
    chord = chord_of(mesh, patches)
    scale = Scale(spacing_m=size / FINE, noise_m=chord / 3, size_m=size)
    problem = _differs(made.solid, mesh, middle, chord, is_free, area, scale)
    if problem:
        return no_solid(f"as drawn: {problem}")
    holes = surface_topology(mesh).n_handles
    drawn = made.surfaces if made.n_facets else None
    return trued(made.solid, middle, scale, (), Compared(problem="", holes=(holes, holes)), drawn=drawn, within_m=JOINED * EXACT * size)


def finer(mesh: TriangleMesh, patches: Patches, edge_m: float) -> tuple[TriangleMesh, IntArray]:
    """The mesh with the edges inside and between its surfaces no longer than `edge_m`, new corners on their surface, and the surface of each face."""
    vertices, faces, label = mesh.vertices, mesh.faces, patches.label
    for _ in range(ROUNDS):
        table = edge_table(faces)
        ends = vertices[table.edges]
        sides = np.full((len(table.edges), 2), -1, np.int64)
        half = np.arange(len(table.twin))
        sides[table.edge_of, 0], sides[table.edge_of, 1] = label[half // 3], label[table.twin // 3]
        long = (np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > edge_m) & (sides >= 0).all(1)
        if not long.any():
            break
        new = ends[long].mean(1)
        inside = sides[long, 0] == sides[long, 1]
        for k in np.unique(sides[long, 0][inside]).tolist():
            rows = np.flatnonzero(inside & (sides[long, 0] == k))
            new[rows] = patches.surfaces[k].projected(new[rows])
        middle = np.full(len(long), -1, np.int64)
        middle[long] = len(vertices) + np.arange(len(new))
        vertices = np.concatenate([vertices, new])
        faces, origin = _halved(faces, middle[table.edge_of].reshape(-1, 3))
        label = label[origin]
    return TriangleMesh(vertices=vertices, faces=faces), label


def _halved(faces: IntArray, middle: IntArray) -> tuple[IntArray, IntArray]:
    """Faces cut at the middles of their edges (m, 3), -1 where there is none, and the face that each is of."""
    out, origin = [], []
    count = (middle >= 0).sum(1)
    for n in range(4):
        rows = np.flatnonzero(count == n)
        # turned so that the first edge is cut (one), the first two are (two)
        first = (middle[rows] >= 0).argmax(1) if n == 1 else ((middle[rows] < 0).argmax(1) + 1) % 3 if n == 2 else np.zeros(len(rows), np.int64)
        turn = (first[:, None] + np.arange(3)) % 3
        (a, b, c), (p, q, r) = np.take_along_axis(faces[rows], turn, 1).T, np.take_along_axis(middle[rows], turn, 1).T
        pieces = {
            0: [(a, b, c)], 1: [(a, p, c), (p, b, c)], 2: [(p, b, q), (a, p, q), (a, q, c)], 3: [(a, p, r), (p, b, q), (r, q, c), (p, q, r)],
        }[n]  # fmt: skip
        out += [np.stack(piece, axis=1) for piece in pieces]
        origin += [rows for _ in pieces]
    return np.concatenate(out), np.concatenate(origin)


def chord_of(mesh: TriangleMesh, patches: Patches) -> float:
    """How far the triangles of round faces lie from these at most, metres."""
    corners = mesh.vertices[mesh.faces]
    places = np.concatenate([corners.mean(1, keepdims=True), (corners + np.roll(corners, -1, axis=1)) / 2], axis=1)
    off = [np.abs(s.distance(places[patches.label == k].reshape(-1, 3))).max() for k, s in enumerate(patches.surfaces) if s.kind != PLANE]
    return float(max(off, default=0.0))


def _shortest(mesh: TriangleMesh, label: IntArray) -> float:
    """The shortest edge between two surfaces: no border is shorter."""
    table = edge_table(mesh.faces)
    own, other = np.repeat(label, 3), label[table.twin // 3]
    ends = mesh.vertices[table.edges[table.edge_of[(own != other) & (own >= 0) & (other >= 0)]]]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).min(initial=extent(mesh.vertices)))


def _differs(
    solid: object, mesh: TriangleMesh, middle: FloatArray, chord: float, is_free: BoolArray, area: FloatArray, scale: Scale
) -> str:
    """How the solid is not what was drawn, "" where it is: its corners on the solid, the solid within the chords, as many holes, the volume."""
    from OCP.TopAbs import TopAbs_SOLID

    if len(parts(solid, TopAbs_SOLID)) != 1:
        return "the faces close more than one solid"
    shown, _ = triangles_of(solid, middle, scale.tolerance_m, JOINED * EXACT * scale.size_m)
    if surface_topology(shown).n_handles != surface_topology(mesh).n_handles:
        return "another number of holes goes through the solid"
    give = 1.5 * chord + 1e-5 * scale.size_m  # triangles of both are cut off at chords
    off = float(PointToMesh(shown).nearest(mesh.vertices).distance.max())
    back = float(PointToMesh(mesh).nearest(shown.vertices[np.unique(shown.faces)]).distance.max())
    if max(off, back) > give:
        return f"the solid lies up to {1e3 * max(off, back):.3g} mm off the file, whose chords are {1e3 * chord:.3g} mm high"
    more = abs(volume_of(solid) / MILLIMETRES_PER_METRE**3 - enclosed_volume(mesh))
    if more > give * float(area.sum()):
        return "the solid holds another volume"
    return ""
