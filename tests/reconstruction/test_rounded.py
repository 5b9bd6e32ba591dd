from dataclasses import replace

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, box, moved, rotation, sphere
from scan2fea.errors import ReconstructionError
from scan2fea.kernel.measures import volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.reconstruction import ReconstructionOptions, reconstruct, visibility
from scan2fea.reconstruction.rounded import _bending, divided, rounded, served_smooth
from scan2fea.types import TriangleMesh
from scanned import scan_of, scanned

EGG = np.diag([0.12, 0.1, 0.08])


def egg():
    return moved(sphere(1.0, rounds=5), rotation(3) @ EGG, np.array([1.0, 2.0, 3.0]))


def hidden_cap(scan, places, angle_deg):
    """Without what lies within an angle of +x of the middle."""
    way = places - places.mean(axis=0)
    seen = way[:, 0] < np.cos(np.radians(angle_deg)) * np.linalg.norm(way, axis=1)
    return scan_of(scan.cloud.points[seen], scan.sensors()[seen])


@pytest.mark.parametrize("sigma", [0.0, 0.002])
def test_a_coarse_scan_of_an_egg_keeps_its_volume_over_a_cap_that_nobody_saw(sigma):
    scan, places, _ = scanned(egg(), 0.02, sigma, seed=0)
    scan = hidden_cap(scan, places, 30.0)
    flat = reconstruct(scan, ReconstructionOptions(smooth=False))
    found = reconstruct(scan)
    assert found.how["method"] == "smooth"
    assert all(check.passed for check in found.checks)
    assert_closed_manifold_oriented(found.mesh)
    assert not len(self_intersections(found.mesh))
    assert volume(flat.mesh) < 0.95 * volume(egg())
    assert volume(found.mesh) == pytest.approx(volume(egg()), rel=0.015)


def test_larger_caps_leave_more_open_until_they_are_refused():
    scan, places, _ = scanned(egg(), 0.02, 0.0, seed=0)
    first = {angle: visibility(hidden_cap(scan, places, angle)) for angle in (0.0, 30.0, 75.0)}
    open_ = [
        next(c for c in rounded(hidden_cap(scan, places, angle), found).checks if c.name == "volume under gaps") for angle, found in first.items()
    ]
    assert open_[0].value < open_[1].value < open_[2].value
    assert [check.passed for check in open_] == [True, True, False]


@pytest.mark.parametrize("sigma", [0.0, 0.001])
def test_a_box_is_not_taken_for_a_smooth_part(sigma):
    scan = scanned(moved(box((0.1, 0.08, 0.06)), rotation(1), np.zeros(3)), 0.01, sigma, seed=0)[0]
    first = visibility(scan)
    assert served_smooth(scan, first).mesh is first.mesh


def test_the_bending_of_flat_and_evenly_curved_places_is_nothing_and_scales():
    mesh = sphere(1.0, rounds=3)
    assert np.abs(_bending(mesh) @ np.ones(len(mesh.vertices))).max() < 1e-6
    K, larger = _bending(mesh), _bending(TriangleMesh(vertices=2.0 * mesh.vertices, faces=mesh.faces))
    assert abs(larger - K / 16.0).max() < 1e-9 * abs(K).max()


def test_divided_triangles_lie_where_they_were():
    mesh = box((1.0, 1.0, 1.0))
    finer = divided(mesh, 0.3)
    assert_closed_manifold_oriented(finer)
    assert volume(finer) == pytest.approx(1.0)
    with pytest.raises(ReconstructionError, match="dense"):
        divided(mesh, 1e-3)


def test_without_sensors_the_first_surface_stays():
    scan = scanned(egg(), 0.02, 0.0, seed=0)[0]
    first = replace(visibility(scan), source="outside flood")
    assert served_smooth(scan, first) is first
