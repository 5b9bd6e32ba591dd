"""The surface of a noisy scan whose images are known: occupancy for its shape, the ranges themselves for its place, and what speaks against it.

Where the noise mixes the two faces of a wall no neighbourhood of points can part them; rays can, since each knows from which side it came, and
empty pixels show the outline exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import ReconstructionError
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import area, face_areas, face_normals, vertex_normals, volume
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.kernel.side_normals import wall_depth
from scan2fea.reconstruction.budget import volume_in_doubt
from scan2fea.reconstruction.evidence import KNOWN_WALL, WALL_QUANTILE, Evidence, at_most
from scan2fea.reconstruction.gates_ranges import NOT_SEEN, UNSEEN_ENDS, gates_ranges, own_image
from scan2fea.reconstruction.isosurface import isosurface, rebuilt
from scan2fea.reconstruction.occupancy import cell_of, occupancy
from scan2fea.reconstruction.range_fit import FLATNESS, Fit, measured, range_fit
from scan2fea.reconstruction.raster import Images
from scan2fea.reconstruction.wall_ends import wall_ends
from scan2fea.types import BoolArray, Check, FloatArray, TriangleMesh, Value

FIRST_CELL = 1.7  # pixels: to find the area
ROUGH_ROUNDS = 20
TRIES = ((1.0, 1.0), (0.7, 0.7**-2), (1.3, 1.3**-2), (0.7, 1.0))  # of the cell and the flatness, most likely first; the last closes least
LEAST_NOISE = 0.05  # pixels
REACH = 12.0  # edges in which the other face of a wall is looked for
REBUILDS = 2


@dataclass(frozen=True, eq=False, kw_only=True)
class Ranged(Value):
    """fit : the surface and what the rays say of it.   sigma_m : noise along the rays.   residual_m : noise left in the surface.

    wall_m : thickness at its vertices.   checks : the gates.   cell_m : of the grid.   n_parts, n_tried, volume_spread : of the two halves.
    """

    fit: Fit
    sigma_m: float
    residual_m: float
    wall_m: FloatArray
    checks: tuple[Check, ...]
    cell_m: float
    n_parts: int
    n_tried: int
    volume_spread: float


def ray_sigma(images: Images) -> float:
    """Noise along the rays, m: second differences of the ranges along rows, by their median, which steps of the shape do not reach."""
    hit = np.flatnonzero(images.is_hit)
    column, row, image, length = images.pixel[hit, 0], images.pixel[hit, 1], images.image[hit], images.range_m[hit]
    order = np.lexsort((column, row, image))
    column, row, image, length = column[order], row[order], image[order], length[order]
    near = (image[2:] == image[:-2]) & (row[2:] == row[:-2]) & (column[2:] - column[:-2] == 2)
    bend = (length[:-2] - 2 * length[1:-1] + length[2:])[near] / math.sqrt(6.0)
    return float(1.4826 * np.median(np.abs(bend - np.median(bend)))) if len(bend) else math.nan


def by_ranges(points: FloatArray, images: Images, sigma_m: float, seed: int) -> Ranged:
    """The first surface that passes all gates, else the one that fails the fewest. Raises ReconstructionError if there is none.

    points : (n, 3) those of `images`.   sigma_m : noise along the rays, from `ray_sigma`.
    """
    pixel = images.pitch_rad * float(np.median(images.range_m[images.is_hit]))
    sigma = max(sigma_m, LEAST_NOISE * pixel)
    first = FIRST_CELL * pixel
    rough, _ = isosurface(occupancy(images, points, sigma, first, ROUGH_ROUNDS), seed)
    cell = cell_of(images, points, sigma, area(rough))
    best: Ranged | None = None
    reason = ""
    for n, (factor, flat) in enumerate(TRIES, start=1):
        try:
            found = _tried(points, images, sigma, factor * cell, flat * FLATNESS, pixel, seed, n)
        except ReconstructionError as error:
            reason = str(error)
            continue
        if best is None or _failures(found) < _failures(best):
            best = found
        if not _curable(best):
            break
    if best is None:
        raise ReconstructionError(f"no surface from the ranges ({reason})")
    return best


def _curable(found: Ranged) -> bool:
    """Another cell may mend what failed; it cannot show what no ray has met."""
    return any(not check.passed and check.name not in NOT_SEEN for check in found.checks)


def _failures(found: Ranged) -> int:
    return sum(not check.passed for check in found.checks)


def _tried(points: FloatArray, images: Images, sigma: float, cell: float, flatness: float, pixel: float, seed: int, n: int) -> Ranged:
    mesh, n_parts = _surface(points, images, sigma, cell, flatness, seed)
    fit = measured(mesh, images)
    halves = [range_fit(mesh, _half(images, odd), sigma, flatness).mesh for odd in (False, True)]
    apart = np.linalg.norm(halves[0].vertices - halves[1].vertices, axis=1)
    across = np.abs(np.einsum("ij,ij->i", halves[0].vertices - halves[1].vertices, vertex_normals(mesh)))
    residual = float(1.4826 * np.median(across) / 2.0) if len(apart) else math.nan
    spread = abs(volume(halves[0]) - volume(halves[1])) / abs(volume(mesh)) / 2.0
    edge = math.sqrt(2.3 * float(face_areas(mesh).mean()))
    wall = wall_depth(mesh.vertices, vertex_normals(mesh), edge, REACH * edge)
    one = at_most("parts", float(n_parts), 1.0, f"the rays enclose {n_parts} separate parts: segment them into objects of their own")
    ends = wall_ends(_evidence(fit, images, wall, residual), UNSEEN_ENDS)
    checks = (*gates_ranges(fit, images, sigma, residual, typical_wall(wall), pixel, spread), ends, one)
    checks = (*checks, volume_in_doubt(checks))
    if all(check.passed for check in checks):
        again, _ = _surface(*_seen_again(mesh, images, sigma, seed), sigma, cell, flatness, seed)
        checks = (*checks, own_image(volume(again) / volume(mesh) - 1))
    return Ranged(
        fit=fit, sigma_m=sigma, residual_m=residual, wall_m=wall, checks=checks, cell_m=cell, n_parts=n_parts, n_tried=n, volume_spread=spread
    )


def _evidence(fit: Fit, images: Images, wall: FloatArray, residual_m: float) -> Evidence:
    """Where the rays met the surface, as points. wall : thickness at its vertices.

    Rays prove no end: those without a return also stand where a scan was cut to its object, and the others graze a surface fitted into their noise.
    """
    met = np.flatnonzero(images.is_hit & (fit.face >= 0))
    face = fit.face[met]
    places = images.origin[met] + (images.range_m[met] - fit.off_m[met])[:, None] * images.direction[met]
    return Evidence(
        points=places,
        mesh=fit.mesh,
        smoothed=places,
        normals=face_normals(fit.mesh)[face],
        thickness_m=wall[fit.mesh.faces[face, 0]],
        gap_m=np.full(len(places), np.nan),
        spacing_m=spacing(places),
        sigma_m=residual_m,
    )


def _surface(points: FloatArray, images: Images, sigma: float, cell: float, flatness: float, seed: int) -> tuple[TriangleMesh, int]:
    """The surface that the rays make likely, moved to their ranges; and how many parts they enclosed."""
    start, n_parts = isosurface(occupancy(images, points, sigma, cell), seed)
    return _clean(range_fit(start, images, sigma, flatness).mesh, images, sigma, flatness, seed), n_parts


def _seen_again(mesh: TriangleMesh, images: Images, sigma: float, seed: int) -> tuple[FloatArray, Images]:
    """The scan that the same rays, with noise of the same size, would make of `mesh` (parametric bootstrap, Efron 1979): points and images."""
    length, _ = first_hits(scene_of(mesh), images.origin, images.direction)
    hit = np.isfinite(length)
    ranges = np.where(hit, length + sigma * np.random.default_rng(seed).standard_normal(len(length)), np.nan)
    points = images.origin[hit] + ranges[hit, None] * images.direction[hit]
    return points, replace(images, range_m=ranges, point=np.where(hit, np.cumsum(hit) - 1, -1))


def typical_wall(wall: FloatArray) -> float:
    """Thickness of the thinner walls; nan where there are none to speak of."""
    known = wall[np.isfinite(wall)]
    return float(np.quantile(known, WALL_QUANTILE)) if len(known) >= max(1.0, KNOWN_WALL * len(wall)) else math.nan


def _clean(mesh: TriangleMesh, images: Images, sigma: float, flatness: float, seed: int) -> TriangleMesh:
    """The surface rebuilt where its faces have come to cross, and moved to the ranges again if it has been."""
    for _ in range(REBUILDS):
        if not len(self_intersections(mesh)):
            return mesh
        mesh = range_fit(rebuilt(mesh, seed)[0], images, sigma, flatness).mesh
    return mesh if not len(self_intersections(mesh)) else rebuilt(mesh, seed)[0]


def _half(images: Images, odd: bool) -> Images:
    """Every second pixel, as on a chess board: noise of its own, the same view."""
    use: BoolArray = (images.pixel.sum(axis=1) % 2 == 1) == odd
    return Images(
        origin=images.origin[use],
        direction=images.direction[use],
        range_m=images.range_m[use],
        point=images.point[use],
        image=images.image[use],
        pixel=images.pixel[use],
        pitch_rad=images.pitch_rad,
    )


def on_surface(points: FloatArray, images: Images, found: Ranged) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of each point: its place on the surface, the outward normal there, and the thickness of the wall."""
    fit = found.fit
    near = PointToMesh(fit.mesh).nearest(points)
    place, face, weights = near.closest.copy(), near.face.copy(), near.weights
    ray = np.flatnonzero((images.point >= 0) & (fit.face >= 0))
    row = images.point[ray]
    place[row] = images.origin[ray] + (images.range_m[ray] - fit.off_m[ray])[:, None] * images.direction[ray]
    face[row] = fit.face[ray]
    corner = fit.mesh.faces[face, weights.argmax(axis=1)]
    return place, face_normals(fit.mesh)[face], found.wall_m[corner]
