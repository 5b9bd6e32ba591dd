"""A surface moved to where the ranges say it is, all rays at once.

Every ray that hits the surface asks its face to move by what the range says, along the ray, where the noise is: averaged over a face the noise
goes, and nothing is drawn inwards at edges or bends, as averages of points are. Rays that should hit and do not, or should pass and do not, draw
the rim across themselves: that places edges between pixels. Faces turn towards the mean of those that face alike (normals filtered across faces
first, vertices fitted to them afterwards: Sun, Rosin, Martin, Langbein 2007), which costs nothing where a whole plane moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import cg

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.rays import RayScene, first_hits, scene_of
from scan2fea.reconstruction.raster import Images
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

ROUNDS = 12
FLATNESS = 5.0  # weight of the turning faces against their rays
FILTER_ROUNDS = 6
ALIKE_FIRST, ALIKE_LAST = 0.6, 0.3  # length of the difference of two normals that are taken as alike: rough at first
GRAZING = 0.1  # squared cosine: a ray nearer to the surface says no more
FAR_SIGMAS = 3.5  # a range farther off is of another surface
RIM = 2.0  # a ray draws a rim at most this many pixels
PLACES = 13  # along a ray that misses, within 3 sigma of its range
STEP = 0.3  # edges that a vertex may move in one round
HOLD = 0.01  # weight that keeps vertices where no ray says anything
RELAX = 0.4
HELD = 0.1  # share of the normals round a vertex that bind a direction


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit(Value):
    """mesh : the surface.   face : (m,) the face each ray meets, -1.   off_m : (m,) range minus the way to the surface, nan where either is none."""

    mesh: TriangleMesh
    face: IntArray
    off_m: FloatArray


class _Matrix:
    """The normal equations of one round: one number per vertex, along its normal."""

    def __init__(self, mesh: TriangleMesh, along: FloatArray) -> None:
        self.faces, self.along = mesh.faces, along
        n = len(mesh.vertices)
        self.left: csr_array = csr_array((n, n))
        self.right: FloatArray = np.zeros(n)

    def ask(self, face: IntArray, weights: FloatArray, direction: FloatArray, move: FloatArray, price: FloatArray | float) -> None:
        """Places on faces, given by corner weights (k, 3), asked to move by `move` (k,) along `direction` (k, 3)."""
        value = weights * np.einsum("ikj,ij->ik", self.along[self.faces[face]], direction)
        self.ask_corners(self.faces[face], value, move, np.broadcast_to(np.asarray(price, float), len(move)))

    def ask_corners(self, corner: IntArray, value: FloatArray, move: FloatArray, price: FloatArray) -> None:
        k = len(move)
        rows = csr_array((value.ravel(), corner.ravel(), np.arange(0, 3 * k + 1, 3)), shape=(k, len(self.right)))
        self.left = csr_array(self.left + rows.T @ diags_array(price) @ rows)
        self.right = np.asarray(self.right + rows.T @ (price * move))

    def solved(self, hold: float) -> FloatArray:
        left = (self.left + hold * eye_array(len(self.right))).tocsr()
        return np.asarray(cg(left, self.right, rtol=1e-5, maxiter=150, M=diags_array(1.0 / left.diagonal()))[0])


def range_fit(mesh: TriangleMesh, images: Images, sigma_m: float, flatness: float = FLATNESS) -> Fit:
    """The surface that the ranges of `images` know best. mesh : closed, near it.   sigma_m : noise along the rays. Faces stay as they are."""
    vertices, faces = mesh.vertices.copy(), mesh.faces
    beside = _face_neighbours(faces, len(vertices))
    round_vertex = _vertex_means(faces, len(vertices))
    pixel = images.pitch_rad * float(np.median(images.range_m[images.is_hit]))
    for n in range(ROUNDS):
        now = TriangleMesh(vertices=vertices, faces=faces)
        areas, normals = face_areas(now), face_normals(now)
        alike = ALIKE_FIRST + (ALIKE_LAST - ALIKE_FIRST) * min(1.0, n / (ROUNDS - 4))
        smooth = _filtered(normals, areas, beside, alike)
        along = _vertex_normals(faces, smooth, areas, len(vertices))
        matrix = _Matrix(now, along)
        scene = scene_of(now)
        way, face = first_hits(scene, images.origin, images.direction)
        told = _ask_ranges(matrix, now, normals, images, way, face, sigma_m)
        _ask_rims(matrix, now, normals, images, way, face, scene, sigma_m, pixel)
        trust = told / areas.sum() / sigma_m**2  # of the rays of one square metre
        _ask_flat(matrix, now, smooth, flatness * trust * areas / 3.0)
        move = matrix.solved(HOLD * trust * areas.sum() / len(vertices))
        edge = float(np.sqrt(2.3 * areas.mean()))
        vertices = vertices + np.clip(move, -STEP * edge, STEP * edge)[:, None] * along
        vertices = _relaxed(vertices, faces, smooth, areas, round_vertex)
    return measured(TriangleMesh(vertices=vertices, faces=faces), images)


def measured(mesh: TriangleMesh, images: Images) -> Fit:
    """What the rays say of a surface as it is."""
    way, face = first_hits(scene_of(mesh), images.origin, images.direction)
    return Fit(mesh=mesh, face=face, off_m=np.where(face >= 0, images.range_m - np.where(np.isfinite(way), way, 0.0), np.nan))


def _ask_ranges(matrix: _Matrix, mesh: TriangleMesh, normals: FloatArray, images: Images, way: FloatArray, face: IntArray, sigma_m: float) -> int:
    """Each hit asks for its range, in units of its noise across the face; returns how many do."""
    rays = np.flatnonzero(images.is_hit & (face >= 0))
    off = images.range_m[rays] - way[rays]
    cosine = np.einsum("ij,ij->i", images.direction[rays], normals[face[rays]])
    use = (np.abs(off) < FAR_SIGMAS * sigma_m) & (cosine < 0)
    rays, off, cosine = rays[use], off[use], cosine[use]
    place = images.origin[rays] + way[rays, None] * images.direction[rays]
    weights = _corner_weights(mesh, face[rays], place)
    matrix.ask(face[rays], weights, normals[face[rays]], off * cosine, 1.0 / (sigma_m**2 * np.maximum(cosine**2, GRAZING)))
    return len(rays)


def _ask_rims(
    matrix: _Matrix, mesh: TriangleMesh, normals: FloatArray, images: Images, way: FloatArray, face: IntArray,
    scene: RayScene, sigma_m: float, pixel: float,
) -> None:  # fmt: skip
    """Rims drawn out to rays that came back but miss the surface, and in to rays that did not but meet it."""
    near = PointToMesh(mesh)
    lost = np.flatnonzero(images.is_hit & (face < 0))
    steps = np.linspace(-3.0, 3.0, PLACES) * sigma_m
    along = (images.range_m[lost, None] + steps)[..., None] * images.direction[lost, None] + images.origin[lost, None]
    best = near.nearest(along.reshape(-1, 3)).distance.reshape(-1, PLACES).argmin(axis=1)
    goals = [along[np.arange(len(lost)), best]]
    stopped = np.flatnonzero(~images.is_hit & (face >= 0))
    enter = images.origin[stopped] + way[stopped, None] * images.direction[stopped]
    leave, _ = first_hits(scene, enter + 1e-3 * pixel * images.direction[stopped], images.direction[stopped])
    goals.append(enter + 0.5 * np.where(np.isfinite(leave), leave, 0.0)[:, None] * images.direction[stopped])
    goal = np.concatenate(goals)
    if not len(goal):
        return
    found = near.nearest(goal)
    use = found.distance < RIM * pixel
    move, on = (goal - found.closest)[use], found.face[use]
    length = np.linalg.norm(move, axis=1)
    direction = np.where(length[:, None] > 1e-6 * pixel, move / np.maximum(length, np.finfo(float).tiny)[:, None], normals[on])
    matrix.ask(on, found.weights[use], direction, length, (2.0 / pixel) ** 2)


def _ask_flat(matrix: _Matrix, mesh: TriangleMesh, smooth: FloatArray, price: FloatArray) -> None:
    """The corners of each face on the plane of its smoothed normal through its middle."""
    corners = mesh.vertices[mesh.faces]
    height = np.einsum("ikj,ij->ik", corners - corners.mean(axis=1, keepdims=True), smooth)
    rise = np.einsum("ikj,ij->ik", matrix.along[mesh.faces], smooth)
    for k in range(3):
        value = -rise / 3.0
        value[:, k] += rise[:, k]
        matrix.ask_corners(mesh.faces, value, -height[:, k], price)


def _face_neighbours(faces: IntArray, n_vertices: int) -> tuple[IntArray, IntArray]:
    """Pairs of faces that share a vertex, each face with itself among them."""
    m = len(faces)
    at = csr_array((np.ones(3 * m), (np.repeat(np.arange(m), 3), faces.ravel())), shape=(m, n_vertices))
    pairs = (at @ at.T).tocoo()
    return np.asarray(pairs.coords[0], np.int64), np.asarray(pairs.coords[1], np.int64)


def _vertex_means(faces: IntArray, n_vertices: int) -> csr_array:
    """The matrix that takes each vertex to the mean of its neighbours."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ones = coo_array((np.ones(2 * len(edges)), (np.r_[edges[:, 0], edges[:, 1]], np.r_[edges[:, 1], edges[:, 0]])), shape=(n_vertices, n_vertices))
    joined = ones.tocsr()
    joined.data[:] = 1.0
    return csr_array(diags_array(1.0 / np.maximum(joined.sum(axis=1), 1.0)) @ joined)


