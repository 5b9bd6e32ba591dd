"""The kind of an object, guessed from its points: I, L, pipe, box, ... with a calibrated probability, or "unknown" below a stated one.

A guess informs the report and `[select]`; what an object is modelled as is decided by estimation alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.segmentation.canonical import look_at
from scan2fea.segmentation.network import Array, Parameters, logits, softmax
from scan2fea.types import FloatArray, IntArray, PointCloud, Segments, Value

OBJECT_KINDS = ("plate", "I", "L", "C", "T", "box", "pipe", "free form", "clutter")
SUPPORT_KINDS = ("floor", "wall")
UNKNOWN = "unknown"
LEAST_CONFIDENCE = 0.6
_LEVEL, _UPRIGHT = 0.8, 0.3  # cosines of a support's normal with the vertical: a floor, a wall


@dataclass(frozen=True, eq=False, kw_only=True)
class KindNetwork(Value):
    """kinds : names of its classes.   temperature : its logits are divided by this, so that its 0.9 means 0.9.   params : of `network`."""

    kinds: tuple[str, ...]
    params: Parameters
    temperature: float


@dataclass(frozen=True, kw_only=True)
class Guess:
    """kind : of the object, "unknown" where the best one is less than 0.6 likely.   confidence : probability of the best kind (nan: not judged).

    source : "network", "support" (its plane tells), "user" (labels.csv), "mesh".
    """

    kind: str
    confidence: float
    source: str = "network"


def kind_probabilities(network: KindNetwork, grids: Array, extras: Array) -> FloatArray:
    """(n, kinds) calibrated; the mean over the four mirror images of the section."""
    total = np.zeros((len(grids), len(network.kinds)))
    for first in (1, -1):
        for second in (1, -1):
            seen = np.ascontiguousarray(grids[:, ::first, ::second])
            total += softmax(logits(network.params, seen, extras) / network.temperature)
    return np.asarray(total / 4)


def guess_kinds(network: KindNetwork, objects: Sequence[FloatArray], seed: int = 0) -> list[Guess]:
    """One guess per object, each given by its points (n, 3)."""
    looks = [look_at(points, seed) for points in objects]
    told = [k for k, look in enumerate(looks) if look is not None]
    out = [Guess(kind=UNKNOWN, confidence=float("nan"))] * len(objects)
    if not told:
        return out
    grids = np.stack([look.grid for look in looks if look is not None])
    extras = np.stack([look.extra for look in looks if look is not None])
    for k, row in zip(told, kind_probabilities(network, grids, extras), strict=True):
        best = int(row.argmax())
        sure = row[best] >= LEAST_CONFIDENCE
        out[k] = Guess(kind=network.kinds[best] if sure else UNKNOWN, confidence=float(row[best]))
    return out


def segment_kinds(network: KindNetwork, cloud: PointCloud, segments: Segments, seed: int = 0) -> tuple[Guess, ...]:
    """One guess per segment: supports by the direction of their plane, all others by the network.

    Up is z; where supports stand but none of them is level, it is the normal of the one with most points: the scan's own up is another axis then.
    """
    own = [cloud.points[segments.labels == label] for label in range(len(segments.kinds))]
    is_support = [kind == "support" for kind in segments.kinds]
    named = iter(guess_kinds(network, [p for p, support in zip(own, is_support, strict=True) if not support], seed))
    normals = [_normal(p) for p, support in zip(own, is_support, strict=True) if support]
    up = _up(normals, [len(p) for p, support in zip(own, is_support, strict=True) if support])
    kinds = iter(_support_kind(normal, up) for normal in normals)
    return tuple(next(kinds) if support else next(named) for support in is_support)


def _normal(points: FloatArray) -> FloatArray:
    """(3,) of the plane through a support's points; nan for fewer than three."""
    if len(points) < 3:
        return np.full(3, np.nan)
    local = points - points.mean(axis=0)
    normal: FloatArray = np.linalg.eigh(local.T @ local)[1][:, 0]
    return normal


def _up(normals: Sequence[FloatArray], n_points: Sequence[int]) -> FloatArray:
    z = np.array([0.0, 0.0, 1.0])
    stand = [k for k, normal in enumerate(normals) if np.isfinite(normal).all()]
    if not stand or any(abs(float(normals[k] @ z)) >= _LEVEL for k in stand):
        return z
    return normals[max(stand, key=lambda k: n_points[k])]


def _support_kind(normal: FloatArray, upward: FloatArray) -> Guess:
    """Floor (and table tops) or wall; what leans between is told as a support of no kind."""
    if not np.isfinite(normal).all():
        return Guess(kind=UNKNOWN, confidence=float("nan"), source="support")
    up = abs(float(normal @ upward))
    kind = SUPPORT_KINDS[0] if up >= _LEVEL else SUPPORT_KINDS[1] if up <= _UPRIGHT else UNKNOWN
    return Guess(kind=kind, confidence=float("nan"), source="support")


def fitted_temperature(raw: FloatArray, label: IntArray) -> float:
    """The temperature that makes the labels (n,) most likely under softmax(raw / T) (Guo et al. 2017): golden section over log T in 0.2 .. 5."""
    low, high = np.log(0.2), np.log(5.0)
    ratio = (np.sqrt(5.0) - 1) / 2

    def cost(t: float) -> float:
        p = softmax(raw / np.exp(t))
        return -float(np.log(np.maximum(p[np.arange(len(label)), label], 1e-12)).mean())

    for _ in range(40):
        a, b = high - ratio * (high - low), low + ratio * (high - low)
        low, high = (low, b) if cost(a) < cost(b) else (a, high)
    return float(np.exp((low + high) / 2))

