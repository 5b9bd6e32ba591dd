"""From arguments to a Config: the file, then --set, then the short forms."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from scan2fea.errors import UsageError, require
from scan2fea.pipeline.config import Config, load_config

SHORT_FORMS = {
    "unit": "input.unit",
    "poses": "registration.poses",
    "calibration": "registration.calibration",
    "labels": "input.labels",
    "sensor_position": "input.sensor_position",
    "sensor": "acquisition.sensor",
    "scale": "acquisition.scale",
    "known_length": "acquisition.known_length",
    "seed": "run.seed",
    "family": "estimation.family",
    "member": "route.member",
    "catalogue": "route.catalogue",
    "imu": "fusion.imu",
    "gps": "fusion.gps",
    "map": "fusion.map",
    "known_poses": "fusion.poses",
}
PICTURES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm")
METHOD_STAGES = {"reconstruct": "reconstruction.method", "segment": "segmentation.method", "fuse": "fusion.method"}  # what --method picks


def config_of(given: argparse.Namespace, **defaults: Any) -> Config:
    """The configuration that the arguments ask for. Raises UsageError."""
    settings: dict[str, Any] = dict(defaults)
    for text in given.settings:
        key, equals, value = text.partition("=")
        require(equals and key.strip(), UsageError, f"--set {text!r}: write KEY=VALUE, e.g. --set select.min_points=500")
        settings[key.strip()] = value.strip()
    forms = {**SHORT_FORMS, "calibration": "acquisition.calibration"} if _has_pictures(given) else SHORT_FORMS
    for name, key in forms.items():
        value = getattr(given, name, None)
        if value is not None:
            settings[key] = tuple(value) if isinstance(value, list) else value
    if getattr(given, "method", None) is not None:
        settings[METHOD_STAGES[given.command]] = given.method
    if getattr(given, "labels", None) is not None and given.command not in ("segment", "train"):  # there the labels are what is compared with
        settings["segmentation.method"] = "given"
    return load_config(Path(given.config) if given.config else None, settings)


def _has_pictures(given: argparse.Namespace) -> bool:
    """Whether the inputs are pictures or folders of them: --calibration is then of their cameras, else that of KITTI's poses."""
    return any(Path(path).is_dir() or Path(path).suffix.lower() in PICTURES for path in getattr(given, "inputs", ()))
