"""The descent of `surfaces.fitted`, compiled: distances, slopes and normal equations of planes, cylinders, cones, spheres and tori in one pass.

Segmentation fits thousands of surfaces to a few hundred points each; array by array that took ten times as long.
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray

PLANE, CYLINDER, CONE, SPHERE, TORUS = range(5)
SMALL = 1e-12


@jit
def frame(axis: FloatArray) -> FloatArray:
    """(2, 3) unit vectors across the axis, right-handed with it."""
    k = 0
    for c in range(1, 3):
        if abs(axis[c]) < abs(axis[k]):
            k = c
    e = np.zeros((2, 3))
    e[0, (k + 1) % 3], e[0, (k + 2) % 3] = axis[(k + 2) % 3], -axis[(k + 1) % 3]
    length = math.sqrt(e[0, 0] ** 2 + e[0, 1] ** 2 + e[0, 2] ** 2)
    for c in range(3):
        e[0, c] /= length
    for c in range(3):
        e[1, c] = axis[(c + 1) % 3] * e[0, (c + 2) % 3] - axis[(c + 2) % 3] * e[0, (c + 1) % 3]
    return e


@jit
def _row(kind: int, q: FloatArray, axis: FloatArray, e: FloatArray, radius: float, second: float, out: FloatArray) -> float:
    """The distance of a point (q: from the surface's own) away from the axis; its slopes in the order of `surfaces.moved`."""
    h = q[0] * axis[0] + q[1] * axis[1] + q[2] * axis[2]
    l0, l1 = q[0] * e[0, 0] + q[1] * e[0, 1] + q[2] * e[0, 2], q[0] * e[1, 0] + q[1] * e[1, 1] + q[2] * e[1, 2]
    if kind == PLANE:
        out[0], out[1], out[2] = -1.0, l0, l1
        return float(h)
    if kind == SPHERE:
        size = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
        for c in range(3):
            out[c] = -q[c] / max(size, SMALL)
        out[3] = -1.0
        return size - radius
    rho = math.sqrt(l0 * l0 + l1 * l1)
    o0, o1 = l0 / max(rho, SMALL), l1 / max(rho, SMALL)
    if kind == CYLINDER:
        out[0], out[1], out[2], out[3], out[4] = -o0, -o1, -h * o0, -h * o1, -1.0
        return rho - radius
    if kind == CONE:
        co, si = math.cos(second), math.sin(second)
        out[0], out[1], out[4], out[5] = -co * o0, -co * o1, -co, -si * (rho - radius) - co * h
        out[2], out[3] = -co * h * o0 - si * l0, -co * h * o1 - si * l1
        return float((rho - radius) * co - h * si)
    size = math.sqrt((rho - radius) ** 2 + h * h)
    a, b = (rho - radius) / max(size, SMALL), h / max(size, SMALL)
    out[0], out[1], out[2], out[5], out[6] = -a * o0, -a * o1, -b, -a, -1.0
    out[3], out[4] = -a * h * o0 + b * l0, -a * h * o1 + b * l1
    return size - second


@jit
def _moved(kind: int, s: FloatArray, step: FloatArray) -> FloatArray:
    """`surfaces.moved`; s (8,): point, axis, radius, second."""
    out = s.copy()
    if kind == SPHERE:
        for c in range(3):
            out[c] += step[c]
        out[6] += step[3]
        return out
    e = frame(s[3:6])
    at = 1 if kind == PLANE else 3 if kind == TORUS else 2  # where the tilt begins
    for c in range(3):
        if kind == PLANE:
            out[c] += step[0] * s[3 + c]
        else:
            out[c] += step[0] * e[0, c] + step[1] * e[1, c]
        if kind == TORUS:
            out[c] += step[2] * s[3 + c]
        out[3 + c] += step[at] * e[0, c] + step[at + 1] * e[1, c]
    length = math.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2)
    for c in range(3, 6):
        out[c] /= length
    if kind != PLANE:
        out[6] += step[at + 2]
    if kind in (CONE, TORUS):
        out[7] += step[at + 3]
    return out


@jit
def _solved(A: FloatArray, b: FloatArray, free: BoolArray, damping: float) -> FloatArray:
    """The damped step of the unknowns that are free: (A + damping diag A) x = b by Cholesky factors; what has no curvature stays."""
    n = len(b)
    low, x = np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        for j in range(i + 1):
            if not (free[i] and free[j]):
                continue
            total = A[i, j] + ((damping + 1e-12) * max(A[i, i], 1e-300) if i == j else 0.0)
            for k in range(j):
                total -= low[i, k] * low[j, k]
            if i == j:
                low[i, i] = math.sqrt(max(total, 0.0))
            elif low[j, j] > 0.0:
                low[i, j] = total / low[j, j]
    for i in range(n):
        if low[i, i] > 0.0:
            x[i] = (b[i] - (low[i, :i] * x[:i]).sum()) / low[i, i]
    for i in range(n - 1, -1, -1):
        if low[i, i] > 0.0:
            x[i] = (x[i] - (low[i + 1 :, i] * x[i + 1 :]).sum()) / low[i, i]
    return x


