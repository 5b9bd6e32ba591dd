"""Rooms of members that touch: portal frames, trusses, brackets on columns. Sizes, sections and noise follow a seed.

What real structures look like to a segmentation: nothing hangs free, a scan of the whole is one connected piece.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from scan2fea.kernel.measures import volume
from scan2fea.kernel.transforms import rigid
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.types import FloatArray

ROOM_KINDS = ("frame", "truss", "brackets")
_CHORD_M = 1e-3
_UP = np.array([0.0, 0.0, 1.0])
_CLEAR_M = 1.2  # floor around what stands on it


def touching_room(seed: int, spacing_m: float = 0.012, with_floor: bool = True) -> Scene:
    """A room whose kind goes round with the seed: 0 frame, 1 truss, 2 brackets on columns, 3 frame, ... Members are all solids but the floor
    and the brackets (`is_member`).
    """
    rng = np.random.default_rng([seed, 10])
    make = {"frame": _frame, "truss": _truss, "brackets": _brackets}[ROOM_KINDS[seed % len(ROOM_KINDS)]]
    solids = make(rng, spacing_m)
    if with_floor:
        every = np.concatenate([solid.mesh.vertices for solid in solids])
        low, high = every.min(axis=0)[:2] - _CLEAR_M, every.max(axis=0)[:2] + _CLEAR_M
        size = high - low
        values = {"x": float(size[0]), "y": float(size[1]), "z": 0.1}
        solids.append(_solid("floor", "box", values, np.eye(3), np.array([low[0], low[1], -0.1]), 3 * spacing_m))
    return Scene(name=f"touching{seed}", solids=tuple(solids))


def is_member(solid: Solid) -> bool:
    """Whether a solid of such a room is a member."""
    return solid.shape.family not in ("box", "free")


def stations_around(scene: Scene, seed: int) -> tuple[tuple[float, float, float], ...]:
    """Eight places around a room, low and high in turn, as a surveyor would choose them."""
    every = np.concatenate([solid.mesh.vertices for solid in scene.solids])
    low, high = every.min(axis=0), every.max(axis=0)
    middle, reach = (low + high) / 2, 0.75 * float(np.linalg.norm((high - low)[:2])) + 0.5
    turn = np.random.default_rng([seed, 11]).random() * 2 * np.pi
    angle = turn + np.arange(8) * np.pi / 4
    z = np.where(np.arange(8) % 2 == 0, 0.4, high[2] + 0.8)
    places = np.stack([middle[0] + reach * np.cos(angle), middle[1] + reach * np.sin(angle), z], axis=1)
    return tuple((float(x), float(y), float(height)) for x, y, height in places)


def _frame(rng: np.random.Generator, h: float) -> list[Solid]:
    """Two or three columns in a row, beams between them or on top, sometimes a second row with a beam across."""
    column, beam = _column(rng), _beam(rng)
    n, span, tall = int(rng.integers(2, 4)), float(rng.uniform(1.8, 2.8)), float(rng.uniform(2.0, 3.0))
    on_top = bool(rng.random() < 0.5)
    turn = _about_z(float(rng.uniform(0, np.pi)))
    solids = []
    for i in range(n):
        foot = np.array([i * span, 0.0, 0.0])
        solids.append(_between(f"column_{i}", column, foot, foot + tall * _UP, np.array([1.0, 0, 0]), turn, h))
    deep, wide = _depth(beam), _depth(column)
    if on_top:
        z = tall + deep / 2
        solids.append(_between("beam", beam, np.array([-0.3, 0, z]), np.array([(n - 1) * span + 0.3, 0, z]), _UP, turn, h))
        return solids
    z = tall - deep / 2 - float(rng.uniform(0.05, 0.4))
    for i in range(n - 1):
        ends = np.array([[i * span + wide / 2, 0, z], [(i + 1) * span - wide / 2, 0, z]])
        solids.append(_between(f"beam_{i}", beam, ends[0], ends[1], _UP, turn, h))
    if rng.random() < 0.5:  # a beam that lies across on the first one, away from the columns
        x = float(rng.uniform(0.35, 0.65)) * span
        top = z + deep
        purlin = {"kind": "C", "h": 0.12, "b": 0.055, "tw": 0.005, "tf": 0.008}
        solids.append(_between("purlin", purlin, np.array([x, -0.9, z + deep / 2 + 0.06]), np.array([x, 0.9, top - deep / 2 + 0.06]), _UP, turn, h))
    return solids


def _truss(rng: np.random.Generator, h: float) -> list[Solid]:
    """Two chords with verticals and diagonals between them; it stands on two posts."""
    side, web = float(rng.choice([0.08, 0.1, 0.12])), float(rng.choice([0.05, 0.06]))
    chord = {"kind": "RHS", "h": side, "b": side, "t": 0.005}
    bar = {"kind": "RHS", "h": web, "b": web, "t": 0.004} if rng.random() < 0.5 else {"kind": "CHS", "d": web, "t": 0.004}
    panels, panel, tall = int(rng.integers(3, 5)), float(rng.uniform(0.7, 0.95)), float(rng.uniform(0.75, 1.0))
    base = float(rng.uniform(0.9, 1.3))
    turn = _about_z(float(rng.uniform(0, np.pi)))
    length = panels * panel
    low, high = base + side / 2, base + tall
    solids = [
        _between("bottom_chord", chord, np.array([-0.1, 0, low]), np.array([length + 0.1, 0, low]), _UP, turn, h),
        _between("top_chord", chord, np.array([-0.1, 0, high]), np.array([length + 0.1, 0, high]), _UP, turn, h),
    ]
    for i in range(panels + 1):
        x = min(max(i * panel, web), length - web)
        foot, head = np.array([x, 0, low + side / 2]), np.array([x, 0, high - side / 2])
        solids.append(_between(f"vertical_{i}", bar, foot, head, np.array([1.0, 0, 0]), turn, h))
    inset = 1.5 * web
    for i in range(panels):
        a, b = (i * panel + inset + web, (i + 1) * panel - inset) if i % 2 == 0 else ((i + 1) * panel - inset, i * panel + inset + web)
        ends = np.array([[a, 0, low + 0.4 * side], [b, 0, high - 0.4 * side]])
        solids.append(_between(f"diagonal_{i}", bar, ends[0], ends[1], np.array([0, 1.0, 0]), turn, h))
    post = {"kind": "RHS", "h": 0.14, "b": 0.14, "t": 0.006}
    for i, x in enumerate((0.15, length - 0.15)):
        solids.append(_between(f"post_{i}", post, np.array([x, 0, 0]), np.array([x, 0, base]), np.array([1.0, 0, 0]), turn, h))
    return solids


def _brackets(rng: np.random.Generator, h: float) -> list[Solid]:
    """One or two columns with angle brackets on their faces, a beam resting on a pair of them."""
    column, beam = _column(rng), _beam(rng)
    span, tall = float(rng.uniform(1.8, 2.6)), float(rng.uniform(2.2, 3.0))
    turn = _about_z(float(rng.uniform(0, np.pi)))
    wide, deep = _depth(column), _depth(beam)
    z = float(rng.uniform(0.5, 0.7)) * tall
    width = 0.14
    plate = {"a": 0.18, "b": 0.18, "t": 0.012, "width": width, "holes": ()}
    solids = []
    for i in range(2):
        foot = np.array([i * span, 0.0, 0.0])
        solids.append(_between(f"column_{i}", column, foot, foot + tall * _UP, np.array([1.0, 0, 0]), turn, h))
        out = np.array([1.0 if i == 0 else -1.0, 0.0, 0.0])
        face = foot + (wide / 2) * out
        for k, at in enumerate((z, 0.35 * tall)[: 1 + int(rng.random() < 0.6)]):
            axes = np.stack([out, -_UP, np.cross(out, -_UP)], axis=1)  # leg b along x goes out at the top, leg a along y hangs down the face
            origin = face + at * _UP - 0.5 * width * axes[:, 2]
            solids.append(_solid(f"bracket_{i}{k}", "bracket", plate, turn @ axes, turn @ origin, h))
    ends = np.array([[wide / 2 + 0.005, 0, z + deep / 2], [span - wide / 2 - 0.005, 0, z + deep / 2]])
    solids.append(_between("beam", beam, ends[0], ends[1], _UP, turn, h))
    return solids


def _column(rng: np.random.Generator) -> Mapping[str, Any]:
    choices = (
        {"kind": "I", "h": 0.2, "b": 0.2, "tw": 0.009, "tf": 0.015},
        {"kind": "I", "h": 0.16, "b": 0.16, "tw": 0.008, "tf": 0.013},
        {"kind": "RHS", "h": 0.15, "b": 0.15, "t": 0.008},
        {"kind": "RHS", "h": 0.2, "b": 0.12, "t": 0.008},
    )
    return choices[int(rng.integers(len(choices)))]


def _beam(rng: np.random.Generator) -> Mapping[str, Any]:
    choices = (
        {"kind": "I", "h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085},
        {"kind": "I", "h": 0.16, "b": 0.082, "tw": 0.005, "tf": 0.0074},
        {"kind": "C", "h": 0.16, "b": 0.065, "tw": 0.0075, "tf": 0.0105},
        {"kind": "RHS", "h": 0.14, "b": 0.08, "t": 0.006},
    )
    return choices[int(rng.integers(len(choices)))]


def _depth(section: Mapping[str, Any]) -> float:
    return float(section["h"] if "h" in section else section["d"])


def _about_z(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _between(name: str, section: Mapping[str, Any], start: FloatArray, end: FloatArray, depth: FloatArray, turn: FloatArray, h: float) -> Solid:
    """A member from start to end, the depth of its section (its y) towards `depth`; all turned about the vertical afterwards."""
    length = float(np.linalg.norm(end - start))
    z = (end - start) / length
    y = depth - (depth @ z) * z
    y /= np.linalg.norm(y)
    R = np.stack([np.cross(y, z), y, z], axis=1)
    values = {key: value for key, value in section.items() if key != "kind"} | {"length": length}
    return _solid(name, str(section["kind"]), values, turn @ R, turn @ start, h)


def _solid(name: str, kind: str, values: Mapping[str, Any], R: FloatArray, origin: FloatArray, h: float) -> Solid:
    shape = KINDS[kind].build(values, _CHORD_M)
    T = rigid(R, origin)
    mesh = posed(shape.mesh, T)
    return Solid(name=name, shape=shape, T_world_shape=T, mesh=mesh, volume_m3=volume(mesh), spacing_m=h)
