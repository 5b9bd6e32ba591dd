"""Which faces of a noisy surface lie on planes: grown from flat places, tested for bend, then given the rounded bands along creases."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.primitives import Plane, fit_plane
from scan2fea.kernel.topology import edge_table, face_components
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

SEED_COSINE = 0.985  # neighbourhood normals of a seed add up to this share of their sum
GROW_COSINE = float(np.cos(np.radians(25.0)))
FIT_WAVES = 3  # rings of faces round a seed for the first plane
LEAST_AREA = 20.0  # square spacings of a plane
SAG = 3.5  # residuals: a region whose best quadric bends by more is curved (one cut off at three residuals by a curve bends by 4.5)
BEND, BEND_ENDED = 0.05, 1.2  # radians that normals may turn across a plane, and more where creases end it: narrow planes are rounded throughout
ERODED = 2  # rings of faces inside the border that are left out of it
BEYOND = 4  # rings of faces past the border where the surface must have turned away
GOES_ON = 1.5  # times the turn that the bend inside explains must be seen beyond the border
ENDS = 0.75  # share of the border where it has; the rest may run into a fillet
MAX_FAILURES = 400  # seeds in a row without a plane: what is left is curved
ISLAND_AREA = 12.0  # square spacings: larger pieces of free form are features
SPECK_AREA = 7.0  # square spacings: smaller pieces of a plane are not worth a face
PARALLEL = 0.94  # cosine of normals: planes nearer to parallel do not meet in a crease
MERGE_DEG = 12.0  # two neighbours under this angle are one plane or none
CORRELATED = 0.35  # of the noise stays in a denoised surface at long waves, where its vertices do not show it


@dataclass(frozen=True, kw_only=True)
class Scale:
    """spacing_m of the points.   residual_m : noise left in the vertices.   tolerance_m : farthest a vertex may lie off its plane."""

    spacing_m: float
    residual_m: float

    @property
    def tolerance_m(self) -> float:
        """Three residuals cover the vertices of a plane; a fiftieth of the spacing covers exact data."""
        return 3.0 * self.residual_m + 0.02 * self.spacing_m

    @property
    def loose_m(self) -> float:
        """Farthest off a plane that a vertex near a crease may lie."""
        return 1.5 * self.tolerance_m + 0.05 * self.spacing_m

    @property
    def strip_m(self) -> float:
        """The same for a narrow plane: its few points were not averaged and are drawn to its rims."""
        return 1.5 * self.tolerance_m + 0.25 * self.spacing_m

    @property
    def reach_m(self) -> float:
        """Farthest a vertex near a crease is moved: a crease is rounded over a spacing and hidden by the noise."""
        return 1.5 * self.spacing_m + 9.0 * self.residual_m


@dataclass(frozen=True, eq=False, kw_only=True)
class Labelled(Value):
    """label : (m,) plane of each face, -1 free form.   normal : (p, 3).   offset : (p,).   loose : (p,) how far off it its vertices may lie."""

    label: IntArray
    normal: FloatArray
    offset: FloatArray
    loose: FloatArray

    def plane(self, number: int) -> Plane:
        return Plane(normal=self.normal[number], offset=float(self.offset[number]))


class Neighbours:
    """Face neighbours of a closed manifold mesh and what is averaged over them."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self.table = edge_table(mesh.faces)
        self.of = self.table.twin.reshape(-1, 3) // 3  # (m, 3)
        self.areas = face_areas(mesh)
        self.normals = face_normals(mesh)

    def mean(self, values: FloatArray) -> FloatArray:
        """Each face's values (m, k), weighted by area, averaged with those of its neighbours."""
        weight = np.concatenate([self.areas[:, None], self.areas[self.of]], axis=1)
        stacked = np.concatenate([values[:, None], values[self.of]], axis=1)
        return np.asarray((stacked * weight[..., None]).sum(1) / np.maximum(weight.sum(1, keepdims=True), 1e-300))

    def wave(self, inside: BoolArray, front: IntArray) -> IntArray:
        """Faces next to `front` that are not yet inside."""
        near = np.unique(self.of[front])
        return near[~inside[near]]


