"""The inertial sensors in the base of an HDL-32E: three gyroscopes with two-axis accelerometers, in the position packets of a capture.

Layout as public drivers of the unit decode it (the manual's own figure was not seen): from byte 14 four words for each of the three chips, rate,
temperature and two accelerations; twelve bits in two's complement, the four above number the word. From byte 198 the microseconds past the hour.
Scales: 0.09766 degrees/s and 0.001221 g a step. How the chips lie against the axes of the scanner: x and y, say, each seen by two of the
accelerometers, which agree to 0.03 g in a real capture.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from scan2fea.errors import FormatError, require
from scan2fea.io.files import existing_file
from scan2fea.io.nmea import read_nmea
from scan2fea.io.numbers import mapped
from scan2fea.io.pcap import MAGIC, datagrams
from scan2fea.kernel.geodesy import STANDARD_GRAVITY
from scan2fea.types import FloatArray

OFFSET_RAD_S = 0.5  # of gyroscopes that nobody calibrated: 29 degrees/s about the vertical in a capture that turned by half a degree
_POSITION, _WORDS, _TIME, _HOUR_S = 512, 14, 198, 3600.0
_RATE, _FORCE = math.radians(0.09766), 0.001221 * STANDARD_GRAVITY


def is_capture(path: Path) -> bool:
    """True where the file begins as a pcap file does."""
    return bool(existing_file(path)) and mapped(path)[:4].tobytes() in MAGIC


def read_unit_inertial(path: Path) -> FloatArray:
    """(n, 7) seconds of the day (of the hour where the receiver told no time), rates (rad/s) and specific force (m/s^2), axes of the scanner.

    Raises FormatError where the capture holds no position packets of this layout.
    """
    content = mapped(path)
    starts, _ = datagrams(path, content, _POSITION)
    raw = np.ascontiguousarray(content[starts[:, None] + np.arange(_TIME + 4)])
    words = np.ascontiguousarray(raw[:, _WORDS : _WORDS + 24]).view("<u2").reshape(-1, 3, 4).astype(np.int64)
    ours = ((words >> 12) == np.arange(4)).all(axis=(1, 2))
    says = f"{path}: {int(ours.sum())} of {len(ours)} position packets hold inertial words: those of an HDL-32E do (UDP port 8308); record them too"
    require(int(ours.sum()) > 1, FormatError, says)
    value = words[ours] & 0xFFF
    value = np.where(value > 0x7FF, value - 0x1000, value)
    g, a = value[:, :, 0], value[:, :, 2:]
    rate = np.stack([g[:, 1], g[:, 0], -g[:, 2]], axis=1) * _RATE
    force = np.stack([a[:, 2, 0] - a[:, 0, 1], -a[:, 1, 1] - a[:, 2, 1], a[:, 0, 0] + a[:, 1, 0]], axis=1) * (0.5 * _FORCE)
    time = np.ascontiguousarray(raw[ours, _TIME : _TIME + 4]).view("<u4").ravel() * 1e-6
    time = time + _HOUR_S * np.concatenate([[0.0], np.cumsum(np.diff(time) < -0.5 * _HOUR_S)])
    try:
        told = read_nmea(path)[0]
        time = time + _HOUR_S * round((float(told[0, 0]) - float(time[0])) / _HOUR_S)
    except FormatError:
        pass  # no receiver: the hour is not known
    return np.concatenate([time[:, None], rate, force], axis=1)
