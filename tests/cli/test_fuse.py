"""`scan2fea fuse`, and a capture that is put together by `--imu` and `--gps`."""

import json

import numpy as np
import pytest

from fusion.flights import errors_of, flight
from fusion.test_particle import ANGLE, MAP, seen, way
from registration.test_motion import capture, off_room
from scan2fea.cli.main import main
from scan2fea.io import read_scan, write_trajectory
from scan2fea.registration import read_trajectory
from scan2fea.simulation.motion import path_through, trajectory_at
from scan2fea.simulation.sensor_logs import LogOptions, gps_csv, imu_csv, sensor_logs
from scan2fea.types import Trajectory


def files(folder, logs):
    folder.mkdir(exist_ok=True)
    (folder / "imu.csv").write_text(imu_csv(logs.imu))
    (folder / "gps.csv").write_text(gps_csv(logs.gps))
    write_trajectory(folder / "odometry.txt", logs.odometry)
    return [str(folder / name) for name in ("imu.csv", "gps.csv", "odometry.txt")]


def test_fuse_writes_trajectory_covariance_picture_and_report(tmp_path, capsys):
    logs = flight(11, 20.0)
    paths = files(tmp_path / "logs", logs)
    outs = [tmp_path / "one", tmp_path / "two"]
    for out in outs:
        assert main(["fuse", *paths, "-o", str(out), "--set", "fusion.rate_hz=20"]) == 0
    said = capsys.readouterr().out
    assert "imu.csv" in said and "positions: 101 of 101 used" in said and "median std" in said
    for name in ("trajectory.txt", "covariance.csv", "trajectory.png", "report.json", "config.toml"):
        assert (outs[0] / name).read_bytes() == (outs[1] / name).read_bytes()
    report = json.loads((outs[0] / "report.json").read_text())
    assert [row["kind"] for row in report["inputs"]] == ["inertial", "positions", "odometry"]
    assert report["fusion"]["heading"] == "estimated" and report["warnings"] == []
    found = read_trajectory(outs[0] / "trajectory.txt")
    error = errors_of(found, logs.truth)
    assert np.sqrt((error[:, :3] ** 2).sum(axis=1).mean()) < 0.03 and np.abs(error[:, 3:]).max() < np.radians(1.0)
    rows = np.loadtxt(outs[0] / "covariance.csv", delimiter=",", skiprows=1)
    assert rows.shape == (report["trajectory"]["n_poses"], 22)
    assert np.sqrt(np.median(rows[:, 1])) == pytest.approx(report["trajectory"]["std_m"]["x"])


def test_attitude_alone(tmp_path, capsys):
    paths = files(tmp_path / "logs", flight(12, 10.0))
    assert main(["fuse", paths[0], "-o", str(tmp_path / "out"), "--method", "complementary"]) == 0
    assert "the positions of trajectory.txt are zero" in capsys.readouterr().out
    assert not (tmp_path / "out" / "covariance.csv").exists()
    assert json.loads((tmp_path / "out" / "report.json").read_text())["fusion"]["position"] == "not estimated"


def test_what_cannot_be_fused_has_one_line(tmp_path, capsys):
    logs = flight(13, 10.0)
    imu, gps, _ = files(tmp_path / "logs", logs)
    out = str(tmp_path / "out")

    def says(code, *arguments):
        assert main(["fuse", *arguments, "-o", out]) == code
        error = capsys.readouterr().err
        assert error.count("scan2fea:") == 1 and not (tmp_path / "out").exists()
        return error

    assert "beside the inertial log" in says(3, imu)
    assert "needs an inertial log" in says(3, gps)
    assert "second log of positions" in says(2, imu, gps, gps)
    assert "cannot be read (No such file" in says(3, imu, str(tmp_path / "none.csv"))
    assert "--map SCAN" in says(3, imu, "--method", "particle")
    assert "did you mean" in says(2, imu, gps, "--set", "fusion.gps=1", "--set", "fusion.tau=1")
    degrees = np.loadtxt(imu, delimiter=",", skiprows=1)
    degrees[:, 4:] = np.degrees(degrees[:, 4:])
    wrong = tmp_path / "logs" / "degrees.csv"
    head = "time_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s"
    np.savetxt(wrong, degrees, delimiter=",", header=head, comments="")
    assert "in degrees per second, not radians" in says(3, str(wrong), gps)
    assert main(["fuse", str(wrong), gps, "-o", out, "--set", "fusion.angle_unit=deg"]) == 0


