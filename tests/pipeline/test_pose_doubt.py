"""What the scanners' poses leave open, told of each object and in a member's dimensions."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2fea.io.artifacts import load, save
from scan2fea.kernel.sections import section
from scan2fea.kernel.transforms import applied, inverse, rigid
from scan2fea.pipeline.config import load_config
from scan2fea.pipeline.convert import convert
from scan2fea.pipeline.dimension_doubt import FramePose, PoseDoubt, coarsened, widened
from scan2fea.pipeline.part import Part
from scan2fea.pipeline.pose_doubt import doubt_of, smeared_by
from scan2fea.pipeline.record import Record
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
    told = doubt_of(scene, np.arange(1000)).between_m
    drawn = 0.1 + rng.normal(0, std[1] / math.sqrt(3), 20000) - rng.normal(0, std[0] / math.sqrt(3), 20000)
    assert told == pytest.approx(math.sqrt((0.004**2 + 0.007**2) / 3))
    assert told == pytest.approx(drawn.std(), rel=0.02)


def test_one_frame_alone_keeps_the_size_and_poses_that_were_given_have_no_doubt():
    points, frame = np.random.default_rng(1).uniform(0, 1, (40, 3)), np.repeat([0, 1], 20)
    scene = scene_of(points, frame, [0.01, 0.01], [0.01, 0.01])
    assert doubt_of(scene, np.arange(20)) == PoseDoubt()
    assert doubt_of(scene, np.arange(40)).between_m > 0.008
    for std in (np.nan, 0.0):
        assert doubt_of(scene_of(points, frame, [std, std], [std, std]), np.arange(40)).between_m == 0.0
    resting = scene_of(points, np.where(np.arange(40) < 20, 0, -1), [0.01], [0.01])
    assert doubt_of(resting, np.arange(40)).between_m == 0.0  # what was put under it came from no scan


def test_turns_move_points_by_their_distance_from_the_middle_of_their_frame():
    points = np.array([[-3.0, 0, 0], [3.0, 0, 0], [-3.0, 0, 0], [3.0, 0, 0]])
    told = doubt_of(scene_of(points, [0, 0, 1, 1], [0.0, 0.0], [0.01, 0.01]), np.arange(4)).between_m
    assert told == pytest.approx(math.sqrt(2 * 2 / 9 * 0.01**2 * 9))


def test_moments_of_a_moving_scanner_have_the_doubt_of_their_poses():
    points = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    rays = Rays(origin=np.zeros((2, 3)), direction=points, range_m=np.ones(2), time_s=np.array([3600.0, 3602.0]))
    path = SweepPath(
        frame=0, time_s=np.array([0.0, 1.0, 2.0]), T_frame_scanner=np.tile(np.eye(4), (3, 1, 1)), std_m=np.array([0, 0.01, 0.02]), std_rad=np.zeros(3)
    )
    scene = scene_of(points, [0, 0], [0.0], [0.0], rays=rays, paths=(path,))
    scene = replace(scene, scan=Scan(cloud=scene.scan.cloud.replaced(ray=np.arange(2)), rays=rays))
    assert doubt_of(scene, np.arange(2)).between_m == pytest.approx(math.sqrt(2 * (0 + 0.02**2 / 3) / 2))
    unknown = replace(scene, paths=(replace(path, std_m=np.full(3, np.nan), std_rad=np.full(3, np.nan)),))
    assert doubt_of(unknown, np.arange(2)).between_m == 0.0


def test_what_a_motion_smeared_is_named():
    scene = scene_of(np.zeros((2, 3)), [0, 1], [0.0, 0.0], [0.0, 0.0], smeared=("", "its motion could not be found"))
    assert smeared_by(scene, np.array([0])) == ""
    assert smeared_by(scene, np.array([-1, 0, 1])) == "its motion could not be found"


def member_of(family, sizes, std, **more):
    """A straight member with these dimensions and standard deviations (None: not estimated); turned, so that no axis is the world's."""
    parameters = tuple(
        Parameter(name=n, value_m=v, std_m=std.get(n), observable=n in std, source="fitted" if n in std else "fixed") for n, v in sizes.items()
    )
    turn = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
    covariance = np.diag([std.get(n, 0.0) ** 2 for n in sizes])
    return Member(
        family=family, parameters=parameters, T_world_member=rigid(turn, [1.0, 2.0, 3.0]), bow=np.zeros((2, 0)), twist=np.zeros(0),
        end_normals=np.array([[0, 0, -1.0], [0, 0, 1.0]]), covariance=covariance, sigma_m=0.001, noise="gaussian", outlier_share=0.0,
        seen={}, catalogue=(), families={family: 1.0}, damage=(), change=None, **more,
    )  # fmt: skip


