"""Isotropic remeshing: split, collapse, flip, smooth, until edges have the length asked for (Botsch and Kobbelt 2004).

Creases and corners are kept, planes stay planes, free form is put back on the surface it came from. After every round the whole
surface is tested for crossings; a round that made one is taken back and repeated with that place held still.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals, vertex_normals
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.topology import edge_table, half_edges
from scan2fea.remeshing.halfedge import CORNER, CREASE, FREE, FROZEN, LONG, SHORT, collapse_edges, flip_edges, move_vertices, split_edges
from scan2fea.types import BoolArray, ByteArray, FloatArray, IntArray, TriangleMesh

ROUNDS = 6
POLISHES = 3
POOR = 0.4  # shape, about 20 degrees, under which a face is worked on to the end
FLAT_ROUNDS = 3
PUT_BACK = 4  # times that moved vertices whose faces cross are put back
RETRIES = 4  # of a round that made faces cross, each with more of the surface held
TURN = 0.5  # a face may turn by 60 degrees in one change
FLOOR = 0.35  # a vertex is not moved where a face falls under this shape, unless it was worse


@dataclass(frozen=True, eq=False, kw_only=True)
class Work:
    """The half-edge arrays of `halfedge`, with room behind the first n_vertices and n_faces; they are written to. flat_only : free form is held.

    largest : what the goal may grow to along an edge, away from its ends; 0: it does not.
    """

    points: FloatArray
    goal: FloatArray
    kind: ByteArray
    out: IntArray
    origin: IntArray
    twin: IntArray
    sharp: ByteArray
    region: IntArray
    n_vertices: int
    n_faces: int
    flat_only: bool = False
    largest: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Guide:
    """What the result has to follow.

    surface : nearest points of the free form alone: beyond its rim lies a plane that it must not slide onto.   creases : the same for creases.
    planes : region number -> plane.   drift_m : how far one change may move the surface.
    """

    surface: PointToMesh | None
    creases: PointToMesh | None
    planes: dict[int, Plane]
    drift_m: float


def opened(mesh: TriangleMesh, is_sharp: BoolArray, goal: FloatArray, largest: float = 0.0) -> Work:
    """Work arrays of a closed manifold oriented mesh; is_sharp : (e,) over the rows of its edge table, goal : (n,) metres, largest : as in `Work`."""
    table = edge_table(mesh.faces)
    n, origin = len(mesh.vertices), mesh.faces.ravel().copy()
    out = np.zeros(n, np.int64)
    out[origin[::-1]] = np.arange(len(origin))[::-1]
    region = np.full(len(mesh.faces), -1, np.int64) if mesh.face_region is None else mesh.face_region.copy()
    work = Work(
        points=mesh.vertices.copy(), goal=goal.copy(), kind=np.zeros(n, np.uint8), out=out, origin=origin, twin=table.twin.copy(),
        sharp=is_sharp[table.edge_of].astype(np.uint8), region=region, n_vertices=n, n_faces=len(mesh.faces),
        largest=largest,
    )  # fmt: skip
    return replace(work, kind=_kinds(work))


def closed(work: Work) -> TriangleMesh:
    """The mesh of the work arrays, dead faces and vertices left out."""
    faces = work.origin[: 3 * work.n_faces].reshape(-1, 3)
    alive = faces[:, 0] >= 0
    used, packed = np.unique(faces[alive], return_inverse=True)
    return TriangleMesh(vertices=work.points[used], faces=packed.reshape(-1, 3).astype(np.int64), face_region=work.region[: work.n_faces][alive])


def compacted(work: Work) -> Work:
    """A copy without dead rows and without spare room."""
    faces = work.origin[: 3 * work.n_faces].reshape(-1, 3)
    alive = np.flatnonzero(faces[:, 0] >= 0)
    used, packed = np.unique(faces[alive], return_inverse=True)
    halves = (3 * alive[:, None] + np.arange(3)).ravel()
    new_half = np.full(3 * work.n_faces, -1, np.int64)
    new_half[halves] = np.arange(len(halves))
    return Work(
        points=work.points[used], goal=work.goal[used], kind=work.kind[used], out=new_half[work.out[used]], origin=packed.ravel().astype(np.int64),
        twin=new_half[work.twin[halves]], sharp=work.sharp[halves], region=work.region[alive], n_vertices=len(used), n_faces=len(alive),
        flat_only=work.flat_only, largest=work.largest,
    )  # fmt: skip


def _roomy(work: Work, n: int) -> Work:
    """A compact copy with room for n more vertices and 2 n more faces."""
    work = compacted(work)
    pad = {"points": n, "goal": n, "kind": n, "out": n, "origin": 6 * n, "twin": 6 * n, "sharp": 6 * n, "region": 2 * n}
    grown: dict[str, Any] = {name: np.concatenate([old := getattr(work, name), np.zeros((k, *old.shape[1:]), old.dtype)]) for name, k in pad.items()}
    return replace(work, **grown)


def _open_edges(work: Work, *, flat: bool = False) -> IntArray:
    """One half-edge of each edge that may be changed: all, or those between faces of planes where free form is held, or where asked."""
    h = np.flatnonzero(work.origin[: 3 * work.n_faces] >= 0)
    h = h[h < work.twin[h]]
    if work.flat_only or flat:
        h = h[(work.region[h // 3] >= 0) & (work.region[work.twin[h] // 3] >= 0)]
    return h


def _edges_by_length(work: Work, longer: float, shorter: float) -> IntArray:
    """One half-edge of each open edge whose length over its goal lies between the two, shortest first."""
    h = _open_edges(work)
    a, b = work.origin[h], work.origin[h // 3 * 3 + (h + 1) % 3]
    share = np.linalg.norm(work.points[a] - work.points[b], axis=1) / (0.5 * (work.goal[a] + work.goal[b]))
    asked = np.flatnonzero((share > longer) & (share < shorter))
    return h[asked[np.argsort(share[asked], kind="stable")]]


def _split(work: Work, drift: float) -> Work:
    """Edges halved until none is long. Those of planes are turned in between: where thin faces run across a plane each would be cut on its own.

    (A part of 5,500 faces, thin ones across its planes, went through 174,000 without it, and through 36,000 with it.)
    """
    for _ in range(12):  # each halves the longest edges; 12 rounds bring 4096 goals down to one
        long = _edges_by_length(work, LONG, np.inf)[::-1]
        if not len(long):
            break
        work = _roomy(work, len(long))  # half-edges are numbered anew: the queue is looked up again
        long = _edges_by_length(work, LONG, np.inf)[::-1]
        w = work
        n, m = split_edges(long, w.n_vertices, w.n_faces, w.origin, w.twin, w.out, w.sharp, w.kind, w.goal, w.region, w.points, w.largest)
        grew = n > w.n_vertices
        work = replace(work, n_vertices=int(n), n_faces=int(m))
        if not grew:
            break
        _flip(work, drift, TURN, flat=True)
    return work


def _collapse(work: Work, drift: float, turn: float, short: float = SHORT) -> Work:
    for _ in range(3):
        half = _edges_by_length(work, -1.0, short)
        w = work
        if not collapse_edges(half, w.origin, w.twin, w.out, w.sharp, w.kind, w.goal, w.points, turn, drift, short):
            break
    return compacted(work)


def _flip(work: Work, drift: float, turn: float, *, flat: bool = False) -> None:
    for _ in range(3):
        half = _open_edges(work, flat=flat)
        w = work
        if not flip_edges(half, w.origin, w.twin, w.out, w.sharp, w.kind, w.points, turn, drift):
            break


def _crease_targets(work: Work, guide: Guide) -> tuple[IntArray, FloatArray]:
    """Crease vertices and the middle of their two neighbours along the crease, put back onto the crease; not where an edge would then cut a bend."""
    h = np.flatnonzero(work.sharp)
    a, b = work.origin[h], work.origin[h // 3 * 3 + (h + 1) % 3]
    which = np.flatnonzero((work.kind == CREASE) & (np.bincount(a, minlength=len(work.points)) == 2))
    if guide.creases is None or not len(which):
        return which[:0], np.zeros((0, 3))
    order = np.argsort(a, kind="stable")
    first = np.searchsorted(a[order], which)
    beside = work.points[b[order[np.stack([first, first + 1], axis=1)]]]  # (k, 2, 3)
    old = work.points[which]
    wanted = guide.creases.nearest(old + 0.5 * (beside.mean(1) - old)).closest
    before, after = ((0.5 * (beside + place[:, None])).reshape(-1, 3) for place in (old, wanted))
    strays = guide.creases.nearest(after).distance
    cuts = (strays > guide.drift_m) & (strays > guide.creases.nearest(before).distance)
    kept = ~cuts.reshape(-1, 2).any(1)
    return which[kept], wanted[kept]


def _free_targets(work: Work, guide: Guide) -> tuple[IntArray, FloatArray]:
    """Free vertices and the mean of the centroids of their faces (by area over goal squared), in the tangent plane, back on the surface."""
    faces = work.origin.reshape(-1, 3)
    mesh = TriangleMesh(vertices=work.points, faces=faces)
    tri = work.points[faces]
    weight = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1) / work.goal[faces].mean(1) ** 2
    centre = tri.mean(1) * weight[:, None]
    n = len(work.points)
    flat = faces.ravel()
    total = np.stack([np.bincount(flat, weights=np.repeat(centre[:, k], 3), minlength=n) for k in range(3)], axis=1)
    share = np.maximum(np.bincount(flat, weights=np.repeat(weight, 3), minlength=n), 1e-300)
    normal = vertex_normals(mesh)
    step = total / share[:, None] - work.points
    step -= np.einsum("ij,ij->i", step, normal)[:, None] * normal
    wanted = work.points + step
    region = np.full(n, -1, np.int64)
    region[flat] = np.repeat(work.region, 3)  # all faces of a free vertex lie in one region
    free = work.kind == FREE
    for number, plane in guide.planes.items():
        rows = np.flatnonzero(free & (region == number))
        wanted[rows] = plane.projected(wanted[rows])
    rows = np.flatnonzero(free & (region < 0))
    if len(rows) and guide.surface is not None:
        nearest = guide.surface.nearest(wanted[rows])
        agree = np.einsum("ij,ij->i", face_normals(guide.surface.mesh)[nearest.face], normal[rows]) > 0.2  # not the far side of a thin wall
        wanted[rows] = np.where(agree[:, None], nearest.closest, work.points[rows])
    which = np.flatnonzero(free)
    return which, wanted[which]


def _smooth(work: Work, guide: Guide, turn: float, times: int) -> None:
    """Vertices moved to where faces are even, `times` times; those whose faces then cross are put back, with more around them each time."""
    before = work.points.copy()
    for _ in range(times):
        for which, wanted in (_crease_targets(work, guide), _free_targets(work, guide)):
            if len(which):
                move_vertices(which, wanted, work.origin, work.twin, work.out, work.points, turn, FLOOR)
    faces = work.origin.reshape(-1, 3)
    back = np.zeros(len(work.points), bool)
    for _ in range(PUT_BACK if not work.flat_only else 0):
        pairs = self_intersections(TriangleMesh(vertices=work.points, faces=faces))
        if not len(pairs):
            break
        back[faces[np.unique(pairs)]] = True
        work.points[back] = before[back]
        back[faces[back[faces].any(1)]] = True


def _round(work: Work, guide: Guide) -> Work:
    work = _split(work, guide.drift_m)
    work = _collapse(compacted(work), guide.drift_m, TURN)
    _flip(work, guide.drift_m, TURN)
    _smooth(work, guide, TURN, 2)
    _flip(work, guide.drift_m, TURN)
    return work


def _eased(work: Work, where: TriangleMesh, attempt: int) -> Work:
    """The work made easier near crossing faces: shorter edges, which bend less, at the first attempt; held still, farther each time, after that."""
    reach = np.maximum(1.0, attempt) * work.goal
    near = PointToMesh(where).nearest(work.points).distance <= reach
    if attempt == 0:
        return replace(work, goal=np.where(near, 0.5 * work.goal, work.goal))
    return replace(work, kind=np.where(near, FROZEN, work.kind).astype(np.uint8))


def _copy(work: Work) -> Work:
    names = ("points", "goal", "kind", "out", "origin", "twin", "sharp", "region")
    return replace(work, **{name: getattr(work, name).copy() for name in names})


def flat_first(work: Work, guide: Guide, rounds: int = FLAT_ROUNDS) -> Work:
    """The planes remeshed alone, everything that touches free form held: within a plane the guards of each change leave nothing to cross.

    What a plane is filled with at first are long faces; they would hide what happens beside them.
    """
    if not guide.planes:
        return work
    free = np.zeros(len(work.points), bool)
    free[work.origin.reshape(-1, 3)[work.region < 0]] = True
    work = replace(_copy(work), kind=np.where(free, np.maximum(work.kind, CORNER), work.kind).astype(np.uint8), flat_only=True)
    for _ in range(rounds):
        work = _round(work, guide)
    work = compacted(work)
    return replace(work, kind=_kinds(work), flat_only=False)


def _kinds(work: Work) -> ByteArray:
    """FREE, CREASE or CORNER by the number of sharp edges at each vertex."""
    creases = np.bincount(work.origin[work.sharp > 0], minlength=len(work.points))
    return np.where(creases == 0, FREE, np.where(creases == 2, CREASE, CORNER)).astype(np.uint8)


def isotropic(work: Work, guide: Guide, rounds: int = ROUNDS) -> tuple[Work, list[TriangleMesh]]:
    """The remeshed work, and the faces that crossed in steps that had to be given up. The input must be free of crossings; so is the result."""
    if not rounds:
        return work, []
    work = flat_first(work, guide)
    trouble: list[TriangleMesh] = []
    for step in [_round] * rounds + [_polish] * POLISHES:
        work, crossed = _guarded(work, guide, step)
        trouble += crossed
    return work, trouble


def _guarded(work: Work, guide: Guide, step: Callable[[Work, Guide], Work]) -> tuple[Work, list[TriangleMesh]]:
    """The work after a step that makes no faces cross, eased until it does not; else as it was. And the faces that crossed."""
    start = work
    crossed: list[TriangleMesh] = []
    for attempt in range(RETRIES):
        trial = compacted(step(_copy(start), guide))
        mesh = closed(trial)
        pairs = self_intersections(mesh)
        if not len(pairs):
            return replace(trial, kind=_kinds(trial)), crossed
        crossed.append(TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[np.unique(pairs)]))
        start = _eased(start, crossed[-1], attempt)
    return work, crossed


def _polish(work: Work, guide: Guide) -> Work:
    """Faces that are still badly shaped: their edges turned, their shortest edges taken out whatever the goal, their corners moved."""
    work = compacted(work)
    faces = work.origin.reshape(-1, 3)
    tri = work.points[faces]
    edge = np.linalg.norm(tri - np.roll(tri, -1, axis=1), axis=2)
    doubled = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    bad = np.flatnonzero(2 * 3**0.5 * doubled / np.maximum((edge**2).sum(1), 1e-300) < POOR)
    if not len(bad):
        return work
    w = work
    flip_edges((3 * bad[:, None] + np.arange(3)).ravel(), w.origin, w.twin, w.out, w.sharp, w.kind, w.points, TURN, guide.drift_m)
    shortest = 3 * bad + edge[bad].argmin(1)
    collapse_edges(shortest, w.origin, w.twin, w.out, w.sharp, w.kind, w.goal, w.points, TURN, guide.drift_m, np.inf)
    work = compacted(work)
    _smooth(work, guide, TURN, 2)
    _flip(work, guide.drift_m, TURN)
    return work


def sharp_edges(mesh: TriangleMesh, angle_deg: float) -> BoolArray:
    """(e,) True for edges between regions, and between free faces that meet at more than `angle_deg` off flat."""
    table = edge_table(mesh.faces)
    half = np.flatnonzero(table.twin >= 0)
    normal = face_normals(mesh)
    turned = np.einsum("ij,ij->i", normal[half // 3], normal[table.twin[half] // 3]) < np.cos(np.radians(angle_deg))
    region = np.full(len(mesh.faces), -1, np.int64) if mesh.face_region is None else mesh.face_region
    border = region[half // 3] != region[table.twin[half] // 3]
    free = (region[half // 3] < 0) & (region[table.twin[half] // 3] < 0)
    sharp = np.zeros(len(table.edges), bool)
    sharp[table.edge_of[half[border | (turned & free)]]] = True
    return sharp


def free_form(mesh: TriangleMesh) -> PointToMesh | None:
    """Nearest points on the faces that lie on no plane; None without."""
    faces = mesh.faces if mesh.face_region is None else mesh.faces[mesh.face_region < 0]
    return PointToMesh(TriangleMesh(vertices=mesh.vertices, faces=faces)) if len(faces) else None


def crease_guide(mesh: TriangleMesh, is_sharp: BoolArray) -> PointToMesh | None:
    """Nearest points on the creases: each edge a triangle without width."""
    edges = edge_table(mesh.faces).edges[is_sharp]
    if not len(edges):
        return None
    return PointToMesh(TriangleMesh(vertices=mesh.vertices, faces=np.column_stack([edges, edges[:, 1]])))


def crease_lengths(mesh: TriangleMesh) -> FloatArray:
    """(3 m,) length of each half-edge."""
    ends = half_edges(mesh.faces)
    return np.asarray(np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1))
