"""A wall of free form that is a curve drawn along a direction, as one face: the curve a cubic B-spline through the points of the wall.

What of a wall looks square to an axis of the surfaces in and beside it is begun with. Its length along the curve, s, is the potential whose slope is
the tangent (least squares over the edges of the triangles: noise is evened out over the whole wall). The spline has the number of spans of least
n log(variance) + k log(n); points are led to their feet on it and fitted again (Hoschek's intrinsic parameters).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from scan2fea.cad.patches import GROW_COSINE, Near
from scan2fea.kernel.surfaces import CYLINDER, FREEDOMS, PLANE, Surface
from scan2fea.kernel.topology import face_components
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

EXTRUDED = "extruded"
SQUARE = float(np.sin(np.radians(20.0)))  # normals within this of square to an axis may be of a wall along it
SMALL = 0.01  # of the area: a larger patch is no piece of a wall
SMOOTH = 0.94  # cosine of normals across a border that is no crease
ALIKE = float(np.cos(np.radians(10.0)))  # axes nearer than this are tried once
MOST_AXES = 6
WIDENED = 6  # times that a wall takes the small patches beside it
LEAST_REST = 0.15  # of the area of a wall that one curve does not hold: less is its rims
WIDER = 2.0  # times the tolerance: faces nearer to a curve that holds its wall are of it
FLAT = 0.98  # of its area, the sum of the normals of a wall that hardly bends: a plane
SPANS = (2, 3, 4, 6, 8, 11, 16, 22, 32, 45)  # tried
LEAST_POINTS = 4  # for each pole: fewer do not tell it
LED = 4  # times that points are led to their feet
ON_SPAN = 6  # points at least of an edge: a curl of 0.2 mm between points 1 mm apart is cut off
SAMPLES = 16  # a span, among which a foot is looked for
FEW = 32  # points, of which a search tree does not pay
STIFF = 1e-3  # of the third differences of poles that no point tells: a curve goes on as it ends
SWALLOWED = 0.5  # of the area of a patch on the wall: the rest was no surface of its own


@dataclass(frozen=True, eq=False, kw_only=True)
class Extruded(Surface):
    """The curve `spline` (in the frame of the axis, around `point`) along the axis, its outside to the right of it (`sense` is always 1)."""

    spline: BSpline

    def distance(self, points: FloatArray) -> FloatArray:
        """(n,) signed distance of (n, 3) points, positive outside of the solid."""
        flat, u = self._feet(points)
        tangent = self._tangent(u)
        off = flat - self.spline(u)
        return np.asarray(off[:, 0] * tangent[:, 1] - off[:, 1] * tangent[:, 0])

    def normals(self, points: FloatArray) -> FloatArray:
        """(n, 3) outward unit normals at the foot of each point."""
        tangent = self._tangent(self._feet(points)[1])
        return np.asarray(np.column_stack([tangent[:, 1], -tangent[:, 0]]) @ self.frame())

    def along(self, line: FloatArray) -> FloatArray:
        """A line near the surface led along the curve without a step back, as many points on each span as tell it; as it is where it runs across."""
        u, height = self._feet(line)[1], (line - self.point) @ self.axis
        if abs(u[-1] - u[0]) <= abs(height[-1] - height[0]):
            return line
        ends = np.sort(u[[0, -1]])
        knots = np.unique(self.spline.t)
        stops = np.concatenate([ends[:1], knots[(knots > ends[0]) & (knots < ends[1])], ends[1:]])
        share = np.diff(stops) / max(float(ends[1] - ends[0]), 1e-300)
        many = np.maximum(ON_SPAN, np.ceil(share * len(line))).astype(int)
        spans = zip(stops[:-1].tolist(), stops[1:].tolist(), many.tolist(), strict=True)
        even = np.concatenate([*(np.linspace(a, b, n, endpoint=False) for a, b, n in spans), ends[1:]])
        even = even if u[0] < u[-1] else even[::-1]
        rise = (even - u[0]) / (u[-1] - u[0])
        at = self.point + self.spline(even) @ self.frame()
        return np.asarray(at + (height[0] + rise * (height[-1] - height[0]))[:, None] * self.axis)

    def poles(self) -> FloatArray:
        """(n, 3) control points of the curve."""
        return np.asarray(self.point + self.spline.c @ self.frame())

    def ends(self) -> tuple[float, float]:
        return float(self.spline.t[0]), float(self.spline.t[-1])

    def _feet(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points in the plane across the axis, and the parameter of the foot of each."""
        flat = (np.asarray(points) - self.point) @ self.frame().T
        low, high = self.ends()
        grid = np.linspace(low, high, SAMPLES * (len(self.spline.c) - 3) + 1)
        samples = self.spline(grid)
        if len(flat) <= FEW:
            u = grid[((flat[:, None] - samples) ** 2).sum(2).argmin(1)]
        else:
            u = grid[cKDTree(samples).query(flat)[1]]
        for _ in range(3):  # Newton on (p - C) . C' = 0
            off, slope, bend = flat - self.spline(u), self.spline(u, 1), self.spline(u, 2)
            down = np.maximum((slope * slope).sum(1) - (off * bend).sum(1), 0.1 * (slope * slope).sum(1))
            u = np.clip(u + (off * slope).sum(1) / down, low, high)
        return flat, u

    def _tangent(self, u: FloatArray) -> FloatArray:
        slope = self.spline(u, 1)
        return np.asarray(slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-300))


