"""The next triangle on an edge of the front, among the Delaunay facets round that edge (compiled): the most plausible, or the one a ball meets."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.delaunay import FACETS
from scan2fea.kernel.jit import jit
from scan2fea.kernel.side_normals import SAME_SIDE
from scan2fea.reconstruction.front_state import INNER, Front, is_free
from scan2fea.types import FloatArray, IntArray

Graph = tuple[FloatArray, FloatArray, IntArray, IntArray, FloatArray, FloatArray, float, float, float]
# points, normals, tets, neighbors, circumcentres of the tets, radii of their facets, wedge, ratio, radius of the pivoting ball (0: none)
FOLDED = 5.0 * math.pi / 6.0  # a triangle turned by more lies on its neighbour (the sliver bound of Cohen-Steiner and Da)
OUTSIDE_WEDGE = 2.0  # added to a key: inside the wedge first, by size, then the others by angle
ROUNDING = 1e-9  # of the ball: its centre may lie this far off a dual edge


@jit
def facet_radii(points: FloatArray, tets: IntArray, neighbors: IntArray, centre: FloatArray, ball: FloatArray, n_input: int) -> FloatArray:
    """(m, 4) radius of the smallest empty ball through each facet, m: its distance to the dual Voronoi edge; inf at the box and on the hull."""
    out = np.full((len(tets), 4), np.inf)
    for t in range(len(tets)):
        for i in range(4):
            other = neighbors[t, i]
            a, b, c = tets[t, FACETS[i, 0]], tets[t, FACETS[i, 1]], tets[t, FACETS[i, 2]]
            if other < 0 or a >= n_input or b >= n_input or c >= n_input:
                continue
            ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
            vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            size = math.sqrt(nx * nx + ny * ny + nz * nz)
            if size == 0.0:
                continue
            here = nx * (centre[t, 0] - points[a, 0]) + ny * (centre[t, 1] - points[a, 1]) + nz * (centre[t, 2] - points[a, 2])
            there = nx * (centre[other, 0] - points[a, 0]) + ny * (centre[other, 1] - points[a, 1]) + nz * (centre[other, 2] - points[a, 2])
            if here * there <= 0.0:  # the circle's own ball is empty
                out[t, i] = math.sqrt(max(0.0, ball[t] ** 2 - (here / size) ** 2))
            else:
                out[t, i] = min(ball[t], ball[other])
    return out


@jit
def faces_its_side(points: FloatArray, normals: FloatArray, u: int, v: int, x: int) -> bool:
    """Do the outward normals of all three corners lie on the side that triangle (u, v, x) faces? Always where no normals are given."""
    if len(normals) == 0:
        return True
    ax, ay, az = points[v, 0] - points[u, 0], points[v, 1] - points[u, 1], points[v, 2] - points[u, 2]
    bx, by, bz = points[x, 0] - points[u, 0], points[x, 1] - points[u, 1], points[x, 2] - points[u, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    least = SAME_SIDE * math.sqrt(nx * nx + ny * ny + nz * nz)
    worst = np.inf
    for k in (u, v, x):
        worst = min(worst, nx * normals[k, 0] + ny * normals[k, 1] + nz * normals[k, 2])
    return bool(worst >= least)


@jit
def _turn(points: FloatArray, u: int, v: int, apex: int, c: int) -> float:
    """Angle between triangle (v, u, apex) and its neighbour (u, v, c): 0 where flat, pi where folded back."""
    ex, ey, ez = points[v, 0] - points[u, 0], points[v, 1] - points[u, 1], points[v, 2] - points[u, 2]
    ax, ay, az = points[apex, 0] - points[v, 0], points[apex, 1] - points[v, 1], points[apex, 2] - points[v, 2]
    cx, cy, cz = points[c, 0] - points[u, 0], points[c, 1] - points[u, 1], points[c, 2] - points[u, 2]
    px, py, pz = ay * ez - az * ey, az * ex - ax * ez, ax * ey - ay * ex
    qx, qy, qz = ey * cz - ez * cy, ez * cx - ex * cz, ex * cy - ey * cx
    size = math.sqrt((px * px + py * py + pz * pz) * (qx * qx + qy * qy + qz * qz))
    if size == 0.0:
        return math.pi
    return math.acos(min(1.0, max(-1.0, (px * qx + py * qy + pz * qz) / size)))


@jit
def _candidate(graph: Graph, front: Front, u: int, largest: float) -> float:
    """The key of the most plausible triangle on the front edge that leaves u, inf where there is none; choice[u] takes its (corner, tet, facet)."""
    points, normals, tets, neighbors, _, radii, wedge, ratio, _ = graph
    state, after, _, home, choice, _, used = front
    out = choice[u]
    v, tet, facet, apex = after[u], home[u, 0], home[u, 1], home[u, 2]
    own = radii[tet, facet]
    best = np.inf
    out[0] = -1
    t, w, x = tet, apex, tets[tet, facet]
    while True:
        j = 0
        for k in range(4):
            if tets[t, k] == w:
                j = k
        r = radii[t, j]  # facet (u, v, x)
        if x < len(state) and r < best and state[x] != INNER and is_free(v, x, after, used) and is_free(x, u, after, used):
            angle = _turn(points, u, v, apex, x)
            if angle < FOLDED and (angle < wedge or r <= ratio * own) and faces_its_side(points, normals, u, v, x):
                best = r
                out[0], out[1], out[2] = x, t, j
        onward = neighbors[t, j]
        if onward < 0:
            break
        t = onward
        w = x
        for k in range(4):
            p = tets[t, k]
            if p not in (u, v, w):
                x = p
        if x == apex:
            break
    if best == np.inf:
        return np.inf
    angle = _turn(points, u, v, apex, out[0])
    return best / largest if angle < wedge else OUTSIDE_WEDGE + angle


@jit
def rests(points: FloatArray, centre: FloatArray, u: int, v: int, x: int, t: int, other: int, ball: float, out: FloatArray) -> bool:
    """Does a ball rest on triangle (u, v, x), a facet between tets t and `other`, from the side it faces, and hold no point? `out`: its centre.

    It holds none where its centre lies on the dual Voronoi edge, between the circumcentres of the two tets.
    """
    ax, ay, az = points[v, 0] - points[u, 0], points[v, 1] - points[u, 1], points[v, 2] - points[u, 2]
    bx, by, bz = points[x, 0] - points[u, 0], points[x, 1] - points[u, 1], points[x, 2] - points[u, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    if size == 0.0 or other < 0:
        return False
    nx, ny, nz = nx / size, ny / size, nz / size
    one = two = across = 0.0
    for k in range(3):
        n = nx if k == 0 else (ny if k == 1 else nz)
        one += n * (centre[t, k] - points[u, k])
        two += n * (centre[other, k] - points[u, k])
        across += (centre[t, k] - points[u, k]) ** 2
    circle = across - one * one  # squared radius of the circle through the corners
    if circle > ball * ball:
        return False
    height = math.sqrt(ball * ball - circle)
    hair = ROUNDING * ball
    if height < min(one, two) - hair or height > max(one, two) + hair:
        return False
    out[0] = centre[t, 0] + (height - one) * nx
    out[1] = centre[t, 1] + (height - one) * ny
    out[2] = centre[t, 2] + (height - one) * nz
    return True


@jit
def _rolled(points: FloatArray, u: int, v: int, begin: FloatArray, end: FloatArray) -> float:
    """Angle in [0, 2 pi) by which a ball turns about edge uv, onward over the front, to come from centre `begin` to centre `end`."""
    p, q = begin - 0.5 * (points[u] + points[v]), end - 0.5 * (points[u] + points[v])
    e = points[v] - points[u]
    sine = e[0] * (p[1] * q[2] - p[2] * q[1]) + e[1] * (p[2] * q[0] - p[0] * q[2]) + e[2] * (p[0] * q[1] - p[1] * q[0])
    angle = math.atan2(-sine / math.sqrt((e * e).sum()), (p * q).sum())
    return angle if angle >= 0.0 else angle + 2.0 * math.pi


@jit
def _pivot(graph: Graph, front: Front, u: int) -> float:
    """0 if the ball that rests behind the front edge leaving u, turned about that edge, first meets a point that may be joined; inf if not.

    choice[u] takes that (corner, tet, facet).
    """
    points, normals, tets, neighbors, centre, _, _, _, ball = graph
    state, after, _, home, choice, _, used = front
    v, tet, facet, apex = after[u], home[u, 0], home[u, 1], home[u, 2]
    choice[u, 0] = -1
    begin, end = np.zeros(3), np.zeros(3)
    if not rests(points, centre, v, u, apex, tet, neighbors[tet, facet], ball, begin):
        return np.inf
    least = np.inf
    t, w, x = tet, apex, tets[tet, facet]
    while True:
        j = 0
        for k in range(4):
            if tets[t, k] == w:
                j = k
        onward = neighbors[t, j]
        if x < len(state) and rests(points, centre, u, v, x, t, onward, ball, end):
            angle = _rolled(points, u, v, begin, end)
            if angle < least:
                least = angle
                choice[u, 0], choice[u, 1], choice[u, 2] = x, t, j
        if onward < 0:
            break
        t, w = onward, x
        for k in range(4):
            p = tets[t, k]
            if p not in (u, v, w):
                x = p
        if x == apex:
            break
    x = choice[u, 0]
    if x < 0 or state[x] == INNER or not (is_free(v, x, after, used) and is_free(x, u, after, used) and faces_its_side(points, normals, u, v, x)):
        choice[u, 0] = -1
        return np.inf
    return 0.0


@jit
def next_triangle(graph: Graph, front: Front, u: int, largest: float) -> float:
    """The key of the next triangle on the front edge that leaves u; inf where there is none."""
    return _pivot(graph, front, u) if graph[8] > 0.0 else _candidate(graph, front, u, largest)
