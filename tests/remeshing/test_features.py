"""What creases say of the size of details, and that details narrower than an edge survive it."""

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_no_crossing, box, moved, rotation
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import median_edge
from scan2fea.kernel.topology import edge_table
from scan2fea.remeshing import RemeshOptions, remesh
from scan2fea.remeshing.features import crease_bend, strip_width
from scan2fea.remeshing.isotropic import sharp_edges
from scan2fea.types import TriangleMesh


def prism(loop, height):
    """A closed prism over a convex polygon (counter-clockwise), its walls as a CAD program writes them: two triangles a chord."""
    n = len(loop)
    k, after = np.arange(n), np.roll(np.arange(n), -1)
    low, high = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    middle = loop.mean(0)
    vertices = np.concatenate([np.c_[loop, np.zeros(n)], np.c_[loop, np.full(n, height)], [[*middle, 0], [*middle, height]]])
    rows = [(k, after, after + n), (k, after + n, k + n), (after, k, low), (k + n, after + n, high)]
    return TriangleMesh(vertices=vertices, faces=np.concatenate([np.stack(row, axis=1) for row in rows]))


def circle(radius, n, at=0.0, first=0.0, turn=2 * np.pi):
    angle = first + np.arange(n) * turn / n
    return np.c_[at + radius * np.cos(angle), radius * np.sin(angle)]


def sharp(mesh):
    return sharp_edges(mesh, 40.0)


def test_a_rim_tells_its_radius_however_tall_the_facets_of_its_wall():
    mesh = prism(circle(0.02, 60), 1.0)
    bend = crease_bend(mesh, sharp(mesh))
    assert bend[:120] == pytest.approx(1 / 0.02, rel=2e-3)
    assert (bend[120:] == 0).all()  # off creases


def test_jagged_rims_are_read_through():
    loop = circle(1.0, 60)
    loop *= (1 + 0.01 * (-1.0) ** np.arange(60))[:, None]  # zigzag of a tenth of an edge: each vertex turns by 22 degrees
    mesh = prism(loop, 1.0)
    assert crease_bend(mesh, sharp(mesh))[:120] == pytest.approx(1.0, rel=0.1)


def test_the_bend_is_the_same_when_edges_are_named_otherwise_round():
    mesh = prism(circle(0.02, 24), 0.1)
    turned = TriangleMesh(vertices=mesh.vertices[::-1].copy(), faces=len(mesh.vertices) - 1 - mesh.faces)
    assert crease_bend(turned, sharp(turned))[::-1] == pytest.approx(crease_bend(mesh, sharp(mesh)))


def test_corners_bend_nowhere():
    mesh = box((1.0, 0.3, 0.05))
    assert (crease_bend(mesh, sharp(mesh)) == 0).all()


def test_the_width_of_a_box_at_each_of_its_edges():
    mesh = moved(box((1.0, 0.3, 0.05), pitch=0.025), 2.0 * rotation(3), np.array([5.0, 1, 2]))
    width = strip_width(mesh, sharp(mesh))
    local = (mesh.vertices - [5.0, 1, 2]) @ (rotation(3)) / 2.0
    at_end = (np.abs(local / [1.0, 0.3, 0.05] - 0.5) > 0.5 - 1e-6).T
    for along, narrowest in ((0, 0.05), (1, 0.05), (2, 0.3)):
        inner = at_end[(along + 1) % 3] & at_end[(along + 2) % 3] & ~at_end[along]
        assert inner.any()
        assert width[inner] == pytest.approx(2 * narrowest)
    assert np.isinf(width[at_end.sum(0) < 2]).all()


@pytest.mark.parametrize(("wedge_deg", "is_strip"), [(29.0, True), (31.0, False)])
def test_two_sides_of_a_corner_are_a_strip_up_to_thirty_degrees(wedge_deg, is_strip):
    half = np.radians(wedge_deg / 2)
    mesh = prism(np.array([[0, 0], [np.cos(half), -np.sin(half)], [np.cos(half), np.sin(half)]]), 3.0)
    width = strip_width(mesh, sharp(mesh))
    assert (width[0] < 0.5 * np.tan(2 * half) + 1e-9) == is_strip


def teardrop(small, height=20.0):
    """The outline round a circle of 10 and a small one 25 away."""
    lean = np.arccos((10.0 - small) / 25.0)
    tip = circle(small, 24, 25.0, -lean, 2 * lean)
    return prism(np.concatenate([tip, circle(10.0, 72, 0.0, lean, 2 * np.pi - 2 * lean)]), height)


@pytest.mark.parametrize("small", [0.2, 0.5])
def test_a_tip_narrower_than_an_edge_is_kept(small):
    mesh = moved(teardrop(small), 1e-3 * rotation(5), np.zeros(3))
    found = remesh(mesh, RemeshOptions(edge_m=3e-3), spacing_m=1.5e-3, sigma_m=0.0)
    assert_closed_manifold_oriented(found.mesh)
    assert_no_crossing(found.mesh)
    off = PointToMesh(found.mesh).nearest(mesh.vertices).distance
    assert off.max() < 0.15e-3 + 0.05e-3  # what one change may move it by, and rounding off
    assert median_edge(found.mesh) > 1.2e-3  # elsewhere triangles stay large


def test_a_mesh_without_creases_has_neither():
    mesh = box()
    none = np.zeros(len(edge_table(mesh.faces).edges), bool)
    assert (crease_bend(mesh, none) == 0).all()
    assert np.isinf(strip_width(mesh, none)).all()
