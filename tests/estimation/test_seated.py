"""A face that rests on a plane is told by it, where the sides beside it come down to it; and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import SIZES, made
from scan2fea.estimation.seated import seated
from scan2fea.kernel.section_likelihood import faces
from scan2fea.kernel.sections import section
from scan2fea.kernel.transforms import random_rotation, rigid
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import Footing
from scan2fea.verification.member import open_walls

SIGMA, FLOOR_SIGMA, LENGTH = 3e-4, 4e-4, 1.0
BAND = 4 * FLOOR_SIGMA
POSE = rigid(random_rotation(3), [2.0, -1.0, 0.5])
# What is down: the faces that rest, the axis of the section, the side; what else is not seen; the dimensions and origin that the fit has 2 mm off.
DOWN = {
    "L": (("A_TOE",), 0, 1, (), {"a": 2e-3}, (0.0, 0.0)),
    "L flat": (("A_OUTER",), 1, -1, ("B_INNER",), {"b": -2e-3, "t": -2e-3}, (0.0, 2e-3)),
    "C": (("WEB_OUTER",), 0, -1, (), {"b": 2e-3, "tw": 2e-3}, (-2e-3, 0.0)),
    "C on its toes": (("BOTTOM_TOE", "TOP_TOE"), 0, 1, ("BOTTOM_INNER",), {"b": 2e-3}, (0.0, 0.0)),
    "T": (("FLANGE_OUTER",), 1, 1, (), {"h": -2e-3, "tf": -2e-3}, (0.0, -2e-3)),
    "RHS": (("BOTTOM_OUTER",), 1, -1, ("LEFT_INNER", "RIGHT_INNER", "TOP_INNER"), {"h": 2e-3, "t": 2e-3}, (0.0, -1e-3)),
    "rect": (("RIGHT",), 0, 1, (), {"b": 2e-3}, (1e-3, 0.0)),
    "I": (("BOTTOM_TOE_LEFT", "TOP_TOE_LEFT"), 0, -1, ("WEB_LEFT", "BOTTOM_INNER_LEFT", "TOP_INNER_LEFT"), {"b": 2e-3, "tw": 2e-3}, (-1e-3, 0.0)),
}
SIZE = {**SIZES, "L": {"a": 0.127, "b": 0.1, "t": 0.012}, "rect": {"b": 0.1, "t": 0.04}}


def scene(name, gap=0.0, tilt=0.0, n=40_000, seed=1, floor_n=60_000, sigma=SIGMA, floor_sigma=FLOOR_SIGMA):
    """Points of the member above the plane's band, the member as it may be fitted, as it is, and the plane with what is its own.

    gap : between both, growing by tilt to one end.
    """
    family = name.split()[0]
    rests, axis, side, more, wrong, shift = DOWN[name]
    true = made(family, LENGTH, SIZE[family], R=POSE[:3, :3], shift=POSE[:3, 3], sigma=sigma)
    hidden = {*rests, *more}
    seen = tuple(face for face in faces(family) if face not in hidden)
    points = member_points(family, true.values(), n, MemberScanOptions(noise_m=sigma, faces=seen, seed=seed))
    corners = np.concatenate(section(family, true.values()).loops)
    plane = side * (side * corners[:, axis]).max()
    rng = np.random.default_rng(seed)
    floor = np.stack([np.full(floor_n, plane), rng.uniform(-0.4, 0.5, floor_n), rng.uniform(-0.3, 1.3, floor_n)], axis=1)
    floor = floor if axis == 0 else floor[:, [1, 0, 2]]
    floor[:, axis] += side * (gap + tilt * floor[:, 2] / LENGTH) + floor_sigma * rng.standard_normal(floor_n)
    across = floor[:, 1 - axis]
    under = (across > corners[:, 1 - axis].min()) & (across < corners[:, 1 - axis].max()) & (floor[:, 2] > 0) & (floor[:, 2] < LENGTH)
    floor = floor[~under]
    normal = np.zeros(3)
    normal[axis], normal[2] = -side, tilt / LENGTH
    normal /= np.linalg.norm(normal)
    offset = float(normal[axis] * (plane + side * gap))
    band = 4 * floor_sigma
    taken = points @ normal - offset < band
    its = np.concatenate([floor, points[taken]])
    world = POSE[:3, :3]
    footing = Footing(
        normal=world @ normal, offset_m=offset + float(world @ normal @ POSE[:3, 3]), sigma_m=floor_sigma, std_m=1e-5, band_m=band,
        points=its @ world.T + POSE[:3, 3],
    )  # fmt: skip
    fitted = replace(
        true,
        parameters=tuple(
            replace(p, value_m=p.value_m + wrong.get(p.name, 0.0), observable=p.name not in wrong, std_m=None if p.name in wrong else p.std_m)
            for p in true.parameters
        ),
        T_world_member=POSE @ rigid(np.eye(3), np.array([*shift, 0.0])),
        seen={face: float(face not in hidden) for face in faces(family)},
    )
    return points[~taken] @ world.T + POSE[:3, 3], fitted, true, footing


@pytest.mark.parametrize("name", DOWN)
def test_the_plane_tells_the_face_that_rests_on_it(name) -> None:
    points, fitted, true, footing = scene(name)
    got = seated(points, fitted, [footing])
    assert set(got.seated) == set(DOWN[name][0])
    for p in got.parameters:
        assert p.observable
        assert abs(p.value_m - true.values()[p.name]) < 3 * p.std_m + 1e-9, p
        assert p.std_m < 4e-4 or p.name == "length"
    shift = np.linalg.solve(POSE, got.T_world_member)[:2, 3]
    np.testing.assert_allclose(shift, 0, atol=3e-4)
    std = np.sqrt(np.diag(got.covariance))
    np.testing.assert_allclose(std, [p.std_m for p in got.parameters], rtol=1e-9)
    assert open_walls(got) <= open_walls(replace(true, seen=dict.fromkeys(faces(true.family), 1.0)))


@pytest.mark.parametrize("name", DOWN)
@pytest.mark.parametrize(("gap", "tilt"), [(0.003, 0.0), (0.03, 0.0), (0.0, 0.008)])
def test_what_is_held_above_the_plane_is_not_told_by_it(name, gap, tilt) -> None:
    points, fitted, _, footing = scene(name, gap, tilt)
    got = seated(points, fitted, [footing])
    assert got.seated == ()
    assert [p.value_m for p in got.parameters] == [p.value_m for p in fitted.parameters]
    assert not any(p.observable for p in got.parameters if p.name in DOWN[name][4])


def test_errors_of_what_the_plane_tells_go_with_its_standard_deviations() -> None:
    """Of a plane with its own noise, at random: the gap that would not be found is part of what is told, so none is off by more than that."""
    off = []
    for seed in range(12):
        points, fitted, true, footing = scene("L", seed=seed, n=6_000)
        got = seated(points, fitted, [footing])
        (a,) = (p for p in got.parameters if p.name == "a")
        off.append((a.value_m - true.values()["a"]) / a.std_m)
    assert np.abs(off).max() < 3


def test_a_face_that_the_plane_has_cut_off_was_not_seen() -> None:
    """The fit takes the place where the plane has taken the points of both legs' ends for a toe."""
    points, fitted, _, footing = scene("L", gap=0.004)
    toe = replace(fitted, seen={**fitted.seen, "A_TOE": 0.3}, parameters=tuple(replace(p, std_m=1e-5, observable=True) for p in fitted.parameters))
    got = seated(points, toe, [footing])
    assert got.seated == ()
    assert got.seen["A_TOE"] == 0.0
    assert [p.name for p in got.parameters if not p.observable] == ["a"]
    assert not np.asarray(got.covariance)[0].any()


