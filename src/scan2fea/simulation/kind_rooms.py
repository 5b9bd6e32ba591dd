"""Rooms with a class for every point, to teach a classifier of points: floor, walls, members that touch, bodies, clutter. All follows a seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.measures import volume
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.simulation.stations import StationsOptions, scan_stations
from scan2fea.simulation.touching import is_member, stations_around, touching_room
from scan2fea.types import FloatArray, IntArray, Value

POINT_CLASSES = ("floor", "wall", "member", "body", "clutter")
_CLEAR_M = 0.9
_BUSHES = 3
_UP = (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class FurnishedRoom(Value):
    """points : (n, 3).   solid : (n,) what each lies on, -1 leaves.   names, classes : of the solids, the class a number in POINT_CLASSES."""

    points: FloatArray
    solid: IntArray
    names: tuple[str, ...]
    classes: tuple[int, ...]


def classed_room(seed: int) -> tuple[FloatArray, IntArray]:
    """(n, 3) points of one scanned room and the (n,) class of each, a number in POINT_CLASSES."""
    room = furnished_room(seed)
    return room.points, np.append(room.classes, POINT_CLASSES.index("clutter"))[room.solid].astype(np.int64)


def furnished_room(seed: int) -> FurnishedRoom:
    """A structure of members that touch, bodies and heaps beside it, bushes behind, none to two walls: seen from eight stations."""
    rng = np.random.default_rng([seed, 31])
    spacing = float(rng.uniform(0.014, 0.03))
    structure = touching_room(seed, spacing, with_floor=False)
    solids = list(structure.solids)
    classes = [POINT_CLASSES.index("member") if is_member(s) or s.shape.kind == "bracket" else POINT_CLASSES.index("body") for s in solids]
    every = np.concatenate([s.mesh.vertices for s in solids])
    low, high = every.min(axis=0)[:2], every.max(axis=0)[:2]
    for k in range(int(rng.integers(2, 6))):  # bodies and heaps in a row beside the structure
        place = np.array([rng.uniform(low[0], high[0]), low[1] - 0.7 - 0.9 * (k % 2)])
        is_heap = rng.random() < 0.35
        made = _heap(k, place, spacing, rng) if is_heap else [_body(f"body_{k}", place, spacing, rng)]
        solids += made
        classes += [POINT_CLASSES.index("clutter" if is_heap else "body")] * len(made)
    rooms, room_classes = _room(solids, spacing, rng)
    scene = Scene(name=f"classed{seed}", solids=tuple(solids + rooms))
    classes += room_classes
    noise = float(rng.uniform(0.0003, 0.003))
    inside = Scene(name="inside", solids=tuple(solids))  # stations stand in the room, not behind its walls
    scans = scan_stations(scene, StationsOptions(positions_m=stations_around(inside, seed), noise_m=noise), seed)
    points = np.concatenate([scan.cloud.points for scan in scans])
    label = np.concatenate([scan.cloud.label for scan in scans if scan.cloud.label is not None])
    bushes = [_bush(np.array([rng.uniform(low[0], high[0]), high[1] + rng.uniform(0.3, 0.9)]), spacing, rng) for _ in range(_BUSHES)]
    points = np.concatenate([points, *bushes])
    return FurnishedRoom(
        points=points,
        solid=np.concatenate([label, np.full(len(points) - len(label), -1)]).astype(np.int64),
        names=tuple(solid.name for solid in scene.solids),
        classes=tuple(classes),
    )


def _solid(name: str, kind: str, values: dict[str, object], R: FloatArray, origin: FloatArray, spacing: float) -> Solid:
    shape = KINDS[kind].build(values, 2e-3)
    T = rigid(R, origin)
    mesh = posed(shape.mesh, T)
    return Solid(name=name, shape=shape, T_world_shape=T, mesh=mesh, volume_m3=volume(mesh), spacing_m=spacing)


def _body(name: str, place: FloatArray, spacing: float, rng: np.random.Generator) -> Solid:
    u = rng.uniform
    kind = str(rng.choice(["box", "cylinder", "blob", "tank"]))
    values: dict[str, dict[str, object]] = {
        "box": {"x": u(0.25, 0.8), "y": u(0.25, 0.8), "z": u(0.2, 0.9)},
        "cylinder": {"d": u(0.25, 0.6), "length": u(0.3, 1.0)},
        "blob": {"d": u(0.3, 0.7), "wave": u(0.1, 0.4), "shape_seed": int(rng.integers(10_000))},
        "tank": {"d": u(0.3, 0.6), "height": u(0.4, 0.8), "t": 0.01},
    }
    lift = float(values["blob"]["d"]) * 0.75 if kind == "blob" else 0.0  # type: ignore[arg-type]
    return _solid(name, kind, values[kind], rotation_about(_UP, float(u(0, np.pi))), np.array([*place, lift]), spacing)


def _heap(k: int, place: FloatArray, spacing: float, rng: np.random.Generator) -> list[Solid]:
    """Small boxes and rods thrown on one another."""
    made = []
    for i in range(int(rng.integers(4, 9))):
        kind = str(rng.choice(["box", "round"]))
        values: dict[str, object] = {"x": rng.uniform(0.08, 0.25), "y": rng.uniform(0.08, 0.25), "z": rng.uniform(0.05, 0.2)}
        if kind == "round":
            values = {"d": rng.uniform(0.03, 0.08), "length": rng.uniform(0.2, 0.5)}
        turn = rotation_about(rng.standard_normal(3), float(rng.uniform(0, np.pi)))
        at = np.array([*(place + rng.uniform(-0.2, 0.2, 2)), rng.uniform(0.25, 0.45)])
        made.append(_solid(f"heap_{k}_{i}", kind, values, turn, at, spacing))
    return made


def _room(solids: list[Solid], spacing: float, rng: np.random.Generator) -> tuple[list[Solid], list[int]]:
    """The floor, and in two rooms of three one or two walls behind everything."""
    every = np.concatenate([s.mesh.vertices for s in solids])
    low, high = every.min(axis=0)[:2] - _CLEAR_M, every.max(axis=0)[:2] + _CLEAR_M
    size, tall = high - low, float(rng.uniform(2.2, 3.2))
    made = [_solid("floor", "box", {"x": size[0], "y": size[1], "z": 0.1}, np.eye(3), np.array([*low, -0.1]), 1.5 * spacing)]
    n_walls = int(rng.integers(3))
    walls = [({"x": 0.1, "y": size[1], "z": tall}, [low[0] - 0.1, low[1], 0.0]), ({"x": size[0], "y": 0.1, "z": tall}, [low[0], high[1], 0.0])]
    for w, (values, at) in enumerate(walls[:n_walls]):
        made.append(_solid(f"wall_{w}", "box", dict(values), np.eye(3), np.array(at), 1.5 * spacing))
    return made, [POINT_CLASSES.index("floor")] + [POINT_CLASSES.index("wall")] * n_walls


def _bush(place: FloatArray, spacing: float, rng: np.random.Generator) -> FloatArray:
    """Leaves: points on no surface."""
    size = rng.uniform(0.12, 0.35, 3)
    n = min(int(4.0 * float(np.prod(size)) / spacing**3), 6000)
    points = np.array([*place, 2 * size[2]]) + size * rng.standard_normal((n, 3))
    return np.asarray(points[points[:, 2] > 0])
