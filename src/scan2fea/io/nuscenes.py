"""nuScenes LIDAR_TOP sweeps (.pcd.bin): rows of five 32-bit floats, x y z intensity ring, in the frame of the sensor (nuScenes devkit).

What lies beside them as .pkl is Python code in disguise and is never read.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scan2fea.errors import FormatError, require
from scan2fea.io.kitti import BYTES, as_float, float_rows
from scan2fea.io.numbers import mapped
from scan2fea.io.source import Source

_NAMES = ("x", "y", "z", "intensity", "ring")
_LOOK = 1000  # rows by which a file that only bears the name is told
_MOST_RINGS = 256


def open_nuscenes(path: Path, size: int) -> Source:
    """A sweep, seen from the origin. Raises FormatError where it is no whole rows of five, or its fifth column holds no ring numbers."""
    require(
        size % (BYTES * len(_NAMES)) == 0,
        FormatError,
        f"{path}: {size} bytes are no whole rows of x y z intensity ring as 32-bit floats: it is cut off or another format",
    )
    ring = as_float(mapped(path)[: _LOOK * BYTES * len(_NAMES)].view("<f4").reshape(-1, len(_NAMES))[:, 4])
    is_ring = bool(np.isfinite(ring).all()) and bool(((ring >= 0) & (ring < _MOST_RINGS) & (ring == np.floor(ring))).all())
    require(is_ring, FormatError, f"{path}: its fifth column holds no ring numbers as in a nuScenes sweep: name it .bin if its rows are others")
    return float_rows(path, size, _NAMES, is_at_origin=True)
