"""Sections that change along the axis, and two members in one cluster."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import made, scanned
from predicates import rotation
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.profile import RADIAL, laws_of
from scan2fea.estimation.several import several_members
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan, SectionChange

I_BEAM = {"h": 0.3, "b": 0.15, "tw": 0.007, "tf": 0.011}


def changed(family, values, dimension, sizes, at, length, side=0):
    change = SectionChange(
        kind="taper", dimension=dimension, z_m=np.array(at) * length, value_m=np.array(sizes), std_m=np.zeros(len(at)), side=side
    )
    return replace(made(family, length, values, R=rotation(2), shift=(4, 5, 6)), change=change)


def fitted(points, **options):
    return fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions(max_degree=1, twist=False, **options))


@pytest.mark.parametrize(
    ("family", "values", "dimension", "sizes"),
    [("I", I_BEAM, "h", (0.3, 0.45)), ("CHS", {"d": 0.1, "t": 0.005}, "d", (0.18, 0.1))],
)
def test_a_taper_is_measured(family, values, dimension, sizes):
    member = changed(family, values, dimension, sizes, (0, 1), 3.0)
    found = fitted(scanned(member, 4_000, 0.001, 3, clutter=0.03), family=family)
    change = found.member.change
    assert found.explains and change is not None and change.kind == "taper" and change.dimension == dimension, found.reason
    assert sorted(change.value_m.tolist()) == pytest.approx(sorted(sizes), abs=1.2e-3)
    assert found.member.values()[dimension] == change.value_m.min()
    for name, true in values.items():
        if name != dimension:
            assert found.member.values()[name] == pytest.approx(true, abs=4e-4)
    assert found.member.values()["length"] == pytest.approx(3.0, abs=0.01)
    assert abs(abs(found.member.T_world_member[:3, 2] @ member.T_world_member[:3, 2]) - 1) < 1e-5


def test_a_prism_stays_one():
    found = fitted(member_points("I", {**I_BEAM, "length": 2.0}, 3_000, MemberScanOptions(noise_m=0.001, clutter=0.05)), family="I")
    assert found.explains and found.member.change is None


@pytest.mark.parametrize(("kind", "growth"), [("taper", (0.0, 0.1)), ("haunch", (0.1, 0.0, 0.0))])
@pytest.mark.parametrize("axis", [0, RADIAL])
def test_slices_tell_the_law(kind, growth, axis):
    share = np.array([0.0, 1.0]) if kind == "taper" else np.array([0.0, 0.3, 1.0])
    z = np.random.default_rng(0).random(6_000)
    angle = 2 * np.pi * np.random.default_rng(1).random(6_000)
    r = 0.1 + np.interp(z, share, growth) / 2
    points = np.c_[r * np.cos(angle), (0.1 if axis == 0 else r) * np.sin(angle), z]
    best = laws_of(points, (0.0, 1.0), axis)[0]
    assert best.kind == kind and best.growth_m.max() == pytest.approx(0.1, abs=0.01)
    if kind == "haunch":
        assert best.share[1] == pytest.approx(0.3, abs=0.06)
    straight = np.c_[0.1 * np.cos(angle), 0.1 * np.sin(angle), z]
    assert laws_of(straight, (0.0, 1.0), axis) == []


def test_two_parallel_beams_are_two():
    one = member_points("I", {"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085, "length": 2.0}, 2_000, MemberScanOptions(noise_m=0.001))
    points = np.r_[one, one[:, [0, 1, 2]] + [0.3, 0, 0]] @ rotation(4).T
    found = several_members(points, fitted(points, family="I"), MemberOptions(family="I"))
    assert found is not None and found.how == "side by side" and found.families == ("I", "I") and found.apart_m == pytest.approx(0.3, abs=0.01)
    assert "segment" in found.reason and len({tuple(found.of[:2_000]), tuple(found.of[2_000:])}) == 2


def test_crossing_tubes_are_two_and_one_is_one():
    tube = member_points("RHS", {"h": 0.1, "b": 0.06, "t": 0.005, "length": 1.5}, 2_000, MemberScanOptions(noise_m=0.001)) - [0, 0, 0.75]
    c, s = np.cos(1.0), np.sin(1.0)
    points = np.r_[tube, tube @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) + [0.061, 0, 0]]
    found = several_members(points, None, MemberOptions(family="RHS"))
    assert found is not None and found.how == "crossing" and "segment" in found.reason
    assert several_members(tube, fitted(tube, family="RHS")) is None


def test_the_two_faces_of_a_wall_are_no_two_members():
    """Seen along the axis the inner and the outer face of a tube are pieces with a gap, and each is a tube by itself."""
    tube = member_points("RHS", {"h": 0.152, "b": 0.103, "t": 0.0073, "length": 0.848}, 9000, MemberScanOptions(noise_m=0.0004, seed=1, caps=True))
    found = fitted(tube, family="RHS")
    assert found.explains and several_members(tube, found) is None
