"""Pieces of a file to whole columns: what is not finite is dropped, lengths become metres, and of too many points one a voxel is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2fea.errors import FormatError, InputError, require
from scan2fea.io.source import Column, Piece
from scan2fea.kernel.voxels import VoxelStream
from scan2fea.types import BoolArray, FloatArray, IntArray, Rays

_FARTHEST_M = 1e12  # beyond the solar system's planets: bytes that are no coordinates
_SAMPLE = 200_000  # points from which the first edge is told
_MISSES = 0.25  # rays without return that are kept, as a share of the points: what is seen empty is seen so by many
_SAFETY = 4.0  # the first edge is that much smaller than the sample suggests: it only ever doubles


@dataclass(frozen=True, eq=False, kw_only=True)
class Gathered:
    """Columns of the points that are kept, metres.

    points : (n, 3).   raw_points : the first rows as in the file.   raw_index : (n,).   sensor : (n, 3) or (1, 3), nan unknown, or None.
    miss_origin, miss_direction : (m, 3) rays without return whose direction is known.   miss_time : (m,) when they were sent, nan where not told.
    """

    points: FloatArray
    raw_points: FloatArray
    raw_index: IntArray
    columns: dict[str, Column]
    sensor: FloatArray | None
    miss_origin: FloatArray
    miss_direction: FloatArray
    miss_time: FloatArray
    n_rows: int
    n_dropped: int
    n_misses: int
    voxel_edge_m: float | None
    notes: tuple[str, ...]

    def rays(self, time_s: FloatArray | None = None, ring: FloatArray | None = None) -> tuple[IntArray, Rays | None]:
        """The row of each point in the rays, -1 where its sensor is not known, and the rays: of the points in order, then the misses.

        time_s, ring : (n,) of the points; of misses the ring is not kept (-1).
        """
        n = len(self.points)
        ray = np.full(n, -1, np.int64)
        if self.sensor is None and len(self.miss_origin) == 0:
            return ray, None
        origin = np.broadcast_to(self.sensor if self.sensor is not None else np.full(3, np.nan), (n, 3))
        offset = self.points - origin
        distance = np.sqrt((offset**2).sum(axis=1))
        known = np.isfinite(distance) & (distance > 0)
        n_known = int(known.sum())
        if n_known == 0 and len(self.miss_origin) == 0:
            return ray, None
        ray[known] = np.arange(n_known)
        n_misses = len(self.miss_origin)
        return ray, Rays(
            origin=np.concatenate([origin[known], self.miss_origin]),
            direction=np.concatenate([offset[known] / distance[known, None], self.miss_direction]),
            range_m=np.concatenate([distance[known], np.full(n_misses, np.nan)]),
            time_s=None if time_s is None else np.concatenate([time_s[known], self.miss_time]),
            ring=None if ring is None else np.concatenate([ring[known].astype(np.int64), np.full(n_misses, -1, np.int64)]),
        )


class _Rows:
    """The pieces so far, or one point of each voxel once there are more than `limit`: means would draw the faces of thin walls together."""

    def __init__(self, limit: int, edge_m: float | None = None) -> None:
        self.limit = limit
        self.stream: VoxelStream | None = None if edge_m is None else VoxelStream(edge_m)
        self.points: list[FloatArray] = []
        self.index: list[IntArray] = []
        self.sensor: list[FloatArray] = []
        self.columns: list[dict[str, Column]] = []
        self.n = 0

    def add(self, points: FloatArray, index: IntArray, sensor: FloatArray | None, columns: dict[str, Column]) -> None:
        self._keep(points, index, sensor, columns)
        if self.stream is not None:
            self._thin(points)
        elif self.n > self.limit:
            self._start_thinning()

    def _keep(self, points: FloatArray, index: IntArray, sensor: FloatArray | None, columns: dict[str, Column]) -> None:
        self.points.append(points)
        self.index.append(index)
        self.sensor.append(np.full((1, 3), np.nan) if sensor is None else sensor)
        self.columns.append(columns)
        self.n += len(points)

    def _start_thinning(self) -> None:
        points, index, sensors, columns = self.points, self.index, self.sensor, self.columns
        self.points, self.index, self.sensor, self.columns, self.n = [], [], [], [], 0
        self.stream = VoxelStream(_first_edge(points, self.limit))
        while points:
            part = points.pop(0)
            self._keep(part, index.pop(0), sensors.pop(0), columns.pop(0))
            self._thin(part)

    def _thin(self, points: FloatArray) -> None:
        """Put the last piece kept into the voxels, and keep of it the rows alone that are the first of their voxel."""
        stream = self.stream
        if stream is None:
            return
        n_cells, n_rows = stream.n_cells, stream.n_rows
        stream.add(points)
        new = stream.first_row(n_cells) - n_rows
        self.n -= len(points) - len(new)
        self.points[-1] = np.zeros((0, 3))  # not a view: it would hold the piece
        self.index[-1] = self.index[-1][new]
        self.sensor[-1] = self.sensor[-1] if len(self.sensor[-1]) == 1 else self.sensor[-1][new]
        self.columns[-1] = {name: column[new] for name, column in self.columns[-1].items()}
        while stream.n_cells > self.limit:
            self._coarsen(stream)

    def _coarsen(self, stream: VoxelStream) -> None:
        merged = stream.coarsen()
        top = np.maximum.accumulate(merged)
        kept = np.flatnonzero(np.concatenate([[True], top[1:] != top[:-1]]))
        index, sensor, columns = self.whole()
        self.points, self.index, self.columns = [np.zeros((0, 3))], [index[kept]], [{name: c[kept] for name, c in columns.items()}]
        self.sensor = [sensor if len(sensor) == 1 else sensor[kept]]
        self.n = len(kept)

    def whole(self) -> tuple[IntArray, FloatArray, dict[str, Column]]:
        """Index, sensor ((n, 3), or (1, 3) where all are the same) and columns of all rows kept."""
        if not self.index:
            return np.zeros(0, np.int64), np.full((1, 3), np.nan), {}
        sensor = _joined_sensors(self.sensor, [len(part) for part in self.index])
        names = self.columns[0]
        return np.concatenate(self.index), sensor, {name: np.concatenate([part[name] for part in self.columns]) for name in names}


def _joined_sensors(parts: list[FloatArray], rows: list[int]) -> FloatArray:
    first = parts[0]
    if all(len(part) == 1 and np.array_equal(part, first, equal_nan=True) for part in parts):
        return first
    return np.concatenate([np.broadcast_to(part, (n, 3)) for part, n in zip(parts, rows, strict=True)])


def _first_edge(points: list[FloatArray], limit: int) -> float:
    """A power of two, in metres, at which voxels begin to join points of the scan: small enough, as it only ever doubles."""
    n = sum(len(part) for part in points)
    step = max(1, n // _SAMPLE)
    sample = np.concatenate([part[::step] for part in points])
    extent = float((sample.max(axis=0) - sample.min(axis=0)).max())
    largest = float(np.abs(sample).max())
    smallest = max(extent * 2.0**-22, largest * 2.0**-48, 1e-12)
    stream = VoxelStream(2.0 ** np.floor(np.log2(smallest)))
    stream.add(sample)
    while stream.n_cells > len(sample) // 2 and stream.edge_m < max(extent, smallest):
        stream.coarsen()
    # points on surfaces: `step` times as many of them lie sqrt(step) times closer
    return float(max(2.0 ** np.floor(np.log2(stream.edge_m / (np.sqrt(step) * _SAFETY))), 2.0 ** np.floor(np.log2(smallest))))


def gather(path: Path, pieces: Callable[[], Iterator[Piece]], wanted: tuple[str, ...], scale: float, limit: int, keep_rows: bool) -> Gathered:
    """Read all pieces. `limit`: points beyond which one a voxel is kept; `keep_rows`: vertices of faces, none may be dropped or joined.

    A scan that is thinned is read a second time where doubling the edge has overshot: by the cube root at most what `limit` allows, which holds
    for points on surfaces (count falls as edge^-2) and in a volume (edge^-3) alike.
    """
    found = _read(path, pieces(), wanted, scale, _Rows(limit), keep_rows)
    stream = found.rows.stream
    if stream is not None and stream.n_cells < limit // 2:
        edge = stream.edge_m * (stream.n_cells / limit) ** (1 / 3)
        del found, stream  # one of them is enough to hold
        found = _read(path, pieces(), wanted, scale, _Rows(limit, edge), keep_rows)
    return _gathered(found, limit)


_Ray = tuple[FloatArray, FloatArray, FloatArray]
_NO_RAY: _Ray = (np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


class _Misses:
    """Rays without return: all of them, or every 2nd, 4th, ... where there are more than `limit`."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.n_added, self.step = 0, 1
        self.parts: list[_Ray] = []

    def add(self, origin: FloatArray, direction: FloatArray, time_s: FloatArray) -> None:
        first = -self.n_added % self.step
        self.n_added += len(origin)
        self.parts.append((origin[first :: self.step].copy(), direction[first :: self.step].copy(), time_s[first :: self.step].copy()))
        while sum(len(part[0]) for part in self.parts) > self.limit:
            origin, direction, time_s = self.whole()
            self.step *= 2
            self.parts = [(origin[::2].copy(), direction[::2].copy(), time_s[::2].copy())]

    def whole(self) -> _Ray:
        """Origins and directions (m, 3) and times (m,) of those kept."""
        parts = self.parts or [_NO_RAY]
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts]), np.concatenate([p[2] for p in parts])


