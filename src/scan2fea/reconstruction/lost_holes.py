"""Holes of the surface that a solid of flat and round faces came from, and that this has closed: planes of their walls were not found.

A slot a wall deep has a dozen points on each end, all within the noise of the faces of the wall. Without their planes the cells there are full, and
what the solid then has too much is a hundredth of its volume. But in a wall of two spacings the first surface also goes through where gaps between
points lie opposite each other; such a place, where no point lies between the faces of the wall, though a hole would have some there, is none.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import pdtr

from scan2fea.kernel.distances import signed_distance
from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.reconstruction.plane_growing import tolerance_m
from scan2fea.types import Check, FloatArray, IntArray, TriangleMesh

LOST_HOLES = "holes that flat faces close"
HOLES_APART = "holes that flat faces tell otherwise"
DEEP = 0.25  # of the wall, from both its faces: walls of a hole run through its middle
WIDE, SIGMAS = 1.5, 1.0  # spacings and sigma of the radius of a hole that chance does not make
CLEAR = 0.6  # of that radius about such a place is empty: a surface through points narrows its holes, gaps by chance leave less
APART = 4.0  # of that radius: what lies nearer counts as one hole, however long
BARE = 0.01  # chance that the wall of a hole has so few points


def lost_holes(first: TriangleMesh, solid: TriangleMesh, points: FloatArray, wall_m: float, spacing_m: float, sigma_m: float) -> Check:
    """How many holes of the first surface, wider than gaps between points, are full in the solid; none where it has as many holes.

    points : (n, 3) measured.
    """
    places, group = np.zeros((0, 3)), np.zeros(0, np.int64)
    if surface_topology(first).n_handles > surface_topology(solid).n_handles:
        places = _closed(first, solid, wall_m, WIDE * spacing_m + SIGMAS * sigma_m)
        group = _groups(places, APART * (WIDE * spacing_m + SIGMAS * sigma_m))
    if len(places):
        depth = -signed_distance(points, solid)
        is_gap = np.array([_is_gap(places[group == k], first, solid, points, depth, spacing_m, sigma_m) for k in range(int(group.max()) + 1)])
        places, group = places[~is_gap[group]], group[~is_gap[group]]
    n = len(np.unique(group))
    says = f"flat faces close {n} holes of the surface they came from{around(places)}: their walls are not among the faces"
    return at_most(LOST_HOLES, float(n), 0.0, says)


def holes_apart(free: TriangleMesh, solid: TriangleMesh, n_lost: int) -> Check:
    """Holes of the free form besides those that a solid of flat faces has, or is known to have lost: gaps between points, or scanned too thinly."""
    n = max(0, surface_topology(free).n_handles - surface_topology(solid).n_handles - n_lost)
    says = f"{n} holes through walls are as narrow as gaps between points, and flat faces through the same points close them: scan more densely"
    return at_most(HOLES_APART, float(n), 0.0, says)


def _closed(first: TriangleMesh, solid: TriangleMesh, wall_m: float, radius_m: float) -> FloatArray:
    """(k, 3) places before walls of holes of the first surface, with nothing of it near, that lie between the faces of a wall of the solid."""
    deep = DEEP * wall_m if np.isfinite(wall_m) else DEEP * radius_m
    middle, out = first.vertices[first.faces].mean(axis=1), face_normals(first)
    rows = np.flatnonzero(signed_distance(middle, solid) < -deep)
    places = middle[rows] + radius_m * out[rows]
    if len(rows):
        places = places[signed_distance(places, solid) < -deep]
    return np.asarray(places[signed_distance(places, first) > CLEAR * radius_m]) if len(places) else places


def _is_gap(
    places: FloatArray, first: TriangleMesh, solid: TriangleMesh, points: FloatArray, depth: FloatArray, spacing_m: float, sigma_m: float
) -> bool:
    """Is a hole of the first surface, about `places`, one between points? Between the faces of the wall lie fewer than its own wall would have.

    depth : (n,) of the points in the solid. A hole whose wall nobody scanned leaves both faces bare: that is asked elsewhere (`empty_places`).
    """
    off, reach = tolerance_m(spacing_m, sigma_m), APART * (WIDE * spacing_m + SIGMAS * sigma_m)
    middle, beside = first.vertices[first.faces].mean(axis=1), cKDTree(places)
    own = np.flatnonzero(np.isfinite(beside.query(middle, distance_upper_bound=reach)[0]))
    own = own[signed_distance(middle[own], solid) < -off]
    due = float(face_areas(first)[own].sum()) / spacing_m**2
    near = np.isfinite(beside.query(points, distance_upper_bound=reach)[0])
    return bool(pdtr(int(np.sum(depth[near] > off)), due) <= BARE)


def _groups(places: FloatArray, apart_m: float) -> IntArray:
    """(k,) the group of each place: groups lie farther than that apart."""
    group, n = np.full(len(places), -1, np.int64), 0
    tree = cKDTree(places) if len(places) else None
    while tree is not None and (group < 0).any():
        begun = [int(np.argmin(group))]
        group[begun] = n
        while begun:
            near = np.array(tree.query_ball_point(places[begun.pop()], apart_m), np.int64)
            near = near[group[near] < 0]
            group[near] = n
            begun += near.tolist()
        n += 1
    return group
