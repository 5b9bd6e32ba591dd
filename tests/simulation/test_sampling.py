"""Points on surfaces: on the surface, as dense as asked, uniform by area, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import chi2

from scan2fea.errors import InputError
from scan2fea.kernel.measures import area, face_areas, face_normals
from scan2fea.kernel.transforms import random_rotation, rigid
from scan2fea.simulation.sampling import SamplingOptions, blue_noise, noise_sd, on_grid, sampled, sampled_solid
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Scene, Solid


def solid(kind, values, spacing=0.01, T=None):
    shape = KINDS[kind].build(values, 1e-4)
    T = rigid(random_rotation(2), [1.0, 2.0, -0.5]) if T is None else T
    return Solid(name=kind, shape=shape, T_world_shape=T, mesh=posed(shape.mesh, T), volume_m3=1.0, spacing_m=spacing)


L = solid("L", {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 0.6}, 0.004)
TANK = solid("tank", {"d": 0.3, "height": 0.3, "t": 0.012}, 0.006)


def above(points, face, mesh):
    """(n,) distance from the plane of the face, in extended precision."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[face]].astype(np.longdouble), 1, 0)
    normal = np.cross(b - a, c - a)
    return np.abs(((points - a) * normal).sum(1)) / np.sqrt((normal**2).sum(1))


@pytest.mark.parametrize("method", ["uniform", "blue_noise", "grid"])
@pytest.mark.parametrize("thing", [L, TANK], ids=["L", "tank"])
def test_points_lie_on_their_faces(method, thing):
    points, face = sampled_solid(thing, SamplingOptions(method=method), 3)
    assert above(points, face, thing.mesh).max() < 1e-12
    assert len(np.unique(face)) > 0.5 * min(len(thing.mesh.faces), len(points) / 20)


@pytest.mark.parametrize("thing", [L, TANK], ids=["L", "tank"])
def test_uniform_by_area_chi_square(thing):
    """Counts of faces, pooled to expectations of 30 and more, against their areas: p between 0.1 % and 99.9 %."""
    points, face = sampled_solid(thing, SamplingOptions(method="uniform", spacing_m=0.002), 11)
    share = face_areas(thing.mesh) / area(thing.mesh)
    pool = np.floor(np.cumsum(share) * len(points) / 30 * (1 - 1e-12)).astype(int)
    observed, expected = np.bincount(pool[face], minlength=pool.max() + 1), np.bincount(pool, weights=share * len(points))
    used = expected > 5
    statistic = ((observed - expected)[used] ** 2 / expected[used]).sum()
    assert 0.001 < chi2.cdf(statistic, used.sum() - 1) < 0.999


def test_uniform_within_one_face():
    plate = solid("plate", {"b": 1.0, "t": 0.01, "length": 1.0}, 0.004, np.eye(4))
    points, face = sampled_solid(plate, SamplingOptions(), 5)
    top = points[face_normals(plate.mesh)[face][:, 1] > 0.5]
    counts, _, _ = np.histogram2d(top[:, 0], top[:, 2], bins=20, range=[[-0.5, 0.5], [0, 1]])
    expected = len(top) / 400
    assert 0.001 < chi2.cdf(((counts - expected) ** 2 / expected).sum(), 399) < 0.999


def test_blue_noise_keeps_its_gap_and_its_density():
    ball = solid("sphere", {"d": 0.4}, 0.01, np.eye(4))
    points, _ = blue_noise(ball.mesh, 0.01, 3)
    gap = cKDTree(points).query(points, k=2)[0][:, 1]
    assert gap.min() >= 0.66 * 0.01 * np.sqrt(2 / np.sqrt(3))
    assert len(points) == pytest.approx(area(ball.mesh) / 1e-4, rel=0.06)
    brute = np.linalg.norm(points[:200, None] - points[None, :200], axis=2)
    assert (brute[~np.eye(200, dtype=bool)] >= gap.min()).all()


