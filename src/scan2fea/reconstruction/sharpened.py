"""Edges between flat faces of a free form, which points beside them cut off: triangles across an edge are led out to where the planes meet.

Random points h apart leave 0.22 h^2 of cross-section off a square edge; of a bracket with points a third of its wall apart that is 4 % of the volume.
An edge of a triangle whose ends lie on two planes gets a vertex on the line in which these meet, a triangle on three planes one in their corner
(after Attene, Falcidino, Rossignac, Spagnuolo, "Edge-sharpener", 2003, with planes grown from all points in place of the triangles beside the edge).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.errors import ReconstructionError
from scan2fea.kernel.measures import vertex_normals, volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.primitives import Plane, meeting_point
from scan2fea.kernel.topology import half_edges, surface_topology
from scan2fea.reconstruction.budget import EDGES_CUT, VOLUME_IN_DOUBT
from scan2fea.reconstruction.evidence import at_most
from scan2fea.reconstruction.gates import in_all
from scan2fea.reconstruction.gates_planar import is_flat
from scan2fea.reconstruction.gates_surface import RIM_SPACING, mean_curvature
from scan2fea.reconstruction.plane_growing import grow_planes, tolerance_m
from scan2fea.reconstruction.strips import with_strips
from scan2fea.reconstruction.visibility import Reconstruction
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, Scan, TriangleMesh

APART = 0.1  # spacings from the other plane: nearer, a vertex lies on the edge already
FARTHEST = 2.0  # spacings that a vertex is led out: over wider gaps nobody knows that planes go on
OWN_SIDE = 0.3  # cosine of a vertex's normal with its plane's
ROUNDS = 12  # of taking back what makes triangles cross
MOSTLY = 0.5  # of the points lie on flat faces
TURNED = 0.7  # cosine: planes that turn less have no edge to speak of, and may be pieces of something round


def served_sharp(scan: Scan, first: Reconstruction) -> Reconstruction:
    """The first surface with edges between its flat faces led out to where these meet; as it is where there are none, or it would cross itself."""
    if first.source == "ranges" or first.how["method"] != "visibility":
        return first
    try:
        planes = _planes(scan.cloud.points, first)
    except ReconstructionError:  # too many: nothing is flat
        return first
    if not planes:
        return first
    places, of_edge, of_face = _new_places(first, planes)
    for _ in range(ROUNDS):
        mesh, place = sharpened(first.mesh, places, of_edge, of_face)
        crossing = np.unique(self_intersections(mesh))
        if not len(crossing):
            break
        bad = np.unique(place[mesh.faces[crossing]])
        of_edge, of_face = (np.where(np.isin(own, bad), -1, own) for own in (of_edge, of_face))
    else:
        return first
    is_new = place >= 0
    if not is_new.any() or not surface_topology(mesh).is_clean:
        return first
    how = {**first.how, "n_sharpened": int(is_new.sum()), "first_volume_m3": volume(first.mesh)}
    return replace(first, mesh=mesh, checks=_checks(first, mesh, is_new), how=how)


def _planes(points: FloatArray, first: Reconstruction) -> list[Plane]:
    """The planes under the points, without those that are pieces of something round; none where most of the points lie on none."""
    h, sigma = first.spacing_m, first.sigma_m
    known = first.thickness_m[np.isfinite(first.thickness_m)]
    wall = float(np.quantile(known, 0.25)) if len(known) else float("nan")
    grown = grow_planes(points, first.normals, h, sigma)
    if not len(grown):
        return []
    every = with_strips(points, grown, first.mesh, wall, h, sigma)
    flat = [k for k in range(len(every)) if is_flat(points[every.label == k], every.plane(k), sigma, h)]
    return [every.plane(k) for k in flat] if np.isin(every.label, flat).mean() >= MOSTLY else []


def _new_places(first: Reconstruction, planes: list[Plane]) -> tuple[FloatArray, IntArray, IntArray]:
    """(k, 3) places on edges and corners, and the one of each of the three edges of each face (m, 3), and of its inside (m,); -1: none."""
    mesh, h = first.mesh, first.spacing_m
    label = _labels(first, planes)
    edges, number = np.unique(np.sort(half_edges(mesh.faces), axis=1), axis=0, return_inverse=True)
    places: list[FloatArray] = []

    def put(corners: IntArray) -> int:
        place = _led_out(mesh.vertices[corners], [planes[k] for k in label[corners]], h)
        if place is not None:
            places.append(place)
        return -1 if place is None else len(places) - 1

    across: BoolArray = np.asarray((label[edges] >= 0).all(axis=1) & (label[edges[:, 0]] != label[edges[:, 1]]))
    of_edge = np.array([put(edge) if is_one else -1 for edge, is_one in zip(edges, across, strict=True)])[number.reshape(-1, 3)]
    every: BoolArray = np.asarray((of_edge >= 0).all(axis=1))
    of_face = np.array([put(face) if is_one else -1 for face, is_one in zip(mesh.faces, every, strict=True)])
    return np.reshape(places, (-1, 3)), of_edge, of_face


def _labels(first: Reconstruction, planes: list[Plane]) -> IntArray:
    """(v,) the plane that each vertex lies on, -1 none; where it lies on several that which the surface there faces most alike."""
    normals = vertex_normals(first.mesh)
    off = tolerance_m(first.spacing_m, first.sigma_m)
    alike = np.stack([np.where(np.abs(p.distance(first.mesh.vertices)) <= off, normals @ p.normal, -1.0) for p in planes], axis=1)
    best = alike.argmax(axis=1)
    return np.where(alike.max(axis=1) >= OWN_SIDE, best, -1)


def sharpened(mesh: TriangleMesh, places: FloatArray, of_edge: IntArray, of_face: IntArray) -> tuple[TriangleMesh, IntArray]:
    """The mesh with those of the places (k, 3) in it that its edges (m, 3) and faces (m,) name, and the place that each vertex is, -1 none."""
    n = len(mesh.vertices)
    middle, corner = np.where(of_edge >= 0, of_edge + n, -1), np.where((of_face >= 0) & (of_edge >= 0).all(axis=1), of_face + n, -1)
    faces = np.concatenate([_split(face, on, int(inside)) for face, on, inside in zip(mesh.faces, middle, corner, strict=True)])
    used, packed = np.unique(faces, return_inverse=True)
    vertices = np.concatenate([mesh.vertices, places])[used]
    return TriangleMesh(vertices=vertices, faces=packed.reshape(-1, 3).astype(np.int64)), np.where(used >= n, used - n, -1)


def _led_out(places: FloatArray, planes: list[Plane], spacing_m: float) -> FloatArray | None:
    """Where the planes that two or three places lie on meet; None where they hardly turn, one place lies on another's plane, or it is far."""
    for i, plane in enumerate(planes):
        for j in range(len(planes)):
            if i != j and (abs(plane.normal @ planes[j].normal) > TURNED or abs(plane.distance(places[j : j + 1])[0]) < APART * spacing_m):
                return None
    middle = places.mean(axis=0)
    out = meeting_point(planes, middle)
    return out if np.linalg.norm(out - middle) <= FARTHEST * spacing_m else None


