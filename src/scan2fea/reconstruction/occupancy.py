"""What space is filled, told by rays: the most likely density on a grid, given where each ray ended or that it did not.

Each ray meets its first surface at a step k with probability alpha_k prod_{j<k} (1 - alpha_j), and its range is that place with normal noise
along the ray; a ray without a return passes all. The likelihood of all rays and the area of the surface (total variation, which keeps the noise
out) are brought to their best by gradient steps. No normal and no neighbourhood is needed, so the noise may exceed the wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, label

from scan2fea.kernel.jit import jit_ieee
from scan2fea.reconstruction.raster import Images
from scan2fea.types import FloatArray, IntArray, Value

Grid = npt.NDArray[np.float32]

ROUNDS = 50
LEAST_PIXELS = 1.0  # of a cell: finer ones no ray tells apart
STEP, MEMORY, SCALE_MEMORY = 0.3, 0.9, 0.95  # of Adam (Kingma, Ba 2015)
AREA_PRICE = 0.5  # nats per square pixel of surface; each pixel's ray is worth several
SOFT = 0.05  # of the total variation
STRAY = 1e-3  # probability that a ray tells nothing
CLEAR_PIXELS = 3.0  # free space round the points
CELL_PIXELS, CELL_NOISE = 1.2, 1.45  # a cell is a pixel, or what its points can place within a quarter of itself: sigma / (sqrt(n) g) = g / 2
LARGEST_GRID = 4_000_000
SURE = 8.0
FAR = 8.0  # sigma: noise that does not occur
CORE = 1e-4  # of the points may lie beyond the grid at each end


@dataclass(frozen=True, eq=False, kw_only=True)
class Field(Value):
    """value : (i, j, k) log odds of being filled at low + cell_m (i, j, k)."""

    value: Grid
    low: FloatArray
    cell_m: float


def cell_of(images: Images, points: FloatArray, sigma_m: float, area_m2: float) -> float:
    """Edge of the cells, m: what the rays resolve.   area_m2 : of the surface, roughly."""
    pixel = images.pitch_rad * float(np.median(images.range_m[images.is_hit]))
    density = len(points) / area_m2
    return max(CELL_PIXELS * pixel, CELL_NOISE * float(np.sqrt(sigma_m / np.sqrt(density))))


def occupancy(images: Images, points: FloatArray, sigma_m: float, cell_m: float, rounds: int = ROUNDS) -> Field:
    """The most likely field. points : (n, 3) the measured ones.   sigma_m : noise along the rays."""
    pixel = images.pitch_rad * float(np.median(images.range_m[images.is_hit]))
    clear = CLEAR_PIXELS * pixel
    low, high = np.quantile(points, CORE, axis=0) - clear, np.quantile(points, 1.0 - CORE, axis=0) + clear
    cell = max(cell_m, LEAST_PIXELS * pixel, float((np.prod(high - low) / LARGEST_GRID) ** (1 / 3)))
    shape = tuple(int(n) for n in np.ceil((high - low) / cell) + 1)
    value = _started(points, low, cell, shape)
    price = AREA_PRICE * (cell / pixel) ** 2
    hit = images.is_hit
    origin, way = np.ascontiguousarray(images.origin), np.ascontiguousarray(images.direction)
    length = np.where(hit, images.range_m, 0.0)
    mean, scale = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for n in range(1, rounds + 1):
        filled = (1.0 / (1.0 + np.exp(-value))).astype(np.float32)
        slope = np.zeros(shape, np.float32)
        _slopes(origin, way, length, hit, low, cell, filled, slope, sigma_m)
        slope = (slope + _area_slope(filled, price)) * filled * (1 - filled)
        mean = MEMORY * mean + (1 - MEMORY) * slope
        scale = SCALE_MEMORY * scale + (1 - SCALE_MEMORY) * slope * slope
        value = value - STEP * (mean / (1 - MEMORY**n)) / (np.sqrt(scale / (1 - SCALE_MEMORY**n)) + 1e-3)
        value = np.clip(value, -SURE, SURE).astype(np.float32)
    return Field(value=_without_voids(value), low=low, cell_m=cell)


def _started(points: FloatArray, low: FloatArray, cell: float, shape: tuple[int, ...]) -> Grid:
    """Likely filled where many points are."""
    at = np.round((points - low) / cell).astype(np.int64)
    at = at[((at >= 0) & (at < np.array(shape))).all(axis=1)]
    count = np.zeros(shape)
    np.add.at(count, tuple(at.T), 1.0)
    count = gaussian_filter(count, 1.0)
    typical = float(np.median(count[count > 0.1])) if (count > 0.1).any() else 1.0
    return np.where(count > 0.5 * typical, 1.0, -3.0).astype(np.float32)


def _area_slope(filled: Grid, price: float) -> Grid:
    """Slope of price x total variation."""
    steps = [np.diff(filled, axis=a, append=np.take(filled, [-1], axis=a)) for a in range(3)]
    length = np.sqrt(steps[0] ** 2 + steps[1] ** 2 + steps[2] ** 2 + SOFT**2)
    out = np.zeros_like(filled)
    for a in range(3):
        unit = steps[a] / length
        out -= unit
        out += np.roll(unit, 1, axis=a)
    return np.asarray(price * out, np.float32)


def _without_voids(value: Grid) -> Grid:
    """Enclosed space is filled: no ray has been there."""
    free, _ = label(value <= 0)
    outer = np.unique(np.concatenate([np.take(free, [0, -1], axis=a).ravel() for a in range(3)]))
    void = (free > 0) & ~np.isin(free, outer)
    return np.where(void, np.float32(1.0), value)


@jit_ieee
def _slopes(
    origin: FloatArray, way: FloatArray, length: FloatArray, hit: npt.NDArray[np.bool_], low: FloatArray, cell: float,
    filled: Grid, slope: Grid, sigma: float,
) -> None:  # fmt: skip
    """Slope of minus the log likelihood of all rays by the filling of each node, added to `slope`."""
    most = filled.shape[0] + filled.shape[1] + filled.shape[2] + 8
    node, part = np.zeros((most, 3), np.int64), np.zeros((most, 3))
    alpha, clear, near = np.zeros(most), np.zeros(most), np.zeros(most)
    for r in range(len(length)):
        begin, end = 0.0, length[r] + FAR * sigma if hit[r] else np.inf  # nothing farther behind can have sent the ray back
        for a in range(3):
            if abs(way[r, a]) > 1e-12:
                s = (low[a] - origin[r, a]) / way[r, a]
                e = (low[a] + (filled.shape[a] - 1) * cell - origin[r, a]) / way[r, a]
                begin, end = max(begin, min(s, e)), min(end, max(s, e))
        n = _marched(origin, way, r, low, cell, filled, begin, end, node, part, alpha, clear, near)
        if n == 0:
            continue
        if hit[r]:
            likely, behind = STRAY, 0.0
            for k in range(n):
                off = (near[k] - length[r]) / sigma
                near[k] = np.exp(-0.5 * off * off) if off > -FAR else 0.0
                likely += clear[k] * alpha[k] * near[k]
            for k in range(n - 1, -1, -1):
                near[k], behind = (behind / (1.0 - alpha[k]) - clear[k] * near[k]) / likely, behind + clear[k] * alpha[k] * near[k]
        else:
            through = clear[n - 1] * (1.0 - alpha[n - 1])
            for k in range(n):
                near[k] = through / (1.0 - alpha[k]) / (through + STRAY)
        _shared(slope, node, part, near, n)


@jit_ieee
def _marched(
    origin: FloatArray, way: FloatArray, r: int, low: FloatArray, cell: float, filled: Grid, begin: float, end: float,
    node: IntArray, part: FloatArray, alpha: FloatArray, clear: FloatArray, along: FloatArray,
) -> int:  # fmt: skip
    """Steps of one cell along a ray: node and place in its cell, filling, share of the ray still under way, distance from its origin."""
    n, left = 0, 1.0
    s = (math.floor(begin / cell) + 0.5) * cell
    while s < end and n < len(alpha) and left > 1e-4:
        x = (origin[r, 0] + s * way[r, 0] - low[0]) / cell
        y = (origin[r, 1] + s * way[r, 1] - low[1]) / cell
        z = (origin[r, 2] + s * way[r, 2] - low[2]) / cell
        i, j, k = np.int64(math.floor(x)), np.int64(math.floor(y)), np.int64(math.floor(z))
        if s >= begin and 0 <= i < filled.shape[0] - 1 and 0 <= j < filled.shape[1] - 1 and 0 <= k < filled.shape[2] - 1:
            a, b, c = x - i, y - j, z - k
            f = ((filled[i, j, k] * (1 - a) + filled[i + 1, j, k] * a) * (1 - b)
                 + (filled[i, j + 1, k] * (1 - a) + filled[i + 1, j + 1, k] * a) * b) * (1 - c)  # fmt: skip
            f += ((filled[i, j, k + 1] * (1 - a) + filled[i + 1, j, k + 1] * a) * (1 - b)
                  + (filled[i, j + 1, k + 1] * (1 - a) + filled[i + 1, j + 1, k + 1] * a) * b) * c  # fmt: skip
            node[n, 0], node[n, 1], node[n, 2] = i, j, k
            part[n, 0], part[n, 1], part[n, 2] = a, b, c
            alpha[n], clear[n], along[n] = min(f, 0.999), left, s
            left *= 1.0 - alpha[n]
            n += 1
        s += cell
    return n


@jit_ieee
def _shared(slope: Grid, node: IntArray, part: FloatArray, value: FloatArray, n: int) -> None:
    """Each of the first n values shared among the eight nodes round its place."""
    for m in range(n):
        v = value[m]
        if v == 0.0:
            continue
        i, j, k = node[m, 0], node[m, 1], node[m, 2]
        for di in range(2):
            u = v * (part[m, 0] if di else 1.0 - part[m, 0])
            for dj in range(2):
                w = u * (part[m, 1] if dj else 1.0 - part[m, 1])
                slope[i + di, j + dj, k] += np.float32(w * (1.0 - part[m, 2]))
                slope[i + di, j + dj, k + 1] += np.float32(w * part[m, 2])
