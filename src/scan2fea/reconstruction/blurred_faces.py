"""Places of the planes of a flat solid, its faces blurred by the noise.

Where noise is wide against a wall, points of a rim or of the next leg lie within it of a face near its edges, all of them on its inner side, and
draw its plane into the wall: 5 % of the thickness where the noise is a quarter of it. Here every point belongs to each face by the density that the
face, blurred by the noise, has there, and each plane moves along its normal to where its own points are likeliest (expectation and maximisation,
Dempster, Laird and Rubin 1977).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import log_ndtr

from scan2fea.kernel.edges_distance import edges_distance
from scan2fea.kernel.topology import edge_table, half_edges
from scan2fea.reconstruction.plane_growing import Planes
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

STRAY = -0.5 * 3.5**2  # log density of a stray, against the middle of a face: as at 3.5 sigma
ROUNDS, SETTLED = 40, 1e-3  # of sigma
LEAST = 3.0  # points that move a plane
REACH = 5.0  # sigma from a plane within which its points are looked for


def placed(points: FloatArray, normals: FloatArray, mesh: TriangleMesh, planes: Planes, sigma_m: float) -> Planes:
    """The planes, each moved along its normal to where its faces explain the points (n, 3) best. normals : (n, 3) outward.

    mesh : the solid; face_region is the plane (doubled, plus 1 for its other side) of each face. Its outlines stay as they are.
    """
    if mesh.face_region is None or sigma_m <= 0.0:
        return planes
    regions = np.unique(mesh.face_region)
    every = [_near(points, normals, mesh, planes, int(region), sigma_m) for region in regions]
    rows, edges = (np.concatenate([part[k] for part in every]) for k in (0, 1))
    of = np.repeat(regions // 2, [len(part[0]) for part in every])
    height = np.einsum("ij,ij->i", points[rows], planes.normal[of])
    offset = planes.offset.copy()
    for _ in range(ROUNDS):
        density = np.exp(edges - 0.5 * ((height - offset[of]) / sigma_m) ** 2)
        weight = density / (np.bincount(rows, density, minlength=len(points)) + np.exp(STRAY))[rows]
        held = np.bincount(of, weight, minlength=len(offset))
        moved = np.where(held >= LEAST, np.bincount(of, weight * height, minlength=len(offset)) / np.maximum(held, LEAST), offset)
        change, offset = float(np.abs(moved - offset).max()), moved
        if change <= SETTLED * sigma_m:
            break
    return replace(planes, offset=offset)


def _near(
    points: FloatArray, normals: FloatArray, mesh: TriangleMesh, planes: Planes, region: int, sigma_m: float
) -> tuple[IntArray, FloatArray]:
    """Rows of the points of its side that a face may have given, and the log of the share of it that the noise leaves over each."""
    plane = planes.plane(region // 2)
    outward = plane.normal * (1 - 2 * (region % 2))
    rows = np.flatnonzero((np.abs(plane.distance(points)) <= REACH * sigma_m) & (normals @ outward > 0.0))
    beyond = from_outline(mesh, np.asarray(mesh.face_region == region), plane.axes(), points[rows])
    return rows, np.asarray(log_ndtr(-beyond / sigma_m))


def from_outline(mesh: TriangleMesh, own: BoolArray, axes: FloatArray, places: FloatArray) -> FloatArray:
    """(k,) distance of places (k, 3), along a plane, from the outline of one of its faces, negative inside. own : its triangles.   axes : (2, 3)."""
    faces = mesh.faces[own]
    ends = half_edges(faces)[edge_table(faces).twin < 0]
    corners = np.ascontiguousarray(mesh.vertices @ axes.T)
    start = np.ascontiguousarray(corners[ends[:, 0]])
    return edges_distance(start, corners[ends[:, 1]] - start, np.ascontiguousarray(places @ axes.T))[0]
