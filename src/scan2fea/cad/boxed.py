"""Turned bodies that stand askew, written so that other programs see them where they are.

Open Cascade, and what is built on it, draws the box of a surface of revolution round its whole circles: askew it comes out too wide (85 mm of 1.3 m
measured). As rational B-splines the same surfaces have an exact box; but gmsh does not mesh their poles. So one is shipped, the other is meshed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from scan2fea.cad.live import surface_of
from scan2fea.cad.readback import ReadBack, box_m, parts_of_shape, read_back, shape_of
from scan2fea.cad.step_occ import named, step_of_solid
from scan2fea.errors import CadError
from scan2fea.kernel.measures import extent
from scan2fea.types import Brep, TriangleMesh

BOX_OFF = 0.005  # of the size: what placing programs may see beyond the body
AGREES = 1e-6  # relative, of volume and area, and of centres to the size: both files are one solid


def box_off_m(step: str, mesh: TriangleMesh) -> float:
    """How far the box of the solid in the text reaches beyond that of its triangles, or falls short, metres."""
    return float(np.abs(box_m(step) - np.stack([mesh.vertices.min(0), mesh.vertices.max(0)])).max())


def with_exact_box(brep: Brep, solid_mm: Any, mesh: TriangleMesh, uncertainty_m: float) -> Brep:
    """`brep` as it is where its box is right, or where no better text is to be had; else with one whose turned surfaces are B-splines.

    solid_mm : the live solid that `brep.step` was written from.   mesh : its triangles, metres.
    """
    limit = BOX_OFF * extent(mesh.vertices)
    if box_off_m(brep.step, mesh) <= limit:
        return brep
    from OCP.ShapeCustom import ShapeCustom
    from OCP.TopAbs import TopAbs_FACE

    try:
        shape = ShapeCustom.ConvertToBSpline_s(solid_mm, False, True, False, False)
        text, numbers = step_of_solid(shape, uncertainty_m)
        found = read_back(text)
    except CadError:
        return brep
    if not _same(brep, found, extent(mesh.vertices)) or box_off_m(text, mesh) > limit:
        return brep
    kinds = tuple(surface_of(face).kind for face in parts_of_shape(shape_of(text), TopAbs_FACE))
    return replace(brep, step=named(text, numbers, brep.face_names), mesh_step=brep.step, face_kinds=kinds)


def _same(brep: Brep, found: ReadBack, size_m: float) -> bool:
    """Whether the other text is the same solid, face by face."""
    if brep.face_centre is None or brep.face_area is None or len(found.face_area) != len(brep.face_area):
        return False
    sound = found.is_valid and found.n_solids == 1 and found.n_free_edges == 0
    close = abs(found.volume_m3 / brep.volume_m3 - 1) <= AGREES
    moved = float(np.linalg.norm(found.face_centre - brep.face_centre, axis=1).max()) / size_m
    other = float(np.abs(found.face_area - brep.face_area).max()) / size_m**2
    return bool(sound and close and max(moved, other) <= AGREES)

