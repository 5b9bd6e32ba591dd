"""An end of a member that is no plane is told; a flat one is not, whatever its noise, its slope, or what is broken off it."""

import numpy as np
import pytest

from scan2fea.estimation.end_faces import SQUARE, cut_askew, n_not_flat
from scan2fea.estimation.ends import End, Ends
from scan2fea.estimation.member import fit_member
from scan2fea.kernel.distances import sample_surface
from scan2fea.simulation import parts
from scan2fea.simulation.members import member as member_shape
from scan2fea.types import PointCloud, Scan

SIGMA, REACH, LENGTH, WALL = 0.0005, 0.004, 0.3, 0.012


def ends(rng, n_cap, off, clutter=0, wide=1.0):
    """side and beyond of a wall's points: its two faces, and a cap at z = 0 at heights `off(depth)` with noise."""
    z, face = LENGTH * rng.random(4_000), SIGMA * rng.standard_normal(4_000)
    depth = WALL / 2 * (1 - np.abs(1 - 2 * rng.random(n_cap)))
    height = off(depth) + wide * SIGMA * rng.standard_normal(n_cap)
    side = np.concatenate([face, -depth, -WALL / 2 * rng.random(clutter)])
    at = np.concatenate([z, height, LENGTH * rng.random(clutter)])
    return side, np.stack([-at, at - LENGTH], axis=1)


@pytest.mark.parametrize(
    "off, wide, clutter, told",
    [
        (np.zeros_like, 1.0, 0, 0),
        (np.zeros_like, 6.0, 0, 0),  # a scanner that looks along the member
        (np.zeros_like, 1.0, 2_000, 0),
        (lambda depth: np.where(np.arange(len(depth)) % 5 < 2, 0.003, 0.0), 1.0, 0, 0),  # a corner broken off
        (lambda depth: 0.0015 + 0.3 * (WALL / 2 - depth), 1.0, 0, 1),  # the rim of a dish
        (lambda depth: 0.0015 + 0.3 * (WALL / 2 - depth), 1.0, 2_000, 1),
    ],
)
def test_most_points_on_one_side_of_an_end_plane(off, wide, clutter, told):
    side, beyond = ends(np.random.default_rng(3), 400, off, clutter, wide)
    assert n_not_flat(side, beyond, SIGMA, REACH, LENGTH) == told


def test_a_pot_of_which_the_bottom_was_not_seen_is_no_tube():
    """Standing on a floor, seen from its sides and above: it had been converted as a tube that hangs in the air, a tenth short."""
    points, _ = sample_surface(parts.tank(0.101, 0.233, 0.0139, 2e-4).mesh, 12_000, 1)
    is_outer = np.linalg.norm(points[:, :2], axis=1) > 0.094
    points = points[np.where(is_outer, points[:, 2] > 0.02, points[:, 2] > 0.06)]
    points = points + 0.0007 * np.random.default_rng(1).standard_normal(points.shape)
    member = fit_member(Scan(cloud=PointCloud.of(points))).member
    assert member.family == "CHS" and member.inside == "unknown"


def test_a_short_tube_seen_whole_is_one():
    points, _ = sample_surface(member_shape("CHS", {"d": 0.2, "t": 0.012, "length": 0.25}, 2e-4).mesh, 12_000, 1)
    points = points + 0.0007 * np.random.default_rng(1).standard_normal(points.shape)
    found = fit_member(Scan(cloud=PointCloud.of(points)))
    assert found.explains and found.member.inside == "hollow"


@pytest.mark.parametrize(
    "slope, std, cap, told", [(0.05, 0.002, 0, True), (SQUARE + 0.005, 0.002, 0, False), (0.05, 0.02, 0, False), (0.05, 0.002, 40, False)]
)
def test_sides_that_stop_askew_where_no_end_face_was_seen(slope, std, cap, told):
    def end(tilt):
        plane = {"slope": np.array([0.0, tilt]), "slope_std": np.full(2, std), "pivot": np.zeros(2)}
        return End(position_m=0.0, std_m=1e-4, cap_points=cap, excess=1.0, **plane)

    for low, high in ((slope, 0.0), (0.0, -slope)):
        found = cut_askew(Ends(low=end(low), high=end(high), length_m=1.0, std_m=1e-4), "rect")
        assert bool(found) == told and ("degrees off square" in found) == told


def test_half_a_bar_cut_askew_by_the_scan_tells_no_length():
    """Cut by a plane 17 degrees off square: the half had been a bar of its own, half as long."""
    points, _ = sample_surface(parts.box(0.16, 0.083, 0.066).mesh, 14_000, 1)
    points = points + 5e-4 * np.random.default_rng(1).standard_normal(points.shape)
    whole = fit_member(Scan(cloud=PointCloud.of(points)))
    half = fit_member(Scan(cloud=PointCloud.of(points[(points - points.mean(0)) @ [np.cos(0.3), np.sin(0.3), 0] < 0])))
    assert "length" not in whole.why and "cut off" in half.why["length"]
    assert {p.name: p.observable for p in whole.member.parameters}["length"]
    assert not {p.name: p.observable for p in half.member.parameters}["length"]
