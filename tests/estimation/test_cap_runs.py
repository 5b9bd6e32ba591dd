"""A face that nobody saw, told by the end faces: where their points stop, and not where that may be a cut or no end face was scanned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import SIZES, made
from scan2fea.estimation.cap_runs import told_by_caps
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.reach import reach
from scan2fea.kernel.section_likelihood import faces
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan
from scan2fea.verification.member import walls_in_noise

ASKEW = rotation_about((1, 2, 3), 1.1)
HIDDEN = {"C": "WEB_INNER", "T": "FLANGE_OUTER", "L": "A_INNER", "I": "TOP_OUTER", "rect": "TOP"}
SIZE = {**SIZES, "L": {"a": 0.127, "b": 0.1, "t": 0.012}, "rect": {"b": 0.1, "t": 0.04}, "I": {"h": 0.2, "b": 0.15, "tw": 0.009, "tf": 0.015}}


def scanned(family, sigma, n=20_000, seed=4, R=ASKEW, **more):
    """A member of which one face was not seen though the end faces were, and its points (n, 3)."""
    seen = tuple(name for name in faces(family) if name != HIDDEN[family])
    options = MemberScanOptions(noise_m=sigma, faces=seen, **{"caps": True, "seed": seed, **more})
    points = member_points(family, {**SIZE[family], "length": 1.0}, n, options)
    member = made(family, values=SIZE[family], R=R, sigma=max(sigma, 1e-6))
    return replace(member, seen={name: float(name in seen) for name in faces(family)}), points @ R.T, seen


@pytest.mark.parametrize("family", HIDDEN)
@pytest.mark.parametrize("sigma", [0.0, 4e-4])
def test_the_end_faces_stop_at_the_hidden_face_and_the_deviation_is_as_told(family, sigma) -> None:
    pulls, stds = [], []
    for seed in range(12):
        member, points, seen = scanned(family, sigma, n=60_000 if family == "I" else 20_000, seed=seed)
        found = told_by_caps(points, member, seen)
        assert set(found) <= {HIDDEN[family]}
        if found:
            off, std = found[HIDDEN[family]]
            pulls.append(off / std)
            stds.append(std)
    assert len(pulls) >= 10
    assert np.abs(pulls).max() < 4 and 0.1 < np.sqrt(np.mean(np.square(pulls))) < 1.6
    assert np.mean(stds) < 0.05 * min(SIZE[family].values())


def test_it_does_not_ask_where_the_member_has_the_face() -> None:
    """A wall that nobody saw has the thickness of some size of the table, and the run begins at the face that was seen."""
    member, points, seen = scanned("C", 4e-4)
    off, std = told_by_caps(points, member, seen)["WEB_INNER"]
    wrong = replace(member, parameters=tuple(replace(p, value_m=0.0115) if p.name == "tw" else p for p in member.parameters))
    moved, spread = told_by_caps(points, wrong, seen)["WEB_INNER"]  # 3 mm farther out, which is towards the toes
    assert moved == pytest.approx(off - 0.003, abs=1e-9 + 0.5 * std) and spread == pytest.approx(std, rel=0.2)


def test_nothing_is_told_without_end_faces_or_of_few_points_or_in_wide_noise() -> None:
    for more in ({"caps": False}, {"n": 600}, {"sigma": 2.5e-3}):
        member, points, seen = scanned(**{"family": "C", "sigma": 4e-4, **more})
        assert told_by_caps(points, member, seen) == {}


@pytest.mark.parametrize("n_strays", [900, 1300, 2000])
def test_strays_where_the_ends_are_hardly_known_tell_nothing(n_strays) -> None:
    """Half the length counts as an end then, and evenly strewn points reach up to wherever one stops to look: 12 of these 30 told a wall."""
    for seed in range(10):
        member, points, seen = scanned("C", 5e-5, n=6_000, caps=False, seed=seed)
        member = replace(member, parameters=(*member.parameters[:-1], replace(member.parameters[-1], std_m=0.05)))
        local = points @ ASKEW
        strays = np.random.default_rng(seed).uniform(local.min(axis=0) - 0.05, local.max(axis=0) + 0.05, (n_strays, 3))
        assert told_by_caps(np.concatenate([points, strays @ ASKEW.T]), member, seen) == {}


def test_what_lies_beside_an_end_is_no_end_face() -> None:
    """The same points at the ends as an end face has, and half as many just beside them: a second body in the wall's place."""
    member, points, seen = scanned("C", 4e-4)
    assert set(told_by_caps(points, member, seen)) == {"WEB_INNER"}
    local = points @ ASKEW
    cap = local[(np.abs(local[:, 2]) < 1e-3) & (local[:, 0] > 0.002)]
    beside = cap[: len(cap) // 2] * np.array([1.0, 1.0, 0.0]) + np.array([0.0, 0.0, 0.0024])
    assert told_by_caps(np.concatenate([points, beside @ ASKEW.T]), member, seen) == {}


def test_an_end_face_that_goes_on_is_none_of_the_wall_alone() -> None:
    """A channel filled with concrete: its end face is full."""
    member, points, seen = scanned("C", 4e-4)
    rng, size = np.random.default_rng(2), SIZE["C"]
    fill = np.c_[rng.uniform(0, size["b"], 4000), rng.uniform(-0.09, 0.09, 4000), rng.integers(0, 2, 4000)]
    assert told_by_caps(np.concatenate([points, fill @ ASKEW.T]), member, seen) == {}


@pytest.mark.parametrize("slope", [0.1, -0.3])
def test_a_shadow_askew_on_the_end_faces_tells_nothing(slope) -> None:
    member, points, seen = scanned("C", 2e-4, n=60_000)
    local = points @ ASKEW
    dark = (local[:, 0] > 0.004 + slope * local[:, 1]) & (np.abs(local[:, 1]) < 0.08) & (np.abs(local[:, 2] - 0.5) > 0.49)
    assert told_by_caps(points[~dark], member, seen) == {}


def test_an_outermost_face_square_to_the_file_may_be_a_cut() -> None:
    for family, R, told in (("I", np.eye(3), False), ("I", ASKEW, True), ("C", np.eye(3), True)):
        member, points, seen = scanned(family, 2e-4, n=60_000, R=R)
        assert bool(told_by_caps(points, member, seen)) == told  # beyond the inner face of a web the flanges go on: nothing was cut there


@pytest.mark.parametrize(("n", "told"), [(60_000, True), (3_000, False)])
def test_an_outermost_face_is_told_only_where_a_cut_at_another_angle_would_show(n, told) -> None:
    """Two of 60 halves of members cut along had passed as whole ones: the end of a leg has few points, and stops askew as it does square."""
    member, points, seen = scanned("rect", 0.0, n=n)
    assert bool(told_by_caps(points, member, seen)) == told
    local = points @ ASKEW
    for degrees in (4, 10, 45):  # cut aslant below the hidden face
        gone = local[:, 1] > 0.01 + np.tan(np.radians(degrees)) * local[:, 0]
        assert told_by_caps(points[~gone], member, seen) == {}


def test_where_two_neighbours_were_seen_they_decide() -> None:
    """A flat cut a degree off square: its sides stop 1.7 mm apart, which the end faces, a tenth as dense, would not know."""
    member, points, _ = scanned("rect", 0.0, n=12_000)
    local = points @ ASKEW
    cut = points[local[:, 1] < 0.001 + np.tan(np.radians(1)) * local[:, 0]]
    assert reach(cut, member) is None
    assert reach(points, member) is not None


def test_the_whole_fit_tells_the_wall_and_moves_with_the_member() -> None:
    _, points, _ = scanned("C", 4e-4, clutter=0.02)
    T = rigid(rotation_about((-1, 2, 0.5), 0.4), np.array([3.0, -1.0, 2.0]))
    for cloud in (points, points @ T[:3, :3].T + T[:3, 3]):
        member = fit_member(Scan(cloud=PointCloud.of(cloud)), MemberOptions()).member
        wall = next(p for p in member.parameters if p.name == "tw")
        assert member.family == "C" and member.reached == ("WEB_INNER",) and walls_in_noise(member) == 0
        assert wall.observable and abs(wall.value_m - SIZE["C"]["tw"]) < 3 * wall.std_m < 0.15 * wall.value_m
