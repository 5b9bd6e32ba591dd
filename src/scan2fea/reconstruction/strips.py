"""Planes of faces one row of points wide: the rim of a plate, the toe of an angle. Their points tell no normal; the closed surface round them does.

What a first surface has beside the planes already known is averaged over about a wall, which turns its rounded rim into one direction. The points
there then say how far out the rim lies: those of the two faces end at it, its own lie on it, all in the noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.jit import jit
from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.primitives import Plane, fit_plane
from scan2fea.reconstruction.plane_growing import LEAST_POINTS as LEAST_GROWN
from scan2fea.reconstruction.plane_growing import SPACINGS, Planes, interleaved, robust_plane, tolerance_m
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

BESIDE = 0.1  # spacings a face may lie off a plane that it belongs to, besides the noise
LEANS = np.cos(np.radians(35.0))
SNAP = np.cos(np.radians(20.0))  # to a direction that the known planes give
CLEARLY = 1.5  # times the points of any other plane that one must hold along a direction that a strip does not have
TURNED_IN = np.cos(np.radians(45.0))  # of the faces of a strip between two faces of a tube: the first surface rounds both its edges
ALIKE_DEG = 3.0
DEPTH = 0.5  # spacings a strip's faces may lie off its plane, besides the noise
LEAST_AREA = 4.0  # square spacings of a strip
LEAST_POINTS = 4
NEEDED = 6  # points of a strip that no other plane explains
EXACTLY = 1.0 - 1e-9  # cosine with a direction that was taken over
BACKED = 0.25  # points of a strip per square spacing of it, at least
MOST = 60
EXACT = 1e-12  # spacings: what rounding leaves of an exact offset
EXACTLY_ON, TRIPLES = 1e-6, 200  # spacings that exact points lie off their plane; of a strip an eighth are of its own plane alone
QUIET = 0.01  # spacings: below, the rim is where its exact points are
WINDOW = 3.0  # spacings inwards from a rim that are looked at
MIX_ROUNDS = 8
MOST_LOOKS = 20  # at each point: parts with narrow faces take up to three; a surface rough all over would take hundreds and has none


@dataclass(frozen=True, eq=False, kw_only=True)
class _Left(Value):
    """The faces of the first surface that no plane explains: their middles, areas, local directions (shorter where these differ), points."""

    middle: FloatArray
    area: FloatArray
    direction: FloatArray
    length: FloatArray
    point_face: IntArray
    point: IntArray


def with_strips(
    points: FloatArray, planes: Planes, mesh: TriangleMesh, wall_m: float, spacing_m: float, sigma_m: float, axes: FloatArray | None = None
) -> Planes:
    """`planes` and those of the narrow faces of `mesh` that they do not explain.   wall_m : the thinner walls, nan: none.

    axes : (k, 3) other directions that faces may have: those of cylinders.
    """
    planes = needed(points, planes, spacing_m, sigma_m)
    left = _left(points, planes, mesh, wall_m, spacing_m, sigma_m)
    ways = ways_of(planes.normal if axes is None else np.vstack([planes.normal, axes]))
    depth = DEPTH * spacing_m + 2.0 * sigma_m
    label, free = planes.label.copy(), np.ones(len(left.area), bool)
    found: list[Plane] = []
    spread: list[float] = []

    def take(plane: Plane, own: BoolArray, on: IntArray) -> None:
        free[own] = False
        label[on] = len(planes) + len(found)
        found.append(plane)
        spread.append(max(sigma_m, plane.rms_m) / np.sqrt(max(1, len(on))))

    for way in () if axes is None else (*axes, *-axes):
        while (own := _rim_along(left, way, free, depth, LEAST_AREA * spacing_m**2)) is not None:
            rows = left.point[own[left.point_face]]
            plane = _at_rim(points, rows, left, own, way, spacing_m, sigma_m) if len(rows) >= LEAST_POINTS else None
            if plane is None:
                free[own] = False
                continue
            take(plane, own, rows[np.abs(plane.distance(points[rows])) <= tolerance_m(spacing_m, sigma_m)])
    snaps = (left.direction @ ways.T >= SNAP * left.length[:, None]).any(axis=1) if len(ways) else np.zeros(len(left.length), bool)
    looks = 0
    for seed in np.lexsort((-left.length * left.area, ~snaps)):  # directions that the planes give come first
        if not free[seed]:
            continue
        if len(found) >= MOST or looks > MOST_LOOKS * len(points):
            break
        own, area = _own(left.middle, left.area, left.direction, left.length, int(seed), free, depth)
        free[seed] = False
        if area < LEAST_AREA * spacing_m**2:
            continue
        rows = left.point[own[left.point_face]]
        looks += len(rows)
        plane = _placed(points, rows, left, own, ways, spacing_m, sigma_m) if len(rows) >= LEAST_POINTS else None
        if plane is None:
            continue
        on = rows[np.abs(plane.distance(points[rows])) <= tolerance_m(spacing_m, sigma_m)]
        is_told = (ways @ plane.normal > EXACTLY).any() and float(_way(left, own) @ plane.normal) >= SNAP
        if not is_told and not _is_needed(points[on], [*planes_of(planes), *found], spacing_m, sigma_m, NEEDED):
            continue
        take(plane, own, on)
    if not found:
        return planes
    every = Planes(
        normal=np.vstack([planes.normal, [p.normal for p in found]]),
        offset=np.append(planes.offset, [p.offset for p in found]),
        label=label,
        std_m=np.append(planes.std_m, spread),
    )
    return _without_backs(points, _joined(points, every, spacing_m), spacing_m)


def planes_of(planes: Planes) -> list[Plane]:
    return [planes.plane(k) for k in range(len(planes))]


def needed(points: FloatArray, planes: Planes, spacing_m: float, sigma_m: float) -> Planes:
    """The planes without those whose points lie on others anyway: blends of normals along an edge."""
    every = planes_of(planes)
    keep = list(range(len(planes)))
    for k in reversed(range(len(planes))):
        own = points[planes.label == k]
        if len(own) < LEAST_GROWN or not _is_needed(own, [every[j] for j in keep if j != k], spacing_m, sigma_m, LEAST_GROWN):
            keep.remove(k)
    return planes_kept(planes, keep)


def _is_needed(own: FloatArray, others: list[Plane], spacing_m: float, sigma_m: float, least: int) -> bool:
    """Do enough of a plane's points lie on no other plane, whichever way that looks?"""
    off = tolerance_m(spacing_m, sigma_m)
    apart = np.ones(len(own), bool)
    for other in others:
        apart &= np.abs(other.distance(own)) > off
    return int(apart.sum()) >= least


