"""What a carrier records beside its scans, in files: where it truly was, what its instruments say, and the capture of a Velodyne unit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.io import write_text, write_trajectory
from scan2fea.io.velodyne import write_velodyne
from scan2fea.simulation.lidar import Hdl32eOptions, Vlp16Options, firings_of
from scan2fea.simulation.motion import path_of, trajectory_at
from scan2fea.simulation.sensor_logs import LogOptions, gps_csv, imu_csv, sensor_logs
from scan2fea.simulation.sensors import SENSORS
from scan2fea.types import Scan


def write_logs(
    folder: Path, stem: str, kind: str, options: Any, scans: Sequence[Scan], seed: int, log: LogOptions = LogOptions()
) -> tuple[Path, ...]:
    """Write the logs of one sensor and return their files; none for a sensor that stands.

    `stem`_truth.txt, `stem`_odometry.txt and `stem`_frames.txt (the true pose at the first shot of each scan) are in TUM form,
    `stem`_imu.csv and `stem`_gps.csv in SI; an HDL-32E has its capture `stem`.pcap.
    """
    if not SENSORS[kind].moves:
        return ()
    files: list[Path] = []
    path = path_of(options, kind)
    if path.duration_s > 0:
        logs = sensor_logs(path, log, seed)
        tables = {"imu": imu_csv(logs.imu), "gps": gps_csv(logs.gps)}
        for name, text in tables.items():
            files.append(folder / f"{stem}_{name}.csv")
            write_text(files[-1], text)
        begun = [float(s.rays.time_s[0]) for s in scans if s.rays is not None and s.rays.time_s is not None]
        for name, trajectory in (("truth", logs.truth), ("odometry", logs.odometry), ("frames", trajectory_at(path, begun))):
            files.append(folder / f"{stem}_{name}.txt")
            write_trajectory(files[-1], trajectory)
    if isinstance(options, Hdl32eOptions) and not isinstance(options, Vlp16Options) and len(options.elevations_deg) == 32:
        told = [firings_of(scan, options) for scan in scans]
        columns = [np.concatenate([getattr(t, name) for t in told]) for name in ("time_s", "azimuth_deg", "range_m", "intensity")]
        files.append(folder / f"{stem}.pcap")
        write_velodyne(files[-1], *columns)
    return tuple(files)
