import math
import re

import numpy as np
import pytest

from predicates import box, moved, rotation
from scan2fea.kernel.distances import sample_surface
from scan2fea.reconstruction.empty_places import BARE, CHANCE, discs_of, emptiness, empty_places
from scan2fea.reconstruction.hidden_volume import LIMIT
from scan2fea.reconstruction.sight import Sight
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


def test_random_points_on_a_whole_plate_leave_nothing_empty():
    for seed in range(40):
        (check,) = empty_places(plate(), sample_surface(plate(), N, seed)[0])
        assert check.passed and check.value == 0


def test_a_place_empty_on_both_faces_is_told_and_one_face_alone_is_not():
    points = sample_surface(plate(), N, 3)[0]
    wide = radius_of(1.4 * emptiness(N))
    (check,) = empty_places(plate(), without(points, wide))
    assert not check.passed and check.value == 1
    told = np.array([float(word) for word in re.findall(r"around \((.+)\) m", check.says)[0].split(",")])
    assert np.linalg.norm(told[:2] - AT) < 0.5 * wide and "holes, or not scanned" in check.says
    assert empty_places(plate(), without(points, wide, (0.0,)))[0].passed
    assert empty_places(plate(), without(points, radius_of(0.3 * emptiness(N))))[0].passed


def test_it_does_not_depend_on_place_or_scale():
    points = without(sample_surface(plate(), N, 3)[0], radius_of(1.4 * emptiness(N)))
    turn, shift = rotation(4), np.array([300.0, -20.0, 7.0])
    for size in (1e-3, 1e3):
        mesh = moved(plate(), size * turn, size * shift)
        mesh = TriangleMesh(vertices=mesh.vertices, faces=mesh.faces, face_region=plate().face_region)
        assert empty_places(mesh, points @ (size * turn).T + size * shift)[0].value == 1


def test_a_coarser_part_of_a_scan_is_not_a_hole():
    """A twelfth of the points on a third of the plate: as dense there as beside it."""
    points = sample_surface(plate(), N, 5)[0]
    rng = np.random.default_rng(0)
    kept = points[(points[:, 0] < 0.66) | (rng.random(N) < 0.083)]
    assert empty_places(plate(), kept)[0].passed


def lines_over(places, down):
    """Sight lines that run along `down` and end on `places`."""
    return Sight(
        points=places, normals=-np.tile(down, (len(places), 1)), wall_m=np.full(len(places), WALL), origin=places - 2.0 * down, target=places,
        spacing_m=0.03, skin_m=0.01,
    )  # fmt: skip


@pytest.mark.parametrize("radius", [0.12, 0.2])
def test_the_bare_part_of_a_wall_is_measured_and_told_where_no_line_passes(radius):
    points = without(sample_surface(plate(), N, 0)[0], radius)
    discs = discs_of(plate(), points)
    bare = discs.area_m2.sum()
    assert math.pi * radius**2 <= bare <= math.pi * (radius + radius_of(BARE)) ** 2 and np.allclose(discs.wall_m, WALL)
    aside = lines_over(np.array([[0.9, 0.5, WALL], [0.1, 0.1, WALL]]), np.array([0.0, 0.0, -1.0]))
    hole, told = empty_places(plate(), points, aside)
    share = bare / (SIZE[0] * SIZE[1])
    assert hole.passed and hole.value == 0 and told.value == pytest.approx(share) and told.passed == (share <= LIMIT)
    through = lines_over(np.array([[*AT, -0.3]]), np.array([0.0, 0.0, -1.0]))
    hole, told = empty_places(plate(), points, through)
    assert not hole.passed and hole.value >= 1 and told.value < share


@pytest.mark.parametrize(("end", "is_hole"), [(WALL, False), (WALL - 0.5 * WALL, False), (0.011, True), (-0.3, True)])
def test_a_line_passes_a_wall_that_ends_beyond_its_middle_deeper_than_noise_lets_it(end, is_hole):
    points = without(sample_surface(plate(), N, 0)[0], 0.12)
    for way in (np.array([0.0, 0.0, -1.0]), np.array([0.6, 0.0, -0.8])):
        line = lines_over(np.array([[*AT, end]]) + (WALL / 2 - end) * np.array([[way[0] / way[2], 0.0, 0.0]]) * -1.0, way)
        assert empty_places(plate(), points, line)[0].passed != is_hole


def test_a_place_with_a_wider_gap_round_it_on_one_face_is_a_gap_of_the_scan():
    """A ball before one face hides more of it than of the other; a hole without points on its rim leaves as much of both."""
    points, wide = sample_surface(plate(), 4 * N, 3)[0], radius_of(0.8 * emptiness(4 * N))
    gap = without(without(points, wide), 2.0 * wide, (0.0,))
    hole, told = empty_places(plate(), gap)
    share = math.pi * wide**2 / (SIZE[0] * SIZE[1])
    assert hole.passed and told.passed and share < told.value < 2.0 * share  # where one face is bare the other is so by chance
    beside = points[~((np.linalg.norm(points[:, :2] - AT - [1.5 * wide, 0.0], axis=1) < 2.0 * wide) & (points[:, 2] < 1e-9))]
    assert not empty_places(plate(), without(beside, wide))[0].passed  # one face has points at part of the rim of the hole
    rim = np.append(AT + [wide, 0.0], 0.5 * WALL)
    assert not empty_places(plate(), np.vstack([gap, rim]))[0].passed
