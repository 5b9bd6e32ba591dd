import re

import numpy as np
import pytest

import real_scans
from scan2fea.errors import InputError
from scan2fea.io.pcap import datagrams
from scan2fea.kernel.lidar_units import HDL32E, VLP16
from scan2fea.simulation.lidar import Hdl32eOptions, LidarOptions, PlanarOptions, Vlp16Options, firings_of, rings_of, scan_lidar
from scan2fea.simulation.motion import kinematics, path_of
from sensed import block, clutter, nearest_by_brute_force, scene

DATA = real_scans.DATA / "velodyne"
ROOM = scene(block((-20, -20, -2.2), (20, 20, -2)), block((7, -20, -3), (8, 20, 20)))
HERE = {"positions_m": ((0.0, 0.0, 0.0),)}


def test_beams_of_the_hdl32e():
    fan = np.sort(HDL32E.elevations_deg)
    np.testing.assert_allclose([fan[0], fan[-1]], [-30.67, 10.67])
    np.testing.assert_allclose(np.diff(fan), 4 / 3, atol=0.0067)  # the maker rounds to 0.01
    assert HDL32E.elevations_deg[:6] == (-30.67, -9.33, -29.33, -8.0, -28.0, -6.67)
    assert HDL32E.elevations_deg[-2:] == (-10.67, 10.67)
    assert sorted(VLP16.elevations_deg) == list(range(-15, 16, 2))
    assert VLP16.elevations_deg[:4] == (-15, 1, -13, 3)
    assert rings_of(HDL32E.elevations_deg)[:3].tolist() == [0, 16, 1]


@real_scans.needs("velodyne")
def test_elevations_are_those_of_the_makers_calibration():
    text = (DATA / "velodyne_default_calib_HDL-32.xml").read_text()
    told = [float(x) for x in re.findall(r"<vertCorrection_>([^<]+)<", text)][:32]
    np.testing.assert_allclose(HDL32E.elevations_deg, told, atol=1e-6)


@real_scans.needs("velodyne")
def test_azimuth_steps_are_those_of_a_real_unit():
    """Steps between firings, in hundredths of a degree, at the real unit's rate of turn: the same mean, spread and histogram."""
    content = np.fromfile(DATA / "monterey-first-100-packets.pcap", np.uint8)
    starts, _ = datagrams(DATA, content, 1206)
    at = (starts[:, None] + 100 * np.arange(12)).ravel()
    told = content[at + 2].astype(int) + 256 * content[at + 3].astype(int)
    real = np.diff(told) % 36000
    rate = real.mean() / 36000 / (HDL32E.firing_us * 1e-6)
    assert 5 <= rate <= 20
    options = Hdl32eOptions(rate_hz=float(rate), frames=15, **HERE)
    azimuth = np.concatenate([firings_of(scan, options).azimuth_deg for scan in scan_lidar(ROOM, options, 3)])
    simulated = np.rint(np.diff(azimuth) * 100).astype(int) % 36000
    assert simulated.mean() == pytest.approx(real.mean(), abs=0.02)
    assert simulated.std() == pytest.approx(real.std(), rel=0.15)
    bins = np.arange(15, 26)
    shares = [np.histogram(steps, bins)[0] / len(steps) for steps in (real, simulated)]
    assert np.abs(shares[0] - shares[1]).sum() / 2 < 0.1  # total variation


def test_a_turn_has_the_firings_rings_and_times_of_the_unit():
    options = Hdl32eOptions(rate_hz=10.0, frames=2, noise_m=0.0, quantum_m=0.0, wobble_deg=0.0, azimuth_step_deg=0.0, **HERE)
    first, second = scan_lidar(ROOM, options)
    n = len(first.rays) // 32
    assert n in (2170, 2171)  # 0.1 s / 46.08 us
    time = first.rays.time_s.reshape(-1, 32)
    np.testing.assert_allclose(np.diff(time[:, 0]), 46.08e-6, rtol=1e-6)
    np.testing.assert_allclose(time[7] - time[7, 0], 1.152e-6 * np.arange(32), atol=1e-12)
    assert second.rays.time_s[0] - first.rays.time_s[-32] == pytest.approx(46.08e-6)
    elevation = np.degrees(np.arcsin(first.rays.direction[:, 2])).reshape(-1, 32)
    np.testing.assert_allclose(elevation, np.tile(HDL32E.elevations_deg, (n, 1)), atol=1e-9)
    assert first.rays.ring[:32].tolist() == rings_of(HDL32E.elevations_deg).tolist()
    azimuth = np.degrees(np.arctan2(-first.rays.direction[:, 1], first.rays.direction[:, 0])).reshape(-1, 32)
    np.testing.assert_allclose((np.diff(azimuth[:, 0]) + 180) % 360 - 180, 3600 * 46.08e-6, rtol=1e-6)  # clockwise from above
    np.testing.assert_allclose((azimuth[5] - azimuth[5, 0]), 3600 * 1.152e-6 * np.arange(32), atol=1e-9)  # the head turns on while they fire