def test_the_grid_by_brute_force_on_a_box():
    """Exactly the products of (i + 1/4) pitch on each face, both sides."""
    box = KINDS["box"].build({"x": 0.105, "y": 0.043, "z": 0.031}, 1e-4).mesh
    points, _ = on_grid(box, 0.01)
    sizes = (0.105, 0.043, 0.031)
    ticks = [(np.arange(40) + 0.25) * 0.01 for _ in range(3)]
    ticks = [t[t < s] for t, s in zip(ticks, sizes, strict=True)]
    expected = 2 * sum(len(ticks[i]) * len(ticks[(i + 1) % 3]) for i in range(3))
    assert len(points) == expected
    assert len(np.unique(points.round(12), axis=0)) == expected
    top = points[points[:, 2] == 0.031]
    assert len(top) == len(ticks[0]) * len(ticks[1])
    np.testing.assert_allclose(np.unique(top[:, 0].round(9)), ticks[0], atol=1e-9)


def test_the_grid_has_every_line_once_where_triangles_meet():
    """Lines through the edges between triangles of one face: a square cut along lines of the grid itself."""
    from scan2fea.types import TriangleMesh

    n = np.arange(5) * 0.01 + 0.0025
    x, y = (g.ravel() for g in np.meshgrid(n, n, indexing="ij"))
    quads = [(i * 5 + j, (i + 1) * 5 + j, (i + 1) * 5 + j + 1, i * 5 + j + 1) for i in range(4) for j in range(4)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    points, _ = on_grid(TriangleMesh(vertices=np.c_[x, y, np.zeros(25)], faces=faces), 0.01)
    inner = points[(points[:, :2] > 0.0026).all(1) & (points[:, :2] < 0.0424).all(1)]
    assert len(inner) == 9
    assert len(np.unique(points.round(12), axis=0)) == len(points)


def test_both_faces_of_a_thin_wall_and_its_toe():
    points, face = sampled_solid(L, SamplingOptions(method="grid", spacing_m=0.0101), 0)
    own = (points - L.T_world_shape[:3, 3]) @ L.T_world_shape[:3, :3]
    normal = face_normals(L.mesh)[face] @ L.T_world_shape[:3, :3]
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1)):
        assert ((normal[:, axis] * sign > 0.9) & (own[:, 2] > 0)).sum() > 50, (axis, sign)
    assert (own[:, 0] > 0.127 - 1e-9).sum() > 50  # the toe of leg a


def test_noise_has_the_moments_and_law_asked_for():
    from scipy.stats import kstest

    scene = Scene(name="s", solids=(L,))
    clean = sampled(scene, SamplingOptions(), 4).cloud.points
    for law, sd, cdf in (("gaussian", 0.002, "norm"), ("uniform", 0.002 / 3**0.5, "uniform")):
        noisy = sampled(scene, SamplingOptions(noise=law, noise_m=0.002), 4)
        error = (noisy.cloud.points - clean).ravel()
        assert noise_sd(law, 0.002) == pytest.approx(sd)
        assert error.std() == pytest.approx(sd, rel=0.02)
        assert abs(error.mean()) < 4 * sd / len(error) ** 0.5
        scaled = error / 0.002 if law == "gaussian" else error / 0.004 + 0.5
        assert kstest(scaled, cdf).pvalue > 1e-3
        assert noisy.cloud.sigma_along_m[0] == pytest.approx(sd)


@pytest.mark.parametrize("method", ["uniform", "blue_noise", "grid"])
def test_same_seed_same_bytes(method):
    scene = Scene(name="s", solids=(TANK, L))
    a, b = (sampled(scene, SamplingOptions(method=method, noise_m=0.001), 9) for _ in range(2))
    assert a.cloud.points.tobytes() == b.cloud.points.tobytes()
    other = sampled(scene, SamplingOptions(method=method, noise_m=0.001), 10)
    assert other.cloud.points.tobytes() != a.cloud.points.tobytes()


def test_too_many_points_are_refused():
    with pytest.raises(InputError, match="object tank: a spacing of 1e-06 m makes"):
        sampled_solid(TANK, SamplingOptions(spacing_m=1e-6), 0)