def _joined(points: FloatArray, planes: Planes, spacing_m: float) -> Planes:
    """Planes of one direction that the noise does not part made one; those without points dropped."""
    label, kept = planes.label.copy(), list[int]()
    offset, std = planes.offset.copy(), np.maximum(planes.std_m, EXACT * spacing_m)
    for k in range(len(planes)):
        own = points[label == k]
        if len(own) < LEAST_POINTS:
            label[label == k] = -1
            continue
        for j in kept:
            if planes.normal[j] @ planes.normal[k] < np.cos(np.radians(ALIKE_DEG)):
                continue
            apart = float(np.median(own @ planes.normal[j])) - offset[j]  # of mostly exact points exact
            if abs(apart) <= 3.0 * np.hypot(std[j], std[k]) + SPACINGS * spacing_m:
                weight = std[j] ** 2 / (std[j] ** 2 + std[k] ** 2)
                offset[j] += weight * apart
                std[j] *= np.sqrt(1.0 - weight)
                label[label == k] = j
                break
        else:
            kept.append(k)
    return planes_kept(Planes(normal=planes.normal, offset=offset, label=label, std_m=std), kept)


def _without_backs(points: FloatArray, planes: Planes, spacing_m: float) -> Planes:
    """The planes without those whose points lie on and among the points of a larger plane that faces against them: a wall is thicker than nothing."""
    size = np.bincount(planes.label[planes.label >= 0], minlength=len(planes))
    keep: list[int] = []
    for k in np.argsort(-size, kind="stable").tolist():
        own = points[planes.label == k]
        for j in keep:
            apart = abs(float(np.median(own @ planes.normal[j])) - planes.offset[j])
            near = 3.0 * np.hypot(planes.std_m[j], planes.std_m[k]) + SPACINGS * spacing_m
            faces = planes.normal[j] @ planes.normal[k] <= -np.cos(np.radians(ALIKE_DEG))
            if faces and apart <= near and interleaved(own, points[planes.label == j], planes.plane(j)):
                break
        else:
            keep.append(k)
    return planes_kept(planes, sorted(keep))


