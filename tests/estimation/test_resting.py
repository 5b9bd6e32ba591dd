"""Members that stand or lie on a plane reach down to it."""

from dataclasses import replace

import numpy as np
import pytest

from scan2fea.estimation.resting import rested, standing
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.types import FloatArray, Footing, Member, Parameter

SPACING = 0.01


def bar(b: float, t: float, length: float, T: FloatArray) -> Member:
    told = [Parameter(name=n, value_m=v, std_m=1e-4, observable=True, source="fitted") for n, v in (("b", b), ("t", t), ("length", length))]
    return Member(
        family="rect", parameters=tuple(told), T_world_member=T, bow=np.zeros((2, 0)), twist=np.zeros(0),
        end_normals=np.array([[0.0, 0, -1], [0, 0, 1]]), covariance=np.eye(3) * 1e-8, sigma_m=3e-4, noise="gaussian", outlier_share=0.0,
        seen={}, families={"rect": 1.0},
    )  # fmt: skip


def footprint(T: FloatArray, across: tuple[int, int], at: FloatArray) -> FloatArray:
    """A grid of contact points in the plane through `at` (member frame) along two axes of the member."""
    u, v = np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.08, 0.08, 7))
    local = np.tile(at, (u.size, 1))
    local[:, across[0]] += u.ravel()
    local[:, across[1]] += v.ravel()
    return np.asarray(local @ T[:3, :3].T + T[:3, 3])


POSE = rigid(rotation_about((1, 2, 3), 0.7), (5.0, -2.0, 1.0))


@pytest.mark.parametrize(("z", "low_shift"), [(-0.004, -0.004), (0.604, 0.0)])
def test_a_standing_member_reaches_the_plane_at_either_end(z: float, low_shift: float) -> None:
    member = bar(0.3, 0.2, 0.6, POSE)
    got = rested(member, footprint(POSE, (0, 1), np.array([0, 0, z])), SPACING)
    assert got.values() == pytest.approx({"b": 0.3, "t": 0.2, "length": 0.604}, abs=1e-12)
    origin = np.linalg.solve(POSE, got.T_world_member)[:3, 3]
    assert origin == pytest.approx([0, 0, low_shift], abs=1e-12)
    assert got.end_normals == pytest.approx(np.array([[0, 0, -1], [0, 0, 1]]), abs=1e-9)


@pytest.mark.parametrize(("axis", "name", "side"), [(0, "b", -1), (0, "b", 1), (1, "t", -1), (1, "t", 1)])
def test_a_lying_bar_reaches_the_plane_with_its_side_and_the_other_side_stays(axis: int, name: str, side: int) -> None:
    member = bar(0.3, 0.2, 0.6, POSE)
    half = member.values()[name] / 2
    at = np.array([0.0, 0.0, 0.3])
    at[axis] = side * (half + 0.004)
    got = rested(member, footprint(POSE, (1 - axis, 2), at), SPACING)
    assert got.values()[name] == pytest.approx(2 * half + 0.004, abs=1e-12)
    centre = np.linalg.solve(POSE, got.T_world_member)[:3, 3]
    assert centre[axis] == pytest.approx(side * 0.002, abs=1e-12)
    assert centre[axis] - side * got.values()[name] / 2 == pytest.approx(-side * half, abs=1e-12)


def test_a_plane_out_of_reach_or_askew_changes_nothing() -> None:
    member = bar(0.3, 0.2, 0.6, POSE)
    assert rested(member, footprint(POSE, (0, 1), np.array([0, 0, -0.1])), SPACING) is member
    askew = POSE @ rigid(rotation_about((1, 0, 0), np.radians(4)), (0, 0, 0))
    assert rested(member, footprint(askew, (0, 1), np.array([0, 0, -0.004])), SPACING) is member
    assert rested(member, np.zeros((0, 3)), SPACING) is member


def test_a_dimension_that_only_the_plane_tells_is_observed() -> None:
    member = bar(0.3, 0.2, 0.6, POSE)
    blind = Parameter(name="t", value_m=0.2, std_m=None, observable=False, source="fitted")
    member = replace(member, parameters=(member.parameters[0], blind, member.parameters[2]))
    got = rested(member, footprint(POSE, (0, 2), np.array([0, -0.104, 0.3])), SPACING)
    assert got.parameters[1].observable
    assert got.parameters[1].std_m == member.sigma_m
    assert got.covariance[1, 1] == member.sigma_m**2


def plane(height_m: float, up: float = 1.0) -> Footing:
    """A support square to the bar's axis, at a height along it."""
    normal = up * POSE[:3, 2]
    offset = float(normal @ (POSE[:3, 3] + height_m * POSE[:3, 2]))
    return Footing(normal=normal, offset_m=offset, sigma_m=8e-4, std_m=2e-5, band_m=3e-3, points=np.zeros((0, 3)))


@pytest.mark.parametrize(("height", "up", "low_shift"), [(-0.004, 1.0, -0.004), (0.604, -1.0, 0.0)])
def test_an_end_that_stands_on_a_plane_is_there_and_no_surer_than_what_the_plane_took(height: float, up: float, low_shift: float) -> None:
    got = standing(bar(0.3, 0.2, 0.6, POSE), (plane(height, up),))
    assert got.values()["length"] == pytest.approx(0.604, abs=1e-12)
    assert got.parameters[-1].std_m == pytest.approx(np.hypot(np.hypot(1e-4, 2e-5), 0.004 / np.sqrt(3)), rel=1e-9)
    assert got.covariance[2, 2] == pytest.approx(got.parameters[-1].std_m ** 2)
    assert np.linalg.solve(POSE, got.T_world_member)[:3, 3] == pytest.approx([0, 0, low_shift], abs=1e-12)
    assert got.end_normals == pytest.approx(np.array([[0, 0, -1], [0, 0, 1]]), abs=1e-9)
    assert got.seated == ("END",)


def test_both_ends_may_stand_on_planes() -> None:
    got = standing(bar(0.3, 0.2, 0.6, POSE), (plane(-0.003), plane(0.602, -1.0)))
    assert got.values()["length"] == pytest.approx(0.605, abs=1e-12)
    assert got.seated == ("END",)


def test_an_end_above_what_the_plane_takes_hovers_and_a_given_length_stays() -> None:
    member = bar(0.3, 0.2, 0.6, POSE)
    assert standing(member, (plane(-0.011),)) is member  # three bands and six sigma are 10.8 mm
    assert standing(member, (plane(0.1),)) is member  # through the middle
    assert standing(member, ()) is member
    fixed = replace(member.parameters[2], std_m=None, observable=False, source="fixed")
    member = replace(member, parameters=(*member.parameters[:2], fixed))
    assert standing(member, (plane(-0.004),)) is member


def test_an_end_against_another_object_stays_and_is_less_sure() -> None:
    member = bar(0.3, 0.2, 0.6, POSE)
    got = standing(member, (replace(plane(-0.004), is_support=False),))
    assert got.values() == member.values()
    assert got.T_world_member == pytest.approx(POSE, abs=1e-15)
    assert got.parameters[-1].std_m == pytest.approx(np.hypot(np.hypot(1e-4, 2e-5), 0.004 / np.sqrt(3)), rel=1e-9)
    assert got.seated == ()
