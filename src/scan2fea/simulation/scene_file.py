"""Scene files: TOML that names objects with dimensions and units, defects, sensors with their paths, and how bare surfaces are sampled.

Every key is known or refused; every message names the object and the key. Lengths are metres, or text with a unit ("127 mm", "5 in").
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.construction import Change
from scan2fea.kernel.measures import volume
from scan2fea.kernel.transforms import rigid
from scan2fea.simulation.defects import DEFECTS
from scan2fea.simulation.motion import rotation_rpy
from scan2fea.simulation.sampling import SamplingOptions
from scan2fea.simulation.scene_values import filled, known, length_of, nearest, tables, three
from scan2fea.simulation.sensors import SENSORS
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.types import TriangleMesh

SMALLEST_M, LARGEST_M = 1e-6, 1e5  # of a dimension
CHORD_OF_SIZE, CHORD_OF_WALL = 5e-4, 0.02  # chord tolerance where the file states none: of the largest dimension, but no more of the smallest
_OBJECT_KEYS = ("name", "kind", "position", "rotation_deg", "spacing", "reflectance", "chord", "defects", "holes")


@dataclass(frozen=True, kw_only=True)
class PlacedSensor:
    """A sensor of the scene. kind : key of SENSORS.   options : its dataclass, filled in."""

    kind: str
    options: Any


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneFile:
    """What a scene file says. sampling : how surfaces are sampled beside the sensors, or None."""

    scene: Scene
    sensors: tuple[PlacedSensor, ...]
    sampling: SamplingOptions | None


def read_scene(path: Path) -> SceneFile:
    """The scene of a TOML file. Raises InputError in one line that names the file, the object and the key."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text"
        raise InputError(f"{path}: cannot be read ({reason}); give a scene file, or one of the scenes lab, demo") from error
    try:
        return scene_of(text, path.stem)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def scene_of(text: str, name: str = "scene") -> SceneFile:
    """The scene that a TOML text describes. Raises InputError."""
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"is not TOML: {error}") from error
    known(tree, ("name", "object", "sensor", "sampling"), "the scene")
    objects = tables(tree, "object", "the scene")
    require(len(objects) > 0, InputError, "the scene has no object: add an [[object]]")
    solids = [_solid(table, number) for number, table in enumerate(objects)]
    names = [solid.name for solid in solids]
    for one in names:
        require(names.count(one) == 1, InputError, f"object {one}: name is given to {names.count(one)} objects: give each its own")
    sensors = tuple(placed_sensor(table, f"sensor {number + 1}") for number, table in enumerate(tables(tree, "sensor", "the scene")))
    sampling = None
    if "sampling" in tree:
        require(isinstance(tree["sampling"], dict), InputError, "sampling: must be one table [sampling]")
        sampling = filled(SamplingOptions, tree["sampling"], "sampling")
    require(bool(sensors) or sampling is not None, InputError, "the scene has no sensor: add a [[sensor]], or [sampling] for bare surfaces")
    title = tree.get("name", name)
    require(isinstance(title, str), InputError, "the scene: name must be text")
    return SceneFile(scene=Scene(name=title, solids=tuple(solids)), sensors=sensors, sampling=sampling)


def placed_sensor(table: Mapping[str, Any], where: str) -> PlacedSensor:
    """One [[sensor]] table. Raises InputError."""
    rest = dict(table)
    kind = rest.pop("kind", None)
    require(isinstance(kind, str), InputError, f"{where}: kind is missing; it is one of {', '.join(SENSORS)}")
    require(kind in SENSORS, InputError, f"{where}: kind {kind!r} is unknown{nearest(str(kind), SENSORS)}; it is one of {', '.join(SENSORS)}")
    options = filled(SENSORS[str(kind)].options, rest, f"{where} ({kind})")
    return PlacedSensor(kind=str(kind), options=options)


def _solid(table: Mapping[str, Any], number: int) -> Solid:
    name = table.get("name", f"object_{number + 1}")
    require(isinstance(name, str) and re.fullmatch(r"[\w.-]+", name) is not None, InputError, f"object {number + 1}: name {name!r} must be letters, "
            "digits, dots, - and _, for it names files")  # fmt: skip
    where = f"object {name}"
    kind_name = table.get("kind")
    require(isinstance(kind_name, str), InputError, f"{where}: kind is missing; it is one of {', '.join(KINDS)}")
    says = f"{where}: kind {kind_name!r} is unknown{nearest(str(kind_name), KINDS)}; it is one of {', '.join(KINDS)}"
    require(kind_name in KINDS, InputError, says)
    kind = KINDS[str(kind_name)]
    own = (*kind.lengths, *kind.maybe, *kind.counts, *kind.numbers)
    known(table, (*own, *(k for k in _OBJECT_KEYS if k != "holes" or kind.has_holes)), where)
    values = _dimensions(table, str(kind_name), where)
    sizes = [values[k] for k in kind.lengths]
    usual = min(CHORD_OF_SIZE * max(sizes), CHORD_OF_WALL * min(sizes))
    chord = length_of(table["chord"], f"{where}: chord") if "chord" in table else usual
    require(chord > 0, InputError, f"{where}: chord is {chord} m; it must be positive")
    try:
        shape = kind.build(values, chord)
        mesh = shape.mesh
        defects, changes = [], []
        for entry in tables(table, "defects", where):
            mesh, made, change = _damaged(mesh, entry, chord, where)
            defects.append(made)
            changes.append(change)
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(where) else f"{where}: {error}") from error
    T = rigid(rotation_rpy(*three(table, "rotation_deg", where, lengths=False)), three(table, "position", where, lengths=True))
    spacing = length_of(table["spacing"], f"{where}: spacing") if "spacing" in table else 0.01
    require(spacing > 0, InputError, f"{where}: spacing is {spacing} m; it must be positive")
    reflectance = table.get("reflectance", 0.5)
    is_share = isinstance(reflectance, int | float) and not isinstance(reflectance, bool) and 0 <= reflectance <= 1
    require(is_share, InputError, f"{where}: reflectance is {reflectance!r}; it must lie between 0 and 1")
    world = posed(mesh, T)
    return Solid(
        name=name, shape=shape, T_world_shape=T, mesh=world, volume_m3=volume(world), spacing_m=spacing, reflectance=float(reflectance),
        defects=tuple(defects), changes=tuple(changes),
        damage_chord_m=chord if any(DEFECTS[name].is_curved for name, _ in defects) else 0.0,
    )  # fmt: skip


