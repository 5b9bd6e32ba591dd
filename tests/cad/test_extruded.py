"""Walls of free form that are a curve along a direction, as one face."""

from __future__ import annotations

import numpy as np
import pytest

from predicates import topped
from scan2fea.cad.extruded import EXTRUDED, with_extruded
from scan2fea.cad.live import is_valid
from scan2fea.cad.readback import volume_of
from scan2fea.cad.traced import traced_solid
from scan2fea.kernel.measures import volume


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
