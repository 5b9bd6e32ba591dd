"""Poses of many frames from links between pairs of them, with links that contradict the rest losing their weight.

Gauss-Newton on SE(3) with increments in the world about one common point; each link counts by its information matrix, robustly (Geman-McClure with
a scale that starts wide and closes: graduated non-convexity, Yang 2020).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import splu

from scan2fea.kernel.transforms import inverse, quaternion_to_matrix, rigid
from scan2fea.options import option
from scan2fea.types import FloatArray, Value

CHI2_6_99 = 16.812  # 99 % of chi-square with 6 degrees of freedom
MEDIAN_6 = 5.348
_ROUNDS = 6  # the scale closes from 4^5 to 1
_RIDGE = 1e-12  # of the mean diagonal: frames that links do not hold stay where they were put


@dataclass(frozen=True, kw_only=True)
class GraphOptions:
    """How the poses are made consistent."""

    iterations: int = option(8, "Gauss-Newton steps per scale of the robust weight", minimum=1)
    reject_below: float = option(0.25, "A link whose weight ends below this is reported as contradicting the others", minimum=0.0, maximum=1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class GraphLink(Value):
    """A measured T_target_source with its information (6, 6) of (rotation vector, translation) about `centre` (3,) in the target's frame."""

    target: int
    source: int
    T_target_source: FloatArray
    centre: FloatArray
    information: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class GraphResult(Value):
    """T_world_frame : (n, 4, 4).   covariance : (n, 6, 6) of each pose about its `about` point, zero where held.   weight : (m,) of the links.
    chi2 : (m,).   inflation : what the informations promised too much, >= 1.
    """

    T_world_frame: FloatArray
    covariance: FloatArray
    weight: FloatArray
    chi2: FloatArray
    inflation: float
    converged: bool


def optimise(
    T_world_frame: FloatArray, links: Sequence[GraphLink], held: Sequence[int], about: FloatArray, options: GraphOptions = GraphOptions()
) -> GraphResult:
    """Poses of least squares. T_world_frame : (n, 4, 4) start.   held : frames that do not move (at least one).   about : (n, 3) point of each
    frame, in the frame, at which its covariance is told.
    """
    poses = np.array(T_world_frame, float)
    n, m = len(poses), len(links)
    column = np.full(n, -1)
    free = [k for k in range(n) if k not in set(held)]
    column[free] = np.arange(len(free))
    weight, chi2, inflation, done = np.ones(m), np.zeros(m), 1.0, not free or not m
    if done:
        return GraphResult(T_world_frame=poses, covariance=np.zeros((n, 6, 6)), weight=weight, chi2=chi2, inflation=inflation, converged=True)
    origin = np.mean([poses[k.target, :3, :3] @ k.centre + poses[k.target, :3, 3] for k in links], axis=0)
    for scale in 4.0 ** np.arange(_ROUNDS - 1, -1, -1):
        for _ in range(options.iterations):
            H, g, chi2 = _system(poses, links, column, len(free), weight, origin)
            inflation = _inflation(chi2, len(free))
            c2 = scale * CHI2_6_99 * inflation
            weight = (c2 / (c2 + chi2)) ** 2
            step = splu(H).solve(-g).reshape(-1, 6)
            poses = _moved(poses, step, column, origin)
            done = bool(np.abs(step[:, :3]).max() < 1e-10 and np.abs(step[:, 3:]).max() < 1e-10 * (1.0 + np.abs(origin).max()))
            if done:
                break
    H, _, chi2 = _system(poses, links, column, len(free), weight, origin)
    covariance = np.zeros((n, 6, 6))
    solver = splu(H)
    for k in free:
        rhs = np.zeros((6 * len(free), 6))
        rhs[6 * column[k] : 6 * column[k] + 6] = np.eye(6)
        C = solver.solve(rhs)[6 * column[k] : 6 * column[k] + 6] * inflation
        M = _at(poses[k, :3, :3] @ about[k] + poses[k, :3, 3] - origin)
        covariance[k] = M @ (0.5 * (C + C.T)) @ M.T
    return GraphResult(T_world_frame=poses, covariance=covariance, weight=weight, chi2=chi2, inflation=inflation, converged=done)


def _inflation(chi2: FloatArray, n_free: int) -> float:
    """What the links promised too much: median of chi-square over that of 6 degrees of freedom, which the fit has used up in part. >= 1."""
    m = len(chi2)
    return max(1.0, float(np.median(chi2)) / MEDIAN_6 * m / (m - n_free)) if m > n_free else 1.0