def test_all_beams_cross_at_the_focal_point():
    options = Hdl32eOptions(frames=1, noise_m=0.0, wobble_deg=0.0, laser_us=0.0, **HERE)
    rays = scan_lidar(ROOM, options)[0].rays
    flat = rays.direction[:, :2] / np.linalg.norm(rays.direction[:, :2], axis=1, keepdims=True)
    focus = np.c_[options.focal_m * flat, np.zeros(len(flat))]
    off = focus - rays.origin
    off -= np.einsum("nc,nc->n", off, rays.direction)[:, None] * rays.direction
    assert np.linalg.norm(off, axis=1).max() < 1e-15
    assert (rays.origin[:, :2] == 0).all()


def test_reach_of_the_unit():
    far = scene(block((101, -90, -90), (102, 90, 90)), block((-0.9, -0.3, -0.2), (-0.8, 0.3, 0.2)))
    assert len(scan_lidar(far, Hdl32eOptions(frames=1, **HERE))[0].cloud) == 0
    near = scene(block((99, -90, -90), (102, 90, 90)))
    scan = scan_lidar(near, Hdl32eOptions(frames=1, noise_m=0.0, **HERE))[0]
    assert 0 < len(scan.cloud) < len(scan.rays)
    assert scan.rays.range_m[np.isfinite(scan.rays.range_m)].max() <= 100.001


def test_motion_within_the_turn():
    """Every firing has its own pose: without noise all points lie on the walls, though the sensor moves half a metre and turns meanwhile."""
    options = Hdl32eOptions(
        positions_m=((0, 0, 0), (0.5, 0.2, 0.1)),
        orientations_deg=((0, 0, 0), (5, -10, 90)),
        times_s=(0.0, 0.1),
        rate_hz=10.0,
        noise_m=0.0,
        quantum_m=0.0,
    )
    (scan,) = scan_lidar(ROOM, options)
    point, label = scan.cloud.points, scan.cloud.label
    assert np.abs(point[label == 0, 2] + 2).max() < 1e-12
    assert np.abs(point[label == 1, 0] - 7).max() < 1e-12
    firing = scan.rays.time_s[::32]
    state = kinematics(path_of(options, "x"), firing)
    height = -options.focal_m * np.tan(np.radians(HDL32E.elevations_deg))
    expected = state.position[:, None] + height[:, None] * state.rotation[:, None, :, 2]
    np.testing.assert_allclose(scan.rays.origin.reshape(-1, 32, 3), expected, atol=1e-15)
    assert np.ptp(scan.rays.origin[:, 0]) > 0.49
    still = Hdl32eOptions(positions_m=((0, 0, 0),), frames=1, rate_hz=10.0, noise_m=0.0, quantum_m=0.0)
    assert np.ptp(scan_lidar(ROOM, still)[0].rays.origin[:, 0]) == 0


def test_frames_and_one_in_five():
    way = {"positions_m": ((0, 0, 0), (0.5, 0, 0)), "times_s": (0.0, 1.0)}
    every = scan_lidar(ROOM, Hdl32eOptions(rate_hz=20.0, **way), 4)
    fifth = scan_lidar(ROOM, Hdl32eOptions(rate_hz=20.0, keep_every=5, **way), 4)
    assert (len(every), len(fifth)) == (20, 4)
    for k, scan in enumerate(fifth):
        np.testing.assert_array_equal(scan.cloud.points, every[5 * k].cloud.points)
        assert (scan.cloud.frame == k).all()
    assert len(scan_lidar(ROOM, Hdl32eOptions(frames=3, **way))) == 3


