"""Poses as text in the form of the TUM benchmark: time tx ty tz qx qy qz qw, one row per frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

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
