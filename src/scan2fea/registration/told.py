"""Where the sensor was when it measured: the pose of each sweep in the middle of its returns.

Knots lie between the sweeps, where often nothing was measured (what the sensor sees fills a part of its turn, or sweeps were left out): a path that
swings from one sweep to the next may be right at every return and decimetres off at the knots. So no pose is told there.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from scan2fea.kernel.trajectories import between
from scan2fea.kernel.transforms import inverse, rigid
from scan2fea.types import FloatArray, IntArray


def middles(sweep: IntArray, share: FloatArray) -> FloatArray:
    """(k,) share of its time at which the middle return of each sweep came; half of it where none did. sweep : (n,) rising from 0, share : (n,)"""
    bounds = np.searchsorted(sweep, np.arange(int(sweep[-1]) + 2))
    return np.array([float(np.median(share[a:b])) if b > a else 0.5 for a, b in pairwise(bounds)])


def poses_at(T_world_knot: FloatArray, middle: FloatArray) -> FloatArray:
    """(k, 4, 4) poses a share `middle` (k,) of the way from each knot of (k + 1, 4, 4) to the next."""
    R, x = between(T_world_knot, np.arange(len(middle)), middle)
    return np.array([rigid(turn, shift) for turn, shift in zip(R, x, strict=True)])


def from_first(T_world_knot: FloatArray, middle: FloatArray) -> FloatArray:
    """The knots in the frame of the sensor in the middle of its first sweep."""
    return np.asarray(inverse(poses_at(T_world_knot[:2], middle[:1])[0]) @ T_world_knot)


def deviations(T_world_knot: FloatArray, covariance: FloatArray, middle: FloatArray) -> FloatArray:
    """(k, 2) standard deviations of turn (rad) and place (m) of `poses_at` against the first of them, of all three axes together.

    covariance : (6 k, 6 k) of all knots but the first, turn and place of each, which is held.
    """
    k = len(middle)
    weight = np.zeros((k, k + 1))
    weight[np.arange(k), np.arange(k)], weight[np.arange(k), np.arange(1, k + 1)] = 1.0 - middle, middle
    W = np.kron(weight, np.eye(6))[:, 6:]
    C = (W @ covariance @ W.T).reshape(k, 6, k, 6)
    place = poses_at(T_world_knot, middle)[:, :3, 3]
    var = np.zeros((k, 2))
    for m in range(1, k):
        x, y, z = place[m] - place[0]
        lever = np.eye(6)
        lever[3:, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]  # the turn of the first about the world's axes carries what is seen from it
        crossed = C[m, :, 0, :] @ lever.T
        V = np.diag(C[m, :, m, :] - crossed - crossed.T + lever @ C[0, :, 0, :] @ lever.T)
        var[m] = V[:3].sum(), V[3:].sum()
    return np.sqrt(np.maximum(var, 0.0))
