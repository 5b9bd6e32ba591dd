"""An object in the frame of its own faces, as a grid of voxels: what the network looks at.

The grid follows the section: its first two axes share one scale, the third (the axis of a member) has its own, so that a wall of a beam 25 times as
long as deep still fills voxels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.types import FloatArray, Value

GRID = (20, 20, 8)
N_CHANNELS, N_EXTRA = 4, 9
LEAST_POINTS = 60  # fewer tell no kind
_LOOKED_AT, _AMONG = 2000, 20_000
_NEIGHBOURS = 14
_MODES = 150  # normals tried as the direction of a face
_NEAR = 0.978  # cosine of 12 degrees
_ACROSS = 0.34  # cosine of 70 degrees
_LEAST_FACE = 0.02
_TAIL = 0.01
_LINE = 1e-6  # of the length: what is thinner is a line


@dataclass(frozen=True, eq=False, kw_only=True)
class Look(Value):
    """grid : (20, 20, 8, 4) float32: filled, and how much the surface faces each axis.   extra : (9,) float32 proportions."""

    grid: npt.NDArray[np.float32]
    extra: npt.NDArray[np.float32]


def look_at(points: FloatArray, seed: int = 0) -> Look | None:
    """What the network sees of points (n, 3) of one object; None for too few of them or all on one line."""
    if len(points) < LEAST_POINTS:
        return None
    among = points[sampled_rows(len(points), _AMONG, seed)]
    places = among[sampled_rows(len(among), _LOOKED_AT, seed)]
    normals, rough = _normals(places, among)
    frame = _frame(places, normals, seed)
    local, facing = places @ frame.T, np.abs(normals @ frame.T)
    low, high = np.quantile(local, [_TAIL, 1.0 - _TAIL], axis=0)
    extent, share = high - low, (facing**2).mean(axis=0)
    if np.sort(extent)[1] <= _LINE * extent.max():
        return None
    order = _ordered(extent, share)
    local, facing, low, extent, share = local[:, order], facing[:, order], low[order], extent[order], share[order]
    scale = np.array([extent[0], extent[0], max(extent[2], 1e-12)])
    at = (local - low - extent / 2) / scale + 0.5
    cell = np.floor(at * GRID).astype(np.int64)
    inside = ((cell >= 0) & (cell < GRID)).all(axis=1)
    number = (cell[inside, 0] * GRID[1] + cell[inside, 1]) * GRID[2] + cell[inside, 2]
    n_cells = int(np.prod(GRID))
    count = np.bincount(number, minlength=n_cells)
    grid = np.zeros((n_cells, N_CHANNELS), np.float32)
    used = count > 0
    grid[:, 0] = np.minimum(1.0, count / max(float(np.median(count[used])) if used.any() else 1.0, 1.0))
    for k in range(3):
        total = np.bincount(number, weights=facing[inside, k], minlength=n_cells)
        grid[used, 1 + k] = total[used] / count[used]
    proportions = [np.log(scale[2] / extent[0]), extent[1] / extent[0], *share, facing.max(axis=1).mean(), inside.mean()]
    beside = [float(np.median(rough)) / extent[0] * 10.0, float(used.mean()) * 5.0]
    return Look(grid=grid.reshape(*GRID, N_CHANNELS), extra=np.array([*proportions, *beside], np.float32))


def _normals(places: FloatArray, among: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit normals (m, 3) and the standard deviation (m,) of the neighbours across them."""
    patch = among[k_nearest(among, _NEIGHBOURS, places)[1]]
    patch = patch - patch.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("mki,mkj->mij", patch, patch) / patch.shape[1])
    return np.asarray(vectors[:, :, 0]), np.sqrt(np.maximum(values[:, 0], 0.0))


def _frame(points: FloatArray, normals: FloatArray, seed: int) -> FloatArray:
    """(3, 3) rows: the direction that most of the surface faces, the one that most of the rest faces across it, and the third."""
    first = _mode(normals, normals, seed)
    across = normals - (normals @ first)[:, None] * first
    length = np.linalg.norm(across, axis=1)
    beside = length > np.sqrt(1 - _ACROSS**2)
    if beside.mean() >= _LEAST_FACE:
        flat = across[beside] / length[beside, None]
        second = _mode(flat, flat, seed)
    else:  # one sheet: its own long side
        local = points - points.mean(axis=0)
        local = local - (local @ first)[:, None] * first
        second = np.linalg.eigh(local.T @ local)[1][:, 2]
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)])


def _mode(directions: FloatArray, candidates: FloatArray, seed: int) -> FloatArray:
    """(3,) the direction, of any sign, with most of the directions (n, 3) within 12 degrees: the mean of these."""
    tried = candidates[sampled_rows(len(candidates), _MODES, seed)]
    near = np.abs(directions @ tried.T) >= _NEAR
    own = directions[near[:, int(near.sum(axis=0).argmax())]]
    return np.asarray(np.linalg.eigh(own.T @ own)[1][:, 2])


def _ordered(extent: FloatArray, share: FloatArray) -> list[int]:
    """Axes in the order: longer side of the section, shorter side, axis. The axis is where a prism shows little surface for its length."""
    axis = int(np.argmin((share + 1e-3) / np.maximum(extent, 1e-12)))
    rest = [k for k in range(3) if k != axis]
    return [*sorted(rest, key=lambda k: -extent[k]), axis]
