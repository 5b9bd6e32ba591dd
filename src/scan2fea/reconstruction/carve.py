"""From points with outward normals to a closed surface: denoise, triangulate, vote, cut, make manifold. With or without sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.delaunay import Tetrahedralisation, tetrahedralise
from scan2fea.kernel.side_normals import wall_depth
from scan2fea.reconstruction.cut import Cut, cut, gather_votes
from scan2fea.reconstruction.denoise import Denoised, denoise
from scan2fea.reconstruction.pinholes import without_pinholes
from scan2fea.reconstruction.singular import Resolved, boundary, resolve
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

REACH = 12.0  # spacings in which the other face of a wall is looked for
PSEUDO_REACH = 4.0  # spacings a pseudo-sensor stands off

Prior = Callable[[Tetrahedralisation], FloatArray]


@dataclass(frozen=True, eq=False, kw_only=True)
class Carved(Value):
    """mesh : closed, manifold, outward.   vertex_point : (k,) the point each vertex is.   thickness_m : (n,) of the wall at each point, nan: none.

    gap_m : (n,) to the next surface in front of each point, likewise.
    """

    mesh: TriangleMesh
    vertex_point: IntArray
    clean: Denoised
    thickness_m: FloatArray
    gap_m: FloatArray
    tetra: Tetrahedralisation
    inside: BoolArray
    labels: Cut
    resolved: Resolved


def carve(
    points: FloatArray,
    normals: FloatArray,
    sensors: FloatArray,
    spacing_m: float,
    sigma_m: float,
    *,
    between_m: float = 0.0,
    prior: Prior | None = None,
    quality_weight: float = 0.3,
    seed: int = 0,
    kept: Callable[[Tetrahedralisation], BoolArray] | None = None,
) -> Carved:
    """The surface of the solid under the points.

    points : (n, 3) raw.   normals : (n, 3) outward.   sensors : (n, 3) where each point was seen from; a nan row gets a pseudo-sensor in
    front of it, nearer than half of the gap there.   sigma_m : noise of the points.   between_m : the part of it that is of the places
    of their scans.   prior : votes for outside (m,) of the tets it is given (those of the denoised points).
    kept : those of them that are no channel to fill.   Raises ReconstructionError.
    """
    clean = denoise(points, normals, spacing_m, sigma_m, between_m)
    thickness = wall_depth(clean.points, clean.normals, spacing_m, REACH * spacing_m)
    gap = gaps(clean.points, clean.normals, spacing_m)
    targets = np.where(np.isfinite(sensors), sensors, pseudo_sensors(clean.points, clean.normals, gap, spacing_m))
    tetra = tetrahedralise(clean.points, spacing_m, seed)
    votes = gather_votes(tetra, clean.normals, targets, clean.residual_m, thickness, spacing_m)
    extra = None if prior is None else prior(tetra)
    labels = cut(tetra, votes, spacing_m, extra, quality_weight)
    source = votes.source if extra is None else votes.source + extra
    resolved = resolve(tetra, labels.inside, votes.capacity, source, votes.sink, spacing_m)
    seen = clean.normals if np.isfinite(sensors).any() else None
    resolved = without_pinholes(tetra, resolved, votes, source, spacing_m, seen, None if kept is None else kept(tetra))
    mesh, vertex_point = boundary(tetra, resolved.inside)
    return Carved(
        mesh=mesh,
        vertex_point=vertex_point,
        clean=clean,
        thickness_m=thickness,
        gap_m=gap,
        tetra=tetra,
        inside=resolved.inside,
        labels=labels,
        resolved=resolved,
    )


def pseudo_sensors(points: FloatArray, normals: FloatArray, gap_m: FloatArray, spacing_m: float) -> FloatArray:
    """(n, 3) p + n min(4 h, half the gap in front of p)."""
    return np.asarray(points + normals * np.fmin(PSEUDO_REACH * spacing_m, 0.5 * gap_m)[:, None])


def gaps(points: FloatArray, normals: FloatArray, spacing_m: float) -> FloatArray:
    """(n,) width of the gap in front of each point, nan where nothing faces it within twice the stand-off of a pseudo-sensor."""
    return wall_depth(points, normals, spacing_m, 2.0 * PSEUDO_REACH * spacing_m, outward=True)
