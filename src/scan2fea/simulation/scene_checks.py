"""What no real scene has: two solids in one place, a sensor inside a solid."""

from __future__ import annotations

import itertools

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.distances import PointToMesh, signs
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.types import FloatArray

TOUCH = 1e-7  # of the size of the smaller solid: what rounding may push a solid into the one it stands on
_MOST_HITS = 64  # of one edge with another solid


def check_scene(scene: Scene) -> None:
    """Raises InputError that names the first two solids that overlap. Solids may touch; curved ones may touch to their chord tolerances."""
    boxes = [(s.mesh.vertices.min(axis=0), s.mesh.vertices.max(axis=0)) for s in scene.solids]
    for i, j in itertools.combinations(range(len(scene.solids)), 2):
        if ((boxes[i][0] < boxes[j][1]) & (boxes[j][0] < boxes[i][1])).all():
            a, b = scene.solids[i], scene.solids[j]
            size = min(float(np.ptp(s.mesh.vertices, axis=0).max()) for s in (a, b))
            depth = max(_deepest(a, b), _deepest(b, a))
            limit = TOUCH * size + a.shape.chord_m + b.shape.chord_m
            says = f"object {b.name}: position: it overlaps object {a.name} by {depth * 1e3:.3g} mm or more: move one of them"
            require(depth <= limit, InputError, says)


def check_sensor(scene: Scene, positions: FloatArray, sensor: str) -> None:
    """Raises InputError where one of (k, 3) positions lies inside a solid."""
    for solid in scene.solids:
        low, high = solid.mesh.vertices.min(axis=0), solid.mesh.vertices.max(axis=0)
        near = np.flatnonzero(((positions > low) & (positions < high)).all(axis=1))
        if len(near):
            inside = near[_depths(positions[near], solid) > 0]
            if len(inside):
                at = ", ".join(f"{v:g}" for v in positions[inside[0]])
                raise InputError(f"sensor {sensor}: positions_m: position {inside[0] + 1} ({at}) lies inside object {solid.name}: move it")


def _deepest(a: Solid, b: Solid) -> float:
    """How deep the edges of `a` reach into `b`: where two solids share space, an edge of one passes into the other, or all of one lies inside."""
    edges = np.unique(np.sort(np.stack([a.mesh.faces, np.roll(a.mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1), axis=0)
    start, end = a.mesh.vertices[edges[:, 0]], a.mesh.vertices[edges[:, 1]]
    low, high = b.mesh.vertices.min(axis=0), b.mesh.vertices.max(axis=0)
    near = (np.minimum(start, end) < high).all(axis=1) & (np.maximum(start, end) > low).all(axis=1)
    start, end = start[near], end[near]
    if not len(start):
        return 0.0
    return float(_depths(_middles(start, end, b), b).max(initial=0.0))


def _middles(start: FloatArray, end: FloatArray, b: Solid) -> FloatArray:
    """The middle of each piece into which the surface of `b` cuts the segments."""
    target = scene_of(b.mesh)
    way = end - start
    at = np.zeros(len(start))
    rows = np.arange(len(start))
    middles = []
    for _ in range(_MOST_HITS):
        t, _face = first_hits(target, start[rows] + at[rows, None] * way[rows], way[rows])
        stop = np.minimum(at[rows] + t, 1.0)
        middles.append(start[rows] + ((at[rows] + stop) / 2)[:, None] * way[rows])
        at[rows] = stop + 1e-12
        rows = rows[at[rows] < 1.0]
        if not len(rows):
            break
    return np.concatenate(middles)


def _depths(points: FloatArray, solid: Solid) -> FloatArray:
    """(n,) distance below the surface, 0 outside."""
    nearest = PointToMesh(solid.mesh).nearest(points)
    return np.where(signs(points, solid.mesh, nearest) < 0, nearest.distance, 0.0)