@pytest.mark.parametrize(("name", "inside"), [("RHS", "BOTTOM_INNER"), ("C on its toes", "WEB_INNER")])
def test_a_tube_and_a_channel_on_its_toes_are_alike_where_nobody_looked_into_them(name, inside) -> None:
    points, fitted, _, footing = scene(name)
    assert seated(points, replace(fitted, seen={**fitted.seen, inside: 0.0}), [footing]).seated == ()


def test_members_that_no_plane_tells_stay_as_they_are() -> None:
    points, fitted, _, footing = scene("L")
    bent = replace(fitted, bow=np.full((2, 1), 1e-3))
    held = replace(fitted, parameters=(replace(fitted.parameters[0], source="fixed"), *fitted.parameters[1:]))
    askew = replace(footing, normal=footing.normal @ random_rotation(9).T)
    for member, planes in ((bent, [footing]), (held, [footing]), (fitted, []), (fitted, [askew])):
        assert seated(points, member, planes) is member


def test_the_order_of_points_and_the_frame_change_nothing() -> None:
    points, fitted, _, footing = scene("I")
    got = seated(points, fitted, [footing])
    T = rigid(random_rotation(5), [4.0, 1.0, -2.0])
    moved = replace(fitted, T_world_member=T @ fitted.T_world_member)
    normal = T[:3, :3] @ footing.normal
    there = replace(footing, normal=normal, offset_m=footing.offset_m + float(normal @ T[:3, 3]), points=footing.points @ T[:3, :3].T + T[:3, 3])
    order = np.random.default_rng(0).permutation(len(points))
    other = seated((points @ T[:3, :3].T + T[:3, 3])[order], moved, [there])
    np.testing.assert_allclose([p.value_m for p in other.parameters], [p.value_m for p in got.parameters], atol=1e-12)
    assert other.seated == got.seated


def test_exact_points_are_told_exactly() -> None:
    points, fitted, true, footing = scene("L", sigma=0.0, floor_sigma=0.0)
    got = seated(points, fitted, [footing])
    assert got.seated == ("A_TOE",)
    assert got.values()["a"] == pytest.approx(true.values()["a"], abs=1e-4)
