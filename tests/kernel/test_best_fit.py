import numpy as np
import pytest

from scan2fea.kernel.best_fit import as_placed, best_fit
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import extent
from scan2fea.kernel.transforms import applied, quaternion_to_matrix, rigid
from scan2fea.simulation import parts

BODIES = {
    "bracket": parts.bracket(0.15, 0.16, 0.012, 0.12, [("a", 0.09, 0.03, 0.008), ("b", 0.1, 0.06, 0.012)], 1e-4).mesh,
    "block": parts.box(0.1, 0.07, 0.05).mesh,
}


@pytest.mark.parametrize(("name", "seed"), [("bracket", 1), ("bracket", 2), ("block", 3)])
def test_points_are_laid_onto_the_surface_from_anywhere(name, seed):
    rng, body = np.random.default_rng(seed), BODIES[name]
    T = rigid(quaternion_to_matrix(rng.standard_normal(4)), rng.uniform(-5, 5, 3))
    points = sample_surface(body, 8_000, seed)[0]
    sigma = 1e-3 * extent(points)
    found = best_fit(applied(T, points + sigma * rng.standard_normal(points.shape)), body)
    placed = applied(as_placed(found), body.vertices)
    off = np.linalg.norm(placed[:, None] - applied(T, body.vertices)[None], axis=2).min(axis=1)  # of a block each corner may lie on any other
    assert off.max() < 0.5 * sigma and found.sigma_m == pytest.approx(sigma, rel=0.1)


def test_a_dent_does_not_pull():
    body = BODIES["block"]
    points, _ = sample_surface(body, 8_000, 0)
    dented = points - np.where((points[:, 2] > 0.05 - 1e-9) & (points[:, 0] < 0.03), 0.002, 0.0)[:, None] * np.array([0.0, 0.0, 1.0])
    T = as_placed(best_fit(dented + 1e-5 * np.random.default_rng(0).standard_normal(points.shape), body))
    corners = applied(T, body.vertices)
    assert np.linalg.norm(corners[:, None] - body.vertices[None], axis=2).min(axis=1).max() < 5e-6
