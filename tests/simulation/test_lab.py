"""The demo lab is what the report will call truth: points on the exact solids, noise along the ray, nothing seen through anything."""

import dataclasses

import numpy as np
import pytest

from scan2fea.errors import InputError
from scan2fea.kernel.distances import distance_to_mesh
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.rays import first_hits, ray_scene
from scan2fea.simulation import Lab, LabOptions, demo_lab, simulate, simulate_lab


@pytest.fixture(scope="module")
def scanned():
    return simulate_lab(LabOptions())


def points_of(scanned):
    return np.concatenate([s.cloud.points for s in scanned.scans]), np.concatenate([s.cloud.label for s in scanned.scans])


def test_size_and_objects(scanned):
    points, label = points_of(scanned)
    assert 130_000 <= len(points) <= 180_000
    assert len(scanned.truth) >= 9  # the floor and eight more
    counts = np.bincount(label, minlength=len(scanned.truth))
    assert counts.min() > 2000
    beam = next(i for i, o in enumerate(scanned.truth) if o.name == "l_beam")
    assert spacing(points[label == beam]) < 0.006
    assert scanned.truth[beam].volume_m3 == pytest.approx(4.7932e-3, rel=1e-4)


def test_what_hangs_is_seen_all_round(scanned):
    for thing, seen in zip(scanned.truth, scanned.seen, strict=True):
        if thing.name in ("l_beam", "bracket", "tank", "crate"):
            assert thing.stands_on == ""
            assert seen > 0.995
        if thing.stands_on:
            assert seen < 0.97


def test_points_lie_on_their_rays_and_noise_is_along_them(scanned):
    errors = []
    for scan in scanned.scans:
        ray = scan.cloud.ray
        np.testing.assert_allclose(scan.rays.origin[ray] + scan.rays.range_m[ray, None] * scan.rays.direction[ray], scan.cloud.points, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(scan.rays.direction, axis=1), 1, atol=1e-12)
        assert np.isnan(scan.rays.range_m).sum() == len(scan.rays) - len(ray) > 0  # misses are kept
        vertices = np.concatenate([o.mesh.vertices for o in scanned.truth])
        first = np.cumsum([0] + [len(o.mesh.vertices) for o in scanned.truth[:-1]])
        faces = np.concatenate([o.mesh.faces + f for o, f in zip(scanned.truth, first, strict=True)])
        t, _ = first_hits(ray_scene(vertices, faces), scan.rays.origin[ray], scan.rays.direction[ray])
        errors.append(scan.rays.range_m[ray] - t)
    error = np.concatenate(errors)
    assert error.mean() == pytest.approx(0, abs=5e-6)
    assert error.std() == pytest.approx(5e-4, rel=0.01)
    assert np.quantile(np.abs(error), 0.6827) == pytest.approx(5e-4, rel=0.02)


def test_without_noise_points_lie_on_their_objects():
    exact = simulate_lab(LabOptions(noise_m=0.0, density=0.05, overview_deg=0.0))
    points, label = points_of(exact)
    for i, thing in enumerate(exact.truth):
        own = points[label == i]
        nearest = distance_to_mesh(own, thing.mesh)
        assert nearest.distance.max() < 1e-9  # double precision on needles of 3 m by 6 mm
        a, b, c = np.moveaxis(thing.mesh.vertices[thing.mesh.faces[nearest.face]].astype(np.longdouble), 1, 0)
        normal = np.cross(b - a, c - a)
        above = np.abs(((own - a) * normal).sum(axis=1)) / np.sqrt((normal**2).sum(axis=1))
        assert above.max() < 1e-12


def test_same_seed_same_bytes_and_other_seed_other_points():
    small = LabOptions(density=0.02, overview_deg=20.0)
    a, b = simulate_lab(small), simulate_lab(small)
    for x, y in zip(a.scans, b.scans, strict=True):
        assert x.cloud.points.tobytes() == y.cloud.points.tobytes()
        assert x.rays.direction.tobytes() == y.rays.direction.tobytes()
    other = simulate_lab(dataclasses.replace(small, seed=1))
    assert other.scans[0].cloud.points.tobytes() != a.scans[0].cloud.points.tobytes()


def test_a_scene_without_sensor_or_object_is_refused():
    lab = demo_lab()
    with pytest.raises(InputError, match="no sensor"):
        simulate(Lab(objects=lab.objects, stations=np.zeros((0, 3))))
    with pytest.raises(InputError, match="no object"):
        simulate(Lab(objects=(), stations=lab.stations))
