"""Delaunay tetrahedra of a cloud inside a box, and straight walks through them.

The triangulation is checked, not trusted: every tet has positive volume and neighbours lie on opposite sides of their common facet, so
any union of its tets has a boundary that cannot cross itself.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import Delaunay, QhullError

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.delaunay_insert import inserted
from scan2fea.kernel.jit import jit, jit_ieee
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

JITTER = 1e-3  # of the spacing: breaks exact coplanarity and cosphericity, far below any noise
BOX_MARGIN = 0.25  # of the diagonal of the cloud
MAX_STEPS = 20_000  # facets one walk may cross: more means that rounding has trapped it
FACETS = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])  # facet i is opposite vertex i; its normal (b - a) x (c - a) points out


@dataclass(frozen=True, eq=False, kw_only=True)
class Tetrahedralisation(Value):
    """Delaunay tets of n points and the 8 corners of a box round them.

    points : (n + 8, 3) metres, the input with its jitter, then the box corners.   n_input : n.
    tets : (m, 4) positively oriented.   neighbors : (m, 4), across the facet opposite vertex i, -1 on the hull.
    circumcentre : (m, 3).   circumradius : (m,).   is_box : (m,) True where a box corner is among the vertices.
    """

    points: FloatArray
    n_input: int
    tets: IntArray
    neighbors: IntArray
    circumcentre: FloatArray
    circumradius: FloatArray
    is_box: BoolArray

    _ROWS = (("tets", "neighbors", "circumcentre", "circumradius", "is_box"),)

    def __len__(self) -> int:
        return len(self.tets)

    @cached_property
    def incidence(self) -> tuple[IntArray, IntArray]:
        """(first (n + 9,), tets): the tets round vertex v are tets[first[v]:first[v + 1]], ascending."""
        flat = self.tets.ravel()
        order = np.argsort(flat, kind="stable") // 4
        first = np.zeros(len(self.points) + 1, np.int64)
        np.cumsum(np.bincount(flat, minlength=len(self.points)), out=first[1:])
        for array in (first, order):
            array.flags.writeable = False
        return first, order

    @cached_property
    def volumes(self) -> FloatArray:
        """(m,) cubic metres, all positive."""
        a, b, c, d = (self.points[self.tets[:, i]] for i in range(4))
        found = np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0)
        found.flags.writeable = False
        return found


def tetrahedralise(points: FloatArray, spacing: float, seed: int) -> Tetrahedralisation:
    """The Delaunay tets of `points` (n, 3), moved by a seeded jitter of JITTER x spacing, and of a box round them.

    Raises ReconstructionError for fewer than 4 points, values that are not finite, or if no valid triangulation comes out.
    """
    require(len(points) >= 4, ReconstructionError, f"{len(points)} points cannot enclose a volume: at least 4 are needed")
    require(np.isfinite(points).all(), ReconstructionError, "some points are not finite: remove them before the reconstruction")
    require(math.isfinite(spacing) and spacing > 0, ReconstructionError, f"spacing {spacing} m must be positive: are all points the same?")
    for attempt in range(4):  # a failed check is a rounding accident: draw again, a little stronger
        rng = np.random.default_rng((seed, attempt))
        moved = points + rng.uniform(-1, 1, points.shape) * (JITTER * spacing * 2.0**attempt)
        built = _build(moved, rng)
        if built is not None:
            return built
    raise ReconstructionError(f"no valid tetrahedra of {len(points)} points at spacing {spacing:.3g} m: are most of them duplicates?")


def _build(moved: FloatArray, rng: np.random.Generator) -> Tetrahedralisation | None:
    low, high = moved.min(axis=0), moved.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    box = low + corners * (high - low) + (2 * corners - 1) * diagonal * BOX_MARGIN * (1 + 0.02 * rng.uniform(size=(8, 3)))
    everything = np.vstack([moved, box])
    centre = 0.5 * (low + high)
    scale = 2.0 ** -math.ceil(math.log2(diagonal))  # a power of two: exact
    local = (everything - centre) * scale
    found = _triangulated(local, len(moved), rng)
    if found is None:
        return None
    tets, neighbors = found
    radius_centre, radius = _circumspheres(local, tets)
    return Tetrahedralisation(
        points=everything,
        n_input=len(moved),
        tets=tets,
        neighbors=neighbors,
        circumcentre=radius_centre / scale + centre,
        circumradius=radius / scale,
        is_box=np.asarray((tets >= len(moved)).any(axis=1)),
    )


def _triangulated(local: FloatArray, n: int, rng: np.random.Generator) -> tuple[IntArray, IntArray] | None:
    """Checked tets and neighbours of all points, the last 8 of them the corners of a box round the n others; None where nothing stands the check."""
    box = _hull(local[n:])
    found = None if box is None else inserted(local, box[0] + n, box[1], n, int(rng.integers(2**31)))
    if found is not None and _orient(local, *found):
        return found
    return _hull(local)


def _hull(points: FloatArray) -> tuple[IntArray, IntArray] | None:
    """The same by qhull."""
    try:
        hull = Delaunay(points, qhull_options="Qbb Qc Qz Q12")
    except QhullError:
        return None
    tets, neighbors = hull.simplices.astype(np.int64), hull.neighbors.astype(np.int64)
    return None if len(hull.coplanar) or not _orient(points, tets, neighbors) else (tets, neighbors)


@jit_ieee
def _circumspheres(points: FloatArray, tets: IntArray) -> tuple[FloatArray, FloatArray]:
    """Centres (m, 3) and radii (m,)."""
    centre, radius = np.empty((len(tets), 3)), np.empty(len(tets))
    for t in range(len(tets)):
        ax, ay, az = points[tets[t, 0]]
        bx, by, bz = points[tets[t, 1], 0] - ax, points[tets[t, 1], 1] - ay, points[tets[t, 1], 2] - az
        cx, cy, cz = points[tets[t, 2], 0] - ax, points[tets[t, 2], 1] - ay, points[tets[t, 2], 2] - az
        dx, dy, dz = points[tets[t, 3], 0] - ax, points[tets[t, 3], 1] - ay, points[tets[t, 3], 2] - az
        b, c, d = bx * bx + by * by + bz * bz, cx * cx + cy * cy + cz * cz, dx * dx + dy * dy + dz * dz
        bc = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        twice = 2.0 * (bc[0] * dx + bc[1] * dy + bc[2] * dz)
        x = (b * (cy * dz - cz * dy) + c * (dy * bz - dz * by) + d * bc[0]) / twice
        y = (b * (cz * dx - cx * dz) + c * (dz * bx - dx * bz) + d * bc[1]) / twice
        z = (b * (cx * dy - cy * dx) + c * (dx * by - dy * bx) + d * bc[2]) / twice
        centre[t, 0], centre[t, 1], centre[t, 2] = ax + x, ay + y, az + z
        radius[t] = math.sqrt(x * x + y * y + z * z)
    return centre, radius


@jit
def _triple(points: FloatArray, a: int, b: int, c: int, d: int) -> float:
    """Six times the signed volume of a, b, c, d."""
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    wx, wy, wz = points[d, 0] - points[a, 0], points[d, 1] - points[a, 1], points[d, 2] - points[a, 2]
    return float((uy * vz - uz * vy) * wx + (uz * vx - ux * vz) * wy + (ux * vy - uy * vx) * wz)


@jit
def _orient(points: FloatArray, tets: IntArray, neighbors: IntArray) -> bool:
    """Make every tet positive (in place); False if one is flat or two neighbours lie on the same side of their facet."""
    used = np.zeros(len(points), np.bool_)
    for t in range(len(tets)):
        volume = _triple(points, tets[t, 0], tets[t, 1], tets[t, 2], tets[t, 3])
        if volume == 0.0:
            return False
        if volume < 0.0:
            tets[t, 2], tets[t, 3] = tets[t, 3], tets[t, 2]
            neighbors[t, 2], neighbors[t, 3] = neighbors[t, 3], neighbors[t, 2]
        for i in range(4):
            used[tets[t, i]] = True
    for t in range(len(tets)):
        for i in range(4):
            other = neighbors[t, i]
            if other < t:
                continue
            apex = -1
            for j in range(4):
                if neighbors[other, j] == t:
                    apex = tets[other, j]
            a, b, c = tets[t, FACETS[i, 0]], tets[t, FACETS[i, 1]], tets[t, FACETS[i, 2]]
            if apex < 0 or _triple(points, a, b, c, apex) <= 0.0:
                return False
    return bool(used.all())


@jit
def facet_vector(points: FloatArray, tets: IntArray, t: int, i: int) -> tuple[float, float, float, float, float, float]:
    """A corner of facet i of tet t, and the vector out of the tet that is twice as long as the facet is large."""
    a, b, c = tets[t, FACETS[i, 0]], tets[t, FACETS[i, 1]], tets[t, FACETS[i, 2]]
    ax, ay, az = points[a, 0], points[a, 1], points[a, 2]
    ux, uy, uz = points[b, 0] - ax, points[b, 1] - ay, points[b, 2] - az
    vx, vy, vz = points[c, 0] - ax, points[c, 1] - ay, points[c, 2] - az
    return ax, ay, az, uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@jit
def _slopes(points: FloatArray, tets: IntArray, t: int, ray: FloatArray, out: FloatArray) -> None:
    """out[i]: barycentric coordinate i of the origin ray[:3] in tet t; out[4 + i]: its change per metre along ray[3:]; both times 6 volumes."""
    ox, oy, oz, dx, dy, dz = ray[0], ray[1], ray[2], ray[3], ray[4], ray[5]
    for i in range(4):
        ax, ay, az, nx, ny, nz = facet_vector(points, tets, t, i)
        out[i] = nx * (ax - ox) + ny * (ay - oy) + nz * (az - oz)
        out[4 + i] = -(nx * dx + ny * dy + nz * dz)


@jit
def start_tet(
    points: FloatArray, tets: IntArray, first: IntArray, incident: IntArray, v: int, ray: FloatArray, work: FloatArray
) -> tuple[int, int, float]:
    """The ray leaves vertex v: (tet, facet it is left through, distance); the tet with the largest smallest coordinate of its direction."""
    best, best_tet, best_facet, best_s = -np.inf, -1, -1, 0.0
    for k in range(first[v], first[v + 1]):
        t = incident[k]
        _slopes(points, tets, t, ray, work)
        least, facet = np.inf, 0
        for i in range(4):
            if tets[t, i] == v:
                facet = i
            elif work[4 + i] < least:
                least = work[4 + i]
        least /= abs(work[facet])  # work[facet] is 6 volumes: v itself has coordinate 1
        if least > best and work[4 + facet] < 0.0:
            best, best_tet, best_facet, best_s = least, t, facet, work[facet] / -work[4 + facet]
    return best_tet, best_facet, best_s


@jit
def next_tet(
    points: FloatArray, tets: IntArray, neighbors: IntArray, t: int, facet: int, ray: FloatArray, work: FloatArray
) -> tuple[int, int, int, float]:
    """Through `facet` of tet t: (next tet or -1, its entry facet, its exit facet or -1, distance of the exit from the ray's origin)."""
    other = neighbors[t, facet]
    if other < 0:
        return -1, -1, -1, np.inf
    entry = 0
    for i in range(4):
        if neighbors[other, i] == t:
            entry = i
    _slopes(points, tets, other, ray, work)
    leave, best = -1, np.inf
    for i in range(4):
        if i != entry and work[4 + i] < 0.0 and work[i] < best * -work[4 + i]:
            leave, best = i, work[i] / -work[4 + i]
    return other, entry, leave, best


@jit
def walk_votes(
    points: FloatArray, tets: IntArray, neighbors: IntArray, first: IntArray, incident: IntArray,
    is_box: BoolArray, vertex: IntArray, target: FloatArray, weight: FloatArray, rise: FloatArray, softness: float,
    capacity: FloatArray, source: FloatArray,
) -> None:  # fmt: skip
    """Votes of the sight lines from vertex[k] to target[k] (metres), added to capacity (m, 4) and source (m,) IN PLACE.

    Each facet crossed at height z above the point's surface adds weight (1 - exp(-z^2 / (2 softness^2))) to the facet of the tet on the
    TARGET side: the price of that tet being outside while the one on the point's side is inside (Labatut, Pons, Keriven 2009, with
    direction, and with height in place of distance: a grazing ray stays in the noise for long). rise[k] : height per metre of the way.
    The tet that holds the target, or the last one before the hull, gains `weight` as source. A walk ends in the first tet of the box: it has
    left the points, and the box is outside already.
    """
    work, ray = np.zeros(8), np.zeros(6)
    for k in range(len(vertex)):
        v = vertex[k]
        length = math.sqrt(((target[k] - points[v]) ** 2).sum())
        if not length > 0.0:
            continue
        for a in range(3):
            ray[a], ray[3 + a] = points[v, a], (target[k, a] - points[v, a]) / length
        t, facet, s = start_tet(points, tets, first, incident, v, ray, work)
        for _ in range(MAX_STEPS):
            if t < 0 or facet < 0 or s >= length or is_box[t]:
                break
            other, entry, leave, s_next = next_tet(points, tets, neighbors, t, facet, ray, work)
            if other < 0:
                break
            soft = 1.0
            if softness > 0.0:
                soft = 1.0 - math.exp(-0.5 * (s * rise[k] / softness) ** 2)
            capacity[other, entry] += weight[k] * soft
            t, facet, s = other, leave, s_next
        if t >= 0:
            source[t] += weight[k]


@jit
def tet_at(
    points: FloatArray, tets: IntArray, neighbors: IntArray, first: IntArray, incident: IntArray,
    vertex: IntArray, direction: FloatArray, depth: FloatArray,
) -> IntArray:  # fmt: skip
    """(k,) the tet at `depth[k]` (metres) from vertex[k] along the unit direction[k]; the last one before the hull; -1 if none."""
    work, ray = np.zeros(8), np.zeros(6)
    out = np.full(len(vertex), -1, np.int64)
    for k in range(len(vertex)):
        v = vertex[k]
        for a in range(3):
            ray[a], ray[3 + a] = points[v, a], direction[k, a]
        t, facet, s = start_tet(points, tets, first, incident, v, ray, work)
        for _ in range(MAX_STEPS):
            if t < 0 or facet < 0 or s >= depth[k]:
                break
            other, _entry, leave, s_next = next_tet(points, tets, neighbors, t, facet, ray, work)
            if other < 0:
                break
            t, facet, s = other, leave, s_next
        out[k] = t
    return out


@jit
def depth_to(
    points: FloatArray, tets: IntArray, neighbors: IntArray, first: IntArray, incident: IntArray,
    vertex: IntArray, direction: FloatArray, mask: BoolArray, cap: float,
) -> FloatArray:  # fmt: skip
    """(k,) metres from vertex[k] along the unit direction[k] until a tet with mask True is entered; inf beyond `cap` or the hull."""
    work, ray = np.zeros(8), np.zeros(6)
    out = np.full(len(vertex), np.inf)
    for k in range(len(vertex)):
        v = vertex[k]
        for a in range(3):
            ray[a], ray[3 + a] = points[v, a], direction[k, a]
        t, facet, s = start_tet(points, tets, first, incident, v, ray, work)
        if t >= 0 and mask[t]:
            out[k] = 0.0
            continue
        for _ in range(MAX_STEPS):
            if t < 0 or facet < 0 or s > cap:
                break
            other, _entry, leave, s_next = next_tet(points, tets, neighbors, t, facet, ray, work)
            if other < 0:
                break
            if mask[other]:
                out[k] = s
                break
            t, facet, s = other, leave, s_next
    return out


@jit
def crossed(
    points: FloatArray, tets: IntArray, neighbors: IntArray, first: IntArray, incident: IntArray,
    vertex: IntArray, direction: FloatArray, cap: float,
) -> tuple[IntArray, IntArray]:  # fmt: skip
    """(ray, tet) of every tet that the ray from vertex[k] along the unit direction[k] enters within `cap` metres, in this order."""
    work, ray = np.zeros(8), np.zeros(6)
    out, n = np.empty((2, 8 * len(vertex)), np.int64), 0
    for k in range(len(vertex)):
        v = vertex[k]
        for a in range(3):
            ray[a], ray[3 + a] = points[v, a], direction[k, a]
        t, facet, s = start_tet(points, tets, first, incident, v, ray, work)
        for _ in range(MAX_STEPS):
            if t < 0:
                break
            if n == out.shape[1]:
                out = np.hstack((out, np.empty_like(out)))
            out[0, n], out[1, n] = k, t
            n += 1
            if facet < 0 or s > cap:
                break
            t, _entry, facet, s = next_tet(points, tets, neighbors, t, facet, ray, work)
    return out[0, :n], out[1, :n]
