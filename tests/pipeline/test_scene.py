"""Where the inputs come to lie, and what the files of OUT say of it."""

import json

import numpy as np

from scan2fea.io import read_scan
from scan2fea.kernel.transforms import applied, quaternion_to_matrix, rigid
from scan2fea.pipeline.config import load_config
from scan2fea.pipeline.register import register_files

RNG = np.random.default_rng(5)
FAR = np.array([412_345.678, 5_398_765.432, 612.25])
T_FAR = rigid(quaternion_to_matrix([0.1, -0.2, 0.3, 0.9]), FAR)


def sheet(n=2000):
    """Points of a wavy sheet that lies in its own frame."""
    x = RNG.uniform(-1, 1, (n, 2))
    return np.column_stack([x, 0.1 * np.sin(3 * x[:, 0])])


def test_every_file_of_out_is_the_input_minus_the_shift(tmp_path):
    own = sheet()
    np.save(tmp_path / "own.npy", own)
    np.savetxt(tmp_path / "pose.txt", T_FAR)
    out = tmp_path / "out"
    report = register_files([tmp_path / "own.npy"], out, load_config(None, {"registration.poses": str(tmp_path / "pose.txt")}))
    assert json.loads((out / "report.json").read_text())["frame"] == report["frame"]
    shift = np.array(report["frame"]["shift_m"])
    assert np.abs(shift).max() > 10_000 and np.abs(FAR - shift).max() < 10_000
    T = np.array(report["registration"]["frames"][0]["T_world_frame"])
    row = np.loadtxt(out / "trajectory.txt")
    placed = read_scan(out / "cloud.ply").scan.cloud.points
    for pose in (T, rigid(quaternion_to_matrix(row[4:]), row[1:4])):
        np.testing.assert_allclose(applied(pose, own), placed, atol=1e-6)
        np.testing.assert_allclose(applied(pose, own) + shift, applied(T_FAR, own), atol=1e-8)


def test_near_the_origin_nothing_is_subtracted(tmp_path):
    np.save(tmp_path / "own.npy", sheet())
    report = register_files([tmp_path / "own.npy"], tmp_path / "out", load_config())
    assert report["frame"]["shift_m"] == [0.0, 0.0, 0.0]
    assert report["registration"]["frames"][0]["T_world_frame"] == np.eye(4).tolist()