def _split(face: IntArray, middle: IntArray, corner: int) -> IntArray:
    """The triangles of a face. middle : (3,) vertex put on its edges 01, 12, 20, -1 none.   corner : one put inside it, -1 none."""
    n = int((middle >= 0).sum())
    if n == 0:
        return face[None]
    if corner >= 0:
        ring = [face[0], middle[0], face[1], middle[1], face[2], middle[2]]
        return np.array([[ring[k], ring[(k + 1) % 6], corner] for k in range(6)])
    if n == 3:
        (a, b, c), (ab, bc, ca) = face, middle
        return np.array([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
    k = int(np.flatnonzero(middle >= 0)[0]) if n == 1 else int((np.flatnonzero(middle < 0)[0] + 1) % 3)
    a, b, c = np.roll(face, -k)
    ab, bc = np.roll(middle, -k)[:2]  # the first edge is split, and where two are the next one too
    if n == 1:
        return np.array([[a, ab, c], [ab, b, c]])
    return np.array([[ab, b, bc], [a, ab, bc], [a, bc, c]])


def _checks(first: Reconstruction, mesh: TriangleMesh, is_new: BoolArray) -> tuple[Check, ...]:
    """Those of the first surface; what spacing cuts off edges is asked of those alone that were not led out. Noise moves the others all the same."""
    whole = max(mean_curvature(first.mesh), np.finfo(float).tiny)
    left = max(0.0, mean_curvature(mesh, without=is_new)) / whole * abs(volume(first.mesh) / volume(mesh))
    out = []
    for check in first.checks:
        if check.name == EDGES_CUT and isinstance(check.value, float):
            says = f"{check.says} (edges between flat faces led out: {left:.0%} of that is left)"
            check = at_most(EDGES_CUT, left * check.value, RIM_SPACING, says)
        out.append(check)
    return in_all(*(check for check in out if check.name != VOLUME_IN_DOUBT))
