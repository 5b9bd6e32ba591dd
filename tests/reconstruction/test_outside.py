import itertools

import numpy as np
import pytest

from predicates import box, l_beam, moved, rotation, sphere
from scan2fea.errors import ReconstructionError
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals
from scan2fea.reconstruction.flooding import reached
from scan2fea.reconstruction.outside import LEAK_TOLERATED, OutsideOptions, flood, floods, prepare
from scan2fea.types import TriangleMesh
from scanned import DENSITY


def sampled(mesh, spacing, seed=0):
    points, face = sample_surface(mesh, int(DENSITY * area(mesh) / spacing**2), seed)
    return points, face_normals(mesh)[face]


def hollow(outer, inner):
    """A box with a box-shaped cavity."""
    a, b = box((outer,) * 3), box((inner,) * 3)
    b = TriangleMesh(vertices=b.vertices + (outer - inner) / 2, faces=b.faces[:, ::-1] + len(a.vertices))
    return TriangleMesh(vertices=np.vstack([a.vertices, b.vertices]), faces=np.vstack([a.faces, b.faces]))


def right(found, normals):
    """Share of the points whose sign is right."""
    return float(np.mean(np.einsum("ij,ij->i", found.signed, normals) > 0))


def test_sphere_normals_point_out():
    points, normals = sampled(sphere(1.0, rounds=5), 0.07)
    found = next(floods(prepare(points)))
    assert right(found, normals) == 1.0
    assert found.leak_share == 0.0 and found.n_cavities == 0 and not found.core_solid


def test_slab_thinner_than_two_balls():
    points, normals = sampled(box((1.0, 1.0, 0.04)), 0.02)
    found = next(floods(prepare(points)))
    faces = np.abs(normals[:, 2]) > 0.5
    assert np.mean((np.einsum("ij,ij->i", found.signed, normals) > 0)[faces]) > 0.98


def test_cavity_is_open_first_and_solid_next():
    points, normals = sampled(hollow(1.0, 0.7), 0.05)
    open_first, solid_next = list(floods(prepare(points), OutsideOptions(ball=(1.4,))))
    assert right(open_first, normals) > 0.97 and open_first.n_cavities == 1 and not open_first.core_solid
    assert solid_next.core_solid and right(solid_next, normals) < 0.85


def test_motion_and_scale():
    mesh = l_beam(length=0.2)
    turned = moved(mesh, rotation(5), [3.0, -7.0, 1.0])
    scaled = TriangleMesh(vertices=mesh.vertices * 1000, faces=mesh.faces)
    found = []
    for body, h in ((mesh, 0.004), (turned, 0.004), (scaled, 4.0)):
        points, normals = sampled(body, h)
        answer = next(floods(prepare(points)))
        found.append(right(answer, normals))
        assert answer.ball_m / h == pytest.approx(1.68, rel=0.25)
    assert min(found) > 0.95 and max(found) - min(found) < 0.01


def test_a_sheet_is_open_on_both_sides():
    points = np.column_stack([np.random.default_rng(0).random((2000, 2)), np.zeros(2000)])
    points = points + 1e-4 * np.random.default_rng(1).normal(size=points.shape)
    assert flood(prepare(points), 1.4, core_solid=False).leak_share > 0.9


def test_five_sides_of_a_box_are_open_on_both_sides():
    points, normals = sampled(box((1.0, 1.0, 1.0)), 0.05)
    found = flood(prepare(points[normals[:, 2] < 0.5]), 1.4, core_solid=False)
    assert found.leak_share > LEAK_TOLERATED


def test_a_larger_ball_reaches_less():
    points, _ = sampled(l_beam(length=0.1), 0.004)
    tetra = prepare(points).tetra
    masks = [reached(tetra, r) for r in (0.004, 0.006, 0.012, 1e9)]
    assert (masks[-1] == tetra.is_box).all()
    for small, large in itertools.pairwise(masks):
        assert not (large & ~small).any()


def test_same_bytes_and_input_untouched():
    points, _ = sampled(l_beam(length=0.05), 0.004)
    before = points.copy()
    first, again = (next(floods(prepare(points))) for _ in range(2))
    assert first.signed.tobytes() == again.signed.tobytes() and first.outside.tobytes() == again.outside.tobytes()
    np.testing.assert_array_equal(points, before)


def test_equal_balls_are_tried_once():
    points, _ = sampled(sphere(1.0, rounds=4), 0.1)
    setting = prepare(points)
    assert len(list(floods(setting, OutsideOptions(ball=(1.4, 1.4, 1.4))))) == 1


def test_too_few_points():
    with pytest.raises(ReconstructionError, match="18 points are too few"):
        prepare(np.random.default_rng(0).random((18, 3)))
