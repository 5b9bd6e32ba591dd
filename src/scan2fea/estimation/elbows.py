"""Pipes with elbows: laid out straight along their axis they are members as any other, and are bent back once fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scan2fea.kernel.bends import bent, pieces_of, straightened
from scan2fea.kernel.pipe_path import PipePath
from scan2fea.kernel.sections import ROUND
from scan2fea.kernel.transforms import applied, compose, inverse, rigid
from scan2fea.types import Bend, FloatArray, Member

_AWRY = 3.0  # standard deviations of the noise by which the fitted axis may leave the path that its points were laid out along


def laid_out(points: FloatArray, path: PipePath) -> FloatArray:
    """(n, 3) points about a pipe's axis as if it were straight: across, across and along."""
    return straightened(path.bends, applied(inverse(path.T_world_path), points))


def bent_back(member: Member, path: PipePath) -> Member | None:
    """The member of points that were laid out straight, where it is; None where it is not round, or does not run along the path past all bends."""
    T = np.asarray(member.T_world_member)
    length = member.values()["length"]
    if member.family not in ROUND or member.change is not None or member.bow.any():
        return None
    if T[2, 2] < 0:  # found the other way round
        T = T @ rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, length]))
        normals = np.asarray(member.end_normals)[::-1] * [1.0, -1.0, -1.0]
        member = replace(member, T_world_member=T, end_normals=normals)
    ends = np.array([T[:2, 3], T[:2, 3] + length * T[:2, 2]])
    if np.linalg.norm(ends, axis=1).max() > _AWRY * member.sigma_m + 1e-3 * member.values()["d"]:
        return None
    start = float(T[2, 3])
    bends = tuple(replace(bend, start_m=bend.start_m - start) for bend in path.bends)
    if bends[0].start_m < 0 or bends[-1].start_m + bends[-1].length_m > length:
        return None
    T_world = compose(path.T_world_path, rigid(np.eye(3), np.array([0.0, 0.0, start])))
    damage = tuple(replace(d, position_m=_in_world(path, np.asarray(d.position_m))) for d in member.damage)
    normals = np.asarray(member.end_normals) @ T[:3, :3].T
    return replace(_longer_in_doubt(member, bends), T_world_member=T_world, end_normals=normals, bends=bends, damage=damage)


def _in_world(path: PipePath, place: FloatArray) -> FloatArray:
    return np.asarray(applied(path.T_world_path, bent(path.bends, place[None]))[0])


def _longer_in_doubt(member: Member, bends: Sequence[Bend]) -> Member:
    """The member whose length is uncertain by its bends too: corners are held, and an arc between them is shorter by (2 tan(a / 2) - a) dR."""
    at = len(member.parameters) - 1
    p = member.parameters[at]
    if p.std_m is None:
        return member
    slack = sum(((2 * math.tan(b.angle_rad / 2) - b.angle_rad) * b.radius_std_m) ** 2 for b in bends)
    covariance = np.array(member.covariance)
    covariance[at, at] += slack
    return replace(member, covariance=covariance, parameters=(*member.parameters[:at], replace(p, std_m=math.hypot(p.std_m, math.sqrt(slack)))))


def runs_of(member: Member) -> tuple[Member, ...]:
    """A pipe with elbows as straight members from corner to corner, as a wireframe has it; any other member as it is."""
    if not member.bends:
        return (member,)
    T, length = np.asarray(member.T_world_member), member.values()["length"]
    runs = [piece for piece in pieces_of(member.bends) if piece.bend is None]
    cut = [0.0, *(b.radius_m * math.tan(b.angle_rad / 2) for b in member.bends), 0.0]
    begins = np.array([0.0, *(b.start_m + b.length_m for b in member.bends)])
    straight = (np.array([*(b.start_m for b in member.bends), length]) - begins).tolist()
    square = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    out = []
    for piece, before, after, run in zip(runs, cut[:-1], cut[1:], straight, strict=True):
        frame = compose(T, rigid(piece.turn, piece.origin), rigid(np.eye(3), np.array([0.0, 0.0, -before])))
        parameters = tuple(replace(p, value_m=before + run + after) if p.name == "length" else p for p in member.parameters)
        out.append(replace(member, T_world_member=frame, parameters=parameters, bends=(), end_normals=square, damage=()))
    return tuple(out)