def test_a_capture_is_put_together_by_imu_and_gps(tmp_path, capsys):
    t = np.linspace(0.0, 20.0, 11)
    rng = np.random.default_rng(3)
    place = np.c_[2.0 * np.sin(0.8 * t), 1.5 * np.cos(0.5 * t), 0.1 * rng.standard_normal(11)]
    path = path_through(t, place, np.c_[rng.uniform(-5, 5, (11, 2)), 40 * t])
    logs = sensor_logs(path, LogOptions(), 5)
    paths = files(tmp_path / "logs", logs)
    turns = 10.0 + 0.05 * np.arange(5)
    capture(tmp_path / "a.pcap", trajectory_at(path, turns).T_world_frame)
    arguments = ["register", str(tmp_path / "a.pcap"), "--imu", paths[0], "--gps", paths[1]]
    assert main(["register", str(tmp_path / "a.pcap"), "-o", str(tmp_path / "lies")]) == 0
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    before, after = (off_room(read_scan(tmp_path / name / "cloud.ply").scan.cloud.points) for name in ("lies", "out"))
    assert np.sqrt((before**2).mean()) > 0.1 and np.sqrt((after**2).mean()) < 0.03
    assert main(["segment", *arguments[1:], "--method", "single", "-o", str(tmp_path / "parts")]) == 0
    np.testing.assert_allclose(np.sqrt((off_room(read_scan(tmp_path / "parts" / "cloud.ply").scan.cloud.points) ** 2).mean()), 0.0, atol=0.03)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert 0 < np.median(report["registration"]["sweeps"][0]["std_m"]) < 0.03
    assert any("the inertial unit and the logs beside it" in text for text in report["warnings"])
    capsys.readouterr()
    assert main([*arguments[:4], "-o", str(tmp_path / "no")]) == 2
    assert "--gps" in capsys.readouterr().err
    assert main(["register", str(tmp_path / "out" / "cloud.ply"), *arguments[2:], "-o", str(tmp_path / "no")]) == 3
    assert "one capture of many turns" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["run", "register", "segment", "reconstruct", "fit"])
def test_an_option_of_a_fusion_that_does_not_happen_is_refused(tmp_path, capsys, command):
    cloud = tmp_path / "a.xyz"
    np.savetxt(cloud, np.random.default_rng(0).uniform(0, 1, (50, 3)))
    assert main([command, str(cloud), "-o", str(tmp_path / "out"), "--set", "fusion.scanner_m=[0.1, 0, 0]"]) == 2
    said = capsys.readouterr().err
    assert "fusion.scanner_m = (0.1, 0.0, 0.0) has no effect" in said or "fusion.scanner_m = [0.1, 0, 0] has no effect" in said
    assert not (tmp_path / "out" / "report.json").exists()


def test_a_place_on_a_map(tmp_path, capsys):
    poses = way(4, 20)
    log, odometry = seen(poses, 4)
    np.savetxt(tmp_path / "ranges.csv", np.c_[log.time_s, log.angle, log.range_m], delimiter=",", header="time,angle_rad,range", comments="")
    write_trajectory(tmp_path / "odometry.txt", odometry)
    np.savetxt(tmp_path / "map.xyz", np.c_[MAP, np.full(len(MAP), 0.3)])
    logs = [str(tmp_path / "ranges.csv"), str(tmp_path / "odometry.txt")]
    assert main(["fuse", *logs, "-o", str(tmp_path / "out"), "--method", "particle", "--map", str(tmp_path / "map.xyz")]) == 0
    rows = np.loadtxt(tmp_path / "out" / "trajectory.txt")
    assert np.linalg.norm(rows[-1, 1:3] - poses[-1, :2]) < 0.1
    assert len(ANGLE) == 180 and isinstance(read_trajectory(tmp_path / "odometry.txt"), Trajectory)