def _filtered(normals: FloatArray, areas: FloatArray, beside: tuple[IntArray, IntArray], alike: float) -> FloatArray:
    """Normals averaged with those of neighbours that face alike, by area."""
    i, j = beside
    now = normals
    for _ in range(FILTER_ROUNDS):
        weight = areas[j] * np.exp(-((now[i] - now[j]) ** 2).sum(axis=1) / (2.0 * alike**2))
        total = np.stack([np.bincount(i, weight * now[j, k], len(now)) for k in range(3)], axis=1)
        now = total / np.maximum(np.linalg.norm(total, axis=1), np.finfo(float).tiny)[:, None]
    return now


def _vertex_normals(faces: IntArray, normals: FloatArray, areas: FloatArray, n_vertices: int) -> FloatArray:
    total = np.stack([np.bincount(faces.ravel(), np.repeat(normals[:, k] * areas, 3), n_vertices) for k in range(3)], axis=1)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1), np.finfo(float).tiny)[:, None])


def _relaxed(vertices: FloatArray, faces: IntArray, normals: FloatArray, areas: FloatArray, round_vertex: csr_array) -> FloatArray:
    """Vertices moved towards the middle of their neighbours in the directions that no face round them binds: along faces and along creases."""
    spread = areas[:, None] * np.stack([normals[:, a] * normals[:, b] for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))], axis=1)
    moment = np.stack([np.bincount(faces.ravel(), np.repeat(spread[:, k], 3), len(vertices)) for k in range(6)], axis=1)
    values, axes = np.linalg.eigh(moment[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3))
    free: BoolArray = values < HELD * values.sum(axis=1, keepdims=True)
    part = np.einsum("nij,ni->nj", axes, round_vertex @ vertices - vertices) * free
    return np.asarray(vertices + RELAX * np.einsum("nij,nj->ni", axes, part))


def _corner_weights(mesh: TriangleMesh, face: IntArray, place: FloatArray) -> FloatArray:
    """(k, 3) barycentric coordinates of places on faces."""
    a, b, c = (mesh.vertices[mesh.faces[face, k]] for k in range(3))
    u, v, w = b - a, c - a, place - a
    uu, vv, uv = (u * u).sum(axis=1), (v * v).sum(axis=1), (u * v).sum(axis=1)
    wu, wv = (w * u).sum(axis=1), (w * v).sum(axis=1)
    scale = np.maximum(uu * vv - uv * uv, np.finfo(float).tiny)
    p, q = (vv * wu - uv * wv) / scale, (uu * wv - uv * wu) / scale
    weights = np.clip(np.stack([1.0 - p - q, p, q], axis=1), 0.0, 1.0)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
