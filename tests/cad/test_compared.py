"""A solid of true faces and a surface with another number of holes: which of the two invents, the points say; and faces beside their points."""

import numpy as np
import pytest

from drawn import drawing, triangles
from predicates import box
from scan2fea.cad import true_solid
from scan2fea.cad.compared import BESIDE, Scale, beside_faces
from scan2fea.kernel.coverage import EXPECTED, is_unmeasured
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, volume
from scan2fea.types import TriangleMesh

SPACING, NOISE = 0.0012, 5e-5
RADIUS, MIDDLE = 0.005, np.array([0.03, 0.025, 0.0])
BOX = 0.06 * 0.05 * 0.012
BORE = np.pi * RADIUS**2 * 0.012


def plate(*tools):
    """The surface of a plate, cut by solids of revolution about its middle: (height, next height, radius, next radius) each."""
    with drawing() as occ:
        body = [(3, occ.addBox(0, 0, 0, 0.06, 0.05, 0.012))]
        for low, high, first, last in tools:
            at = (MIDDLE[0], MIDDLE[1], low, 0, 0, high - low)
            tool = occ.addCylinder(*at, first) if first == last else occ.addCone(*at, first, last)
            body, _ = occ.cut(body, [(3, tool)])
        mesh = triangles(0.0015)
    return mesh if volume(mesh) > 0 else TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[:, ::-1])


BORED = plate((-0.01, 0.02, RADIUS, RADIUS))
DRILLED = plate((0.0045, 0.02, RADIUS, RADIUS), (0.0015, 0.0045, 0.0008, RADIUS))  # a drill's tip leaves a skin


def scanned(mesh):
    """Noisy points, SPACING apart."""
    points, _ = sample_surface(mesh, round(area(mesh) / SPACING**2), 0)
    return points + NOISE * np.random.default_rng(0).standard_normal(points.shape)


def found(surface, points):
    rough = surface.vertices + NOISE * np.random.default_rng(1).standard_normal(surface.vertices.shape)
    return true_solid(TriangleMesh(vertices=rough, faces=surface.faces), points, spacing_m=SPACING, noise_m=NOISE)


def test_a_hole_whose_wall_nobody_saw_is_an_unseen_place():
    points = scanned(plate())
    seen = points[np.linalg.norm((points - MIDDLE)[:, :2], axis=1) > RADIUS]
    solid = found(BORED, seen)
    assert solid.brep.face_kinds == ("plane",) * 6
    assert solid.how["holes"] == {"solid": 0, "surface": 1}
    assert solid.brep.volume_m3 == pytest.approx(BOX, rel=2e-3)


def test_a_hole_with_points_on_its_wall_stays():
    solid = found(BORED, scanned(BORED))
    assert sorted(solid.brep.face_kinds) == ["cylinder"] + ["plane"] * 6
    assert "holes" not in solid.how
    assert solid.brep.volume_m3 == pytest.approx(BOX - BORE, rel=2e-3)


def test_a_skin_over_a_hole_where_nobody_looked_is_none():
    points = scanned(BORED)
    seen = points[np.linalg.norm(points - MIDDLE, axis=1) > 0.007]
    solid = found(DRILLED, seen)
    assert sorted(solid.brep.face_kinds) == ["cylinder"] + ["plane"] * 6
    assert solid.how["holes"] == {"solid": 1, "surface": 0}
    assert solid.brep.volume_m3 == pytest.approx(BOX - BORE, rel=2e-3)


def test_a_bottom_that_was_measured_stays():
    blind = plate((0.0015, 0.02, RADIUS, RADIUS))
    solid = found(blind, scanned(blind))
    assert sorted(solid.brep.face_kinds) == ["cylinder"] + ["plane"] * 7
    assert "holes" not in solid.how
    assert solid.brep.volume_m3 == pytest.approx(BOX - BORE * 10.5 / 12, rel=2e-3)


@pytest.mark.parametrize(("expected", "n", "unseen"), [(EXPECTED, 0, True), (0.999 * EXPECTED, 0, False), (20.0, 1, True), (19.9, 1, False)])
def test_a_part_is_unmeasured_where_chance_would_leave_points(expected, n, unseen):
    assert is_unmeasured(expected / 100, n, 100.0) is unseen


@pytest.mark.parametrize(("wave", "noise", "told"), [(0.0, 5e-4, False), (0.0, 0.0, False), (0.003, 5e-4, True), (4e-4, 5e-4, False)])
def test_a_wavy_top_is_none_of_a_block_with_a_flat_one(wave, noise, told):
    """Waves of six times the noise are told, which the rounding of creases would let pass; those within the noise are not."""
    flat = box((0.12, 0.08, 0.03), 0.003)
    top = flat.vertices[:, 2] > flat.vertices[:, 2].max() - 1e-9
    up = np.where(top, wave * np.sin(60 * flat.vertices[:, 0]) * np.sin(60 * flat.vertices[:, 1]), 0.0)
    wavy = TriangleMesh(vertices=flat.vertices + up[:, None] * [0.0, 0.0, 1.0], faces=flat.faces)
    points, _ = sample_surface(wavy, 3000, seed=1)
    points = points + noise * np.random.default_rng(0).normal(size=points.shape)
    share = beside_faces(flat, wavy, points, Scale(spacing_m=0.0034, noise_m=noise / 3, size_m=0.15))
    assert share > 2 * BESIDE if told else share < 0.2 * BESIDE


def test_points_that_are_the_vertices_themselves_have_the_noise_of_these():
    flat = box((0.12, 0.08, 0.03), 0.003)
    noisy = flat.vertices + 5e-4 * np.random.default_rng(0).normal(size=flat.vertices.shape)
    surface = TriangleMesh(vertices=noisy, faces=flat.faces)
    assert beside_faces(flat, surface, noisy, Scale(spacing_m=0.003, noise_m=5e-4, size_m=0.15)) < 0.2 * BESIDE
