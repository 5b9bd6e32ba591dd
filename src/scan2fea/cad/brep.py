"""Triangles to a CAD solid: exactly planar regions become plane faces, the rest stays facets, everything shares edges and vertices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scan2fea.cad.patchwork import Patchwork, patchwork
from scan2fea.cad.readback import ReadBack, read_back
from scan2fea.cad.step_text import step_text
from scan2fea.errors import CadError, require
from scan2fea.kernel.measures import volume as enclosed_volume
from scan2fea.kernel.planar_regions import PLANAR_TOLERANCE, PlanarRegions, planar_regions
from scan2fea.kernel.topology import face_components
from scan2fea.options import option
from scan2fea.types import Brep, TriangleMesh

OCC_RESOLUTION_M = 1e-10  # 1e-7 mm, Precision::Confusion of Open Cascade: nothing below is told apart
VOLUME_AGREES = 1e-6  # relative; contract of `cad`


@dataclass(frozen=True, kw_only=True)
class CadOptions:
    """How a surface becomes a B-Rep."""

    planar_tolerance: float = option(
        PLANAR_TOLERANCE,
        "triangles become one plane face when their vertices lie in one plane to this share of the size of the object",
        minimum=0.0,
        maximum=1e-3,
    )
    true_faces: bool = option(True, "planes, cylinders, cones and spheres become true faces where the object is bounded by them")
    patches: bool = option(True, "a free form becomes NURBS patches where these follow it; facets without them")
    time_limit_s: float = option(
        120.0, "processor time for the true faces of one object, and for its NURBS patches; else facets", unit="s", minimum=1.0
    )
    max_faces: int = option(24_000, "largest number of faces of the solid; CAD systems and checks become unusable beyond", minimum=4)


def to_brep(mesh: TriangleMesh, options: CadOptions = CadOptions()) -> Brep:
    """The solid that a closed, oriented, manifold mesh of one component bounds.

    Each planar region (kernel/planar_regions.py) becomes ONE plane face with an outer wire and its holes; all other triangles become facets. The STEP
    text is read back with Open Cascade and must be one valid solid, without free edges, whose volume equals the mesh's to 1e-6. Where plane faces do
    not pass that test, all triangles become facets; where these do not pass either, CadError says which test failed.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    require(len(faces) >= 4, CadError, f"the surface has {len(faces)} triangles; a solid needs at least 4")
    require(np.isfinite(vertices).all(), CadError, "the surface has vertices that are not finite numbers; repair it first")
    n_parts = face_components(faces)[0]
    require(n_parts == 1, CadError, f"the surface is {n_parts} separate surfaces; a solid has one: keep the largest, or split the object")
    volume = enclosed_volume(mesh)
    require(volume > 0, CadError, f"the surface encloses {volume:.6g} m3: it is inside out or flat; repair it first")
    first_problem = ""
    for patches, deviation in _candidates(mesh, options.planar_tolerance):
        n_faces = len(patches.faces)
        says = f"the solid would have {n_faces} faces, cad.max_faces allows {options.max_faces}: remesh the surface coarser or raise the limit"
        require(n_faces <= options.max_faces, CadError, f"no valid solid: {first_problem}" if first_problem else says)
        names = _names(patches)
        text = step_text(patches, names, uncertainty_m=max(OCC_RESOLUTION_M, 2 * deviation))
        found = read_back(text)
        problem = _problem(patches, found, volume)
        if not problem:
            return _brep(patches, text, names, found)
        first_problem = first_problem or problem
    raise CadError(f"no valid solid: {first_problem}; facets alone failed too: {problem}")


def _candidates(mesh: TriangleMesh, tolerance: float) -> Iterator[tuple[Patchwork, float]]:
    """The B-Rep with plane faces, then (when that one was refused) the one of facets alone; each with its largest vertex-to-plane distance."""
    regions = planar_regions(mesh, tolerance)
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    yield patchwork(mesh, regions, tolerance * size), float(regions.deviation_m.max(initial=0.0))
    if len(regions.ids):
        none = PlanarRegions(label=np.full(len(mesh.faces), -1, np.int64), ids=regions.ids[:0], normal=regions.normal[:0], point=regions.point[:0],
                             deviation_m=regions.deviation_m[:0], n_not_planar=0, n_cut_off=0)  # fmt: skip
        yield patchwork(mesh, none, 0.0), 0.0


def _names(patches: Patchwork) -> tuple[str, ...]:
    """FACE_01_PLANE, ..., FACE_09_FACET: numbered in the order of the file, as wide as the largest number."""
    width = max(2, len(str(len(patches.faces))))
    return tuple(f"FACE_{k + 1:0{width}d}_{kind.upper()}" for k, kind in enumerate(_kinds(patches)))


def _kinds(patches: Patchwork) -> tuple[str, ...]:
    return tuple("plane" if face.region >= 0 else "facet" for face in patches.faces)


def _problem(patches: Patchwork, found: ReadBack, volume_m3: float) -> str:
    """The first test that the solid fails, in words; empty where it passes all."""
    expected = np.array([face.area_m2 for face in patches.faces])
    if found.n_solids != 1:
        return f"Open Cascade reads {found.n_solids} solids instead of one"
    if found.n_free_edges:
        return f"{found.n_free_edges} edges belong to one face only"
    if not found.is_valid:
        return "Open Cascade's BRepCheck finds it invalid"
    if len(found.face_area) != len(expected):
        return f"Open Cascade reads {len(found.face_area)} faces instead of {len(expected)}"
    if abs(found.volume_m3 - volume_m3) > VOLUME_AGREES * volume_m3:
        return f"the solid holds {found.volume_m3:.9g} m3, the surface {volume_m3:.9g} m3 (limit {VOLUME_AGREES:g} of it)"
    extent = np.sqrt(expected.sum())
    if (np.abs(found.face_area - expected) > VOLUME_AGREES * np.maximum(expected, VOLUME_AGREES * extent**2)).any():
        return "the faces of the file are not in the order in which they were written"
    return ""


def _brep(patches: Patchwork, text: str, names: tuple[str, ...], found: ReadBack) -> Brep:
    return Brep(
        step=text, face_names=names, face_kinds=_kinds(patches), region_of_face=np.array([f.region for f in patches.faces], np.int64),
        facet_of_face=np.array([f.facet for f in patches.faces], np.int64), volume_m3=found.volume_m3, area_m2=found.area_m2, is_valid=found.is_valid,
        n_solids=found.n_solids, n_free_edges=found.n_free_edges,
    )  # fmt: skip