def sides_of(member, n=4000):
    """Points on the sides of a rect or an angle, in the world, and the number of the edge of each."""
    rng = np.random.default_rng(0)
    (loop,) = section(member.family, member.values()).loops
    way = np.roll(loop, -1, axis=0) - loop
    long = np.linalg.norm(way, axis=1)
    edge = rng.choice(len(loop), n, p=long / long.sum())
    xy = loop[edge] + rng.random((n, 1)) * way[edge]
    return applied(member.T_world_member, np.c_[xy, member.values()["length"] * rng.random(n)]), edge


PLATE = {"b": 0.2, "t": 0.02, "length": 1.0}


def pose(k, points, std_m, std_rad=0.0):
    return FramePose(frame=k, centre_m=tuple(points.mean(axis=0).tolist()), std_m=std_m, std_rad=std_rad)


def test_a_thickness_takes_the_doubt_of_both_frames_and_a_width_that_one_saw_takes_none():
    """A plate, its two broad faces from two frames, its edges from the first: t is uncertain by both along one axis, b by neither."""
    member = member_of("rect", PLATE, dict.fromkeys(PLATE, 0.0005))
    points, edge = sides_of(member)
    frame = np.where(edge == 2, 1, 0)  # the top
    doubt = PoseDoubt(frames=(pose(0, points[frame == 0], 0.003), pose(1, points[frame == 1], 0.006)), between_m=0.01)
    told = widened(member, PointCloud.of(points).replaced(frame=frame), doubt)
    std = {p.name: p.std_m for p in told.parameters}
    assert std["t"] == pytest.approx(math.hypot(0.0005, math.hypot(0.003, 0.006) / math.sqrt(3)), rel=0.01)
    assert std["b"] == pytest.approx(0.0005, rel=0.05)
    np.testing.assert_allclose(np.sqrt(np.diag(told.covariance)), list(std.values()), rtol=1e-9)
    assert std["length"] < math.hypot(0.0005, math.hypot(0.003, 0.006) / math.sqrt(3))


def test_a_thickness_between_faces_of_whole_millimetres_is_known_to_two_roundings():
    member = member_of("rect", PLATE, dict.fromkeys(PLATE, 1e-8))
    told = coarsened(replace(member, sigma_m=1e-6), 1e-3)
    assert {p.name: p.std_m for p in told.parameters} == pytest.approx(dict.fromkeys(PLATE, 1e-3 / math.sqrt(6.0)), rel=1e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(told.covariance)), 1e-3 / math.sqrt(6.0), rtol=1e-3)
    assert coarsened(member, 0.0) is member  # nothing was rounded


def test_frames_that_move_together_move_the_member_and_no_dimension():
    member = member_of("L", {"a": 0.15, "b": 0.1, "t": 0.012, "length": 0.9}, {"a": 1e-4, "b": 1e-4, "t": 1e-4, "length": 1e-4})
    points, _ = sides_of(member)
    alone = PointCloud.of(points).replaced(frame=np.zeros(len(points), np.int64))
    doubt = PoseDoubt(frames=(pose(0, points, 0.01, 0.02),), between_m=0.01)
    told = widened(member, alone, doubt)
    assert all(p.std_m < 1.1e-4 for p in told.parameters)


