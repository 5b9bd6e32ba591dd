import numpy as np
import pytest

from predicates import rotation, sphere
from scan2fea.errors import InternalError
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals
from scan2fea.kernel.winding import layout, winding


def dipoles(n, seed=0):
    mesh = sphere(1.0, rounds=4)
    points, face = sample_surface(mesh, n, seed)
    return points, face_normals(mesh)[face], np.full(n, area(mesh) / n)


def by_definition(points, normals, areas, softening, queries):
    off = points[None] - queries[:, None]
    r2 = (off**2).sum(-1) + softening**2
    dot = (normals[None] * off).sum(-1)
    value = (areas * dot * r2**-1.5).sum(1) / (4 * np.pi)
    outward = (areas[:, None] * (normals[None] * r2[..., None] ** -1.5 - 3 * dot[..., None] * off * r2[..., None] ** -2.5)).sum(1) / (4 * np.pi)
    return value, outward


@pytest.mark.parametrize("n", [1, 7, 8, 9, 3000])
def test_equals_the_sum(n):
    points, normals, areas = dipoles(n)
    queries = np.random.default_rng(1).normal(size=(100, 3))
    exact, gradient = by_definition(points, normals, areas, 0.05, queries)
    w, g = winding(layout(points), normals, areas, 0.05, queries, opening=0.0)
    np.testing.assert_allclose(w, exact, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(g, gradient, rtol=1e-8, atol=1e-10)
    w, g = winding(layout(points), normals, areas, 0.05, queries)
    np.testing.assert_allclose(w, exact, atol=0.05)


def test_far_away_the_cells_answer():
    points, normals, areas = dipoles(3000)
    away = 20.0 * points[:50]
    half = points[:, 2] > 0  # open: a dipole far away
    args = (normals[half], areas[half], 0.05)
    exact, gradient = by_definition(points[half], *args, away)
    w, g = winding(layout(points[half]), *args, away)
    np.testing.assert_allclose(w, exact, atol=1e-2 * np.abs(exact).max())
    np.testing.assert_allclose(g, gradient, atol=1e-2 * np.abs(gradient).max())


def test_gradient_is_the_derivative():
    points, normals, areas = dipoles(500)
    queries = np.random.default_rng(2).uniform(-1.5, 1.5, (20, 3))
    tree, step = layout(points), 1e-5
    _, outward = winding(tree, normals, areas, 0.2, queries, opening=0.0)
    for axis in range(3):
        move = step * np.eye(3)[axis]
        ahead, back = (winding(tree, normals, areas, 0.2, queries + s * move, opening=0.0)[0] for s in (1, -1))
        np.testing.assert_allclose(-(ahead - back) / (2 * step), outward[:, axis], atol=1e-6)


def test_one_inside_none_outside_half_on_a_sphere():
    points, normals, areas = dipoles(20_000)
    tree = layout(points)
    at = lambda r: winding(tree, normals, areas, 0.02, r * points[:300])[0]  # noqa: E731
    np.testing.assert_allclose(at(0.5), 1.0, atol=0.06)
    np.testing.assert_allclose(at(2.0), 0.0, atol=0.06)
    on, outward = winding(tree, normals, areas, 0.05)
    assert abs(np.median(on) - 0.5) < 0.05
    assert (np.einsum("ij,ij->i", outward, normals) > 0).all()


def test_motion_scale_and_order():
    points, normals, areas = dipoles(2000)
    w, g = winding(layout(points), normals, areas, 0.1)
    turn, order = rotation(3), np.random.default_rng(0).permutation(len(points))
    moved = layout((points @ turn.T * 50.0 + [1e3, -2e3, 0])[order])
    other, gradient = winding(moved, (normals @ turn.T)[order], 2500.0 * areas[order], 5.0)
    np.testing.assert_allclose(other, w[order], atol=0.06)
    assert (np.einsum("ij,ij->i", gradient, (g @ turn.T)[order]) > 0).mean() > 0.999


def test_same_bytes_and_input_untouched():
    points, normals, areas = dipoles(1000)
    before = points.copy(), normals.copy(), areas.copy()
    first, again = (winding(layout(points), normals, areas, 0.1) for _ in range(2))
    assert first[0].tobytes() == again[0].tobytes() and first[1].tobytes() == again[1].tobytes()
    for kept, given in zip(before, (points, normals, areas), strict=True):
        np.testing.assert_array_equal(kept, given)


def test_wrong_lengths_and_no_points():
    points, normals, areas = dipoles(10)
    with pytest.raises(InternalError, match="9 areas"):
        winding(layout(points), normals, areas[:9], 0.1)
    with pytest.raises(InternalError, match="at least one point"):
        layout(np.zeros((0, 3)))
