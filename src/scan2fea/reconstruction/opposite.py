"""The other face of a wall where nobody saw it: the wall goes on as thick as it was measured round about.

A wall of which one face is hidden in part has one skin there, and the minimum cut ends anywhere behind it. What is known is that the seen skin goes
on, and how far below it the other one lies where both were seen. Where that is one thickness all along the border of the gap, and the gap is no
larger than what was measured of the same face, it is carried over. The points put there are inferred, and told so.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scan2fea.kernel.inferred import with_inferred
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.reconstruction.carve import REACH as THICKEST
from scan2fea.reconstruction.evidence import Evidence
from scan2fea.reconstruction.gates_surface import NOISE_OVER_WALL, SPACING_OVER_WALL
from scan2fea.reconstruction.wall_ends import passed
from scan2fea.types import BoolArray, FloatArray, IntArray, PointCloud

ALIKE = 0.8  # cosine between normals of one face
JOINED, BORDER, NEIGHBORS = 2.0, 3.0, 12  # spacings: between points of one gap, and from these to the measured thickness round it
LEAST = 12  # points of a gap, and of its border: smaller gaps any answer closes, shorter borders tell nothing
SPREAD, SPREAD_SPACINGS = 0.05, 0.5  # of the thickness and of the spacing: what it may vary by along the border (one sd), besides the noise
FREE = 0.6  # spacings to the next point of the same side
IN_WALL, SEEN_THROUGH = 0.1, 0.05  # of the thickness off the middle of the wall; share of its places that sight lines may pass, beside bores
BESIDE = 1.6  # spacings from where the first surface is met to a point of that side: it was seen there (as in `wall_depth`)
MANY = 400  # places of a gap at which sight lines are asked for


def with_opposite(cloud: PointCloud, evidence: Evidence) -> PointCloud | None:
    """The cloud with points on the unseen side of its walls; None where there are none, or nothing tells how thick the wall is.

    evidence : a first surface of `cloud`, its sensors known.
    """
    points, normals, thickness = evidence.smoothed, evidence.normals, _thickness(evidence)
    seen, lacking = np.flatnonzero(np.isfinite(thickness)), np.flatnonzero(~np.isfinite(thickness))
    if evidence.sensors is None or not len(lacking) or not len(seen):
        return None
    known = np.flatnonzero(np.isfinite(evidence.sensors).all(axis=1))
    lines = np.ascontiguousarray(evidence.sensors[known]), np.ascontiguousarray(evidence.points[known])
    face = _faces(points, normals, evidence.spacing_m)
    gap = _faces(points[lacking], normals[lacking], evidence.spacing_m)
    made = [(np.zeros((0, 3)), np.zeros((0, 3)))]
    for number in np.flatnonzero(np.bincount(gap) >= LEAST):
        own = lacking[gap == number]
        wall = _thickness_round(evidence, thickness, own, seen)
        whole = int(np.isin(face[seen], np.unique(face[own])).sum())
        if not np.isfinite(wall) or len(own) > whole:
            continue
        asked = own[np.linspace(0, len(own) - 1, min(len(own), MANY)).astype(np.int64)]
        if passed(points[asked] - 0.5 * wall * normals[asked], *lines, IN_WALL * wall).mean() <= SEEN_THROUGH:
            made.append((points[own] - wall * normals[own], -normals[own]))
    new, out = (np.concatenate(column) for column in zip(*made, strict=True))
    free = _free(points, normals, new, out, FREE * evidence.spacing_m) if len(new) else np.zeros(0, bool)
    return with_inferred(cloud, new[free], out[free]) if free.any() else None


def _thickness(evidence: Evidence) -> FloatArray:
    """(n,) of the wall at each point, m, also where it is thicker than the reach in which other faces are looked for; nan where none was seen."""
    mesh, points, normals = evidence.mesh, evidence.smoothed, evidence.normals
    out = np.array(evidence.thickness_m)
    asked = np.flatnonzero(~np.isfinite(out))
    below = 0.5 * evidence.spacing_m
    depth, hit = first_hits(scene_of(mesh), points[asked] - below * normals[asked], -normals[asked])
    # within that reach a face that was seen had been found: what the first surface has there is its own
    far = (hit >= 0) & (depth + below > THICKEST * evidence.spacing_m)
    rows = asked[far]
    place = points[rows] - (depth[far] + below)[:, None] * normals[rows]
    distance, near = k_nearest(points, min(NEIGHBORS, len(points)), place)
    was_seen = ((distance < BESIDE * evidence.spacing_m) & (np.einsum("nkc,nc->nk", normals[near], normals[rows]) < 0.0)).any(axis=1)
    out[rows[was_seen]] = (depth[far] + below)[was_seen]
    return out


def _faces(points: FloatArray, normals: FloatArray, spacing_m: float) -> IntArray:
    """(n,) number of the set of neighbours of one side that each point is of."""
    distance, near = k_nearest(points, min(NEIGHBORS, len(points)), points)
    row, col = np.nonzero((distance <= JOINED * spacing_m) & (np.einsum("nkc,nc->nk", normals[near], normals) > ALIKE))
    graph = coo_array((np.ones(len(row), np.int8), (row, near[row, col])), shape=(len(points),) * 2)
    return np.asarray(connected_components(graph, directed=False)[1])


def _thickness_round(evidence: Evidence, thickness_m: FloatArray, own: IntArray, seen: IntArray) -> float:
    """Thickness along the border of a gap, m; nan where it is not one, or no wall to this scan.

    thickness_m : (n,).   own, seen : rows of the points of the gap, and of those with a thickness.
    """
    points, normals = evidence.smoothed, evidence.normals
    distance, near = k_nearest(points[own], min(4, len(own)), points[seen])
    beside = (distance <= BORDER * evidence.spacing_m) & (np.einsum("nkc,nc->nk", normals[own][near], normals[seen]) > ALIKE)
    border = thickness_m[seen[beside.any(axis=1)]]
    if len(border) < LEAST:
        return float("nan")
    wall = float(np.median(border))
    spread = 1.4826 * float(np.median(np.abs(border - wall)))
    is_one = spread <= min(SPREAD * wall, SPREAD_SPACINGS * evidence.spacing_m) + evidence.sigma_m
    is_wall = evidence.spacing_m <= SPACING_OVER_WALL * wall and evidence.sigma_m <= NOISE_OVER_WALL * wall
    return wall if is_one and is_wall else float("nan")


def _free(points: FloatArray, normals: FloatArray, new: FloatArray, out: FloatArray, near_m: float) -> BoolArray:
    """(k,) new places beside which there is no point of their side."""
    distance, near = k_nearest(points, min(NEIGHBORS, len(points)), new)
    return np.asarray(~((distance < near_m) & (np.einsum("nkc,nc->nk", normals[near], out) > 0.0)).any(axis=1))
