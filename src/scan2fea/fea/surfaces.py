"""Integrals over named parts of the boundary: loads spread over faces, mean displacements and rotations of faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.types import FloatArray, IntArray, Value

# six points of degree 4 on a triangle (Dunavant 1985)
_A, _B = 0.445948490915965, 0.091576213509771
_BARY = np.array([[1 - 2 * _A, _A, _A], [_A, 1 - 2 * _A, _A], [_A, _A, 1 - 2 * _A], [1 - 2 * _B, _B, _B], [_B, 1 - 2 * _B, _B], [_B, _B, 1 - 2 * _B]])
_WEIGHT = np.array([0.223381589678011] * 3 + [0.109951743655322] * 3)
_EDGES = ((0, 1), (1, 2), (0, 2))
_D = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface(Value):
    """The points of integration of some boundary triangles.

    triangles : (f, 3 or 6).   shape : (q, 3 or 6) shape functions.   at : (f, q, 3).   outward : (f, q, 3) vector of the area that each stands for.
    """

    triangles: IntArray
    shape: FloatArray
    at: FloatArray
    outward: FloatArray

    @property
    def area(self) -> FloatArray:
        """(f, q) m2."""
        return np.asarray(np.linalg.norm(self.outward, axis=2))

    @property
    def centroid(self) -> FloatArray:
        return np.asarray(np.einsum("fq,fqc->c", self.area, self.at) / self.area.sum())

    def nodal(self, traction: FloatArray, n_nodes: int) -> FloatArray:
        """(n, 3) consistent nodal forces of a traction (f, q, 3) in N at the points (stress times area)."""
        each = np.einsum("qa,fqc->fac", self.shape, traction).reshape(-1, 3)
        rows = self.triangles.ravel()
        return np.stack([np.bincount(rows, each[:, c], n_nodes) for c in range(3)], axis=1)

    def moved(self, field: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(mean displacement (3,), rotation (3,)) of the surface under displacements (n, 3): the rigid motion nearest to it, weighed by area."""
        u = np.einsum("qa,fac->fqc", self.shape, field[self.triangles])
        area = self.area
        mean = np.einsum("fq,fqc->c", area, u) / area.sum()
        arm = self.at - self.centroid
        turning = np.einsum("fq,fqc->c", area, np.cross(arm, u - mean))
        return mean, np.linalg.lstsq(_inertia(arm, area), turning, rcond=1e-9)[0]


def distortion(face: Surface, axes: FloatArray, field: FloatArray) -> float:
    """Share of the motion of a flat face, within its plane, that is not rigid: 0 of a section that keeps its shape, 1 of walls that swing.

    axes : (3, 2), columns that span the plane.   field : (n, 3) displacements.
    """
    mean, turned = face.moved(field)
    u = np.einsum("qa,fac->fqc", face.shape, field[face.triangles])
    rest = u - mean - np.cross(turned, face.at - face.centroid)
    own, whole = (float((face.area * ((v @ axes) ** 2).sum(axis=2)).sum()) for v in (rest, u))
    return own / whole if whole > 0 else 0.0


def _inertia(arm: FloatArray, area: FloatArray) -> FloatArray:
    """(3, 3) of areas about the origin of their arms."""
    square = np.einsum("fqc,fqc->fq", arm, arm)
    return np.asarray(float((area * square).sum()) * np.eye(3) - np.einsum("fq,fqc,fqd->cd", area, arm, arm))


def surface(nodes: FloatArray, triangles: IntArray) -> Surface:
    """The surface of triangles (f, 3) or (f, 6), straight or curved."""
    if triangles.shape[1] == 3:
        shape, slope = _BARY, np.repeat(_D[None], len(_BARY), axis=0)
    else:
        shape = np.concatenate([_BARY * (2 * _BARY - 1), np.stack([4 * _BARY[:, i] * _BARY[:, j] for i, j in _EDGES], axis=1)], axis=1)
        corner = (4 * _BARY - 1)[:, :, None] * _D[None]
        middle = np.stack([4 * (_BARY[:, i, None] * _D[j] + _BARY[:, j, None] * _D[i]) for i, j in _EDGES], axis=1)
        slope = np.concatenate([corner, middle], axis=1)
    p = nodes[triangles]
    tangent = np.einsum("qad,fac->fqdc", slope, p)
    outward = np.cross(tangent[:, :, 0], tangent[:, :, 1]) * (_WEIGHT / _WEIGHT.sum() / 2)[None, :, None]
    return Surface(triangles=np.array(triangles, np.int64), shape=shape, at=np.einsum("qa,fac->fqc", shape, p), outward=outward)


def spread_force(on: Surface, force: FloatArray) -> FloatArray:
    """(f, q, 3) N: the force (3,) evenly over the area."""
    area = on.area
    return np.asarray(area[..., None] * force / area.sum())


def spread_moment(on: Surface, moment: FloatArray) -> FloatArray:
    """(f, q, 3) N: tractions w x (x - c) that add up to the moment (3,) about the centroid and to no force."""
    arm = on.at - on.centroid
    spin = np.linalg.lstsq(_inertia(arm, on.area), moment, rcond=1e-9)[0]
    return np.asarray(on.area[..., None] * np.cross(spin, arm))


def spread_pressure(on: Surface, pressure: float) -> FloatArray:
    """(f, q, 3) N: pressure against the outward normal."""
    return -pressure * on.outward
