"""A solid of a scene: its exact mesh, what its dimensions say in closed form, and where to measure them again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.kernel.construction import Base, Change
from scan2fea.kernel.transforms import applied, rotated
from scan2fea.simulation.closed_forms import Moments
from scan2fea.types import FloatArray, TriangleMesh, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Probe(Value):
    """A straight line through the solid on which one dimension can be measured again.

    middle : (3,) middle of the interval of solid.   direction : (3,) unit.   size_m : length of that interval.
    """

    name: str
    middle: FloatArray
    direction: FloatArray
    size_m: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape(Value):
    """A kind of solid with its dimensions, in its own frame.

    kind : key of `shape_kinds.KINDS`.   family : of kernel.sections for members, else "box" or "free".
    parameters : dimensions by name, metres.   exact : closed forms of the solid as it is without defects.
    chord_m : how far the mesh may stray from the true surface; 0 where it is exact.
    section : loops (k, 2) of a member's outline, else empty.   n_cad_faces : faces a draughtsman would draw.
    base : how CAD makes it with true faces.
    """

    kind: str
    family: str
    parameters: Mapping[str, float]
    mesh: TriangleMesh
    exact: Moments
    chord_m: float
    section: tuple[FloatArray, ...]
    n_cad_faces: int
    probes: tuple[Probe, ...]
    base: Base


@dataclass(frozen=True, eq=False, kw_only=True)
class Solid(Value):
    """A shape where it stands in the world.

    T_world_shape : (4, 4).   mesh : in the world, with its defects.   defects : name -> its numbers, in the order they were made.
    changes : the same in the words of kernel.construction.   damage_chord_m : how far the mesh may stray where defects bent it.
    reflectance : share of the light that a surface square to it sends back.   spacing_m : what scans of this object aim at.
    """

    name: str
    shape: Shape
    T_world_shape: FloatArray
    mesh: TriangleMesh
    volume_m3: float
    spacing_m: float = 0.01
    reflectance: float = 0.5
    defects: tuple[tuple[str, Mapping[str, Any]], ...] = ()
    changes: tuple[Change, ...] = ()
    damage_chord_m: float = 0.0

    @property
    def chord_m(self) -> float:
        """How far the mesh may stray from the true surface; 0 where it is exact."""
        return max(self.shape.chord_m, self.damage_chord_m)

    def probes(self) -> tuple[Probe, ...]:
        """The shape's probes in the world; none of a solid with defects, whose lines may no longer hold what they say."""
        if self.defects:
            return ()
        T = self.T_world_shape
        return tuple(
            Probe(name=p.name, middle=applied(T, p.middle[None])[0], direction=rotated(T, p.direction[None])[0], size_m=p.size_m)
            for p in self.shape.probes
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene(Value):
    """Solids in the order of their number, which is the label of every point that is scanned on them."""

    name: str
    solids: tuple[Solid, ...]

    def mesh(self) -> TriangleMesh:
        """All solids as one list of triangles, in order."""
        first = np.cumsum([0] + [len(s.mesh.vertices) for s in self.solids])
        return TriangleMesh(
            vertices=np.concatenate([s.mesh.vertices for s in self.solids]),
            faces=np.concatenate([s.mesh.faces + f for s, f in zip(self.solids, first, strict=False)]),
        )

    def solid_of_face(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """(m,) number of the solid of each triangle of `mesh`."""
        return np.repeat(np.arange(len(self.solids), dtype=np.int64), [len(s.mesh.faces) for s in self.solids])
