"""End faces that reach beyond a face nobody saw."""

import dataclasses

import numpy as np
import pytest

from estimation.made import made, scanned
from scan2fea.estimation.ends_show_more import ends_show_more
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.kernel.transforms import rotation_about
from scan2fea.types import PointCloud, Scan

FLAT = dataclasses.replace(made("rect"), reached=("BOTTOM",))


def in_the_ends(n, seed=0, away=0.03):
    """n points in the planes of both ends, below the flat."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-0.005, 0.005, n), -0.005 - away * rng.uniform(0.3, 1, n), rng.integers(0, 2, n) * 1.0])


def test_a_tee_of_which_the_flange_alone_was_seen_is_no_flat():
    """It was built as one."""
    tee = made("T", 3.29, {"h": 0.249, "b": 0.432, "tw": 0.0556, "tf": 0.0889})
    points = scanned(tee, 8_000, 3.35e-4, 1)
    x, y, z = points.T
    at_end = np.minimum(np.abs(z), np.abs(z - 3.29)) < 2e-3
    points = points[at_end | (y > -2e-3) | (np.abs(x) > 0.214)] @ rotation_about((1, 2, 3), 0.7).T
    found = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions())
    assert found.member.family == "rect" and not found.explains and "in the planes of its ends" in found.reason


@pytest.mark.parametrize(("n", "says"), [(7, False), (8, True), (30, True)])
def test_eight_points_in_the_planes_of_the_ends_are_a_face(n, says):
    points = np.concatenate([scanned(FLAT, 4_000, 5e-4, 1), in_the_ends(n)])
    assert bool(ends_show_more(points, FLAT)) == says
    assert "BOTTOM was not seen" in ends_show_more(points, FLAT) or not says
    R = rotation_about((1, 2, 3), 0.7)
    turned = dataclasses.replace(made("rect", R=R, shift=(4, -5, 6)), reached=("BOTTOM",))
    assert ends_show_more(points @ R.T + [4, -5, 6], turned) == ends_show_more(points, FLAT)


def test_strays_all_along_and_faces_that_were_seen_are_none():
    rng = np.random.default_rng(3)
    strays = np.column_stack([rng.uniform(-0.1, 0.1, 900), rng.uniform(-0.1, 0.1, 900), rng.uniform(-0.1, 1.1, 900)])
    assert ends_show_more(np.concatenate([scanned(FLAT, 4_000, 5e-4, 1), strays]), FLAT) == ""
    assert ends_show_more(np.concatenate([scanned(FLAT, 4_000, 5e-4, 1), in_the_ends(30)]), made("rect")) == ""
