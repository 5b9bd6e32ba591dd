"""Pings of an ultrasonic sensor: the nearest surface in a wide cone, of which the distance is known well and the direction hardly.

An occupancy grid (Moravec, Elfes 1985) holds what all pings say: no surface nearer than the echo anywhere in the cone, one somewhere on the cap at
its distance. Each echo then becomes one point on its cap, at the mean of the directions weighted with the odds that the *other* pings leave to the
cells there; its standard deviation across is the spread of those directions: a large one where nothing narrows it down.

A log is text with a header. Position x, y, z (m); direction dx, dy, dz, or qx, qy, qz, qw (the sensor looks along x), or yaw_deg and pitch_deg;
range_m, or time_us with temperature_c (else 20); cone_deg where it is known. A ping without echo has no range, or 0: it says nothing, as a surface
that throws the sound aside is silent, not absent.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2fea.acquisition.acquired import Acquired, Frame, seen_from
from scan2fea.acquisition.options import AcquisitionOptions
from scan2fea.errors import FormatError, InputError, require
from scan2fea.kernel.transforms import quaternion_to_matrix
from scan2fea.types import FloatArray, IntArray, Scan, Value

CONE_DEG = 30.0
RANGE_SIGMA_M, RANGE_SIGMA_SHARE = 0.003, 0.005  # of a range: clock and threshold; 1 degree of the air is 0.17 %, 3 degrees are told nowhere
_CELLS_ACROSS = 8.0  # of the cap's radius
_FREE, _THERE = -0.85, 0.4  # log odds that one ping gives a cell before, and one on, its cap
_ZERO_C, _SPEED_0 = 273.15, 331.3  # speed of sound 331.3 m/s sqrt(1 + T / 273.15 C), dry air (Cramer 1993, ideal gas)
_LEAST_PINGS = 3
_MOST_PINGS = 200_000
_AT_ONCE = 500


def from_ultrasonic(path: Path, options: AcquisitionOptions) -> Acquired:
    """One frame of all pings of a log, in the frame of its positions. Raises InputError, FormatError with the line."""
    columns, n_rows = _read(path)
    origin, axis = np.stack([columns[k] for k in "xyz"], axis=1), _axes(path, columns)
    range_m = _ranges(path, columns)
    heard = np.isfinite(range_m) & (range_m > 0) & np.isfinite(origin).all(axis=1) & np.isfinite(axis).all(axis=1)
    says = f"{path}: {int(heard.sum())} of {n_rows} pings have an echo and a place, {_LEAST_PINGS} are needed"
    require(int(heard.sum()) >= _LEAST_PINGS, InputError, says)
    require(int(heard.sum()) <= _MOST_PINGS, InputError, f"{path}: {int(heard.sum())} pings, at most {_MOST_PINGS} are used: thin the log")
    told = columns.get("cone_deg")
    stated = float(np.nanmedian(told)) if told is not None and np.isfinite(told).any() else None
    cone = options.cone_deg or stated or CONE_DEG
    scan, cell = surface_of(origin[heard], axis[heard], range_m[heard], math.radians(cone) / 2)
    across = scan.cloud.sigma_across_m
    widest = range_m[heard] * math.tan(math.radians(cone) / 2) / 2
    how = {
        "method": "ultrasonic", "n_pings": n_rows, "n_echoes": int(heard.sum()), "cone_deg": cone, "cell_m": cell,
        "across_m_median": float(np.median(across)) if across is not None else None, "across_m_median_of_the_cone": float(np.median(widest)),
    }  # fmt: skip
    assumed = () if options.cone_deg or stated else (f"{path.name}: the cone's opening is not stated: {CONE_DEG:g} degrees were taken",)
    note = f"{path.name}: {int(heard.sum())} echoes; a place is known to {how['across_m_median']:.2g} m across (standard deviation, median)"
    return Acquired(frames=(Frame(name=str(path), scan=scan, T_world_frame=np.eye(4)),), unit_source="format", how=how, notes=(*assumed, note))


def surface_of(origin: FloatArray, axis: FloatArray, range_m: FloatArray, half: float) -> tuple[Scan, float]:
    """One point per echo (n, 3 origins and unit axes, n ranges, half the opening), and the edge of the cells, m."""
    sigma = np.hypot(RANGE_SIGMA_M, RANGE_SIGMA_SHARE * range_m)
    radius = float(np.median(range_m)) * math.tan(half)
    cell = max(radius / _CELLS_ACROSS, 2.0 * float(np.median(sigma)))
    cells = _cells(origin, range_m, cell)
    odds = _odds(origin, axis, range_m, half, range_m - 3.0 * sigma - cell, cells)
    way, across = _directions(origin, axis, range_m, half, cells, odds)
    points = origin + range_m[:, None] * way
    return seen_from(origin, points, sigma, np.hypot(across, cell / math.sqrt(12.0))), cell


def _cap(axis: FloatArray, half: float, k: int) -> FloatArray:
    """(n, k, 3) unit directions spread evenly over the cones about (n, 3) axes, along a spiral."""
    i = np.arange(k) + 0.5
    cosine = 1.0 - (1.0 - math.cos(half)) * i / k
    sine, turn = np.sqrt(1.0 - cosine**2), i * (math.pi * (3.0 - math.sqrt(5.0)))
    side = np.where(np.abs(axis[:, [2]]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(axis, side)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(axis, u)
    across = (np.cos(turn) * sine)[None, :, None] * u[:, None] + (np.sin(turn) * sine)[None, :, None] * v[:, None]
    return np.asarray(cosine[None, :, None] * axis[:, None] + across)


def _count(range_m: FloatArray, half: float, cell: float) -> int:
    """Directions so dense that the largest cap has about two in each cell."""
    area = 2.0 * math.pi * float(range_m.max()) ** 2 * (1.0 - math.cos(half))
    return int(np.clip(2.0 * area / cell**2, 16, 4000))


@dataclass(frozen=True, eq=False, kw_only=True)
class Cells(Value):
    """A grid of `shape` cells of one edge from the corner `low`."""

    low: FloatArray
    edge_m: float
    shape: tuple[int, int, int]

    def keys(self, places: FloatArray) -> IntArray:
        """One whole number per cell for places (..., 3) within the grid."""
        i = np.floor((places - self.low) / self.edge_m).astype(np.int64)
        return np.asarray((i[..., 0] * self.shape[1] + i[..., 1]) * self.shape[2] + i[..., 2])


def _cells(origin: FloatArray, range_m: FloatArray, edge: float) -> Cells:
    low = (origin - range_m[:, None]).min(axis=0) - edge
    size = np.ceil(((origin + range_m[:, None]).max(axis=0) - low) / edge).astype(int) + 1
    return Cells(low=low, edge_m=edge, shape=(int(size[0]), int(size[1]), int(size[2])))


def _odds(origin: FloatArray, axis: FloatArray, range_m: FloatArray, half: float, clear: FloatArray, cells: Cells) -> tuple[IntArray, FloatArray]:
    """Rising keys of the cells that any ping spoke of, and their log odds. Each ping speaks of a cell once. clear : (n,) reach that is empty."""
    keys, values = [], []
    k = _count(range_m, half, cells.edge_m)
    n_cells = math.prod(cells.shape)
    for start in range(0, len(origin), _AT_ONCE):
        rows = slice(start, start + _AT_ONCE)
        way, own = _cap(axis[rows], half, k), origin[rows, None]
        ping = np.arange(len(way), dtype=np.int64)[:, None] * n_cells
        there = np.unique(ping + cells.keys(own + range_m[rows, None, None] * way))
        before = [np.zeros(0, np.int64)]
        for s in np.arange(cells.edge_m, float(clear[rows].max(initial=0.0)), cells.edge_m):
            near = clear[rows] > s
            few = way[near, :: max(1, int((float(range_m[rows].min()) / s) ** 2 / 2))]  # nearer caps are smaller
            before.append(np.unique(ping[near] + cells.keys(own[near] + s * few)))
        free = np.setdiff1d(np.concatenate(before), there)
        for found, value in ((there, _THERE), (free, _FREE)):
            keys.append(found % n_cells)
            values.append(np.full(len(found), value))
    key, where = np.unique(np.concatenate(keys), return_inverse=True)
    return np.asarray(key, np.int64), np.asarray(np.bincount(where, weights=np.concatenate(values), minlength=len(key)), np.float64)


def _directions(
    origin: FloatArray, axis: FloatArray, range_m: FloatArray, half: float, cells: Cells, odds: tuple[IntArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """(n, 3) unit direction of each echo, and the standard deviation (n,) of its place across it."""
    k = _count(range_m, half, cells.edge_m)
    ways, spreads = [], []
    for start in range(0, len(origin), _AT_ONCE):
        rows = slice(start, start + _AT_ONCE)
        way = _cap(axis[rows], half, k)
        key = cells.keys(origin[rows, None] + range_m[rows, None, None] * way)
        at = np.minimum(np.searchsorted(odds[0], key), len(odds[0]) - 1)
        value = np.where(odds[0][at] == key, odds[1][at], 0.0)
        weight = np.exp(value - value.max(axis=1, keepdims=True))  # its own share is the same all over the cap
        weight /= weight.sum(axis=1, keepdims=True)
        mean = np.einsum("nk,nkc->nc", weight, way)
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        off = way - mean[:, None] * np.einsum("nkc,nc->nk", way, mean)[:, :, None]
        spread = np.sqrt(np.einsum("nk,nkc,nkc->n", weight, off, off) / 2.0)
        ways.append(mean)
        spreads.append(spread * range_m[rows])
    return np.concatenate(ways), np.concatenate(spreads)


def _read(path: Path) -> tuple[dict[str, FloatArray], int]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as handle:
            rows = [row for row in csv.reader(handle) if row and not row[0].lstrip().startswith("#")]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FormatError(f"{path}: cannot be read as text of columns ({error})") from error
    require(len(rows) > 1, InputError, f"{path}: holds no pings")
    names = [name.strip().lower() for name in rows[0]]
    need = [name for name in "xyz" if name not in names]
    says = f"{path}: its header {', '.join(names)[:120]} lacks {', '.join(need)}: a log needs x, y, z, a direction (dx dy dz) and range_m"
    require(not need, FormatError, says)
    values = np.full((len(rows) - 1, len(names)), np.nan)
    for i, row in enumerate(rows[1:]):
        require(len(row) == len(names), FormatError, f"{path}, row {i + 2}: {len(row)} values for {len(names)} columns")
        for j, word in enumerate(row):
            try:
                values[i, j] = float(word) if word.strip() else np.nan
            except ValueError as error:
                raise FormatError(f"{path}, row {i + 2}: {names[j]} = {word!r} is no number") from error
    return {name: values[:, j] for j, name in enumerate(names)}, len(values)


def _axes(path: Path, columns: Mapping[str, FloatArray]) -> FloatArray:
    if _has(columns, ("dx", "dy", "dz")):
        way = np.stack([columns[k] for k in ("dx", "dy", "dz")], axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True))
    if _has(columns, ("qx", "qy", "qz", "qw")):
        q = np.stack([columns[k] for k in ("qx", "qy", "qz", "qw")], axis=1)
        fine = np.isfinite(q).all(axis=1) & (np.linalg.norm(q, axis=1) > 0)
        return np.array([quaternion_to_matrix(v)[:, 0] if ok else np.full(3, np.nan) for v, ok in zip(q, fine, strict=True)])
    if _has(columns, ("yaw_deg",)):
        yaw = np.radians(columns["yaw_deg"])
        pitch = np.radians(columns.get("pitch_deg", np.zeros(len(yaw))))
        return np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=1)
    raise FormatError(f"{path}: no direction: give dx, dy, dz, or qx, qy, qz, qw, or yaw_deg (and pitch_deg)")


def _ranges(path: Path, columns: Mapping[str, FloatArray]) -> FloatArray:
    if "range_m" in columns:
        return columns["range_m"]
    require("time_us" in columns, FormatError, f"{path}: no range: give range_m, or time_us (out and back) with temperature_c")
    air = columns.get("temperature_c", np.full(len(columns["time_us"]), 20.0))
    return np.asarray(columns["time_us"] * 1e-6 * _SPEED_0 * np.sqrt(1.0 + air / _ZERO_C) / 2.0)


def _has(columns: Mapping[str, FloatArray], names: Sequence[str]) -> bool:
    return all(name in columns for name in names)
