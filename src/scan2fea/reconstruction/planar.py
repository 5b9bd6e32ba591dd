"""Solids of flat and round faces: their planes and cylinders found, space cut by them into cells, and each inside or outside by a minimum cut.

Which cells are inside is told by a first closed surface (by sight lines, or by what can be reached from outside); where the faces lie is told by the
planes alone. Creases and corners are where planes meet: exact without noise, and with noise as good as the average over a whole face.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.arrangement import Arrangement, Cells
from scan2fea.kernel.distances import PointToMesh, signed_distance
from scan2fea.kernel.measures import volume
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.planar_regions import planar_regions
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction.blurred_faces import placed
from scan2fea.reconstruction.bores import Bore
from scan2fea.reconstruction.flat_gaps import over_walls
from scan2fea.reconstruction.flat_noise import LESS, flat_noise_m
from scan2fea.reconstruction.flat_solid import flat_solid
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.gates_planar import BESIDE_FLATS, DIFFER, gates_planar
from scan2fea.reconstruction.gates_round import one_region, rolled
from scan2fea.reconstruction.gates_surface import LEFT_OUT
from scan2fea.reconstruction.lost_bores import closed_bores, told_by
from scan2fea.reconstruction.parting import parting
from scan2fea.reconstruction.plane_growing import Planes
from scan2fea.reconstruction.regular import EXACT
from scan2fea.reconstruction.round_cuts import Shapes, cut_round, hung_together, shapes
from scan2fea.reconstruction.round_gaps import over_rounds
from scan2fea.reconstruction.round_growing import Rounds
from scan2fea.reconstruction.shapes_found import (
    Faces,
    flat_faces,
    joined_faces,
    moved_planes,
    outlined_faces,
    outlined_round_faces,
    round_faces,
    rounds_of,
)
from scan2fea.reconstruction.sharpened import served_sharp
from scan2fea.reconstruction.sight import Sight
from scan2fea.reconstruction.slots import slot_ends
from scan2fea.reconstruction.two_answers import against_free
from scan2fea.reconstruction.visibility import Reconstruction, VisibilityOptions, visibility
from scan2fea.types import BoolArray, FloatArray, IntArray, Scan, TriangleMesh, Value

CUT_ALL = 20  # planes, or cylinders: so few may cut every cell
RINGS = (0.15, 0.4, 0.7, 1.0)  # of that reach
SUPPORT = 600  # points of a plane that say which cells it cuts
REACH = 2.5  # spacings that a plane reaches beyond its points, besides the noise
MARGIN = 0.05  # of the size: the box round everything
PROBES = 24  # places in a cell at which the first surface is asked
PROBES_KNOWN = 48  # the same where points and sight lines are: of many a place they tell nothing
BARE_PRICE = 0.5  # spacings: what a square metre of boundary without points costs against a cubic metre on the wrong side
VOTE = 0.5  # cubic spacings that a point on a cylinder speaks for on either side
FEW = 0.1  # of a cell: with less of it seen only that counts
PLACED = 2  # times that the planes are placed again by the faces they bound
# of these each may come of a wall that the first surface lacks part of: its points lie on no face of what is left
MISLABELLED = frozenset({DIFFER, BESIDE_FLATS, "stray points", LEFT_OUT})
FULL = 0.5  # points per square spacing that back a facet fully
BACKED = 0.25  # of them, where the facet says what lies behind it


@dataclass(frozen=True, eq=False, kw_only=True)
class FlatForm(Value):
    """mesh : closed, manifold; face_region is the row of `shapes` (doubled, plus 1 for its other side) of each face.   shapes : all that were tried.

    seen_through_m3 : volume of the solid that sight lines pass through, where they labelled the cells.
    """

    mesh: TriangleMesh
    shapes: Shapes
    n_cells: int
    seen_through_m3: float = 0.0


def planar(scan: Scan, options: VisibilityOptions = VisibilityOptions()) -> Reconstruction:
    """The solid of flat and round faces under the points. Raises ReconstructionError where they do not close, or nothing is found at all."""
    first = visibility(scan, options)
    told = first.told or told_by(scan.cloud.points, first.normals, first.spacing_m, first.sigma_m)
    first = _quieter(scan.cloud.points, first, told.grown)
    try:
        return flattened(scan, first, options.seed)
    except ReconstructionError:
        faces = round_faces(scan.cloud.points, first, rounds_of(scan.cloud.points, first))
        if faces is None:
            raise
        return flattened(scan, first, options.seed, faces=faces)


def flattened(scan: Scan, first: Reconstruction, seed: int = 0, by_lines: bool = False, faces: Faces | None = None) -> Reconstruction:
    """The solid of flat faces that lies nearest to a first closed surface, or (by_lines) to what its points and their sight lines tell.

    faces : cylinders among them; None: planes alone are looked for. Raises ReconstructionError where there is none.
    """
    cloud = scan.cloud
    faces = flat_faces(cloud.points, first) if faces is None else faces
    sight = Sight.of(scan, first, seed) if by_lines else None
    try:
        form = flat_form(cloud.points, first, faces, seed, sight)
    except ReconstructionError:
        joined = joined_faces(cloud.points, faces, first.spacing_m, first.sigma_m)
        if joined is None:
            raise
        form = flat_form(cloud.points, first, joined, seed, sight)
    every = form.shapes
    rows = np.zeros(0, np.int64) if form.mesh.face_region is None else np.unique(form.mesh.face_region // 2)
    of = np.unique(every.primitive[rows])
    facts: Mapping[str, float | str] = {
        **first.how,
        "method": "planar",
        "n_planes": int(np.sum(of < every.n_flat)),
        "n_cylinders": int(np.sum(of >= every.n_flat)),
        "n_cells": form.n_cells,
        "first_volume_m3": volume(first.mesh),
    }
    std = float(np.max(every.planes.std_m[rows], initial=0.0))  # a cylinder of five points may have been tried, and bound nothing
    if sight is not None:
        measured = cloud.points if cloud.is_inferred is None else cloud.points[~cloud.is_inferred]
        told = one_region(form.mesh, every), measured, first.spacing_m, rolled(every)
        first = replace(first, carried=np.concatenate([over_walls(*told), over_rounds(*told, sight)]))
        facts = {**facts, "n_carried": len(first.carried)}
    checks = gates_planar(scan, first, form.mesh, every, form.seen_through_m3 if by_lines else None)
    return replace(first, mesh=form.mesh, checks=checks, how=facts, residual_m=std)


def served(
    scan: Scan, first: Reconstruction, seed: int = 0, bores: Sequence[Bore] = (), grown: Planes | None = None
) -> tuple[Reconstruction, tuple[Reconstruction, ...]]:
    """Flat and round faces where they explain the points and close; else the first surface, with the reason in `how`. And those that were refused.

    Of two solids of planes, with narrow faces as their points or as the outlines of walls tell them, that of fewer faces is taken.
    Cylinders are looked for where planes alone do not serve, with the outlines of walls first. Where sensors are known and the first surface is
    refused, or differs from a flat solid that nothing else speaks against but points on none of its faces, what is hidden has led it astray: then
    sight lines label the cells in its place, before any cylinder is tried.
    bores : that the points tell: planes alone close those of few points.   grown : the planes under all points; None: not asked, or too many.
    """
    given, first = first, _quieter(scan.cloud.points, first, grown)
    grown = grown if first is given else None
    seen, by_lines = first.source == "sensors", bool(failed(first.checks))
    why = ""
    refused: list[Reconstruction] = []
    best: Reconstruction | None = None
    points = scan.cloud.points
    of_planes = cache(lambda: flat_faces(points, first, grown))
    rounds = cache(lambda: rounds_of(points, first, _or_none(of_planes)))
    finders: tuple[tuple[bool, Callable[[], Faces | None]], ...]  # is it asked where planes alone serve?
    finders = (
        (True, of_planes),
        (True, lambda: outlined_faces(points, first, grown)),
        (False, lambda: outlined_round_faces(points, first, rounds())),
        (False, lambda: round_faces(points, first, rounds())),
    )
    has_slots = cache(lambda: (flat := _or_none(of_planes)) is not None and bool(slot_ends(points, flat.planes, first.spacing_m, first.sigma_m)))
    for always, find in finders:
        if best is not None and not always and (best.how["n_cylinders"] or not has_slots()):
            break
        try:
            faces = find()
        except ReconstructionError as error:
            why = str(error)
            continue
        differs = False
        for lines in (False, True):
            if faces is None or (lines and not (seen and (by_lines or differs))):
                continue
            try:
                flat = flattened(scan, first, seed, lines, faces)
                flat = against_free(scan, flat, served_sharp(scan, first), seed) if lines and not by_lines else flat
            except ReconstructionError as error:
                why = str(error)
                continue
            flat = flat if failed(flat.checks) else replace(flat, checks=(*flat.checks, closed_bores(bores, flat.mesh)))
            against = failed(flat.checks)
            if not against:
                best = flat if best is None or _rank(flat) < _rank(best) else best
                break
            refused.append(flat)
            names = {check.name for check in against}
            differs = DIFFER in names and names <= MISLABELLED
            why = "; ".join(check.name for check in against)
    return (replace(given, how={**given.how, "not_planar": why}) if best is None else best), tuple(refused)


def _quieter(points: FloatArray, first: Reconstruction, grown: Planes | None) -> Reconstruction:
    """The surface with the noise that its planes tell, where neighbourhoods that reach round edges have told more than twice as much."""
    noise = np.nan if grown is None or first.sigma_m <= EXACT else flat_noise_m(points, grown)
    return replace(first, sigma_m=noise) if noise < LESS * first.sigma_m else first


def _or_none(find: Callable[[], Faces]) -> Faces | None:
    try:
        return find()
    except ReconstructionError:
        return None


def _rank(flat: Reconstruction) -> tuple[bool, int]:
    """The least is best: with cylinders where ends of slots ask for them; then by pieces of planes: where these lean that should not, more."""
    return not flat.how["n_cylinders"], len(planar_regions(flat.mesh).ids)


def flat_form(points: FloatArray, first: Reconstruction, faces: Faces, seed: int = 0, sight: Sight | None = None) -> FlatForm:
    """Cells between the faces, labels, surface. points : (n, 3) raw, in the rows of `first`. Raises ReconstructionError where they do not close.

    sight : labels the cells in place of the first surface.
    """
    sigma, planes, rounds = first.sigma_m, faces.planes, faces.rounds
    teller = PointToMesh(first.mesh) if sight is None else sight
    form = _closed(points, planes, rounds, first, seed, teller)
    is_blurred = sigma > EXACT and first.source != "ranges"  # a range camera's noise lies along its rays: faces are not blurred alike all round
    for _ in range(PLACED if is_blurred else 0):
        planes = moved_planes(planes, placed(points, first.normals, form.mesh, form.shapes.planes, sigma))
        form = _closed(points, planes, rounds, first, seed, teller)
    return form


def _closed(points: FloatArray, planes: Planes, rounds: Rounds, first: Reconstruction, seed: int, teller: PointToMesh | Sight) -> FlatForm:
    """The solid between the faces. Raises ReconstructionError where it is no clean one."""
    h, sigma, sight = first.spacing_m, first.sigma_m, teller if isinstance(teller, Sight) else None
    every = shapes(points, planes, rounds, h)
    cells, count, group = arranged(points, every, h, sigma)
    full, empty, size = _told(cells, group, teller, seed)
    scale = 1.0 if sight is None else _whole(full, empty, size, _by_faces(cells, group, count, full, empty, h))
    out, within = _votes(cells, group, count, every, h)
    inside = _cheapest(cells, group, count, scale * empty + out, scale * full + within, h)[group]
    mesh = flat_solid(cells, inside, every.planes.normal)
    topology = surface_topology(mesh)
    require(topology.is_clean, ReconstructionError, "the planes meet in edges or corners where the solid only touches itself")
    require(topology.n_components == 1, ReconstructionError, f"the planes enclose {topology.n_components} shells")
    require(not len(self_intersections(mesh)), ReconstructionError, "flat faces cross: their planes nearly coincide")
    through = 0.0 if sight is None else _seen_through(cells, inside, mesh, sight, seed)
    return FlatForm(mesh=mesh, shapes=every, n_cells=int(group.max()) + 1, seen_through_m3=through)


def arranged(points: FloatArray, every: Shapes, spacing_m: float, sigma_m: float) -> tuple[Cells, FloatArray, IntArray]:
    """The cells of a box round the points, each shape cutting those that its own points reach; how many points back each facet; (n_cells,) group.

    Cells of one group are one: no shape parts them, and they hang together.
    """
    planes, n_flat = every.planes, every.n_flat
    low, high = points.min(axis=0), points.max(axis=0)
    margin = MARGIN * float(np.linalg.norm(high - low)) + 4.0 * spacing_m
    apart = parting(points, every)
    normal, offset = np.vstack([planes.normal, apart.normal]), np.append(planes.offset, apart.offset)
    space = Arrangement(normal, offset, low - margin, high + margin)
    reach = REACH * spacing_m + 3.0 * sigma_m
    for k in range(n_flat):
        own = _sample(points, planes, np.array([k]))
        if len(own):
            cut = range(space.n_cells) if n_flat <= CUT_ALL else space.holding(_spread(own, planes.plane(k), reach, spacing_m))
            space.cut(k, cut)
    group = apart.cut(space, len(planes))
    few = n_flat <= CUT_ALL and len(every.rounds) <= CUT_ALL
    for number in range(len(every.rounds)):
        own, surface = _sample(points, planes, every.rows(number)), every.rounds.surfaces[number]
        along = np.concatenate([own + share * reach * surface.axis for share in (-1.0, -0.5, 0.0, 0.5, 1.0)])
        hair = 1e-6 * spacing_m * surface.normals(along)
        cut = range(space.n_cells) if few else space.holding(np.concatenate([along + hair, along - hair]))
        group = cut_round(space, every, number, list(cut), group)
    cells = space.cells()
    numbers = hung_together(cells, np.array(group))
    return cells, _backed(points, every, space, cells, numbers, spacing_m), numbers


def _sample(points: FloatArray, planes: Planes, rows: IntArray) -> FloatArray:
    """SUPPORT of the points of some rows, each on its plane."""
    own = np.flatnonzero(np.isin(planes.label, rows))
    own = own[sampled_rows(len(own), SUPPORT, 0)]
    normal = planes.normal[planes.label[own]]
    height = np.einsum("ij,ij->i", points[own], normal) - planes.offset[planes.label[own]]
    return np.asarray(points[own] - height[:, None] * normal)


def _spread(own: FloatArray, plane: Plane, reach: float, spacing_m: float) -> FloatArray:
    """Places round points of a plane, on both sides of it."""
    across, angle = plane.axes(), np.arange(8) * (np.pi / 4)
    ring = np.cos(angle)[:, None] * across[0] + np.sin(angle)[:, None] * across[1]
    spread = np.concatenate([own, *[(own[:, None] + share * reach * ring).reshape(-1, 3) for share in RINGS]])
    hair = 1e-6 * spacing_m * plane.normal
    return np.concatenate([spread + hair, spread - hair])


def _backed(points: FloatArray, every: Shapes, space: Arrangement, cells: Cells, group: IntArray, spacing_m: float) -> FloatArray:
    """(f,) how many points back each facet: those of one shape between the same two groups share theirs by area."""
    planes, of = every.planes, np.append(every.primitive, np.full(int(cells.plane.max()) + 1 - len(every.primitive), -1))  # more: beside, and the box
    pieces: dict[tuple[int, int, int], list[int]] = {}
    for f, (shape, pair) in enumerate(zip(of[cells.plane].tolist(), np.append(group, -1)[cells.cell].tolist(), strict=True)):
        pieces.setdefault((shape, *pair), []).append(f)
    area = _areas(cells)
    count = np.zeros(len(cells.loops))
    for k in np.unique(planes.label[planes.label >= 0]):
        on = planes.plane(k).projected(points[planes.label == k])
        hair = 1e-6 * spacing_m * planes.normal[k]
        sides = np.stack([group[space.located(on + hair)], group[space.located(on - hair)]], axis=1)
        pairs, backed = np.unique(sides, axis=0, return_counts=True)
        for pair, n in zip(pairs.tolist(), backed.tolist(), strict=True):
            own = pieces.get((int(of[k]), *pair), [])
            count[own] += n * area[own] / max(float(area[own].sum()), 1e-300)
    return count


def _told(cells: Cells, group: IntArray, teller: PointToMesh | Sight, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(g,) volume of each group that is told to be inside, that is told to be outside, and all of it: by the first surface, or by sight lines."""
    places, owner, share = _probes(cells, seed, PROBES_KNOWN if isinstance(teller, Sight) else PROBES)
    if isinstance(teller, Sight):
        full, empty = teller.told(places)
    else:
        full = teller.signed_distance(places) < 0
        empty = ~full
    one, other, size = (np.bincount(group[owner], weights=of) for of in (share * full, share * empty, share))
    return np.asarray(one, float), np.asarray(other, float), np.asarray(size, float)


