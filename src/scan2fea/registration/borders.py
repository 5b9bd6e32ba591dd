"""Straight borders of planes: what holds a sensor's way along a floor, a wall or a beam, which their planes leave free.

A surface ends, along a ring, between the last beam that met it and the next one, that went on farther or did not come back. The ray in the middle
meets the plane of that surface in a point that owes nothing to the noise of ranges: half a step of the azimuth is all that is not known. Where the
next beam ended on something nearer, that thing's shadow is what ends, which moves with the sensor: such places are not used, nor is a line that
stays with the sensor (the end of its reach, a cut of its view), nor one seen from beyond, where the face below the border may come first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.jit import jit
from scan2fea.kernel.trajectories import between
from scan2fea.registration.icp import tukey
from scan2fea.registration.map_patches import FLATTEST
from scan2fea.registration.map_planes import MapPlanes
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

_FARTHER = 6.0  # sigma: how much farther the next beam must have gone
_GATE = 4.0  # sigma across its plane that a last return may lie
_LEAST, _LEAST_SWEEPS, _LEAST_EDGES = 20, 3, 6.0  # ends and sweeps of a border, and its length in voxel edges: longer than any patch
_TOLERANCE = 0.5  # edges across a border while it is sought
_ANGLES, _VOTERS, _MOST = 90, 2_000, 50
_REFITS = 6
_ALONG = 0.2  # a ring that runs along a border ends within this share of a step, across it, at best
_STAYS = 0.9  # of its scatter in the world: a line that scatters less than this about the sensor stays with it
_MAD = 1.4826


@dataclass(frozen=True, eq=False, kw_only=True)
class Ends(Value):
    """points : (m, 3) in the frame of the sensor at their moments, at the range of the last return, half a step beyond it.   sweep, share : (m,)
    as of `Sweeps`, rising.   half_rad : half a step of the azimuth.
    """

    points: FloatArray
    sweep: IntArray
    share: FloatArray
    half_rad: float

    def reversed(self, n_sweeps: int) -> Ends:
        """As seen backwards in time."""
        return Ends(points=self.points[::-1], sweep=n_sweeps - 1 - self.sweep[::-1], share=1.0 - self.share[::-1], half_rad=self.half_rad)


@dataclass(frozen=True, eq=False, kw_only=True)
class Borders(Value):
    """Residuals of ends on borders. first, share : (m,) knot before each end and share of the way to the next.   across : (m,) metres off its
    border, within the plane.   own : (m, 6) its derivative by a turn about the sensor and a shift of it.   terms : (m, 3) by the border's shift and
    turn (the third is 0).   deviation : (m,).   label : (m,) border.   n : of them.
    """

    first: IntArray
    share: FloatArray
    across: FloatArray
    own: FloatArray
    terms: FloatArray
    deviation: FloatArray
    label: IntArray
    n: int


def surface_ends(points: FloatArray, ring: IntArray, sweep: IntArray, share: FloatArray, sigma_m: float) -> Ends | None:
    """Where surfaces end along the rings of a scanner that turns about its z axis; None where the steps of its azimuth are not told.

    points : (n, 3) in the frame of the sensor at their moments, in sweep (n,) at share (n,) of its time, from beam `ring` (n,).
    """
    at = sweep + share
    order = np.lexsort((at, ring))
    xyz, at, ring = points[order], at[order], ring[order]
    r = np.linalg.norm(xyz, axis=1)
    same, turned = np.diff(ring) == 0, np.diff(at)
    if not same.any():
        return None
    step = float(np.median(turned[same]))
    beside = same & (turned < 1.5 * step)
    if not 0 < step < 0.05 or not beside.any():
        return None
    sense = math.copysign(1.0, float(np.median((xyz[:-1, 0] * xyz[1:, 1] - xyz[:-1, 1] * xyz[1:, 0])[beside])))
    found, moments = [], []
    for way, farther in ((1.0, np.append(r[1:] - r[:-1], 0.0)), (-1.0, np.insert(r[:-1] - r[1:], 0, 0.0))):
        goes_on = np.append(beside, False) if way > 0 else np.insert(beside, 0, False)
        rows = np.flatnonzero(~goes_on | (farther > _FARTHER * sigma_m))
        c, s = math.cos(math.pi * step), way * sense * math.sin(math.pi * step)
        x, y, z = xyz[rows].T
        found.append(np.stack([c * x - s * y, s * x + c * y, z], axis=1))
        moments.append(at[rows] + 0.5 * way * step)
    every, when = np.concatenate(found), np.concatenate(moments)
    order = np.argsort(when, kind="stable")
    order = order[(when[order] >= 0) & (when[order] < int(sweep.max()) + 1)]
    first = np.floor(when[order]).astype(np.int64)
    return Ends(points=every[order], sweep=first, share=when[order] - first, half_rad=math.pi * step)


def borders(ends: Ends, T_world_knot: FloatArray, planes: MapPlanes, world: FloatArray, edge_m: float, sigma_m: float) -> Borders | None:
    """Straight borders of planes under poses T_world_knot (k, 4, 4), None where there is none.

    planes, world : of the points (n, 3) that are on them or on none.   edge_m : of the voxels that the planes grew over.
    """
    R, x = between(T_world_knot, ends.sweep, ends.share)
    arm = np.einsum("nij,nj->ni", R, ends.points)
    far = np.linalg.norm(arm, axis=1)
    ray = arm / np.maximum(far, 1e-300)[:, None]
    step = ends.half_rad * np.cross(R[:, :, 2], arm)  # of a point, when its ray turns by half a step
    on = np.flatnonzero(planes.label >= 0)
    if not len(on):
        return None
    distance, near = cKDTree(world[on]).query(x + arm, k=1, distance_upper_bound=2.0 * edge_m, workers=1)
    plane = np.where(np.isfinite(distance), planes.label[on][np.minimum(np.asarray(near, np.int64), len(on) - 1)], -1)
    parts, n = [], 0
    for rows, k in _by_plane(plane):
        normal, centre = planes.normal[k], planes.centre[k]
        slope, off = ray[rows] @ normal, (x[rows] + arm[rows] - centre) @ normal
        flat = np.maximum(np.abs(slope), FLATTEST)
        kept = (np.abs(slope) >= FLATTEST) & (np.abs(off) < _GATE * sigma_m * flat)
        rows, slope, off = rows[kept], slope[kept], off[kept]
        meets = arm[rows] - ray[rows] * (off / slope)[:, None]
        flat_xy = np.ascontiguousarray((x[rows] + meets - centre) @ planes.axes[k].T)
        for line in _lines(flat_xy, ends.sweep[rows], _TOLERANCE * edge_m, _LEAST_EDGES * edge_m):
            off_along, m, moves, deviation = _fitted(flat_xy[line], ray[rows[line]], step[rows[line]], normal, planes.axes[k])
            to_sensor = -(meets[line] @ m)  # from the border; seen from beyond it, what ends may be the face below
            inner = to_sensor * float((centre - (x[rows] + meets)[line].mean(axis=0)) @ m) > 0
            if int(inner.sum()) < _LEAST or _spread(to_sensor) < _STAYS * _spread(off_along[:, 0]):
                continue
            line, off_along, moves, deviation = line[inner], off_along[inner], moves[inner], deviation[inner]
            own = np.concatenate([np.cross(meets[line], moves), moves], axis=1)
            terms = np.stack([np.ones(len(line)), off_along[:, 1], np.zeros(len(line))], axis=1)
            parts.append((rows[line], off_along[:, 0], own, terms, deviation, np.full(len(line), n)))
            n += 1
    if not parts:
        return None
    rows, across, own, terms, deviation, label = (np.concatenate([part[i] for part in parts]) for i in range(6))
    return Borders(
        first=ends.sweep[rows], share=ends.share[rows], across=across, own=own, terms=terms, deviation=deviation, label=label, n=n
    )


def _by_plane(plane: IntArray) -> Iterator[tuple[IntArray, int]]:
    """Rows of each plane that has enough of them for a border."""
    order = np.argsort(plane, kind="stable")
    found, begin = np.unique(plane[order], return_index=True)
    for k, rows in zip(found.tolist(), np.split(order, begin[1:]), strict=True):
        if k >= 0 and len(rows) >= _LEAST:
            yield rows, k


def _fitted(
    xy: FloatArray, ray: FloatArray, step: FloatArray, normal: FloatArray, axes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Of points xy (n, 2) of one border: (n, 2) off it and along it, its normal (3,) within the plane, and derivative (n, 3) of the first by a shift
    of the ray, and its deviation (n,).

    A point shifted by d moves along its ray until it is back on the plane: by m . (d - u (n . d) / (n . u)) across the border, with m its normal.
    """
    weight = np.ones(len(xy))
    for _ in range(_REFITS):
        middle = np.average(xy, axis=0, weights=weight)
        turn = np.linalg.eigh(np.cov((xy - middle).T, aweights=weight))[1]
        m = turn[:, 0] @ axes
        moves = m - normal * ((ray @ m) / (ray @ normal))[:, None]
        across = (xy - middle) @ turn[:, 0]
        even = np.maximum(np.abs(np.einsum("nc,nc->n", step, moves)), _ALONG * np.linalg.norm(step, axis=1)) / math.sqrt(3.0)
        deviation = even * max(1.0, _MAD * float(np.median(np.abs(across) / even)))
        weight = (tukey(across, deviation) + 1e-9) / deviation**2
    return (xy - middle) @ turn, m, moves, deviation