def planes_kept(planes: Planes, rows: list[int]) -> Planes:
    """Some of the planes, in the order of `rows`; points of the others are of none."""
    number = np.full(len(planes) + 1, -1, np.int64)
    number[rows] = np.arange(len(rows))
    return Planes(normal=planes.normal[rows], offset=planes.offset[rows], label=number[planes.label], std_m=planes.std_m[rows])


def _left(points: FloatArray, planes: Planes, mesh: TriangleMesh, wall_m: float, spacing_m: float, sigma_m: float) -> _Left:
    normals, middle, areas = face_normals(mesh), mesh.vertices[mesh.faces].mean(axis=1), face_areas(mesh)
    off = BESIDE * spacing_m + sigma_m
    known = np.zeros(len(middle), bool)
    for k in range(len(planes)):
        known |= (np.abs(planes.plane(k).distance(middle)) <= off) & (normals @ planes.normal[k] >= LEANS)
    rest = np.flatnonzero(~known)
    radius = max(2.0 * spacing_m, 0.7 * wall_m if np.isfinite(wall_m) else 0.0)
    direction = np.zeros((len(rest), 3))
    if len(rest):
        vector = areas[rest, None] * normals[rest]
        near = cKDTree(middle[rest])
        pairs = near.query_pairs(radius, output_type="ndarray")
        direction = vector.copy()
        for axis in range(3):
            direction[:, axis] += np.bincount(pairs[:, 0], vector[pairs[:, 1], axis], len(rest))
            direction[:, axis] += np.bincount(pairs[:, 1], vector[pairs[:, 0], axis], len(rest))
        total = areas[rest].copy()
        for one, other in (pairs.T, pairs[:, ::-1].T):
            total += np.bincount(one, areas[rest][other], len(rest))
        direction /= total[:, None]
    on = PointToMesh(mesh).nearest(points).face
    slot = np.full(len(middle), -1, np.int64)
    slot[rest] = np.arange(len(rest))
    rows = np.flatnonzero(slot[on] >= 0)
    length = np.maximum(np.linalg.norm(direction, axis=1), 1e-300)
    return _Left(middle=middle[rest], area=areas[rest], direction=direction, length=length, point_face=slot[on[rows]], point=rows)


@jit
def _own(
    middle: FloatArray, area: FloatArray, direction: FloatArray, length: FloatArray, seed: int, free: BoolArray, depth: float
) -> tuple[BoolArray, float]:
    """The free faces that lean as the seed does and lie as far out, and their area. Columns as in `_Left`."""
    n = len(area)
    own, alike, count = np.zeros(n, np.bool_), np.empty(n, np.int64), 0
    way = direction[seed] / length[seed]
    start = middle[seed, 0] * way[0] + middle[seed, 1] * way[1] + middle[seed, 2] * way[2]
    for i in range(n):
        if free[i] and direction[i, 0] * way[0] + direction[i, 1] * way[1] + direction[i, 2] * way[2] >= LEANS * length[i]:
            alike[count] = i
            count += 1
            own[i] = abs(middle[i, 0] * way[0] + middle[i, 1] * way[1] + middle[i, 2] * way[2] - start) <= depth
    for _ in range(3):
        way = np.zeros(3)
        weight = 0.0
        for k in range(count):
            i = alike[k]
            if own[i]:
                weight += area[i]
                for c in range(3):
                    way[c] += area[i] * direction[i, c]
        if not weight > 0.0:  # none lies within the depth of the others' middle, or only faces without area do
            break
        way /= max(math.sqrt((way**2).sum()), 1e-300)
        mean = 0.0
        for k in range(count):
            i = alike[k]
            if own[i]:
                mean += area[i] / weight * (middle[i, 0] * way[0] + middle[i, 1] * way[1] + middle[i, 2] * way[2])
        for k in range(count):
            i = alike[k]
            own[i] = abs(middle[i, 0] * way[0] + middle[i, 1] * way[1] + middle[i, 2] * way[2] - mean) <= depth
    total = 0.0
    for k in range(count):
        total += area[alike[k]] if own[alike[k]] else 0.0
    return own, total


