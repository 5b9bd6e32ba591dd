"""The demo lab: a room with ten exact objects, scanned by static stations. Everything about it is known, so everything we claim can be measured.

What is to be converted hangs in a rig whose wires are too thin to scan, so that low stations see it from below. What stands on the
floor or the table shows no underside, as in real rooms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.measures import volume
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation import shapes
from scan2fea.types import FloatArray, TriangleMesh, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneObject(Value):
    """One solid of a scene: exact mesh in the world, dimensions and volume in SI.

    spacing_m : mean distance between neighbours that the detail scan of this object aims at.
    stands_on : name of the object that hides its underside, or "" if it hangs free.   T_world_shape : (4, 4), or None where not stated.
    """

    name: str
    kind: str
    mesh: TriangleMesh
    dimensions: Mapping[str, float]
    volume_m3: float
    spacing_m: float
    stands_on: str
    T_world_shape: FloatArray | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Lab(Value):
    """objects : in order of their label.   stations : (s, 3) scanner positions, metres."""

    objects: tuple[SceneObject, ...]
    stations: FloatArray


_L_BEAM = {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048}  # thesis 3.3.1: 5 x 5 x 1/4 in, 10 ft
BRACKET_HOLES = (("a", 0.055, 0.03, 0.009), ("a", 0.055, 0.09, 0.009), ("b", 0.07, 0.06, 0.012))
_ANY_ANGLE = math.radians(17.0)  # nothing that hangs is aligned with the axes of the scan


def demo_lab() -> Lab:
    """Floor, table, L-beam, bracket with holes, open tank, hung crate, box on the table, two boxes and a drum on the floor."""
    turned = about_z(_ANY_ANGLE)
    beam_up = turned @ rotation_about((0, 1, 0), math.pi / 2) @ about_z(math.radians(225.0))  # lies along x, legs hang like a roof
    tilted = rotation_about((1, 2, 0.5), math.radians(40.0))
    box, table = shapes.box, shapes.table
    objects = (
        _object("floor", "box", box(4.4, 3.6, 0.1), {"x": 4.4, "y": 3.6, "z": 0.1}, 0.025, np.eye(3), (-0.4, -0.3, -0.1)),
        _object(
            "table",
            "table",
            table(1.2, 0.8, 0.72, 0.03, 0.06, 0.05),
            {"x": 1.2, "y": 0.8, "height": 0.72, "top": 0.03, "leg": 0.06, "inset": 0.05},
            0.014,
            turned,
            (2.2, 0.2, 0.0),
            "floor",
        ),
        _object("l_beam", "l_beam", shapes.l_beam(**_L_BEAM), _L_BEAM, 0.0052, beam_up, (0.2, 1.5, 1.35)),
        _object(
            "bracket",
            "bracket",
            shapes.bracket(0.1, 0.12, 0.01, 0.12, BRACKET_HOLES),
            {"a": 0.1, "b": 0.12, "t": 0.01, "width": 0.12, "d1": 0.018, "d2": 0.018, "d3": 0.024},
            0.0025,
            tilted,
            (0.9, 0.5, 1.0),
        ),
        _object("tank", "tank", shapes.tank(0.15, 0.3, 0.012), {"radius": 0.15, "height": 0.3, "wall": 0.012}, 0.0065, np.eye(3), (1.7, 0.5, 0.75)),
        _object("crate", "box", box(0.4, 0.3, 0.25), {"x": 0.4, "y": 0.3, "z": 0.25}, 0.01, tilted, (0.7, 2.5, 0.8)),
        _object("box_on_table", "box", box(0.3, 0.2, 0.15), {"x": 0.3, "y": 0.2, "z": 0.15}, 0.008, about_z(1.0), (2.7, 0.55, 0.72), "table"),
        _object("box_1", "box", box(0.5, 0.4, 0.3), {"x": 0.5, "y": 0.4, "z": 0.3}, 0.012, about_z(0.4), (2.9, 2.2, 0.0), "floor"),
        _object("box_2", "box", box(0.25, 0.35, 0.45), {"x": 0.25, "y": 0.35, "z": 0.45}, 0.012, about_z(-0.3), (1.9, 2.5, 0.0), "floor"),
        _object("drum", "cylinder", shapes.cylinder(0.2, 0.6), {"radius": 0.2, "length": 0.6}, 0.012, np.eye(3), (0.2, 0.6, 0.0), "floor"),
    )
    return Lab(objects=objects, stations=_stations())


def about_z(angle_rad: float) -> FloatArray:
    """(3, 3) rotation about the vertical."""
    return rotation_about((0.0, 0.0, 1.0), angle_rad)


def _stations() -> FloatArray:
    """Low ones look up at what hangs, high ones look down; three stand around the tank's opening."""
    low = [(x, y, 0.25) for x, y in ((-0.3, 0.0), (1.3, 0.3), (1.2, 3.2), (3.7, 1.4), (1.5, 1.6), (0.0, 2.0))]
    high = [(x, y, 2.3) for x, y in ((-0.3, -0.2), (3.9, -0.2), (3.9, 3.2), (-0.3, 3.2))]
    over_tank = [(1.7 + 0.5 * math.cos(a), 0.5 + 0.5 * math.sin(a), 1.9) for a in (0.3, 2.4, 4.5)]
    return np.array(low + high + over_tank)


def _object(
    name: str,
    kind: str,
    mesh: TriangleMesh,
    dimensions: Mapping[str, float],
    spacing_m: float,
    R_world_shape: FloatArray,
    origin: tuple[float, float, float],
    stands_on: str = "",
) -> SceneObject:
    T = rigid(R_world_shape, origin)
    solid = shapes.posed(mesh, T)
    return SceneObject(
        name=name, kind=kind, mesh=solid, dimensions=dimensions, volume_m3=volume(solid), spacing_m=spacing_m, stands_on=stands_on, T_world_shape=T
    )
