"""Cylinders that pass into planes without an angle: the ends of slots, round-topped lugs and housings.

Cells cannot cut faces that touch: by the last digit of a fit they cross twice or miss each other. Where the data do not refuse it the cylinder is
made to touch exactly, and both faces are drawn up to the line where they touch and no farther: there their edges meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.kernel.surfaces import CYLINDER, PLANE, Surface
from scan2fea.types import BoolArray, FloatArray, Value

SQUARE = 1e-6  # cosine of plane and axis: relations make them parallel exactly or leave them
LEANS = float(np.sin(np.radians(2.5)))  # as far as relations are looked for
EXACT = 1e-9  # of the radius: what rounding leaves of a cylinder that touches all its planes


@dataclass(frozen=True, eq=False, kw_only=True)
class Limit(Value):
    """A face ends where (x - at) . inward = 0. at : a point of the line of touch.   inward : along the face, square to the line."""

    at: FloatArray
    inward: FloatArray


def touching(
    surfaces: Sequence[Surface], own: Sequence[FloatArray], tolerance: float, reach: float
) -> tuple[list[Surface], list[tuple[Limit, ...]]]:
    """The surfaces with cylinders moved to touch their planes, and where each face ends. own : (n, 3) points of the patch of each.

    tolerance : by how much a cylinder may miss its plane.   reach : how far the rounding of a crease goes.
    """
    surfaces = _along_axes(surfaces, own, tolerance, reach)
    out = list(surfaces)
    limits: list[list[Limit]] = [[] for _ in surfaces]
    for c, round_one in enumerate(surfaces):
        if round_one.kind != CYLINDER:
            continue
        planes = [k for k, flat in enumerate(surfaces) if flat.kind == PLANE and _touch(round_one, own[c], flat, own[k], tolerance, reach)]
        moved = _moved(round_one, [surfaces[k] for k in planes], 2 * tolerance) if planes else None
        if moved is None:
            continue
        out[c] = moved
        for k in planes:
            at, along = _line(moved, surfaces[k])
            side = np.sign((own[k] - at).mean(0) @ along)
            limits[k].append(Limit(at=at, inward=side * along))
            limits[c].append(Limit(at=at, inward=-side * along))
    return out, [tuple(found) for found in limits]


def _along_axes(surfaces: Sequence[Surface], own: Sequence[FloatArray], tolerance: float, reach: float) -> list[Surface]:
    """The surfaces with planes that would touch a cylinder turned about the middle of their patch so that they run along its axis, where no corner of
    it moves by more than the tolerance. Of many relations one in a hundred is refused by chance; that the patches end at one line is evidence too.
    """
    out = list(surfaces)
    for round_one, arc in zip(surfaces, own, strict=True):
        for k, flat in enumerate(out):
            lean = float(round_one.axis @ flat.axis) if (round_one.kind, flat.kind) == (CYLINDER, PLANE) else 0.0
            if not SQUARE < abs(lean) <= LEANS:
                continue
            axis = flat.axis - lean * round_one.axis
            middle = own[k].mean(0)
            turned = replace(flat, point=middle - float((middle - flat.point) @ flat.axis) * flat.axis, axis=axis / np.linalg.norm(axis))
            moves = np.abs(turned.distance(own[k]) - flat.distance(own[k])).max()
            if moves <= tolerance and _touch(round_one, arc, turned, own[k], tolerance, reach):
                out[k] = turned
    return out


def _line(round_one: Surface, flat: Surface) -> tuple[FloatArray, FloatArray]:
    """A point of the line in which a cylinder touches a plane, and the direction in the plane square to it."""
    height = float((round_one.point - flat.point) @ flat.axis)
    return round_one.point - height * flat.axis, np.cross(round_one.axis, flat.axis)


def _touch(round_one: Surface, arc: FloatArray, flat: Surface, face: FloatArray, tolerance: float, reach: float) -> bool:
    """Do they touch to within the tolerance, along a line at which both patches end, one on either side?"""
    if abs(float(round_one.axis @ flat.axis)) > SQUARE:
        return False
    if abs(abs(float((round_one.point - flat.point) @ flat.axis)) - round_one.radius) > tolerance:
        return False
    at, along = _line(round_one, flat)
    near_arc, near_face = ((points - at) @ along for points in (arc[_beside(arc, at, flat, reach)], face))
    if not len(near_arc):
        return False
    beyond = reach + np.sqrt(2 * round_one.radius * tolerance)  # so far a plane lies within the tolerance of a cylinder that touches it
    on_face = np.sign(near_face.mean())
    meets = min((on_face * near_face).min(), (-on_face * near_arc).min())
    apart = np.abs(near_face).min() + np.abs(near_arc).min()
    along_axis = [((points - at) @ round_one.axis) for points in (arc, face)]
    overlap = min(v.max() for v in along_axis) - max(v.min() for v in along_axis)
    return bool(on_face and meets > -beyond and apart < 2 * beyond and overlap > 0)


def _beside(points: FloatArray, at: FloatArray, flat: Surface, reach: float) -> BoolArray:
    """Which points of an arc are near the plane: of a half round the other end is as far along."""
    return np.asarray(np.abs((points - at) @ flat.axis) <= reach)


def _moved(round_one: Surface, planes: Sequence[Surface], most: float) -> Surface | None:
    """The cylinder changed least so that it touches all the planes; None where that takes more than `most`, or cannot be."""
    height = np.array([(round_one.point - p.point) @ p.axis for p in planes])
    normal = np.array([p.axis for p in planes]) * np.sign(height)[:, None]
    matrix = np.column_stack([normal, -np.ones(len(planes))])
    step = np.linalg.lstsq(matrix, round_one.radius - np.abs(height), rcond=1e-6)[0]
    off = matrix @ step - (round_one.radius - np.abs(height))
    if np.abs(off).max() > EXACT * round_one.radius or np.linalg.norm(step) > most:
        return None
    return replace(round_one, point=round_one.point + step[:3], radius=round_one.radius + float(step[3]))
