"""Gaps of a body of revolution: what was measured elsewhere round its axis is carried round to where nobody looked.

Every normal of such a body meets its axis, and all its points lie on one curve of the half-plane beside it, its meridian (Pottmann, Wallner,
"Computational Line Geometry", 2001). Where all points of a scan say so, a place that was not measured has others of its own ring to go by. A quarter
of a ring must have been measured, and no sight line may pass through the wall there; a rim that nobody saw lies where both faces of its wall end, if
sight lines pass just beyond. The points put there are inferred, and told so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtri

from scan2fea.kernel.inferred import with_inferred
from scan2fea.kernel.noise import noise_there, sampled_rows
from scan2fea.reconstruction.evidence import Evidence
from scan2fea.reconstruction.wall_ends import BEYOND, passed
from scan2fea.reconstruction.wall_ends import IN_WALL as BESIDE_MIDDLE
from scan2fea.types import BoolArray, FloatArray, IntArray, PointCloud, Value

POINTS = 4000  # from which the axis is found
ROUNDS = 12  # of weighting, and of settling
ONE_AXIS = 0.05  # mean square sine by which normals miss any other axis: spheres and plates have many
NEAR, NEAR_SIGMAS = 0.15, 4.0  # spacings and noises: reach in the half-plane within which points tell where the meridian lies
OFF, OFF_SIGMAS = 0.1, 3.0  # the same: how far a point may lie off it
LEANS = 0.5  # sine between a normal and its half-plane, noise and edges included
BESIDE = 0.01  # of the points may do so
BY_CHANCE, BEND_SPACING = 1e-3, 0.02  # of places scatter so about a meridian that noise alone left; spacings by which it is bent between neighbours
STEP = 0.7  # spacings between stations along the meridian, and between places round a ring
ALIKE = 0.7  # cosine of normals of one face
GAP, FREE = 1.75, 0.6  # spacings from points of the same face: random ones leave 0.03 % of a surface so bare; and of the places put in a gap
MEASURED, SECTOR = 0.25, 3.0  # of a ring, in sectors of so many spacings
ENDS, WIDEST = 0.25, 12.0  # spacings that the end of a face lies off the middle of its points, and between the two faces of a wall
SLACK = 0.25  # of the wall, or of BEYOND spacings: so near beyond a rim sight lines pass, BESIDE_MIDDLE of the wall off its middle
LEAST_PAST, GRAZES = 3, 0.1  # places where they do; cosine of a sight line with a normal of the wrong side
SEEN_THROUGH = 0.1  # of the places round one, through whose wall sight lines pass: as in `round_gaps`
LEAST, FEW = 12, 6  # points of a scan, and near one to tell how the meridian runs there
MOST = 0.5  # of all places on the body: at most so many may lie in gaps


@dataclass(frozen=True, eq=False, kw_only=True)
class Axis(Value):
    """point, way : (3,) of a line, `way` unit."""

    point: FloatArray
    way: FloatArray

    def frame(self) -> FloatArray:
        """(2, 3) unit vectors across it."""
        one = np.linalg.svd(self.way[None])[2][1]
        return np.stack([one, np.cross(self.way, one)])

    def meridian(self, points: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n, 2) z and r of points, (n, 2) their normals in the half-plane, (n,) sine by which normals lean out of it."""
        q = points - self.point
        z = q @ self.way
        out = q - z[:, None] * self.way
        r = np.linalg.norm(out, axis=1)
        out = out / np.maximum(r, 1e-300)[:, None]
        within = np.stack([normals @ self.way, np.einsum("ij,ij->i", normals, out)], axis=1)
        return np.stack([z, r], axis=1), within, np.abs(np.einsum("ij,ij->i", normals, np.cross(self.way, out)))


