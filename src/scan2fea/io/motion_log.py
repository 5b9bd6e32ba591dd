"""Logs of an inertial unit, a satellite receiver and a scanner of one beam: which columns are what, in which unit, and which rows can be used."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from scan2fea.errors import FormatError, InputError, require
from scan2fea.io.nmea import holds_nmea, read_nmea
from scan2fea.io.planar_scan import planar_columns
from scan2fea.io.table import Table, read_table
from scan2fea.io.unit_inertial import is_capture, read_unit_inertial
from scan2fea.kernel.geodesy import STANDARD_GRAVITY, east_north_up
from scan2fea.types import BoolArray, FloatArray, InertialLog, IntArray, PositionLog, RangeLog

T = TypeVar("T")
INERTIAL, POSITIONS, RANGES, POSES = "inertial", "positions", "ranges", "poses"
NO_HEIGHT_M = (3.0, 3.0, 100.0)  # standard deviations of a place whose height is not told
GAP_STEPS, GAP_S = 10.0, 0.05  # a step that is longer than both (of the median) is a gap
_MOST_DISORDER = 0.1
_FASTEST = math.radians(2000.0)  # what gyroscopes of this kind measure at most
_GRAVITY_FITS = (0.7, 1.4)

_TIME = re.compile(r"^(?:timestamp|time|stamp|t|sec|seconds|epoch)[ _.]*(?:[\[(]?(?P<unit>[a-z]*)[\])]?)$")
_KINDS = {
    "rate": "gyroscope|gyro|gyr|omega|angular[ _.]?(?:velocity|rate)|rate|g|w",
    "force": "accelerometer|linear[ _.]?acceleration|acceleration|accel|acc|specific[ _.]?force|f|a",
    "field": "magnetometer|magnetic(?:[ _.]?field)?|mag|m",
}
_AXIS = {kind: re.compile(rf"^(?:field\.|imu[ _.])?(?:{names})[ _.]*(?P<axis>[xyz])[ _.]*(?P<unit>.*)$") for kind, names in _KINDS.items()}
_TIME_UNITS = {"": 1.0, "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_RATE_UNITS = {"rads": 1.0, "radpers": 1.0, "rad": 1.0, "degs": math.pi / 180, "dps": math.pi / 180, "deg": math.pi / 180, "°s": math.pi / 180}
_FORCE_UNITS = {"ms2": 1.0, "mss": 1.0, "ms-2": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY}
_PLACES = {
    "position": (("x", "y", "z"), ("x_m", "y_m", "z_m"), ("east", "north", "up"), ("east_m", "north_m", "up_m"), ("e", "n", "u")),
    "sigma": (("sx_m", "sy_m", "sz_m"), ("sx", "sy", "sz"), ("std_x", "std_y", "std_z"), ("std_e", "std_n", "std_u")),
}
_LATITUDE, _LONGITUDE = ("lat", "latitude", "lat_deg", "latitude_deg"), ("lon", "lng", "longitude", "lon_deg", "longitude_deg")
_HEIGHT = ("h", "alt", "altitude", "height", "h_m", "alt_m", "altitude_m", "height_m", "elevation")


@dataclass(frozen=True)
class Read(Generic[T]):
    """A log and what had to be said about it."""

    value: T
    notes: tuple[str, ...]


def kind_of_log(path: Path) -> str:
    """INERTIAL, POSITIONS, RANGES or POSES (eight numbers a line, without names), by content. Raises FormatError for anything else."""
    if holds_nmea(path):
        return POSITIONS
    table = read_table(path)
    if _triple(table.names, "rate") is not None:
        return INERTIAL
    if planar_columns(table.names) is not None:
        return RANGES
    lower = [name.lower() for name in table.names]
    if _place(lower, "position") or (_one(lower, _LATITUDE) and _one(lower, _LONGITUDE)):
        return POSITIONS
    if table.rows.shape[1] == 8 and (not table.names or lower[0].startswith("t")):
        return POSES
    raise FormatError(
        f"{path} is no log that is known: a line of names is needed, e.g. time_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s or "
        f"time_s,x_m,y_m,z_m or time_s,lat,lon,height; its columns are {', '.join(table.names)[:150] or 'not named'}"
    )


def read_inertial(path: Path, angle_unit: str = "auto") -> Read[InertialLog]:
    """Rates, specific force and, where it is there, the magnetic field; of a capture those of the scanner's base.

    angle_unit : "rad" or "deg" of the rates; "auto": as the names say, else rad.

    Rows with a value that is missing or a time that does not rise are left out and counted. Raises InputError for units that cannot be (a mean force
    that is not gravity, rates beyond 2000 degrees per second) and where more than a tenth of the times do not rise; FormatError for missing columns.
    """
    if is_capture(path):
        rows, notes = _usable(path, read_unit_inertial(path))
        log = InertialLog(time_s=rows[:, 0], rate=rows[:, 1:4], force=_in_si(path, rows[:, 4:7], "ms2")[0], is_gap=_gaps(rows[:, 0]))
        return Read(log, tuple(f"{path.name}: {note}" for note in ("the gyroscopes of a scanner's base have offsets that nobody took out", *notes)))
    table = read_table(path)
    rate, force, field = (_triple(table.names, kind) for kind in ("rate", "force", "field"))
    says = f"{path}: columns of rate and specific force are needed (gx, gy, gz, ax, ay, az); its columns: {', '.join(table.names)[:150] or None}"
    if rate is None or force is None:
        raise FormatError(says)
    time = _time(table)
    columns = [time[:, None], _columns(table, rate[0]), _columns(table, force[0])] + ([_columns(table, field[0])] if field is not None else [])
    rows, notes = _usable(path, np.concatenate(columns, axis=1))
    w, more = _in_radians(path, rows[:, 1:4], rate[1] if angle_unit == "auto" else angle_unit)
    f, also = _in_si(path, rows[:, 4:7], force[1])
    is_gap = _gaps(rows[:, 0])
    notes += more + also
    if is_gap.any():
        longest = float(np.diff(rows[:, 0]).max())
        notes += (f"{int(is_gap.sum())} gaps in time, the longest of {longest:.3g} s",)
    log = InertialLog(time_s=rows[:, 0], rate=w, force=f, is_gap=is_gap, magnetic=rows[:, 7:10] if field is not None else None)
    return Read(log, tuple(f"{path.name}: {note}" for note in notes))


def read_positions(path: Path) -> Read[PositionLog]:
    """Positions in metres, or latitude, longitude (degrees) and height made metres east, north and up of the first. NMEA: of a text or a capture.

    Raises FormatError for missing columns, InputError for angles that are none.
    """
    if holds_nmea(path):
        rows, notes = read_nmea(path)
        sigma = None
        if np.isnan(rows[:, 3]).any():
            rows = np.c_[rows[:, :3], np.zeros(len(rows))]
            sigma = np.tile(NO_HEIGHT_M, (len(rows), 1))
            notes = (*notes, f"its sentences (RMC) hold no height: level ground within {NO_HEIGHT_M[2]:.0f} m is assumed")
    else:
        table = read_table(path)
        lower = [name.lower() for name in table.names]
        place, deviation = _place(lower, "position"), _place(lower, "sigma")
        parts = [_time(table)[:, None]]
        if place is not None:
            parts.append(table.rows[:, place])
        else:
            angles = _one(lower, _LATITUDE), _one(lower, _LONGITUDE)
            height = _one(lower, _HEIGHT)
            says = f"{path}: columns x, y, z in metres or lat, lon, height are needed; it has {', '.join(table.names)[:150] or 'no names'}"
            if angles[0] is None or angles[1] is None or height is None:
                raise FormatError(says)
            parts.append(table.rows[:, [lower.index(angles[0]), lower.index(angles[1]), lower.index(height)]])
        if deviation is not None:
            parts.append(table.rows[:, deviation])
        rows, notes = _usable(path, np.concatenate(parts, axis=1))
        sigma = rows[:, 4:7] if deviation is not None else None
        if place is not None:
            positive = sigma is None or bool((sigma > 0).all())
            require(positive, InputError, f"{path}: holds a standard deviation that is not positive: correct it")
            return Read(PositionLog(time_s=rows[:, 0], position=rows[:, 1:4], sigma_m=sigma), tuple(f"{path.name}: {n}" for n in notes))
    latitude, longitude, height_m = np.radians(rows[:, 1]), np.radians(rows[:, 2]), rows[:, 3]
    fits = bool((np.abs(latitude) <= math.pi / 2).all() and (np.abs(longitude) <= 2 * math.pi).all())
    require(fits, InputError, f"{path}: a latitude is beyond 90 or a longitude beyond 360 degrees: are they metres? name the columns x_m, y_m, z_m")
    origin = np.array([latitude[0], longitude[0], height_m[0]])
    log = PositionLog(time_s=rows[:, 0], position=east_north_up(latitude, longitude, height_m, origin), sigma_m=sigma, origin=origin)
    return Read(log, tuple(f"{path.name}: {note}" for note in notes))


def read_ranges(path: Path) -> Read[RangeLog]:
    """Sweeps of a scanner of one beam: time, angle, range; a new one begins where the angle jumps back. Raises FormatError for missing columns."""
    table = read_table(path)
    found = planar_columns(table.names)
    if found is None:
        raise FormatError(f"{path}: columns time, angle and range are needed; it has {', '.join(table.names)[:150] or 'no names'}")
    angle = table.column(found.angle) * (math.pi / 180 if found.in_degrees else 1.0)
    time, distance = _time(table), table.column(found.range)
    sound = np.isfinite(time) & np.isfinite(angle)
    time, angle, distance = time[sound], angle[sound], np.where(distance[sound] > 0, distance[sound], np.nan)
    require(len(time) > 1 and bool((np.diff(time) >= 0).all()), InputError, f"{path}: the times of the rays must rise: sort the lines by time")
    steps = np.diff(angle)
    back = np.flatnonzero(np.abs(steps) > 0.5 * max(float(np.ptp(angle)), 1e-9)) + 1
    first: IntArray = np.concatenate([[0], back, [len(angle)]]).astype(np.int64)
    notes = (f"{int((~sound).sum())} rows without a number were left out",) if not sound.all() else ()
    log = RangeLog(time_s=time, angle=angle, range_m=distance, first=first)
    return Read(log, tuple(f"{path.name}: {note}" for note in (*found.notes, *notes)))


def _time(table: Table) -> FloatArray:
    for name in table.names:
        match = _TIME.match(name.strip().strip("\"'#").strip().lower())
        if match and match["unit"] in _TIME_UNITS:
            return table.column(name) * _TIME_UNITS[match["unit"]]
    raise FormatError(f"{table.path}: no column is named time (s, ms, us or ns): name it time_s; it has {', '.join(table.names)[:150] or 'no names'}")


def _triple(names: tuple[str, ...], kind: str) -> tuple[tuple[str, ...], str] | None:
    """The columns of the three axes and what their names say of the unit, or None."""
    found, unit = {}, ""
    for name in names:
        match = _AXIS[kind].match(name.strip().strip("\"'").lower())
        if match and match["axis"] not in found:
            found[match["axis"]] = name
            unit = re.sub(r"[\s_/^()\[\]*·]", "", match["unit"])
    return ((found["x"], found["y"], found["z"]), unit) if len(found) == 3 else None


def _columns(table: Table, names: tuple[str, ...]) -> FloatArray:
    return np.stack([table.column(name) for name in names], axis=1)


def _place(lower: list[str], what: str) -> list[int] | None:
    return next(([lower.index(name) for name in names] for names in _PLACES[what] if all(name in lower for name in names)), None)


def _one(lower: list[str], names: tuple[str, ...]) -> str | None:
    return next((name for name in names if name in lower), None)


def _usable(path: Path, rows: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Rows whose numbers are finite and whose times rise."""
    sound = np.isfinite(rows).all(axis=1)
    notes: tuple[str, ...] = (f"{int((~sound).sum())} of {len(rows)} rows hold a value that is missing and were left out",) if not sound.all() else ()
    rows = rows[sound]
    require(len(rows) > 1, InputError, f"{path}: fewer than two rows hold all their values")
    rising = np.concatenate([[True], rows[1:, 0] > np.maximum.accumulate(rows[:, 0])[:-1]])
    if not rising.all():
        n = int((~rising).sum())
        row = int(np.argmin(rising))
        says = f"{n} of {len(rows)} times do not rise, the first in row {row + 1} ({rows[row, 0]:.6f} s after {rows[row - 1, 0]:.6f} s)"
        require(n <= _MOST_DISORDER * len(rows), InputError, f"{path}: {says}: sort the rows by time, or check the unit of the clock")
        notes += (f"{says}: they were left out",)
    return rows[rising], notes


