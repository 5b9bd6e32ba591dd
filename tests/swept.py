"""Sweeps of a scanner that moves through a room, cast exactly."""

import numpy as np

from occluded import rings
from scan2fea.kernel.trajectories import between
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.registration.sweeps import Sweeps

PERIOD = 0.1
LOW, HIGH = np.array([-6.0, -5.0, -1.6]), np.array([7.0, 5.0, 2.4])
BOXES = ((np.array([2.0, 1.0, -1.6]), np.array([3.0, 2.2, -0.2])), (np.array([-3.0, -3.0, -1.6]), np.array([-2.0, -2.4, 0.8])))


def swept(knots, sigma, n_columns=120, seed=0, high=HIGH, low=LOW, boxes=BOXES):
    """Sweeps of a room with boxes (a corridor where its ends are far), cast exactly from a scanner that moves evenly between knots."""
    rng = np.random.default_rng(seed)
    direction, _ = rings(n_columns)
    share = np.mod(-np.arctan2(direction[:, 1], direction[:, 0]), 2 * np.pi) / (2 * np.pi)
    order = np.argsort(share, kind="stable")
    direction, share = direction[order], share[order]
    points, sweep, shares = [], [], []
    for k in range(len(knots) - 1):
        R, x = between(knots, np.full(len(share), k), share)
        ray = np.einsum("nij,nj->ni", R, direction)
        with np.errstate(divide="ignore"):
            reach = np.min(np.where(ray > 0, (high - x) / ray, (low - x) / ray), axis=1)
            for a, b in boxes:
                near, far = (np.array([a, b])[:, None] - x) / ray
                enters, leaves = np.minimum(near, far).max(axis=1), np.maximum(near, far).min(axis=1)
                reach = np.where((enters < leaves) & (enters > 0), np.minimum(reach, enters), reach)
        seen = reach < 30.0
        reach = reach + sigma * rng.standard_normal(len(reach))
        points.append((direction * reach[:, None])[seen])
        sweep.append(np.full(int(seen.sum()), k))
        shares.append(share[seen])
    return Sweeps(points=np.concatenate(points), sweep=np.concatenate(sweep), share=np.concatenate(shares), period_s=PERIOD)


def even(n, step, turn_deg):
    return np.array([rigid(rotation_about((0, 0, 1), np.radians(turn_deg) * k), np.array(step) * k) for k in range(n + 1)])