def with_turned(cloud: PointCloud, evidence: Evidence) -> PointCloud | None:
    """The cloud with points on unseen places of a body of revolution; None where it is none, or nothing is missing.

    evidence : a first surface of `cloud`, its sensors known.
    """
    measured = np.flatnonzero(np.ones(len(cloud), bool) if cloud.is_inferred is None else ~cloud.is_inferred)
    points, normals = evidence.points[measured], _towards(evidence)[measured]
    if evidence.sensors is None or len(points) < LEAST:
        return None
    axis = axis_of(points, normals)
    axis = None if axis is None else settled(axis, points, normals, evidence.spacing_m, evidence.sigma_m)
    if axis is None:
        return None
    near = _Near.of(axis, points, normals, NEAR * evidence.spacing_m + NEAR_SIGMAS * evidence.sigma_m)
    if np.bincount(near.one).max() < FEW:
        return None
    stations = _stations(near, evidence.thickness_m[measured], evidence.spacing_m)
    places, out, of = _missing(axis, evidence, points, near, stations)
    keep = _unseen(places, out, of, stations, evidence)
    return with_inferred(cloud, places[keep], out[keep]) if keep.any() else None


def _towards(evidence: Evidence) -> FloatArray:
    """(n, 3) normals, turned to where each point was seen from: of a rim one row wide the side is easily lost."""
    if evidence.sensors is None:
        return evidence.normals
    way = evidence.sensors - evidence.points
    cosine = np.einsum("ij,ij->i", way, evidence.normals) / np.maximum(np.linalg.norm(way, axis=1), 1e-300)
    return np.asarray(evidence.normals * np.where(cosine < -GRAZES, -1.0, 1.0)[:, None])  # nan: as it is


def axis_of(points: FloatArray, normals: FloatArray) -> Axis | None:
    """The line that the normals (n, 3) at points (n, 3) meet: least squares of moments, those that miss it weighing less; None where many do."""
    rows = sampled_rows(len(points), POINTS, 0)
    middle = points.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((points - middle) ** 2, axis=1))))
    if size <= 0.0:
        return None
    lines = np.concatenate([np.cross((points[rows] - middle) / size, normals[rows]), normals[rows]], axis=1)
    weight = np.ones(len(rows))
    for _ in range(ROUNDS):
        squares = lines.T @ (weight[:, None] * lines) / weight.sum()
        solved = -np.linalg.pinv(squares[3:, 3:], rcond=1e-9, hermitian=True) @ squares[3:, :3]
        value, vector = np.linalg.eigh(squares[:3, :3] + squares[:3, 3:] @ solved)
        way = vector[:, 0]
        miss = np.abs(lines @ np.concatenate([way, solved @ way]))
        weight = 1.0 / (1.0 + (miss / max(float(np.median(miss)), 1e-9)) ** 2)
    if value[1] < ONE_AXIS:
        return None
    return Axis(point=middle + size * np.cross(way, solved @ way), way=way)


def settled(axis: Axis, points: FloatArray, normals: FloatArray, spacing_m: float, sigma_m: float) -> Axis | None:
    """The axis about which the points (n, 3) lie nearest to one meridian; None where some lie off it, or face out of their half-planes."""
    reach, off = NEAR * spacing_m + NEAR_SIGMAS * sigma_m, OFF * spacing_m + OFF_SIGMAS * sigma_m
    rows = sampled_rows(len(points), POINTS, 0)
    for _ in range(ROUNDS):
        near = _Near.of(axis, points[rows], normals[rows], reach)
        slopes = near.slopes(axis, points[rows])
        held = np.abs(near.height) <= max(off, float(np.median(np.abs(near.height))))
        step = np.linalg.lstsq(slopes[held], -near.height[held], rcond=1e-6)[0]
        e = axis.frame()
        way = axis.way + step[2:] @ e
        axis = Axis(point=axis.point + step[:2] @ e, way=way / np.linalg.norm(way))
    near = _Near.of(axis, points[rows], normals[rows], reach)
    leans = axis.meridian(points[rows], normals[rows])[2] > LEANS
    fills = near.scatter > near.due(np.maximum(sigma_m**2, noise_there(points, normals, rows))) + BEND_SPACING * spacing_m  # of an oval, or a flat
    return axis if np.mean(fills) <= BESIDE and np.mean((np.abs(near.height) > off) | leans) <= BESIDE else None


