"""A straight member bent into runs and circular arcs, and points around such a pipe laid out straight again.

Both ways keep the distance of every point from the axis, so that a section is not distorted; a volume keeps its size wherever its centroid lies on
the axis (Pappus).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.types import Bend, FloatArray, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece(Value):
    """A run (bend None) or an arc of the axis, from `start_m` to `end_m` along it.

    origin : (3,), turn : (3, 3) columns x, y, z of the frame in which it begins.
    """

    start_m: float
    end_m: float
    origin: FloatArray
    turn: FloatArray
    bend: Bend | None


def pieces_of(bends: Sequence[Bend]) -> list[Piece]:
    """Runs and arcs in turn, the first run from minus infinity, the last one to infinity."""
    origin, turn, at = np.zeros(3), np.eye(3), 0.0
    out = []
    for bend in bends:
        out.append(Piece(start_m=at, end_m=bend.start_m, origin=origin, turn=turn, bend=None))
        origin, at = origin + (bend.start_m - at) * turn[:, 2], bend.start_m
        out.append(Piece(start_m=at, end_m=at + bend.length_m, origin=origin, turn=turn, bend=bend))
        inward = turn @ _inward(bend)
        sine, cosine = np.sin(bend.angle_rad), np.cos(bend.angle_rad)
        origin = origin + bend.radius_m * (sine * turn[:, 2] + (1 - cosine) * inward)
        turn = turn @ _turned(bend, bend.angle_rad)
        at += bend.length_m
    out.append(Piece(start_m=at, end_m=np.inf, origin=origin, turn=turn, bend=None))
    out[0] = Piece(start_m=-np.inf, end_m=out[0].end_m, origin=np.zeros(3), turn=np.eye(3), bend=None)
    return out


def bent(bends: Sequence[Bend], straight: FloatArray) -> FloatArray:
    """(..., 3) places of a straight member (x, y, way along it) on the bent one, both in the frame of its first end."""
    local = straight.reshape(-1, 3)
    out = np.empty_like(local)
    for piece in pieces_of(bends):
        own = (local[:, 2] >= piece.start_m) & (local[:, 2] <= piece.end_m)
        if piece.bend is None:
            begin = piece.start_m if np.isfinite(piece.start_m) else 0.0
            out[own] = piece.origin + (local[own] - [0.0, 0.0, begin]) @ piece.turn.T
        else:
            out[own] = piece.origin + _on_arc(piece.bend, local[own] - [0.0, 0.0, piece.start_m]) @ piece.turn.T
    return out.reshape(straight.shape)


def straightened(bends: Sequence[Bend], points: FloatArray) -> FloatArray:
    """(n, 3) x, y and way along the axis of points (n, 3) about the bent member, of the piece whose axis is nearest."""
    best, out = np.full(len(points), np.inf), np.empty_like(points)
    for piece in pieces_of(bends):
        local = (points - piece.origin) @ piece.turn
        begin = piece.start_m if np.isfinite(piece.start_m) else 0.0
        if piece.bend is not None:
            local = _off_arc(piece.bend, local)
        way = local[:, 2] + begin
        beyond = way - np.clip(way, piece.start_m, piece.end_m)
        away = local[:, 0] ** 2 + local[:, 1] ** 2 + beyond**2
        nearer = away < best
        best[nearer] = away[nearer]
        out[nearer] = np.column_stack([local[nearer, :2], way[nearer]])
    return out


def _inward(bend: Bend) -> FloatArray:
    return np.array([np.cos(bend.roll_rad), np.sin(bend.roll_rad), 0.0])


def _turned(bend: Bend, angle: float) -> FloatArray:
    """(3, 3) the frame at an angle of the arc, in that of its beginning."""
    inward = _inward(bend)
    along = np.array([0.0, 0.0, 1.0])
    about = np.cross(along, inward)
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.asarray(np.outer(about, about) + cosine * (np.eye(3) - np.outer(about, about)) + sine * _cross(about))


def _cross(about: FloatArray) -> FloatArray:
    x, y, z = about
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _on_arc(bend: Bend, local: FloatArray) -> FloatArray:
    """x, y, way along the arc -> place in the frame of its beginning."""
    inward = _inward(bend)
    beside = np.array([-inward[1], inward[0], 0.0])
    angle = local[:, 2] / bend.radius_m
    reach = bend.radius_m - local @ inward  # from the line about which it turns
    across = bend.radius_m - reach * np.cos(angle)
    out: FloatArray = across[:, None] * inward + (local @ beside)[:, None] * beside
    out[:, 2] = reach * np.sin(angle)
    return out


def _off_arc(bend: Bend, local: FloatArray) -> FloatArray:
    """The way back of `_on_arc`; angles from half a turn before its middle to half a turn after."""
    inward = _inward(bend)
    beside = np.array([-inward[1], inward[0], 0.0])
    across = bend.radius_m - local @ inward
    middle = 0.5 * bend.angle_rad
    angle = middle + np.angle(np.exp(1j * (np.arctan2(local[:, 2], across) - middle)))
    off = bend.radius_m - np.hypot(across, local[:, 2])
    out: FloatArray = off[:, None] * inward + (local @ beside)[:, None] * beside
    out[:, 2] = bend.radius_m * angle
    return out
