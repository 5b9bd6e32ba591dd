"""What places see, by brute force over all triangles."""

from __future__ import annotations

import numpy as np
import pytest

from scan2fea.kernel.transforms import rigid
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.simulation.visibility import seen_from


def solid(name, kind, values, at):
    shape = KINDS[kind].build(values, 1e-3)
    T = rigid(np.eye(3), at)
    return Solid(name=name, shape=shape, T_world_shape=T, mesh=posed(shape.mesh, T), volume_m3=1.0)


ANGLE = {"a": 0.3, "b": 0.2, "t": 0.02, "length": 0.8}
SCENE = Scene(
    name="s",
    solids=(
        solid("wall", "box", {"x": 0.1, "y": 1.0, "z": 1.0}, [0, 0, 0]),
        solid("L", "L", ANGLE, [0.5, 0.3, 0.1]),
    ),
)
PLACES = np.array([[-1.0, 0.5, 0.5], [1.5, 1.0, 0.5], [0.9, 0.31, 2.0]])


def blocked(start, end, tri):
    """Does the open segment cross any triangle? By signed volumes, one segment against all."""
    a, b, c = tri[:, 0], tri[:, 1], tri[:, 2]

    def side(p, q, r, s):
        return np.einsum("ij,ij->i", np.cross(q - p, r - p), s - p)

    n = len(tri)
    s, e = np.tile(start, (n, 1)), np.tile(start + (end - start) * (1 - 1e-7), (n, 1))
    apart = side(a, b, c, s) * side(a, b, c, e) < 0
    turns = np.stack([side(s, e, a, b), side(s, e, b, c), side(s, e, c, a)], 1)
    return bool((apart & ((turns > 0).all(1) | (turns < 0).all(1))).any())


def test_by_brute_force():
    seen = seen_from(SCENE, PLACES, 3, n_samples=150)
    mesh = SCENE.mesh()
    tri = mesh.vertices[mesh.faces]
    for k, place in enumerate(PLACES):
        for p, f, told in zip(seen.points, seen.face, seen.seen[:, k], strict=True):
            a, b, c = tri[f]
            facing = np.cross(b - a, c - a) @ (place - p) > 0
            assert told == (facing and not blocked(place, p, tri))


def test_shares_and_their_union():
    seen = seen_from(SCENE, PLACES, 3)
    shares, union = seen.shares(), seen.union()
    assert shares.shape == (2, 3)
    assert (union >= shares.max(axis=1)).all() and (union <= shares.sum(axis=1) + 1e-12).all()
    wall = 1.0 / (2 * (1 + 0.1 + 0.1))
    assert shares[0, 0] == pytest.approx(wall, abs=0.034)
    assert shares[1, 0] < 0.1  # the wall stands before it


def test_reach_and_incidence_limit_on_the_threshold():
    every = seen_from(SCENE, PLACES[:1], 3)
    distance = np.linalg.norm(every.points - PLACES[0], axis=1)
    reach = float(np.median(distance[every.seen[:, 0]]))
    near = seen_from(SCENE, PLACES[:1], 3, reach_m=(0.0, reach))
    np.testing.assert_array_equal(near.seen[:, 0], every.seen[:, 0] & (distance <= reach))
    flat = seen_from(SCENE, PLACES[:1], 3, max_incidence_deg=20.0)
    on_wall = every.seen[:, 0] & (every.solid == 0)
    cosine = 1.0 / distance[on_wall]  # the wall's face is a metre off
    np.testing.assert_array_equal(flat.seen[on_wall, 0], cosine > np.cos(np.radians(20.0)))
