import numpy as np
import pytest

from scan2fea.errors import InternalError
from scan2fea.kernel.rays import first_hits, ray_scene
from scan2fea.kernel.transforms import random_rotation

CUBE = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
CUBE_FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4]])
CUBE_FACES = np.concatenate([CUBE_FACES, [[1, 5, 7], [1, 7, 3]]])


def brute_force(triangles, origin, direction):
    best = np.full(len(origin), np.inf)
    for a, b, c in triangles:
        m = np.stack([np.broadcast_to(b - a, origin.shape), np.broadcast_to(c - a, origin.shape), -direction], -1)
        u, v, t = np.moveaxis(np.linalg.solve(m, (origin - a)[..., None])[..., 0], -1, 0)
        best = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), np.minimum(best, t), best)
    return best


def test_equals_brute_force():
    rng = np.random.default_rng(0)
    vertices = rng.random((300, 3))
    faces = np.array([rng.choice(300, 3, replace=False) for _ in range(120)])
    origin, direction = 3 * rng.random((2000, 3)) - 1, rng.standard_normal((2000, 3))
    t, face = first_hits(ray_scene(vertices, faces), origin, direction)
    expected = brute_force(vertices[faces], origin, direction)
    np.testing.assert_array_equal(np.isfinite(t), np.isfinite(expected))
    hit = np.isfinite(t)
    assert hit.sum() > 100
    np.testing.assert_allclose(t[hit], expected[hit], rtol=1e-9)
    assert (face[~hit] == -1).all()
    on = origin[hit] + t[hit, None] * direction[hit]
    normal = np.cross(vertices[faces[face[hit], 1]] - vertices[faces[face[hit], 0]], vertices[faces[face[hit], 2]] - vertices[faces[face[hit], 0]])
    assert np.abs(np.einsum("nc,nc->n", on - vertices[faces[face[hit], 0]], normal)).max() < 1e-12


def test_no_ray_leaks_through_a_closed_solid():
    """From inside a turned cube every ray hits, also those at edges and corners, and along the axes."""
    R = random_rotation(2)
    target = np.concatenate([CUBE, (CUBE[CUBE_FACES][:, 0] + CUBE[CUBE_FACES][:, 1]) / 2, np.random.default_rng(0).random((3000, 3)) * 4 - 1.5])
    for rotation in (np.eye(3), R):
        vertices = CUBE @ rotation.T
        inside = np.array([0.3, 0.4, 0.45]) @ rotation.T
        direction = target @ rotation.T - inside
        t, _ = first_hits(ray_scene(vertices, CUBE_FACES), np.broadcast_to(inside, direction.shape), direction)
        assert np.isfinite(t).mean() > 0.999  # a ray through an exact edge may round to either side of both triangles
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    t, _ = first_hits(ray_scene(CUBE, CUBE_FACES), np.full((6, 3), 0.5), axes)
    np.testing.assert_allclose(t, 0.5)


def test_t_min_skips_the_start_and_ties_go_to_the_lower_face():
    scene = ray_scene(CUBE, np.concatenate([CUBE_FACES, CUBE_FACES]))
    origin, direction = np.array([[0.5, 0.4, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    t, face = first_hits(scene, origin, direction, t_min=1e-9)
    assert t[0] == 1
    assert face[0] < len(CUBE_FACES)


def test_no_triangle():
    with pytest.raises(InternalError, match="at least one triangle"):
        ray_scene(CUBE, np.zeros((0, 3), np.int64))


def test_threads_change_nothing():
    rng = np.random.default_rng(1)
    vertices = rng.random((3000, 3))
    scene = ray_scene(vertices, np.arange(3000).reshape(-1, 3))
    origin, direction = rng.random((40_000, 3)), rng.standard_normal((40_000, 3))
    for one, two in zip(first_hits(scene, origin, direction), first_hits(scene, origin, direction, threads=2), strict=True):
        np.testing.assert_array_equal(one, two)


def test_many_triangles_in_one_place_and_in_geometric_series():
    """Neither centres that no plane parts, nor splits that each part one triangle off, may break the tree."""
    same = np.tile(CUBE[[0, 3, 5]], (500, 1, 1))
    shrinking = CUBE[[0, 3, 5]] * (0.7 ** np.arange(400))[:, None, None]
    triangles = np.concatenate([same, shrinking])
    origin = np.random.default_rng(2).random((500, 3)) - 0.2
    direction = triangles[::2].mean(axis=1)[:450].repeat(2, axis=0)[:500] - origin
    t, face = first_hits(ray_scene(triangles.reshape(-1, 3), np.arange(2700).reshape(-1, 3)), origin, direction)
    np.testing.assert_allclose(t, brute_force(triangles, origin, direction), rtol=1e-9)
    assert face.min() >= 0
