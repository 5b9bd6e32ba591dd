"""NMEA 0183: the sentences of satellite receivers. Of them GGA is read (time of day, latitude, longitude, quality, height)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from pathlib import Path

import numpy as np

from scan2fea.errors import FormatError, require
from scan2fea.types import FloatArray

_DAY_S = 86400.0


def is_nmea(lines: Sequence[str]) -> bool:
    """True where the first line begins with a dollar sign and a talker."""
    return bool(lines) and lines[0].startswith("$") and "," in lines[0]


def read_nmea(path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """(n, 4) seconds of the day (going on after midnight), latitude, longitude (degrees), height over the ellipsoid (m); and notes.

    Sentences without a fix or with a wrong checksum are left out and counted. Raises FormatError where fewer than two are left.
    """
    rows, n_bad, n_lost = [], 0, 0
    with path.open(encoding="ascii", errors="replace") as handle:
        for line in handle:
            text = line.strip()
            if text[3:6] != "GGA":
                continue
            body, star, checksum = text[1:].partition("*")
            if star and f"{reduce(lambda total, c: total ^ ord(c), body, 0):02X}" != checksum.strip().upper():
                n_bad += 1
                continue
            row = _row(body.split(","))
            if row is None:
                n_lost += 1
            else:
                rows.append(row)
    require(len(rows) > 1, FormatError, f"{path}: holds {len(rows)} GGA sentences with a fix: two or more are needed")
    table = np.array(rows)
    table[:, 0] += _DAY_S * np.concatenate([[0.0], np.cumsum(np.diff(table[:, 0]) < -0.5 * _DAY_S)])
    rising = np.concatenate([[True], table[1:, 0] > np.maximum.accumulate(table[:, 0])[:-1]])
    late = int((~rising).sum())
    left_out = ((n_bad, "sentences with a wrong checksum"), (n_lost, "sentences without a fix"), (late, "times that do not rise"))
    notes = tuple(f"{n} {what} were left out" for n, what in left_out if n)
    return table[rising], (*notes, "times are seconds of the day (UTC)")


def _row(fields: Sequence[str]) -> tuple[float, float, float, float] | None:
    """One GGA sentence; None without a fix."""
    try:
        if len(fields) < 12 or int(fields[6] or 0) == 0:
            return None
        clock = float(fields[1][:2]) * 3600 + float(fields[1][2:4]) * 60 + float(fields[1][4:])
        latitude = (float(fields[2][:2]) + float(fields[2][2:]) / 60) * (-1 if fields[3] == "S" else 1)
        longitude = (float(fields[4][:3]) + float(fields[4][3:]) / 60) * (-1 if fields[5] == "W" else 1)
        return clock, latitude, longitude, float(fields[9]) + float(fields[11] or 0.0)
    except ValueError:
        return None
