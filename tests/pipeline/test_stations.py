"""Stations of one file that lie off each other, told by the faces that several of them saw."""

import math
from dataclasses import replace

import numpy as np

from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.pipeline.dimension_doubt import PoseDoubt, widened
from scan2fea.pipeline.stations import larger_doubt, open_volume, stations_of
from scan2fea.simulation.shapes import box
from scan2fea.types import Member, Parameter, PointCloud, Rays, Scan

SIGMA = 0.0005
SIZE = {"b": 0.2, "t": 0.05, "length": 1.0}
AROUND = np.array([[2.0, 2.0, 0.0], [-2.0, 2.0, 0.3], [2.0, -2.0, 0.2], [-2.0, -2.0, -0.3]])  # each face by two of them, the ends by one each


def solid():
    mesh = box(*SIZE.values())
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    return replace(mesh, vertices=mesh.vertices - middle)


def scan_with(off, n=8_000, seed=0):
    """Points of the box, each seen from a station that its face looks at, and moved as that station is (k, 3)."""
    mesh, rng = solid(), np.random.default_rng(seed)
    areas, normals = face_areas(mesh), face_normals(mesh)
    face = rng.choice(len(areas), n, p=areas / areas.sum())
    u, v = np.sqrt(rng.random(n)), rng.random(n)
    points = np.einsum("nk,nkj->nj", np.stack([1 - u, u * (1 - v), u * v], axis=1), mesh.vertices[mesh.faces[face]])
    station = rng.integers(0, len(AROUND), n)
    seen = np.einsum("ij,ij->i", normals[face], AROUND[station] - points) > 0.3
    points, station = points[seen], station[seen]
    points = points + rng.normal(0, SIGMA, points.shape) + np.asarray(off)[station]
    origin = AROUND + off
    away = points - origin[station]
    range_m = np.linalg.norm(away, axis=1)
    rays = Rays(origin=origin[station], direction=away / range_m[:, None], range_m=range_m)
    return Scan(cloud=PointCloud.of(points).replaced(ray=np.arange(len(points))), rays=rays)


def plate():
    parameters = tuple(Parameter(name=k, value_m=v, std_m=1e-5, observable=True, source="fitted") for k, v in SIZE.items())
    T = np.eye(4)
    T[2, 3] = -0.5 * SIZE["length"]
    return Member(
        family="rect", parameters=parameters, T_world_member=T, bow=np.zeros((2, 0)), twist=np.zeros(0),
        end_normals=np.array([[0, 0, -1.0], [0, 0, 1.0]]), covariance=1e-10 * np.eye(3), sigma_m=SIGMA, noise="gaussian", outlier_share=0.0,
        seen={}, catalogue=(), families={"rect": 1.0}, damage=(), change=None,
    )  # fmt: skip


def test_stations_that_agree_leave_a_member_and_a_volume_as_they_are():
    scan = scan_with(np.zeros((4, 3)))
    assert larger_doubt(scan, plate(), PoseDoubt()) == (scan.cloud, PoseDoubt())
    assert open_volume(scan, solid(), 0.008, SIGMA) == (0.0, 0.0)


def test_a_dimension_is_as_uncertain_as_the_stations_that_measured_its_sides():
    """Stations off by 1 mm along each axis: of the ten draws told thickness and width hold what such draws make of them."""
    z = []
    for seed in range(10):
        off = np.random.default_rng(seed).normal(0, 0.001, (4, 3))
        scan = scan_with(off, seed=seed)
        cloud, doubt = larger_doubt(scan, plate(), PoseDoubt())
        std = {p.name: p.std_m for p in widened(plate(), cloud, doubt).parameters}
        for name, axis in (("b", 0), ("t", 1)):  # least squares takes the mean of the two stations that saw a side
            error = off[AROUND[:, axis] > 0, axis].mean() - off[AROUND[:, axis] < 0, axis].mean()
            z.append(error / std[name])
        assert doubt.between_m > 0.0003
    assert 0.4 < math.sqrt(np.mean(np.square(z))) < 1.3
    assert np.mean(np.abs(z) < 2) >= 0.9


def test_stations_that_were_put_together_first_move_together():
    """Two stations of four off by the same, which see one side of it: they count once. A larger doubt of the poses stands."""
    off = np.where(AROUND[:, 1:2] > 0, 0.002, 0.0) * [1.0, 1.0, 0.0]
    scan = scan_with(off)
    cloud, doubt = larger_doubt(scan, plate(), PoseDoubt())
    assert len(doubt.frames) < len(AROUND)
    std = {p.name: p.std_m for p in widened(plate(), cloud, doubt).parameters}
    assert std["t"] > 0.001
    wide = PoseDoubt(between_m=0.1)
    assert larger_doubt(scan, plate(), wide)[1] is wide
    share, apart = open_volume(scan, solid(), 0.008, SIGMA)
    assert 0.5 * 0.002 / SIZE["t"] < share < 3 * 0.002 / SIZE["t"]
    assert apart > 0.001


def test_a_scanner_that_moved_has_no_stations():
    scan = scan_with(np.zeros((4, 3)), n=2_000)
    moving = replace(scan, rays=replace(scan.rays, origin=scan.rays.origin + np.linspace(0, 1, len(scan.cloud))[:, None]))
    assert stations_of(moving) is None
    assert stations_of(replace(scan, rays=None)) is None
    assert stations_of(scan).max() == 3