def _rim_along(left: _Left, way: FloatArray, free: BoolArray, depth: float, least: float) -> BoolArray | None:
    """The free faces that look along a direction, within `depth` of where their area is greatest; None where this is less than `least`."""
    rows = np.flatnonzero(free & (left.direction @ way >= TURNED_IN * left.length))
    height = left.middle[rows] @ way
    order = np.argsort(height, kind="stable")
    rows, height = rows[order], height[order]
    until = np.append(0.0, np.cumsum(left.area[rows]))
    area = until[np.searchsorted(height, height + 2.0 * depth, side="right")] - until[:-1]
    if not len(rows) or area.max() < least:
        return None
    best = height[int(np.argmax(area))]
    own = np.zeros(len(free), bool)
    own[rows[(height >= best) & (height <= best + 2.0 * depth)]] = True
    return own


def _at_rim(points: FloatArray, rows: IntArray, left: _Left, own: BoolArray, way: FloatArray, spacing_m: float, sigma_m: float) -> Plane | None:
    """The plane square to a known direction on which a strip's points lie; None where too few do."""
    start = float(np.average(left.middle[own] @ way, weights=left.area[own]))
    plane = Plane(normal=way, offset=rim_offset(points[rows] @ way, start, spacing_m, sigma_m))
    held = np.abs(plane.distance(points[rows])) <= tolerance_m(spacing_m, sigma_m)
    return plane if held.sum() >= max(LEAST_POINTS, BACKED * float(left.area[own].sum()) / spacing_m**2) else None


def ways_of(normals: FloatArray) -> FloatArray:
    """(k, 3) directions that known planes give: their normals, and the lines in which they meet, both ways."""
    found: list[FloatArray] = []

    def add(way: FloatArray) -> None:
        if all(abs(float(way @ other)) < np.cos(np.radians(ALIKE_DEG)) for other in found):
            found.append(way)

    for normal in normals:
        add(normal)
    for i, first in enumerate(normals):
        for second in normals[i + 1 :]:
            line = np.cross(first, second)
            if np.linalg.norm(line) > 0.5:
                add(line / np.linalg.norm(line))
    return np.array([*found, *[-way for way in found]]).reshape(-1, 3)


def _way(left: _Left, own: BoolArray) -> FloatArray:
    """(3,) which way a strip looks, as the first surface has it."""
    total = (left.area[own, None] * left.direction[own]).sum(axis=0)
    return np.asarray(total / max(float(np.linalg.norm(total)), 1e-300))


def _placed(points: FloatArray, rows: IntArray, left: _Left, own: BoolArray, ways: FloatArray, spacing_m: float, sigma_m: float) -> Plane | None:
    """The plane of a strip: along a direction that the known planes give where one is near, else through its own points."""
    way = _way(left, own)
    near = ways[np.argmax(ways @ way)] if len(ways) else way
    off = tolerance_m(spacing_m, sigma_m)
    choices: list[Plane] = []
    for direction in (near, way) if float(near @ way) >= SNAP else (way,):
        start = float(np.average(left.middle[own] @ direction, weights=left.area[own]))
        choices.append(Plane(normal=direction, offset=rim_offset(points[rows] @ direction, start, spacing_m, sigma_m)))
    choices += _refitted(choices[-1], points[rows], way, off, spacing_m)
    if sigma_m < QUIET * spacing_m:  # what most lie on exactly, however far the faces lean
        exact = _exact_plane(points[rows], way, EXACTLY_ON * spacing_m + 3.0 * sigma_m)
        choices += [] if exact is None else [exact]
    wanted = max(LEAST_POINTS, BACKED * float(left.area[own].sum()) / spacing_m**2)

    def held(plane: Plane) -> int:
        return int((np.abs(plane.distance(points[rows])) <= off).sum())

    if TURNED_IN <= float(near @ way) < SNAP:  # as between an edge and a hollow corner, where faces go on beyond the rim
        along, askew = (Plane(normal=direction, offset=_densest(points[rows] @ direction, 0.5 * off)) for direction in (near, way))
        rivals = [p for p in (*choices, askew, *_refitted(askew, points[rows], way, off, spacing_m)) if float(p.normal @ near) < SNAP]
        if held(along) >= max(wanted, CLEARLY * max(map(held, rivals), default=0)):
            return along
    count = [held(plane) for plane in choices]
    best = int(np.argmax(count))
    if count[0] >= 0.8 * count[best]:  # a direction that other planes share needs no more evidence than another
        best = 0
    return choices[best] if count[best] >= wanted else None


