"""What a beam needs to know of its section: moments, torsion constant, shear centre, warping constant, shear areas.

Saint-Venant's torsion and the shear stresses of bending are solved on curved six-node triangles (Pilkey 2002, chapters 5 and 6; the shear centre
after Trefftz 1935, so that it does not depend on Poisson's ratio; shear areas by the energy of the stresses at Poisson's ratio 0).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from scan2fea.fea.section_mesh import LEVEL, SectionMesh, section_mesh
from scan2fea.kernel.outline import Outline, outline
from scan2fea.types import FloatArray, IntArray, RootFillet, Value

# seven points of degree 5 on a triangle (Radon 1948)
_A, _B = (6 - math.sqrt(15)) / 21, (6 + math.sqrt(15)) / 21
_POINTS = np.array([[1 / 3, 1 / 3], [_A, _A], [1 - 2 * _A, _A], [_A, 1 - 2 * _A], [_B, _B], [1 - 2 * _B, _B], [_B, 1 - 2 * _B]])
_WEIGHTS = np.array([9 / 40] + [(155 - math.sqrt(15)) / 1200] * 3 + [(155 + math.sqrt(15)) / 1200] * 3)


@dataclass(frozen=True, eq=False, kw_only=True)
class SectionProperties(Value):
    """All about the axes x, y of the section (frame of kernel.sections), metres to the power that fits.

    centroid, shear_centre : (2,).   ixx, iyy, ixy : integrals of y^2, x^2, x y about the centroid, m4.   j : torsion constant, m4.
    warping : about the shear centre, m6.   shear : (2, 2), 1/m2: a shear force V (2,) makes the strain shear @ V / G, so that the shear area along a
    principal axis is the inverse of its entry.   reach : (4,) how far the section goes from the centroid towards -x, +x, -y, +y.
    """

    area: float
    centroid: FloatArray
    ixx: float
    iyy: float
    ixy: float
    j: float
    shear_centre: FloatArray
    warping: float
    shear: FloatArray
    reach: FloatArray

    @property
    def inertia(self) -> FloatArray:
        """(2, 2) integrals of x_i x_j about the centroid, m4."""
        return np.array([[self.iyy, self.ixy], [self.ixy, self.ixx]])

    @property
    def i1(self) -> float:
        return float(np.linalg.eigvalsh(self.inertia)[1])

    @property
    def i2(self) -> float:
        return float(np.linalg.eigvalsh(self.inertia)[0])

    @property
    def angle_rad(self) -> float:
        """From x to the axis about which i1 is taken (0 where it is x itself)."""
        return 0.5 * math.atan2(-2 * self.ixy, self.ixx - self.iyy)

    @property
    def eccentricity(self) -> FloatArray:
        """(2,) from the centroid to the shear centre."""
        return np.asarray(self.shear_centre - self.centroid)

    @property
    def polar_radius_squared(self) -> float:
        """(ixx + iyy) / area + eccentricity squared: of the section about its shear centre, m2."""
        return (self.ixx + self.iyy) / self.area + float(self.eccentricity @ self.eccentricity)


def properties_of(family: str, values: Mapping[str, float], root: RootFillet = RootFillet(), level: int = LEVEL) -> SectionProperties:
    """Of a family of kernel.sections with the given dimensions, metres. Raises UsageError where these make no section."""
    return section_properties(outline(family, values, root.radius_m, root.toe_m, root.slope), level)


def section_properties(shape: Outline, level: int = LEVEL) -> SectionProperties:
    """Of an outline with true arcs. Doubling the mesh (`level` + 1) changes no figure by 0.1 % (tests)."""
    mesh = section_mesh(shape, level)
    size = float(np.ptp(mesh.points, axis=0).max())  # solved at size 1: figures in metres to the sixth would drown in rounding
    middle = mesh.points.mean(axis=0)
    x, n, dn, area = _at_points((mesh.points - middle) / size, mesh.triangles)
    total = float(area.sum())
    centroid = np.einsum("eq,eqc->c", area, x) / total
    x = x - centroid
    inertia = np.einsum("eq,eqi,eqj->ij", area, x, x)
    torsion, warped, shear = _torsion_and_shear(mesh, x, n, dn, area, inertia)
    centre = np.linalg.solve(inertia, warped[:2])
    centre = np.array([-centre[1], centre[0]])
    warping = float(warped[2] - warped[:2] @ np.linalg.solve(inertia, warped[:2]))
    at = mesh.points - (middle + size * centroid)
    return SectionProperties(
        area=total * size**2,
        centroid=middle + size * centroid,
        ixx=float(inertia[1, 1]) * size**4,
        iyy=float(inertia[0, 0]) * size**4,
        ixy=float(inertia[0, 1]) * size**4,
        j=torsion * size**4,
        shear_centre=middle + size * (centroid + centre),
        warping=max(warping, 0.0) * size**6,
        shear=shear / size**2,
        reach=np.array([-at[:, 0].min(), at[:, 0].max(), -at[:, 1].min(), at[:, 1].max()]),
    )


def _at_points(nodes: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """At the points of every triangle: places (e, q, 2), shape functions (q, 6), their gradients (e, q, 6, 2), areas (e, q)."""
    r, s = _POINTS.T
    t = 1 - r - s
    n = np.stack([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t], axis=1)
    zero = 0 * r
    by_r = np.stack([1 - 4 * t, 4 * r - 1, zero, 4 * (t - r), 4 * s, -4 * s], axis=1)
    by_s = np.stack([1 - 4 * t, zero, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)], axis=1)
    natural = np.stack([by_r, by_s], axis=2)
    x = nodes[triangles]
    jacobian = np.einsum("qai,eac->eqci", natural, x)
    det = jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0]
    adjoint = np.stack([np.stack([jacobian[..., 1, 1], -jacobian[..., 0, 1]], -1), np.stack([-jacobian[..., 1, 0], jacobian[..., 0, 0]], -1)], -2)
    gradient = np.einsum("qai,eqic->eqac", natural, adjoint) / det[..., None, None]
    return np.einsum("qa,eac->eqc", n, x), n, gradient, det * _WEIGHTS / 2


def _torsion_and_shear(
    mesh: SectionMesh, x: FloatArray, n: FloatArray, dn: FloatArray, area: FloatArray, inertia: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """(J, integrals of warping times x, y and itself, shear compliance): three solutions on one matrix."""
    count = len(mesh.points)
    element = np.einsum("eq,eqac,eqbc->eab", area, dn, dn)
    rows, columns = np.repeat(mesh.triangles, 6, axis=1).ravel(), np.tile(mesh.triangles, (1, 6)).ravel()
    stiffness = sp.csc_array((element.ravel(), (rows, columns)), shape=(count, count))
    spin = np.stack([x[..., 1], -x[..., 0]], axis=-1)
    right = [np.einsum("eq,eqac,eqc->ea", area, dn, spin)]
    slope = np.einsum("ij,eqj->eqi", np.linalg.inv(inertia), x)  # bending stress by unit shear forces grows along the axis by this
    right += [np.einsum("eq,qa,eq->ea", area, n, slope[..., k]) for k in (0, 1)]
    load = np.stack([np.bincount(mesh.triangles.ravel(), r.ravel(), count) for r in right], axis=1)
    # the level of each solution is free: one node is held, then its mean is taken off
    factors = splu(sp.csc_matrix(stiffness[1:][:, 1:]))
    field = np.concatenate([np.zeros((1, 3)), factors.solve(load[1:])])
    at = np.einsum("qa,eak->eqk", n, field[mesh.triangles])
    field = field - np.einsum("eq,eqk->k", area, at) / area.sum()
    at = np.einsum("qa,eak->eqk", n, field[mesh.triangles])
    torsion = float(np.trace(inertia) - field[:, 0] @ load[:, 0])
    omega = at[..., 0]
    warped = np.array([float((area * omega * f).sum()) for f in (x[..., 0], x[..., 1], omega)])
    return torsion, warped, field[:, 1:].T @ load[:, 1:]
