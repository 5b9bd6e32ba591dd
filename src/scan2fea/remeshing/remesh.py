"""From the surface of a reconstruction to one that a mesher can use: planes made flat, creases straight, triangles of one size."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import MeshingError, require
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import median_edge, volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.primitives import Plane, meeting_point
from scan2fea.kernel.quality import triangle_quality
from scan2fea.kernel.topology import surface_topology
from scan2fea.options import option
from scan2fea.remeshing.creases import Flattened, flattened
from scan2fea.remeshing.exact import drawn, edge_of_drawn
from scan2fea.remeshing.find import find_planes
from scan2fea.remeshing.folds import flattest_deg, meshable
from scan2fea.remeshing.isotropic import RETRIES, Guide, closed, crease_guide, free_form, isotropic, opened, sharp_edges
from scan2fea.remeshing.planes import Neighbours, scale_of
from scan2fea.remeshing.regions import centred
from scan2fea.remeshing.relax import near_places, relaxed
from scan2fea.remeshing.relaxing import KINDS, relaxed_by
from scan2fea.remeshing.sizing import CHORD, edge_goal
from scan2fea.remeshing.thin import THIN_DEG, without_thin
from scan2fea.types import TriangleMesh, Value

EDGE_SPACINGS = 2.0
CREASE_DEG = 40.0
DRAWN_NOISE = 1e-3  # of the spacing: with less noise the surface may have been drawn
EXACT_SCAN = 0.01  # of the spacing: less noise than this leaves creases sharp
DRIFT = 0.3  # spacings that one change of the triangles may move the surface
RESTARTS = 3
VOLUME_DRIFT, FINER = 0.01, 0.6
LOST_SIGMAS, LOST_SPACINGS, LOST = 1.0, 0.5, 0.005  # half of the stray points that the final geometry may have, whose noise are two more sigmas
FACES, MORE_FACES = 10_000, 17_000  # a third more come out; CAD systems bear 24,000 facets
POOR_DEG = 15.0
MENDINGS = 2  # of folds and thin triangles in turn


@dataclass(frozen=True, kw_only=True)
class RemeshOptions:
    """How the surface is made fit for finite elements."""

    edge_m: float | None = option(None, "edge length of the triangles; from the data: twice the point spacing", unit="m", minimum=0)
    max_faces: int | None = option(
        None,
        "edges are made longer where the surface would take more faces; from the data: 10,000, or 17,000 where its shape would be lost",
        unit="faces",
        minimum=100,
    )
    planes: bool = option(True, "find planes, make them exactly flat and their creases straight")
    relax: str = option("none", "Lloyd or ODT as the last step, sliding on the surface; free: as in the thesis, which wears it off", choices=KINDS)
    relaxations: int = option(200, "iterations of Lloyd or ODT", minimum=0)
    rounds: int = option(6, "rounds of split, collapse, flip and smooth; 0 leaves the triangles as they are", unit="rounds", minimum=0, maximum=50)


@dataclass(frozen=True, eq=False, kw_only=True)
class Remeshed(Value):
    """mesh : closed, manifold, free of crossings; face_region numbers the planes, -1 is free form.   planes : one per region.

    n_taken_back : rounds undone because faces crossed.   relaxed : what Lloyd or ODT did, where asked for.
    volume_drift : relative change of volume.   moved_p95_m, moved_max_m : of the old vertices from the new surface.
    """

    mesh: TriangleMesh
    planes: tuple[Plane, ...]
    n_taken_back: int
    edge_m: float
    volume_drift: float
    moved_p95_m: float
    moved_max_m: float
    relaxed: str = ""


@dataclass(frozen=True, kw_only=True)
class _Aim:
    """What the triangles should be. edge_m, finest_m : where the surface is flat, and where it bends or is thin.   drift_m : how far they may stray.

    crease_deg : edges that turn by more are kept.   is_drawn : as in `edge_goal`.
    """

    edge_m: float
    finest_m: float
    drift_m: float
    crease_deg: float
    is_drawn: bool

    def finer(self) -> _Aim:
        return replace(self, edge_m=FINER * self.edge_m, finest_m=FINER * self.finest_m, drift_m=FINER * self.drift_m)


def remesh(
    mesh: TriangleMesh, options: RemeshOptions = RemeshOptions(), *, spacing_m: float, sigma_m: float, is_unbiased: bool = False
) -> Remeshed:
    """A surface of well shaped triangles that follows `mesh` within its noise.

    spacing_m, sigma_m : of the points the surface was made from.   is_unbiased : it was fitted to ranges, so it bulges beside a crease by as much as
    it rounds it off; else what it rounds off is missing, and comes back where planes are made to meet.
    Raises MeshingError if `mesh` is not closed, manifold and free of crossings.
    """
    require(surface_topology(mesh).is_clean, MeshingError, "remeshing needs a closed manifold surface: repair it first")
    require(not len(self_intersections(mesh)), MeshingError, "remeshing needs a surface whose faces do not cross: repair it first")
    is_flat = mesh.face_region is not None and bool((mesh.face_region >= 0).all())  # made of planes by the reconstruction
    found = drawn(mesh) if options.planes and (is_flat or sigma_m < DRAWN_NOISE * spacing_m) else None
    is_drawn = found is not None
    if found is not None:
        edge = options.edge_m or edge_of_drawn(mesh, spacing_m)
        finest, drift = edge / 4, CHORD * edge
    else:
        edge = options.edge_m or EDGE_SPACINGS * spacing_m
        finest, drift = min(spacing_m, edge), max(sigma_m, DRIFT * spacing_m, 4 * CHORD * (options.edge_m or 0.0))
        found = _flat(mesh, options, spacing_m, sigma_m, edge, is_unbiased)
    crease_deg = CREASE_DEG if sigma_m < EXACT_SCAN * spacing_m else 180.0  # in noise every edge may be sharp
    aim = _Aim(edge_m=edge, finest_m=finest, drift_m=drift, crease_deg=crease_deg, is_drawn=is_drawn)
    result, taken_back, relaxed_how = _fit(found, aim, options)
    far = LOST_SIGMAS * sigma_m + LOST_SPACINGS * spacing_m
    if options.rounds and not options.edge_m and _worn(result, found.mesh, far) > 1:
        # thin walls were cut short, or curves that the budget of faces cannot follow: finer triangles that may stray less
        more_faces = replace(options, max_faces=options.max_faces or MORE_FACES)
        finer, more, how = _fit(found, aim.finer(), more_faces)
        if _worn(finer, found.mesh, far) < _worn(result, found.mesh, far):
            result, taken_back, relaxed_how = finer, taken_back + more, how
    planes = () if options.relax.endswith("free") else found.planes
    if planes and len(self_intersections(result)):
        # planes that cross each other in the noise: free form follows the surface without them
        return remesh(mesh, replace(options, planes=False), spacing_m=spacing_m, sigma_m=sigma_m, is_unbiased=is_unbiased)
    moved = PointToMesh(result).nearest(mesh.vertices).distance
    return Remeshed(
        mesh=result,
        planes=planes,
        n_taken_back=taken_back,
        edge_m=median_edge(result),
        volume_drift=volume(result) / volume(mesh) - 1,
        moved_p95_m=float(np.percentile(moved, 95)),
        moved_max_m=float(moved.max()),
        relaxed=relaxed_how,
    )


def _worn(mesh: TriangleMesh, surface: TriangleMesh, far_m: float) -> float:
    """How much of the surface the new mesh loses, of what it may: volume, and vertices left farther than `far_m` off."""
    lost = float(np.mean(PointToMesh(mesh).nearest(surface.vertices).distance > far_m))
    return max(abs(volume(mesh) / volume(surface) - 1) / VOLUME_DRIFT, lost / LOST)


def _fit(found: Flattened, aim: _Aim, options: RemeshOptions) -> tuple[TriangleMesh, int, str]:
    """Even triangles that a mesher can use, how many steps were taken back, and what Lloyd or ODT did."""
    even, taken_back = _even(found.mesh, found.planes, aim, options)
    even, relaxed_how = relaxed_by(options.relax, even, options.relaxations, aim.drift_m)
    if options.relax.endswith("free"):
        return meshable(even), taken_back, relaxed_how
    flat = on_planes(even, found.planes)
    return _mended(flat, max(aim.drift_m, CHORD * median_edge(flat))) if options.rounds else meshable(flat), taken_back, relaxed_how


def _mended(mesh: TriangleMesh, give_m: float) -> TriangleMesh:
    """Without folds and without thin triangles, as far as they go: mending the one may make some of the other. The least flat of all stays."""
    tried = [meshable(mesh)]
    for _ in range(MENDINGS):
        if flattest_deg(tried[-1]) >= THIN_DEG:
            break
        tried.append(without_thin(tried[-1], give_m))
        tried.append(meshable(tried[-1]))
    return max(tried, key=flattest_deg)


def _even(flat: TriangleMesh, planes: tuple[Plane, ...], aim: _Aim, options: RemeshOptions) -> tuple[TriangleMesh, int]:
    """`flat` with triangles of even size, and how many steps were taken back. Where free form keeps crossing itself, a spike or a pit is in the way:
    it is relaxed in the surface that is followed, and all is done again; the result with the fewest poor faces stays.
    """
    best, best_poor, taken_back = flat, np.inf, 0
    surface = flat
    for restart in range(RESTARTS):
        is_sharp = sharp_edges(surface, aim.crease_deg)
        goal, largest = edge_goal(surface, is_sharp, aim.edge_m, aim.finest_m, options.max_faces or FACES, is_drawn=aim.is_drawn)
        give = max(aim.drift_m, CHORD * float(np.median(goal)))
        guide = Guide(surface=free_form(surface), creases=crease_guide(surface, is_sharp), planes=dict(enumerate(planes)), drift_m=give)
        work, trouble = isotropic(opened(surface, is_sharp, goal, largest), guide, options.rounds)
        mesh = closed(work)
        taken_back += len(trouble)
        poor = int((triangle_quality(mesh.vertices, mesh.faces)["min_angle_deg"] < POOR_DEG).sum())
        is_last = poor > 0.5 * best_poor  # going on helps little
        if poor < best_poor:
            best, best_poor = mesh, poor
        if len(trouble) < RETRIES or not poor or is_last:
            break
        near = np.zeros(len(surface.vertices), bool)
        for crossed in trouble:
            near |= near_places(surface, crossed, (1 + restart) * float(np.median(goal)))
        smooth = relaxed(surface, near)
        if np.array_equal(smooth.vertices, surface.vertices) or len(self_intersections(smooth)):
            break  # planes hold what is in the way: all would come out the same again
        surface = smooth
    return best, taken_back


def _flat(mesh: TriangleMesh, options: RemeshOptions, spacing_m: float, sigma_m: float, edge_m: float, is_unbiased: bool) -> Flattened:
    """`mesh` with its planes found and made flat, or as it is."""
    if not options.planes:
        region = np.full(len(mesh.faces), -1, np.int64)
        return Flattened(mesh=TriangleMesh(vertices=mesh.vertices, faces=mesh.faces, face_region=region), planes=(), n_undone=0)
    neighbours = Neighbours(mesh)
    scale = scale_of(mesh, neighbours, spacing_m, sigma_m)
    labelled = find_planes(mesh, neighbours, scale)
    flat = [flattened(mesh, neighbours, labelled, scale, edge_m)]
    if is_unbiased:
        flat.append(flattened(mesh, neighbours, centred(mesh, neighbours, labelled), scale, edge_m))
    return min(flat, key=lambda found: abs(volume(found.mesh) / volume(mesh) - 1))


def on_planes(mesh: TriangleMesh, planes: tuple[Plane, ...]) -> TriangleMesh:
    """Every vertex of a region put onto its plane to the last digit; those of several regions onto their line or point."""
    if mesh.face_region is None or not planes:
        return mesh
    pairs = np.unique(np.stack([mesh.faces.ravel(), np.repeat(mesh.face_region, 3)], axis=1), axis=0)
    pairs = pairs[pairs[:, 1] >= 0]
    start = np.searchsorted(pairs[:, 0], np.arange(len(mesh.vertices) + 1))
    n_planes = np.diff(start)
    points = mesh.vertices.copy()
    normal, offset = np.array([plane.normal for plane in planes]), np.array([plane.offset for plane in planes])
    one = np.flatnonzero(n_planes == 1)
    name = pairs[start[one], 1]
    for _ in range(2):
        points[one] -= (np.einsum("ij,ij->i", points[one], normal[name]) - offset[name])[:, None] * normal[name]
    for v in np.flatnonzero(n_planes > 1):
        points[v] = meeting_point([planes[k] for k in pairs[start[v] : start[v + 1], 1]], points[v])
    return TriangleMesh(vertices=points, faces=mesh.faces, face_region=mesh.face_region)