def scale_of(mesh: TriangleMesh, neighbours: Neighbours, spacing_m: float, sigma_m: float) -> Scale:
    """The residual noise, from the height of vertices over the mean of their neighbours where the surface is flat."""
    edges = neighbours.table.edges
    n = len(mesh.vertices)
    valence = np.bincount(edges.ravel(), minlength=n)
    total = np.zeros((n, 3))
    for k in range(3):
        total[:, k] = np.bincount(edges[:, 0], weights=mesh.vertices[edges[:, 1], k], minlength=n)
        total[:, k] += np.bincount(edges[:, 1], weights=mesh.vertices[edges[:, 0], k], minlength=n)
    mean = total / np.maximum(valence, 1)[:, None]
    smooth = neighbours.mean(neighbours.mean(neighbours.normals))
    flatness = np.linalg.norm(smooth, axis=1)
    flat = np.flatnonzero(flatness >= np.median(flatness))
    normal = np.zeros((n, 3))
    normal[mesh.faces[flat].ravel()] = np.repeat(smooth[flat], 3, axis=0)
    rows = np.flatnonzero((np.abs(normal).sum(1) > 0) & (valence > 0))
    normal[rows] /= np.linalg.norm(normal[rows], axis=1, keepdims=True)
    height = np.einsum("ij,ij->i", mesh.vertices[rows] - mean[rows], normal[rows]) / np.sqrt(1 + 1 / valence[rows])
    high_waves = 1.4826 * float(np.median(np.abs(height))) if len(rows) else 0.0
    return Scale(spacing_m=spacing_m, residual_m=max(min(high_waves, 2 * sigma_m), CORRELATED * sigma_m, 0.005 * spacing_m))


def _grown(
    mesh: TriangleMesh, neighbours: Neighbours, smooth: FloatArray, free: BoolArray, seed: int, scale: Scale
) -> tuple[IntArray, Plane] | None:
    """The faces round `seed` within tolerance of one plane, and the plane, refitted each time the region has doubled."""
    inside = np.zeros(len(mesh.faces), bool)
    inside[seed] = True
    front = np.array([seed])
    for _ in range(FIT_WAVES):
        front = neighbours.wave(inside, front)
        front = front[free[front] & (smooth[front] @ smooth[seed] > GROW_COSINE)]
        inside[front] = True
    rows = np.flatnonzero(inside)
    if len(rows) < 6:
        return None
    plane = fit_plane(mesh.vertices[np.unique(mesh.faces[rows])], towards=smooth[seed])
    fitted = 0
    while True:
        start = rows[_fits(mesh, smooth, rows, plane, scale)]
        if not len(start):
            return None
        inside[rows] = False
        inside[start] = True
        front, pieces, count = start, [start], len(start)
        while len(front) and count <= 2 * max(fitted, len(start)):
            front = neighbours.wave(inside, front)
            front = front[free[front]]
            front = front[_fits(mesh, smooth, front, plane, scale)]
            inside[front] = True
            pieces.append(front)
            count += len(front)
        rows = np.concatenate(pieces)
        if len(rows) <= 1.02 * fitted and not len(front):
            return np.sort(rows), plane
        fitted = max(len(rows), fitted)
        plane = fit_plane(mesh.vertices[np.unique(mesh.faces[rows])], towards=plane.normal)


def _fits(mesh: TriangleMesh, smooth: FloatArray, rows: IntArray, plane: Plane, scale: Scale) -> BoolArray:
    """Which faces of `rows` have all corners within tolerance of the plane and look its way."""
    near = np.abs(plane.distance(mesh.vertices[mesh.faces[rows]])) <= scale.tolerance_m
    return np.asarray(near.all(1) & (smooth[rows] @ plane.normal > GROW_COSINE))


def _turned(neighbours: Neighbours, rows: IntArray, plane: Plane, least_rad: float) -> float:
    """Share of the area a few faces beyond the border that has turned by `least_rad`: a plane ends at creases, a curved surface goes on."""
    inside = np.zeros(len(neighbours.areas), bool)
    inside[rows] = True
    front = rows
    for _ in range(BEYOND):
        front = neighbours.wave(inside, front)
        inside[front] = True
    if not len(front):
        return 1.0
    area = neighbours.areas[front]
    return float(area[neighbours.normals[front] @ plane.normal < np.cos(least_rad)].sum() / area.sum())


