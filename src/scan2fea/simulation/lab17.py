"""The source thesis's virtual lab (3.3.1): 17 objects with the ground, 114,808 points at zero noise.

Stated there: the number of objects and of points, and the L-beam, 10 ft long, legs of 5 in, 1/4 in thick. Sizes of the room and of the other 16
objects are not, nor is one spacing: "0.1 in" and "0.1 cm^2" would each give the beam alone more points than the whole cloud has. One square grid
of 0.4 in on everything meets what can be met: 114,808 points in all, and the beam is then the only cluster of 3,000 to 50,000 points at a
clustering radius of 0.5 in, as in the thesis (its own limits; the ground has more, the other objects less).
Everything hangs clear of everything else by more than that radius.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from scan2fea.kernel.measures import volume
from scan2fea.kernel.transforms import quaternion_to_matrix, rigid, rotation_about
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.types import FloatArray

N_POINTS = 114_808
SPACING_M = 0.4 * 0.0254
CHORD_M = 2e-4
_CLEAR_M = 0.04  # between the bounding balls or boxes of neighbours: three times the clustering radius

_FLOOR = {"x": 3.4, "y": 1.2, "z": 0.05}
_BEAM = {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048}
_OTHERS: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
    ("i_beam", "I", {"h": 0.1, "b": 0.055, "tw": 0.0041, "tf": 0.0057, "length": 0.25}),
    ("channel", "C", {"h": 0.08, "b": 0.045, "tw": 0.006, "tf": 0.008, "length": 0.25}),
    ("tee", "T", {"h": 0.08, "b": 0.08, "tw": 0.009, "tf": 0.009, "length": 0.25}),
    ("square_tube", "RHS", {"h": 0.08, "b": 0.08, "t": 0.005, "length": 0.25}),
    ("pipe", "CHS", {"d": 0.0889, "t": 0.004, "length": 0.25}),
    ("bar", "rect", {"b": 0.1, "t": 0.012, "length": 0.29}),
    ("rod", "round", {"d": 0.05, "length": 0.3}),
    ("crate", "box", {"x": 0.2, "y": 0.16, "z": 0.12}),
    ("brick", "box", {"x": 0.215, "y": 0.1025, "z": 0.065}),
    ("drum", "cylinder", {"d": 0.15, "length": 0.2}),
    ("ball", "sphere", {"d": 0.16}),
    ("stone", "blob", {"d": 0.175, "wave": 0.2, "shape_seed": 17}),
    ("bracket", "bracket", {"a": 0.12, "b": 0.12, "t": 0.01, "width": 0.12,
                            "holes": (("a", 0.07, 0.03, 0.009), ("a", 0.07, 0.09, 0.009), ("b", 0.07, 0.06, 0.012))}),
    ("pot", "tank", {"d": 0.16, "height": 0.16, "t": 0.008}),
    ("girder", "girder", {"h": 0.12, "b": 0.08, "tw": 0.005, "tf": 0.008, "length": 0.3, "ts": 0.006, "bs": 0.03, "n_stiffeners": 2}),
)  # fmt: skip
_COLUMNS = 5


def lab17(seed: int = 0) -> Scene:
    """The 17 solids; the seed turns the 15 that are not stated. Labels: 0 the floor, 1 the beam, then the others in order."""
    rng = np.random.default_rng(seed)
    floor = _solid("floor", "box", _FLOOR, np.eye(3), np.array([0.0, 0.0, -_FLOOR["z"]]))
    legs_up = rotation_about((0, 1, 0), math.pi / 2) @ rotation_about((0, 0, 1), math.radians(225.0))  # along x, legs hang like a roof
    beam = _solid("l_beam", "L", _BEAM, legs_up, np.array([0.176, 0.6, 0.9]))
    solids = [floor, beam]
    reach = max(_radius(kind, values) for _, kind, values in _OTHERS)
    step = 2 * reach + _CLEAR_M
    for k, (name, kind, values) in enumerate(_OTHERS):
        turn = quaternion_to_matrix(rng.standard_normal(4))
        place = np.array([(k % _COLUMNS + 0.5) * _FLOOR["x"] / _COLUMNS, _FLOOR["y"] / 2, 1.0 + reach + _CLEAR_M + (k // _COLUMNS + 0.5) * step])
        middle = _middle(kind, values)
        solids.append(_solid(name, kind, values, turn, place - turn @ middle))
    return Scene(name="lab", solids=tuple(solids))


def _solid(name: str, kind: str, values: Mapping[str, Any], R: FloatArray, origin: FloatArray) -> Solid:
    shape = KINDS[kind].build(values, CHORD_M)
    T = rigid(R, origin)
    mesh = posed(shape.mesh, T)
    return Solid(name=name, shape=shape, T_world_shape=T, mesh=mesh, volume_m3=volume(mesh), spacing_m=SPACING_M)


def _box_of(kind: str, values: Mapping[str, Any]) -> FloatArray:
    vertices = KINDS[kind].build(values, CHORD_M).mesh.vertices
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])


def _middle(kind: str, values: Mapping[str, Any]) -> FloatArray:
    return np.asarray(_box_of(kind, values).mean(axis=0))


def _radius(kind: str, values: Mapping[str, Any]) -> float:
    return float(np.linalg.norm(np.diff(_box_of(kind, values), axis=0)) / 2)