def _spread(values: FloatArray) -> float:
    return float(np.median(np.abs(values - np.median(values))))


def _lines(xy: FloatArray, sweep: IntArray, tolerance: float, least_m: float) -> list[IntArray]:
    """Rows of each straight line among points xy (n, 2), the fullest first."""
    lines: list[IntArray] = []
    free = np.arange(len(xy))
    while len(free) >= _LEAST and len(lines) < _MOST:
        angle, offset = _fullest(xy[free[:: max(1, len(free) // _VOTERS)]], _ANGLES, 2.0 * tolerance)
        inside = np.abs(xy[free] @ np.array([math.cos(angle), math.sin(angle)]) - offset) <= 1.5 * tolerance
        inside = _settled(xy[free], inside, tolerance)
        if int(inside.sum()) < _LEAST:
            return lines
        own = xy[free[inside]]
        if float(np.linalg.norm(np.ptp(own, axis=0))) >= least_m and len(np.unique(sweep[free[inside]])) >= _LEAST_SWEEPS:
            lines.append(free[inside])
        free = free[~inside]
    return lines


def _settled(xy: FloatArray, inside: BoolArray, tolerance: float) -> BoolArray:
    """Points within the tolerance of the line that those inside are of."""
    for _ in range(4):
        if int(inside.sum()) < _LEAST:
            break
        middle = xy[inside].mean(axis=0)
        normal = np.linalg.eigh(np.cov((xy[inside] - middle).T))[1][:, 0]
        inside = np.abs((xy - middle) @ normal) <= tolerance
    return inside


@jit
def _fullest(xy: FloatArray, n_angles: int, width: float) -> tuple[float, float]:
    """Angle of the normal and offset of the middle of the strip of a width that holds most points."""
    best, at, offset = 0, 0.0, 0.0
    for k in range(n_angles):
        angle = math.pi * k / n_angles
        across = np.sort(xy[:, 0] * math.cos(angle) + xy[:, 1] * math.sin(angle))
        last = 0
        for first in range(len(across)):
            while last < len(across) and across[last] <= across[first] + width:
                last += 1
            if last - first > best:
                best, at, offset = last - first, angle, across[first] + 0.5 * width
    return at, offset