@dataclass(frozen=True, eq=False, kw_only=True)
class _Near(Value):
    """Points in the half-plane against the line through those near them, of their side.

    at, normal : (n, 2) places, and normals of those lines.   height : (n,) over them.   scatter : (n,) of its neighbours about each line.
    one, other : (k,) the pairs of neighbours.
    """

    at: FloatArray
    normal: FloatArray
    height: FloatArray
    scatter: FloatArray
    one: IntArray
    other: IntArray

    @classmethod
    def of(cls, axis: Axis, points: FloatArray, normals: FloatArray, reach_m: float) -> _Near:
        at, within, _ = axis.meridian(points, normals)
        pairs = cKDTree(at).query_pairs(reach_m, output_type="ndarray")
        pairs = pairs[np.einsum("ij,ij->i", within[pairs[:, 0]], within[pairs[:, 1]]) > 0]
        itself = np.repeat(np.arange(len(at))[:, None], 2, axis=1)
        one, other = np.concatenate([pairs, pairs[:, ::-1], itself]).T
        n = np.bincount(one, minlength=len(at))
        middle = _sums(at, one, other) / n[:, None]
        (z, r), (x, y) = at.T, middle.T
        zz, zr, rr = (_sums(np.stack([z * z, z * r, r * r], axis=1), one, other) / n[:, None]).T - np.stack([x * x, x * y, y * y])
        angle = 0.5 * np.arctan2(2.0 * zr, zz - rr) + 0.5 * np.pi  # of the direction of least spread
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        given = within / np.maximum(np.linalg.norm(within, axis=1), 1e-300)[:, None]
        normal = np.where((n < FEW)[:, None], given, normal * np.where(np.einsum("ij,ij->i", normal, within) < 0, -1.0, 1.0)[:, None])
        scatter = np.sqrt(np.maximum(0.5 * (zz + rr - np.hypot(zz - rr, 2.0 * zr)), 0.0))
        return cls(at=at, normal=normal, height=np.einsum("ij,ij->i", at - middle, normal), scatter=scatter, one=one, other=other)

    def due(self, variance: FloatArray) -> FloatArray:
        """(n,) scatter about a line that noise of this variance, (n,) at each point, passes by chance in one place of a thousand.

        Of the neighbours of a place two numbers are its line's; those of other places round the ring may be noisier: rays met the wall there.
        """
        n = np.bincount(self.one, minlength=len(self.at))
        mean = _sums(variance[:, None], self.one, self.other)[:, 0] / n
        return np.asarray(np.sqrt(mean * np.where(n > 2, chdtri(np.maximum(n - 2, 1), BY_CHANCE), 0.0) / n))

    def slopes(self, axis: Axis, points: FloatArray) -> FloatArray:
        """(n, 4) of the heights, by shift and tilt of the axis.

        A shift s takes s . away from r; a tilt t takes z t . away from r and adds r t . away to z.
        """
        z, r = self.at.T
        away = (points - axis.point) @ axis.frame().T / np.maximum(r, 1e-300)[:, None]
        tilt = self.normal[:, 0] * r - self.normal[:, 1] * z
        own = np.concatenate([-self.normal[:, 1:] * away, tilt[:, None] * away], axis=1)
        return np.asarray(own - _sums(own, self.one, self.other) / np.bincount(self.one, minlength=len(z))[:, None])