def _inner_vertices(mesh: TriangleMesh, rows: IntArray) -> IntArray:
    """Vertices whose faces all belong to `rows`: those on the border are pulled towards what lies beyond."""
    all_faces = np.bincount(mesh.faces.ravel(), minlength=len(mesh.vertices))
    own = np.bincount(mesh.faces[rows].ravel(), minlength=len(mesh.vertices))
    return np.flatnonzero((own == all_faces) & (own > 0))


def _sag(points: FloatArray, plane: Plane) -> float:
    """Range of the best quadric over the points of a region, metres: what a bend adds to a plane."""
    u, v = ((points - points.mean(0)) @ plane.axes().T).T
    size = max(float(np.abs(u).max()), float(np.abs(v).max()), 1e-300)
    u, v = u / size, v / size
    basis = np.stack([np.ones(len(u)), u, v, u * u, u * v, v * v], axis=1)
    fit = basis @ np.linalg.lstsq(basis, plane.distance(points), rcond=None)[0]
    low, high = np.percentile(fit, [2, 98])
    return float(high - low)


def _bend(mesh: TriangleMesh, neighbours: Neighbours, smooth: FloatArray, rows: IntArray, plane: Plane) -> tuple[float, float]:
    """How far the normals turn from one end of a region to the other, radians, along the direction in which they turn most; and its width, metres.

    Read away from the border where the region is wide enough: creases are rounded and would turn the normals there.
    """
    axes = plane.axes()
    whole = mesh.vertices[mesh.faces[rows]].mean(1) @ axes.T
    inside = np.zeros(len(neighbours.areas), bool)
    inside[rows] = True
    inner = rows
    for _ in range(ERODED):
        inside[inner[~inside[neighbours.of[inner]].all(1)]] = False
        inner = inner[inside[inner]]
    rows = inner if len(inner) >= 12 else rows
    place, tilt = mesh.vertices[mesh.faces[rows]].mean(1) @ axes.T, smooth[rows] @ axes.T
    root = np.sqrt(neighbours.areas[rows])[:, None]
    place = place - np.average(place, axis=0, weights=root[:, 0] ** 2)
    slope = np.linalg.lstsq(place * root, (tilt - tilt.mean(0)) * root, rcond=None)[0]
    values, vectors = np.linalg.eigh((slope + slope.T) / 2)
    width = np.ptp(whole @ vectors, axis=0)
    most = int((np.abs(values) * width).argmax())
    return float(abs(values[most]) * width[most]), float(width[most])


def _ends_at_creases(mesh: TriangleMesh, neighbours: Neighbours, smooth: FloatArray, rows: IntArray, plane: Plane, scale: Scale) -> bool:
    """Is the region flat inside and turned away from outside, by more than a surface that goes on bending as it does inside?"""
    bend, width = _bend(mesh, neighbours, smooth, rows, plane)
    goes_on = bend / max(width, 1e-300) * (width / 2 + BEYOND * 0.8 * scale.spacing_m)
    ended = _turned(neighbours, rows, plane, max(float(np.arccos(GROW_COSINE)), GOES_ON * goes_on))
    return bend <= BEND + BEND_ENDED * (ended - ENDS)


def grow_planes(mesh: TriangleMesh, neighbours: Neighbours, scale: Scale) -> Labelled:
    """Planes large enough to be sure of, flattest seeds first. Faces near creases and narrow faces stay -1."""
    label = np.full(len(mesh.faces), -1, np.int64)
    smooth = neighbours.mean(neighbours.mean(neighbours.normals))
    flatness = np.linalg.norm(neighbours.mean(smooth), axis=1)
    smooth = smooth / np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-300)
    tried = flatness < SEED_COSINE
    planes: list[Plane] = []
    failures = 0
    for seed in np.argsort(-flatness, kind="stable"):
        if tried[seed] or failures > MAX_FAILURES:
            continue
        tried[seed] = True
        grown = _grown(mesh, neighbours, smooth, label < 0, int(seed), scale)
        if grown is None:
            continue
        rows, plane = grown
        tried[rows] = True
        inner = _inner_vertices(mesh, rows)
        failures += 1
        if neighbours.areas[rows].sum() < LEAST_AREA * scale.spacing_m**2 or len(inner) < 6:
            continue
        sag = _sag(mesh.vertices[np.unique(mesh.faces[rows])], plane)
        if sag > SAG * scale.residual_m + 0.01 * scale.spacing_m:
            continue
        if not _ends_at_creases(mesh, neighbours, smooth, rows, plane, scale):
            continue
        failures = 0
        plane = fit_plane(mesh.vertices[inner], towards=plane.normal)
        label[rows] = len(planes)
        planes.append(plane)
    normal, offset = np.array([p.normal for p in planes]).reshape(-1, 3), np.array([p.offset for p in planes])
    return Labelled(label=label, normal=normal, offset=offset, loose=np.full(len(planes), scale.loose_m))


