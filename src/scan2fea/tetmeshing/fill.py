"""Fill a closed surface with tets: from its B-Rep where that is made of true faces, else inside its own triangles."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scan2fea.errors import MeshingError, require
from scan2fea.kernel.measures import extent, median_edge
from scan2fea.kernel.measures import volume as enclosed_volume
from scan2fea.kernel.processes import spent_s
from scan2fea.kernel.quality import TET_LIMITS, tet_dihedrals, triangle_angles
from scan2fea.options import option
from scan2fea.tetmeshing.child import run_worker
from scan2fea.tetmeshing.curve import curved
from scan2fea.tetmeshing.faults import faults_in_words, require_solid
from scan2fea.tetmeshing.naming import PATCH, Names, names_of, prove_order
from scan2fea.tetmeshing.optimise import OptimiseOptions, optimised
from scan2fea.tetmeshing.sizing import element_size
from scan2fea.tetmeshing.tets import VOLUME_AGREES, WrongVolumeError, boundary_of, proved, tagged, tet_mesh
from scan2fea.types import Brep, FloatArray, IntArray, TetMesh, TriangleMesh, Value
from scan2fea.units import MILLIMETRES_PER_METRE

GOOD_DEG = 10.0  # gmsh's own optimisers run below it, where ours are switched off: its clean meshes of thin parts reach 12 to 21
ENOUGH_DEG = 12.0  # no second attempt above: what every object reaches whose surface allows it
LIMIT_DEG = float(TET_LIMITS["min_dihedral_deg"].fail or 0.0)
SHORT_S = 60.0  # less than this is not split between attempts
MANY_FACES = 400  # B-Rep faces up to which meshing face by face makes sense; above it the faces are facets, smaller than elements
CHORDS = 3e-3  # of the volume: what straight edges on curved faces may cut off or add; verification refuses 5e-3
PER_TURN = (24.0, 36.0, 54.0)  # edges round a circle, more where these cut off too much; down to half where the budget would not do
STRAIGHT = 1e-6  # of its length: what the middle of a straight edge may be off by rounding
TOO_MANY_FACES = 6000  # where the triangles cannot be kept, face by face is tried up to here; gmsh needs some seconds per 1000 faces


@dataclass(frozen=True, kw_only=True)
class FillOptions(OptimiseOptions):
    """How a solid is filled with tets."""

    route: str = option("auto", "mesh the faces of the B-Rep anew, or keep the triangles of the surface", choices=("auto", "brep", "surface"))
    edge_m: float | None = option(
        None, "edge length of the elements; two wall thicknesses, within the limits below, without it", unit="m", minimum=0.0
    )
    max_elements: int = option(40_000, "largest number of tets that element sizes are chosen for", minimum=100)
    max_nodes: int = option(58_000, "TET10 nodes that element sizes are chosen for (a kept surface sets its own size)", minimum=100)
    growth: float = option(0.4, "how fast elements grow away from the kept triangles: metres of edge per metre of distance", minimum=0.0, maximum=2.0)
    order: int = option(2, "1: TET4, 2: TET10, with curved edges on curved CAD faces", minimum=1, maximum=2)
    time_limit_s: float = option(180.0, "processor time of the mesher for one object, all attempts together", unit="s", minimum=1.0)
    memory_limit_gib: float = option(4.0, "memory of the mesher, where the system can limit it", unit="GiB", minimum=0.5)

@dataclass(frozen=True, eq=False, kw_only=True)
class Filled(Value):
    """The mesh and how it came about: route, algorithm, edge_m, per_turn (edges round a circle; full_per_turn where the budget made these fewer),
    wall_m, min_dihedral_deg, attempts, steps (the log of the optimisers); of TET10 on curved CAD faces curved_edges, and kept_straight: how many had
    to stay so for a valid Jacobian.
    """

    tets: TetMesh
    how: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class _Attempt:
    route: str
    algorithm: str
    edge_m: float
    growth: float
    per_turn: float = 0.0


class _CutOffError(MeshingError):
    """Straight edges on curved faces, as many round a circle as were asked for, cut off too much: another algorithm fills the same triangles."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Found(Value):
    nodes: FloatArray
    tets: IntArray
    boundary: IntArray
    face_tag: IntArray
    done: str
    edge_m: float  # asked for; of the kept triangles (median) where the surface sets it
    per_turn: float = 0.0
    is_as_asked: bool = False  # of a curved solid: no edge was made longer to keep within the budget
    rim: IntArray | None = None  # (e, 2) edges on curved CAD faces
    middles: FloatArray | None = None  # (e, 3) their middles there
    steps: tuple[Mapping[str, Any], ...] = ()

    @property
    def worst_deg(self) -> float:
        return float(tet_dihedrals(self.nodes, self.tets).min())


