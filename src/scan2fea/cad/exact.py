"""The STEP file of a solid whose making is known: true planes, cylinders, spheres, surfaces of revolution, and B-splines where it is bent or free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.cad.bases import base_shape, straight
from scan2fea.cad.brep import CadOptions, to_brep
from scan2fea.cad.changes import changed
from scan2fea.cad.occ import moved, step_of
from scan2fea.cad.prism import prism_brep
from scan2fea.cad.readback import ReadBack, read_back
from scan2fea.errors import CadError, require
from scan2fea.kernel.construction import Base, Change, Plain, Swept
from scan2fea.kernel.outline import outline
from scan2fea.types import FloatArray, TriangleMesh

EXACT = 1e-9  # relative, of the volume of a solid as it was made
BENT = 1e-5  # of one that is bent: Open Cascade integrates over trimmed B-splines no better
MOST_FACETS = 200_000  # of a solid of which no true faces could be made: a minute or two


@dataclass(frozen=True, kw_only=True)
class ExactSolid:
    """step : text, AP214, millimetres, one solid.   is_true : true faces; False: the facets of the mesh.   n_faces, volume_m3 : as read back.

    note : why it has facets, else empty.
    """

    step: str
    is_true: bool
    n_faces: int
    volume_m3: float
    note: str = ""


def exact_solid(
    base: Base, changes: Sequence[Change], T_world_shape: FloatArray, mesh: TriangleMesh, volume_m3: float, limit: float = EXACT
) -> ExactSolid:
    """The solid of a construction, read back and measured: one valid solid whose volume is `volume_m3` to the relative `limit`.

    mesh : of the same solid in the world, for the facets that stand in where Open Cascade makes no such solid (a dent that runs out of a face).
    Raises CadError where even facets make no valid solid.
    """
    try:
        if not changes and isinstance(base, Swept):
            step = prism_brep(outline(base.family, base.values, base.fillet_m), straight(np.asarray(T_world_shape), base.length_m)).step
        elif not changes and isinstance(base, Plain) and not base.holes:
            step = to_brep(mesh).step
        else:
            shape = base_shape(base)
            for change in changes:
                shape = changed(shape, change)
            step = step_of(moved(shape, T_world_shape))
        found = read_back(step)
        problem = _problem(found, volume_m3, limit)
        require(not problem, CadError, problem)
    except (CadError, RuntimeError) as error:  # Open Cascade's own failures are RuntimeErrors
        note = " ".join(str(error).split()) or type(error).__name__
        facets = to_brep(mesh, CadOptions(max_faces=MOST_FACETS))
        return ExactSolid(step=facets.step, is_true=False, n_faces=len(facets.face_names), volume_m3=facets.volume_m3, note=note)
    return ExactSolid(step=step, is_true=True, n_faces=len(found.face_area), volume_m3=found.volume_m3)


def _problem(found: ReadBack, volume_m3: float, limit: float) -> str:
    if found.n_solids != 1:
        return f"Open Cascade reads {found.n_solids} solids instead of one"
    if found.n_free_edges:
        return f"{found.n_free_edges} edges belong to one face only"
    if not found.is_valid:
        return "Open Cascade's BRepCheck finds it invalid"
    if abs(found.volume_m3 - volume_m3) > limit * volume_m3:
        return f"the solid holds {found.volume_m3:.12g} m3 instead of {volume_m3:.12g} m3 (limit {limit:.2g} of it)"
    return ""
