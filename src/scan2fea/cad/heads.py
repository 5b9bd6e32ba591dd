"""Heads of vessels: conics that run smoothly into the cylinder beside them, and begin at one height where the points do not refuse that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.cad.meridian import LEAST_POINTS, PARALLEL, REFUSES, Piece, is_smooth
from scan2fea.types import FloatArray, IntArray, Value

ROUNDS = 20


@dataclass(frozen=True, eq=False, kw_only=True)
class Head(Value):
    """A conic r^2 = R^2 + C (z - z0)^2.

    piece : its number.   radius : R of its shell.   used : (n, 2) points it is fitted to.   z0, std : where it is widest, and how well that is known.
    c_std : of C.
    """

    piece: int
    radius: float
    used: FloatArray
    z0: float
    std: float
    c: float
    c_std: float

    def opens(self) -> bool:
        """Whether it lies towards greater z of its widest place."""
        return bool(np.median(self.used[:, 0]) > self.z0)

    def pole_std(self) -> float:
        """How well the place is known where it meets the axis, sqrt(-R^2 / C) from z0."""
        return float(self.radius * self.c_std / (2 * abs(self.c) ** 1.5)) if self.c < 0 else np.inf


def smoothed(pieces: Sequence[Piece], samples: FloatArray, points: FloatArray, owner: IntArray, reach: float, slack: float) -> list[Piece] | None:
    """Conics that run smoothly into cylinders get their widest place there; None where other pieces run smoothly into each other.

    points : (n, 2) measured, z and r.   owner : (n,) the sample each is nearest to.   slack : of the width where a head runs into a shell.
    """
    out = list(pieces)
    n, closed = len(out), bool((samples[0] == samples[-1]).all())
    heads: list[Head] = []
    for k in range(n if closed else n - 1):
        a, b = out[k], out[(k + 1) % n]
        if not is_smooth(a, b, samples[a.last], slack):
            continue
        i, j = (k, (k + 1) % n) if a.kind == "conic" else ((k + 1) % n, k)
        head, shell = out[i], out[j]
        if head.kind != "conic" or shell.kind != "line" or abs(shell.values[0]) > PARALLEL:
            return None
        radius = float(shell.values[2] / shell.values[1])
        margin = max(1, (head.last - head.first) // 20)
        used = points[(owner >= head.first + margin) & (owner <= head.last - margin)]
        is_told = len(used) >= LEAST_POINTS
        used = used if is_told else samples[head.first : head.last + 1]
        c = float(head.values[2])
        z0, c, std, c_std = _descended(used, radius, float(-head.values[1] / (2 * c)) if c else float(used[:, 0].mean()), c, (True, True))
        heads.append(Head(piece=i, radius=radius, used=used, z0=z0, std=std if is_told else reach, c=c, c_std=c_std))
        out[j] = replace(shell, values=np.array([0.0, 1.0, radius]))
    for h in _level(heads):
        c = h.c
        if h.pole_std() > slack:  # a strip beside the shell was measured: the rest is as it was guessed
            c = _descended(samples[out[h.piece].first : out[h.piece].last + 1], h.radius, h.z0, h.c, (False, True))[1]
        if c >= 0:
            return None
        out[h.piece] = replace(out[h.piece], values=np.array([h.radius**2 + c * h.z0**2, -2 * c * h.z0, c]))
    return out


def _level(heads: Sequence[Head]) -> list[Head]:
    """Heads that lie to one side get one height, the mean, where they differ by chance (p > 0.01): of the inside of a bottom little is seen."""
    out = sorted(heads, key=lambda h: (h.std, h.piece))
    left = list(range(len(out)))
    while left:
        group = [left.pop(0)]
        for k in list(left):
            weight = np.array([1 / max(out[j].std, 1e-12) ** 2 for j in group])
            mean = float(weight @ [out[j].z0 for j in group] / weight.sum())
            if out[k].opens() == out[group[0]].opens() and abs(out[k].z0 - mean) <= REFUSES * np.sqrt(out[k].std ** 2 + 1 / weight.sum()):
                group.append(k)
                left.remove(k)
        if len(group) > 1:
            weight = np.array([1 / max(out[j].std, 1e-12) ** 2 for j in group])
            mean = float(weight @ [out[j].z0 for j in group] / weight.sum())
            for k in group:
                _, c, _, c_std = _descended(out[k].used, out[k].radius, mean, out[k].c, (False, True))
                out[k] = replace(out[k], z0=mean, c=c, c_std=c_std)
    return out


def _descended(used: FloatArray, radius: float, z0: float, c: float, free: tuple[bool, bool]) -> tuple[float, float, float, float]:
    """Gauss-Newton for z0 and C of r^2 = R^2 + C (z - z0)^2 by distances to first order; and their standard deviations. free : of the two."""
    z, r = used.T
    columns = np.flatnonzero(free)
    for _ in range(ROUNDS):
        f = r * r - radius**2 - c * (z - z0) ** 2
        size = np.maximum(np.hypot(2 * r, 2 * c * (z - z0)), 1e-3 * radius)
        J = np.column_stack([2 * c * (z - z0), -((z - z0) ** 2)]) / size[:, None]
        step = np.zeros(2)
        step[columns] = np.linalg.lstsq(J[:, columns], -f / size, rcond=None)[0]
        z0, c = z0 + float(step[0]), c + float(step[1])
        if np.abs(step).max() < 1e-12:
            break
    spread = float(np.sum((f / size) ** 2)) / max(len(used) - len(columns), 1)
    std = np.zeros(2)
    std[columns] = np.sqrt(spread * np.diag(np.linalg.pinv(J[:, columns].T @ J[:, columns])))
    return z0, c, float(std[0]), float(std[1])
