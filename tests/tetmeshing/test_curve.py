"""Curved mid nodes: the volume of a ball at the rate of quadratic edges, and what may not be curved."""

import functools

import numpy as np
import pytest

from predicates import sphere
from scan2fea.fea.elements import surface_volume
from scan2fea.kernel.quality import scaled_jacobian
from scan2fea.tetmeshing import FillOptions, fill
from scan2fea.tetmeshing.curve import GOOD, curved

BALL = 4 / 3 * np.pi


@functools.cache
def filled(rounds):
    return fill(sphere(rounds=rounds), None, FillOptions(growth=0.8)).tets


def rim_of(tets):
    """Edges of the boundary and their middles on the unit sphere."""
    edges = np.unique(np.sort(tets.boundary[:, [[0, 1], [1, 2], [0, 2]]], axis=2).reshape(-1, 2), axis=0)
    middles = tets.nodes[edges].mean(1)
    return edges, middles / np.linalg.norm(middles, axis=1, keepdims=True)


def test_the_volume_of_a_ball_comes_out_at_the_rate_of_quadratic_edges():
    off = []
    for rounds in (1, 2, 3):
        straight = filled(rounds)
        tets, kept = curved(straight, *rim_of(straight))
        assert kept == 0
        assert (scaled_jacobian(tets.nodes, tets.tets) > np.minimum(scaled_jacobian(straight.nodes, straight.tets), GOOD) * (1 - 1e-9)).all()
        off.append(abs(surface_volume(tets.nodes, tets.boundary) / BALL - 1))
        assert abs(surface_volume(straight.nodes, straight.boundary) / BALL - 1) > 30 * off[-1]
    rate = np.log2(np.array(off[:-1]) / off[1:])
    assert rate == pytest.approx([4, 4], abs=0.3)


def test_edges_that_would_spoil_a_tet_stay_straight_and_are_counted():
    straight = filled(2)
    edges, middles = rim_of(straight)
    middles[::7] *= 0.3  # far inside the tets
    before = straight.nodes.copy()
    tets, kept = curved(straight, edges[:, ::-1], middles)
    assert np.array_equal(straight.nodes, before)
    assert len(edges[::7]) <= kept < len(edges)
    assert (scaled_jacobian(tets.nodes, tets.tets) >= np.minimum(scaled_jacobian(straight.nodes, straight.tets), GOOD) * (1 - 1e-9)).all()
    n_moved = int((tets.nodes != before).any(axis=1).sum())
    assert n_moved == len(edges) - kept
    assert np.array_equal(tets.tets, straight.tets)