def fill(mesh: TriangleMesh, brep: Brep | None, options: FillOptions = FillOptions()) -> Filled:
    """Tets inside `mesh` (closed, manifold, oriented, one component), whose CAD solid is `brep`.

    Every attempt is proved: positive tets that conform and fill the volume of the surface to 1e-6. Attempts go on until the smallest dihedral angle
    is good; the best is returned also where it stays below the limit of `verification`, which then refuses it. Raises MeshingError where no attempt
    gives a mesh, with the reason of the first.
    """
    require_solid(mesh)
    names = names_of(mesh, brep)
    size = element_size(mesh, options.max_elements, options.max_nodes, options.seed)
    require(options.edge_m is None or options.edge_m > 0, MeshingError, f"tetmeshing.edge_m is {options.edge_m} m; it must be greater than 0")
    edge = size.edge_m if options.edge_m is None else options.edge_m
    attempts = _attempts(mesh, brep, edge, options)
    try:
        best, chosen, tried = _best(attempts, lambda a, o: _run(a, mesh, brep, names, o, size.max_edge_m), options)
    except MeshingError as error:
        raise MeshingError(f"{error}{faults_in_words(mesh)}") from None
    how = {**vars(chosen), "done": best.done, "min_dihedral_deg": best.worst_deg, "wall_m": size.wall_m, "attempts": tried, "steps": best.steps}
    if len(best.tets) > options.max_elements:  # the walls ask for more than was allowed
        how |= {"over_budget": True, "max_elements": options.max_elements}
    if 0 < chosen.per_turn < PER_TURN[0]:
        how |= {"full_per_turn": PER_TURN[0]}
    tets = tet_mesh(best.nodes, best.tets, best.boundary, best.face_tag, names.names, options.order)
    if best.rim is not None and best.middles is not None and options.order == 2:
        tets, straight = curved(tets, best.rim, best.middles)
        how |= {"curved_edges": len(best.rim) - straight, "kept_straight": straight}
    return Filled(tets=tets, how=how)


def _best(
    attempts: Iterator[_Attempt], run: Callable[[_Attempt, FillOptions], _Found], options: FillOptions
) -> tuple[_Found, _Attempt, tuple[dict[str, Any], ...]]:
    """The first attempt that is good enough, else the best that time allowed, and what was tried. Raises MeshingError where none succeeds."""
    best: tuple[_Found, _Attempt] | None = None
    tried: list[dict[str, Any]] = []
    too_few = 0.0  # edges round a circle
    began = spent_s()
    for attempt in attempts:
        if 0 < attempt.per_turn <= too_few:
            continue
        left = options.time_limit_s - (spent_s() - began)
        if (best is not None and best[0].worst_deg >= ENOUGH_DEG) or (tried and left < 0.1 * options.time_limit_s):
            break
        share = max(left / 2, min(left, SHORT_S))  # a hanging attempt leaves time for another
        try:
            found = run(attempt, replace(options, time_limit_s=share))
        except MeshingError as error:
            tried.append({**vars(attempt), "error": str(error)})
            too_few = attempt.per_turn if isinstance(error, _CutOffError) else too_few
            continue
        ran = replace(attempt, edge_m=found.edge_m, per_turn=found.per_turn)
        tried.append({**vars(ran), "done": found.done, "n_tets": len(found.tets), "min_dihedral_deg": found.worst_deg})
        if best is None or found.worst_deg > best[0].worst_deg:
            best = found, ran
    if best is None:
        raise MeshingError(str(tried[0]["error"]))
    return (*best, tuple(tried))


def _attempts(mesh: TriangleMesh, brep: Brep | None, edge: float, options: FillOptions) -> Iterator[_Attempt]:
    """Most promising first. A kept triangle with a small angle gives a tet with one: a surface of needles is no start where there are true faces."""
    if brep is not None and brep.is_curved:  # its triangles only come near to it
        for per_turn in PER_TURN:
            for algorithm in ("auto", "other"):
                yield _Attempt(route="brep", algorithm=algorithm, edge_m=edge, growth=options.growth, per_turn=per_turn)
        return
    routes = [options.route]
    if options.route == "auto":
        n_faces = np.inf if brep is None else len(brep.face_names)
        needles = bool(np.degrees(triangle_angles(mesh.vertices, mesh.faces)).min() < LIMIT_DEG)
        routes = ["brep", "surface"] if n_faces <= (TOO_MANY_FACES if needles else MANY_FACES) else ["surface"]
    require(brep is not None or "brep" not in routes, MeshingError, 'tetmeshing.route = "brep" needs a B-Rep, and there is none for this object')
    for algorithms, finer in ((("auto", "other"), 1.0), (("auto",), 0.7)):
        for route in routes:
            for algorithm in algorithms:
                yield _Attempt(route=route, algorithm=algorithm, edge_m=edge * finer, growth=options.growth * finer)


