"""`scan2fea simulate SCENE`: scans of exact solids, and everything that is true of them."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from scan2fea.errors import InputError, UsageError
from scan2fea.pipeline.simulate import scene_named, simulate_scene, with_noise, with_sensor
from scan2fea.report.scene_picture import scene_picture
from scan2fea.simulation.scene_values import length_of
from scan2fea.simulation.solids import Scene
from scan2fea.types import Scan


def execute(given: argparse.Namespace) -> int:
    scene = scene_named(given.scene, given.seed)
    if given.sensor:
        scene = with_sensor(scene, given.sensor)
    if given.noise is not None:
        scene = with_noise(scene, *noise_of(given.noise))
    out = simulate_scene(scene, Path(given.out), seed=given.seed, formats=given.format or ("ply",), picture=_picture, step=not given.no_step)
    truth = out.truth
    print(f"{truth['n_points']} points on {len(truth['objects'])} objects in {len(out.files)} files; truth.json, truth/, scene.png in {out.out}")
    return 0


def noise_of(text: str) -> tuple[float, str | None]:
    """Metres and law of "2 mm", "0.002" or "uniform:20 mm". Raises UsageError."""
    law, _, size = text.rpartition(":")
    try:
        metres = float(size)
    except ValueError:
        try:
            metres = length_of(size, "--noise")
        except InputError as error:
            raise UsageError(str(error)) from error
    if not math.isfinite(metres):
        raise UsageError(f"--noise is {size}: it must be a finite length")
    return metres, law or None


def _picture(scene: Scene, scans: Sequence[Scan]) -> bytes:
    return scene_picture([solid.mesh for solid in scene.solids], scans)
