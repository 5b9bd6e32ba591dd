"""Inputs that hold no points (pictures, depth images, logs) become scans as files of points do: one `RawScan` and one row of the report per frame."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scan2fea.acquisition import Acquired, AcquisitionOptions, from_photographs, from_rgbd, from_stereo, from_ultrasonic, is_image, is_rgbd
from scan2fea.acquisition.acquired import Frame
from scan2fea.io import InputOptions, RawScan
from scan2fea.io.files import sha256_of
from scan2fea.units import metres_per

NO_SCALE = "unknown"  # RawScan.unit_source of lengths that are not metres: nothing with a size may be made of them
WITHOUT_SCALE = (
    "the photographs do not tell a size, and a model of a wrong size is worse than none: "
    'give --scale "0.25 m between targets A B" (or cameras), or --known-length "0.8 m 03.jpg 120,340 810,355"'
)


@dataclass(frozen=True, kw_only=True)
class Group:
    """Inputs that are read together. kind : "scan" (one file of points), "stereo", "rgbd", "photographs", "ultrasonic"."""

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
    """The inputs in their order, pictures together."""
    pictures = tuple(path for path in inputs if path.is_file() and is_image(path))
    groups: list[Group] = []
    for path in inputs:
        if path in pictures:
            if path == pictures[0]:
                groups.append(_of_pictures(pictures, options))
        elif path.is_dir() and is_rgbd(path):
            groups.append(Group(kind="rgbd", paths=(path,)))
        elif path.is_dir() and photographs_in(path):
            groups.append(Group(kind="photographs", paths=tuple(photographs_in(path))))
        elif options.sensor == "ultrasonic":
            groups.append(Group(kind="ultrasonic", paths=(path,)))
        else:
            groups.append(Group(kind="scan", paths=(path,)))
    return groups


def _of_pictures(paths: tuple[Path, ...], options: AcquisitionOptions) -> Group:
    return Group(kind="stereo" if options.calibration else "photographs", paths=paths)


def photographs_in(folder: Path) -> list[Path]:
    """The pictures of a folder, or of `images` in it, in the order of their names."""
    for place in (folder, folder / "images"):
        found = sorted(path for path in place.iterdir() if path.is_file() and is_image(path)) if place.is_dir() else []
        if found:
            return found
    return []


def acquire(group: Group, options: AcquisitionOptions, unit: str = "") -> Acquired:
    """Run the acquisition of a group. Raises InputError where nothing of it can be used, UsageError where an option lacks."""
    if group.kind == "rgbd":
        return from_rgbd(group.paths[0], options)
    if group.kind == "ultrasonic":
        return from_ultrasonic(group.paths[0], options)
    if group.kind == "photographs":
        return from_photographs(group.paths, options)
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


def without_scale(raws: list[Any], rows: list[dict[str, Any]]) -> None:
    """Leave out inputs without a scale where others have one: nothing says how large they are beside them."""
    lacks = {raw.value.path for raw in raws if raw.value.unit_source == NO_SCALE}
    if not lacks or len(lacks) == len(raws):
        return
    raws[:] = [raw for raw in raws if raw.value.path not in lacks]
    for k, row in enumerate(rows):
        if row["path"] in lacks and row["used"]:
            rows[k] = {**row, "n_points": 0, "used": False, "unit": None, "unit_source": None, "sensor": None}
            rows[k]["reason"] = f"{Path(row['path']).name}: its size beside the other inputs is not known: give --scale"
