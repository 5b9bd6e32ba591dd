"""What the scanners' poses leave open, told of each object and in a member's dimensions."""

import math
from dataclasses import replace

import numpy as np
import pytest

from scan2fea.io.artifacts import load, save
from scan2fea.pipeline.config import load_config
from scan2fea.pipeline.convert import convert
from scan2fea.pipeline.part import Part
from scan2fea.pipeline.pose_doubt import between_frames, smeared_by
from scan2fea.pipeline.record import Record
from scan2fea.pipeline.route import widened
from scan2fea.pipeline.scene import Scene
from scan2fea.pipeline.sweeps import SweepPath
from scan2fea.types import Member, Parameter, PointCloud, Rays, Scan, Trajectory


def scene_of(points, frame, std_m, std_rad, **more):
    cloud = PointCloud.of(np.asarray(points, float)).replaced(frame=np.asarray(frame, np.int64))
    k = len(std_m)
    empty = {"meshes": (), "shift_m": np.zeros(3), "spacing_m": 0.01, "agreement_m": np.zeros(k), "reasons": ("",) * k, "links": (), "notes": ()}
    way = Trajectory(T_world_frame=np.tile(np.eye(4), (k, 1, 1)), placed=np.ones(k, bool))
    scan = Scan(cloud=cloud, rays=more.pop("rays", None))
    return Scene(scan=scan, trajectory=way, std_m=np.asarray(std_m, float), std_rad=np.asarray(std_rad, float), **{**empty, **more})


def test_a_wall_seen_from_both_sides_is_as_uncertain_as_both_poses():
    """Two faces, one per frame: the thickness that draws of both poses give has the deviation that is told."""
    rng = np.random.default_rng(0)
    near, far = np.c_[rng.uniform(-1, 1, (500, 2)), np.zeros(500)], np.c_[rng.uniform(-1, 1, (500, 2)), np.full(500, 0.1)]
    std = np.array([0.004, 0.007])
    scene = scene_of(np.r_[near, far], np.repeat([0, 1], 500), std, [0.0, 0.0])
    told = between_frames(scene, np.arange(1000))
    drawn = 0.1 + rng.normal(0, std[1] / math.sqrt(3), 20000) - rng.normal(0, std[0] / math.sqrt(3), 20000)
    assert told == pytest.approx(math.sqrt((0.004**2 + 0.007**2) / 3))
    assert told == pytest.approx(drawn.std(), rel=0.02)


def test_one_frame_alone_keeps_the_size_and_poses_that_were_given_have_no_doubt():
    points, frame = np.random.default_rng(1).uniform(0, 1, (40, 3)), np.repeat([0, 1], 20)
    scene = scene_of(points, frame, [0.01, 0.01], [0.01, 0.01])
    assert between_frames(scene, np.arange(20)) == 0.0
    assert between_frames(scene, np.arange(40)) > 0.008
    for std in (np.nan, 0.0):
        assert between_frames(scene_of(points, frame, [std, std], [std, std]), np.arange(40)) == 0.0
    resting = scene_of(points, np.where(np.arange(40) < 20, 0, -1), [0.01], [0.01])
    assert between_frames(resting, np.arange(40)) == 0.0  # what was put under it came from no scan


def test_turns_move_points_by_their_distance_from_the_middle_of_their_frame():
    points = np.array([[-3.0, 0, 0], [3.0, 0, 0], [-3.0, 0, 0], [3.0, 0, 0]])
    told = between_frames(scene_of(points, [0, 0, 1, 1], [0.0, 0.0], [0.01, 0.01]), np.arange(4))
    assert told == pytest.approx(math.sqrt(2 * 2 / 9 * 0.01**2 * 9))


def test_moments_of_a_moving_scanner_have_the_doubt_of_their_poses():
    points = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    rays = Rays(origin=np.zeros((2, 3)), direction=points, range_m=np.ones(2), time_s=np.array([3600.0, 3602.0]))
    path = SweepPath(
        frame=0, time_s=np.array([0.0, 1.0, 2.0]), T_frame_scanner=np.tile(np.eye(4), (3, 1, 1)), std_m=np.array([0, 0.01, 0.02]), std_rad=np.zeros(3)
    )
    scene = scene_of(points, [0, 0], [0.0], [0.0], rays=rays, paths=(path,))
    scene = replace(scene, scan=Scan(cloud=scene.scan.cloud.replaced(ray=np.arange(2)), rays=rays))
    assert between_frames(scene, np.arange(2)) == pytest.approx(math.sqrt(2 * (0 + 0.02**2 / 3) / 2))
    unknown = replace(scene, paths=(replace(path, std_m=np.full(3, np.nan), std_rad=np.full(3, np.nan)),))
    assert between_frames(unknown, np.arange(2)) == 0.0


def test_what_a_motion_smeared_is_named():
    scene = scene_of(np.zeros((2, 3)), [0, 1], [0.0, 0.0], [0.0, 0.0], smeared=("", "its motion could not be found"))
    assert smeared_by(scene, np.array([0])) == ""
    assert smeared_by(scene, np.array([-1, 0, 1])) == "its motion could not be found"


def test_dimensions_take_the_doubt_in_quadrature():
    def parameter(name, std):
        return Parameter(name=name, value_m=0.1, std_m=std, observable=std is not None, source="fitted" if std else "fixed")

    member = Member(
        family="rect", parameters=(parameter("b", 0.003), parameter("t", None)), T_world_member=np.eye(4), bow=np.zeros((2, 0)), twist=np.zeros(0),
        end_normals=np.array([[0, 0, -1.0], [0, 0, 1.0]]), covariance=np.diag([9e-6, 0.0]), sigma_m=0.001, noise="gaussian", outlier_share=0.0,
        seen={}, catalogue=(), families={"rect": 1.0}, damage=(), change=None,
    )  # fmt: skip
    told = widened(member, 0.004)
    assert told.parameters[0].std_m == pytest.approx(0.005) and told.parameters[1].std_m is None
    np.testing.assert_allclose(told.covariance, np.diag([25e-6, 0.0]))
    assert widened(member, 0.0) is member


def test_nothing_is_made_of_what_a_motion_smeared(tmp_path):
    points = np.random.default_rng(2).uniform(0, 1, (50, 3))
    part = Part(id=1, kind="object", scan=Scan(cloud=PointCloud.of(points)), smeared="its motion could not be found")
    kept = tmp_path / "part.npz"
    save(part, kept)
    assert load(kept).smeared == part.smeared
    row = convert(part, "key", load_config(None, {}), Record(tmp_path / "keep", resume=False), tmp_path / "files")
    assert (row["verdict"], row["reason"]) == ("failed", "its motion could not be found")
    assert row["between_frames_m"] == 0.0
