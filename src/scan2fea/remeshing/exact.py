"""Planes of a surface that was drawn, not scanned: groups of triangles that lie in one plane to the last digits."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import extent, face_areas, face_normals
from scan2fea.kernel.planar_regions import planar_regions
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.kernel.topology import edge_table
from scan2fea.remeshing.creases import Flattened
from scan2fea.types import BoolArray, FloatArray, TriangleMesh

SHARP_DEG = 20.0  # a plane ends where the next face turns by more
SHARP_SHARE = 0.6  # of the border of a plane; the facets of a drawn cylinder pass into one another at less
DRAWN = 0.3  # share of the area on planes from which a surface counts as drawn
SAMPLES = 2000  # places where the wall is measured
WALLS, PARTS = 1.5, 20.0  # edge length of a drawn surface: at most this many walls, and this part of the size


def drawn(mesh: TriangleMesh) -> Flattened | None:
    """The mesh with its exact planes numbered; None where it has too few to have been drawn."""
    regions = planar_regions(mesh)
    table = edge_table(mesh.faces)
    normal = face_normals(mesh)
    half = np.flatnonzero(table.twin >= 0)
    a, b = regions.label[half // 3], regions.label[table.twin[half] // 3]
    ends = table.edges[table.edge_of[half]]
    length = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    turned = np.einsum("ij,ij->i", normal[half // 3], normal[table.twin[half] // 3]) < np.cos(np.radians(SHARP_DEG))
    border = (a != b) & (a >= 0)
    n = int(regions.label.max(initial=-1)) + 1
    total = np.bincount(a[border], weights=length[border], minlength=n)
    sharp = np.bincount(a[border & turned], weights=length[border & turned], minlength=n)
    keep: BoolArray = sharp >= SHARP_SHARE * np.maximum(total, 1e-300)
    kept = np.flatnonzero(keep & (np.bincount(regions.label[regions.label >= 0], minlength=n) > 0))
    number = np.full(n + 1, -1, np.int64)
    number[kept] = np.arange(len(kept))
    region = number[regions.label]
    areas = face_areas(mesh)
    if areas[region >= 0].sum() < DRAWN * areas.sum():
        return None
    row = np.searchsorted(regions.ids, kept)
    planes = tuple(Plane(normal=regions.normal[k], offset=float(regions.normal[k] @ regions.point[k])) for k in row)
    flat = TriangleMesh(vertices=mesh.vertices, faces=mesh.faces, face_region=region)
    return Flattened(mesh=flat, planes=planes, n_undone=0)


def edge_of_drawn(mesh: TriangleMesh, spacing_m: float) -> float:
    """An edge length for a drawn surface, whose vertices say nothing of the size of its details."""
    places, face = sample_surface(mesh, SAMPLES, 0)
    inward = -face_normals(mesh)[face]
    size = extent(mesh.vertices)
    through, _ = first_hits(scene_of(mesh), places + 1e-7 * size * inward, inward)
    candidates: FloatArray = np.array([2 * spacing_m, WALLS * float(np.median(through)), size / PARTS])
    return float(candidates.min())