def with_extruded(
    mesh: TriangleMesh, label: IntArray, surfaces: Sequence[Surface], wall: BoolArray, tolerance: float, spacing: float
) -> tuple[IntArray, list[Surface]]:
    """Labels and surfaces with each wall that a curve drawn along a direction holds; as they were where none does.

    label : (m,) number of the surface of each face, -1 none.   wall : (m,) faces on walls of free form.
    """
    near, out, label = Near(mesh), list(surfaces), label.copy()
    left = _pieces(near, wall)
    while left:
        rows = left.pop()
        for loose, core, found in _found(near, rows, label, out, tolerance, spacing):
            given = _given(near, label, loose, core, found, len(out), tolerance)
            if not _is_simpler(near, label, given, [*out, found], tolerance):
                continue
            label = given
            rest = np.zeros(len(label), bool)
            rest[rows] = label[rows] != len(out)
            least = LEAST_REST * near.areas[rows].sum()
            left += [piece for piece in _pieces(near, rest) if near.areas[piece].sum() > least]
            out.append(found)
            break
    return label, out


def _is_simpler(near: Near, before: IntArray, after: IntArray, surfaces: Sequence[Surface], tolerance: float) -> bool:
    """Whether the last surface, a curve, asks for less than what it takes the place of: chi2 of the corners (six faces meet at each) + k log(n).

    Free form has a freedom for each corner that no patch beside it holds, unless the noise is wider than its faces.
    """
    rows = np.flatnonzero(after == len(surfaces) - 1)
    faces = near.mesh.faces[rows]
    n = max(len(np.unique(faces)), 1)
    is_told = (near.areas[rows] >= tolerance**2) & (before[rows] < 0)
    n_free = len(np.setdiff1d(faces[is_told], faces[before[rows] >= 0]))

    def left(label: IntArray) -> float:
        at = {k: near.mesh.vertices[faces[label == k]].reshape(-1, 3) for k in np.unique(label[label >= 0]).tolist()}
        return sum(float((surfaces[k].distance(corners) ** 2).sum()) for k, corners in at.items()) / (tolerance / 3) ** 2 / 6

    more = sum(s.spline.c.size for s in surfaces[-1:] if isinstance(s, Extruded)) - n_free
    more -= sum(FREEDOMS[surfaces[k].kind] for k in np.setdiff1d(before[before >= 0], after).tolist() if surfaces[k].kind != EXTRUDED)
    return left(after[rows]) + more * float(np.log(n)) < left(before[rows])


def _found(
    near: Near, rows: IntArray, label: IntArray, surfaces: Sequence[Surface], tolerance: float, spacing: float
) -> Iterator[tuple[IntArray, IntArray, Extruded]]:
    """The faces of a wall, those that a curve along an axis is begun with, and the surface, one after another that holds.

    Tried are the wall with all small patches beside it, then with those that it passes into without an angle, then alone.
    """
    for wider in (_with_small(near, label, rows, -1.0), _with_small(near, label, rows, SMOOTH), rows):
        loose = _off_large(near, wider, label, surfaces, tolerance)
        n_given = next((k for k, s in enumerate(surfaces) if s.kind == EXTRUDED), len(surfaces))
        for axis in _axes(near, loose, label, surfaces):
            core = _core(near, loose[label[loose] < n_given], axis, tolerance)
            made = _through(near, core, axis, tolerance, spacing)
            if made is not None:
                yield loose, core, made