def _votes(cells: Cells, group: IntArray, count: FloatArray, every: Shapes, spacing_m: float) -> tuple[FloatArray, FloatArray]:
    """(g,) volume that points on cylinders speak for outside, and for inside: of what lies before them, and behind.

    The inside of a bore a few spacings wide lies within reach of the faces round it, whose points say that it is under them.
    """
    on = np.flatnonzero(np.isin(cells.plane, np.flatnonzero(every.round_of >= 0)) & (cells.cell >= 0).all(axis=1))
    said, sides = VOTE * spacing_m**3 * count[on], group[cells.cell[on]]
    n = int(group.max()) + 1
    before, behind = (np.bincount(sides[:, k], said, minlength=n) for k in (0, 1))
    return np.asarray(before, float), np.asarray(behind, float)


def _seen_through(cells: Cells, inside: BoolArray, mesh: TriangleMesh, sight: Sight, seed: int) -> float:
    """Volume of the solid, but for a skin in which lines may graze its faces, that sight lines pass through, m^3."""
    places, owner, share = _probes(cells, seed, PROBES_KNOWN)
    within = np.flatnonzero(inside[owner])
    within = within[signed_distance(places[within], mesh) < -sight.skin_m]
    return float(share[within][sight.passes(places[within])].sum())


def _whole(full: FloatArray, empty: FloatArray, size: FloatArray, sure: BoolArray) -> FloatArray:
    """(c,) what makes the told volume of each cell all of it: what was seen of it tells the rest; 1 where FEW places of it were seen.

    sure : (c,) cells whose own faces say the same, however little of their inside was seen.
    """
    known = full + empty
    return np.asarray(np.divide(size, known, out=np.ones(len(size)), where=(known > FEW * size) | (sure & (known > 0.0))))


