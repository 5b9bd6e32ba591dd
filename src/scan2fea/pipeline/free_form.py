"""The CAD solid of a free form: NURBS patches on tiles of its surface. Where these do not follow it its faces are facets."""

from __future__ import annotations

from scan2fea.cad import CadOptions, Trued
from scan2fea.kernel.measures import area, face_areas
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.faces_worker import patched_solid_in_child
from scan2fea.pipeline.part import Made
from scan2fea.pipeline.record import Record, Tracked
from scan2fea.types import Brep, TriangleMesh

PATCHES = "NURBS patches"
FLAT_SHARE = 0.05  # of the area in planes: with more the planes are worth more to a user than smoothness, and facets keep them


def build_patches(made: Made, surface: Tracked[TriangleMesh], config: Config, record: Record) -> Brep | None:
    """The solid of NURBS patches, told in `made.how`; None where there is none, or where its facets are wanted."""
    mesh = surface.value
    if not config.cad.patches or config.tetmeshing.route == "brep" or _flat_share(mesh) > FLAT_SHARE:
        return None
    noise = made.sigma_m if made.residual_m is None else made.residual_m
    scale = {"spacing_m": made.spacing_m, "noise_m": noise}
    found = record("patches", _patched, surface, options=config.cad, extra=scale, n_in=len(mesh.faces), count=_n_faces).value
    if found.brep is None:
        made.how["cad_reason"] = f"{made.how.get('cad_reason', '')}; {found.reason}".removeprefix("; ")
        return None
    made.how["cad_route"], made.how["cad_patches"] = PATCHES, dict(found.how)
    return found.brep


def _flat_share(mesh: TriangleMesh) -> float:
    if mesh.face_region is None:
        return 0.0
    return float(face_areas(mesh)[mesh.face_region >= 0].sum() / area(mesh))


def _patched(mesh: TriangleMesh, options: CadOptions, *, spacing_m: float, noise_m: float) -> Trued:
    return patched_solid_in_child(mesh, options, spacing_m=spacing_m, noise_m=noise_m)


def _n_faces(found: Trued) -> int:
    return 0 if found.brep is None else len(found.brep.face_names)
