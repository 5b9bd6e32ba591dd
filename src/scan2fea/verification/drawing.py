"""Nominal against scanned: how far the measured points lie from the faces of a drawing that was laid onto them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.coverage import NOISE_SIGMAS, is_unmeasured
from scan2fea.kernel.distances import Nearest, PointToMesh, signs
from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.normals import pca_normals
from scan2fea.kernel.topology import edge_table
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

# ISO 2768-1, class m (medium), linear sizes: up to so many metres, plus or minus so many; drawings without tolerances of their own are read by it
ISO_2768_M = ((0.006, 1e-4), (0.03, 2e-4), (0.12, 3e-4), (0.4, 5e-4), (1.0, 8e-4), (2.0, 1.2e-3), (np.inf, 2e-3))
AROUND = 16  # points whose mean is held against the tolerance: their noise is a quarter of one point's
ON_RIM = 1e-9  # barycentric weight of a corner below which a place lies on the edge across from it
LIKE_IT = 0.7  # cosine between the plane of the neighbours of a point and a face: 45 degrees
SHARE_OUT = 0.01  # of the points of a face: so many beyond the tolerance are more than the tails of the noise


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnFace(Value):
    """One face of the drawing. mean_m, std_m : of the signed distances of its points, positive where there is more material than drawn, nan where it
    has none; p95_m : 95 % of them lie nearer.   is_seen : next to no point lies on a face that is not.
    share_out : of its points, where the mean of 16 neighbours is beyond the tolerance and three standard deviations.
    """

    name: str
    kind: str
    area_m2: float
    centre_m: FloatArray
    n_points: int
    is_seen: bool
    mean_m: float
    std_m: float
    p95_m: float
    share_out: float

    @property
    def is_out(self) -> bool:
        return self.is_seen and self.share_out > SHARE_OUT


@dataclass(frozen=True, eq=False, kw_only=True)
class AsBuilt(Value):
    """deviation_m : (n,) of each point from the drawing, signed.   local_m : (n,) mean of 16 neighbours on the same face.   face : (n,) the nearest.
    share_out : of all points, as of a face.
    """

    faces: tuple[DrawnFace, ...]
    deviation_m: FloatArray
    local_m: FloatArray
    face: IntArray
    tolerance_m: float
    share_out: float

    @property
    def fits(self) -> bool:
        """Whether it is a drawing of this part at all: most of what was measured lies on it."""
        return self.share_out < 0.5


def general_tolerance(size_m: float) -> float:
    """Plus or minus, metres, of a part whose largest extent is `size_m` (ISO 2768-1, class m)."""
    return next(give for up_to, give in ISO_2768_M if size_m <= up_to)


def as_built(
    points: FloatArray, drawing: TriangleMesh, face_of: IntArray, names: Sequence[str], kinds: Sequence[str], tolerance_m: float, noise_m: FloatArray
) -> AsBuilt:
    """(n, 3) measured points against a closed drawing in the same frame.   face_of : (m,) the face of each triangle, an index into names and kinds.

    A point beyond the border of the face that it is nearest to, or whose neighbours lie across that face, tells of a face beside it, and is counted
    to none.
    noise_m : (2,) standard deviations: of a point by itself, and of what neighbours share (places of the scans).
    """
    near = PointToMesh(drawing).nearest(points)
    deviation = near.distance * signs(points, drawing, near)
    turned = np.abs(np.einsum("ij,ij->i", pca_normals(points, AROUND), face_normals(drawing)[near.face])) < LIKE_IT
    face, beyond = face_of[near.face], turned | _beyond(near, drawing, face_of)
    local, n_local = _local_means(points, deviation, face)
    is_out = np.asarray(np.abs(local) > tolerance_m + NOISE_SIGMAS * np.hypot(noise_m[0] / np.sqrt(n_local), noise_m[1]))
    areas = face_areas(drawing)
    density = len(points) / float(areas.sum())
    middle = drawing.vertices[drawing.faces].mean(axis=1)

    def of(number: int) -> DrawnFace:
        own, triangles = (face == number) & ~beyond, face_of == number
        area = float(areas[triangles].sum())
        return _face(
            deviation[own], is_out[own], name=names[number], kind=kinds[number], area_m2=area,
            centre_m=np.average(middle[triangles], axis=0, weights=areas[triangles]), is_seen=not is_unmeasured(area, int(own.sum()), density),
        )  # fmt: skip

    faces = tuple(of(number) for number in range(len(names)))
    return AsBuilt(faces=faces, deviation_m=deviation, local_m=local, face=face, tolerance_m=tolerance_m, share_out=float(is_out.mean()))


def _beyond(near: Nearest, drawing: TriangleMesh, face_of: IntArray) -> BoolArray:
    """(n,) whose closest place lies on a border between two faces."""
    twin = edge_table(drawing.faces).twin
    half = np.arange(len(twin))
    is_border = (twin < 0) | (face_of[half // 3] != face_of[np.maximum(twin, 0) // 3])
    is_corner = np.zeros(len(drawing.vertices), bool)
    is_corner[drawing.faces.ravel()[is_border]] = True
    is_corner[np.roll(drawing.faces, -1, axis=1).ravel()[is_border]] = True
    rim = near.weights <= ON_RIM
    out = np.zeros(len(near.face), bool)
    for k in range(3):
        out |= (rim.sum(axis=1) == 1) & rim[:, k] & is_border[near.face * 3 + (k + 1) % 3]
        out |= (rim.sum(axis=1) == 2) & ~rim[:, k] & is_corner[drawing.faces[near.face, k]]
    return out


def _face(
    deviation: FloatArray, is_out: BoolArray, *, name: str, kind: str, area_m2: float, centre_m: FloatArray, is_seen: bool
) -> DrawnFace:
    n = len(deviation)
    mean, std, p95 = (float(deviation.mean()), float(deviation.std()), float(np.percentile(np.abs(deviation), 95))) if n else (np.nan,) * 3
    share = float(is_out.mean()) if n else 0.0
    return DrawnFace(
        name=name, kind=kind, area_m2=area_m2, centre_m=centre_m, n_points=n, is_seen=is_seen and n > 0, mean_m=mean, std_m=std, p95_m=p95,
        share_out=share,
    )  # fmt: skip


def _local_means(points: FloatArray, deviation: FloatArray, face: IntArray) -> tuple[FloatArray, IntArray]:
    """(n,) means over each point and the nearest others on its face, and (n,) of how many."""
    _, near = k_nearest(points, AROUND)
    own = face[near] == face[:, None]
    n = np.maximum(own.sum(axis=1), 1)
    return np.asarray(np.where(own, deviation[near], 0.0).sum(axis=1) / n), n
