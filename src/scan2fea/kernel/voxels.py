"""Voxel means: one point per occupied cell of a grid anchored at 0 (thesis eq 2.4).

A stream and a small batch share one hash table, a large batch goes part by part (`voxel_parts`). All sum the points of a cell in the order of their
rows, so a stream gives the same bytes as the batch whatever the sizes of its pieces. A record is one cache line: first point, sum of the offsets
from it, count, first row. Offsets from the first point keep all digits far from the origin, where a plain sum of coordinates loses them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from scan2fea.errors import InputError, UsageError, require
from scan2fea.kernel.jit import jit
from scan2fea.kernel.voxel_parts import cells_by_parts, mix
from scan2fea.types import FloatArray, IntArray, Value

_RECORD = 8  # float64 per cell: x, y, z of the first point; sum of offsets in x, y, z; count; first row
_EMPTY = np.int64(-1)
_BLOCK = 128  # rows whose loads run side by side
_SMALLEST_TABLE = 1 << 12
_LARGE = 1 << 21  # cells beyond which storage doubles; below it grows fourfold, as every step enters all cells again
_MANY = 1 << 17  # rows from which a table of their cells may not fit the cache
_MAX_CELL = 2.0**52  # beyond it floor(p / edge) is no longer exact in float64


@dataclass(frozen=True, eq=False, kw_only=True)
class VoxelCells(Value):
    """Occupied cells in the order in which the rows reach them.

    cell_of_point : (n,) int64.   mean : (c, 3) metres.   first_row : (c,) int64, lowest row in the cell, ascending.   count : (c,) int64.
    """

    cell_of_point: IntArray
    n_cells: int
    mean: FloatArray
    first_row: IntArray
    count: IntArray

    _ROWS = (("mean", "first_row", "count"),)


@jit
def _find(fx: float, fy: float, fz: float, edge: float, tag: int, slot: int, table: npt.NDArray[np.int64], records: FloatArray) -> int:
    """Slot of the cell, or the empty slot where it belongs. A slot holds tag (high 31 bits) and cell (low 32 bits)."""
    mask = len(table) - 1
    while table[slot] != -1:
        if table[slot] >> 32 == tag:
            cell = table[slot] & 0xFFFFFFFF
            if np.floor(records[cell, 0] / edge) == fx and np.floor(records[cell, 1] / edge) == fy and np.floor(records[cell, 2] / edge) == fz:
                break
        slot = (slot + 1) & mask
    return slot


@jit
def _touch(points: FloatArray, start: int, stop: int, edge: float, table: npt.NDArray[np.int64], records: FloatArray, hashes: IntArray) -> float:
    """Hash the cells of some rows and load what inserting them will look at: these loads run side by side, those of `_insert` one after the other."""
    mask = len(table) - 1
    for row in range(start, stop):
        hashes[row - start] = mix(np.floor(points[row, 0] / edge), np.floor(points[row, 1] / edge), np.floor(points[row, 2] / edge))
    for k in range(stop - start):
        hashes[_BLOCK + k] = table[hashes[k] & mask]
    seen = 0.0
    for k in range(stop - start):
        if hashes[_BLOCK + k] != -1:
            seen += records[hashes[_BLOCK + k] & 0xFFFFFFFF, 6]
    return seen  # used, so that the loads are not optimised away


@jit
def _insert(
    points: FloatArray, start: int, row0: int, edge: float, table: npt.NDArray[np.int64], records: FloatArray, n_cells: int, cell_of_point: IntArray
) -> tuple[int, int, float]:
    """Add the rows from `start` until all are in or `records` is full; returns the next row, the number of cells, and what `_touch` saw."""
    mask = len(table) - 1
    hashes = np.empty(2 * _BLOCK, np.int64)
    seen = 0.0
    for block in range(start, len(points), _BLOCK):
        stop = min(block + _BLOCK, len(points))
        seen += _touch(points, block, stop, edge, table, records, hashes)
        for row in range(block, stop):
            x, y, z = points[row, 0], points[row, 1], points[row, 2]
            h = hashes[row - block]
            tag = h >> 31
            slot = _find(np.floor(x / edge), np.floor(y / edge), np.floor(z / edge), edge, tag, h & mask, table, records)
            if table[slot] == -1:
                if n_cells == len(records):
                    return row, n_cells, seen
                table[slot] = (tag << 32) | n_cells
                records[n_cells, 0], records[n_cells, 1], records[n_cells, 2] = x, y, z
                records[n_cells, 3], records[n_cells, 4], records[n_cells, 5] = 0.0, 0.0, 0.0
                records[n_cells, 6] = 1.0
                records[n_cells, 7] = row0 + row
                cell_of_point[row] = n_cells
                n_cells += 1
            else:
                cell = table[slot] & 0xFFFFFFFF
                records[cell, 3] += x - records[cell, 0]
                records[cell, 4] += y - records[cell, 1]
                records[cell, 5] += z - records[cell, 2]
                records[cell, 6] += 1.0
                cell_of_point[row] = cell
    return len(points), n_cells, seen


@jit
def _index(records: FloatArray, n_cells: int, edge: float, table: npt.NDArray[np.int64], merged: IntArray) -> int:
    """Enter cells 0..n into an empty table, joining those that fall into one cell; returns how many are left.

    merged : (n,) receives the new number of each cell. `records` keeps the joined cells in its first rows, in their order.
    """
    mask = len(table) - 1
    kept = 0
    for cell in range(n_cells):
        x, y, z = records[cell, 0], records[cell, 1], records[cell, 2]
        fx, fy, fz = np.floor(x / edge), np.floor(y / edge), np.floor(z / edge)
        h = mix(fx, fy, fz)
        tag = h >> 31
        slot = _find(fx, fy, fz, edge, tag, h & mask, table, records)
        if table[slot] == -1:
            table[slot] = (tag << 32) | kept
            for k in range(8):
                records[kept, k] = records[cell, k]
            merged[cell] = kept
            kept += 1
        else:
            into = table[slot] & 0xFFFFFFFF
            n = records[cell, 6]
            records[into, 3] += records[cell, 3] + n * (x - records[into, 0])
            records[into, 4] += records[cell, 4] + n * (y - records[into, 1])
            records[into, 5] += records[cell, 5] + n * (z - records[into, 2])
            records[into, 6] += n
            merged[cell] = into
    return kept


def _empty_table(n_cells: int) -> npt.NDArray[np.int64]:
    size = _SMALLEST_TABLE
    while size < 2 * n_cells:
        size *= 2
    return np.full(size, _EMPTY)


def _checked(points: FloatArray, edge_m: float) -> FloatArray:
    """(n, 3) contiguous. Raises InputError as `VoxelStream.add`."""
    xyz = np.ascontiguousarray(points, float).reshape(-1, 3)
    largest = max(float(xyz.max(initial=0.0)), -float(xyz.min(initial=0.0)))  # nan stays nan
    require(
        largest / edge_m < _MAX_CELL,
        InputError,
        f"a coordinate of {largest:g} m cannot be put into voxels of {edge_m:g} m: drop what is not finite, or take larger voxels",
    )
    return xyz


class VoxelStream:
    """Voxel means of points that arrive in pieces; memory grows with the occupied cells only (64 bytes each and its table).

    This is the one object of the kernel that changes in place: it is an accumulator and never leaves the function that reads a file.
    """

    def __init__(self, edge_m: float) -> None:
        require(np.isfinite(edge_m) and edge_m > 0, UsageError, f"voxel edge is {edge_m} m: give a positive length")
        self.edge_m = float(edge_m)
        self.n_cells = 0
        self.n_rows = 0
        self._records: FloatArray = np.empty((_SMALLEST_TABLE // 2, _RECORD))
        self._table = _empty_table(_SMALLEST_TABLE // 2)

    def add(self, points: FloatArray) -> IntArray:
        """Cell of each of the next points, (n, 3) finite. Cells not below the previous `n_cells` are new.

        Raises InputError where a coordinate is not finite or exceeds 2^52 edges.
        """
        xyz = _checked(points, self.edge_m)
        cells = np.empty(len(xyz), np.int64)
        row = 0
        while row < len(xyz):
            row, self.n_cells, _ = _insert(xyz, row, self.n_rows, self.edge_m, self._table, self._records, self.n_cells, cells)
            if row < len(xyz):
                self._grow()
        self.n_rows += len(xyz)
        return cells

    def coarsen(self) -> IntArray:
        """Double the edge; returns the new number of each cell. Exactly the cells of the double edge: p / (2 e) is (p / e) / 2 to the last bit."""
        self.edge_m *= 2.0
        self._table.fill(_EMPTY)
        merged = np.empty(self.n_cells, np.int64)
        self.n_cells = _index(self._records, self.n_cells, self.edge_m, self._table, merged)
        return merged

    def mean(self) -> FloatArray:
        """(c, 3) mean of the points in each cell (eq 2.4)."""
        used = self._records[: self.n_cells]
        return np.asarray(used[:, 0:3] + used[:, 3:6] / used[:, 6:7])

    def first_point(self) -> FloatArray:
        """(c, 3) point of the lowest row in each cell."""
        return self._records[: self.n_cells, 0:3].copy()

    def first_row(self, from_cell: int = 0) -> IntArray:
        """(c,) lowest row in each cell (from a cell on), ascending."""
        return self._records[from_cell : self.n_cells, 7].astype(np.int64)

    def count(self) -> IntArray:
        """(c,) points in each cell."""
        return self._records[: self.n_cells, 6].astype(np.int64)

    def _grow(self) -> None:
        factor = 4 if len(self._records) < _LARGE else 2
        larger = np.empty((factor * len(self._records), _RECORD))
        larger[: self.n_cells] = self._records[: self.n_cells]
        self._records = larger
        self._table = _empty_table(len(larger))
        _index(larger, self.n_cells, self.edge_m, self._table, np.empty(self.n_cells, np.int64))


def voxel_mean(points: FloatArray, edge_m: float) -> VoxelCells:
    """Mean of the points of each cell of edge `edge_m`, floor(p / edge) along each axis, grid anchored at 0 (thesis eq 2.4).

    points : (n, 3) finite, metres. Cells come in the order of their first rows. Raises UsageError for an edge that is not positive,
    InputError for coordinates that are not finite or exceed 2^52 edges.
    """
    stream = VoxelStream(edge_m)
    if _MANY <= len(points) < 2**32:
        cells, mean, first, count = cells_by_parts(_checked(points, stream.edge_m), stream.edge_m)
        return VoxelCells(cell_of_point=cells, n_cells=len(mean), mean=mean, first_row=first, count=count)
    cells = stream.add(points)
    return VoxelCells(cell_of_point=cells, n_cells=stream.n_cells, mean=stream.mean(), first_row=stream.first_row(), count=stream.count())
