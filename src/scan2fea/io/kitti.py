"""Bare rows of 32-bit floats (.bin), the form of KITTI and of much that came after: x y z reflectance, nothing else in the file.

How many values make a row is nowhere stated. It is told from the values themselves: in the right width each column keeps to its own kind of
value, in a wrong one the columns are mixtures of all. The measure is the mutual information of a value and its column (Shannon 1948).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError, require
from scan2fea.io.numbers import forget, mapped
from scan2fea.io.source import ROWS_PER_PIECE, Column, Piece, Source
from scan2fea.types import FloatArray

BYTES = 4
_WIDTHS = (3, 4, 5, 6)
_SAMPLE = 60_000  # values, a multiple of every width
_BLOCKS = 20  # stretches of the file that the sample is taken from
_MOST_BINS, _LEAST_BINS, _PER_BIN = 64, 8, 40
_LEAST_RATIO = 2.0  # the best width must tell this much more than the next one that is no multiple of it
_SURE = 6.0  # standard deviations of what independent columns would tell


def open_kitti(path: Path, size: int) -> Source:
    """Rows of float32, little endian. Four columns are KITTI's own: seen from the origin, the last one reflectance 0..1.

    Raises FormatError where the bytes are no whole rows, or nothing tells the number of columns.
    """
    names = ("x", "y", "z", "intensity", "c5", "c6")[: width_of(path, size)]
    return float_rows(path, size, names, is_at_origin=len(names) == 4)


def float_rows(path: Path, size: int, names: tuple[str, ...], *, is_at_origin: bool) -> Source:
    """Rows of float32 of the given columns, the first three of which are the coordinates. is_at_origin : they were seen from (0, 0, 0)."""
    width = len(names)
    require(size % (BYTES * width) == 0, FormatError, f"{path}: {size} bytes are no whole rows of {width} floats: it is cut off or another format")
    content = mapped(path)
    n = size // (BYTES * width)

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        for start in range(0, n, ROWS_PER_PIECE):
            stop = min(n, start + ROWS_PER_PIECE)
            rows = content[BYTES * width * start : BYTES * width * stop].view("<f4").reshape(-1, width)
            kept: dict[str, Column] = {name: as_float(rows[:, k]) for k, name in enumerate(names) if k > 2 and name in wanted}
            yield Piece(points=as_float(rows[:, :3]), columns=kept, sensor=np.zeros(3) if is_at_origin else None)
            forget(content)

    return Source(columns=names, pieces=pieces, n_points=n)


def as_float(values: npt.NDArray[Any]) -> FloatArray:
    """The same as float64; bytes that are no number become nan in silence."""
    with np.errstate(invalid="ignore"):
        return np.asarray(values, np.float64)


def width_of(path: Path, size: int) -> int:
    """Values in a row. Raises FormatError where nothing tells."""
    require(size % BYTES == 0, FormatError, f"{path}: {size} bytes are no whole 32-bit floats: it is cut off or another format")
    fits = [width for width in _WIDTHS if size % (BYTES * width) == 0]
    says = f"{path}: nothing tells that these {size} bytes are rows of 3 to 6 floats (x y z ...): convert it to PLY or NPY"
    require(fits, FormatError, says)
    values = _sampled(path, size)
    told = {width: _information(values, width) for width in _WIDTHS}
    doubt = _SURE * np.sqrt(2.0 * (_bins(len(values)) - 1) * (max(_WIDTHS) - 1)) / (2.0 * max(len(values), 1))
    best = fits[0]
    for width in fits[1:]:  # 6 tells as much as 3 where it is 3 twice: more, not as much, is asked of the wider
        if told[width] > told[best] + doubt:
            best = width
    rivals = [told[width] for width in fits if width % best != 0 and best % width != 0]
    require(told[best] > doubt and told[best] > _LEAST_RATIO * max(rivals, default=0.0), FormatError, says)
    return best


def _sampled(path: Path, size: int) -> FloatArray:
    """Stretches from all over the file that begin where rows of every width would."""
    content = mapped(path).view("<f4")
    unit = 60  # divides into rows of 3, 4, 5 and 6
    stretch = _SAMPLE // _BLOCKS
    if len(content) <= _SAMPLE:
        return as_float(content)
    starts = np.linspace(0, len(content) - stretch, _BLOCKS).astype(np.int64) // unit * unit
    return np.concatenate([as_float(content[k : k + stretch]) for k in starts.tolist()])


def _bins(n: int) -> int:
    return min(_MOST_BINS, max(_LEAST_BINS, n // _PER_BIN))


def _information(values: FloatArray, width: int) -> float:
    """Mutual information, in nats, of the place of a value in its row and of its bin (up to 64 of equal count); 0 where values are not finite.

    Less what independent columns show on the mean, (bins - 1)(width - 1) / 2n (Miller 1955).
    """
    whole = values[: len(values) // width * width]
    if not len(whole) or not np.isfinite(whole).all():
        return 0.0
    bins = _bins(len(whole))
    rank = np.searchsorted(np.unique(np.quantile(whole, np.linspace(0, 1, bins + 1)[1:-1])), whole)
    count = np.zeros((width, bins))
    np.add.at(count, (np.arange(len(whole)) % width, rank), 1.0)
    share = count / count.sum()
    expected = share.sum(axis=1, keepdims=True) * share.sum(axis=0)
    used = share > 0
    by_chance = (bins - 1) * (width - 1) / (2.0 * len(whole))
    return float((share[used] * np.log(share[used] / expected[used])).sum()) - by_chance