def _pieces(near: Near, inside: BoolArray) -> list[IntArray]:
    """The faces of each piece, in the order of the lowest."""
    both = inside[near.table.twin // 3] & np.repeat(inside, 3)
    joined = np.zeros(len(near.table.edges), bool)
    joined[near.table.edge_of[both]] = True
    part = face_components(near.mesh.faces, joined)[1]
    return [np.flatnonzero(inside & (part == k)) for k in np.unique(part[inside]).tolist()]


def _with_small(near: Near, label: IntArray, rows: IntArray, cosine: float) -> IntArray:
    """A wall with the small patches beside it, and beside these, that it meets at an angle of at least that cosine; and what goes on smoothly."""
    inside = np.zeros(len(label), bool)
    inside[rows] = True
    small = np.bincount(label + 1, weights=near.areas)[1:] <= SMALL * near.areas.sum()
    free = np.full(len(label), -2)
    for k, piece in enumerate(_pieces(near, label < 0)):
        free[piece] = k
    for number in range(WIDENED):
        own, other = np.repeat(np.arange(len(label)), 3), near.of.ravel()
        border = np.flatnonzero(inside[own] & ~inside[other])
        turn = np.einsum("ij,ij->i", near.smooth[own[border]], near.smooth[other[border]])
        beside = label[other[border]]
        least = cosine if number < 2 else SMOOTH
        more = [k for k in np.unique(beside[beside >= 0]).tolist() if small[k] and np.median(turn[beside == k]) > least]
        inside |= np.isin(label, more)
        inside |= np.isin(free, free[other[border][beside < 0]])
    return np.flatnonzero(inside)


def _off_large(near: Near, rows: IntArray, label: IntArray, surfaces: Sequence[Surface], tolerance: float) -> IntArray:
    """The faces of a wall that lie on no large surface beside it: what rounds its rims says nothing of it."""
    inside = np.zeros(len(label), bool)
    inside[rows] = True
    beside = near.of[rows]
    corners = near.mesh.vertices[near.mesh.faces[rows]].reshape(-1, 3)
    off = np.full(len(rows), np.inf)
    names = np.unique(label[beside[~inside[beside]]])
    for k in names[names >= 0].tolist():
        if float(near.areas[label == k].sum()) > SMALL * near.areas.sum():
            off = np.minimum(off, np.abs(surfaces[k].distance(corners)).reshape(-1, 3).max(1))
    return rows[off > WIDER * tolerance]


def _axes(near: Near, loose: IntArray, label: IntArray, surfaces: Sequence[Surface]) -> list[FloatArray]:
    """The axes of the surfaces on and beside a wall, that which most of its area is square to first; of some alike that of the largest surface."""
    names = np.unique(label[np.concatenate([loose, near.of[loose].ravel()])])
    known = [k for k in names[names >= 0].tolist() if surfaces[k].kind in (PLANE, CYLINDER)]
    size = np.bincount(label + 1, weights=near.areas, minlength=len(surfaces) + 1)[1:]
    out: list[FloatArray] = []
    for k in sorted(known, key=lambda k: (-size[k], k)):
        if all(abs(float(surfaces[k].axis @ axis)) < ALIKE for axis in out):
            out.append(surfaces[k].axis)
    share = [float(near.areas[loose][np.abs(near.smooth[loose] @ axis) < SQUARE].sum()) for axis in out]
    return [out[k] for k in np.argsort(-np.array(share), kind="stable")[:MOST_AXES].tolist()]


def _core(near: Near, loose: IntArray, axis: FloatArray, tolerance: float) -> IntArray:
    """The largest piece of some faces that is square to an axis. Faces smaller than the noise is wide (a curl) look any way: they part no piece."""
    square = np.zeros(len(near.areas), bool)
    square[loose] = (np.abs(near.smooth[loose] @ axis) < SQUARE) | (near.areas[loose] < tolerance**2)
    return max(_pieces(near, square), key=lambda found: float(near.areas[found].sum()), default=np.zeros(0, np.int64))


def _through(near: Near, rows: IntArray, axis: FloatArray, tolerance: float, spacing: float) -> Extruded | None:
    """The curve along the axis through the vertices of some faces; None where it does not hold them."""
    used, index = np.unique(near.mesh.faces[rows], return_inverse=True)
    turn = float(np.linalg.norm(near.areas[rows] @ near.smooth[rows])) / max(float(near.areas[rows].sum()), 1e-300)
    if len(used) < LEAST_POINTS * (SPANS[0] + 3) or turn > FLAT:
        return None
    points = near.mesh.vertices[used]
    blank = Extruded(kind=EXTRUDED, point=points.mean(0), axis=axis, spline=BSpline(np.array([0, 0, 1, 1.0]), np.zeros((2, 2)), 1))
    flat = (points - blank.point) @ blank.frame().T
    across = near.smooth[rows] @ blank.frame().T
    tangent = np.column_stack([-across[:, 1], across[:, 0]])
    s = _along(index.reshape(-1, 3), flat, tangent / np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-300))
    told = np.unique(index.reshape(-1, 3)[near.areas[rows] >= tolerance**2])  # the corners of smaller ones may be those of a rim
    used, points, flat, s = used[told], points[told], flat[told], s[told]
    if len(used) < LEAST_POINTS * (SPANS[0] + 3):
        return None
    beyond = tolerance + 2 * spacing
    best, least = None, np.inf
    for spans in SPANS:
        if LEAST_POINTS * (spans + 3) > len(used):
            break
        found = replace(blank, spline=_spline(flat, s, spans, beyond))
        for _ in range(LED):
            found = replace(found, spline=_spline(flat, found._feet(points)[1], spans, beyond))
        floor = (1e-9 * float(np.linalg.norm(np.ptp(points, axis=0)))) ** 2
        squares, dof = float((found.distance(points) ** 2).sum()), max(len(used) - 2 * len(found.spline.c), 1)
        cost = len(used) * np.log(squares / len(used) + floor) + 2 * (spans + 3) * np.log(len(used))
        holds = squares / dof <= (tolerance / 3) ** 2 * (1 + 3 * np.sqrt(2 / dof))
        if holds and cost < least:
            best, least = found, cost
    return best


