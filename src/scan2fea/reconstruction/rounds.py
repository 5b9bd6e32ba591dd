"""Flats that are pieces of something round: neighbours that one cylinder explains as well as they do, with fewer numbers."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.surfaces import CYLINDER, fit_surface
from scan2fea.kernel.topology import edge_table
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

MOST_TURN_DEG = 65.0  # between neighbours: the flats of a hexagon turn by 60, those of most parts by 90
LEAST_FLATS = 3  # two flats and the face between them are a chamfer
LEAST_POINTS = 4  # of a flat
AS_WELL = 1.15  # times the scatter about the flats
OFF_SPACING = 0.02


def on_rounds(mesh: TriangleMesh, points: FloatArray, spacing_m: float) -> BoolArray:
    """(n,) which of (n, 3) points lie on three or more flats (mesh.face_region) that are one cylinder as far as the points can tell."""
    if not len(mesh.faces):  # cylinders alone
        return np.zeros(len(points), bool)
    region = np.zeros(len(mesh.faces), np.int64) if mesh.face_region is None else np.unique(mesh.face_region, return_inverse=True)[1].ravel()
    nearest = PointToMesh(mesh).nearest(points)
    of, off = region[nearest.face], nearest.distance
    normal = np.zeros((int(region.max()) + 1, 3))
    normal[region] = face_normals(mesh)
    beside = _neighbours(mesh, region, normal)
    is_round = np.zeros(len(normal), bool)
    for first, others in enumerate(beside):
        for second in others:
            if is_round[first] or is_round[second] or second < first:
                continue
            group = _grown([first, second], beside, points, of, off, normal, spacing_m)
            is_round[group if len(group) >= LEAST_FLATS else []] = True
    return np.asarray(is_round[of])


def _neighbours(mesh: TriangleMesh, region: IntArray, normal: FloatArray) -> list[list[int]]:
    """For each region those beside it, ascending, whose normals turn by less than MOST_TURN_DEG."""
    twin = edge_table(mesh.faces).twin
    here, there = np.repeat(region, 3)[twin >= 0], region[twin[twin >= 0] // 3]
    apart = (here != there) & (np.einsum("ij,ij->i", normal[here], normal[there]) >= np.cos(np.radians(MOST_TURN_DEG)))
    pairs = np.unique(np.stack([here[apart], there[apart]], axis=1), axis=0)
    return [pairs[pairs[:, 0] == k, 1].tolist() for k in range(len(normal))]


def _grown(
    group: list[int], beside: list[list[int]], points: FloatArray, of: IntArray, off: FloatArray, normal: FloatArray, spacing_m: float
) -> list[int]:
    """The regions that join two neighbours on one cylinder; the two alone, or none, where nothing does."""
    refused: set[int] = set()
    while True:
        found = [r for g in group for r in beside[g] if r not in group and r not in refused]
        if not found:
            return group
        rows = np.flatnonzero(np.isin(of, [*group, found[0]]))
        if np.sum(of == found[0]) >= LEAST_POINTS and _is_round(points[rows], normal[of[rows]], of[rows], off[rows], spacing_m):
            group = [*group, found[0]]
        else:
            refused.add(found[0])


def _is_round(points: FloatArray, normals: FloatArray, of: IntArray, off: FloatArray, spacing_m: float) -> bool:
    """Does one cylinder explain the points of every flat, as far as so few can tell?"""
    surface = fit_surface(CYLINDER, points, normals)
    if surface is None:
        return False
    limit = AS_WELL * float(np.sqrt(np.mean(off**2))) + OFF_SPACING * spacing_m
    count, squares = np.bincount(of), np.bincount(of, weights=surface.distance(points) ** 2)
    held = count > 0
    chance = 1.0 + 3.0 / np.sqrt(2.0 * count[held])  # the scatter of n points is known to 1 / sqrt(2 n)
    return bool((np.sqrt(squares[held] / count[held]) <= limit * chance).all()) and float(np.sqrt(squares.sum() / len(points))) <= limit
