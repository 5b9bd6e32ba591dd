"""An end of a member that is no plane is told; a flat one is not, whatever its noise, its slope, or what is broken off it."""

import numpy as np
import pytest

from scan2fea.estimation.end_faces import n_not_flat
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
