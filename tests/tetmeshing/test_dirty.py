"""Surfaces that cross themselves: the boundary that fTetWild finds, and what the chain makes of it."""

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_no_crossing, box, spiral
from scan2fea.errors import CrossingError, MeshingError
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import extent, volume
from scan2fea.repair import repair
from scan2fea.tetmeshing import ENVELOPE, FillOptions, new_boundary
from scan2fea.types import TriangleMesh


def test_two_boxes_that_overlap_become_one():
    one, other = box(), box()
    faces = np.concatenate([one.faces, other.faces + len(one.vertices)])
    both = TriangleMesh(vertices=np.concatenate([one.vertices, other.vertices + 0.5]), faces=faces)
    found, again = new_boundary(both), new_boundary(both)
    assert np.array_equal(found.vertices, again.vertices) and np.array_equal(found.faces, again.faces)
    assert volume(found) == pytest.approx(1.875 * volume(one), rel=5e-3)  # 1 + 1 - 1/8
    assert PointToMesh(both).nearest(found.vertices).distance.max() <= 1.01 * ENVELOPE * extent(both.vertices)


def test_a_bar_wound_through_itself():
    given = spiral()
    with pytest.raises(CrossingError, match="cross after repair"):
        repair(given)
    solid = repair(new_boundary(given)).mesh
    assert_closed_manifold_oriented(solid)
    assert_no_crossing(solid)
    ring = 0.5 * np.sin(np.radians(72)) * (0.05**2 - 0.03**2) * 5 * 0.02
    assert ring <= volume(solid) <= 1.16 * ring  # the turns climb by 3.2 mm in all, of 20


def test_nothing_inside():
    sheet = TriangleMesh(vertices=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), faces=np.array([[0, 1, 2]]))
    with pytest.raises(MeshingError, match="nothing inside"):
        new_boundary(sheet)


def test_no_time():
    with pytest.raises(MeshingError, match=r"stopped after 1 s"):
        new_boundary(spiral(turns=3.0), FillOptions(time_limit_s=1.0))
