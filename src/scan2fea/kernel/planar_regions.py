"""Exactly planar regions of a closed triangle mesh: what `cad` turns into plane faces and `tetmeshing` names its boundary by.

Both stages must agree on which triangle belongs to which CAD face without importing each other, so the grouping lives here and is a function of the
mesh and of one tolerance alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from scan2fea.errors import RepairError, require
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

PLANAR_TOLERANCE = 1e-7  # of the size (diagonal of the box): float32 STL coordinates, rotated, still count as planar


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanarRegions(Value):
    """Regions of a mesh that lie in one plane.

    label : (m,) int64, per triangle the id of its region, -1 for a triangle that stands alone.
    ids : (r,) int64, ascending; a region of `mesh.face_region` keeps its number, grown ones are numbered on from there.
    normal, point : (r, 3) plane of each region, outward.   deviation_m : (r,) largest distance of a vertex of the region from it.
    n_not_planar : regions of `mesh.face_region` that are not planar, left as single triangles.
    n_cut_off : triangles left alone because their region would touch itself at one of their corners.
    """

    label: IntArray
    ids: IntArray
    normal: FloatArray
    point: FloatArray
    deviation_m: FloatArray
    n_not_planar: int
    n_cut_off: int

    _ROWS = (("ids", "normal", "point", "deviation_m"),)


def planar_regions(mesh: TriangleMesh, tolerance: float = PLANAR_TOLERANCE) -> PlanarRegions:
    """Group the triangles of a closed manifold mesh into edge-connected regions planar to `tolerance` x size.

    `mesh.face_region` >= 0 is believed after a check; coplanar neighbours (regions or free triangles) are joined. Where the border of a region passes
    twice through one vertex, the smaller fan of triangles there is cut off: a wire that touches itself is not a valid CAD boundary.
    Raises RepairError if an edge is not used twice.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    centre = (vertices.min(0) + vertices.max(0)) / 2
    local = vertices - centre  # far from the origin, products of coordinates would lose the digits that decide coplanarity
    limit = tolerance * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    pairs = edge_pairs(faces, len(vertices))
    given = np.full(len(faces), -1, np.int64) if mesh.face_region is None else np.asarray(mesh.face_region)

    unit, n_bad = _planar_units(local, faces, pairs, given, limit)
    joined = _joined(local, faces, pairs, unit, limit)
    group, dropped = _without_bow_ties(local, faces, pairs, joined)
    label, ids = _numbered(group, np.where(_is_kept(unit, given) & ~dropped, given, -1))
    slot = np.searchsorted(ids, label)
    normal, point, deviation = _fit(local, faces[label >= 0], slot[label >= 0], len(ids))
    return PlanarRegions(
        label=label, ids=ids, normal=normal, point=point + centre, deviation_m=deviation, n_not_planar=n_bad, n_cut_off=int(dropped.sum())
    )  # fmt: skip


