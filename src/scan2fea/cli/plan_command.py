"""`scan2fea plan SCENE.toml`: what the planned stations will see, how densely, and which dimensions that will tell."""

from __future__ import annotations

import argparse
import json

from scan2fea.cli.simulate_command import noise_of
from scan2fea.pipeline.plan import PlannedObject, plan_scene
from scan2fea.pipeline.simulate import scene_named, with_noise, with_sensor


def execute(given: argparse.Namespace) -> int:
    scene = scene_named(given.scene, given.seed)
    if given.sensor:
        scene = with_sensor(scene, given.sensor)
    if given.noise is not None:
        scene = with_noise(scene, *noise_of(given.noise))
    plan = plan_scene(scene, seed=given.seed)
    if given.json:
        print(json.dumps(plan.as_tree(), indent=1, allow_nan=False))
        return 0
    for thing in plan.objects:
        print("\n".join(_lines(thing)))
    return 0


def _lines(thing: PlannedObject) -> list[str]:
    spacing = "no point" if thing.spacing_m is None else f"{thing.n_points} points, {thing.spacing_m * 1e3:.2f} mm apart"
    lines = [f"{thing.name} ({thing.kind}): {thing.seen_share:.0%} of its surface seen, {spacing}"]
    for station in thing.stations:
        lines.append(f"    {station.name}: sees {station.seen_share:.0%}, {station.n_points} points")
    for row in thing.dimensions:
        std = "not in the data" if row.std_m is None else f"+- {row.std_m * 1e3:.3g} mm at best"
        lines.append(f"    {row.name} = {row.value_m * 1e3:.6g} mm: {'observable' if row.observable else 'NOT observable'}, {std}")
    return lines
