"""Surfaces that pass into each other without an angle, made to touch exactly: all at once, each moved as little as its covariance asks.

Where two surfaces touch along a line their distances from a place on it are equal. That place is found by sliding across the border to where the
normals agree; that the distances agree there is one linear equation in the steps of both surfaces, and the steps are those of least chi-square.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.cad.extruded import EXTRUDED
from scan2fea.cad.network import Chain, Network, smoothed
from scan2fea.kernel.polylines import evenly
from scan2fea.kernel.surfaces import PLANE, TORUS, Surface, moved, slopes
from scan2fea.kernel.topology import edge_table
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value

SMOOTH = float(np.cos(np.radians(30.0)))  # a small cylinder that misses its plane by the noise meets it so
PLACES = 7  # along a border
SIGMAS = 4.0  # by which two surfaces that touch may miss each other
MOST = 0.6  # of the places of a border
PART = 2  # places at one end of it
SLIDES = 12
ROUNDS = 10
FIRST, LAST, FALL = 3e-2, 1e-3, 0.3  # mm: how closely the equations are asked for, round by round
LOUD = 20.0  # times that: an equation farther off speaks no louder
REFUSED = 0.05  # of the tolerance: a border that is still farther from touching does not touch
LEFT = 0.5  # of the worst: what misses by more is left in one round


@dataclass(frozen=True, eq=False, kw_only=True)
class Touch(Value):
    """A border without an angle. chain : its number.   at, across : (n, 3) places on it, and the way across.   most : how far these may slide."""

    chain: int
    first: int
    second: int
    at: FloatArray
    across: FloatArray
    most: float


def touches_of(
    mesh: TriangleMesh, network: Network, surfaces: Sequence[Surface], covariances: Sequence[FloatArray], tolerance: float, spacing: float
) -> list[Touch]:
    """The borders along which two surfaces touch as far as their covariances tell, or half the tolerance."""
    out = []
    for number, chain in enumerate(network.chains):
        first, second = int(network.surface[chain.left]), int(network.surface[chain.right])
        if first == second or min(first, second) < 0 or surfaces[first].kind == surfaces[second].kind == PLANE:
            continue
        a, b = surfaces[first], surfaces[second]
        if EXTRUDED in (a.kind, b.kind):  # as the points have it
            continue
        line = smoothed(mesh.vertices[chain.vertices])
        at = evenly(line, PLACES)
        if float(np.median(np.einsum("ij,ij->i", a.normals(at), b.normals(at)))) < SMOOTH:
            continue
        across = _across(a, b, at, np.gradient(at, axis=0))
        most = float(np.sqrt(2 * sharpest(a, b) * tolerance)) + 2 * spacing
        inner = slice(None) if (line[0] == line[-1]).all() else slice(1, -1)
        touch = Touch(chain=number, first=first, second=second, at=at[inner], across=across[inner], most=most)
        place = _slid(touch, a, b)
        variance = sum(
            np.einsum("ij,jk,ik->i", slopes(surfaces[k], place), covariances[k], slopes(surfaces[k], place)) for k in (first, second)
        )  # fmt: skip
        limit = np.maximum(SIGMAS * np.sqrt(variance), tolerance / 2)
        good = (np.abs(a.distance(place) - b.distance(place)) <= limit) & (np.linalg.norm(place - touch.at, axis=1) <= most)
        if good.mean() > MOST:
            out.append(touch)
        elif good.sum() >= PART and np.flatnonzero(np.diff(good)).size == 1:  # up to a cusp, from which on they part
            out.append(replace(touch, at=touch.at[good], across=touch.across[good]))
    return out


def sharpest(a: Surface, b: Surface) -> float:
    """The smaller radius of two surfaces, of which one is round."""
    return min(s.second if s.kind == TORUS else s.radius for s in (a, b) if s.kind != PLANE)


def _slid(touch: Touch, a: Surface, b: Surface) -> FloatArray:
    """The places moved across the border to where the normals of both surfaces agree, half way between them."""
    at, step = touch.at.copy(), 1e-3 * touch.most
    for _ in range(SLIDES):
        apart, more, less = (
            np.einsum("ij,ij->i", a.normals(x) - b.normals(x), touch.across) for x in (at, at + step * touch.across, at - step * touch.across)
        )
        bends = (more - less) / (2 * step)
        flat = np.abs(bends) < 1e-6 / touch.most
        slide = np.where(flat, 0.0, -apart / np.where(flat, 1.0, bends)).clip(-touch.most / 3, touch.most / 3)
        at = at + slide[:, None] * touch.across
        normal = a.normals(at) + b.normals(at)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        at = at - (0.5 * (a.distance(at) + b.distance(at)))[:, None] * normal
        if float(np.abs(slide).max()) < 1e-9 * touch.most:
            break
    return at


def made_to_touch(
    surfaces: Sequence[Surface], covariances: Sequence[FloatArray], touches: Sequence[Touch], tolerance: float
) -> tuple[list[Surface], list[Touch]]:
    """The surfaces moved so that they touch, and the borders where they do. Those that miss most are left first: two that do not touch (rounds that
    noise lets meet beside their ball) keep others, which they are asked with, from it.
    """
    limit, kept = REFUSED * tolerance + 1e-5, list(touches)
    while kept:
        now, gaps = _joint(surfaces, covariances, kept, LAST)
        worst = max(gaps)
        if worst <= limit:
            return now, kept
        kept = [touch for touch, gap in zip(kept, gaps, strict=True) if gap <= max(limit, LEFT * worst)]
    return list(surfaces), []


def _joint(
    surfaces: Sequence[Surface], covariances: Sequence[FloatArray], touches: Sequence[Touch], closely: float
) -> tuple[list[Surface], list[float]]:
    """Least sum of squares of the steps, in standard deviations, with the equations; and by how much each border misses."""
    roots = [_root(c) for c in covariances]
    first = np.append(0, np.cumsum([root.shape[1] for root in roots]))
    steps: FloatArray = np.zeros(int(first[-1]))
    now = list(surfaces)
    gaps: list[float] = []
    for number in range(ROUNDS):
        rows, off = [], []
        for touch in touches:
            a, b = now[touch.first], now[touch.second]
            place = _slid(touch, a, b)
            row = np.zeros((len(place), len(steps)))
            for sign, k in ((1.0, touch.first), (-1.0, touch.second)):  # in the frame that the steps are counted in
                row[:, first[k] : first[k + 1]] += sign * surfaces[k].sense * slopes(surfaces[k], place) @ roots[k]
            rows.append(row)
            off.append(a.distance(place) - b.distance(place))
        gaps = [float(np.abs(gap).max()) for gap in off]
        if max(gaps) < 1e-8:
            break
        J, gap = np.concatenate(rows), np.concatenate(off)
        sigma = max(FIRST * FALL**number, closely)
        w = np.minimum(1.0, LOUD * sigma / np.maximum(np.abs(gap), 1e-300)) / sigma**2
        steps = np.asarray(np.linalg.solve((J * w[:, None]).T @ J + np.eye(len(steps)), J.T @ (w * (J @ steps - gap))), float)
        now = [moved(s, roots[k] @ steps[first[k] : first[k + 1]]) if s.kind != EXTRUDED else s for k, s in enumerate(surfaces)]
    return now, gaps


def _root(covariance: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def sided(mesh: TriangleMesh, label: IntArray, chains: Sequence[Chain], touches: Sequence[Touch], surfaces: Sequence[Surface]) -> IntArray:
    """Labels with the faces beyond the line along which two surfaces touch given to the other of them: on either side of it noise lets neither tell.

    label : (m,) surface of each face.   surfaces : made to touch.
    """
    label, centres, of = label.copy(), mesh.vertices[mesh.faces].mean(1), edge_table(mesh.faces).twin.reshape(-1, 3) // 3
    for touch in touches:
        a, b = surfaces[touch.first], surfaces[touch.second]
        line = smoothed(mesh.vertices[chains[touch.chain].vertices])
        at = evenly(line, len(line))
        along = np.gradient(at, axis=0)
        dense = replace(touch, at=at, across=_across(a, b, at, along))
        place = _slid(dense, a, b)
        for own, other, side in ((touch.second, touch.first, 1.0), (touch.first, touch.second, -1.0)):
            for _ in range(SLIDES):
                rows = np.flatnonzero((label == own) & (label[of] == other).any(1))
                apart = centres[rows][:, None] - place
                near = np.linalg.norm(apart, axis=2).argmin(1)
                apart = apart[np.arange(len(rows)), near]
                beyond = side * np.einsum("ij,ij->i", apart, dense.across[near]) > 0
                step = np.linalg.norm(along[near], axis=1)
                beyond &= np.abs(np.einsum("ij,ij->i", apart, along[near])) <= step**2  # not past its ends
                beyond &= np.linalg.norm(apart, axis=1) <= touch.most
                if not beyond.any():
                    break
                label[rows[beyond]] = other
    return label


def _across(a: Surface, b: Surface, at: FloatArray, along: FloatArray) -> FloatArray:
    """(n, 3) unit vectors across a border, to the left of it."""
    across = np.cross(a.normals(at) + b.normals(at), along)
    return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300))
