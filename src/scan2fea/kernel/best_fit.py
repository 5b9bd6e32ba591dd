"""Points laid onto a drawn surface by a rigid motion, from no start: what metrology calls the best fit.

Many rotations are tried roughly, the nearest of them are improved by least squares of the distances (closest points taken anew in each round:
Besl and McKay 1992; along the way to the closest point: Chen and Medioni 1992), the best stays.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import extent, face_normals
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.transforms import applied, compose, inverse, quaternion_to_matrix, rigid, rotation_about
from scan2fea.types import FloatArray, TriangleMesh, Value

ROTATIONS = 256  # random ones, beside those that lay axis on axis: some 30 degrees from the next
TURN_DEG = 15.0  # steps about each principal axis: of a plate with bolt holes all directions but one are alike
# points, rounds of least squares, how many of the best go on, steps beside these that are tried too
ROUNDS = ((200, 0, 40, 0), (500, 10, 4, 2), (500, 10, 4, 2), (500, 10, 4, 0), (4_000, 40, 1, 0))
ALIKE = 0.01  # of the size: poses that lay the points so near to each other are one
STEP = 0.5  # of that: of a wall seen from one side alone either face lies on the other's place as well, a thickness off
OUTSIDE = 3.0  # standard deviations (of the middle half) beyond which a point does not pull: it may lie on a dent, or on something else
SETTLED = 1e-8  # of the size: a step that changes nothing any more


@dataclass(frozen=True, eq=False, kw_only=True)
class BestFit(Value):
    """T_surface_points : (4, 4).   sigma_m : standard deviation of the distances by their median."""

    T_surface_points: FloatArray
    sigma_m: float


def best_fit(points: FloatArray, surface: TriangleMesh, seed: int = 0, shape: FloatArray | None = None) -> BestFit:
    """The rigid motion that lays (n, 3) points on `surface`; points farther off than three standard deviations do not pull.

    shape : (k, 3) points even over the whole of what was measured, where that is known: what its middle and axes are taken from. Symmetric surfaces
    have several answers as good; the first is given.
    """
    onto, size = PointToMesh(surface), extent(surface.vertices)
    normals = face_normals(surface)
    even = sample_surface(surface, 4_000, seed)[0]
    middle, axes = _frame(even)
    from_middle, from_axes = _frame(points if shape is None else shape)
    starts = [axes @ turn @ from_axes.T for turn in (*_axis_turns(), *_random_turns(seed))]
    poses = [rigid(R, middle - R @ from_middle) for R in starts]
    for n, rounds, kept, steps in ROUNDS:
        own = points[sampled_rows(len(points), n, seed)]
        if rounds:
            poses = [_improved(T, own, onto, normals, size, rounds) for T in poses]
        off = [float(np.minimum(onto.nearest(applied(T, own)).distance, size).mean()) for T in poses]
        poses = _different([poses[k] for k in np.argsort(off, kind="stable")], own, kept, ALIKE * size)
        poses += [compose(rigid(np.eye(3), k * STEP * ALIKE * size * way), T) for T in poses for k in range(-steps, steps + 1) if k for way in axes.T]
    found = onto.nearest(applied(poses[0], points[sampled_rows(len(points), ROUNDS[-1][0], seed)])).distance
    return BestFit(T_surface_points=poses[0], sigma_m=_sigma(found))


def _frame(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middle and (3, 3) principal axes, right-handed, as columns."""
    middle = points.mean(axis=0)
    axes = np.linalg.eigh((points - middle).T @ (points - middle))[1]
    return middle, axes * np.array([1.0, 1.0, np.linalg.det(axes)])


def _different(poses: Sequence[FloatArray], points: FloatArray, kept: int, within_m: float) -> list[FloatArray]:
    """The first of those that lay the points elsewhere."""
    out: list[FloatArray] = []
    for T in poses:
        if all(np.linalg.norm(applied(T, points) - applied(other, points), axis=1).max() > within_m for other in out):
            out.append(T)
        if len(out) == kept:
            break
    return out


def _axis_turns() -> list[FloatArray]:
    """The 24 turns that lay axes on axes (which is the longest is a matter of chance where two are alike), and turns about each axis from there."""
    signs = itertools.product((1.0, -1.0), repeat=3)
    turns = [np.eye(3)[list(order)] * np.array(sign) for sign in signs for order in itertools.permutations(range(3))]
    proper = [turn for turn in turns if np.linalg.det(turn) > 0]
    halves = [np.diag(sign) for sign in ((1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0))]
    steps = np.radians(np.arange(TURN_DEG, 180.0, TURN_DEG))
    return proper + [rotation_about(axis, float(angle)) @ half for axis in np.eye(3) for half in halves for angle in steps]


def _random_turns(seed: int) -> list[FloatArray]:
    return [quaternion_to_matrix(q) for q in np.random.default_rng(seed).standard_normal((ROTATIONS, 4))]


def _sigma(distance: FloatArray) -> float:
    return 1.4826 * float(np.median(distance))


def _improved(T: FloatArray, points: FloatArray, onto: PointToMesh, normals: FloatArray, size: float, rounds: int) -> FloatArray:
    """Steps of Gauss and Newton on the squared distances of the points that pull."""
    for _ in range(rounds):
        at = applied(T, points)
        near = onto.nearest(at)
        pulls = near.distance <= max(OUTSIDE * _sigma(near.distance), SETTLED * size)
        centre = at[pulls].mean(axis=0)
        away = (at - near.closest)[pulls]
        is_on = near.distance[pulls] <= 1e-12 * size
        way = np.where(is_on[:, None], normals[near.face[pulls]], away / np.maximum(near.distance[pulls], 1e-300)[:, None])
        lever = np.cross(at[pulls] - centre, way) / size
        step = np.linalg.lstsq(np.concatenate([lever, way], axis=1), -near.distance[pulls], rcond=1e-6)[0]
        angle = float(np.linalg.norm(step[:3])) / size
        R = rotation_about(step[:3], angle) if angle > 0 else np.eye(3)
        T = compose(rigid(R, centre - R @ centre + step[3:]), T)
        if angle * size + float(np.linalg.norm(step[3:])) < SETTLED * size:
            break
    return T


def as_placed(found: BestFit) -> FloatArray:
    """(4, 4) T_points_surface: where the surface lies among the points."""
    return inverse(found.T_surface_points)
