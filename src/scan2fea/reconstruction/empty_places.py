"""Places of a flat wall that are empty on both of its faces: holes, which planes would close because they know nothing of outlines.

Of random points of density rho the circles through three neighbours (Delaunay) that hold no other have 2 rho of them per area, and one of radius r
or more is a chance of (1 + x) exp(-x), x = rho pi r^2 (Miles 1970). Where both faces of a wall leave the same place bare, x is that of both.

Where sight lines are known, a hole is what one of them passes through: the wall of a bore is seen along such lines. What none passes was not looked
at from either side: there the planes go on, and what may be missing is told. Without them, points of both faces go up to the rim of a hole. Where all
round such a place one face has none either, and the middle of the wall neither, something stood before that face, as deep as the other one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import label
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.empty_circles import empty_circles
from scan2fea.kernel.measures import face_areas, face_normals, volume
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.rays import RayScene, first_hits, scene_of
from scan2fea.reconstruction.blurred_faces import from_outline
from scan2fea.reconstruction.budget import UNSEEN_WALLS
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.reconstruction.hidden_volume import LIMIT
from scan2fea.reconstruction.plane_growing import FACING
from scan2fea.reconstruction.sight import Sight
from scan2fea.reconstruction.wall_ends import BETWEEN
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, TriangleMesh, Value

EMPTY_PLACES = "empty places in flat walls"
CHANCE = 0.0025  # that random points leave a place so bare anywhere on the part
LEAST_POINTS = 12  # of a face
LOOKS = 200  # places of a face that are asked for what lies behind it
WITHIN = 0.8  # of a circle's radius: how far it stays from the outline, beside which points are missing for want of neighbours
BARE = 6.0  # points of both faces that are due in a circle: without one, by chance, 0.25 % of a wall
PIXELS = 4  # in the radius of such a circle
RING = 64  # places round a circle, up to twice its radius, that tell how dense the points are there
HAIR = 1e-6  # of the size


_FIELDS = ("middle", "radius", "within_m", "wall_m", "normal", "area_m2", "beyond")


@dataclass(frozen=True, eq=False, kw_only=True)
class Discs(Value):
    """Empty circles on one face of a wall.   middle, normal : (k, 3), outward.   radius, wall_m : (k,).

    within_m : (k,) how far from its middle a circle lies in the wall: beyond the wall's outline lines pass that tell nothing of it.
    area_m2 : (k,) of the bare part of the wall that a circle is of, shared with the other circles in it.
    beyond : (k,) points of one face that are due round a circle, as far as neither that face nor the inside of the wall has one.
    bare : (b, 3) places on either face of all these parts.
    """

    middle: FloatArray
    radius: FloatArray
    within_m: FloatArray
    wall_m: FloatArray
    normal: FloatArray
    area_m2: FloatArray
    beyond: FloatArray
    bare: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def volume_m3(self) -> float:
        """Of the wall that is bare."""
        return float(np.sum(self.area_m2 * self.wall_m))

    def passed(self, sight: Sight) -> BoolArray:
        """(k,) those through which a sight line crosses the middle of the wall and ends deeper than one that meets the face may seem to."""
        deep = 0.5 * self.wall_m - sight.skin_m
        return self._crossed(sight, 0.5 * self.wall_m, 1.0, deep) | self._crossed(sight, 0.5 * self.wall_m, -1.0, deep)

    def entered(self, sight: Sight) -> BoolArray:
        """(k,) those into which a sight line leads through either face of the wall and ends below its skin."""
        skin = np.full(len(self.radius), -sight.skin_m)
        return self._crossed(sight, np.zeros(len(skin)), 1.0, skin) & self._crossed(sight, self.wall_m, -1.0, skin)

    def _crossed(self, sight: Sight, depth_m: FloatArray, side: float, below_m: FloatArray) -> BoolArray:
        """(k,) does a line cross the circle, moved so deep into the wall, towards -side, and end beyond it, no higher than `below_m` over it?"""
        out = np.zeros(len(self.radius), bool)
        for k, (normal, radius) in enumerate(zip(self.normal, self.within_m, strict=True)):
            heart = self.middle[k] - depth_m[k] * normal
            start, end = side * ((sight.origin - heart) @ normal), side * ((sight.target - heart) @ normal)
            rows = np.flatnonzero((start > 0.0) & (end < 0.0) & (end < below_m[k]))
            share = (start[rows] / (start[rows] - end[rows]))[:, None]
            crossing = sight.origin[rows] + share * (sight.target[rows] - sight.origin[rows])
            out[k] = bool((np.linalg.norm(crossing - heart, axis=1) <= radius).any())
        return out

    def of(self, chosen: BoolArray) -> Discs:
        return replace(self, **{name: getattr(self, name)[chosen] for name in _FIELDS})

    def bare_at(self, places: FloatArray, pixel_m: float) -> BoolArray:
        """(k,) places on a face, pixels so wide, that lie on a bare part."""
        return np.asarray(cKDTree(self.bare).query(places)[0] <= math.sqrt(0.5) * pixel_m) if len(self.bare) else np.zeros(len(places), bool)


def empty_places(mesh: TriangleMesh, points: FloatArray, sight: Sight | None = None, discs: Discs | None = None) -> tuple[Check, ...]:
    """How many places in walls of a flat solid (`face_region` is set) are empty on both faces by more than chance? points : (n, 3).

    sight : lines that pass holes. A second check tells how much wall lies under the places that are gaps of the scan.   discs : of `discs_of`.
    """
    discs = discs_of(mesh, points) if discs is None else discs
    is_hole = discs.beyond < emptiness(len(points)) if sight is None else discs.passed(sight)
    holes, rest = discs.of(is_hole), discs.of(~is_hole)
    says = (
        f"at {len(holes.radius)} places flat walls have no points on either face{around(holes.middle)}: "
        "holes, or not scanned; planes would close them"
    )
    check = at_most(EMPTY_PLACES, float(len(holes.radius)), 0.0, says)
    if sight is None and not len(rest.radius):
        return (check,)
    share = rest.volume_m3 / abs(volume(mesh))
    says = (
        f"{share:.1%} of the volume lies where walls have no points on either face and nothing shows a hole (limit {LIMIT:.0%})"
        f"{around(rest.middle)}: they may go on there or not; scan there too, or fit the member"
    )
    return check, at_most(UNSEEN_WALLS, share, LIMIT, says)


def discs_of(mesh: TriangleMesh, points: FloatArray) -> Discs:
    """The empty places. points : (n, 3)."""
    region = np.zeros(len(mesh.faces), np.int64) if mesh.face_region is None else np.unique(mesh.face_region, return_inverse=True)[1].ravel()
    of = region[PointToMesh(mesh).nearest(points).face]
    least = emptiness(len(points))
    scene, normals = scene_of(mesh), face_normals(mesh)
    found = [Discs(**{name: np.zeros((0, 3) if name in ("middle", "normal") else 0) for name in _FIELDS})]
    for first in np.unique(region):
        for second in _behind(mesh, scene, region, normals, int(first)):
            pair = (int(first), int(second))
            if min(np.sum(of == pair[0]), np.sum(of == pair[1])) >= LEAST_POINTS:
                found.append(_in_wall(mesh, scene, region, normals, pair, points, of, least))
    return Discs(**{name: np.concatenate([getattr(own, name) for own in found]) for name in (*_FIELDS, "bare")})


def emptiness(n_points: int) -> float:
    """x of the empty circle that n random points have with a chance of CHANCE."""
    return float(brentq(lambda x: 2.0 * n_points * (1.0 + x) * math.exp(-x) - CHANCE, 0.0, 100.0))


def _behind(mesh: TriangleMesh, scene: RayScene, region: IntArray, normals: FloatArray, first: int) -> IntArray:
    """The faces, of greater number, that lie behind a face across the solid and look the other way."""
    own = np.flatnonzero(region == first)
    corners = mesh.vertices[mesh.faces[own]]
    steps = max(1, math.isqrt(max(LOOKS // len(own), 1)))
    weights = np.array([(i + 1 / 3, j + 1 / 3) for i in range(steps) for j in range(steps - i)]) / steps
    places = np.einsum("wk,fkc->fwc", np.column_stack([1 - weights.sum(axis=1), weights]), corners).reshape(-1, 3)
    hit = _under(scene, places, normals[own[0]], _hair(mesh))
    behind = np.unique(region[hit[hit >= 0]])
    facing = np.array([normals[region == k][0] @ normals[own[0]] < FACING for k in behind], bool)
    return np.asarray(behind[facing & (behind > first)])


def _in_wall(
    mesh: TriangleMesh,
    scene: RayScene,
    region: IntArray,
    normals: FloatArray,
    pair: tuple[int, int],
    points: FloatArray,
    of: IntArray,
    least: float,
) -> Discs:
    """The places, on the first face, that the points of both faces of a wall leave empty."""
    faces = [region == number for number in pair]
    plane = _plane(mesh, faces[0], normals)
    axes, both = plane.axes(), np.flatnonzero((of == pair[0]) | (of == pair[1]))
    flat = points[both] @ axes.T
    areas = face_areas(mesh)
    of_area = [float(np.sum(of == number)) / float(areas[own].sum()) for number, own in zip(pair, faces, strict=True)]
    density = sum(of_area)
    middle, radius = empty_circles(flat)
    large = np.flatnonzero(math.pi * density * radius**2 >= least)
    clearance = np.zeros(len(radius))
    clearance[large] = np.min([np.abs(from_outline(mesh, own, axes, middle[large] @ axes)) for own in faces], axis=0)
    large = large[clearance[large] >= WITHIN * radius[large]]
    large = large[_across(scene, region, plane, pair, middle[large], _hair(mesh))]
    kept: list[int] = []
    for k in large[np.argsort(-radius[large], kind="stable")]:
        if all(np.linalg.norm(middle[k] - middle[j]) >= radius[j] for j in kept):
            kept.append(int(k))
    kept = [k for k in kept if _ring_count(scene, region, plane, pair, middle[k], radius[k], flat, _hair(mesh)) >= least]
    at = middle[kept] @ axes + plane.offset * plane.normal
    wall = np.abs(_plane(mesh, faces[1], normals).distance(at))
    parts, pixel = _bare_parts(scene, region, plane, pair, middle[kept], flat, math.sqrt(BARE / (math.pi * density)), _hair(mesh))
    area, bare = np.zeros(len(kept)), [np.zeros((0, 3))]
    for own, pixels in parts:
        area[own] = pixel**2 * len(pixels) / np.sum(own)
        top = pixels @ axes + plane.offset * plane.normal
        bare += [top, top - float(wall[own].mean()) * plane.normal]
    within, normal = np.minimum(radius, clearance)[kept], np.tile(plane.normal, (len(kept), 1))
    depth, beyond = -plane.distance(points), np.zeros(len(kept))
    for i, k in enumerate(kept):
        inside = (depth > BETWEEN * wall[i]) & (depth < (1.0 - BETWEEN) * wall[i])
        off = np.linalg.norm(points @ axes.T - middle[k], axis=1)
        for number, due in zip(pair, of_area, strict=True):
            reach = float(off[inside | (of == number)].min())
            if reach > radius[k]:
                share = float(_across(scene, region, plane, pair, middle[k] + _sunflower(radius[k], reach), _hair(mesh)).mean())
                beyond[i] = max(beyond[i], due * math.pi * (reach**2 - radius[k] ** 2) * share)
    return Discs(middle=at, radius=radius[kept], within_m=within, wall_m=wall, normal=normal, area_m2=area, beyond=beyond, bare=np.concatenate(bare))


def _bare_parts(
    scene: RayScene, region: IntArray, plane: Plane, pair: tuple[int, int], middle: FloatArray, flat: FloatArray, reach_m: float, hair: float
) -> tuple[list[tuple[BoolArray, FloatArray]], float]:
    """Bare parts of a wall, what circles of `reach_m` without a point cover: the circles (k,) of each and its pixels (b, 2); how wide these are."""
    if not len(middle):
        return [], 0.0
    pixel, low = reach_m / PIXELS, flat.min(axis=0) - reach_m
    shape = tuple(np.ceil((flat.max(axis=0) + reach_m - low) / pixel).astype(np.int64).tolist())
    at = low + (np.argwhere(np.ones(shape, bool)) + 0.5) * pixel
    on = np.zeros(len(at), bool)
    rows = np.flatnonzero(np.asarray(cKDTree(flat).query(at)[0]) > reach_m)
    on[rows] = _across(scene, region, plane, pair, at[rows], hair)
    part = label(on.reshape(shape))[0].ravel()
    own = part[np.flatnonzero(on)[cKDTree(at[on]).query(middle)[1]]] if on.any() else np.zeros(len(middle), np.int64)
    out = []
    for number in np.unique(own[own > 0]):
        near = np.flatnonzero(np.asarray(cKDTree(at[part == number]).query(at, distance_upper_bound=reach_m)[0]) < np.inf)
        out.append((own == number, at[near[_across(scene, region, plane, pair, at[near], hair)]]))
    return out, pixel


def _plane(mesh: TriangleMesh, own: BoolArray, normals: FloatArray) -> Plane:
    normal = normals[own][0]
    return Plane(normal=normal, offset=float((mesh.vertices[mesh.faces[own]].reshape(-1, 3) @ normal).mean()))


def _hair(mesh: TriangleMesh) -> float:
    return HAIR * float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def _under(scene: RayScene, places: FloatArray, normal: FloatArray, hair: float) -> IntArray:
    """(k,) the face that lies under each place of a face, across the solid; -1 none."""
    return first_hits(scene, places - hair * normal, np.tile(-normal, (len(places), 1)))[1]


def _across(scene: RayScene, region: IntArray, plane: Plane, pair: tuple[int, int], places: FloatArray, hair: float) -> BoolArray:
    """(k,) places (k, 2) that lie on the first face and over the second."""
    at = places @ plane.axes() + plane.offset * plane.normal
    distance, top = first_hits(scene, at + hair * plane.normal, np.tile(-plane.normal, (len(at), 1)))
    under = _under(scene, at, plane.normal, hair)
    return np.asarray((top >= 0) & (region[top] == pair[0]) & (distance < 2.0 * hair) & (under >= 0) & (region[under] == pair[1]))


def _ring_count(
    scene: RayScene, region: IntArray, plane: Plane, pair: tuple[int, int], middle: FloatArray, radius: float, flat: FloatArray, hair: float
) -> float:
    """Points that the ring round an empty circle, up to twice its radius, foretells for it: as dense there as beside it."""
    ring = middle + radius * _sunflower(1.0, 2.0)
    share = float(_across(scene, region, plane, pair, ring, hair).mean())
    off = np.linalg.norm(flat - middle, axis=1)
    return float(np.sum((off > (1.0 + HAIR) * radius) & (off <= 2.0 * radius))) / max(3.0 * share, 1.0 / RING)


def _sunflower(inner: float, outer: float) -> FloatArray:
    """(RING, 2) places spread evenly between two circles."""
    angle = np.arange(RING) * (np.pi * (3.0 - math.sqrt(5.0)))
    share = (np.arange(RING) + 0.5) / RING
    return np.asarray(np.sqrt(inner**2 + (outer**2 - inner**2) * share)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))
