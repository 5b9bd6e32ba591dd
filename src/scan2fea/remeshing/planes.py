"""Which faces of a noisy surface lie on planes: grown from flat places and tested for bend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.primitives import Plane, fit_plane
from scan2fea.kernel.topology import edge_table
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


def inner_vertices(mesh: TriangleMesh, rows: IntArray) -> IntArray:
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
        inner = inner_vertices(mesh, rows)
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