def _dimensions(table: Mapping[str, Any], kind_name: str, where: str) -> dict[str, Any]:
    kind = KINDS[kind_name]
    values: dict[str, Any] = {}
    for key in (*kind.lengths, *kind.maybe):
        if key not in table:
            require(key in kind.maybe, InputError, f"{where}: {key} is missing; {kind_name} needs {', '.join(kind.lengths)}")
            continue
        values[key] = length_of(table[key], f"{where}: {key}")
        require(values[key] > 0, InputError, f"{where}: {key} is {values[key]:g} m; it must be positive")
        fits = SMALLEST_M <= values[key] <= LARGEST_M
        require(fits, InputError, f"{where}: {key} is {values[key]:g} m; it must lie between {SMALLEST_M:g} and {LARGEST_M:g} m")
    for key, default in (*kind.counts.items(), *kind.numbers.items()):
        value = table.get(key, default)
        ok = isinstance(value, int if key in kind.counts else int | float) and not isinstance(value, bool) and value >= 0
        require(ok, InputError, f"{where}: {key} is {value!r}; it must be a {'whole ' if key in kind.counts else ''}number, 0 or more")
        values[key] = value
    if kind.has_holes:
        values["holes"] = tuple(_hole(hole, where) for hole in tables(table, "holes", where))
    return values


def _hole(table: Mapping[str, Any], where: str) -> tuple[str, float, float, float]:
    known(table, ("leg", "along", "z", "d"), f"{where}: holes")
    for key in ("leg", "along", "z", "d"):
        require(key in table, InputError, f"{where}: holes: {key} is missing")
    d = length_of(table["d"], f"{where}: holes: d")
    require(d > 0, InputError, f"{where}: holes: d is {d:g} m; it must be positive")
    return str(table["leg"]), length_of(table["along"], f"{where}: holes: along"), length_of(table["z"], f"{where}: holes: z"), d / 2


def _damaged(
    mesh: TriangleMesh, table: Mapping[str, Any], chord: float, where: str
) -> tuple[TriangleMesh, tuple[str, Mapping[str, Any]], Change]:
    """The damaged mesh, the defect for truth.json, and the change that it is."""
    kind = table.get("kind")
    says = f"{where}: defects: kind {kind!r} is unknown{nearest(str(kind), DEFECTS)}; it is one of {', '.join(DEFECTS)}"
    require(kind in DEFECTS, InputError, says)
    defect, here = DEFECTS[str(kind)], f"{where}: defect {kind}"
    known(table, ("kind", *defect.lengths, *defect.numbers, *defect.words, *defect.points), here)
    for key in (*defect.lengths, *defect.numbers, *defect.words, *defect.points):
        require(key in table, InputError, f"{here}: {key} is missing")
    numbers: dict[str, float] = {key: length_of(table[key], f"{here}: {key}") for key in defect.lengths}
    for key in defect.lengths:
        require(numbers[key] > 0 or key == "at", InputError, f"{here}: {key} is {numbers[key]:g} m; it must be positive")
    for key in defect.numbers:
        is_number = isinstance(table[key], int | float) and not isinstance(table[key], bool) and math.isfinite(table[key])
        require(is_number, InputError, f"{here}: {key} is {table[key]!r}; it must be a number")
        numbers[key] = float(table[key])
    for key, choices in defect.words.items():
        require(table[key] in choices, InputError, f"{here}: {key} is {table[key]!r}: use {', '.join(choices)}")
    points = {key: three(table, key, here, lengths=True) for key in defect.points}
    try:
        words = {k: str(table[k]) for k in defect.words}
        damaged = defect.make(mesh, numbers, words, points, chord)
    except InputError as error:
        raise InputError(f"{here}: {error}") from error
    told = {**numbers, **words, **{k: np.asarray(p, float).tolist() for k, p in points.items()}}
    return damaged, (str(kind), told), defect.tell(mesh, numbers, words, points)