def _run(attempt: _Attempt, mesh: TriangleMesh, brep: Brep | None, names: Names, options: FillOptions, max_edge_m: float) -> _Found:
    limits = {"time_limit_s": options.time_limit_s, "memory_limit_gib": options.memory_limit_gib}
    common = {"algorithm": attempt.algorithm, "good_deg": GOOD_DEG if options.optimise == "none" else 0.0}
    if attempt.route == "brep" and brep is not None:
        fixed = options.edge_m is not None  # an edge that was asked for is kept, whatever it costs
        budget = {"max_tets": np.inf if fixed else options.max_elements, "max_nodes": np.inf if fixed else options.max_nodes}
        sizes = {"size_mm": attempt.edge_m * MILLIMETRES_PER_METRE, "max_size_mm": max(max_edge_m, attempt.edge_m) * MILLIMETRES_PER_METRE}
        job = {**common, **budget, **sizes, "kind": "brep", "per_turn": attempt.per_turn, "is_patched": PATCH in brep.face_kinds}
        found = _from_brep(job, mesh, brep, names, limits)
    else:
        found = _from_surface({**common, "kind": "surface", "growth": attempt.growth}, mesh, names, limits)
    held, agrees = (brep.volume_m3, CHORDS) if brep is not None and brep.is_curved else (enclosed_volume(mesh), VOLUME_AGREES)
    try:
        proved(found.nodes, found.tets, found.boundary, held, agrees)
    except WrongVolumeError as error:
        raise (_CutOffError(str(error)) if found.is_as_asked else error) from None
    if options.optimise == "none":
        return found
    better = _better(found, options)
    proved(better.nodes, better.tets, better.boundary, held, agrees)
    return better


def _better(found: _Found, options: OptimiseOptions) -> _Found:
    """The same boundary, with better tets inside."""
    result = optimised(found.nodes, found.tets, options)
    done = "+".join([found.done, *(str(row["step"]) for row in result.log[1:])])
    boundary = boundary_of(result.tets)
    tag = tagged(boundary, result.row[found.boundary], found.face_tag)
    rim = None if found.rim is None else result.row[found.rim]
    return replace(found, nodes=result.nodes, tets=result.tets, boundary=boundary, face_tag=tag, rim=rim, done=done, steps=result.log)


def _from_brep(job: dict[str, Any], mesh: TriangleMesh, brep: Brep, names: Names, limits: dict[str, float]) -> _Found:
    centre = (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2
    step = np.frombuffer((brep.mesh_step or brep.step).encode("ascii"), np.uint8)
    got = run_worker({**job, "step": step, "shift_mm": -centre * MILLIMETRES_PER_METRE}, **limits)
    scale = 1 / MILLIMETRES_PER_METRE
    prove_order(names, got["face_centre"] * scale + centre, got["face_area"] * scale**2, extent(mesh.vertices))
    boundary = boundary_of(got["tets"])
    tag = tagged(boundary, got["triangles"], names.tag_of_face[got["face"]])
    rim, middles = _rim_of(got) if brep.is_curved else (None, None)
    as_asked = brep.is_curved and float(got["coarser"]) == 1.0 and float(got["per_turn"]) == job["per_turn"]
    return _Found(nodes=got["nodes"] * scale + centre, tets=got["tets"], boundary=boundary, face_tag=tag, done=str(got["done"]), rim=rim,
                  middles=None if middles is None else middles * scale + centre, edge_m=job["size_mm"] * float(got["coarser"]) * scale,
                  per_turn=float(got["per_turn"]), is_as_asked=as_asked)  # fmt: skip


def _rim_of(got: dict[str, Any]) -> tuple[IntArray, FloatArray]:
    """Edges of the boundary whose middle on the faces is not half-way between their ends, and that middle, in the units of the mesher."""
    ends = np.sort(got["triangles"][:, [[0, 1], [1, 2], [0, 2]]], axis=2).reshape(-1, 2)
    edges, first = np.unique(ends, axis=0, return_index=True)
    middles = got["middles"].reshape(-1, 3)[first]
    chord = got["nodes"][edges]
    bent = np.linalg.norm(middles - chord.mean(1), axis=1) > STRAIGHT * np.linalg.norm(chord[:, 1] - chord[:, 0], axis=1)
    return edges[bent], middles[bent]


def _from_surface(job: dict[str, Any], mesh: TriangleMesh, names: Names, limits: dict[str, float]) -> _Found:
    """gmsh works on the surface moved to the origin and brought to a size of 1; the vertices come back as they are, to the last bit."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    centre = (vertices.min(0) + vertices.max(0)) / 2
    scale = 2.0 ** np.ceil(np.log2(extent(vertices)))  # a power of two: no rounding on the way
    got = run_worker({**job, "vertices": (vertices - centre) / scale, "faces": faces}, **limits)
    kept = got["tags"] <= len(vertices)  # gmsh numbers the given nodes 1..n, its own after them
    nodes = got["nodes"] * scale + centre
    nodes[kept] = vertices[got["tags"][kept] - 1]
    row = np.full(len(vertices), -1, np.int64)
    row[got["tags"][kept] - 1] = np.flatnonzero(kept)
    boundary = boundary_of(got["tets"])
    lost = len(faces) - len(boundary)
    says = f"the mesher did not keep the triangles of the surface ({len(faces)} given, {len(boundary)} kept)"
    require(lost == 0 and (row[faces] >= 0).all(), MeshingError, says)
    tag = tagged(boundary, row[faces], names.tag_of_triangle)
    return _Found(nodes=nodes, tets=got["tets"], boundary=boundary, face_tag=tag, done=str(got["done"]), edge_m=median_edge(mesh))
