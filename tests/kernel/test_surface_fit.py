import numpy as np
import pytest

from predicates import rotation, torus
from scan2fea.cad.patches import GROW_COSINE, Near, _fits
from scan2fea.kernel.surfaces import CONE, CYLINDER, PLANE, SPHERE, TORUS, Surface, fitted, slopes

EXACT = {
    PLANE: Surface(kind=PLANE, point=np.array([0.3, -0.2, 0.5]), axis=rotation(2)[:, 2]),
    CYLINDER: Surface(kind=CYLINDER, point=np.array([0.3, -0.2, 0.5]), axis=rotation(2)[:, 2], radius=0.7),
    CONE: Surface(kind=CONE, point=np.array([0.3, -0.2, 0.5]), axis=rotation(2)[:, 2], radius=0.7, second=0.3),
    SPHERE: Surface(kind=SPHERE, point=np.array([0.3, -0.2, 0.5]), axis=np.array([0, 0, 1.0]), radius=0.7),
    TORUS: Surface(kind=TORUS, point=np.array([0.3, -0.2, 0.5]), axis=rotation(2)[:, 2], radius=0.7, second=0.2),
}


def on(surface, n=300, sigma=0.0):
    rng = np.random.default_rng(3)
    points = surface.projected(surface.point + rng.uniform(-0.8, 0.8, (n, 3)))
    return points + sigma * rng.standard_normal((n, 1)) * surface.normals(points)


@pytest.mark.parametrize("kind", EXACT)
def test_the_exact_surface_comes_back_from_a_start_nearby(kind):
    exact = EXACT[kind]
    points = on(exact)
    start = Surface(
        kind=kind, point=exact.point + 0.03, axis=(exact.axis + 0.03) / np.linalg.norm(exact.axis + 0.03),
        radius=exact.radius * 1.05, second=exact.second * 1.1,
    )  # fmt: skip
    found = fitted(start, points)
    assert np.abs(found.distance(points)).max() < 1e-9
    if kind != CONE:  # whose radius is that at its point, and that may lie anywhere on the axis
        assert found.radius == pytest.approx(exact.radius, abs=1e-8)
    assert abs(found.second) == pytest.approx(exact.second, abs=1e-8)


@pytest.mark.parametrize("kind", EXACT)
def test_it_ends_where_the_slopes_of_the_sum_of_squares_vanish(kind):
    points = on(EXACT[kind], sigma=0.01)
    weights = np.random.default_rng(1).uniform(0.5, 2, len(points))
    found = fitted(EXACT[kind], points, weights)
    J, d = slopes(found, points), found.distance(points)
    assert np.abs((J * weights[:, None]).T @ d).max() < 1e-5 * np.sqrt((J**2).sum(0).max() * (d**2).sum())


def test_what_is_held_does_not_move():
    exact = EXACT[CYLINDER]
    free = np.array([True, True, False, False, True])
    found = fitted(exact, on(exact, sigma=0.02), None, free)
    np.testing.assert_allclose(found.axis, exact.axis, atol=1e-15)
    assert found.radius != exact.radius


@pytest.mark.parametrize("kind", [PLANE, CYLINDER, CONE, SPHERE, TORUS])
def test_a_flood_is_the_connected_part_of_the_faces_that_fit(kind):
    mesh = torus(0.1, 0.03)
    near = Near(mesh)
    seed = 17
    start = near.around(seed, np.ones(len(mesh.faces), bool))
    centre = near.centres[start].mean(0)
    axis = near.smooth[seed]
    surface = {
        PLANE: Surface(kind=PLANE, point=centre, axis=axis),
        CYLINDER: Surface(kind=CYLINDER, point=centre - 0.03 * axis, axis=near.mesh.vertices[0] * 0 + [1.0, 0, 0], radius=0.03),
        CONE: Surface(kind=CONE, point=centre - 0.03 * axis, axis=np.array([0.0, 1, 0]), radius=0.03, second=0.1),
        SPHERE: Surface(kind=SPHERE, point=centre - 0.05 * axis, axis=axis, radius=0.05),
        TORUS: Surface(kind=TORUS, point=np.zeros(3), axis=np.array([0, 0, 1.0]), radius=0.1, second=0.031),
    }[kind]
    free = np.ones(len(mesh.faces), bool)
    free[200:400] = False
    inside = np.zeros(len(mesh.faces), bool)
    inside[start] = True
    wanted = inside.copy()
    may = free & _fits(near, np.arange(len(mesh.faces)), surface, 0.004)
    while True:
        more = wanted | (may & wanted[near.of].any(1))
        if (more == wanted).all():
            break
        wanted = more
    assert not near.flood(inside, surface, 0.004, free, len(free))
    assert (inside == wanted).all()
    assert GROW_COSINE > 0.8


def test_a_flood_stops_after_the_wave_that_passes_its_limit():
    mesh = torus(0.1, 0.03)
    near = Near(mesh)
    surface = Surface(kind=TORUS, point=np.zeros(3), axis=np.array([0, 0, 1.0]), radius=0.1, second=0.03)
    inside = np.zeros(len(mesh.faces), bool)
    inside[0] = True
    assert near.flood(inside, surface, 1.0, np.ones(len(mesh.faces), bool), 10)
    assert 10 < inside.sum() < 40
