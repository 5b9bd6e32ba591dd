import math
import re

import numpy as np
import pytest

from predicates import box, moved, rotation
from scan2fea.kernel.distances import sample_surface
from scan2fea.reconstruction.empty_places import CHANCE, emptiness, empty_circles, empty_places
from scan2fea.types import TriangleMesh

SIZE, WALL, N = (1.0, 0.6, 0.05), 0.05, 1500
AT = np.array([0.4, 0.3])


def plate():
    """A plate whose six sides are its faces, and where each of its triangles looks."""
    mesh = box(SIZE)
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    number = np.round(normal @ [1, 2, 3]).astype(np.int64)
    return TriangleMesh(vertices=mesh.vertices, faces=mesh.faces, face_region=number + 3)


def without(points, radius, sides=(0.0, WALL)):
    gone = (np.linalg.norm(points[:, :2] - AT, axis=1) < radius) & np.isin(np.round(points[:, 2], 9), sides)
    return points[~gone]


def radius_of(x):
    """Of the circle in which both faces together are due x of N points."""
    area = 2 * (SIZE[0] * SIZE[1] + SIZE[0] * WALL + SIZE[1] * WALL)
    return math.sqrt(x * area / (2 * math.pi * N))


def test_emptiness_is_a_chance_of_the_whole_part():
    for n in (100, 10_000):
        x = emptiness(n)
        assert 2 * n * (1 + x) * math.exp(-x) == pytest.approx(CHANCE)


def test_circles_are_empty_and_go_through_three_points():
    points = np.random.default_rng(0).random((40, 2))
    middle, radius = empty_circles(points)
    off = np.linalg.norm(points[None] - middle[:, None], axis=2)
    assert len(middle) == 2 * 40 - 2 - len(np.unique(_hull(points)))  # Euler
    assert (off >= radius[:, None] * (1 - 1e-9)).all()
    assert (np.sum(off <= radius[:, None] * (1 + 1e-9), axis=1) == 3).all()


def _hull(points):
    from scipy.spatial import ConvexHull

    return ConvexHull(points).vertices


def test_random_points_on_a_whole_plate_leave_nothing_empty():
    for seed in range(40):
        check = empty_places(plate(), sample_surface(plate(), N, seed)[0])
        assert check.passed and check.value == 0


def test_a_place_empty_on_both_faces_is_told_and_one_face_alone_is_not():
    points = sample_surface(plate(), N, 3)[0]
    wide = radius_of(1.4 * emptiness(N))
    check = empty_places(plate(), without(points, wide))
    assert not check.passed and check.value == 1
    told = np.array([float(word) for word in re.findall(r"around \((.+)\) m", check.says)[0].split(",")])
    assert np.linalg.norm(told[:2] - AT) < 0.5 * wide and "holes, or not scanned" in check.says
    assert empty_places(plate(), without(points, wide, (0.0,))).passed
    assert empty_places(plate(), without(points, radius_of(0.3 * emptiness(N)))).passed


def test_it_does_not_depend_on_place_or_scale():
    points = without(sample_surface(plate(), N, 3)[0], radius_of(1.4 * emptiness(N)))
    turn, shift = rotation(4), np.array([300.0, -20.0, 7.0])
    for size in (1e-3, 1e3):
        mesh = moved(plate(), size * turn, size * shift)
        mesh = TriangleMesh(vertices=mesh.vertices, faces=mesh.faces, face_region=plate().face_region)
        assert empty_places(mesh, points @ (size * turn).T + size * shift).value == 1


def test_a_coarser_part_of_a_scan_is_not_a_hole():
    """A twelfth of the points on a third of the plate: as dense there as beside it."""
    points = sample_surface(plate(), N, 5)[0]
    rng = np.random.default_rng(0)
    kept = points[(points[:, 0] < 0.66) | (rng.random(N) < 0.083)]
    assert empty_places(plate(), kept).passed