@dataclass
class _Found:
    """Counts while a file is read; never leaves this file."""

    rows: _Rows
    misses: _Misses
    raw: FloatArray
    n_rows: int = 0
    n_dropped: int = 0
    n_misses: int = 0
    n_lost: int = 0


def _read(path: Path, pieces: Iterator[Piece], wanted: tuple[str, ...], scale: float, rows: _Rows, keep_rows: bool) -> _Found:
    found = _Found(rows, _Misses(max(1, round(_MISSES * rows.limit))), np.zeros((0, 3)))
    for piece in pieces:
        is_finite = _is_finite(piece.points)
        is_hit: BoolArray = is_finite if piece.is_miss is None else is_finite & ~piece.is_miss
        whole = bool(is_hit.all())
        if found.n_rows == 0:
            found.raw = piece.points[:4]
        if keep_rows:
            _require_whole(path, found.n_rows, is_hit, rows.limit)
        if piece.is_miss is not None:
            lost, ray = _misses(piece, scale)
            found.n_misses += int(piece.is_miss.sum())
            found.n_lost += lost
            found.misses.add(*ray)
        found.n_dropped += int((~is_finite).sum() if piece.is_miss is None else (~is_finite & ~piece.is_miss).sum())
        first, n = found.n_rows, len(piece.points)
        sensor = None if piece.sensor is None else np.atleast_2d(piece.sensor if piece.sensor.ndim == 1 or whole else piece.sensor[is_hit]) * scale
        points = _scaled(piece.points if whole else piece.points[is_hit], scale)
        largest = max(float(points.max(initial=0.0)), -float(points.min(initial=0.0)))
        require(largest <= _FARTHEST_M, InputError, f"{path} has a coordinate of {largest:.3g} m, at most {_FARTHEST_M:g} m is read: it is damaged")
        rows.add(
            points,
            np.arange(first, first + n) if whole else first + np.flatnonzero(is_hit),
            sensor,
            {name: np.asarray(piece.columns[name] if whole else piece.columns[name][is_hit]) for name in wanted},
        )
        found.n_rows += n
    return found


