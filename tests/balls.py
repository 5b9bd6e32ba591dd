"""Delaunay tets of points in a ball, slivers and all: the raw material of the tests of the optimisers."""

import numpy as np
from scipy.spatial import Delaunay

from scan2fea.kernel.measures import tet_volumes


def ball(n_shell=120, n_inside=120, seed=0):
    """Nodes and positive, conforming tets of a convex ball of radius 1; the shell is a golden spiral."""
    k = np.arange(n_shell) + 0.5
    polar, around = np.arccos(1 - 2 * k / n_shell), np.pi * (1 + 5**0.5) * k
    shell = np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], axis=1)
    rng = np.random.default_rng(seed)
    inside = rng.normal(size=(n_inside, 3))
    inside *= (0.85 * rng.uniform(size=n_inside) ** (1 / 3) / np.linalg.norm(inside, axis=1))[:, None]
    nodes = np.concatenate([shell, inside])
    tets = Delaunay(nodes).simplices.astype(np.int64)
    wrong = tet_volumes(nodes, tets) < 0
    tets[wrong] = tets[wrong][:, [1, 0, 2, 3]]
    return nodes, tets
