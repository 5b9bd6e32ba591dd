"""The likelihood of the place of an edge in one dimension: points of a step blurred by noise, a cap on it, and even clutter; rates profiled out.

lambda(z) = rho Phi((z - e) / s) + c phi((z - e) / s) / s + b        in a window of z, the cap c being a known multiple of rho
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.kernel.noise_kernels import bell_and_tail
from scan2fea.types import FloatArray

_ROOT_HALF = math.sqrt(0.5)
_INV_ROOT_2PI = 1 / math.sqrt(2 * math.pi)
_TINY = 1e-300
_ROUNDS = 12  # of Newton's steps, at most
_STILL = 1e-12  # change of the share of clutter that ends them
_LEAST_START = 1e-3
_WHOLE = 9.0  # sd beyond an edge: nothing of the normal law is left beyond it, in doubles


@jit_ieee
def edge_levels(
    at: FloatArray, weight: FloatArray, low: float, high: float, s: float, edges: FloatArray, ratio: float, most_clutter: float
) -> tuple[FloatArray, FloatArray]:
    """(g,) greatest log likelihood over the rates at each edge, and (3, g) the rates rho, c, b.

    at, weight : (m,) places of the points in the window low .. high, and how many lie there.   s : sd of the noise.   ratio : metres, of the cap's
    points over rho.   most_clutter : b over rho at most.

    The expected number of points is their number at the maximum, so that one unknown is left: the share q of clutter. The likelihood is concave in
    it; Newton's steps are kept inside a bracket, and begin from the share at the edge before.
    """
    g, m, span = len(edges), len(at), high - low
    n = weight.sum()
    level, rates = np.empty(g), np.empty((3, g))
    member, tilt, back = np.empty(m), np.empty(m), np.empty(m)
    even, q = 1 / span, 0.02
    for i in range(g):
        mass = max(s * _grown((low - edges[i]) / s, (high - edges[i]) / s), 1e-9 * s) + ratio
        for k in range(m):
            v = (at[k] - edges[i]) / s
            member[k] = (1.0 if v > _WHOLE else _step(v, ratio / s)) / mass
            tilt[k] = even - member[k]
        most = most_clutter * span / mass
        q = _likeliest_share(member, tilt, back, weight, most / (1 + most), q)
        total = 0.0
        for k in range(m):
            total += weight[k] * math.log(max(member[k] + q * tilt[k], _TINY))
        level[i] = total + n * math.log(n) - n
        rho = n * (1 - q) / mass
        rates[0, i], rates[1, i], rates[2, i] = rho, ratio * rho, n * q / span
    return level, rates


@jit_ieee
def _likeliest_share(member: FloatArray, tilt: FloatArray, back: FloatArray, weight: FloatArray, most: float, start: float) -> float:
    """The share q of even clutter in 0 .. most that makes the points likeliest, from `start`.

    member : (m,) density of what is no clutter.   tilt : (m,) that of even clutter less it.   back : (m,) written over.
    """
    low, high = 0.0, most
    q = min(max(start, _LEAST_START), 0.5 * high)
    for _ in range(_ROUNDS):
        for k in range(len(member)):  # apart from the sums, which wait for one another: so the divisions need not
            back[k] = tilt[k] / max(member[k] + q * tilt[k], _TINY)
        slope, bend = 0.0, 0.0
        for k in range(len(member)):
            slope += weight[k] * back[k]
            bend += weight[k] * back[k] * back[k]
        step = slope / max(bend, _TINY)
        if abs(step) < _STILL or (slope > 0 and q >= most) or (slope <= 0 and q < _STILL):
            break  # before the bracket is asked, in which rounding would leave no room
        if slope > 0:
            low = q
        else:
            high = q
        q += step
        if not low < q < high:
            q = 0.01 * high if slope <= 0 else most if high >= most else 0.5 * (low + high)
    return q


@jit_ieee
def _step(v: float, ratio: float) -> float:
    """Phi(v) + ratio phi(v)."""
    bell, tail = bell_and_tail(-v)
    return tail + ratio * bell


@jit_ieee
def _below(v: float) -> float:
    """Phi(v)."""
    return 0.5 * math.erfc(-v * _ROOT_HALF)


@jit_ieee
def _grown(a: float, b: float) -> float:
    """Integral of Phi over a .. b."""
    return b * _below(b) - a * _below(a) + (math.exp(-0.5 * b * b) - math.exp(-0.5 * a * a)) * _INV_ROOT_2PI
