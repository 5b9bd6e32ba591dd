"""Captures of Velodyne LiDAR units (.pcap): the UDP packets as they left the unit.

Layout (HDL-32E and VLP-16 user manuals): a data packet is 12 blocks of flag 0xEEFF, azimuth in 0.01 degree and 32 ranges in 2 mm (0: no
return) with one byte of reflectivity each, then the time of its first firing in microseconds past the hour, the return mode and the unit.
A block is one firing of the 32 beams of an HDL-32E, or two of the 16 of a VLP-16.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import FormatError, InputError, require
from scan2fea.io.files import replacing
from scan2fea.io.numbers import mapped
from scan2fea.io.pcap import datagrams, packet_header, pcap_header, record_header
from scan2fea.io.source import ROWS_PER_PIECE, Piece, Source
from scan2fea.kernel.lidar_units import HDL32E, VLP16, LidarUnit
from scan2fea.types import FloatArray, IntArray

PORT = 2368
RANGE_STEP_M = 0.002
AZIMUTH_STEP_DEG = 0.01
_FLAG = 0xEEFF
_BLOCKS, _CHANNELS = 12, 32
_PAYLOAD = 1206
_STRONGEST = 0x37
_HOUR_US = 3_600_000_000
_SHOT = [("range", "<u2"), ("reflectivity", "u1")]
_BLOCK = np.dtype([("flag", "<u2"), ("azimuth", "<u2"), ("shot", _SHOT, (_CHANNELS,))])
_PACKET = np.dtype([("block", _BLOCK, (_BLOCKS,)), ("time_us", "<u4"), ("mode", "u1"), ("unit", "u1")])
_FULL_TURN = 36000


_UNITS = (HDL32E, VLP16)
_HELD_BACK_S = 1.0  # no network keeps a packet longer
_SAME_PACE = 0.02  # crystals agree far better; the paces of the units differ by a factor


# ------------------------------------------------------------------ writing


def write_velodyne(path: Path, time_s: FloatArray, azimuth_deg: FloatArray, range_m: FloatArray, intensity: FloatArray) -> int:
    """Write firings of an HDL-32E as the unit sends them; returns the number of packets.

    time_s : (f,) increasing, seconds since 1970 or since any hour.   azimuth_deg : (f,) of the first beam of each firing.
    range_m : (f, 32) in firing order, nan for no return.   intensity : (f, 32) 0..1, written as reflectivity in percent.
    The last packet, and each before a gap in time, is filled up with firings without return. Raises InputError for shapes that do not agree.
    """
    n = len(time_s)
    same = azimuth_deg.shape == (n,) and range_m.shape == intensity.shape == (n, _CHANNELS) and n > 0
    require(same, InputError, f"{path}: {n} times and ranges of shape {range_m.shape}: an HDL-32E needs ({n}, {_CHANNELS})")
    require(bool(np.isfinite(time_s).all() and (time_s >= 0).all()), InputError, f"{path}: the times of the firings must be finite and not negative")
    packets = _packed(np.asarray(time_s, float), azimuth_deg, range_m, intensity)
    with replacing(path) as handle:
        handle.write(pcap_header())
        head = packet_header(_PAYLOAD, PORT)
        for packet, time in packets:
            handle.write(record_header(time, len(head) + _PAYLOAD))
            handle.write(head)
            handle.write(packet.tobytes())
    return len(packets)


def _packed(time_s: FloatArray, azimuth_deg: FloatArray, range_m: FloatArray, intensity: FloatArray) -> list[tuple[np.ndarray[Any, Any], float]]:
    """Packets with the time of their first firing."""
    block = np.zeros(len(time_s), _BLOCK)
    block["flag"] = _FLAG
    block["azimuth"] = np.rint(azimuth_deg / AZIMUTH_STEP_DEG).astype(np.int64) % _FULL_TURN
    steps = np.rint(np.nan_to_num(range_m, nan=0.0) / RANGE_STEP_M)
    block["shot"]["range"] = np.where((steps > 0) & (steps < 1 << 16), steps, 0).astype(np.uint16)
    block["shot"]["reflectivity"] = np.clip(np.rint(100 * intensity), 0, 255).astype(np.uint8)
    gaps = np.flatnonzero(np.abs(np.diff(time_s) - HDL32E.firing_us * 1e-6) > 0.5 * HDL32E.firing_us * 1e-6) + 1
    packets = []
    for run in np.split(np.arange(len(time_s)), gaps):
        for first in range(0, len(run), _BLOCKS):
            rows = run[first : first + _BLOCKS]
            packet = np.zeros(1, _PACKET)
            packet["block"][0, : len(rows)] = block[rows]
            packet["block"][0, len(rows) :] = _blank(block[rows], _BLOCKS - len(rows))
            packet["time_us"] = int(time_s[rows[0]] * 1e6) % _HOUR_US
            packet["mode"], packet["unit"] = _STRONGEST, HDL32E.factory
            packets.append((packet, float(time_s[rows[0]])))
    return packets


def _blank(before: np.ndarray[Any, Any], n: int) -> np.ndarray[Any, Any]:
    """Firings without return that turn on as those before."""
    azimuth = before["azimuth"].astype(np.int64)
    step = int(azimuth[-1] - azimuth[-2]) % _FULL_TURN if len(azimuth) > 1 else 0
    blank = np.zeros(n, _BLOCK)
    blank["flag"] = _FLAG
    blank["azimuth"] = (azimuth[-1] + step * np.arange(1, n + 1)) % _FULL_TURN
    return blank


# ------------------------------------------------------------------ reading


def open_velodyne(path: Path, size: int) -> Source:
    """A capture of an HDL-32E or a VLP-16, in the frame of the sensor: x at azimuth 0, z up; every shot without return is a miss.

    Raises FormatError where it is no sound capture, holds no data packet, or those of another unit or of two returns per shot.
    """
    content = mapped(path)
    offsets, n_other = datagrams(path, content, _PAYLOAD)
    ours = content[offsets].astype(np.int64) + 256 * content[offsets + 1].astype(np.int64) == _FLAG if len(offsets) else np.zeros(0, bool)
    n_other += int((~ours).sum())
    offsets = offsets[ours]
    require(len(offsets) > 0, FormatError, f"{path} holds no data packet of a Velodyne unit ({n_other} other packets): record UDP port {PORT}")
    order, disorder = _in_time(content, offsets)
    offsets = offsets[order]
    unit, notes = _unit(path, content, offsets)
    notes += disorder
    turns = _turns(content, offsets)
    if turns[-1] > 0:
        notes += (f"{int(turns[-1]) + 1} turns, all in the frame of the sensor: one cloud only where it stood still",)
    if n_other:
        notes += (f"{n_other} packets without ranges were passed over",)

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        step = max(1, ROWS_PER_PIECE // (_BLOCKS * _CHANNELS))
        for first in range(0, len(offsets), step):
            rows = slice(first, first + step)
            yield _piece(_packets(content, offsets[rows]), turns[_BLOCKS * first : _BLOCKS * (first + step)], unit, wanted)

    return Source(
        columns=("x", "y", "z", "intensity", "ring", "time", "frame"),
        pieces=pieces,
        n_points=len(offsets) * _BLOCKS * _CHANNELS,
        unit="m",
        notes=notes,
    )


def _packets(content: np.ndarray[Any, Any], offsets: IntArray) -> np.ndarray[Any, Any]:
    raw = content[offsets[:, None] + np.arange(_PAYLOAD)]
    return np.ascontiguousarray(raw).view(_PACKET).reshape(-1)


def _unit(path: Path, content: np.ndarray[Any, Any], offsets: IntArray) -> tuple[LidarUnit, tuple[str, ...]]:
    """The model, told from the pace of its packets before its factory byte, which some units carry wrongly."""
    head = _packets(content, offsets[:1000])
    mode, factory = int(head["mode"][0]), int(head["unit"][0])
    require(mode in (_STRONGEST, 0x38), FormatError, f"{path}: return mode {mode:#x}: set the unit to one return per shot (strongest or last)")
    named = next((unit for unit in _UNITS if unit.factory == factory), None)
    pace = np.diff(head["time_us"].astype(np.int64)) % _HOUR_US
    if len(pace):
        middle = float(np.median(pace))
        paced = next((unit for unit in _UNITS if abs(middle / _packet_us(unit) - 1) < _SAME_PACE), None)
        if paced is not None:
            odd = (f"the packets call their unit {named.name if named else hex(factory)}, but come at the pace of a {paced.name}: read as that",)
            return paced, () if paced is named else odd
    if named is None:
        raise FormatError(f"{path} is a capture of Velodyne unit {factory:#x}: {' and '.join(u.name for u in _UNITS)} are read; convert it")
    return named, ()


def _in_time(content: np.ndarray[Any, Any], offsets: IntArray) -> tuple[IntArray, tuple[str, ...]]:
    """Order of the packets by their own clock, and what is said of it. Networks deliver some late; one that is later than that began anew."""
    at = offsets + _BLOCKS * _BLOCK.itemsize
    clock = sum(content[at + k].astype(np.int64) << (8 * k) for k in range(4))
    step = (np.diff(clock) + _HOUR_US // 2) % _HOUR_US - _HOUR_US // 2
    late = step < 0
    if not late.any():
        return np.arange(len(offsets)), ()
    back = float(-step.min()) * 1e-6
    if back > _HELD_BACK_S:
        return np.arange(len(offsets)), (f"its clock goes back by {back:.3g} s: it is more than one recording; split it there",)
    time = np.concatenate([[0], np.cumsum(step)])
    n_late = int((time < np.maximum.accumulate(time)).sum())
    return np.argsort(time, kind="stable"), (f"{n_late} packets came out of order: they were put in the order of their times",)


def _packet_us(unit: LidarUnit) -> float:
    """From one packet to the next."""
    return _BLOCKS * _CHANNELS / len(unit.elevations_deg) * unit.firing_us


def _turns(content: np.ndarray[Any, Any], offsets: IntArray) -> IntArray:
    """(blocks,) number of the turn of each block: one more wherever the azimuth passes 0."""
    starts = (offsets[:, None] + _BLOCK.itemsize * np.arange(_BLOCKS)).ravel()
    azimuth = content[starts + 2].astype(np.int64) + 256 * content[starts + 3].astype(np.int64)
    wraps = np.diff(azimuth) < -_FULL_TURN // 2
    return np.concatenate([[0], np.cumsum(wraps)]).astype(np.int64)


def _piece(packets: np.ndarray[Any, Any], turn: IntArray, unit: LidarUnit, wanted: frozenset[str]) -> Piece:
    """All shots of some packets in firing order."""
    n_beams = len(unit.elevations_deg)
    per_block = _CHANNELS // n_beams
    block = packets["block"]
    azimuth = block["azimuth"].astype(np.int64)
    # hundredths of a degree from one block to the next: the mean of the packet, for single steps carry the rounding of two azimuths
    step = (azimuth[:, -1:] - azimuth[:, :1]) % _FULL_TURN / (_BLOCKS - 1)
    shot = np.arange(_CHANNELS)
    after_us = shot // n_beams * unit.firing_us + shot % n_beams * unit.laser_us
    a = np.radians((azimuth[:, :, None] + step[:, :, None] * (after_us / (per_block * unit.firing_us))) * AZIMUTH_STEP_DEG).ravel()
    beam = np.tile(shot % n_beams, azimuth.size)
    w = np.radians(np.asarray(unit.elevations_deg))[beam]
    direction = np.stack([np.cos(w) * np.cos(a), -np.cos(w) * np.sin(a), np.sin(w)], axis=1)
    sensor = np.zeros_like(direction)
    sensor[:, 2] = -unit.focal_m * np.tan(w)
    steps = block["shot"]["range"].reshape(-1)
    columns: dict[str, Any] = {}
    if "intensity" in wanted:
        columns["intensity"] = block["shot"]["reflectivity"].reshape(-1).astype(np.float64)
    if "ring" in wanted:
        columns["ring"] = np.argsort(np.argsort(unit.elevations_deg))[beam]
    if "time" in wanted:
        blocks_us = per_block * unit.firing_us * np.arange(_BLOCKS)
        columns["time"] = ((packets["time_us"].astype(float)[:, None, None] + blocks_us[:, None] + after_us) * 1e-6).ravel()
    if "frame" in wanted:
        columns["frame"] = np.repeat(turn, _CHANNELS)
    points = sensor + direction * (steps * RANGE_STEP_M)[:, None]
    return Piece(points=points, columns=columns, sensor=sensor, is_miss=steps == 0, direction=direction)
