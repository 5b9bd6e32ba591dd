"""What rays can hit: the solids of a scene as one mesh that knows its objects."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.rays import RayScene, first_hits, scene_of
from scan2fea.simulation.solids import Scene
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

THREADS = min(os.cpu_count() or 1, 8)  # hits do not depend on it
_SAME_PLACE = 1e-9  # of the distance: rounding of a point that was computed from a range


@dataclass(frozen=True, eq=False, kw_only=True)
class Target(Value):
    """m triangles of k objects.

    scene : the hierarchy over them.   mesh : all triangles in one mesh, objects in order.   object_of_face : (m,).   normal : (m, 3) outward unit.
    reflectance : (k,) diffuse share 0..1 of the light sent back.
    """

    scene: RayScene
    mesh: TriangleMesh
    object_of_face: IntArray
    normal: FloatArray
    reflectance: FloatArray

    _ROWS = (("object_of_face", "normal"),)


@dataclass(frozen=True, eq=False, kw_only=True)
class Hits(Value):
    """Where n rays end.

    range_m : (n,) nan for a miss.   face, thing : (n,) triangle and object, -1 for a miss.   cosine : (n,) of the incidence, 0 for a miss.
    """

    range_m: FloatArray
    face: IntArray
    thing: IntArray
    cosine: FloatArray


def target_of(scene: Scene) -> Target:
    """The solids of a scene, ready to be hit. Raises InputError for no solid and for reflectances outside 0..1."""
    require(len(scene.solids) > 0, InputError, f"scene {scene.name!r} has no object to scan: add one")
    for solid in scene.solids:
        require(0.0 <= solid.reflectance <= 1.0, InputError, f"object {solid.name!r}: reflectance = {solid.reflectance} must lie between 0 and 1")
    mesh = scene.mesh()
    return Target(
        scene=scene_of(mesh),
        mesh=mesh,
        object_of_face=scene.solid_of_face(),
        normal=face_normals(mesh),
        reflectance=np.array([s.reflectance for s in scene.solids]),
    )


def hits(target: Target, origin: FloatArray, direction: FloatArray) -> Hits:
    """First hits of (n, 3) rays of unit direction; exact, without noise."""
    t, face = first_hits(target.scene, origin, direction, threads=THREADS)
    is_hit = face >= 0
    cosine = np.zeros(len(t))
    cosine[is_hit] = np.abs(np.einsum("nc,nc->n", target.normal[face[is_hit]], direction[is_hit]))
    thing = np.full(len(t), -1, np.int64)
    thing[is_hit] = target.object_of_face[face[is_hit]]
    return Hits(range_m=np.where(is_hit, t, np.nan), face=face, thing=thing, cosine=cosine)


def is_visible(target: Target, eye: FloatArray, point: FloatArray, toward: FloatArray) -> BoolArray:
    """(n,) True where nothing stands between an eye and a point of a surface, and the eye sees the side of it that faces against `toward`.

    eye, point : (n, 3) metres.   toward : (n, 3) direction from which the point was lit or found: outward normal times -1, or the laser's ray.
    """
    away = point - eye
    distance = np.linalg.norm(away, axis=1)
    t, face = first_hits(target.scene, eye, away / distance[:, None], threads=THREADS)
    reached: BoolArray = t >= distance * (1 - _SAME_PLACE)
    hit = np.flatnonzero(reached & (face >= 0))
    normal = target.normal[face[hit]]
    same_side = np.einsum("nc,nc->n", normal, away[hit]) * np.einsum("nc,nc->n", normal, toward[hit]) > 0
    reached[hit] &= same_side | (t[hit] > distance[hit] * (1 + _SAME_PLACE))
    return reached
