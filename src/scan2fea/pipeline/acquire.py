"""Inputs that hold no points (pictures, depth images, logs) become scans as files of points do: one `RawScan` and one row of the report per frame."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scan2fea.acquisition import Acquired, AcquisitionOptions, from_rgbd, from_stereo, is_image, is_rgbd
from scan2fea.acquisition.acquired import Frame
from scan2fea.errors import InputError, require
from scan2fea.io import InputOptions, RawScan
from scan2fea.io.files import sha256_of
from scan2fea.units import metres_per

NO_SCALE = "unknown"  # RawScan.unit_source of lengths that are not metres: nothing with a size may be made of them


@dataclass(frozen=True, kw_only=True)
class Group:
    """Inputs that are read together. kind : "scan" (one file of points), "stereo", "rgbd"."""

    kind: str
    paths: tuple[Path, ...]

    def files(self) -> list[Path]:
        """Every file that the result depends on."""
        if self.kind == "rgbd":
            return sorted(path for path in self.paths[0].rglob("*") if path.is_file())
        return list(self.paths)

    def sha256(self, options: AcquisitionOptions) -> str:
        """Of all files and of the calibration."""
        digest = hashlib.sha256()
        told = Path(options.calibration) if options.calibration else None
        beside = [] if told is None else sorted(told.rglob("*")) if told.is_dir() else [told]
        for path in [*self.files(), *beside]:
            if path.is_file():
                digest.update(path.name.encode() + bytes.fromhex(sha256_of(path)))
        return digest.hexdigest()


def grouped(inputs: Sequence[Path], options: AcquisitionOptions) -> list[Group]:
    """The inputs in their order, pictures together. Raises InputError for pictures of which nothing can be made."""
    pictures = tuple(path for path in inputs if path.is_file() and is_image(path))
    groups: list[Group] = []
    for path in inputs:
        if path in pictures:
            if path == pictures[0]:
                groups.append(_of_pictures(pictures, options))
        elif path.is_dir() and is_rgbd(path):
            groups.append(Group(kind="rgbd", paths=(path,)))
        else:
            groups.append(Group(kind="scan", paths=(path,)))
    return groups


def _of_pictures(paths: tuple[Path, ...], options: AcquisitionOptions) -> Group:
    says = f"{paths[0].name}: one picture alone has no depth: give two of a calibrated rig with --calibration FILE"
    require(len(paths) > 1, InputError, says)
    return Group(kind="stereo", paths=paths)


def acquire(group: Group, options: AcquisitionOptions, unit: str = "") -> Acquired:
    """Run the acquisition of a group. Raises InputError where nothing of it can be used, UsageError where an option lacks."""
    if group.kind == "rgbd":
        return from_rgbd(group.paths[0], options)
    return from_stereo(group.paths, options, metres_per(unit) if unit else None)


def raw_of(frame: Frame, acquired: Acquired, *, is_first: bool, options: InputOptions) -> RawScan:
    """One frame as if a file had held it. The first frame carries the figures and notes of all."""
    cloud = frame.scan.cloud
    metric = acquired.unit_source != NO_SCALE
    return RawScan(
        scan=frame.scan,
        mesh=None,
        path=frame.name,
        sha256=sha256_of(Path(frame.name)),
        format=str(acquired.how.get("method", "")),
        n_points=len(cloud),
        n_dropped=0,
        n_misses=0,
        unit=(options.unit or "m") if metric else "none",
        unit_source=acquired.unit_source,
        sensor="known",
        pose_given=False,
        T_world_frame=frame.T_world_frame,
        voxel_edge_m=None,
        columns=(),
        notes=acquired.notes if is_first else (),
        acquired=dict(acquired.how) if is_first else None,
    )


def acquired_rows(raws: Sequence[Any]) -> list[dict[str, Any]]:
    """acquisition of report.json: what was made of pictures and logs, one row per group."""
    return [dict(raw.acquired) for raw in raws if raw.acquired is not None]
