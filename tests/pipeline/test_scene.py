"""Where the inputs come to lie, and what the files of OUT say of it."""

import json

import numpy as np

from occluded import rings, seen
from scan2fea.io import read_scan, write_scan_ply
from scan2fea.kernel.transforms import applied, quaternion_to_matrix, rigid
from scan2fea.pipeline.config import load_config
from scan2fea.pipeline.register import register_files
from scan2fea.pipeline.route import estimate
from scan2fea.pipeline.scene import clean, place_all, segment
from scan2fea.types import PointCloud, Rays, Scan

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


# ---- what is put behind what stands in the way


def filled_scene(tmp_path, **settings):
    direction, _ = rings(1080)
    points, in_the_way, _ = seen(direction, 0.005)
    rays = Rays(origin=np.zeros_like(points), direction=direction, range_m=np.linalg.norm(points, axis=1))
    write_scan_ply(tmp_path / "room.ply", Scan(cloud=PointCloud.of(points, ray=np.arange(len(points))), rays=rays))
    config = load_config(None, {"filtering.outliers": "none", **settings})
    scene = place_all((read_scan(tmp_path / "room.ply"),), config.registration, names=["room.ply"])
    return clean(scene, config.filtering), config, in_the_way


def test_inferred_points_are_labelled_by_what_they_continue_and_are_no_evidence(tmp_path):
    scene, config, in_the_way = filled_scene(tmp_path, **{"filtering.disocclusion": "planes"})
    bare, _, _ = filled_scene(tmp_path)
    n, cloud = len(in_the_way), scene.scan.cloud
    assert (cloud.is_inferred == scene.is_filled).all() and scene.is_filled.sum() > 2000 and len(bare.scan.cloud) == n
    assert scene.spacing_m == bare.spacing_m  # measured points alone
    assert (scene.is_occluder[:n] & in_the_way).sum() > 0.9 * in_the_way.sum()
    with_them, without = (segment(each, config.segmentation, config.repair.small_part) for each in (scene, bare))
    assert (with_them.labels[:n] == without.labels).all() and with_them.kinds == without.kinds
    assert (with_them.labels[n:] == with_them.labels[scene.continues[n:]]).all()
    crate = with_them.labels[:n][in_the_way]
    assert not np.isin(with_them.labels[n:], crate[crate > 0]).all()


def test_a_fit_does_not_see_inferred_points():
    rng = np.random.default_rng(2)
    k = np.arange(3000)
    corners = np.array([[0, 0], [0.1, 0], [0.1, 0.01], [0.01, 0.01], [0.01, 0.1], [0, 0.1], [0, 0.0]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    xy = np.stack([np.interp((k + 0.5) / len(k) * along[-1], along, corners[:, axis]) for axis in (0, 1)], axis=1)
    beam = np.c_[xy, 0.5 * (k * 0.6180339887498949 % 1.0)] + rng.normal(0.0, 3e-4, (len(k), 3))
    invented = rng.uniform([0, 0, 0], [0.1, 0.1, 0.5], (800, 3))
    measured = PointCloud.of(beam)
    both = PointCloud.of(np.concatenate([beam, invented]), is_inferred=np.arange(len(k) + 800) >= len(k))
    options = load_config()
    alone, beside = (estimate(Scan(cloud=cloud), options.estimation, options.route) for cloud in (measured, both))
    assert alone.member.values() == beside.member.values() and alone.member.damage == beside.member.damage == ()
