"""Free form that is smooth at the spacing of its points: the surface of least variation of curvature through them, over what nobody saw too.

A triangle through three points of a round face lies under it, and a cap over a gap is flat: a coarse scan of a ball loses a tenth of its volume. Here
the triangles of a first surface are divided, and its curvature varies as little as the points let it (squares of the slopes of the Laplacian of its
places; Moreton, Sequin 1992, on the triangles as they lie), so it bulges between points and over gaps as it does beside them. How closely it follows
the points is told by points that are held out, and so is whether the part is smooth at all; what gaps may hide is told by others as wide, made where
points are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.distances import Nearest, PointToMesh
from scan2fea.kernel.measures import face_areas, face_normals, volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import half_edges
from scan2fea.reconstruction.evidence import mm
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.gates_planar import BEND_SPACING, EXCESS
from scan2fea.reconstruction.gates_smooth import gates_smooth
from scan2fea.reconstruction.visibility import Reconstruction
from scan2fea.types import BoolArray, FloatArray, IntArray, Scan, TriangleMesh, Value

EDGE = 0.3  # spacings: triangles are divided until half of their edges are shorter
MOST_FACES = 40_000  # a scan that needs more is dense: what is cut off between its points is little
LENGTHS = (0.25, 0.5, 1.0)  # spacings over which curvature may be evened out: that which foretells held-out points best
ORDER = 3  # of the Laplacian between places and places: its slopes squared
FOLDS = 5
HOPELESS = 2.0  # times the scatter of held-out points that is allowed
AGAIN = 2  # times that the surface found is the one on which bending is measured
LEAST_AREA = 1e-3  # of the mean: a corner's share of the area is taken as at least that
GAP = 2.0  # spacings from all points: random ones leave exp(-0.85 pi 4) = 2e-5 of a surface so bare
TRIALS = 6  # gaps made where points are, for each gap


@dataclass(frozen=True, eq=False, kw_only=True)
class _Plate(Value):
    """What bends.   mesh : its triangles as they lie.   bending : (v, v).   at : (n, v) weights of the vertices at the foot of each point.

    points : (n, 3) measured.   spacing_m : their spacing.
    """

    mesh: TriangleMesh
    bending: csc_array
    at: csc_array
    points: FloatArray
    spacing_m: float

    @classmethod
    def of(cls, mesh: TriangleMesh, points: FloatArray, spacing_m: float) -> _Plate:
        near = PointToMesh(mesh).nearest(points)
        corner = (np.repeat(np.arange(len(points)), 3), mesh.faces[near.face].ravel())
        at = coo_array((near.weights.ravel(), corner), shape=(len(points), len(mesh.vertices))).tocsc()
        return cls(mesh=mesh, bending=_bending(mesh), at=at, points=points, spacing_m=spacing_m)

    def through(self, used: BoolArray, length_m: float) -> TriangleMesh:
        """The least of squared distances from the points used (n,), each over a squared spacing, and length^6 x squared slopes of curvature."""
        weight = used * self.spacing_m**2
        matrix = self.at.T @ diags_array(weight) @ self.at + length_m ** (2 * ORDER) * self.bending
        solver = splu(csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        return replace(self.mesh, vertices=solver.solve(self.at.T @ (weight[:, None] * self.points)))

    def held_out(self, length_m: float) -> FloatArray:
        """(n,) signed distance of each point, outside positive, from the surface through those of the other folds."""
        fold = np.random.default_rng(0).permutation(len(self.points)) % FOLDS
        out = np.zeros(len(self.points))
        for k in range(FOLDS):
            mesh = self.through(fold != k, length_m)
            out[fold == k] = _signed(mesh, PointToMesh(mesh).nearest(self.points[fold == k]), self.points[fold == k])
        return out


def served_smooth(scan: Scan, first: Reconstruction) -> Reconstruction:
    """The smooth surface where points that are held out show the part to be smooth, and nothing is said against it; else the first one."""
    if first.source != "sensors" or first.how["method"] != "visibility" or len(first.carried):
        return first
    try:
        smooth = rounded(scan, first)
    except ReconstructionError as error:
        return replace(first, how={**first.how, "not_smooth": str(error)})
    against = failed(smooth.checks)
    return replace(first, how={**first.how, "not_smooth": "; ".join(check.name for check in against)}) if against else smooth


def rounded(scan: Scan, first: Reconstruction) -> Reconstruction:
    """The smooth surface over a first one. Raises ReconstructionError where there is none, or points that are held out lie beside it."""
    cloud, h = scan.cloud, first.spacing_m
    points = cloud.points if cloud.is_inferred is None else cloud.points[~cloud.is_inferred]
    plate = _Plate.of(divided(first.mesh, EDGE * h), points, h)
    tried: dict[float, FloatArray] = {}
    for length in LENGTHS:
        tried[length] = plate.held_out(length * h)
        scatter = float(np.sqrt(np.mean(np.square(tried[length]))))
        has_edges = scatter > HOPELESS * (EXCESS * first.sigma_m + BEND_SPACING * h)
        require(not has_edges, ReconstructionError, f"points held out lie {mm(scatter)} off the smooth surface through the others: it has edges")
    length = min(tried, key=lambda of: float(np.square(tried[of]).mean()))
    every = np.ones(len(points), bool)
    for _ in range(AGAIN):
        plate = _Plate.of(plate.through(every, length * h), points, h)
    mesh = plate.through(every, length * h)
    require(not len(self_intersections(mesh)), ReconstructionError, "the smooth surface crosses itself: walls are too thin for this spacing")
    gaps_m3 = _under_gaps(plate, mesh, length * h)
    facts: Mapping[str, float | str] = {**first.how, "method": "smooth", "first_volume_m3": volume(first.mesh), "evened_m": length * h}
    residual = float(np.std(_signed(mesh, PointToMesh(mesh).nearest(points), points)))
    return replace(first, mesh=mesh, checks=gates_smooth(scan, first, mesh, tried[length], gaps_m3), how=facts, residual_m=residual)


def divided(mesh: TriangleMesh, edge_m: float) -> TriangleMesh:
    """Every triangle in four, at the middles of its edges, until the median edge is at most `edge_m`.

    Raises ReconstructionError beyond MOST_FACES.
    """
    while True:
        ends = half_edges(mesh.faces)
        if np.median(np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)) <= edge_m:
            return mesh
        require(4 * len(mesh.faces) <= MOST_FACES, ReconstructionError, f"the scan is dense: {4 * len(mesh.faces)} triangles, limit {MOST_FACES}")
        edges, number = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
        (a, b, c), (ab, bc, ca) = mesh.faces.T, (len(mesh.vertices) + number.reshape(-1, 3)).T
        faces = np.concatenate([np.stack(f, axis=1) for f in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
        mesh = TriangleMesh(vertices=np.concatenate([mesh.vertices, mesh.vertices[edges].mean(axis=1)]), faces=faces)


def _bending(mesh: TriangleMesh) -> csc_array:
    """(v, v) K with X' K X the integral of the squared slope of the Laplacian of X over the mesh: cotangents, areas lumped at corners."""
    v, n = mesh.vertices, len(mesh.vertices)
    areas = np.maximum(face_areas(mesh), np.finfo(float).tiny)
    rows: list[IntArray] = []
    cols: list[IntArray] = []
    values: list[FloatArray] = []
    for k in range(3):
        o, i, j = (mesh.faces[:, (k + s) % 3] for s in range(3))
        half = 0.25 * np.einsum("ij,ij->i", v[i] - v[o], v[j] - v[o]) / areas
        rows += [i, j, i, j]
        cols += [j, i, i, j]
        values += [-half, -half, half, half]
    slope = coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=(n, n)).tocsc()
    share = np.bincount(mesh.faces.ravel(), np.repeat(areas / 3.0, 3), minlength=n)
    per_area = diags_array(1.0 / np.maximum(share, LEAST_AREA * share.mean()))
    return csc_array(slope @ per_area @ slope @ per_area @ slope)