def _by_faces(cells: Cells, group: IntArray, count: FloatArray, full: FloatArray, empty: FloatArray, spacing_m: float) -> BoolArray:
    """(g,) cells that lie behind facets with points and before none, and are told to be full; or the other way round.

    Of a thick wall of which one face was seen hardly a place is known but those just under its points.
    """
    on = np.flatnonzero((count * spacing_m**2 > BACKED * _areas(cells)) & (cells.cell >= 0).all(axis=1))
    before, behind = (np.bincount(group[cells.cell[on, k]], minlength=len(full)) > 0 for k in (0, 1))
    return np.asarray((behind & ~before & (full >= empty)) | (before & ~behind & (empty >= full)))


def _probes(cells: Cells, seed: int, n_probes: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Random places in every cell, uniform in volume: the place, its cell, the volume it stands for. A cell is the tets over its facets."""
    rng = np.random.default_rng(seed)
    corner: list[list[int]] = [[] for _ in range(cells.n_cells)]
    triangles: list[list[tuple[int, int, int]]] = [[] for _ in range(cells.n_cells)]
    for loop, pair in zip(cells.loops, cells.cell, strict=True):
        fan = [(int(loop[0]), int(b), int(c)) for b, c in itertools.pairwise(loop[1:])]
        for c in pair:
            if c >= 0:
                corner[c] += loop.tolist()
                triangles[c] += fan
    places, owner, share = [], [], []
    for c in range(cells.n_cells):
        apex = cells.vertices[np.unique(corner[c])].mean(axis=0)
        tri = cells.vertices[np.array(triangles[c])]
        sizes = np.abs(np.einsum("ij,ij->i", np.cross(tri[:, 0] - apex, tri[:, 1] - apex), tri[:, 2] - apex)) / 6.0
        total = float(sizes.sum())
        chosen = rng.choice(len(tri), n_probes, p=sizes / total) if total > 0 else np.zeros(n_probes, np.int64)
        weight = rng.dirichlet(np.ones(4), n_probes)
        places.append(weight[:, :1] * apex + np.einsum("ik,ikj->ij", weight[:, 1:], tri[chosen]))
        owner.append(np.full(n_probes, c))
        share.append(np.full(n_probes, total / n_probes))
    return np.concatenate(places), np.concatenate(owner), np.concatenate(share)


def _cheapest(cells: Cells, group: IntArray, count: FloatArray, price_inside: FloatArray, price_outside: FloatArray, spacing_m: float) -> BoolArray:
    """(g,) the groups inside, by a minimum cut: a facet is free where points back it and its plane's normal points outside."""
    import maxflow  # heavy: only where it is used

    graph = maxflow.GraphFloat(len(price_inside), len(cells.loops))
    nodes = graph.add_nodes(len(price_inside))
    area = _areas(cells)
    at_box = (cells.cell < 0).any(axis=1)
    sides = group[cells.cell]
    inner = ~at_box & (sides[:, 0] != sides[:, 1])
    price = BARE_PRICE * spacing_m * area[inner]
    bare = np.clip(1.0 - count[inner] * spacing_m**2 / np.maximum(FULL * area[inner], 1e-300), 0.0, 1.0)
    graph.add_edges(sides[inner, 0], sides[inner, 1], price * bare, price)
    never = np.zeros(len(price_inside))
    never[group[cells.cell[at_box].max(axis=1)]] = 1e6 * float(price_inside.sum() + price_outside.sum())  # cells at the box are outside
    graph.add_grid_tedges(nodes, price_inside + never, price_outside)
    graph.maxflow()
    return np.asarray(graph.get_grid_segments(nodes), bool)


def _areas(cells: Cells) -> FloatArray:
    """(f,) of the facets, flat loops."""
    size = np.array([len(loop) for loop in cells.loops])
    first = np.concatenate([[0], np.cumsum(size)[:-1]])
    corner = cells.vertices[np.concatenate(cells.loops)]
    after = np.arange(len(corner)) + 1
    after[first + size - 1] = first
    origin = np.repeat(corner[first], size, axis=0)
    vectors = np.add.reduceat(np.cross(corner - origin, corner[after] - origin), first, axis=0)
    return np.asarray(0.5 * np.linalg.norm(vectors, axis=1))