def edge_pairs(faces: IntArray, n_vertices: int) -> IntArray:
    """(3m/2, 4): two triangles and the two vertices of the edge they share, ascending by vertices. Raises RepairError unless each edge has two."""
    edge = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    key = edge[:, 0] * n_vertices + edge[:, 1]
    order = np.argsort(key, kind="stable")
    first, second = order[0::2], order[1::2]
    ok = len(key) % 2 == 0 and bool((key[first] == key[second]).all()) and len(np.unique(key)) == len(first)
    require(ok, RepairError, f"the surface is not closed and manifold: {int((np.unique(key, return_counts=True)[1] != 2).sum())} edges are not "
            "used by exactly two triangles; repair it first")  # fmt: skip
    return np.column_stack([first // 3, second // 3, edge[first]]).astype(np.int64)


def _is_kept(unit: IntArray, given: IntArray) -> BoolArray:
    """(m,) triangles whose given region survived the planarity check (its unit holds more than this triangle, or the region is one triangle)."""
    return np.asarray((given >= 0) & ((np.bincount(unit)[unit] > 1) | (np.bincount(given + 1)[given + 1] == 1)))


def _components(n: int, pairs: IntArray) -> IntArray:
    graph = coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _area_vectors(points: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = (points[faces[:, k]] for k in range(3))
    return np.asarray(np.cross(b - a, c - a) / 2)


def _fit(points: FloatArray, faces: IntArray, group: IntArray, n_groups: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Plane of each group: area-weighted normal, offset half-way between the extremes. Returns normal, point, largest deviation."""
    vector = _area_vectors(points, faces)
    total, moment, weight = np.zeros((n_groups, 3)), np.zeros((n_groups, 3)), np.zeros(n_groups)
    area = np.linalg.norm(vector, axis=1)
    np.add.at(total, group, vector)
    np.add.at(moment, group, area[:, None] * points[faces].mean(1))
    np.add.at(weight, group, area)
    normal = total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]
    centre = moment / np.maximum(weight, 1e-300)[:, None]
    height = np.einsum("fkc,fc->fk", points[faces] - centre[group][:, None], normal[group])
    low, high = np.full(n_groups, np.inf), np.full(n_groups, -np.inf)
    np.minimum.at(low, group, height.min(1))
    np.maximum.at(high, group, height.max(1))
    if not n_groups:
        return normal, centre, np.zeros(0)
    return normal, centre + normal * ((low + high) / 2)[:, None], (high - low) / 2


def _is_planar(points: FloatArray, faces: IntArray, group: IntArray, n_groups: int, limit: float) -> BoolArray:
    """Per group: every vertex within `limit` of the plane and no triangle folded over (a sliver thinner than the limit has no side)."""
    normal, _, deviation = _fit(points, faces, group, n_groups)
    vector = _area_vectors(points, faces)
    along = np.einsum("fc,fc->f", vector, normal[group])
    edges = np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2).max(1)
    folded = along < -limit * edges
    return np.asarray((deviation <= limit) & (np.bincount(group[folded], minlength=n_groups) == 0))


def _planar_units(points: FloatArray, faces: IntArray, pairs: IntArray, given: IntArray, limit: float) -> tuple[IntArray, int]:
    """(m,) number of the planar unit of each triangle: connected pieces of given regions that are planar, single triangles otherwise."""
    same = (given[pairs[:, 0]] == given[pairs[:, 1]]) & (given[pairs[:, 0]] >= 0)
    unit = _components(len(faces), pairs[same])
    n_units = int(unit.max(initial=-1)) + 1
    bad = ~_is_planar(points, faces, unit, n_units, limit) & (np.bincount(unit, minlength=n_units) > 1)
    alone = bad[unit]
    unit = np.where(alone, n_units + np.arange(len(faces)), unit)
    return np.unique(unit, return_inverse=True)[1].astype(np.int64), int(bad.sum())


def _joined(points: FloatArray, faces: IntArray, pairs: IntArray, unit: IntArray, limit: float) -> IntArray:
    """Units joined with coplanar neighbours. A chain of joins that drifts off its plane (a fine cylinder) is cut up from its largest unit on."""
    n_units = int(unit.max(initial=-1)) + 1
    normal, point, _ = _fit(points, faces, unit, n_units)
    area = np.asarray(np.bincount(unit, weights=np.linalg.norm(_area_vectors(points, faces), axis=1), minlength=n_units), float)
    a, b = unit[pairs[:, 0]], unit[pairs[:, 1]]
    # the plane of the larger unit is the better known one; every vertex of the other's triangle at this border must lie in it
    large, small_face = np.where(area[a] >= area[b], a, b), np.where(area[a] >= area[b], pairs[:, 1], pairs[:, 0])
    height = np.abs(np.einsum("fkc,fc->fk", points[faces[small_face]] - point[large][:, None], normal[large])).max(1)
    facing = np.einsum("fc,fc->f", normal[a], normal[b]) > 0
    link = np.column_stack([a, b])[(a != b) & (height <= limit) & facing]
    group = _components(n_units, link)[unit]
    n_groups = int(group.max(initial=-1)) + 1
    bad = np.flatnonzero(~_is_planar(points, faces, group, n_groups, limit))
    for number in bad:
        rows = np.flatnonzero(group == number)
        corners = {int(u): np.unique(faces[rows[unit[rows] == u]]) for u in np.unique(unit[rows])}
        owner = _cut_up(points, corners, (point, normal), link, area, limit)
        group[rows] = int(group.max()) + 1 + np.array([owner[int(unit[row])] for row in rows], np.int64)
    return np.unique(group, return_inverse=True)[1].astype(np.int64)


def _cut_up(
    points: FloatArray, corners: dict[int, IntArray], planes: tuple[FloatArray, FloatArray], link: IntArray, area: FloatArray, limit: float
) -> dict[int, int]:
    """The unit that each unit of `corners` (its vertices) is joined to: grow from the largest left, over links, to units in its plane."""
    point, normal = planes
    linked: dict[int, list[int]] = {u: [] for u in corners}
    for a, b in link[np.isin(link[:, 0], list(corners))].tolist():
        linked[a].append(b)
        linked[b].append(a)
    owner: dict[int, int] = {}
    for seed in sorted(corners, key=lambda u: (-area[u], u)):
        if seed in owner:
            continue
        owner[seed] = seed
        front = [seed]
        while front:
            for other in linked[front.pop()]:
                if other not in owner and np.abs((points[corners[other]] - point[seed]) @ normal[seed]).max() <= limit:
                    owner[other] = seed
                    front.append(other)
    return owner


def _without_bow_ties(points: FloatArray, faces: IntArray, pairs: IntArray, group: IntArray) -> tuple[IntArray, BoolArray]:
    """Groups whose borders are simple, and the triangles cut off for it. Each round cuts some off, so it ends."""
    area = np.linalg.norm(_area_vectors(points, faces), axis=1)
    dropped = np.zeros(len(faces), bool)
    while True:
        same = (group[pairs[:, 0]] == group[pairs[:, 1]]) & ~dropped[pairs[:, 0]] & ~dropped[pairs[:, 1]]
        group = _components(len(faces), pairs[same])
        for number, vertex in _touching(faces, pairs, group):
            rows = np.flatnonzero((group == number) & (faces == vertex).any(1))
            spokes = pairs[same & (pairs[:, 2:] == vertex).any(1) & np.isin(pairs[:, 0], rows)]
            fan = _components(len(rows), np.searchsorted(rows, spokes[:, :2]))
            dropped[rows[fan != np.argmax(np.bincount(fan, weights=area[rows]))]] = True
        cut = dropped & (np.bincount(group)[group] > 1)
        if not cut.any():
            return group, dropped
        group = np.where(cut, len(faces) + np.arange(len(faces)), group)


def _touching(faces: IntArray, pairs: IntArray, group: IntArray) -> list[tuple[int, int]]:
    """(group, vertex) where the border of a group passes a vertex twice: a simple border has two border edges at each of its vertices."""
    border = pairs[group[pairs[:, 0]] != group[pairs[:, 1]]]
    ends = np.concatenate([np.column_stack([group[border[:, f]], border[:, v]]) for f in (0, 1) for v in (2, 3)])
    rows, count = np.unique(ends, axis=0, return_counts=True)
    return [(int(g), int(v)) for g, v in rows[count > 2].tolist()]


def _numbered(group: IntArray, given: IntArray) -> tuple[IntArray, IntArray]:
    """Labels and ascending ids: a group takes the smallest given region in it not yet taken; others follow in order of their first triangle."""
    _, first, group, size = np.unique(group, return_index=True, return_inverse=True, return_counts=True)
    name = np.full(len(size), np.iinfo(np.int64).max)
    has = given >= 0
    np.minimum.at(name, group[has], given[has])
    free = int(given.max(initial=-1)) + 1
    taken: set[int] = set()
    out = np.full(len(size), -1, np.int64)
    for g in np.argsort(first, kind="stable").tolist():
        if name[g] < np.iinfo(np.int64).max and int(name[g]) not in taken:
            out[g] = name[g]
            taken.add(int(name[g]))
        elif size[g] > 1 or name[g] < np.iinfo(np.int64).max:
            out[g] = free
            free += 1
    return out[group], np.unique(out[out >= 0])
