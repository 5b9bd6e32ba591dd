import sys
from dataclasses import replace

import numpy as np
import pytest

from photographed import photographed, turned
from predicates import assert_closed_manifold_oriented, assert_no_crossing, box, extruded, sphere, two_sided
from scan2fea.kernel.measures import volume
from scan2fea.reconstruction import reconstruct
from scan2fea.reconstruction.budget import WALL_ENDS
from scan2fea.reconstruction.gates_ranges import HALVES, PASSED, UNSEEN_VOLUME, closed_holes
from scan2fea.reconstruction.hidden_volume import unseen_volume
from scan2fea.reconstruction.isosurface import isosurface, rebuilt, spread
from scan2fea.reconstruction.occupancy import Field, occupancy
from scan2fea.reconstruction.range_fit import measured, range_fit
from scan2fea.reconstruction.ranges import by_ranges, ray_sigma
from scan2fea.reconstruction.raster import images_of
from scan2fea.simulation.polyhedra import meshed, prism
from scan2fea.types import PointCloud, Scan, TriangleMesh

ANGLE = np.array([(0, 0), (0.6, 0), (0.6, 0.12), (0.12, 0.12), (0.12, 0.6), (0, 0.6)])
SIGMA = 0.03


@pytest.fixture(scope="module")
def angle():
    mesh, points, _ = photographed(extruded(ANGLE, 0.7, 0.1), 14, SIGMA, seed=2, pitch=0.008)
    images = images_of(points, np.arange(len(points)))
    return mesh, points, images


@pytest.fixture(scope="module")
def found(angle):
    _, points, _ = angle
    return reconstruct(Scan(cloud=PointCloud.of(points)))


def test_noise_is_measured_along_the_rays(angle):
    assert ray_sigma(angle[2]) == pytest.approx(SIGMA, rel=0.08)


def test_an_angle_in_noise_of_a_quarter_of_its_wall(angle, found):
    mesh, points, _ = angle
    assert found.source == "ranges"
    assert all(check.passed for check in found.checks), found.checks
    assert_closed_manifold_oriented(found.mesh)
    assert_no_crossing(found.mesh)
    assert volume(found.mesh) == pytest.approx(volume(mesh), rel=0.02)
    there, back = two_sided(found.mesh, mesh)
    assert max(np.percentile(there, 95), np.percentile(back, 95)) < 0.75 * SIGMA
    assert found.residual_m < 0.25 * SIGMA < found.sigma_m
    assert len(found.points) == len(found.normals) == len(found.thickness_m) == len(points)


def test_same_input_same_bytes_and_input_untouched(angle, found):
    points = angle[1]
    before = points.copy()
    again = reconstruct(Scan(cloud=PointCloud.of(points)))
    assert np.array_equal(again.mesh.vertices, found.mesh.vertices) and np.array_equal(again.mesh.faces, found.mesh.faces)
    assert np.array_equal(points, before)


def test_scale(angle, found):
    large = reconstruct(Scan(cloud=PointCloud.of(100.0 * angle[1])))
    assert volume(large.mesh) == pytest.approx(1e6 * volume(found.mesh), rel=0.01)
    assert [check.passed for check in large.checks] == [check.passed for check in found.checks]


def test_a_side_never_seen_is_refused():
    """All cameras on one side: the back is made up."""
    _, points, places = photographed(extruded(ANGLE, 0.7, 0.1), 16, SIGMA, seed=2, pitch=0.008)
    front = places[:, 2] > 0.5
    cut = Scan(cloud=PointCloud.of(points[front], raw_index=np.flatnonzero(front)))
    failed = [check.name for check in reconstruct(cut).checks if not check.passed]
    assert "unmeasured area" in failed


def test_where_a_scan_was_cut_the_walls_may_go_on(angle, found):
    """The pixels of the missing points are no proof that nothing was there."""
    _, points, _ = angle
    kept = points[:, 0] < np.quantile(points[:, 0], 0.85)
    cut = reconstruct(Scan(cloud=PointCloud.of(points[kept], raw_index=np.flatnonzero(kept))))
    assert cut.source == "ranges"
    assert WALL_ENDS in [check.name for check in cut.checks if not check.passed]
    assert {check.name: check.value for check in found.checks}[WALL_ENDS] < 0.001


def test_fit_has_no_bias(angle):
    """From a surface that is too small or too large all over, the ranges bring it back."""
    mesh, points, _ = photographed(sphere(0.5, rounds=4), 12, 0.02, seed=3, pitch=0.008)
    images = images_of(points, np.arange(len(points)))
    start = sphere(0.5, rounds=3)
    for factor in (0.95, 1.05):
        fitted = range_fit(TriangleMesh(vertices=factor * start.vertices, faces=start.faces), images, 0.02).mesh
        assert volume(fitted) == pytest.approx(volume(mesh), rel=0.01)
    exact = measured(mesh, images)
    assert abs(np.nanmean(exact.off_m)) < 4 * 0.02 / np.sqrt(len(points))
    assert np.nanstd(exact.off_m) == pytest.approx(0.02, rel=0.03)


