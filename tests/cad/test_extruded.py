"""Walls of free form that are a curve along a direction, as one face."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from predicates import topped
from scan2fea.cad import extruded
from scan2fea.cad.extruded import EXTRUDED, Extruded, with_extruded
from scan2fea.cad.live import is_valid
from scan2fea.cad.readback import volume_of
from scan2fea.cad.traced import traced_solid
from scan2fea.kernel.measures import volume
from scan2fea.kernel.surfaces import PLANE, fit_surface


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


def strips(noise, height, ends):
    """A block with a top in strips along y, each the plane or cylinder of its corners; labels, surfaces and the faces of the top."""
    mesh, _, label, planes = topped(height, noise)
    is_top, x = label < 0, mesh.vertices[mesh.faces].mean(1)[:, 0]
    surfaces, label = list(planes), label.copy()
    for k, (low, high) in enumerate(itertools.pairwise(ends), 5):
        rows = is_top & (x >= low) & (x < high)
        at = mesh.vertices[np.unique(mesh.faces[rows])]
        normals = np.tile([0.0, 0.0, 1.0], (len(at), 1))
        surfaces.append(fit_surface(PLANE, at, normals))
        label[rows] = k
    return mesh, label, surfaces, is_top


def test_pieces_of_a_curve_are_one_curve():
    mesh, label, surfaces, top = strips(0.05, wave, np.linspace(0.0, 40.0001, 14))
    named, more = with_extruded(mesh, label, surfaces, top, 0.17, 1.0)
    assert [s.kind for s in more[len(surfaces) :]] == [EXTRUDED]
    assert np.mean(named[top] == len(surfaces)) > 0.98


def test_planes_that_hold_their_points_are_no_curve():
    roof = [0.0, 15.0, 25.0, 40.0001]
    mesh, label, surfaces, top = strips(0.05, lambda x, y: np.interp(x, roof, [0.0, 2.0, 2.0, 0.0]), roof)
    named, more = with_extruded(mesh, label, surfaces, top, 0.17, 1.0)
    assert len(more) == len(surfaces)
    assert (named == label).all()


def test_where_a_curve_asks_for_more_than_the_pieces_the_next_is_tried(monkeypatch):
    mesh, label, surfaces, is_top = strips(0.05, wave, np.linspace(0, 40, 11))
    asked = []
    monkeypatch.setattr(extruded, "_axes", lambda *_: [np.array([0.0, 1.0, 0.0])] * 2)
    monkeypatch.setattr(extruded, "_is_simpler", lambda *a: asked.append(a[3][-1]) or len(asked) > 1)
    _, found = with_extruded(mesh, label, surfaces, is_top, 0.17, 1.0)
    assert len(asked) == 2
    assert found[-1] is asked[1]


def test_an_edge_along_a_curl_has_points_on_each_span():
    turn = np.linspace(0.0, np.pi, 9)
    curl = np.column_stack([20 + 0.2 * np.sin(turn), 0.2 * (1 - np.cos(turn))])  # 0.2 mm, between straight lines of 20 mm
    poles = np.concatenate([[[0.0, 0.0], [10.0, 0.0]], curl, [[10.0, 0.4], [0.0, 0.4]]])
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(poles, axis=0), axis=1)))
    spline = make_interp_spline(length, poles, 3)
    surface = Extruded(kind=EXTRUDED, point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), spline=spline)
    ends = spline(length[[0, -1]]) @ surface.frame()
    line = ends[0] + np.linspace(0.0, 1.0, 5)[:, None] * (ends[1] - ends[0])
    at = surface.along(line)
    assert np.allclose(at[[0, -1]], ends)
    assert np.abs(surface.distance(at)).max() < 1e-9
    assert (np.histogram(surface._feet(at)[1], np.unique(spline.t))[0] >= 5).all()  # 6, of which knots may count one beside