def _is_finite(points: FloatArray) -> BoolArray:
    """(k,) rows that are finite; where their sum is, all are, and that is told ten times faster."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = points.sum()
    if bool(np.isfinite(total)):
        return np.ones(len(points), bool)
    return np.asarray(np.isfinite(points).all(axis=1))


def _scaled(points: FloatArray, scale: float) -> FloatArray:
    return points * scale if scale != 1.0 else points


def _require_whole(path: Path, first: int, is_hit: BoolArray, limit: int) -> None:
    """Vertices of a surface keep their rows: none may be dropped, and none joined."""
    bad = first + int(np.argmin(is_hit)) if len(is_hit) else first
    require(bool(is_hit.all()), FormatError, f"{path}: vertex {bad} of a surface is not finite: repair the file")
    n = first + len(is_hit)
    require(n <= limit, InputError, f"{path} has {n} vertices or more, {limit} fit into input.memory_gib: raise it, or simplify the surface")


def _gathered(found: _Found, limit: int) -> Gathered:
    index, sensor, columns = found.rows.whole()
    stream = found.rows.stream
    if stream is not None:
        points = stream.first_point()
    else:
        points = np.concatenate(found.rows.points) if found.rows.points else np.zeros((0, 3))
    origin, direction, time_s = found.misses.whole()
    return Gathered(
        points=points,
        raw_points=found.raw,
        raw_index=index,
        columns=columns,
        sensor=None if bool(np.isnan(sensor).all()) else sensor,
        miss_origin=origin,
        miss_direction=direction,
        miss_time=time_s,
        n_rows=found.n_rows,
        n_dropped=found.n_dropped,
        n_misses=found.n_misses,
        voxel_edge_m=stream.edge_m if stream is not None else None,
        notes=_notes(found, stream, limit),
    )


def _misses(piece: Piece, scale: float) -> tuple[int, _Ray]:
    """How many misses have no known direction, and origin, direction and time of the others."""
    if piece.is_miss is None or piece.direction is None or piece.sensor is None:
        return int(piece.is_miss.sum()) if piece.is_miss is not None else 0, _NO_RAY
    direction = piece.direction[piece.is_miss]
    known = np.asarray(np.isfinite(direction).all(axis=1))
    origin = np.broadcast_to(piece.sensor, piece.points.shape)[piece.is_miss] * scale
    time_s = np.asarray(piece.columns["time"], float)[piece.is_miss] if "time" in piece.columns else np.full(len(known), np.nan)
    return int((~known).sum()), (origin[known], direction[known], time_s[known])


def _notes(found: _Found, stream: VoxelStream | None, limit: int) -> tuple[str, ...]:
    notes = []
    if found.n_dropped:
        notes.append(f"{found.n_dropped} of {found.n_rows} rows are not finite and were dropped")
    if found.misses.step > 1:
        notes.append(f"1 in {found.misses.step} of {found.misses.n_added} rays without return was kept, to fit into input.memory_gib")
    if found.n_lost:
        notes.append(f"the direction of {found.n_lost} rays without return cannot be told: they were dropped")
    if stream is not None:
        read = f"read as one point in each of {stream.n_cells} voxels of {stream.edge_m:.4g} m"
        notes.append(f"{found.n_rows} points exceed the {limit} that fit into input.memory_gib: {read}")
    return tuple(notes)
