"""Walls of free form that are a curve along a direction, as one face."""

from __future__ import annotations

import numpy as np
import pytest

from predicates import box
from scan2fea.cad.extruded import EXTRUDED, with_extruded
from scan2fea.cad.live import is_valid
from scan2fea.cad.readback import volume_of
from scan2fea.cad.traced import traced_solid
from scan2fea.kernel.measures import volume
from scan2fea.kernel.surfaces import PLANE, Surface
from scan2fea.types import TriangleMesh

SIZE = np.array([40.0, 20.0, 10.0])


def topped(height, noise, seed=0):
    """A block whose top is higher by `height(x, y)`, with noise; the side of each face, the top's -1; its five planes."""
    flat = box(SIZE, 1.0)
    middle, at = flat.vertices[flat.faces].mean(1), flat.vertices
    sides = [(k, side) for k in range(3) for side in (-1, 1)]
    label = np.argmin([np.abs(middle[:, k] - SIZE[k] * (side > 0)) for k, side in sides], axis=0)
    up = at + np.outer(height(at[:, 0], at[:, 1]) * at[:, 2] / SIZE[2], [0, 0, 1])
    moved = up + noise * np.random.default_rng(seed).standard_normal(up.shape)
    planes = [Surface(kind=PLANE, point=SIZE * (side > 0) * np.eye(3)[k], axis=side * np.eye(3)[k]) for k, side in sides[:5]]
    return TriangleMesh(vertices=moved, faces=flat.faces), TriangleMesh(vertices=up, faces=flat.faces), np.where(label == 5, -1, label), planes


def wave(x, y):
    return 2.0 * np.sin(x / 4.0) + 0.5 * np.cos(x / 1.7)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_wavy_top_is_one_face(noise):
    mesh, exact, label, planes = topped(wave, noise)
    named, surfaces = with_extruded(mesh, label, planes, label < 0, 3 * noise + 0.02, 1.0)
    assert [s.kind for s in surfaces[5:]] == [EXTRUDED]
    assert np.mean((named == 5) == (label < 0)) > 0.98
    top = surfaces[5]
    at = np.column_stack([np.linspace(1, 39, 200), np.full(200, 7.0), 10 + wave(np.linspace(1, 39, 200), 0)])
    assert np.abs(top.distance(at)).max() < 0.02 + noise
    assert (top.distance(at + [0, 0, 0.5]) > 0.2).all()  # outside is up
    assert (top.normals(at)[:, 2] > 0.5).all()
    made = traced_solid(mesh, named, surfaces, [1e-4 * np.eye(3)] * 5 + [np.zeros((0, 0))], 3 * noise + 0.02, 1.0)
    assert made.n_facets == 0
    assert is_valid(made.solid)
    assert volume_of(made.solid) == pytest.approx(volume(exact), rel=2e-3)


@pytest.mark.parametrize("height", [lambda x, y: 2 * np.sin(x / 4) * np.sin(y / 4), lambda x, y: 0 * x])
def test_a_top_that_bends_both_ways_or_not_at_all_is_none(height):
    mesh, _, label, planes = topped(height, 0.05)
    named, surfaces = with_extruded(mesh, label, planes, label < 0, 0.17, 1.0)
    assert len(surfaces) == 5
    assert (named == label).all()