def _sums(values: FloatArray, one: IntArray, other: IntArray) -> FloatArray:
    """(n, c) of the values (n, c) of all neighbours of each."""
    return np.stack([np.bincount(one, column[other], minlength=len(values)) for column in values.T], axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Stations(Value):
    """Where the meridian was measured, a step apart, and the rims that close it where it ends.

    at, normal : (k, 2) in the half-plane.   rows : of the points of the same face round each, of a rim those of both faces that end there.
    wall_m : (k,).   is_rim, is_end : (k,) nothing was measured on it; its face ends there.
    """

    at: FloatArray
    normal: FloatArray
    rows: tuple[IntArray, ...]
    wall_m: FloatArray
    is_rim: BoolArray
    is_end: BoolArray


def _stations(near: _Near, thickness_m: FloatArray, spacing_m: float) -> _Stations:
    foot = near.at - near.height[:, None] * near.normal
    # where it ends, points have few neighbours: stations begin there
    count = np.bincount(near.one)
    order = np.argsort(count, kind="stable")
    order = order[count[order] >= FEW]  # of fewer the normal is not known
    chosen = order[_apart(np.concatenate([foot, spacing_m * near.normal], axis=1)[order], STEP * spacing_m)]
    at, normal = foot[chosen], near.normal[chosen]
    tree = cKDTree(foot)

    near_by = [np.array(own, np.int64) for own in tree.query_ball_point(at, spacing_m)]
    rows = [own[near.normal[own] @ way >= ALIKE] for own, way in zip(near_by, normal, strict=True)]
    known = [thickness_m[own][np.isfinite(thickness_m[own])] for own in rows]
    wall = [float(np.median(own)) if len(own) else 2.0 * spacing_m for own in known]
    middle = np.stack([foot[own].mean(axis=0) for own in rows])
    is_end = np.abs(np.einsum("ij,ij->i", at - middle, _along(normal))) >= ENDS * spacing_m
    for a, b in _ends(at, normal, middle, spacing_m):
        across = at[b] - at[a]
        width = float(np.linalg.norm(across))
        share = np.linspace(0.0, 1.0, max(3, int(np.ceil(width / (STEP * spacing_m))) + 1))[1:-1]
        way = np.array([-across[1], across[0]]) / width
        way *= np.sign(way @ (at[a] - middle[a]))
        at, normal = np.concatenate([at, at[a] + share[:, None] * across]), np.concatenate([normal, np.tile(way, (len(share), 1))])
        rows += [np.concatenate([rows[a], rows[b]])] * len(share)
        wall += [width] * len(share)
    is_rim = np.arange(len(at)) >= len(chosen)
    is_end = np.append(is_end, np.ones(len(at) - len(chosen), bool))
    return _Stations(at=at, normal=normal, rows=tuple(rows), wall_m=np.array(wall), is_rim=is_rim, is_end=is_end)


def _along(normal: FloatArray) -> FloatArray:
    """(k, 2) directions along the meridian."""
    return np.stack([-normal[:, 1], normal[:, 0]], axis=1)


def _ends(at: FloatArray, normal: FloatArray, middle: FloatArray, spacing_m: float) -> list[tuple[int, int]]:
    """Pairs of stations at which the two faces of a wall end side by side. middle : (k, 2) of the points round each, off it where a face ends."""
    off = np.einsum("ij,ij->i", at - middle, _along(normal))
    out = _along(normal) * np.sign(off)[:, None]
    ends = np.flatnonzero(np.abs(off) >= ENDS * spacing_m)
    pairs = set[tuple[int, int]]()
    for a in ends.tolist():
        across = at[ends] - at[a]
        width = np.linalg.norm(across, axis=1)
        are = (normal[ends] @ normal[a] <= -ALIKE) & (out[ends] @ out[a] >= ALIKE) & (np.abs(across @ out[a]) <= ENDS * spacing_m)
        are &= (across @ normal[a] < 0.0) & (width <= WIDEST * spacing_m)
        if are.any():
            b = int(ends[np.argmin(np.where(are, width, np.inf))])
            pairs.add((min(a, b), max(a, b)))
    return sorted(pairs)


def _missing(
    axis: Axis, evidence: Evidence, points: FloatArray, near: _Near, stations: _Stations
) -> tuple[FloatArray, FloatArray, IntArray]:
    """(k, 3) places on rings a quarter of which was measured, where nothing was, their outward normals, and (k,) the station of each.

    points : (n, 3) measured, those of `near`.
    """
    h, e, lines = evidence.spacing_m, axis.frame(), _lines(evidence)
    angle = np.arctan2(*((points - axis.point) @ e.T).T[::-1])
    places, out, of = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0, np.int64)]
    for k, (z, r) in enumerate(stations.at):
        normal, thick, seen_at = stations.normal[k], float(stations.wall_m[k]), angle[stations.rows[k]]
        n = max(1, int(np.ceil(2.0 * np.pi * r / (STEP * h))))
        turn = 2.0 * np.pi * (np.arange(n) + 0.5 * (k % 2)) / n - np.pi
        away = np.column_stack([np.cos(turn), np.sin(turn)]) @ e
        ring, ways = axis.point + z * axis.way + r * away, normal[0] * axis.way + normal[1] * away
        if _sectors(seen_at, r, h) < MEASURED:
            continue
        if stations.is_rim[k]:
            past = passed(ring + SLACK * max(thick, BEYOND * h) * ways, *lines, BESIDE_MIDDLE * thick)
            if past.sum() < LEAST_PAST:
                continue
        places.append(ring)
        out.append(ways)
        of.append(np.full(n, k))
    found, ways, number = np.concatenate(places), np.concatenate(out), np.concatenate(of)
    # in six dimensions, place and normal: points of another face are out of reach
    z, r = near.at.T
    away = (points - axis.point - z[:, None] * axis.way) / np.maximum(r, 1e-300)[:, None]
    seen = cKDTree(np.concatenate([points, GAP * h * (near.normal[:, :1] * axis.way + near.normal[:, 1:] * away)], axis=1))
    far = np.asarray(seen.query(np.concatenate([found, GAP * h * ways], axis=1))[0])
    core = far > GAP * h
    if not core.any() or core.mean() > MOST:
        return found[:0], ways[:0], number[:0]
    chosen = (far > FREE * h) & (np.asarray(cKDTree(found[core]).query(found)[0]) <= GAP * h)
    return found[chosen], ways[chosen], number[chosen]


