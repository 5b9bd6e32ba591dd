"""What holds for every sensor of the table."""

import dataclasses

import numpy as np
import pytest

from scan2fea.errors import InputError
from scan2fea.simulation.sensors import SENSORS
from sensed import clutter, nearest_by_brute_force

ROOM = clutter(3)
WAY = {"positions_m": ((0.0, -0.4, 1.2), (0.3, 0.6, 1.3)), "times_s": (0.0, 1.0)}
QUICK = {
    "terrestrial": {"step_deg": 4.0},
    "hdl32e": {"keep_every": 10},
    "vlp16": {"keep_every": 5},
    "planar": {"keep_every": 10},
    "lidar": {"keep_every": 5},
    "line_laser": {"max_range_m": 9.0},
    "photogrammetry": {"features_per_m2": 50.0},
    "sfm": {"features_per_m2": 50.0},
    "stereo": {"features_per_m2": 50.0},
}
EXACT = {"noise_m": 0.0, "noise_px": 0.0, "stripe_px": 0.0, "clock_us": 0.0, "quantum_m": 0.0, "footprint_rays": 1, "max_range_m": 50.0}
OURS = [name for name in SENSORS if name != "stations"]  # that one takes no times


def made(name, **more):
    known = {f.name for f in dataclasses.fields(SENSORS[name].options)}
    wanted = {**WAY, **QUICK.get(name, {}), **more}
    return SENSORS[name].options(**{k: v for k, v in wanted.items() if k in known})


def bytes_of(scans):
    rows = [(s.cloud.points, s.cloud.label, s.rays.origin, s.rays.direction, s.rays.range_m, s.rays.time_s) for s in scans if s.rays is not None]
    return b"".join(np.ascontiguousarray(a).tobytes() for row in rows for a in row)


@pytest.mark.parametrize("name", OURS)
def test_same_seed_same_bytes(name):
    scan, options = SENSORS[name].scan, made(name, noise_m=0.01, footprint_rays=16 if name == "ultrasonic" else 1)
    assert bytes_of(scan(ROOM, options, 5)) == bytes_of(scan(ROOM, options, 5)) != bytes_of(scan(ROOM, options, 6))


@pytest.mark.parametrize("name", OURS)
def test_scans_are_whole(name):
    scans = SENSORS[name].scan(ROOM, made(name, noise_m=0.01, noise_along="isotropic", outlier_share=0.1, mismatch_share=0.1), 1)
    assert sum(len(s.cloud) for s in scans) > 15
    for k, scan in enumerate(scans):
        cloud, rays = scan.cloud, scan.rays
        np.testing.assert_allclose(np.linalg.norm(rays.direction, axis=1), 1, rtol=1e-12)
        assert len(np.unique(cloud.ray)) == len(cloud)
        assert np.isfinite(rays.range_m[cloud.ray]).all()
        assert np.isfinite(rays.range_m).sum() == len(cloud)
        assert (cloud.frame == k).all()
        assert ((cloud.label >= -1) & (cloud.label < len(ROOM.solids))).all()
        assert np.isfinite(cloud.points).all()
        assert (cloud.sigma_along_m > 0).all()
        assert (np.diff(rays.time_s) >= 0).all() or name in ("photogrammetry", "sfm", "stereo")
        assert rays.ring is not None
        assert rays.footprint_rad is not None


@pytest.mark.parametrize("name", [name for name in OURS if name != "ultrasonic"])
def test_no_point_lies_behind_an_occluder(name):
    """Without noise, brute force finds nothing nearer along any ray, and just that surface at its end."""
    for scan in SENSORS[name].scan(ROOM, made(name, **EXACT), 2):
        rows = np.random.default_rng(0).permutation(scan.cloud.ray)[:1500]
        nearest = nearest_by_brute_force(ROOM.mesh(), scan.rays.origin[rows], scan.rays.direction[rows])
        np.testing.assert_allclose(scan.rays.range_m[rows], nearest, rtol=1e-9)


@pytest.mark.parametrize("name", list(SENSORS))
def test_options_are_declared_and_a_sensor_needs_a_place(name):
    for field in dataclasses.fields(SENSORS[name].options):
        assert field.metadata.get("doc"), field.name
    assert SENSORS[name].doc
    with pytest.raises(InputError, match="positions_m"):
        SENSORS[name].scan(ROOM, SENSORS[name].options(), 0)


def test_the_scene_is_untouched():
    before = [s.mesh.vertices.tobytes() for s in ROOM.solids]
    for name in OURS:
        SENSORS[name].scan(ROOM, made(name, footprint_rays=16), 0)
    assert [s.mesh.vertices.tobytes() for s in ROOM.solids] == before


@pytest.mark.parametrize("name", OURS)
def test_a_sensor_that_sees_nothing_gives_empty_scans(name):
    away = made(name, positions_m=((0.0, 0.0, 900.0), (0.0, 1.0, 900.0)), orientations_deg=((0, -80, 0), (0, -80, 0)), times_s=(0.0, 1.0))
    for scan in SENSORS[name].scan(ROOM, away, 0):
        assert len(scan.cloud) == 0
        assert scan.cloud.label.dtype == np.int64