def test_the_doubt_is_the_derivative_of_the_fit_by_a_move_of_one_frame():
    """An angle whose outer faces one frame saw: dimensions refitted by least squares to points that were moved scatter as is told."""
    sizes = {"a": 0.15, "b": 0.1, "t": 0.012, "length": 0.9}
    member = member_of("L", sizes, dict.fromkeys(sizes, 1e-3))
    points, edge = sides_of(member)
    frame = np.isin(edge, (0, 5)).astype(np.int64)
    one = pose(1, points[frame == 1], 0.002 * math.sqrt(3), 0.001 * math.sqrt(3))
    more = widened(member, PointCloud.of(points).replaced(frame=frame), PoseDoubt(frames=(one,), between_m=0.01)).covariance - member.covariance
    xyz = applied(inverse(member.T_world_member), points)
    arm = applied(inverse(member.T_world_member), points) - applied(inverse(member.T_world_member), np.array([one.centre_m]))
    lies_in_y = np.isin(edge, (0, 2, 4))  # A_OUTER, A_INNER, B_TOE: level; the others upright
    by_size = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 1], [0, 1, 0], [0, 0, 0]], float)[edge]
    place = np.where(lies_in_y[:, None], [0.0, 1.0], [1.0, 0.0])
    lever = np.where(lies_in_y, xyz[:, 0], -xyz[:, 1])
    design = np.c_[by_size, place, place * xyz[:, 2:], lever]
    rng, found = np.random.default_rng(1), []
    for _ in range(400):
        move = rng.normal(0, 0.002, 3) + np.cross(rng.normal(0, 0.001, 3), arm)
        away = np.where(frame == 1, np.where(lies_in_y, move[:, 1], move[:, 0]), 0.0)
        found.append(np.linalg.lstsq(design, away, rcond=None)[0][:3])
    np.testing.assert_allclose(np.sqrt(np.diag(more)[:3]), np.std(found, axis=0), rtol=0.15)


def test_dimensions_that_no_face_tells_take_the_doubt_whole():
    member = member_of("rect", PLATE, {"b": 0.003, "t": 0.003})
    points, edge = sides_of(member)
    flat = np.isin(edge, (0, 2))
    cloud = PointCloud.of(points[flat]).replaced(frame=(edge[flat] == 2).astype(np.int64))
    told = widened(member, cloud, PoseDoubt(frames=(pose(1, points[edge == 2], 0.003),), between_m=0.004))
    std = {p.name: p.std_m for p in told.parameters}
    assert std["b"] == pytest.approx(0.005) and std["t"] == pytest.approx(math.hypot(0.003, 0.003 / math.sqrt(3)), rel=0.01)
    assert std["length"] is None
    moving = widened(member, cloud, PoseDoubt(between_m=0.004, moments_m=0.004))
    np.testing.assert_allclose(moving.covariance, np.diag([25e-6, 25e-6, 0.0]))
    assert widened(member, cloud, PoseDoubt()) is member
    # what the fit found of faces is in its own deviation: of the two the larger
    for face, said in ((0.001, math.hypot(0.003, math.sqrt(0.004**2 - 2e-6))), (0.01, 0.003)):
        assert widened(member, cloud, PoseDoubt(between_m=0.004), face).parameters[0].std_m == pytest.approx(said)


def test_nothing_is_made_of_what_a_motion_smeared(tmp_path):
    points = np.random.default_rng(2).uniform(0, 1, (50, 3))
    doubt = PoseDoubt(frames=(pose(0, points, 0.01, 0.02),), between_m=0.01)
    part = Part(id=1, kind="object", scan=Scan(cloud=PointCloud.of(points)), smeared="its motion could not be found", doubt=doubt)
    kept = tmp_path / "part.npz"
    save(part, kept)
    assert (load(kept).smeared, load(kept).doubt) == (part.smeared, doubt)
    row = convert(part, "key", load_config(None, {}), Record(tmp_path / "keep", resume=False), tmp_path / "files")
    assert (row["verdict"], row["reason"]) == ("failed", "its motion could not be found")
    assert row["between_frames_m"] == 0.01
