"""Surface normals from neighbours, and their sign from where each point was seen."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.kernel.near_tree import NearTree
from scan2fea.kernel.neighbors import k_nearest, nearest_in_blocks
from scan2fea.types import FloatArray, IntArray


def pca_normals(points: FloatArray, k: int = 12) -> FloatArray:
    """Unit normal of the plane of least squares through the k nearest points (each point counts among its own).

    points : (n, 3).   Returns (n, 3); the sign is arbitrary, and where the neighbours lie on a line so is the direction across it;
    (0, 0, 1) where they are all equal or fewer than three.
    """
    normals = np.zeros((len(points), 3))
    xyz = np.ascontiguousarray(points, float)
    if len(points):
        for rows, _, near in nearest_in_blocks(xyz, min(k, len(points))):
            normals[rows] = _fit(xyz, near)
    return normals


def normals_at(places: FloatArray, points: FloatArray, k: int, tree: NearTree | None = None) -> FloatArray:
    """(m, 3) unit normals, of any sign, of the planes of least squares through the k of the points (n, 3) nearest to each place (m, 3).

    tree : of the points, where one is there already.
    """
    patch = points[k_nearest(points, k, places, tree)[1]]
    patch = patch - patch.mean(axis=1, keepdims=True)
    normals: FloatArray = np.linalg.eigh(np.einsum("mki,mkj->mij", patch, patch))[1][:, :, 0]
    return normals


def oriented_to(normals: FloatArray, points: FloatArray, sensors: FloatArray) -> FloatArray:
    """The normals, turned to the side their point was seen from; unchanged where the sensor is nan.

    normals, points, sensors : (n, 3). A surface is seen from outside, so these point outward.
    """
    away = np.einsum("nc,nc->n", normals, sensors - points) < 0.0
    return np.where(away[:, None], -normals, normals)


@jit
def _fit(points: FloatArray, near: IntArray) -> FloatArray:
    m, k = near.shape
    normals = np.zeros((m, 3))
    for i in range(m):
        cx = cy = cz = 0.0
        for j in range(k):
            cx += points[near[i, j], 0]
            cy += points[near[i, j], 1]
            cz += points[near[i, j], 2]
        cx, cy, cz = cx / k, cy / k, cz / k
        xx = xy = xz = yy = yz = zz = 0.0
        for j in range(k):
            x, y, z = points[near[i, j], 0] - cx, points[near[i, j], 1] - cy, points[near[i, j], 2] - cz
            xx += x * x
            xy += x * y
            xz += x * z
            yy += y * y
            yz += y * z
            zz += z * z
        normals[i, 0], normals[i, 1], normals[i, 2] = least_axis(xx, xy, xz, yy, yz, zz)
    return normals


@jit
def least_axis(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> tuple[float, float, float]:
    """Unit eigenvector of the least eigenvalue of a symmetric matrix; (0, 0, 1) for the zero matrix.

    Closed form: eigenvalue by O. K. Smith (1961), CACM 4(4) 168; vector by cross products of rows.
    """
    scale = max(max(abs(xx), abs(yy), abs(zz)), max(abs(xy), abs(xz), abs(yz)))
    if scale == 0.0:
        return 0.0, 0.0, 1.0
    a, b, c, d, e, f = xx / scale, xy / scale, xz / scale, yy / scale, yz / scale, zz / scale
    q = (a + d + f) / 3.0
    p = math.sqrt(((a - q) ** 2 + (d - q) ** 2 + (f - q) ** 2 + 2.0 * (b * b + c * c + e * e)) / 6.0)
    if p < 1e-15:
        return 0.0, 0.0, 1.0
    u, v, w = (a - q) / p, (d - q) / p, (f - q) / p
    s, t, r = b / p, c / p, e / p
    half = (u * (v * w - r * r) - s * (s * w - r * t) + t * (s * r - v * t)) / 2.0
    least = q + 2.0 * p * math.cos(math.acos(min(1.0, max(-1.0, half))) / 3.0 + 2.0 * math.pi / 3.0)
    # the eigenvector is orthogonal to every row of A - least I: take the longest of the three cross products
    a, d, f = a - least, d - least, f - least
    best, nx, ny, nz = 0.0, 0.0, 0.0, 1.0
    for row in range(3):
        if row == 0:
            x, y, z = b * e - c * d, c * b - a * e, a * d - b * b
        elif row == 1:
            x, y, z = b * f - c * e, c * c - a * f, a * e - b * c
        else:
            x, y, z = d * f - e * e, e * c - b * f, b * e - d * c
        size = x * x + y * y + z * z
        if size > best:
            best, nx, ny, nz = size, x, y, z
    if best < 1e-30:  # the two least eigenvalues are equal (points on a line): any direction across the line serves
        return _across(b, c, e, a, d, f)
    length = math.sqrt(best)
    return nx / length, ny / length, nz / length


@jit
def _across(b: float, c: float, e: float, a: float, d: float, f: float) -> tuple[float, float, float]:
    """A unit vector orthogonal to the longest row of a matrix of rank one."""
    x, y, z = a, b, c
    if b * b + d * d + e * e > x * x + y * y + z * z:
        x, y, z = b, d, e
    if c * c + e * e + f * f > x * x + y * y + z * z:
        x, y, z = c, e, f
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        nx, ny, nz = 0.0, z, -y
    elif abs(y) <= abs(z):
        nx, ny, nz = -z, 0.0, x
    else:
        nx, ny, nz = y, -x, 0.0
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / length, ny / length, nz / length
