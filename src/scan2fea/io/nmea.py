"""NMEA 0183: the sentences of satellite receivers, of a text file or of the position packets of a Velodyne capture.

GGA is read (time of day, latitude, longitude, quality, height); where there is none RMC, which is all that the units pass on and holds no height.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from pathlib import Path

import numpy as np

from scan2fea.errors import FormatError, require
from scan2fea.io.files import existing_file
from scan2fea.io.numbers import mapped
from scan2fea.io.pcap import MAGIC, datagrams
from scan2fea.types import FloatArray

_DAY_S = 86400.0
_POSITION, _SENTENCE = 512, 206  # bytes of a position packet, and where its sentence begins (HDL-32E manual, appendix on the position packet)


def holds_nmea(path: Path) -> bool:
    """True for a capture, and where the first line that is not blank begins with a dollar sign and a talker."""
    head = mapped(path)[: 1 << 10].tobytes() if existing_file(path) else b""
    lines = head.removeprefix(b"\xef\xbb\xbf").split()
    return head[:4] in MAGIC or (bool(lines) and lines[0].startswith(b"$") and b"," in lines[0])


def read_nmea(path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """(n, 4) seconds of the day (going on after midnight), latitude, longitude (degrees), height over the ellipsoid (m, nan of RMC); and notes.

    Sentences without a fix or with a wrong checksum are left out and counted. Raises FormatError where fewer than two are left.
    """
    found: dict[str, list[tuple[float, float, float, float]]] = {"GGA": [], "RMC": []}
    n_bad, n_lost = 0, 0
    for text in _sentences(path):
        kind = text[3:6]
        if kind not in found:
            continue
        body, star, checksum = text[1:].partition("*")
        if star and f"{reduce(lambda total, c: total ^ ord(c), body, 0):02X}" != checksum.strip().upper():
            n_bad += 1
            continue
        row = (_gga if kind == "GGA" else _rmc)(body.split(","))
        if row is None:
            n_lost += 1
        else:
            found[kind].append(row)
    rows = found["GGA"] or found["RMC"]
    says = f"{path}: holds {len(rows)} sentences GGA or RMC with a fix: two or more are needed"
    require(len(rows) > 1, FormatError, says)
    table = np.array(rows)
    table[:, 0] += _DAY_S * np.concatenate([[0.0], np.cumsum(np.diff(table[:, 0]) < -0.5 * _DAY_S)])
    rising = np.concatenate([[True], table[1:, 0] > np.maximum.accumulate(table[:, 0])[:-1]])
    late = int((~rising).sum())
    left_out = ((n_bad, "sentences with a wrong checksum"), (n_lost, "sentences without a fix"), (late, "times that do not rise"))
    notes = tuple(f"{n} {what} were left out" for n, what in left_out if n)
    return table[rising], (*notes, "times are seconds of the day (UTC)")


def _sentences(path: Path) -> Iterable[str]:
    """The lines of a text; of a capture the sentence of each position packet, once (units repeat it until the receiver sends the next)."""
    content = mapped(path)
    if content[:4].tobytes() not in MAGIC:
        return _lines(path)
    starts, _ = datagrams(path, content, _POSITION)
    packets = (content[at + _SENTENCE : at + _POSITION].tobytes().split(b"\0")[0].strip() for at in starts.tolist())
    return list(dict.fromkeys(text.decode("ascii", "replace") for text in packets if text.startswith(b"$")))


def _lines(path: Path) -> Iterator[str]:
    with path.open(encoding="ascii", errors="replace") as handle:
        yield from (line.strip() for line in handle)


def _gga(fields: Sequence[str]) -> tuple[float, float, float, float] | None:
    """One sentence of place and height; None without a fix."""
    try:
        if len(fields) < 12 or int(fields[6] or 0) == 0:
            return None
        return (*_placed(fields[1], fields[2:6]), float(fields[9]) + float(fields[11] or 0.0))
    except ValueError:
        return None


def _rmc(fields: Sequence[str]) -> tuple[float, float, float, float] | None:
    """One sentence of place and speed, without height; None without a fix."""
    try:
        return (*_placed(fields[1], fields[3:7]), float("nan")) if len(fields) > 6 and fields[2] == "A" else None
    except ValueError:
        return None


def _placed(clock: str, place: Sequence[str]) -> tuple[float, float, float]:
    """Seconds of the day, latitude and longitude in degrees, of hhmmss.s and ddmm.m, N, dddmm.m, E. Raises ValueError."""
    latitude = (float(place[0][:2]) + float(place[0][2:]) / 60) * (-1 if place[1] == "S" else 1)
    longitude = (float(place[2][:3]) + float(place[2][3:]) / 60) * (-1 if place[3] == "W" else 1)
    return float(clock[:2]) * 3600 + float(clock[2:4]) * 60 + float(clock[4:]), latitude, longitude
