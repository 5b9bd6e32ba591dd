"""What the doubt of the scanners' places makes of a member's dimensions: each frame's through the derivative of the fit by a move of its points.

A fit to the nearest faces answers a small move of the points of one frame linearly: one Gauss-Newton step of the distances. A dimension that two
frames tell takes a part of the error of each; one that a frame measured on both sides takes none, and all frames moved together move the member.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import StageError
from scan2fea.estimation.field import ResidualField, in_section, residual_field
from scan2fea.estimation.solid import Solid, solid_of
from scan2fea.kernel.coordinate_steps import noise_before, rounding_std
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.sections import PARAMETERS, ROUND, corner_factors, edge_names, section
from scan2fea.kernel.sweep import axis_at
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.types import BoolArray, FloatArray, IntArray, Member, PointCloud, Value

_POINTS = 20_000
_REACH = 3.0  # standard deviations from a face beyond which points say nothing of it: they are on an end, or on something else
_NULL = 1e-9  # of the largest eigenvalue: what no face holds
_SURER = 3.0  # a dimension whose deviation in the fit is so much smaller than faces allow was told by something else (an edge, a bound)
_LAST, _LEAST = 0.01, 20  # share and number of the points that tell an end
_ALONE = 0.9  # of them: the rest are strays


@dataclass(frozen=True, kw_only=True)
class FramePose(Value):
    """Of one frame: the place that it turns about (m), standard deviations of its place and turn, all three axes together."""

    frame: int
    centre_m: tuple[float, float, float]
    std_m: float
    std_rad: float

    @property
    def variances(self) -> FloatArray:
        """(6,) of its turn about each axis (rad2) and of its place along each (m2)."""
        return np.repeat([self.std_rad**2 / 3, self.std_m**2 / 3], 3)


@dataclass(frozen=True, kw_only=True)
class PoseDoubt(Value):
    """What is not known of the places from which an object was seen. frames : those that saw it and may be off.

    between_m : standard deviation along one axis of the difference of two of its points that different frames or moments measured.   moments_m : the
    part of it that comes from scanners that moved while they scanned; how errors of moments go together is not known.
    """

    frames: tuple[FramePose, ...] = ()
    between_m: float = 0.0
    moments_m: float = 0.0


def widened(member: Member, cloud: PointCloud, doubt: PoseDoubt, face_m: float = 0.0) -> Member:
    """The member whose estimated dimensions are uncertain by the poses too.

    face_m : by how much the fit has found each face to be off as a whole. That is what errors of poses look like in the points, and every dimension
    of the section has twice its square in its variance already: the larger of the two is told, not their sum.
    """
    if not doubt.between_m > 0:
        return member
    more = _covariance(member, cloud, doubt)
    had = np.array([0.0 if p.name == "length" else 2 * face_m**2 for p in member.parameters])
    left = np.sqrt(np.clip(1.0 - had / np.maximum(np.diag(more), 1e-300), 0.0, None))
    more = more * np.outer(left, left)
    known = np.array([p.std_m is not None for p in member.parameters])
    estimated = known & (np.diag(member.covariance) > 0)
    covariance = member.covariance + np.where(np.outer(estimated, estimated), more, 0.0)
    std = np.sqrt(np.diag(more))
    parameters = tuple(
        p if p.std_m is None else replace(p, std_m=math.hypot(p.std_m, float(std[k]))) for k, p in enumerate(member.parameters)
    )
    return replace(member, parameters=parameters, covariance=covariance)


def coarsened(member: Member, step_m: float) -> Member:
    """The member whose estimated dimensions, each between two faces, are uncertain by coordinates that were rounded to whole steps too."""
    more = 2.0 * rounding_std(step_m, noise_before(member.sigma_m, step_m)) ** 2
    if not more > 0.0:
        return member
    estimated = np.array([p.std_m is not None for p in member.parameters]) & (np.diag(member.covariance) > 0)
    parameters = tuple(p if p.std_m is None else replace(p, std_m=math.hypot(p.std_m, math.sqrt(more))) for p in member.parameters)
    return replace(member, parameters=parameters, covariance=member.covariance + more * np.diag(estimated.astype(float)))


def _covariance(member: Member, cloud: PointCloud, doubt: PoseDoubt) -> FloatArray:
    """(p, p) of the dimensions, m2, from the poses. Those that no face tells take the doubt whole, each by itself."""
    n = len(member.parameters)
    answer = None if member.change is not None or not doubt.frames else _answers(member, cloud, doubt)
    if answer is None:
        return np.asarray(doubt.between_m**2 * np.eye(n))
    slope, is_told, of_ends = answer
    more = np.diag([of_ends if p.name == "length" else 0.0 for p in member.parameters])
    for S, frame in zip(slope, doubt.frames, strict=True):
        more += (S * frame.variances) @ S.T
    more[~is_told], more[:, ~is_told] = 0.0, 0.0
    return np.asarray(more + np.diag(np.where(is_told, doubt.moments_m**2, doubt.between_m**2)))


def _answers(member: Member, cloud: PointCloud, doubt: PoseDoubt) -> tuple[FloatArray, BoolArray, float] | None:
    """Per frame (p, 6) by how much each dimension changes with a turn (rad) and a shift (m) of its points; which (p,) dimensions faces tell; variance
    of the length beside that (m2).
    """
    try:
        solid = solid_of(member)
    except StageError:
        return None
    rows = np.flatnonzero(cloud.frame >= 0)
    rows = rows[sampled_rows(len(rows), _POINTS, 0)]
    points, frame = cloud.points[rows], cloud.frame[rows]
    J, normal, field = design(member, solid, points)
    off = field.off_m
    scatter = max(member.sigma_m, 1.4826 * float(np.median(np.abs(off))))
    on = np.abs(off) <= _REACH * scatter
    scale = np.sqrt((J[on] ** 2).sum(axis=0))
    scale[scale == 0] = 1.0
    values, axes = np.linalg.eigh((J[on] / scale).T @ (J[on] / scale))
    held = values > _NULL * values[-1]
    gain = (axes[:, held] / values[held]) @ axes[:, held].T / np.outer(scale, scale)
    names = list(PARAMETERS[member.family])
    place = {p.name: k for k, p in enumerate(member.parameters)}
    slope, is_told, of_ends = np.zeros((len(doubt.frames), len(place), 6)), np.zeros(len(place), bool), 0.0
    for i, name in enumerate(names):
        std = member.parameters[place[name]].std_m
        free = float((axes[i, ~held] ** 2).sum()) > _NULL
        is_told[place[name]] = not free and std is not None and scatter * math.sqrt(gain[i, i]) <= _SURER * std
    at = [place[name] for name in names]
    for k, one in enumerate(doubt.frames):
        own = on & (frame == one.frame)
        move = np.concatenate([np.cross(points[own] - one.centre_m, normal[own]), normal[own]], axis=1)
        slope[k, at] = -(gain @ (J[own].T @ move))[: len(names)]
    if "length" in place:
        slope[:, place["length"]], of_ends = _of_length(member, solid, points, frame, doubt)
        is_told[place["length"]] = True
    return slope, is_told, of_ends


def design(member: Member, solid: Solid, points: FloatArray) -> tuple[FloatArray, FloatArray, ResidualField]:
    """Per point the derivatives of its distance from its face by the dimensions, by place, tilt and bow of the axis in x and y, by roll and twist;
    the normal (n, 3) of that face in the world; the distances and faces.
    """
    field = residual_field(points, solid)
    local = applied(inverse(solid.sweep.T_world_member), points)
    xy, zeta = in_section(solid, local), 2 * local[:, 2] / solid.sweep.length_m - 1
    by_size, across = _faces(member, field.names, field.face, xy)
    roll = axis_at(solid.sweep, local[:, 2])[1]
    cos, sin = np.cos(roll), np.sin(roll)
    turned = np.stack([cos * across[:, 0] - sin * across[:, 1], sin * across[:, 0] + cos * across[:, 1]], axis=1)
    wave = np.polynomial.legendre.legvander(zeta, max(solid.sweep.bow.shape[1] + 1, len(solid.sweep.twist), 1))
    bows, twists = wave[:, : max(solid.sweep.bow.shape[1] + 2, 2)], wave[:, : len(solid.sweep.twist) + 1]
    lever = xy[:, 0] * across[:, 1] - xy[:, 1] * across[:, 0]
    J = np.concatenate([-by_size, -turned[:, :1] * bows, -turned[:, 1:] * bows, -lever[:, None] * twists], axis=1)
    normal = np.concatenate([turned, np.zeros((len(turned), 1))], axis=1) @ solid.sweep.T_world_member[:3, :3].T
    return J, normal, field


def _faces(member: Member, names: tuple[str, ...], face: IntArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Per point (n, p) by how much its face moves outwards with each dimension, and the outward normal (n, 2) of it in the section."""
    size = {name: member.values()[name] for name in PARAMETERS[member.family]}
    if member.family in ROUND:
        outward = xy / np.maximum(np.linalg.norm(xy, axis=1, keepdims=True), 1e-300)
        is_outer = np.array([name == "OUTER" for name in names])[face]
        moves = np.where(is_outer[:, None], [0.5, 0.0], [-0.5, 1.0])[:, : len(size)]
        return moves, np.where(is_outer[:, None], outward, -outward)
    moves, normals = np.zeros((len(names), len(size))), np.zeros((len(names), 2))
    for loop, factors, own in zip(section(member.family, size).loops, corner_factors(member.family), edge_names(member.family), strict=True):
        way = np.roll(loop, -1, axis=0) - loop
        outward = np.stack([way[:, 1], -way[:, 0]], axis=1) / np.linalg.norm(way, axis=1, keepdims=True)
        for k, name in enumerate(own):
            normals[names.index(name)], moves[names.index(name)] = outward[k], outward[k] @ factors[k]
    return moves[face], normals[face]


