"""Logs of motion sensors to one trajectory: what `scan2fea fuse` writes, and the motion that `run --imu` places a capture by."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea import __version__
from scan2fea.errors import InputError, UsageError, require
from scan2fea.fusion import FusionOptions, complementary, kalman, particle, require_unit
from scan2fea.io import RawScan, read_scan, write_text, write_trajectory
from scan2fea.io.files import existing_file, sha256_of, write_bytes
from scan2fea.io.motion_log import INERTIAL, POSES, POSITIONS, RANGES, kind_of_log, read_inertial, read_positions, read_ranges
from scan2fea.io.trajectory import write_covariance
from scan2fea.io.unit_inertial import OFFSET_RAD_S, is_capture
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.pipeline.config import Config, to_toml
from scan2fea.pipeline.longest import longest_piece
from scan2fea.pipeline.record import Record, Say, Tracked, key_of
from scan2fea.pipeline.results import finite_tree
from scan2fea.registration import read_trajectory
from scan2fea.types import FloatArray, InertialLog, PositionLog, RangeLog, Trajectory, Value
from scan2fea.units import radians

FUSE_SCHEMA = "scan2fea fuse 1"
FILES = ("trajectory.txt", "covariance.csv", "trajectory.png", "report.json", "config.toml")
Picture = Callable[[Trajectory, Mapping[str, Any]], bytes]


@dataclass(frozen=True, eq=False, kw_only=True)
class Logs(Value):
    """What was read: at most one log of each kind. rows : of report.json, one per file.   notes : for the user."""

    inertial: InertialLog | None = None
    positions: PositionLog | None = None
    odometry: Trajectory | None = None
    poses: Trajectory | None = None
    ranges: RangeLog | None = None
    rows: tuple[Mapping[str, Any], ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Fused(Value):
    """figures : what the method says of itself, for report.json.   notes : what the user must know."""

    trajectory: Trajectory
    figures: Mapping[str, Any]
    notes: tuple[str, ...]


def fuse_files(inputs: Sequence[Path], out: Path, config: Config, picture: Picture, say: Say = lambda _: None) -> dict[str, Any]:
    """OUT gets trajectory.txt (TUM), covariance.csv (where the method states one), trajectory.png, report.json and config.toml.

    Returns the content of report.json. Raises UsageError for an OUT that holds other files, InputError where a log cannot be used, FusionError where
    logs contradict each other.
    """
    require(not out.exists() or out.is_dir(), UsageError, f"{out}: is a file; give a folder with -o")
    if out.is_dir() and any(path.name not in FILES for path in out.iterdir()):
        raise UsageError(f"{out}: holds other files than those of `fuse`; give an empty or new folder with -o")
    options = config.fusion
    logs = _step("read logs", lambda: read_logs(inputs, options), len(inputs), lambda read: sum(row["n_rows"] for row in read.rows), say)
    fused = _step(options.method, lambda: fused_of(logs, options), len(logs.inertial or ()), lambda f: len(f.trajectory.T_world_frame), say)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out}: cannot be written ({error.strerror}); give another folder with -o") from error
    report = dict(finite_tree(_report(logs, fused, config)))
    write_trajectory(out / "trajectory.txt", fused.trajectory)
    (out / "covariance.csv").unlink(missing_ok=True)
    if fused.trajectory.covariance is not None:
        write_covariance(out / "covariance.csv", fused.trajectory)
    write_bytes(out / "trajectory.png", picture(fused.trajectory, report))
    write_text(out / "config.toml", to_toml(config))
    write_text(out / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    return report


def _step(name: str, verb: Callable[[], Any], n_in: int, count: Callable[[Any], int], say: Say) -> Any:
    say({"event": "begin", "object": None, "name": name})
    started = time.perf_counter()
    made = verb()
    say({"event": "end", "object": None, "name": name, "n_in": n_in, "n_out": count(made), "seconds": time.perf_counter() - started})
    return made


def read_logs(inputs: Sequence[Path], options: FusionOptions) -> Logs:
    """Each file by its content, then those that options name. Raises UsageError for two logs of one kind, InputError where one cannot be used."""
    found: dict[str, Any] = {}
    rows: list[dict[str, Any]] = []
    notes: list[str] = []
    named = ((options.imu, INERTIAL), (options.gps, POSITIONS), (options.odometry, "odometry"), (options.poses, POSES))
    for path, kind in [(path, "") for path in inputs] + [(Path(text), kind) for text, kind in named if text]:
        existing_file(path)
        kind = kind or {POSES: "odometry"}.get(told := kind_of_log(path), told)
        if kind in found:
            raise UsageError(f"{path}: is a second log of {kind}: give one of each")
        value, more = _read(path, kind, options)
        found[kind], n = value, len(value.T_world_frame) if isinstance(value, Trajectory) else len(value)
        rows.append({"path": str(path), "sha256": sha256_of(path), "kind": kind, "n_rows": n, "from_s": value.time_s[0], "to_s": value.time_s[-1]})
        notes += more
    if INERTIAL in found and options.angle_unit == "auto":
        require_unit(found[INERTIAL])
    return Logs(
        inertial=found.get(INERTIAL),
        positions=found.get(POSITIONS),
        odometry=found.get("odometry"),
        poses=found.get(POSES),
        ranges=found.get(RANGES),
        rows=tuple(rows),
        notes=tuple(notes),
    )


def _read(path: Path, kind: str, options: FusionOptions) -> tuple[Any, tuple[str, ...]]:
    if kind == INERTIAL:
        inertial = read_inertial(path, options.angle_unit)
        says = (
            f"{path}: the gyroscopes of a scanner's base are not calibrated (29 degrees/s were seen at rest), and fusion.gyro_bias = "
            f"{options.gyro_bias:g} rad/s would take that for a turn: set it to {OFFSET_RAD_S:g}, and give a log that tells the offset (--gps)"
        )
        require(options.gyro_bias >= OFFSET_RAD_S or not is_capture(path), InputError, says)
        return inertial.value, inertial.notes
    if kind == POSITIONS:
        positions = read_positions(path)
        return positions.value, positions.notes
    if kind == RANGES:
        ranges = read_ranges(path)
        return ranges.value, ranges.notes
    poses = read_trajectory(path)
    if poses is None:
        raise InputError(f"{path}: is no log of poses: lines of time tx ty tz qx qy qz qw whose times rise are needed")
    return poses, ()


def fused_of(logs: Logs, options: FusionOptions) -> Fused:
    """The trajectory by the method of the options. Raises InputError where a log that it needs is missing, FusionError where logs contradict."""
    if options.method == "particle":
        return _by_particle(logs, options)
    if logs.inertial is None:
        raise InputError(f"method {options.method} needs an inertial log (time, angular rate, specific force): give one")
    if options.method == "complementary":
        return _by_complementary(logs.inertial, options)
    return _by_kalman(logs, logs.inertial, options)


def _by_complementary(log: InertialLog, options: FusionOptions) -> Fused:
    found = complementary(log, options)
    notes: tuple[str, ...] = ("attitude alone: the positions of trajectory.txt are zero, and no covariance is stated",)
    if log.magnetic is None:
        notes += ("the log has no magnetic field: the heading counts from the start and drifts with the bias about the vertical",)
    figures = {
        "position": "not estimated",
        "heading": found.heading,
        "rest_share": float(found.is_rest.mean()),
        "gyro_bias_rad_s": found.bias[-1].tolist(),
        "n_magnetic_disturbed": found.n_disturbed,
    }
    return Fused(trajectory=found.trajectory, figures=figures, notes=notes)


def _by_kalman(logs: Logs, log: InertialLog, options: FusionOptions) -> Fused:
    log, notes = longest_piece(log)
    found = kalman(log, logs.positions, logs.odometry, logs.poses, options)
    if logs.positions is not None and logs.positions.sigma_m is None and options.gps_m is None:
        notes += ("the log of positions states no standard deviation: 3 m east and north and 6 m upwards were assumed; say it with fusion.gps_m",)
    if not found.is_heading_told:
        notes += ("the heading is not told: starts with another heading explain the logs as well (no acceleration that the positions confirm)",)
    for name, taken in found.taken.items():
        if taken.n_gated:
            notes += (f"{taken.n_gated} of {taken.n} {name} were left out: chance does not explain where they are (fusion.gate)",)
        if taken.nis > 2.0:
            notes += (f"{name} scatter {taken.nis**0.5:.1f} times as much as their standard deviations say: the trajectory is less sure than stated",)
    figures = {
        "position": "estimated",
        "heading": "estimated" if found.is_heading_told else "not told",
        "origin": None if logs.positions is None or logs.positions.origin is None else _geodetic(logs.positions.origin),
        "measurements": {name: {"n": t.n, "n_gated": t.n_gated, "nis": t.nis} for name, t in found.taken.items()},
        "gated_s": found.gated.tolist(),
        "gyro_bias_rad_s": found.gyro_bias[-1].tolist(),
        "force_bias_m_s2": found.force_bias[-1].tolist(),
        "odometry_scale": None if found.scale is None else {"value": found.scale[0], "std": found.scale[1]},
        "gyro_noise": float(np.sqrt(found.density[0])),
        "acceleration_noise": float(np.sqrt(found.density[1])),
    }
    return Fused(trajectory=found.trajectory, figures=figures, notes=notes)


def _by_particle(logs: Logs, options: FusionOptions) -> Fused:
    if logs.ranges is None or not options.map:
        raise InputError("method particle needs a log of ranges in a plane (time, angle, range) and the scan of the place: --map SCAN")
    points = read_scan(Path(options.map)).scan.cloud.points
    low = -np.inf if options.map_low_m is None else options.map_low_m
    high = np.inf if options.map_high_m is None else options.map_high_m
    found = particle(logs.ranges, points[(points[:, 2] >= low) & (points[:, 2] <= high), :2], logs.odometry, options)
    placed = found.trajectory.placed
    unsure = f"{int((~placed).sum())} of {len(placed)} sweeps have no place that is sure: their rows are nan"
    notes: tuple[str, ...] = () if placed.all() else (unsure,)
    if logs.odometry is None:
        notes += ("no odometry: any motion of up to about 1 m/s and 1 rad/s was thought possible",)
    figures = {
        "position": "estimated" if placed.any() else "not estimated",
        "heading": "estimated" if placed.any() else "not told",
        "found_after_s": found.found_s,
        "n_particles": {"first": found.n_particles[0], "median": float(np.median(found.n_particles))},
        "effective_share": float(np.median(found.effective / found.n_particles)),
        "n_resampled": found.n_resampled,
        "n_redrawn": found.n_redrawn,
    }
    return Fused(trajectory=found.trajectory, figures=figures, notes=notes)


def _geodetic(origin: FloatArray) -> dict[str, float]:
    return {"latitude_deg": float(np.degrees(origin[0])), "longitude_deg": float(np.degrees(origin[1])), "height_m": float(origin[2])}


def _report(logs: Logs, fused: Fused, config: Config) -> dict[str, Any]:
    way = fused.trajectory
    steps = np.linalg.norm(np.diff(way.T_world_frame[way.placed, :3, 3], axis=0), axis=1)
    time_s = way.time_s if way.time_s is not None else np.zeros(1)
    n_placed = int(way.placed.sum())
    path: dict[str, Any] = {"n_poses": len(time_s), "n_placed": n_placed, "from_s": time_s[0], "to_s": time_s[-1], "length_m": float(steps.sum())}
    if way.covariance is not None and way.placed.any():
        std = np.sqrt(np.maximum(np.diagonal(way.covariance[way.placed], axis1=1, axis2=2), 0.0))
        path["std_m"] = dict(zip(("x", "y", "z"), np.median(std[:, :3], axis=0), strict=True))
        path["std_rad"] = dict(zip(("about_x", "about_y", "about_z"), np.median(std[:, 3:], axis=0), strict=True))
    return {
        "schema": FUSE_SCHEMA,
        "version": __version__,
        "seed": config.run.seed,
        "method": config.fusion.method,
        "inputs": list(logs.rows),
        "trajectory": path,
        "fusion": dict(fused.figures),
        "warnings": [*logs.notes, *fused.notes],
    }


def record_motion(options: FusionOptions, record: Record, raws: Sequence[Tracked[RawScan]]) -> list[Tracked[Fused]]:
    """The motion of the scanner that `fusion.imu` and the logs beside it tell, as a stage of a run; none without it.

    Raises UsageError where logs are given that cannot tell it, or options of a fusion that does not happen.
    """
    if not options.imu:
        require(not options.gps, UsageError, "--gps alone tells no motion within a turn: give --imu too")
        require_no_fusion(options, "nothing is fused without --imu: give it (with --gps), or leave the option out")
        return []
    others = [text for text in (options.gps, options.odometry, options.poses) if text]
    require(others and options.method == "kalman", UsageError, "--imu tells places with --gps (or fusion.odometry, fusion.poses), by method kalman")
    for text in (options.imu, *others):
        existing_file(Path(text))
    source = Tracked(None, key_of("logs", [sha256_of(Path(text)) for text in (options.imu, *others)]))
    motion = record("fuse", _scanner_motion, source, options=options, n_in=len(others) + 1, count=lambda f: len(f.trajectory.T_world_frame))
    for text in motion.value.notes:
        record.event("note", text=text)
    return [motion]


def require_no_fusion(options: FusionOptions, why: str) -> None:
    """Raises UsageError that names the first option of a fusion that was set where none happens."""
    usual = FusionOptions()
    for each in fields(options):
        value = getattr(options, each.name)
        if each.name != "seed" and value != getattr(usual, each.name):
            raise UsageError(f"fusion.{each.name} = {value!r} has no effect: {why}")


def _scanner_motion(_: None, options: FusionOptions) -> Fused:
    logs = read_logs((), options)
    fused = fused_of(logs, options)
    T_imu_scanner = mounting(options)
    T = fused.trajectory.T_world_frame @ T_imu_scanner
    return replace(fused, trajectory=replace(fused.trajectory, T_world_frame=T), notes=(*logs.notes, *fused.notes))


def mounting(options: FusionOptions) -> FloatArray:
    """T_imu_scanner (4, 4)."""
    roll, pitch, yaw = (radians(angle) for angle in options.scanner_deg)
    R = rotation_about((0, 0, 1), yaw) @ rotation_about((0, 1, 0), pitch) @ rotation_about((1, 0, 0), roll)
    return rigid(R, options.scanner_m)