def _along(triangles: IntArray, flat: FloatArray, tangent: FloatArray) -> FloatArray:
    """(n,) length along the curve at each vertex: s_j - s_i = t . (p_j - p_i) on all edges, in the sense of least squares."""
    a, b = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    rise = ((flat[b] - flat[a]) * np.repeat(tangent, 3, axis=0)).sum(1)
    n = len(flat)
    one = np.ones(len(a))
    graph = coo_matrix((np.concatenate([one, one, -one, -one]), (np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a]))), (n, n))
    right = np.bincount(b, weights=rise, minlength=n) - np.bincount(a, weights=rise, minlength=n)
    hold = coo_matrix((np.ones(1), (np.zeros(1, np.int64), np.zeros(1, np.int64))), (n, n))  # s = 0 at the first
    return np.asarray(spsolve((graph + hold).tocsc(), right))


def _spline(flat: FloatArray, s: FloatArray, spans: int, beyond: float) -> BSpline:
    """The cubic spline of least squares through points at parameters s, which goes on beyond both ends."""
    low, high = float(s.min()) - beyond, float(s.max()) + beyond
    inner = np.quantile(s, np.linspace(0.0, 1.0, spans + 1)[1:-1])
    knots = np.concatenate([[low] * 4, inner, [high] * 4])
    basis = BSpline.design_matrix(np.clip(s, low, high), knots, 3).toarray()
    stiff = STIFF * np.diff(np.eye(spans + 3), 3, axis=0) * np.sqrt(len(s) / (spans + 3))
    poles = np.linalg.lstsq(np.concatenate([basis, stiff]), np.concatenate([flat, np.zeros((len(stiff), 2))]), rcond=None)[0]
    return BSpline(knots, poles, 3)


def _given(near: Near, label: IntArray, loose: IntArray, core: IntArray, found: Extruded, number: int, tolerance: float) -> IntArray:
    """Labels with the faces that lie on the new surface, beginning with its core; what is left of patches that were pieces of it has none."""
    near_by = np.zeros(len(label), bool)
    near_by[core] = True
    for _ in range(2):  # and the patches beside it
        names = np.unique(label[near.of[near_by]])
        near_by |= np.isin(label, names[names >= 0])
    near_by[loose] = True
    rows = np.flatnonzero(near_by)
    corners = near.mesh.vertices[near.mesh.faces[rows]].reshape(-1, 3)
    lies = np.abs(found.distance(corners)).reshape(-1, 3).max(1) <= WIDER * tolerance
    lies &= np.einsum("ij,ij->i", found.normals(near.centres[rows]), near.smooth[rows]) > GROW_COSINE
    on = np.zeros(len(label), bool)
    on[rows[lies]] = True
    on = _reached(near, on, core)
    n = int(label.max()) + 2
    area = np.bincount(label + 1, weights=near.areas, minlength=n)[1:]
    taken = np.bincount(label[on] + 1, weights=near.areas[on], minlength=n)[1:]
    pieces = np.flatnonzero(taken > SWALLOWED * area)
    out = np.where(np.isin(label, pieces), -1, label)
    own = np.isin(label, pieces)
    own[loose] = True
    out[on & own] = number
    return out


def _reached(near: Near, on: BoolArray, core: IntArray) -> BoolArray:
    """The pieces of faces that touch the core."""
    kept = np.zeros(len(on), bool)
    for rows in _pieces(near, on):
        if np.isin(rows, core).any():
            kept[rows] = True
    return kept
