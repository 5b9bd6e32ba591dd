"""What registration found, as rows of report.json."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.pipeline.scene import Scene
from scan2fea.pipeline.sweeps import SweepPath
from scan2fea.registration import Link
from scan2fea.types import Trajectory


def registration_row(inputs: Sequence[Mapping[str, Any]], scene: Scene, mode: str) -> dict[str, Any]:
    """registration of report.json: one frame per input, and every link between two that was tried."""
    used = [Path(row["path"]).name for row in inputs if row["used"]]
    found: dict[str, Any] = {"mode": mode, "frames": frame_rows(inputs, scene), "links": [link_row(link, used) for link in scene.links]}
    return found | ({"sweeps": [sweep_row(path, used) for path in scene.paths]} if scene.paths else {})


def sweep_row(path: SweepPath, names: Sequence[str]) -> dict[str, Any]:
    """How the scanner of one input moved: the poses that were given, or one per sweep in the middle of its returns."""
    return {
        "path": names[path.frame],
        "time_s": path.time_s.tolist(),
        "T_world_scanner": path.T_frame_scanner.tolist(),
        "std_m": [_number(x) for x in path.std_m],
        "std_rad": [_number(x) for x in path.std_rad],
    }


def trajectory_of_all(inputs: Sequence[Mapping[str, Any]], scene: Scene) -> Trajectory:
    """One pose per input, in their order: nan for those that could not be read too; of a single capture of a moving scanner one per sweep."""
    if len(inputs) == 1 and len(scene.paths) == 1:
        path = scene.paths[0]
        return Trajectory(T_world_frame=path.T_frame_scanner, placed=np.ones(len(path.time_s), bool), time_s=path.time_s)
    used = np.array([bool(row["used"]) for row in inputs], bool)
    T, placed = np.full((len(used), 4, 4), np.nan), np.zeros(len(used), bool)
    T[used], placed[used] = scene.trajectory.T_world_frame, scene.trajectory.placed
    time = scene.trajectory.time_s
    if time is not None:
        time = np.full(len(used), np.nan)
        time[used] = scene.trajectory.time_s
    return Trajectory(T_world_frame=T, placed=placed, time_s=time)


def frame_rows(inputs: Sequence[Mapping[str, Any]], scene: Scene) -> list[dict[str, Any]]:
    """registration.frames[], one per input; one that could not be read is not placed."""
    rows, k = [], 0
    for row in inputs:
        used = bool(row["used"])
        placed = used and bool(scene.trajectory.placed[k])
        reason = None if placed else row["reason"] or scene.reasons[k]
        rows.append(
            {
                "path": row["path"],
                "placed": placed,
                "T_world_frame": scene.trajectory.T_world_frame[k].tolist() if placed else None,
                "std_m": _number(scene.std_m[k]) if placed else None,
                "std_rad": _number(scene.std_rad[k]) if placed else None,
                "agreement_m": _number(scene.agreement_m[k]) if placed else None,
                "reason": reason,
            }
        )
        k += used
    return rows


def link_row(link: Link, names: Sequence[str]) -> dict[str, Any]:
    """One link. `used` False: `reason` says why; `open` is the number of motions that the shared surface leaves free."""
    quality = link.quality
    return {
        "target": names[link.target],
        "source": names[link.source],
        "how": link.how,
        "used": link.used,
        "reason": link.reason or None,
        "T_target_source": link.T_target_source.tolist(),
        "overlap": float(quality.overlap),
        "consistency": float(quality.consistency),
        "residual_m": _number(quality.residual_m),
        "std_m": _number(quality.std_m),
        "std_rad": _number(quality.std_rad),
        "open": len(quality.open_directions),
        "n_pairs": quality.n_pairs,
    }


def _number(x: Any) -> float | None:
    return float(x) if math.isfinite(float(x)) else None
