from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from scan2fea.kernel.transforms import inverse, random_rotation, rigid, rotation_about
from scan2fea.registration.icp import icp
from scan2fea.registration.quality import judge
from scan2fea.registration.register import motions, register
from scan2fea.registration.surface import common_edge, surface_of
from scan2fea.types import PointCloud, Scan
from workpiece import errors, scaled, seen_from

STATIONS = [(8, -4, 3), (9, 1, 4), (7, 5, 3.5), (2, 8, 4)]
SIGMA = 0.003


def surfaces_of(scans):
    edge = common_edge([scan.cloud.points for scan in scans])
    return [surface_of(scan, edge) for scan in scans]


def off(truth, surface, shift=0.1, degrees=3.0):
    """The true motion, made wrong about the middle of the surface."""
    centre = surface.points.mean(axis=0)
    R = rotation_about([1.0, -1.0, 2.0], np.radians(degrees))
    return truth @ rigid(R, centre - R @ centre + np.array([shift, 0, 0]))


@pytest.fixture(scope="module")
def pair():
    G = rigid(random_rotation(7), [2.0, -1.0, 5.0])
    scans = [seen_from(STATIONS[0], seed=1, sigma=SIGMA), seen_from(STATIONS[1], seed=2, sigma=SIGMA, T=inverse(G))]
    return surfaces_of(scans), G


def test_refinement_comes_back_from_a_wrong_start(pair):
    (target, source), G = pair
    found = icp(source, target, target.tree(), off(G, source))
    turn, shift = errors(found.T_target_source, G, source.points)
    assert found.converged
    assert turn < np.radians(0.1) and shift < SIGMA
    assert found.scale_m < 2 * SIGMA


def test_the_stated_deviation_is_that_of_many_draws():
    G = rigid(random_rotation(7), [2.0, -1.0, 5.0])
    off_centre, stated = [], []
    for seed in range(12):
        scans = [seen_from(STATIONS[0], 8000, 2 * seed, SIGMA), seen_from(STATIONS[1], 8000, 2 * seed + 1, SIGMA, T=inverse(G))]
        target, source = surfaces_of(scans)
        T = icp(source, target, target.tree(), off(G, source, 0.03, 0.5)).T_target_source
        quality = judge(source, target, target.tree(), T)
        there = np.append(quality.centre, 1.0)
        off_centre.append(np.linalg.norm((T @ inverse(G) @ there - there)[:3]))
        stated.append(quality.std_m)
    rms = np.sqrt(np.mean(np.square(off_centre)))
    assert 1 / 3 < rms / np.mean(stated) < 3
    assert np.mean(stated) < SIGMA


def test_quality_of_the_right_place_and_of_a_wrong_one(pair):
    (target, source), G = pair
    right = judge(source, target, target.tree(), G)
    assert right.overlap > 0.4 and right.consistency > 0.7 and right.blocked < 0.05
    assert not right.is_degenerate
    assert right.residual_m < 3 * SIGMA
    wrong = judge(source, target, target.tree(), off(G, source, 0.5, 30.0))
    assert wrong.consistency < 0.4
    assert wrong.blocked > 0.1
    far = judge(source, target, target.tree(), rigid(np.eye(3), [100.0, 0, 0]) @ G)
    assert far.n_pairs == 0 and np.isnan(far.residual_m) and far.is_degenerate


def plane_scan(seed, bend=0.0, sigma=0.002):
    random = np.random.default_rng(seed)
    xy = random.random((6000, 2)) * [2.0, 1.0]
    return Scan(cloud=PointCloud.of(np.c_[xy, bend * xy[:, 0] ** 2 + random.normal(0, sigma, 6000)]))


