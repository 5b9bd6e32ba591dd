"""What a format tells about a file before and while its points are read: the one form that all readers give and `read_scan` takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.types import FloatArray, IntArray, Value

Column = npt.NDArray[Any]
ROWS_PER_PIECE = 1_000_000


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece(Value):
    """Consecutive rows of a file, in the unit of the file, poses applied.

    points : (k, 3) float64, rows that are not finite included.   columns : name as in the file -> (k,), at least those that were wanted.
    sensor : (3,) or (k, 3) where the points were seen from, or None.
    is_miss : (k,) rows that are rays without return, or None.   direction : (k, 3) unit direction of each ray (read only for misses; nan unknown).
    """

    points: FloatArray
    columns: Mapping[str, Column] = field(default_factory=dict)
    sensor: FloatArray | None = None
    is_miss: npt.NDArray[np.bool_] | None = None
    direction: FloatArray | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Source(Value):
    """An opened file whose header holds.

    columns : names in the order of the file, coordinates among them.   n_points : rows the header promises, None where only reading tells.
    pieces : the wanted columns (names) -> the rows in order.   faces : reads the triangles, None for a file without faces.
    unit : the unit the file states, "" where it states none.   pose_given : a pose in the file was applied to the points.
    grid : reads row and column (n,) of every point in the range image that the file is (-1 none), None where there is no such image or it is damaged.
    """

    columns: tuple[str, ...]
    pieces: Callable[[frozenset[str]], Iterator[Piece]]
    n_points: int | None = None
    faces: Callable[[], IntArray] | None = None
    grid: Callable[[], tuple[IntArray, IntArray] | None] = lambda: None
    unit: str = ""
    pose_given: bool = False
    notes: tuple[str, ...] = ()