def _under_gaps(plate: _Plate, mesh: TriangleMesh, length_m: float) -> float:
    """What gaps may hide, m^3: twice the root mean square of what others as wide, made where points are, change the volume by, summed.

    A gap is a ball that holds no point, farther than GAP spacings from them at its middle.
    """
    tree, places = cKDTree(plate.points), mesh.vertices[mesh.faces].mean(axis=1)
    clear = np.asarray(tree.query(places)[0])
    body, total = volume(mesh), 0.0
    rows = np.argsort(-clear, kind="stable")
    while len(rows) and clear[rows[0]] > GAP * plate.spacing_m:
        gap = float(clear[rows[0]])
        rows = rows[np.linalg.norm(places[rows] - places[rows[0]], axis=1) > gap]
        changes = [volume(plate.through(np.linalg.norm(plate.points - p, axis=1) > gap, length_m)) - body for p in _apart(plate.points)]
        total += 2.0 * float(np.sqrt(np.mean(np.square(changes))))
    return total


def _apart(points: FloatArray) -> FloatArray:
    """(TRIALS, 3) of the points, each as far from those before it as can be."""
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    for _ in range(TRIALS - 1):
        chosen.append(int(np.argmax(np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1))))
    return points[chosen]


def _signed(mesh: TriangleMesh, near: Nearest, points: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", points - near.closest, face_normals(mesh)[near.face]))
