"""Which CAD face each boundary triangle lies on, and how the faces are called in the deck."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.errors import MeshingError, require
from scan2fea.kernel.measures import face_areas
from scan2fea.kernel.planar_regions import planar_regions
from scan2fea.types import Brep, FloatArray, IntArray, TriangleMesh, Value

FREEFORM = "FREEFORM"  # one name for all facets: thousands of face sets help nobody
PATCH = "patch"  # kind of a face of free form among true ones
MANY_NAMES, STANDS_OUT = 200, 10.0  # of more faces than that (mostly facets, some coplanar by chance) only those ten times the median are named
CENTRE_AGREES = 1e-5  # of the size; two plane faces of one solid that share centre and area to this do not occur side by side in a STEP file


@dataclass(frozen=True, eq=False, kw_only=True)
class Names(Value):
    """names : of the tags.   tag_of_triangle : (m,) per triangle of the surface.   tag_of_face : (f,) per B-Rep face.

    face_centre : (f, 3), face_area : (f,) of the B-Rep faces, measured on the surface (of curved ones by who made them): the proof of the order of
    the STEP file.
    """

    names: tuple[str, ...]
    tag_of_triangle: IntArray
    tag_of_face: IntArray
    face_centre: FloatArray
    face_area: FloatArray


def names_of(mesh: TriangleMesh, brep: Brep | None) -> Names:
    """Names from the B-Rep: a tag for each true face, FREEFORM for all facets and patches. Without a B-Rep, regions of the surface: REGION_0, ..."""
    curved = brep is not None and brep.is_curved and mesh.face_region is not None
    label = mesh.face_region if curved and mesh.face_region is not None else planar_regions(mesh).label
    if brep is None:
        ids = np.unique(label[label >= 0])
        titles, is_plane = [f"REGION_{i}" for i in ids] + [""], np.arange(len(ids) + 1) < len(ids)
        face_of = np.where(label >= 0, np.searchsorted(ids, label), len(ids))
    else:
        titles, is_plane = list(brep.face_names), (np.asarray(brep.region_of_face) >= 0) & (np.array(brep.face_kinds) != PATCH)
        face_of = _face_of_triangle(label, brep)
    n_faces = len(titles)
    weight = face_areas(mesh)
    area = np.asarray(np.bincount(face_of, weights=weight, minlength=n_faces), float)
    named = is_plane if n_faces <= MANY_NAMES else is_plane & (area > STANDS_OUT * np.median(area))
    names = tuple(t for t, keep in zip(titles, named, strict=True) if keep)
    of_face = np.where(named, np.cumsum(named) - 1, len(names))
    tag = of_face[face_of]
    if (tag == len(names)).any():
        names = (*names, FREEFORM)
    middle = mesh.vertices[mesh.faces].mean(1)
    moment = np.stack([np.bincount(face_of, weights=weight * middle[:, k], minlength=n_faces) for k in range(3)], axis=1)
    centre = moment / np.maximum(area, 1e-300)[:, None]
    if brep is not None and brep.face_centre is not None and brep.face_area is not None:
        centre, area = brep.face_centre, brep.face_area
    return Names(names=names, tag_of_triangle=tag.astype(np.int64), tag_of_face=of_face.astype(np.int64), face_centre=centre, face_area=area)


def _face_of_triangle(label: IntArray, brep: Brep) -> IntArray:
    """(m,) B-Rep face of each triangle. Raises MeshingError where the B-Rep is not this surface's."""
    face = np.full(len(label), -1, np.int64)
    facet = np.asarray(brep.facet_of_face)
    single = np.flatnonzero(facet >= 0)
    require(len(single) == 0 or facet.max() < len(label), MeshingError, "the B-Rep was made from another surface (facets beyond its triangles)")
    face[facet[single]] = single
    for row in np.flatnonzero(np.asarray(brep.region_of_face) >= 0).tolist():
        face[(label == brep.region_of_face[row]) & (face < 0)] = row
    require((face >= 0).all(), MeshingError, f"the B-Rep was made from another surface: {int((face < 0).sum())} triangles lie on none of its faces")
    return face


def prove_order(names: Names, centre: FloatArray, area: FloatArray, size_m: float) -> None:
    """Raises MeshingError unless face k of the mesher is face k of the B-Rep, by centre and area."""
    n = len(names.face_area)
    require(len(area) == n, MeshingError, f"the mesher found {len(area)} faces in the STEP text, the B-Rep has {n}")
    off = np.linalg.norm(centre - names.face_centre, axis=1).max() / size_m
    wrong = np.abs(area - names.face_area).max() / size_m**2
    require(max(off, wrong) <= CENTRE_AGREES, MeshingError, "the faces of the STEP text are not in the order of the B-Rep (a fault of ours)")
