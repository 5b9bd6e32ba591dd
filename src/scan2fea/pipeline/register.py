"""Registration alone: what `scan2fea register` writes."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scan2fea import __version__
from scan2fea.errors import UsageError, require
from scan2fea.io import write_cloud_ply, write_text, write_trajectory
from scan2fea.pipeline.acquire import acquired_rows
from scan2fea.pipeline.config import Config, to_toml
from scan2fea.pipeline.frames import registration_row, trajectory_of_all
from scan2fea.pipeline.fuse import record_motion
from scan2fea.pipeline.record import Record
from scan2fea.pipeline.results import finite_tree
from scan2fea.pipeline.run import read_all
from scan2fea.pipeline.scene import Scene, place_all

REGISTER_SCHEMA = "scan2fea register 1"
FILES = ("cloud.ply", "trajectory.txt", "report.json", "config.toml")


def register_files(inputs: Sequence[Path], out: Path, config: Config) -> dict[str, Any]:
    """Bring scans into one frame: OUT gets cloud.ply, trajectory.txt (TUM, one row per input, nan where left out), report.json and config.toml.

    Returns the content of report.json. Raises UsageError for an OUT that holds other files, InputError where no input is usable.
    """
    require(not out.exists() or out.is_dir(), UsageError, f"{out}: is a file; give a folder with -o")
    if out.is_dir() and any(path.name not in FILES for path in out.iterdir()):
        raise UsageError(f"{out}: holds other files than those of `register`; give an empty or new folder with -o")
    with tempfile.TemporaryDirectory() as folder:
        record = Record(Path(folder), resume=False)
        raws, rows = read_all(inputs, config.input, record, config.acquisition)
        moved = record_motion(config.fusion, record, raws)
    names = [Path(raw.value.path).name for raw in raws]
    motion = moved[0].value.trajectory if moved else None
    scene = place_all(tuple(raw.value for raw in raws), config.registration, names=names, motion=motion)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out}: cannot be written ({error.strerror}); give another folder with -o") from error
    report = register_report(rows, scene, config)
    told = acquired_rows([raw.value for raw in raws])
    report |= {"acquisition": finite_tree(told)} if told else {}
    write_cloud_ply(out / "cloud.ply", scene.scan.cloud, {"frame": scene.scan.cloud.frame.astype("int32")})
    write_trajectory(out / "trajectory.txt", trajectory_of_all(rows, scene))
    write_text(out / "config.toml", to_toml(config))
    write_text(out / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    return report


def register_report(rows: Sequence[Mapping[str, Any]], scene: Scene, config: Config) -> dict[str, Any]:
    """report.json of a registration."""
    head = {"schema": REGISTER_SCHEMA, "version": __version__, "seed": config.run.seed, "frame": {"shift_m": scene.shift_m.tolist()}}
    found = registration_row(rows, scene, config.registration.mode)
    return dict(finite_tree({**head, "inputs": list(rows), "registration": found, "spacing_m": scene.spacing_m, "warnings": list(scene.notes)}))
