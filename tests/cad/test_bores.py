"""What the points say of a place that came as a square of four planes."""

import numpy as np
import pytest

from scan2fea.cad.bores import bored
from scan2fea.cad.patches import Patches
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.surfaces import CYLINDER, PLANE, Surface
from scan2fea.simulation.polyhedra import meshed, prism
from scanned import scanned

RADIUS, WALL, SPACING = 0.011, 0.012, 0.0045


def _plate(sides, radius):
    """A square plate with a hole of so many sides, its corners on a circle."""
    angle = -2 * np.pi * np.arange(sides) / sides
    return meshed(prism(0.1 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), WALL, [radius * np.c_[np.cos(angle), np.sin(angle)]]))


def _flats(mesh):
    normals = face_normals(mesh)
    keys = np.round(np.column_stack([normals, np.einsum("ij,ij->i", mesh.vertices[mesh.faces[:, 0]], normals)]), 6)
    _, label = np.unique(keys, axis=0, return_inverse=True)
    planes = [Surface(kind=PLANE, point=mesh.vertices[mesh.faces[rows[0], 0]], axis=normals[rows[0]])
              for k in range(label.max() + 1) if len(rows := np.flatnonzero(label == k))]  # fmt: skip
    return Patches(label=label.ravel(), surfaces=tuple(planes))


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("noise", [0.0001, 0.0008])
def test_four_planes_round_a_bolt_hole_are_its_cylinder(seed, noise):
    found = _flats(mesh := _plate(4, 1.25 * RADIUS))
    assert len(found.surfaces) == 6 + 4
    points = scanned(_plate(64, RADIUS), SPACING, noise, seed=seed)[0].cloud.points
    out = bored(mesh, found, points, PointToMesh(mesh).nearest(points).face)
    round_ones = [s for s in out.surfaces if s.kind == CYLINDER]
    assert len(out.surfaces) == 6 + 1 and len(round_ones) == 1
    assert round_ones[0].radius == pytest.approx(RADIUS, abs=max(noise, 1e-4)) and round_ones[0].sense == -1


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_square_hole_stays_one(seed):
    found = _flats(mesh := _plate(4, 0.016))
    points = scanned(mesh, SPACING, 0.0005, seed=seed)[0].cloud.points
    out = bored(mesh, found, points, PointToMesh(mesh).nearest(points).face)
    assert [s.kind for s in out.surfaces] == [PLANE] * 10