def _lines(evidence: Evidence) -> tuple[FloatArray, FloatArray]:
    """(k, 3) sensors and (k, 3) points of the sight lines."""
    sensors = np.zeros((0, 3)) if evidence.sensors is None else evidence.sensors
    known = np.flatnonzero(np.isfinite(sensors).all(axis=1))
    return np.ascontiguousarray(sensors[known]), np.ascontiguousarray(evidence.points[known])


def _apart(values: FloatArray, apart: float) -> list[int]:
    """Rows of (n, c) values, each farther than `apart` from those before it."""
    tree, free, out = cKDTree(values), np.ones(len(values), bool), list[int]()
    for k in range(len(values)):
        if free[k]:
            out.append(k)
            free[tree.query_ball_point(values[k], apart)] = False
    return out


def _sectors(angle: FloatArray, radius_m: float, spacing_m: float) -> float:
    """Share of a ring's sectors, three spacings wide, that hold points."""
    n = max(1, int(2.0 * np.pi * radius_m / (SECTOR * spacing_m)))
    return len(np.unique(np.floor((angle / (2.0 * np.pi) + 0.5) * n).clip(0, n - 1))) / n


def _unseen(places: FloatArray, out: FloatArray, of: IntArray, stations: _Stations, evidence: Evidence) -> BoolArray:
    """(k,) places on rings through whose wall no sight lines pass. out : (k, 3) outward normals.   of : (k,) their stations.

    A few lines side by side have seen an opening, and a ring that is open somewhere is none. At the end of a face they may pass beside it: there
    those places alone are left out.
    """
    lines, reach = _lines(evidence), GAP * evidence.spacing_m
    through = np.zeros(len(places), bool)
    for k in np.unique(of):
        wall, own = float(stations.wall_m[k]), np.flatnonzero(of == k)
        through[own] = passed(places[own] - 0.5 * wall * out[own], *lines, BESIDE_MIDDLE * wall)
    if not through.any():
        return ~through
    sided = np.concatenate([places, reach * out], axis=1)
    every, seen = (np.asarray(cKDTree(sided[own]).query_ball_point(sided, reach, return_length=True)) for own in (through | True, through))
    is_open = (seen >= LEAST_PAST) & (seen > SEEN_THROUGH * every)
    return np.asarray(~is_open & ~np.isin(of, np.unique(of[is_open & ~stations.is_end[of]])))
