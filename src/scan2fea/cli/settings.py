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
    "seed": "run.seed",
    "family": "estimation.family",
    "member": "route.member",
    "catalogue": "route.catalogue",
}
METHOD_STAGES = {"reconstruct": "reconstruction.method", "segment": "segmentation.method"}  # what --method picks


def config_of(given: argparse.Namespace, **defaults: Any) -> Config:
    """The configuration that the arguments ask for. Raises UsageError."""
    settings: dict[str, Any] = dict(defaults)
    for text in given.settings:
        key, equals, value = text.partition("=")
        require(equals and key.strip(), UsageError, f"--set {text!r}: write KEY=VALUE, e.g. --set select.min_points=500")
        settings[key.strip()] = value.strip()
    for name, key in SHORT_FORMS.items():
        value = getattr(given, name, None)
        if value is not None:
            settings[key] = tuple(value) if isinstance(value, list) else value
    if getattr(given, "method", None) is not None:
        settings[METHOD_STAGES[given.command]] = given.method
    if getattr(given, "labels", None) is not None and given.command != "segment":  # there the labels are what is compared with
        settings["segmentation.method"] = "given"
    return load_config(Path(given.config) if given.config else None, settings)
