"""Solids of NURBS patches: bicubic B-splines by least squares on grids of points, borders first, so that neighbours share them exactly.

Every patch has the same knots and the same places of its points: its fit is one product with a constant matrix (Piegl and Tiller, The NURBS Book,
1997, section 9.4). Neighbours meet without a gap (G0); at what angle is measured and told. Few large tiles are tried first; those whose patches leave
the surface or fold are parted, the others stay.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.cad.brep import OCC_RESOLUTION_M
from scan2fea.cad.live import is_valid, moved_by, parts
from scan2fea.cad.occ import bspline_surface
from scan2fea.cad.quads import SAMPLES, Quads, quads_on
from scan2fea.cad.readback import read_back, volume_of
from scan2fea.cad.step_occ import named, step_of_solid
from scan2fea.cad.tiles import parted, spread, tiles_at, web_of
from scan2fea.cad.trued import Trued
from scan2fea.errors import CadError
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals, vertex_normals
from scan2fea.kernel.measures import volume as enclosed_volume
from scan2fea.kernel.nurbs import basis, basis_slopes
from scan2fea.types import BoolArray, Brep, FloatArray, TriangleMesh, Value
from scan2fea.units import MILLIMETRES_PER_METRE

DEGREE, SPANS = 3, 3
KNOTS = np.concatenate([np.zeros(DEGREE), np.linspace(0, 1, SPANS + 1), np.ones(DEGREE)])  # the same backwards: borders run either way
TILES, ROUNDS = 16, 20  # of the first cut; how often tiles are parted
PIECES, RATE = 6, 0.7  # a tile falls into (distance / limit)^0.7 pieces: between the square of a curved surface's error and the root of a crease's
TRIANGLES_A_PATCH = 3  # as many patches as triangles say nothing new
LOST_TILES, SPIKES = 0.01, 3  # of all: so many more that have no more triangles and still do not hold are creases, or noise, sharper than any patch
SAMPLED = 17  # points along a patch that are measured
VOLUME_OFF = 0.005  # of the surface's: what verification takes
FOLDED = 0.2  # cosine between a patch and the surface under it: less is a fold
SEWING_MM = 1e-4  # borders are equal; a larger tolerance would hide that they are not
READS_BACK = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Patched(Value):
    """controls : (q, n, n, 3) control points.   off_m : (q,) largest distance of each patch to the surface, both ways.   p95_m : of all points.

    rms_m : (q,) of each patch from the surface.   folded : (q,) share of each that turns over.   across_deg : (e,) angle at the middle of each
    border between its patches.
    """

    controls: FloatArray
    off_m: FloatArray
    p95_m: float
    rms_m: FloatArray
    folded: FloatArray
    across_deg: FloatArray

    @property
    def is_folded(self) -> BoolArray:
        """(q,) patches that turn over somewhere."""
        return np.asarray(self.folded > 0)


def patched_solid(mesh: TriangleMesh, *, spacing_m: float, noise_m: float) -> Trued:
    """The solid of NURBS patches of a smooth closed surface, as few as lie close enough to it.

    spacing_m : of the measured points.   noise_m : left in the vertices of `mesh`. Nothing is raised where there is none: `reason` says why.
    """
    limit = tolerance(spacing_m, noise_m)
    web = web_of(mesh)
    seeds, reason = spread(web, TILES), ""
    for _ in range(ROUNDS):
        tiles = tiles_at(web, seeds)
        if tiles is None:
            return _none("the surface cannot be cut into disks")
        quads = quads_on(mesh, tiles)
        found = patches_of(quads, mesh)
        n = len(found.controls)
        if n * TRIANGLES_A_PATCH > len(mesh.faces):
            return _none(reason or f"{len(mesh.faces)} triangles are too few for {n} patches")
        worst = np.zeros(len(tiles.loops))
        np.maximum.at(worst, quads.tile, np.where(found.is_folded, np.maximum(found.off_m, 1.01 * limit), found.off_m))
        if worst.max() <= limit:
            made = _solid(found, mesh)
            if made.brep is not None:
                return made
            reason, worst = made.reason, np.full(len(worst), 1.01 * limit)
        else:
            reason = f"{n} NURBS patches lie up to {found.off_m.max() * 1e3:.3g} mm off the surface (limit {limit * 1e3:.3g} mm), "
            reason += f"{int(found.is_folded.sum())} of them fold"
        spent = (worst > limit) & (np.bincount(tiles.label) < TRIANGLES_A_PATCH * np.bincount(quads.tile))
        if spent.sum() > max(SPIKES, LOST_TILES * len(worst)):
            return _none(f"{reason}; at {int(spent.sum())} places the surface turns more sharply than patches of {TRIANGLES_A_PATCH} triangles can")
        seeds = parted(web, tiles, np.where(worst > limit, np.clip(np.ceil((worst / limit) ** RATE), 2, PIECES), 1).astype(np.int64))
    return _none(reason)


def tolerance(spacing_m: float, noise_m: float) -> float:
    """How far patches may lie from the surface: three standard deviations of its noise and a quarter of the spacing, between whose points it is a
    guess.
    """
    return 3.0 * noise_m + 0.25 * spacing_m


def patches_of(quads: Quads, mesh: TriangleMesh) -> Patched:
    """Least squares on every border, then inside."""
    at = np.linspace(0, 1, SAMPLES)
    value = basis(KNOTS, DEGREE, at)
    inside = np.linalg.pinv(value[1:-1, 1:-1])
    ends = value[1:-1][:, [0, -1]]
    border = np.empty((len(quads.curves), value.shape[1], 3))
    border[:, [0, -1]] = quads.curves[:, [0, -1]]
    border[:, 1:-1] = inside @ (quads.curves[:, 1:-1] - ends @ border[:, [0, -1]])
    low, right, top, left = (border[quads.sides[:, k]] for k in range(4))
    control = np.zeros((len(quads.grids), value.shape[1], value.shape[1], 3))
    control[:, :, 0], control[:, -1], control[:, :, -1], control[:, 0] = low, right, top, left
    rest = quads.grids - np.einsum("ui,vj,qijc->quvc", value, value, control, optimize=True)
    control[:, 1:-1, 1:-1] = np.einsum("iu,jv,quvc->qijc", inside, inside, rest[:, 1:-1, 1:-1], optimize=True)
    return _measured(control, quads, mesh)


def _measured(control: FloatArray, quads: Quads, mesh: TriangleMesh) -> Patched:
    at = np.linspace(0, 1, SAMPLED)
    value, slope = basis(KNOTS, DEGREE, at), basis_slopes(KNOTS, DEGREE, at)
    points = np.einsum("ui,vj,qijc->quvc", value, value, control, optimize=True)
    du, dv = np.einsum("ui,vj,qijc->quvc", slope, value, control, optimize=True), np.einsum("ui,vj,qijc->quvc", value, slope, control, optimize=True)
    normal = np.cross(du, dv)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300)
    under = PointToMesh(mesh).nearest(points.reshape(-1, 3))
    up = np.einsum("nk,nkx->nx", under.weights, vertex_normals(mesh)[mesh.faces[under.face]]).reshape(normal.shape)
    flat = face_normals(mesh)[under.face].reshape(normal.shape)  # at the tip of a spike no triangle faces as the mean of its corners' normals does
    facing = np.maximum((normal * up).sum(-1) / np.maximum(np.linalg.norm(up, axis=-1), 1e-300), (normal * flat).sum(-1))
    drawn = _triangles(points)
    back = PointToMesh(drawn).nearest(mesh.vertices)
    off = under.distance.reshape(len(points), -1).max(1)
    np.maximum.at(off, back.face // (len(drawn.faces) // len(points)), back.distance)
    middle, end = SAMPLED // 2, SAMPLED - 1
    on_side = np.stack([normal[:, middle, 0], normal[:, end, middle], normal[:, middle, end], normal[:, 0, middle]], axis=1).reshape(-1, 3)
    pair = np.argsort(quads.sides.ravel(), kind="stable").reshape(-1, 2)  # every border has two patches
    cosine = np.einsum("ij,ij->i", on_side[pair[:, 0]], on_side[pair[:, 1]])
    return Patched(
        controls=control, off_m=off, p95_m=float(np.percentile(np.concatenate([under.distance, back.distance]), 95)),
        rms_m=np.sqrt((under.distance.reshape(len(points), -1) ** 2).mean(1)),
        folded=np.asarray((facing.reshape(len(points), -1) < FOLDED).mean(1)), across_deg=np.degrees(np.arccos(np.clip(cosine, -1, 1))),
    )  # fmt: skip


def _triangles(points: FloatArray) -> TriangleMesh:
    """The grids (q, s, s, 3) as triangles, patch by patch."""
    q, s = points.shape[:2]
    i, j = (a.ravel() for a in np.meshgrid(np.arange(s - 1), np.arange(s - 1), indexing="ij"))
    a = i * s + j
    one = np.concatenate([np.stack([a, a + s, a + s + 1], 1), np.stack([a, a + s + 1, a + 1], 1)])
    return TriangleMesh(vertices=points.reshape(-1, 3), faces=(one + s * s * np.arange(q)[:, None, None]).reshape(-1, 3).astype(np.int64))


def _solid(found: Patched, mesh: TriangleMesh) -> Trued:
    """Sewn, proved, written and read back."""
    middle = (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2
    solid = sewn((found.controls - middle) * MILLIMETRES_PER_METRE)
    if solid is None or not is_valid(solid):
        return _none("the NURBS patches close no valid solid")
    placed = moved_by(solid, middle * MILLIMETRES_PER_METRE)
    try:
        text, numbers = step_of_solid(placed, OCC_RESOLUTION_M)
        back = read_back(text)
    except CadError as error:
        return _none(str(error))
    wanted, volume = enclosed_volume(mesh), volume_of(placed) / MILLIMETRES_PER_METRE**3
    if abs(volume / wanted - 1) > VOLUME_OFF:
        return _none(f"the NURBS patches hold {volume / wanted - 1:+.2%} of the volume of the surface more")
    sound = back.is_valid and back.n_solids == 1 and back.n_free_edges == 0 and len(back.face_area) == len(found.controls)
    if not (sound and abs(back.volume_m3 / volume - 1) < READS_BACK):
        return _none("the STEP file of NURBS patches does not read back as the solid that was written")
    n = len(back.face_area)
    width = max(2, len(str(n)))
    names = tuple(f"FACE_{k + 1:0{width}d}_NURBS" for k in range(n))
    brep = Brep(
        step=named(text, numbers, names), face_names=names, face_kinds=("nurbs",) * n, region_of_face=np.arange(n),
        facet_of_face=np.full(n, -1, np.int64), volume_m3=back.volume_m3, area_m2=back.area_m2, is_valid=back.is_valid, n_solids=back.n_solids,
        n_free_edges=back.n_free_edges, face_centre=back.face_centre, face_area=back.face_area,
    )  # fmt: skip
    angles = found.across_deg
    how = {
        "faces": {"nurbs": n}, "off_max_m": float(found.off_m.max()), "off_p95_m": found.p95_m,
        "across_median_deg": float(np.median(angles)), "across_p95_deg": float(np.percentile(angles, 95)), "across_max_deg": float(angles.max()),
    }  # fmt: skip
    return Trued(brep=brep, mesh=None, reason="", how=how)


def _none(reason: str) -> Trued:
    return Trued(brep=None, mesh=None, reason=reason, how={})


def sewn(controls: FloatArray) -> Any | None:
    """One solid of the patches (q, n, n, 3), millimetres; None where they do not close it."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeSolid, BRepBuilderAPI_Sewing
    from OCP.BRepLib import BRepLib
    from OCP.TopAbs import TopAbs_SHELL
    from OCP.TopoDS import TopoDS

    sewing = BRepBuilderAPI_Sewing(SEWING_MM)
    for control in controls:
        sewing.Add(BRepBuilderAPI_MakeFace(bspline_surface(control, SPANS, DEGREE), SEWING_MM).Face())
    sewing.Perform()
    shells = parts(sewing.SewedShape(), TopAbs_SHELL)
    if len(shells) != 1 or sewing.NbFreeEdges():
        return None
    solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell(shells[0])).Solid()
    BRepLib.OrientClosedSolid_s(solid)
    return solid