def test_firings_tell_what_was_shot():
    options = Vlp16Options(
        positions_m=((0, 0, 0), (0.5, 0.2, 0.1)), orientations_deg=((3, 4, 170), (5, -10, 240)), times_s=(0.0, 0.2), rate_hz=10.0, noise_m=0.03
    )
    for scan in scan_lidar(ROOM, options, 1):
        told = firings_of(scan, options)
        state = kinematics(path_of(options, "x"), told.time_s)
        local = np.einsum("fij,fbi->fbj", state.rotation, scan.rays.direction.reshape(-1, 16, 3))
        turned = told.azimuth_deg[:, None] + 3600 * 2.304e-6 * np.arange(16)
        flat = np.cos(np.radians(VLP16.elevations_deg))
        expected = np.stack(
            [
                flat * np.cos(np.radians(turned)),
                -flat * np.sin(np.radians(turned)),
                np.tile(np.sin(np.radians(VLP16.elevations_deg)), (len(turned), 1)),
            ],
            2,
        )
        np.testing.assert_allclose(local, expected, atol=1e-9)
        np.testing.assert_array_equal(told.range_m.ravel(), scan.rays.range_m)
        assert ((told.intensity > 0) <= np.isfinite(told.range_m)).all()
    with pytest.raises(InputError, match="none of a sensor of 32 beams"):
        firings_of(scan.compact(), Hdl32eOptions(**HERE))


def test_a_planar_scanner_stays_in_its_plane_and_window():
    options = PlanarOptions(frames=1, noise_m=0.0, **HERE)
    rays = scan_lidar(ROOM, options)[0].rays
    assert (rays.direction[:, 2] == 0).all()
    azimuth = np.degrees(np.arctan2(-rays.direction[:, 1], rays.direction[:, 0]))
    assert -95.0 <= azimuth.min() < -94.5
    assert 94.5 < azimuth.max() <= 95.0
    wall = 7 / np.cos(np.radians(azimuth))
    seen = np.abs(azimuth) < 70
    np.testing.assert_allclose(rays.range_m[seen], wall[seen], rtol=1e-12)


def test_any_table_of_beams():
    options = LidarOptions(elevations_deg=(5.0, -5.0), azimuths_deg=(0.0, 3.0), rate_hz=10.0, firing_us=100.0, frames=1, **HERE)
    rays = scan_lidar(ROOM, options)[0].rays
    azimuth = np.degrees(np.arctan2(-rays.direction[:, 1], rays.direction[:, 0])).reshape(-1, 2)
    np.testing.assert_allclose((azimuth[:, 1] - azimuth[:, 0]) % 360, 3.0, atol=1e-9)
    assert rays.ring[:2].tolist() == [1, 0]
    assert len(rays) == 2000


def test_no_point_lies_behind_an_occluder():
    room = clutter(5)
    (scan,) = scan_lidar(room, Hdl32eOptions(positions_m=((0, 0, 1.2),), frames=1, noise_m=0.0, quantum_m=0.0), 1)
    rows = np.random.default_rng(0).choice(len(scan.rays), 4000, replace=False)
    nearest = nearest_by_brute_force(room.mesh(), scan.rays.origin[rows], scan.rays.direction[rows])
    nearest[(nearest < 1) | (nearest > 100)] = np.inf
    np.testing.assert_allclose(np.nan_to_num(scan.rays.range_m[rows], nan=np.inf), nearest, rtol=1e-9)


def test_noise_is_along_each_ray_of_its_own_size():
    noisy = scan_lidar(ROOM, Hdl32eOptions(frames=1, **HERE), 1)[0]
    exact = scan_lidar(ROOM, Hdl32eOptions(frames=1, noise_m=0.0, quantum_m=0.0, **HERE), 1)[0]
    off = noisy.rays.range_m - exact.rays.range_m
    off = off[np.isfinite(off)]
    assert off.std() == pytest.approx(np.hypot(0.02, 0.002 / np.sqrt(12)), rel=0.02)
    on = noisy.rays.origin[noisy.cloud.ray] + noisy.rays.range_m[noisy.cloud.ray, None] * noisy.rays.direction[noisy.cloud.ray]
    np.testing.assert_allclose(noisy.cloud.points, on, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"elevations_deg": ()}, "elevations_deg is empty"),
        ({"window_deg": (30.0, 30.0)}, "window_deg"),
        ({"azimuths_deg": (1.0, 2.0)}, "azimuths_deg has 2 entries, elevations_deg has 1"),
        ({"frames": 10**9}, "give fewer frames"),
        ({"positions_m": ()}, "positions_m is empty"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(InputError, match=message):
        scan_lidar(ROOM, LidarOptions(**{**HERE, "frames": 1, **options}))