def residual(poses: FloatArray, link: GraphLink) -> FloatArray:
    """(6,) motion (rotation vector, displacement of the centre) in the target's frame between the poses and the link."""
    D = inverse(poses[link.target]) @ poses[link.source] @ inverse(link.T_target_source)
    return np.concatenate([rotation_vector(D[:3, :3]), D[:3, :3] @ link.centre + D[:3, 3] - link.centre])


def rotation_vector(R: FloatArray) -> FloatArray:
    """(3,) axis times angle, to the last digit for small angles too."""
    v = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    s, c = float(np.linalg.norm(v)), 0.5 * (float(np.trace(R)) - 1.0)
    angle = math.atan2(s, c)
    if s > 1e-9:
        return np.asarray(v * (angle / s))
    if c > 0:
        return v
    _, axes = np.linalg.eigh(R + R.T)  # a half turn: the axis is the eigenvector of 2
    return np.asarray(math.pi * axes[:, -1])


def _skew(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _at(offset: FloatArray) -> FloatArray:
    """(6, 6) from a motion about a point to the same motion about the point `offset` away."""
    M = np.eye(6)
    M[3:, :3] = -_skew(offset)
    return M


def _system(
    poses: FloatArray, links: Sequence[GraphLink], column: np.ndarray, n_free: int, weight: FloatArray, origin: FloatArray
) -> tuple[csc_matrix, FloatArray, FloatArray]:
    rows, cols, values, g, chi2 = [], [], [], np.zeros(6 * n_free), np.zeros(len(links))
    block_r, block_c = np.indices((6, 6))
    for k, link in enumerate(links):
        r = residual(poses, link)
        R = poses[link.target, :3, :3]
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = R.T
        M = turn @ _at(R @ link.centre + poses[link.target, :3, 3] - origin)
        chi2[k] = float(r @ link.information @ r)
        block = weight[k] * M.T @ link.information @ M
        score = weight[k] * M.T @ link.information @ r
        ends = [(column[link.source], 1.0), (column[link.target], -1.0)]
        for a, sign_a in ends:
            if a < 0:
                continue
            g[6 * a : 6 * a + 6] += sign_a * score
            for b, sign_b in ends:
                if b >= 0:
                    rows.append((block_r + 6 * a).ravel())
                    cols.append((block_c + 6 * b).ravel())
                    values.append((sign_a * sign_b * block).ravel())
    size = 6 * n_free
    if rows:
        H = coo_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=(size, size)).tocsc()
    else:
        H = csc_matrix((size, size))
    diagonal = H.diagonal().reshape(-1, 6)
    ridge = np.repeat(_RIDGE * np.maximum(diagonal.mean(axis=0), 1e-300)[None], n_free, axis=0).ravel()
    return (H + coo_matrix((ridge, (np.arange(size), np.arange(size))), shape=(size, size))).tocsc(), g, chi2


def _moved(poses: FloatArray, step: FloatArray, column: np.ndarray, origin: FloatArray) -> FloatArray:
    moved = poses.copy()
    for k, c in enumerate(column):
        if c >= 0:
            w, v = step[c, :3], step[c, 3:]
            angle = float(np.linalg.norm(w))
            q = np.r_[0.5 * w * (np.sinc(angle / (2 * math.pi))), math.cos(angle / 2)]
            R = quaternion_to_matrix(q)
            moved[k] = rigid(R, origin + v - R @ origin) @ poses[k]
    return moved


def components(n: int, pairs: Sequence[tuple[int, int]]) -> list[int]:
    """Label per frame: the lowest frame it hangs together with."""
    parent = list(range(n))

    def root(k: int) -> int:
        while parent[k] != k:
            k = parent[k]
        return k

    for a, b in pairs:
        ra, rb = root(a), root(b)
        parent[max(ra, rb)] = min(ra, rb)
    return [root(k) for k in range(n)]


def triangles_closed(links: Mapping[tuple[int, int], FloatArray], size_m: float, tolerance_m: float) -> dict[tuple[int, int], int]:
    """Of each link (target, source), how many triangles with two others close within the tolerance (a turn counts times `size_m`)."""
    count = dict.fromkeys(links, 0)
    T = {**links, **{(s, t): inverse(M) for (t, s), M in links.items()}}
    nodes = sorted({k for pair in links for k in pair})
    for x, a in enumerate(nodes):
        for y, b in enumerate(nodes[x + 1 :], x + 1):
            if (a, b) not in T:
                continue
            for c in nodes[y + 1 :]:
                if (b, c) in T and (c, a) in T:
                    loop = T[a, b] @ T[b, c] @ T[c, a]
                    off = np.linalg.norm(loop[:3, 3]) + size_m * np.linalg.norm(rotation_vector(loop[:3, :3]))
                    if off <= tolerance_m:
                        for pair in ((a, b), (b, c), (a, c)):
                            count[pair if pair in count else pair[::-1]] += 1
    return count
