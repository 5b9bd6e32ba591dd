import numpy as np

from scan2fea.io import read_scan
from scan2fea.pipeline.simulate_logs import write_logs
from scan2fea.simulation.motion import as_measured, path_of, trajectory_at
from scan2fea.simulation.sensors import SENSORS
from sensed import clutter

ROOM = clutter()
WAY = {"positions_m": ((0, 0, 1.2), (0.5, 0.2, 1.2)), "orientations_deg": ((0, 0, 0), (0, 0, 30)), "times_s": (0.0, 0.2)}


def logged(tmp_path, kind, **options):
    made = SENSORS[kind].options(**{**WAY, **options})
    scans = SENSORS[kind].scan(ROOM, made, 3)
    return made, scans, {p.name: p for p in write_logs(tmp_path, kind, kind, made, scans, 3)}


def test_a_moving_unit_has_its_way_its_instruments_and_its_capture(tmp_path):
    options, scans, files = logged(tmp_path, "hdl32e")
    assert set(files) == {f"hdl32e{end}" for end in ("_imu.csv", "_gps.csv", "_truth.txt", "_odometry.txt", "_frames.txt", ".pcap")}
    frames = np.loadtxt(files["hdl32e_frames.txt"])
    assert len(frames) == len(scans) == 4
    expected = trajectory_at(path_of(options, "x"), frames[:, 0]).T_world_frame
    np.testing.assert_allclose(frames[:, 1:4], expected[:, :3, 3])
    assert len(np.loadtxt(files["hdl32e_imu.csv"], delimiter=",", skiprows=1)) == 41
    raw = read_scan(files["hdl32e.pcap"]).scan.cloud.points
    told = np.concatenate([as_measured(scan, path_of(options, "x")).cloud.points for scan in scans])
    # azimuths of 0.01 degree at up to 10 m, and the pose of the firing instead of the shot
    assert np.abs(raw - told).max() < np.radians(0.01) * 10 + 2.7 * 36e-6


def test_who_stands_has_no_way(tmp_path):
    assert logged(tmp_path, "terrestrial", step_deg=10.0)[2] == {}
    _, _, files = logged(tmp_path, "hdl32e", positions_m=((0, 0, 1.2),), orientations_deg=(), times_s=())
    assert set(files) == {"hdl32e.pcap"}
