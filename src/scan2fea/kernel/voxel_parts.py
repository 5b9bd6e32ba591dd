"""Voxel cells of a large cloud, part by part: rows go to parts by the hash of their cell, so that a cell's rows meet in one that fits the cache.

One table for everything would be asked at random, from memory, for every row. The rows of a part keep their order, hence the sums theirs.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray

_ROWS_OF_A_PART = 1 << 14
_MOST_BITS = 12
HASH_BITS = 62

Rows = npt.NDArray[np.uint32]


@jit
def mix(fx: float, fy: float, fz: float) -> int:
    """A 62-bit hash of a cell (multiply and xorshift, after the finaliser of SplitMix64)."""
    ix, iy, iz = np.uint64(np.int64(fx)), np.uint64(np.int64(fy)), np.uint64(np.int64(fz))
    h = ix * np.uint64(0x9E3779B97F4A7C15) + iy * np.uint64(0xC2B2AE3D27D4EB4F) + iz * np.uint64(0x165667B19E3779F9)
    h ^= h >> np.uint64(30)
    h *= np.uint64(0xBF58476D1CE4E5B9)
    h ^= h >> np.uint64(27)
    h *= np.uint64(0x94D049BB133111EB)
    h ^= h >> np.uint64(31)
    return np.int64(h >> np.uint64(2))  # type: ignore[return-value]  # numba has no other way to say int


def cells_by_parts(xyz: FloatArray, edge: float) -> tuple[IntArray, FloatArray, IntArray, IntArray]:
    """Cell of each row (n,), means (c, 3), first rows (c,) and counts (c,); cells in the order of their first rows.

    xyz : (n, 3) contiguous, n < 2^32, finite and below 2^52 edges. Beside what is returned it takes 32 bytes a row, before the means are made.
    """
    n = len(xyz)
    bits = min(_MOST_BITS, max(0, (n // _ROWS_OF_A_PART).bit_length()))
    begin = np.concatenate([[0], np.cumsum(_counted(xyz, edge, bits))])
    part, row = np.empty((n, 3)), np.empty(n, np.uint32)
    _dealt(xyz, edge, bits, begin.copy(), part, row)
    cell, number = np.empty(n, np.int64), np.empty(n, np.uint32)
    n_cells = _cells(part, row, begin, edge, cell, number)
    _numbered(cell)
    mean, first, count = np.empty((n_cells, 3)), np.empty(n_cells, np.int64), np.empty(n_cells, np.int64)
    _ordered_means(part, row, cell, mean)
    del part
    _ordered_counts(row, number, cell, first, count)
    return cell, mean, first, count


@jit
def _counted(xyz: FloatArray, edge: float, bits: int) -> IntArray:
    """Rows of each part."""
    count = np.zeros(1 << bits, np.int64)
    for i in range(len(xyz)):
        count[mix(np.floor(xyz[i, 0] / edge), np.floor(xyz[i, 1] / edge), np.floor(xyz[i, 2] / edge)) >> (HASH_BITS - bits)] += 1
    return count


@jit
def _dealt(xyz: FloatArray, edge: float, bits: int, at: IntArray, part: FloatArray, row: Rows) -> None:
    """Copy each row behind those of its part; `at` (parts,) is where the next one goes."""
    for i in range(len(xyz)):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        k = mix(np.floor(x / edge), np.floor(y / edge), np.floor(z / edge)) >> (HASH_BITS - bits)
        j = at[k]
        at[k] = j + 1
        part[j, 0], part[j, 1], part[j, 2] = x, y, z
        row[j] = np.uint32(i)


@jit
def _cells(part: FloatArray, row: Rows, begin: IntArray, edge: float, cell: IntArray, number: Rows) -> int:
    """First row of the cell of each row, into `cell`; returns the number of cells.

    Their means, first rows and numbers of points are written over the first rows of `part`, `row` and into `number`: no more of them than rows that
    have been done.
    """
    room, n_done = int(np.diff(begin).max()), 0
    table = np.empty(_size(room), np.int32)
    key, first, total, count = np.empty((room, 3)), np.empty((room, 3)), np.empty((room, 3)), np.empty((room, 2), np.int64)
    for k in range(len(begin) - 1):
        n_cells, mask = 0, _size(begin[k + 1] - begin[k]) - 1
        table[: mask + 1] = -1
        for j in range(begin[k], begin[k + 1]):
            x, y, z = part[j, 0], part[j, 1], part[j, 2]
            fx, fy, fz = np.floor(x / edge), np.floor(y / edge), np.floor(z / edge)
            slot = mix(fx, fy, fz) & mask
            while table[slot] >= 0 and not (key[table[slot], 0] == fx and key[table[slot], 1] == fy and key[table[slot], 2] == fz):
                slot = (slot + 1) & mask
            c = table[slot]
            if c < 0:
                c = n_cells
                table[slot] = c
                n_cells += 1
                key[c, 0], key[c, 1], key[c, 2] = fx, fy, fz
                first[c, 0], first[c, 1], first[c, 2] = x, y, z
                total[c, 0], total[c, 1], total[c, 2] = 0.0, 0.0, 0.0
                count[c, 0], count[c, 1] = 1, row[j]
            else:
                total[c, 0] += x - first[c, 0]
                total[c, 1] += y - first[c, 1]
                total[c, 2] += z - first[c, 2]
                count[c, 0] += 1
            cell[row[j]] = count[c, 1]
        for c in range(n_cells):
            for d in range(3):
                part[n_done + c, d] = first[c, d] + total[c, d] / count[c, 0]
            row[n_done + c], number[n_done + c] = count[c, 1], count[c, 0]
        n_done += n_cells
    return n_done


@jit
def _size(rows: int) -> int:
    """A power of two, at least twice the number of rows."""
    size = 2
    while size < 2 * rows:
        size *= 2
    return size


@jit
def _numbered(cell: IntArray) -> None:
    """First rows into numbers: a cell's first row comes before all its others."""
    n = 0
    for i in range(len(cell)):
        if cell[i] == i:
            cell[i] = n
            n += 1
        else:
            cell[i] = cell[cell[i]]


@jit
def _ordered_means(part: FloatArray, row: Rows, cell: IntArray, mean: FloatArray) -> None:
    for c in range(len(mean)):
        k = cell[row[c]]
        mean[k, 0], mean[k, 1], mean[k, 2] = part[c, 0], part[c, 1], part[c, 2]


@jit
def _ordered_counts(row: Rows, number: Rows, cell: IntArray, first: IntArray, count: IntArray) -> None:
    for c in range(len(first)):
        k = cell[row[c]]
        first[k], count[k] = row[c], number[c]