def _gaps(time_s: FloatArray) -> BoolArray:
    steps = np.diff(time_s)
    return np.concatenate([[False], steps > max(GAP_STEPS * float(np.median(steps)), GAP_S)])


def _in_radians(path: Path, values: FloatArray, unit: str) -> tuple[FloatArray, tuple[str, ...]]:
    require(unit in _RATE_UNITS or not unit, FormatError, f"{path}: the unit {unit!r} of the rates is not known: name them gx_rad_s or gx_deg_s, ...")
    factor = _RATE_UNITS.get(unit, 1.0)
    fastest = float(np.percentile(np.abs(values), 99.0)) * factor
    ask = "they are in degrees: name the columns gx_deg_s, ... or set fusion.angle_unit=deg" if factor == 1.0 else "check the unit of the columns"
    says = f"{path}: its rates reach {fastest:.0f} rad/s, more than the 2000 degrees per second (35 rad/s) that gyroscopes measure: {ask}"
    require(fastest <= _FASTEST, InputError, says)
    notes = () if unit else ("its rates name no unit and were taken for rad/s",)
    return values * factor, notes


def _in_si(path: Path, values: FloatArray, unit: str) -> tuple[FloatArray, tuple[str, ...]]:
    """Specific force in m/s^2; where its names say nothing, gravity does."""
    require(unit in _FORCE_UNITS or not unit, FormatError, f"{path}: the unit {unit!r} of the force is not known: name it ax_m_s2 or ax_g, ...")
    middle = float(np.median(np.linalg.norm(values, axis=1)))
    fits = [name for name, f in (("m_s2", 1.0), ("g", STANDARD_GRAVITY), ("mg", 1e-3 * STANDARD_GRAVITY)) if _is_gravity(middle * f)]
    if unit:
        hint = f": by its size it is in {fits[0]}, name the columns ax_{fits[0]}, ..." if fits else ": is gravity in it?"
        says = f"{path}: its specific force has a median of {middle * _FORCE_UNITS[unit]:.3g} m/s2, gravity is 9.8{hint}"
        require(_is_gravity(middle * _FORCE_UNITS[unit]), InputError, says)
        return values * _FORCE_UNITS[unit], ()
    require(fits, InputError, f"{path}: its specific force has a median of {middle:.3g}, gravity in no unit (9.8 m/s2, 1 g, 1000 mg)")
    return values * _FORCE_UNITS[fits[0].replace("_", "")], (f"its specific force names no unit; by gravity it is in {fits[0]}",)


def _is_gravity(size: float) -> bool:
    return _GRAVITY_FITS[0] <= size / STANDARD_GRAVITY <= _GRAVITY_FITS[1]