@jit
def _sums(kind: int, s: FloatArray, points: FloatArray, weights: FloatArray, A: FloatArray, b: FloatArray) -> float:
    """Weighted sum of squares; A and b become those of the normal equations."""
    n = len(b)
    e, row, q = frame(s[3:6]), np.zeros(7), np.zeros(3)
    cost = 0.0
    for i in range(n):
        b[i] = 0.0
        for j in range(n):
            A[i, j] = 0.0
    for k in range(len(points)):
        for c in range(3):
            q[c] = points[k, c] - s[c]
        d, w = _row(kind, q, s[3:6], e, s[6], s[7], row), weights[k]
        cost += w * d * d
        for i in range(n):
            b[i] -= w * row[i] * d
            for j in range(i + 1):
                A[i, j] += w * row[i] * row[j]
    for i in range(n):
        for j in range(i):
            A[j, i] = A[i, j]
    return cost


@jit
def descend(
    kind: int, start: FloatArray, points: FloatArray, weights: FloatArray, free: BoolArray, size: float, rounds: int
) -> tuple[FloatArray, float]:
    """((8,) point, axis, radius, second; weighted sum of squares) after damped Gauss-Newton steps from `start`. free : (freedoms,)."""
    n = len(free)
    here, damping = start.copy(), 1e-6
    A, b, A_trial, b_trial = np.zeros((n, n)), np.zeros(n), np.zeros((n, n)), np.zeros(n)
    cost = _sums(kind, here, points, weights, A, b)
    total = 0.0
    for w in weights:
        total += w
    for _ in range(rounds):
        step = _solved(A, b, free, damping)
        trial = _moved(kind, here, step)
        new = _sums(kind, trial, points, weights, A_trial, b_trial)
        if not math.isfinite(new) or new > cost:
            damping = max(10 * damping, 1e-4)
            if damping > 1e6:
                break
            continue
        done = cost - new <= 1e-12 * cost + 1e-32 * total * size * size
        here, cost, damping = trial, new, damping / 10
        A, A_trial, b, b_trial = A_trial, A, b_trial, b
        if done:
            break
    return here, cost


@jit
def _facing(kind: int, q: FloatArray, s: FloatArray, e: FloatArray, way: FloatArray) -> float:
    """Component along `way` of the unit normal, away from the axis, at the foot of a point (q: from the surface's own)."""
    x, y, z = s[3], s[4], s[5]
    along = way[0] * x + way[1] * y + way[2] * z
    if kind == PLANE:
        return float(along)
    if kind == SPHERE:
        return float((q[0] * way[0] + q[1] * way[1] + q[2] * way[2]) / max(math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2), SMALL))
    h = q[0] * x + q[1] * y + q[2] * z
    l0, l1 = q[0] * e[0, 0] + q[1] * e[0, 1] + q[2] * e[0, 2], q[0] * e[1, 0] + q[1] * e[1, 1] + q[2] * e[1, 2]
    w0, w1 = way[0] * e[0, 0] + way[1] * e[0, 1] + way[2] * e[0, 2], way[0] * e[1, 0] + way[1] * e[1, 1] + way[2] * e[1, 2]
    rho = math.sqrt(l0 * l0 + l1 * l1)
    out = (l0 * w0 + l1 * w1) / max(rho, SMALL)
    if kind == CYLINDER:
        return float(out)
    if kind == CONE:
        return float(math.cos(s[7]) * out - math.sin(s[7]) * along)
    size = math.sqrt((rho - s[6]) ** 2 + h * h)
    return float(((rho - s[6]) * out + h * along) / max(size, SMALL))


@jit
def flood(
    kind: int,
    s: FloatArray,
    sense: float,
    tolerance: float,
    cosine: float,
    vertices: FloatArray,
    faces: IntArray,
    beside: IntArray,
    centres: FloatArray,
    normals: FloatArray,
    free: BoolArray,
    inside: BoolArray,
    most: int,
) -> bool:
    """Spread `inside` (m,) over neighbours (`beside`, (m, 3)) that are free, have all corners within `tolerance` and look the surface's way, wave by
    wave until there are more than `most`. s : (8,) as in `descend`. Returns whether there was more to come.
    """
    e, q, row = frame(s[3:6]), np.zeros(3), np.zeros(7)
    front = np.flatnonzero(inside)
    count = len(front)
    seen = inside.copy()
    while len(front) and count <= most:
        new, n = np.empty(3 * len(front), np.int64), 0
        for f in front:
            for k in range(3):
                g = beside[f, k]
                if seen[g] or not free[g]:
                    continue
                seen[g] = True
                for c in range(3):
                    q[c] = centres[g, c] - s[c]
                ok = sense * _facing(kind, q, s, e, normals[g]) > cosine
                for i in range(3):
                    if ok:
                        for c in range(3):
                            q[c] = vertices[faces[g, i], c] - s[c]
                        ok = abs(_row(kind, q, s[3:6], e, s[6], s[7], row)) <= tolerance
                if ok:
                    inside[g] = True
                    new[n] = g
                    n += 1
        front, count = new[:n].copy(), count + n
    return len(front) > 0