def absorbed(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale) -> Labelled:
    """Faces between planes given to the nearest one where every vertex lies on it or on another plane next to the gap that is not parallel to it:
    the chamfers by which a reconstruction cuts off its creases.
    """
    label = labelled.label.copy()
    n_planes = len(labelled.offset)
    if not n_planes:
        return labelled
    on = np.abs(mesh.vertices @ labelled.normal.T - labelled.offset) <= labelled.loose  # (n, p)
    meets = (np.abs(labelled.normal @ labelled.normal.T) < PARALLEL) | np.eye(n_planes, dtype=bool)
    centre = mesh.vertices[mesh.faces].mean(1)
    for _ in range(200):
        front = np.flatnonzero((label < 0) & (label[neighbours.of] >= 0).any(1))
        if not len(front):
            break
        part = np.full(len(label), -1, np.int64)
        part[label < 0] = face_components(mesh.faces[label < 0])[1]
        around = planes_around(label, neighbours.of, part, n_planes)[part[front]]
        best, best_cost = np.full(len(front), -1, np.int64), np.full(len(front), np.inf)
        for side in range(3):
            k = label[neighbours.of[front, side]]
            usable = (around & meets[k])[:, None, :]
            covered = (on[mesh.faces[front]] & usable).any(2).all(1)
            height = np.abs(np.einsum("ij,ij->i", centre[front], labelled.normal[k]) - labelled.offset[k])
            facing = np.einsum("ij,ij->i", neighbours.normals[front], labelled.normal[k])
            fits = (k >= 0) & covered & (height <= scale.reach_m)
            cost = np.where(fits, height + 0.5 * scale.spacing_m * (1 - facing), np.inf)
            better = cost < best_cost
            best[better], best_cost[better] = k[better], cost[better]
        taken = best >= 0
        if not taken.any():
            break
        label[front[taken]] = best[taken]
    return replace(labelled, label=label)


