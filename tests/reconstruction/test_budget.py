"""Doubts add up: what each check lets pass alone must not pass together; and flat faces that nobody saw are told."""

import dataclasses

import numpy as np
import pytest

from predicates import box
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals
from scan2fea.reconstruction.bare_faces import bare_faces
from scan2fea.reconstruction.budget import LIMIT, SHARES, VOLUME_IN_DOUBT, volume_in_doubt
from scan2fea.types import Check, TriangleMesh
from scanned import DENSITY

SIZE = np.array([0.2, 0.15, 0.012])
H = 0.004


def check(name, value):
    return Check(name=name, value=value, limit=1.0, unit="1", passed=True)


def test_doubts_add_up_and_a_standard_deviation_counts_twice():
    names = list(SHARES)
    alone = volume_in_doubt((check(names[0], LIMIT), check("parts", 1.0)))
    assert alone.passed and alone.value == LIMIT and alone.name == VOLUME_IN_DOUBT
    two = volume_in_doubt((check(names[0], 0.6 * LIMIT), check(names[1], 0.6 * LIMIT)))
    assert not two.passed and two.value == pytest.approx(1.2 * LIMIT)
    assert names[0] in two.says and "3.0%" in two.says
    assert volume_in_doubt((check("place of the planes", 0.01),)).value == 0.02
    assert volume_in_doubt(()).value == 0.0
    assert volume_in_doubt((dataclasses.replace(check(names[0], 0.9), passed=False), check(names[1], 0.01))).value == 0.01


def plate():
    mesh = box(SIZE)
    return TriangleMesh(vertices=mesh.vertices, faces=mesh.faces, face_region=np.unique(face_normals(mesh).round(), axis=0, return_inverse=True)[1])


def points_of(mesh, keep, sigma, seed=0):
    places, face = sample_surface(mesh, int(DENSITY * area(mesh) / H**2), seed)
    kept = keep(face_normals(mesh)[face])
    return places[kept] + sigma * np.random.default_rng(seed).normal(size=(kept.sum(), 3))


@pytest.mark.parametrize("sigma", [0.0, 0.1 * SIZE[2], 0.2 * SIZE[2]])
def test_a_rim_without_points_is_told_in_noise(sigma):
    mesh = plate()
    blind = np.full((1, 3), np.nan)
    whole = bare_faces(mesh, points_of(mesh, lambda n: np.ones(len(n), bool), sigma), blind, H, sigma)
    assert whole.passed and whole.value == 0.0
    points = points_of(mesh, lambda n: n[:, 0] < 0.5, sigma)
    cut = bare_faces(mesh, points, np.full_like(points, np.nan), H, sigma)
    length = np.hypot(SIZE[1], SIZE[2])
    assert not cut.passed and cut.value == pytest.approx(SIZE[1] * SIZE[2] * length / np.pi / SIZE.prod(), rel=1e-6)
    assert "around (0.2" in cut.says


def test_a_narrow_rim_that_was_grazed_was_seen():
    """A quarter of the points that are due lie all over it: rays that graze a face lie far apart."""
    mesh = plate()
    kept = np.random.default_rng(2).random(10**6) < 0.25
    points = points_of(mesh, lambda n: (n[:, 0] < 0.5) | kept[: len(n)], 0.0)
    assert 12 < np.sum(points[:, 0] > SIZE[0] - 1e-9) < 40
    assert bare_faces(mesh, points, np.full_like(points, np.nan), H, 0.0).value == 0.0


def test_sight_lines_that_pass_there_prove_the_end():
    mesh = plate()
    points = points_of(mesh, lambda n: n[:, 0] < 0.5, 0.0)
    over, under = points.copy(), points.copy()
    rng = np.random.default_rng(1)
    passing = SIZE[0] + 1.5 * H, SIZE[1] * rng.random(400), SIZE[2] * rng.random(400)
    places = np.stack([np.full(400, passing[0]), passing[1], passing[2]], axis=1)
    way = np.tile([0.0, 0.0, 1.0], (400, 1))
    over, under = places + way, places - way  # lines that pass straight before the rim
    seen = bare_faces(mesh, np.concatenate([points, under]), np.concatenate([np.full_like(points, np.nan), over]), H, 0.0)
    assert seen.passed and seen.value == 0.0
