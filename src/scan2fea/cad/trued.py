"""What a solid of true faces is made of and comes to: surfaces fitted to the measured points, the file proved by reading it back, what is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scan2fea.cad.boxed import with_exact_box
from scan2fea.cad.brep import OCC_RESOLUTION_M
from scan2fea.cad.compared import FIT_POINTS, Compared, Scale, faces_of, triangles_of
from scan2fea.cad.fillets import Fillet
from scan2fea.cad.live import moved_by, surface_of
from scan2fea.cad.naming import named_faces
from scan2fea.cad.patches import Patches
from scan2fea.cad.readback import ReadBack, read_back, volume_of
from scan2fea.cad.resting import LEAST_POINTS, Resting, nearest_points
from scan2fea.cad.roundings import inner_faces
from scan2fea.cad.sheets import as_facet
from scan2fea.cad.step_occ import named, step_of_solid
from scan2fea.cad.surfaces import Fit, Snap, simplest, snapped
from scan2fea.errors import CadError
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.surfaces import CONE, PLANE, SPHERE, TORUS, Surface, covariance
from scan2fea.types import Brep, FloatArray, IntArray, TriangleMesh, Value
from scan2fea.units import MILLIMETRES_PER_METRE

NURBS, PATCH = "nurbs", "patch"
FITTED = 30  # points: with fewer inside its region a surface is fitted to those at its border too
# relative difference of volume between the shape and its file, a hundredth of what is asked of the volume; where a cylinder all but touches a plane
# the tip between them is trimmed anew: 3e-6 of `featuretype` at 0.1 mm
READS_BACK = 1e-5


@dataclass(frozen=True, eq=False, kw_only=True)
class Trued(Value):
    """brep, mesh : the solid of true faces and its triangles, whose face_region is the face of the B-Rep; None where the surface is free form.

    reason : why.   snaps : relations tested.   how : figures for the report.   surfaces : metres, of each face of the B-Rep.
    """

    brep: Brep | None
    mesh: TriangleMesh | None
    reason: str
    snaps: tuple[Snap, ...] = ()
    how: Mapping[str, Any]
    surfaces: tuple[Surface, ...] = ()


def no_solid(reason: str) -> Trued:
    return Trued(brep=None, mesh=None, reason=reason, how={})


def fits_of(
    mesh: TriangleMesh, points: FloatArray, patches: Patches, scale: Scale, stands: Sequence[Resting] = (), *, radii: bool = True,
    told: Mapping[int, FloatArray] | None = None,
) -> tuple[list[Fit], tuple[Snap, ...], bool]:  # fmt: skip
    """The surfaces fitted to the measured points of their regions, away from borders, with relations applied. One with too few points stays as the
    vertices of its patch have it; the last value tells whether there was none.

    radii : relations between radii, and centres of balls, too. What touches tells them better: of a quarter of a turn on its own a radius is known
        to a tenth, and the heads of two walls cannot touch both where all share a centre.
    told : by number, the points of surfaces that are known already.
    """
    used = points[sampled_rows(len(points), FIT_POINTS, 0)]
    inner = inner_faces(mesh, patches.label)
    at = PointToMesh(mesh).nearest(used)
    near = at.distance <= 4 * scale.noise_m + 4 * scale.tolerance_m + scale.spacing_m
    label = np.where(near, patches.label[at.face], -1)
    deep = near & inner[at.face]
    fits: list[Fit] = []
    is_whole = True
    flat = [s.axis for s in patches.surfaces if s.kind == PLANE]
    for k, surface in enumerate(patches.surfaces):
        if told is not None and k in told:
            sigma = max(surface.rms_m, scale.tolerance_m / 3)
            fits.append(Fit(surface=surface, points=told[k], sigma_m=sigma, covariance=covariance(surface, told[k], sigma)))
            continue
        rows = np.flatnonzero((label == k) & deep)
        if len(rows) < FITTED:
            rows = np.flatnonzero(label == k)
        own = used[rows] if len(rows) >= LEAST_POINTS else nearest_points(stands, surface, scale.reach_m)
        fit = simplest(surface, own, scale.size_m, flat) if len(own) >= LEAST_POINTS else None
        is_whole = is_whole and fit is not None
        fits.append(fit or _of_vertices(surface, mesh.vertices[np.unique(mesh.faces[patches.label == k])], scale))
    out, snaps = snapped(fits, radii=radii)
    return out, tuple(snaps), is_whole


def _of_vertices(surface: Surface, vertices: FloatArray, scale: Scale) -> Fit:
    """The surface of a patch as it was found."""
    sigma = max(scale.tolerance_m / 3, surface.rms_m)
    return Fit(surface=surface, points=vertices, sigma_m=sigma, covariance=covariance(surface, vertices, sigma))


def in_mm(surface: Surface, middle: FloatArray) -> Surface:
    second = surface.second if surface.kind == CONE else surface.second * MILLIMETRES_PER_METRE
    return replace(
        surface, point=(surface.point - middle) * MILLIMETRES_PER_METRE, radius=surface.radius * MILLIMETRES_PER_METRE, second=second
    )  # fmt: skip


def covariance_in_mm(fit: Fit) -> FloatArray:
    """The covariance of the steps of `kernel.surfaces.moved` where lengths are in millimetres."""
    lengths = {PLANE: (0,), SPHERE: (0, 1, 2, 3), TORUS: (0, 1, 2, 5, 6)}.get(fit.surface.kind, (0, 1, 4))
    unit = np.ones(len(fit.covariance))
    unit[list(lengths)] = MILLIMETRES_PER_METRE
    return np.asarray(fit.covariance * np.outer(unit, unit))


def trued(
    solid: Any, middle: FloatArray, scale: Scale, snaps: tuple[Snap, ...], proved: Compared, fillets: Sequence[Fillet] = (),
    drawn: Sequence[Surface] | None = None, within_m: float = 0.0, n_patches: int = 0,
) -> Trued:  # fmt: skip
    """The file, proved by reading it back, and the triangles of its faces in their order.

    drawn : the surfaces, in millimetres, of a solid that has facets too: what lies on none of these is one.   within_m : see `triangles_of`.
    n_patches : NURBS patches of free form among the faces; the other faces are none.
    """
    placed = moved_by(solid, middle * MILLIMETRES_PER_METRE)
    try:
        text, numbers = step_of_solid(placed, OCC_RESOLUTION_M)
        found = read_back(text)
    except CadError as error:
        return no_solid(str(error))
    volume = volume_of(placed) / MILLIMETRES_PER_METRE**3
    if not (found.is_valid and found.n_solids == 1 and found.n_free_edges == 0 and abs(found.volume_m3 / volume - 1) < READS_BACK):
        return no_solid("the STEP file does not read back as the solid that was written")
    mesh, face = triangles_of(solid, middle, scale.tolerance_m, within_m)
    order = order_in_file(mesh, face, found)
    if order is None:
        return no_solid("the faces of the STEP file are not those that were written")
    mesh = replace(mesh, face_region=order[face])
    made = [in_metres(s if drawn is None else as_facet(s, drawn), middle) for s in map(surface_of, faces_of(solid))]
    surfaces = [replace(made[k], kind=PATCH) if n_patches and made[k].kind == NURBS else made[k] for k in np.argsort(order)]
    kinds, names = tuple(s.kind for s in surfaces), named_faces(mesh, surfaces)
    brep = Brep(
        step=named(text, numbers, names), face_names=names, face_kinds=kinds, region_of_face=np.arange(len(names)),
        facet_of_face=np.full(len(names), -1, np.int64), volume_m3=found.volume_m3, area_m2=found.area_m2, is_valid=found.is_valid,
        n_solids=found.n_solids, n_free_edges=found.n_free_edges, face_centre=found.face_centre, face_area=found.face_area,
    )  # fmt: skip
    boxed = with_exact_box(brep, placed, mesh, OCC_RESOLUTION_M)
    return Trued(brep=boxed, mesh=mesh, reason="", snaps=snaps, how=_told(snaps, brep, proved, fillets), surfaces=tuple(surfaces))


def in_metres(surface: Surface, middle: FloatArray) -> Surface:
    k = 1 / MILLIMETRES_PER_METRE
    second = surface.second if surface.kind == CONE else surface.second * k
    return replace(surface, point=surface.point * k + middle, radius=surface.radius * k, second=second)


def order_in_file(mesh: TriangleMesh, face: IntArray, found: ReadBack) -> IntArray | None:
    """For each face of the shape its place in the file, by centre and area; None where they do not pair off."""
    n = int(face.max()) + 1
    if len(found.face_area) != n:
        return None
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    total = np.bincount(face, weights=area, minlength=n)
    middle = np.stack([np.bincount(face, weights=area * corners[:, :, k].mean(1), minlength=n) for k in range(3)], axis=1).astype(float)
    middle /= np.maximum(total, 1e-300)[:, None]
    gap = np.linalg.norm(middle[:, None] - found.face_centre[None], axis=2) + np.sqrt(np.abs(total[:, None] - found.face_area[None]))
    order = gap.argmin(1)
    return order if len(np.unique(order)) == n else None


def _told(snaps: Sequence[Snap], brep: Brep, proved: Compared, fillets: Sequence[Fillet]) -> dict[str, Any]:
    kinds = {kind: brep.face_kinds.count(kind) for kind in sorted(set(brep.face_kinds))}
    radii = {"fillets": [{"radius_m": f.radius_m, "std_m": f.std_m} for f in fillets]} if fillets else {}
    solid, surface = proved.holes
    holes = {"holes": {"solid": solid, "surface": surface}} if solid != surface else {}
    return radii | holes | {"faces": kinds, "snaps": sum(s.applied for s in snaps), "refused": sum(not s.applied for s in snaps)}
