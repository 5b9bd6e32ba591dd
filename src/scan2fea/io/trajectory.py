"""Poses as text in the form of the TUM benchmark: time tx ty tz qx qy qz qw, one row per frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scan2fea.errors import InternalError
from scan2fea.io.files import write_bytes
from scan2fea.kernel.transforms import matrix_to_quaternion
from scan2fea.types import Trajectory


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """One row per frame in their order; a frame that was left out is nan. Without times the rows are numbered from 0."""
    rows = []
    for k, T in enumerate(trajectory.T_world_frame):
        time = float(trajectory.time_s[k]) if trajectory.time_s is not None else float(k)
        pose = [*T[:3, 3], *matrix_to_quaternion(T[:3, :3])] if trajectory.placed[k] else [np.nan] * 7
        rows.append(" ".join(repr(float(value)) for value in (time, *pose)))
    write_bytes(path, ("\n".join(rows) + "\n").encode())


def write_covariance(path: Path, trajectory: Trajectory) -> None:
    """CSV: time, then the upper half of the (6, 6) covariance row by row, x y z in metres, a b c the turn about x y z in radians, along the
    world's axes.

    Raises InternalError for a trajectory without.
    """
    if trajectory.covariance is None:
        raise InternalError("a trajectory without covariance has none to write")
    upper = [(i, j) for i in range(6) for j in range(i, 6)]
    time = trajectory.time_s if trajectory.time_s is not None else np.arange(len(trajectory.covariance), dtype=float)
    rows = np.column_stack([time, *(trajectory.covariance[:, i, j] for i, j in upper)]).tolist()
    head = ",".join(["time_s", *("xyzabc"[i] + "xyzabc"[j] for i, j in upper)])
    write_bytes(path, "\n".join([head, *(",".join(map(repr, row)) for row in rows), ""]).encode())