def test_unmeasured_bulge_is_counted():
    """A ball of which a cap was met by no ray: area A and perimeter P of the cap hide A^2 / P."""
    ball = sphere(1.0, rounds=5)
    middle = ball.vertices[ball.faces].mean(axis=1)
    normal = middle / np.linalg.norm(middle, axis=1)[:, None]
    seen = middle[:, 2] < 0.8
    share, where = unseen_volume(ball, middle[seen], normal[seen], 0.02)
    area, perimeter = 2 * np.pi * 0.2, 2 * np.pi * 0.6
    exact = area**2 / perimeter / (4 / 3 * np.pi)
    assert 0.5 * exact < share < exact  # the rim of the patch runs along the edges of triangles: it is longer than the circle
    assert where[:, 2].min() > 0.75
    assert unseen_volume(ball, middle, normal, 0.02)[0] == 0.0
    assert 0 < UNSEEN_VOLUME < share and HALVES > 0 and PASSED > 0


def test_isosurface_of_a_ball():
    low, cell = np.full(3, -1.5), 0.1
    grid = np.stack(np.meshgrid(*[np.arange(31) * cell - 1.5] * 3, indexing="ij"), -1)
    field = Field(value=(4 * (1.0 - np.linalg.norm(grid, axis=-1))).astype(np.float32), low=low, cell_m=cell)
    mesh, n_parts = isosurface(field)
    assert n_parts == 1
    assert_closed_manifold_oriented(mesh)
    assert_no_crossing(mesh)
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi, rel=0.02)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1).max() < 0.02
    again, _ = rebuilt(mesh)
    assert_closed_manifold_oriented(again)
    assert volume(again) == pytest.approx(volume(mesh), rel=0.01)


def test_spread_keeps_its_distance():
    points = np.random.default_rng(0).random((500, 3))
    kept = spread(points, 0.1)
    apart = np.linalg.norm(kept[:, None] - kept, axis=2) + np.eye(len(kept))
    assert apart.min() > 0.1
    assert np.linalg.norm(points[:, None] - kept, axis=2).min(axis=1).max() <= 0.1


def test_solid_block_is_filled_to_its_core():
    """No ray has been inside; it is not a cavity."""
    mesh, points, _ = photographed(box((1.0, 0.8, 0.7)), 10, 0.02, seed=5, pitch=0.008)
    images = images_of(points, np.arange(len(points)))
    field = occupancy(images, points, 0.02, 0.05)
    filled = (field.value > 0).sum() * field.cell_m**3
    assert filled == pytest.approx(volume(mesh), rel=0.1)


def test_wrong_empty_rays_are_told(angle, monkeypatch):
    """Images whose empty rays contradict the rest are refused, not averaged, in the likeliest cell and in that which closes least."""
    module = sys.modules[by_ranges.__module__]
    monkeypatch.setattr(module, "TRIES", (module.TRIES[0], module.TRIES[-1]))
    _, points, images = angle
    empty = np.flatnonzero(~images.is_hit)
    wrong = images.direction.copy()
    rng = np.random.default_rng(0)
    turned = rng.choice(empty, len(empty) // 2, replace=False)
    aim = points[rng.integers(0, len(points), len(turned))] - images.origin[turned]
    wrong[turned] = aim / np.linalg.norm(aim, axis=1)[:, None]
    answer = by_ranges(points, replace(images, direction=wrong), SIGMA, 0)
    assert any(not check.passed for check in answer.checks)


def test_a_hole_that_was_filled_is_told_by_the_rays_through_it():
    """Of a plate with one hole scanned and none drawn; the plate as it is, and one whose hole lies half its width beside its place, keep theirs."""

    def plate(x):
        hole = np.array([[x, 0.27], [x, 0.33], [x + 0.06, 0.33], [x + 0.06, 0.27]])
        return meshed(prism([[0, 0], [1, 0], [1, 0.6], [0, 0.6]], 0.05, [hole]))

    mesh, points, _ = photographed(plate(0.47), 20, 0.01, seed=3)
    images = images_of(points, np.arange(len(points)))
    beside, filled = (turned(other, np.random.default_rng(3)) for other in (plate(0.5), box((1.0, 0.6, 0.05))))
    assert [closed_holes(measured(m, images), images).passed for m in (mesh, beside, filled)] == [True, True, False]


def test_a_surface_is_refused_whose_own_scan_comes_out_thicker_or_thinner(angle, monkeypatch):
    _, points, images = angle
    module = sys.modules[by_ranges.__module__]
    right = module._surface
    turns = iter((1.0, 1.03))  # of the reconstruction of the points, and of that of the surface's own image

    def thickened(*args):
        mesh, n_parts = right(*args)
        return replace(mesh, vertices=mesh.vertices * next(turns) ** (1 / 3)), n_parts

    monkeypatch.setattr(module, "_surface", thickened)
    monkeypatch.setattr(module, "TRIES", ((1.0, 1.0),))
    (own,) = [check for check in by_ranges(points, images, SIGMA, 0).checks if check.name == "own image"]
    assert not own.passed and own.value == pytest.approx(0.03, abs=0.01)
    assert "volume (limit 1%)" in own.says


def test_the_own_image_of_a_surface_has_its_noise_and_its_outline(angle, found):
    _, _, images = angle
    points, seen = sys.modules[by_ranges.__module__]._seen_again(found.mesh, images, SIGMA, 0)
    assert len(points) == seen.is_hit.sum() and np.array_equal(np.sort(seen.point[seen.is_hit]), np.arange(len(points)))
    assert ray_sigma(seen) == pytest.approx(SIGMA, rel=0.08)
    assert np.mean(seen.is_hit == images.is_hit) > 0.97  # but for the rims