def _of_length(member: Member, solid: Solid, points: FloatArray, frame: IntArray, doubt: PoseDoubt) -> tuple[FloatArray, float]:
    """(k, 6) by how much the length changes with a move of each frame that alone tells an end; variance (m2) of the ends that several tell.

    Of several the one that reaches out farthest or saw the end face tells it, whichever that was, and the other end another one.
    """
    axis = solid.sweep.T_world_member[:3, 2]
    z = applied(inverse(solid.sweep.T_world_member), points)[:, 2]
    slope, variance = np.zeros((len(doubt.frames), 6)), 0.0
    for sign, end in ((-1.0, 0.0), (1.0, solid.sweep.length_m)):
        away = np.abs(z - end)
        count = min(max(_LEAST, round(_LAST * len(z))), len(z)) - 1
        last = away <= max(_REACH * member.sigma_m, float(np.partition(away, count)[count]))
        is_alone = np.unique(frame[last], return_counts=True)[1].max() >= _ALONE * last.sum()
        for k, one in enumerate(doubt.frames):
            own = last & (frame == one.frame)
            move = np.concatenate([np.cross(points[own] - one.centre_m, axis), np.tile(axis, (int(own.sum()), 1))], axis=1)
            if is_alone:
                slope[k] += sign * move.sum(axis=0) / last.sum()
            else:
                variance += float((move**2 @ one.variances).sum() / last.sum())
    return slope, variance
