"""The density of points of the plane at themselves: a histogram blurred by a Gaussian, its logarithm and slope, in one compiled pass."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, Value

_CELLS = 2.0  # of the grid, per width of the Gaussian
_REACH = 7  # cells: 3.5 widths
_MOST_CELLS = 1500  # in either direction
_FLOOR = 0.03  # of the mean density: points that lie where it is lower have no say


@dataclass(frozen=True, eq=False, kw_only=True)
class Grid(Value):
    """low : (2,) corner.   shape : cells in x and y.   cell_m : side of a cell."""

    low: FloatArray
    shape: tuple[int, int]
    cell_m: float


def grid_of(u: FloatArray, width_m: float) -> Grid:
    """The grid of a Gaussian of that width over (n, 2) points, without the outermost two hundredths on each side and with four widths around them."""
    low, high = np.quantile(u, (0.005, 0.995), axis=0)
    low, high = low - 4 * width_m, high + 4 * width_m
    cell = width_m / _CELLS
    nx, ny = np.minimum(np.ceil((high - low) / cell).astype(int) + 1, _MOST_CELLS).tolist()
    return Grid(low=low, shape=(nx, ny), cell_m=cell)


def log_density_of(u: FloatArray, grid: Grid) -> tuple[FloatArray, FloatArray]:
    """Log density (n,) of the points (n, 2) at themselves, each without its own share, and its slope (n, 2); zero slope beyond the grid."""
    x = np.arange(-_REACH, _REACH + 1) / _CELLS
    bell = np.exp(-0.5 * x**2)
    return _log_density_of(np.ascontiguousarray(u), np.array(grid.low), grid.shape[0], grid.shape[1], grid.cell_m, bell / bell.sum())


@jit
def _log_density_of(u: FloatArray, low: FloatArray, nx: int, ny: int, cell: float, bell: FloatArray) -> tuple[FloatArray, FloatArray]:
    n = len(u)
    count = np.zeros((nx, ny))
    for i in range(n):
        x, y = (u[i, 0] - low[0]) / cell, (u[i, 1] - low[1]) / cell
        if not (0 < x < nx - 1 and 0 < y < ny - 1):
            continue
        a, b = int(x), int(y)
        fx, fy = x - a, y - b
        count[a, b] += (1 - fx) * (1 - fy)
        count[a + 1, b] += fx * (1 - fy)
        count[a, b + 1] += (1 - fx) * fy
        count[a + 1, b + 1] += fx * fy
    smooth = _blurred(count, bell)
    total, filled = 0.0, 0
    for a in range(nx):
        for b in range(ny):
            if smooth[a, b] > 0:
                total += smooth[a, b]
                filled += 1
    floor = _FLOOR * total / max(filled, 1) + 1e-300
    own = 1 / (2 * math.pi * _CELLS**2)  # of the point itself, which must not vouch for itself
    level, slope = np.empty(n), np.zeros((n, 2))
    for i in range(n):
        x, y = (u[i, 0] - low[0]) / cell, (u[i, 1] - low[1]) / cell
        inside = 0 < x < nx - 1 and 0 < y < ny - 1
        x, y = min(max(x, 0.0), nx - 1.0), min(max(y, 0.0), ny - 1.0)
        a, b = min(int(x), nx - 2), min(int(y), ny - 2)
        fx, fy = x - a, y - b
        value, gx, gy = floor, 0.0, 0.0
        for da in range(2):
            for db in range(2):
                share = (fx if da else 1 - fx) * (fy if db else 1 - fy)
                value += share * smooth[a + da, b + db]
                gx += share * _difference(smooth[min(a + da + 1, nx - 1), b + db], smooth[max(a + da - 1, 0), b + db])
                gy += share * _difference(smooth[a + da, min(b + db + 1, ny - 1)], smooth[a + da, max(b + db - 1, 0)])
        level[i] = math.log(max(value - own, floor) / (n * cell * cell))
        if inside:
            slope[i, 0], slope[i, 1] = gx / value / cell, gy / value / cell
    return level, slope


@jit
def _difference(after: float, before: float) -> float:
    """Central difference of neighbours one cell apart; the margin of the grid is empty, so its rim needs no other."""
    return 0.5 * (after - before)


@jit
def _blurred(count: FloatArray, bell: FloatArray) -> FloatArray:
    """(nx, ny) counts convolved with the bell (2 reach + 1,) along both axes; nothing lies beyond the grid. Empty cells are passed by."""
    nx, ny = count.shape
    reach = len(bell) // 2
    along, both = np.zeros((nx, ny)), np.zeros((nx, ny))
    for a in range(nx):
        for b in range(ny):
            if count[a, b] != 0.0:
                for k in range(-min(reach, b), min(reach, ny - 1 - b) + 1):
                    along[a, b + k] += count[a, b] * bell[k + reach]
    for a in range(nx):
        for k in range(-min(reach, a), min(reach, nx - 1 - a) + 1):
            w = bell[k + reach]
            for b in range(ny):
                both[a + k, b] += w * along[a, b]
    return both