def _refitted(plane: Plane, points: FloatArray, way: FloatArray, off: float, spacing_m: float) -> list[Plane]:
    """The plane through those of (n, 3) points that lie near a plane, where it still looks along `way`."""
    near = np.abs(plane.distance(points)) <= 2.0 * off + 0.1 * spacing_m
    fitted = robust_plane(points[near], way) if near.sum() >= 3 * LEAST_POINTS else None
    return [fitted] if fitted is not None and float(fitted.normal @ way) >= LEANS else []


def _exact_plane(points: FloatArray, way: FloatArray, off: float) -> Plane | None:
    """The plane that looks along `way` and holds most of (n, 3) points within `off`, of those through three of them; None where four are not held."""
    corner = points[np.random.default_rng(0).integers(len(points), size=(TRIPLES, 3))]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    normal *= np.where(normal @ way < 0, -1.0, 1.0)[:, None]
    on = np.abs(points @ normal.T - np.einsum("ij,ij->i", corner[:, 0], normal)) <= off
    held = np.where(normal @ way >= LEANS, on.sum(axis=0), 0)
    best = int(np.argmax(held))
    return fit_plane(points[on[:, best]], towards=way) if held[best] >= LEAST_POINTS else None


def rim_offset(heights: FloatArray, start: float, spacing_m: float, sigma_m: float) -> float:
    """How far out a rim lies, from the heights of the points round it: (1 - w) uniform up to the rim + w on it, both in the noise, most likely.

    heights : (n,) along the rim's direction.   start : a first guess within a spacing or so.
    """
    lowest = start - WINDOW * spacing_m - 2.0 * sigma_m
    u = heights[heights >= lowest]
    if len(u) < LEAST_POINTS:
        return start
    if sigma_m < QUIET * spacing_m:
        return _densest(u, max(sigma_m, 1e-6 * spacing_m))

    def surprise(rim: float) -> float:
        return float(_surprise(u, rim, lowest, sigma_m, 1e-12 * spacing_m))

    reach = spacing_m + 2.0 * sigma_m
    grid = np.linspace(start - reach, start + reach, 41)
    best = grid[int(np.argmin([surprise(float(x)) for x in grid]))]
    step = float(grid[1] - grid[0])
    return float(minimize_scalar(surprise, bounds=(best - step, best + step), method="bounded").x)


def _densest(values: FloatArray, width: float) -> float:
    """The mean of the values in the fullest window of 4 widths."""
    ranked = np.sort(values)
    count = np.searchsorted(ranked, ranked + 4.0 * width, side="right") - np.arange(len(ranked))
    first = int(np.argmax(count))
    return float(ranked[first : first + int(count[first])].mean())


@jit
def _surprise(u: FloatArray, rim: float, lowest: float, sigma: float, least: float) -> float:
    """Minus the log likelihood of heights u under a rim, the share of those on it made most likely in a few rounds."""
    flat, peak = np.empty(len(u)), np.empty(len(u))
    for i in range(len(u)):
        z = (rim - u[i]) / sigma
        flat[i] = 0.5 * math.erfc(-z / math.sqrt(2.0)) / max(rim - lowest, least)
        peak[i] = math.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * sigma)
    share = 0.3
    for _ in range(MIX_ROUNDS):
        total = 0.0
        for i in range(len(u)):
            total += share * peak[i] / max(share * peak[i] + (1.0 - share) * flat[i], 1e-300)
        share = min(max(total / len(u), 1e-3), 0.98)
    out = 0.0
    for i in range(len(u)):
        out -= math.log(max(share * peak[i] + (1.0 - share) * flat[i], 1e-300))
    return out
