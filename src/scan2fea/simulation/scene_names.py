"""Scenes that come with the program: `lab`, the source thesis's room, and `demo`, the room that `scan2fea demo` converts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from scan2fea.simulation.lab import BRACKET_HOLES, SceneObject, demo_lab
from scan2fea.simulation.lab17 import SPACING_M, lab17
from scan2fea.simulation.sampling import SamplingOptions
from scan2fea.simulation.scanner import LabOptions
from scan2fea.simulation.scene_file import PlacedSensor, SceneFile
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import CHORD_M
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.simulation.stations import StationsOptions

_PAST = tuple((x, -1.6, 0.85) for x in (-0.6, 0.17, 0.93, 1.7, 2.47, 3.23, 4.0))  # the thesis: a table of fixed height, moved past the objects
_CORNERS = ((-1.0, -1.5, 0.4), (4.4, -1.5, 1.4), (4.4, 2.7, 0.4), (-1.0, 2.7, 1.4))
_ROUND = tuple((x, y, z) for x, y in ((-1.0, -1.5), (1.7, -1.8), (4.4, -1.5), (4.4, 2.7), (1.7, 3.0), (-1.0, 2.7)) for z in (0.3, 2.4))
_MOVED: Mapping[str, Any] = {"positions_m": (_PAST[0], _PAST[-1]), "orientations_deg": ((0.0, 0.0, 90.0),) * 2}
_STEPS: Mapping[str, Any] = {"positions_m": _PAST, "orientations_deg": ((0.0, 0.0, 90.0),) * len(_PAST)}
LAB_SENSORS: Mapping[str, Mapping[str, Any]] = {  # where a sensor stands in the lab when it is asked for by name; others: in steps along the table
    "stations": {"positions_m": _ROUND},
    "terrestrial": {"positions_m": _CORNERS, "step_deg": 0.25},
    **dict.fromkeys(("hdl32e", "vlp16", "planar", "lidar"), _MOVED),
}


def lab_sensor(kind: str) -> Mapping[str, Any]:
    """Options with which a sensor of this kind scans the lab."""
    return LAB_SENSORS.get(kind, _STEPS)


def lab_file(seed: int) -> SceneFile:
    """The thesis's lab, its surfaces on a grid."""
    return SceneFile(scene=lab17(seed), sensors=(), sampling=SamplingOptions(method="grid", spacing_m=SPACING_M))


def demo_file(seed: int) -> SceneFile:
    """The demo's room and its stations, as `scan2fea demo` scans them."""
    lab, own = demo_lab(), LabOptions()
    solids = tuple(_solid(thing) for thing in lab.objects)
    positions = tuple((float(x), float(y), float(z)) for x, y, z in lab.stations)
    options = StationsOptions(positions_m=positions, noise_m=own.noise_m, overview_deg=own.overview_deg)
    return SceneFile(scene=Scene(name="demo", solids=solids), sensors=(PlacedSensor(kind="stations", options=options),), sampling=None)


SCENE_NAMES: Mapping[str, Callable[[int], SceneFile]] = {"lab": lab_file, "demo": demo_file}


def _solid(thing: SceneObject) -> Solid:
    d = dict(thing.dimensions)
    values: dict[str, Any] = d
    kind = thing.kind
    if kind == "l_beam":
        kind = "L"
    elif kind == "tank":
        values = {"d": 2 * d["radius"], "height": d["height"], "t": d["wall"]}
    elif kind == "cylinder":
        values = {"d": 2 * d["radius"], "length": d["length"]}
    elif kind == "bracket":
        values = {
            **{k: d[k] for k in ("a", "b", "t", "width")},
            "holes": BRACKET_HOLES,
        }
    T = np.eye(4) if thing.T_world_shape is None else thing.T_world_shape
    return Solid(
        name=thing.name,
        shape=KINDS[kind].build(values, CHORD_M),
        T_world_shape=T,
        mesh=thing.mesh,
        volume_m3=thing.volume_m3,
        spacing_m=thing.spacing_m,
    )