def merged(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale) -> Labelled:
    """Neighbouring regions of one plane made one: those whose joint fit holds the vertices of both. Of two that are nearly parallel yet not one
    plane the smaller becomes free form: their line of intersection would be anywhere.
    """
    label = labelled.label.copy()
    normal, offset = labelled.normal.copy(), labelled.offset.copy()
    while True:
        a, b = label[neighbours.table.twin // 3], np.repeat(label, 3)
        pairs = np.unique(np.stack([a, b], axis=1)[(a < b) & (a >= 0)], axis=0)
        close = pairs[np.einsum("ij,ij->i", normal[pairs[:, 0]], normal[pairs[:, 1]]) > np.cos(np.radians(MERGE_DEG))] if len(pairs) else pairs
        if not len(close):
            return replace(labelled, label=label, normal=normal, offset=offset)
        i, j = close[0]
        rows = np.flatnonzero((label == i) | (label == j))
        inner = _inner_vertices(mesh, rows)
        if len(inner) >= 3:
            plane = fit_plane(mesh.vertices[inner], towards=normal[i])
            far = [np.percentile(np.abs(plane.distance(mesh.vertices[mesh.faces[label == k]].reshape(-1, 3))), 90) for k in (i, j)]
        if len(inner) >= 3 and max(far) <= max(labelled.loose[i], labelled.loose[j]):
            label[rows] = i
            normal[i], offset[i] = plane.normal, plane.offset
        else:
            areas = [neighbours.areas[label == k].sum() for k in (i, j)]
            label[label == (i, j)[int(areas[1] < areas[0])]] = -1


def planes_around(label: IntArray, of: IntArray, part: IntArray, n_planes: int) -> BoolArray:
    """(parts, planes) True where a plane borders an unlabelled part."""
    out = np.zeros((int(part.max(initial=-1)) + 1, n_planes), bool)
    face, side = np.nonzero((part >= 0)[:, None] & (label[of] >= 0))
    out[part[face], label[of[face, side]]] = True
    return out


def without_islands(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale) -> Labelled:
    """Islands of free form whose vertices all lie near the planes around them, face by face given to the nearest of these.

    Near: within reach for a small island, within the noise for a large one (a fillet is larger and farther). A small one inside a single plane is
    filled however deep it is: nothing of its size can be told from an outlier. Not where two of the planes are parallel: between the sides of a
    plate the island is the wall of a hole.
    """
    label = labelled.label.copy()
    free = np.flatnonzero(label < 0)
    if not len(free) or not len(labelled.offset):
        return labelled
    n_parts, part = face_components(mesh.faces[free])
    area = np.bincount(part, weights=neighbours.areas[free], minlength=n_parts)
    order = np.argsort(part, kind="stable")
    start = np.searchsorted(part[order], np.arange(n_parts + 1))
    for number in range(n_parts):
        rows = free[order[start[number] : start[number + 1]]]
        names = np.unique(label[neighbours.of[rows]])
        names = names[names >= 0]
        cosine = np.abs(labelled.normal[names] @ labelled.normal[names].T)
        if not len(names) or (cosine - np.eye(len(names)) > PARALLEL).any():
            continue
        gap = np.abs(mesh.vertices[mesh.faces[rows]] @ labelled.normal[names].T - labelled.offset[names])  # (f, 3, p)
        small = area[number] < ISLAND_AREA * scale.spacing_m**2
        if (small and len(names) == 1) or gap.min(2).max() <= (scale.reach_m if small else scale.strip_m):
            label[rows] = names[gap.max(1).argmin(1)]
    return replace(labelled, label=label)


def tidied(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale) -> Labelled:
    """Specks of planes given to the neighbour with the longest common border that they lie near to."""
    label = labelled.label.copy()
    lengths = np.linalg.norm(mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, -1, axis=1)], axis=2)
    for _ in range(6):
        same = label[neighbours.table.twin // 3] == np.repeat(label, 3)
        joined = np.zeros(len(neighbours.table.edges), bool)
        joined[neighbours.table.edge_of[same]] = True
        n, part = face_components(mesh.faces, joined)
        area = np.bincount(part, weights=neighbours.areas, minlength=n)
        small = (area[part] < SPECK_AREA * scale.spacing_m**2) & (label >= 0)
        before = label.copy()
        for number in np.unique(part[small]):
            rows = np.flatnonzero(part == number)
            label[rows] = _best_neighbour(mesh, neighbours, labelled, label, rows, lengths, scale.reach_m)
        if np.array_equal(label, before):
            break
    return replace(labelled, label=label)


def _best_neighbour(
    mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, label: IntArray, rows: IntArray, lengths: FloatArray, reach: float
) -> int:
    """The label with the longest common border with `rows`; -1 if they lie too far from that plane."""
    beyond = label[neighbours.of[rows]].ravel()
    other = beyond != label[rows[0]]
    if not other.any():
        return int(label[rows[0]])
    names, index = np.unique(beyond[other], return_inverse=True)
    winner = int(names[np.bincount(index, weights=lengths[rows].ravel()[other]).argmax()])
    if winner >= 0 and np.abs(mesh.vertices[mesh.faces[rows]] @ labelled.normal[winner] - labelled.offset[winner]).max() > reach:
        return -1
    return winner


def one_piece_each(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled) -> Labelled:
    """Pieces of one plane that do not touch become regions of their own, numbered by first face."""
    label = labelled.label
    same = label[neighbours.table.twin // 3] == np.repeat(label, 3)
    joined = np.zeros(len(neighbours.table.edges), bool)
    joined[neighbours.table.edge_of[same]] = True
    _, part = face_components(mesh.faces, joined)
    on_plane = np.flatnonzero(label >= 0)
    if not len(on_plane):
        return Labelled(label=label, normal=np.zeros((0, 3)), offset=np.zeros(0), loose=np.zeros(0))
    _, first, packed = np.unique(part[on_plane], return_index=True, return_inverse=True)
    out = np.full(len(label), -1, np.int64)
    out[on_plane] = packed
    old = label[on_plane[first]]
    return Labelled(label=out, normal=labelled.normal[old], offset=labelled.offset[old], loose=labelled.loose[old])