def test_a_plane_on_a_plane_leaves_three_motions_open():
    target, source = surfaces_of([plane_scan(1), plane_scan(2)])
    quality = judge(source, target, target.tree(), np.eye(4))
    assert len(quality.open_directions) == 3
    assert np.isnan(quality.std_m) and np.isnan(quality.std_rad)
    slides = quality.open_directions
    for motion in np.eye(6)[[2, 3, 4]]:  # turning about z and sliding along x and y are in their span
        assert np.linalg.norm(slides.T @ (slides @ motion) - motion) < 0.1
    assert np.linalg.norm(slides @ np.eye(6)[5]) < 0.1  # z is told
    for seed in range(5):  # whichever directions of the open space were found
        mixed = replace(quality, open_directions=random_rotation(seed) @ slides)
        assert motions(mixed) == "it slides in 2 directions, it turns about 1 axis"


def test_a_bent_strip_slides_along_its_straight_direction_alone():
    target, source = surfaces_of([plane_scan(1, 0.5), plane_scan(2, 0.5)])
    quality = judge(source, target, target.tree(), np.eye(4))
    assert len(quality.open_directions) == 1
    assert abs(quality.open_directions[0] @ np.eye(6)[4]) > 0.95  # along y


@pytest.mark.parametrize("factor", [1.0, 1e-3, 1e3])
def test_frames_without_initial_guess_in_any_unit(factor):
    poses = [rigid(random_rotation(20 + k), factor * np.array([k, -2.0 * k, 3.0])) for k in range(4)]
    unmoved = [scaled(seen_from(s, 12_000, 10 + k, SIGMA), factor) for k, s in enumerate(STATIONS)]
    scans = [move(scan, inverse(T)) for scan, T in zip(unmoved, poses, strict=True)]
    found = register(surfaces_of(scans), [None] * 4)
    assert found.placed.all()
    for k in range(4):
        turn, shift = errors(found.T_world_frame[k], inverse(poses[0]) @ poses[k], scans[k].cloud.points)
        assert turn < np.radians(0.2) and shift < 2 * SIGMA * factor
    again = register(surfaces_of(scans), [None] * 4)
    assert again.T_world_frame.tobytes() == found.T_world_frame.tobytes()


def move(scan, T):
    from scan2fea.registration.place import RegistrationOptions, place

    return place([scan], [T], ["x"], RegistrationOptions(mode="placed", poses="x")).scan


def test_stations_that_are_not_known_are_registered_too():
    G = rigid(random_rotation(3), [1.0, 2.0, 3.0])
    scans = [seen_from(STATIONS[0], seed=4, sigma=SIGMA, known=False), seen_from(STATIONS[1], seed=5, sigma=SIGMA, known=False, T=inverse(G))]
    found = register(surfaces_of(scans), [None, None])
    assert found.placed.all()
    turn, shift = errors(found.T_world_frame[1], G, scans[1].cloud.points)
    assert turn < np.radians(0.2) and shift < 2 * SIGMA


def test_what_does_not_belong_is_left_out_and_named():
    random = np.random.default_rng(0)
    ball = random.normal(size=(8000, 3))
    ball *= (1.0 + 0.2 * np.sin(5 * ball[:, :1])) / np.linalg.norm(ball, axis=1, keepdims=True)
    scans = [seen_from(STATIONS[0], seed=1, sigma=SIGMA), seen_from(STATIONS[1], seed=2, sigma=SIGMA), Scan(cloud=PointCloud.of(ball))]
    found = register(surfaces_of(scans), [None] * 3)
    assert found.placed.tolist() == [True, True, False]
    assert found.reasons[:2] == ("", "")
    assert "--poses" in found.reasons[2]
    assert np.isnan(found.T_world_frame[2]).all()


def test_the_edge_follows_the_scale_and_the_number_of_cells():
    points = seen_from(STATIONS[0], seed=1).cloud.points
    edge = common_edge([points])
    assert common_edge([1e3 * points]) == pytest.approx(1e3 * edge, rel=0.02)
    assert 600 < len(surface_of(Scan(cloud=PointCloud.of(points)), edge)) < 6700
    assert common_edge([points[:10]]) == 0.0
    assert cKDTree(points).n == len(points)
