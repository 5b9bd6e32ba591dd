"""A face that nobody saw: told by where both its neighbours stop, and only where a cut would hardly stop them so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import SIZES, made
from scan2fea.estimation.as_member import with_length_std
from scan2fea.estimation.ends import run_end
from scan2fea.estimation.from_outside import seen_from_outside
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.reach import end_rows, reach, solved
from scan2fea.kernel.section_likelihood import faces
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan
from scan2fea.verification.member import member_checks, open_walls

ASKEW = rotation_about((1, 2, 3), 1.1)
HIDDEN = {"C": "WEB_OUTER", "T": "FLANGE_OUTER", "rect": "RIGHT", "RHS": "TOP_OUTER", "L": "A_TOE"}
# What a fit may make of it: the hidden face 2 mm farther out and every other face where it is. Dimensions, and the section's origin.
WRONG = {
    "C": ({"b": 0.002, "tw": 0.002}, (-0.002, 0.0)),
    "T": ({"h": 0.002, "tf": 0.002}, (0.0, 0.002)),
    "rect": ({"b": 0.002}, (0.001, 0.0)),
    "RHS": ({"h": 0.002}, (0.0, 0.001)),
    "L": ({"a": 0.002}, (0.0, 0.0)),
}
SIZE = {**SIZES, "L": {"a": 0.127, "b": 0.1, "t": 0.022}, "rect": {"b": 0.1, "t": 0.04}}


def scanned(family, sigma, n=20_000, seed=4, clutter=0.02, caps=False):
    """A member whose hidden face the fit has 2 mm too far out, and the points (n, 3) it was fitted to, in the file's frame."""
    true = made(family, values=SIZE[family], R=ASKEW, sigma=sigma)
    out = [HIDDEN[family]] + (["TOP_INNER"] if family == "RHS" else [])
    seen = tuple(name for name in faces(family) if name not in out)
    points = member_points(family, true.values(), n, MemberScanOptions(noise_m=sigma, faces=seen, caps=caps, clutter=clutter, seed=seed))
    more, shift = WRONG[family]
    wrong = replace(
        true,
        parameters=tuple(replace(p, value_m=p.value_m + more.get(p.name, 0.0)) for p in true.parameters),
        T_world_member=rigid(ASKEW, ASKEW @ np.array([*shift, 0.0])),
        seen={name: float(name in seen) for name in faces(family)},
    )
    return wrong, points @ ASKEW.T, true


@pytest.mark.parametrize("family", HIDDEN)
@pytest.mark.parametrize("sigma", [0.0, 2e-4])
def test_the_hidden_face_lies_where_its_neighbours_stop(family, sigma) -> None:
    member, points, true = scanned(family, sigma)
    found = reach(points, member)
    assert found is not None
    assert found.faces == (HIDDEN[family],)
    std = np.sqrt(np.diag(found.covariance))
    names = [p.name for p in true.parameters if p.name != "length"]
    for name, value, sd in zip(names, found.values, std, strict=True):
        assert abs(value - true.values()[name]) < 4 * sd + 1e-9, name
        assert sd > 5e-6 or name not in WRONG[family][0], name  # a place that nobody saw is no needle
    assert found.told == set(WRONG[family][0])
    np.testing.assert_allclose(found.shift_m, -np.array(WRONG[family][1]), atol=4 * std.max())


def test_the_end_of_a_run_has_the_spread_that_its_law_gives() -> None:
    """Without noise the bare length beyond the last point is exponential; under noise an edge has the information 0.903 rho / sigma."""
    rho = 2e4
    rng = np.random.default_rng(7)
    ends = [run_end(rng.uniform(-0.1, 0.0, round(0.1 * rho)), 1e-12, -0.1) for _ in range(200)]
    assert np.mean([end.std_m for end in ends]) == pytest.approx(1 / rho, rel=0.2)  # strays may lie beyond: a little more than 1 / rho
    z = [end.edge_m / end.std_m for end in ends]
    assert abs(np.mean(z)) < 4 / np.sqrt(200) and 0.9 < np.mean(np.abs(z) < 1.96) < 0.99
    for sigma in (3e-4, 1e-3):
        n = round(0.1 * rho)
        ends = [run_end(rng.uniform(-0.13, 0.0, round(1.3 * n)) + sigma * rng.standard_normal(round(1.3 * n)), sigma, -0.1) for _ in range(100)]
        assert np.mean([end.std_m for end in ends]) == pytest.approx(np.sqrt(sigma / (0.903 * rho)), rel=0.15)
        errors = [end.edge_m / end.std_m for end in ends]
        assert abs(np.mean(errors)) < 0.4 and 0.8 < np.std(errors) < 1.2


def turned_cut(member, points, degrees, inward=0.004):
    """Without what lies beyond a plane across the face that is hidden, turned about the member's axis: as a cut would leave it."""
    true = ASKEW.T @ points.T
    middle = SIZE["C"]["h"] / 2
    turn = np.tan(np.radians(degrees))
    return points[true[0] > inward + turn * (true[1] + 0.3 * middle)]


@pytest.mark.parametrize("degrees", [2.0, 5.0, -20.0])
def test_neighbours_that_a_cut_ended_tell_nothing(degrees) -> None:
    member, points, _ = scanned("C", 2e-4)
    assert reach(turned_cut(member, points, degrees), member) is None
    assert reach(points, member) is not None


def test_a_shadow_that_crosses_the_member_tells_nothing() -> None:
    member, points, _ = scanned("rect", 2e-4)
    local = points @ ASKEW
    assert reach(points[local[:, 0] < 0.03 + 0.015 * local[:, 2]], member) is None


def test_a_face_that_goes_on_is_no_end() -> None:
    """Beyond the end, thinner, as a stretch that few rays reached."""
    member, points, _ = scanned("rect", 2e-4)
    more = points[np.random.default_rng(1).random(len(points)) < 0.2] + ASKEW[:, 0] * 0.03
    assert reach(np.concatenate([points, more]), member) is None


def test_rows_of_points_tell_nothing() -> None:
    """Where the scan runs in rows along the member the face may end anywhere up to the next row."""
    member, points, _ = scanned("rect", 0.0, clutter=0.0)
    local = points @ ASKEW
    local[:, 0] = np.round(local[:, 0] / 0.004) * 0.004
    assert reach(local @ ASKEW.T, member) is None


def test_a_plane_across_an_axis_of_the_file_may_be_the_side_of_a_box() -> None:
    member, points, _ = scanned("C", 2e-4)
    straight = replace(member, T_world_member=rigid(np.eye(3), ASKEW.T @ np.asarray(member.T_world_member)[:3, 3]))
    assert reach(points @ ASKEW, straight) is None


def test_a_thin_wall_or_few_points_or_wide_noise_tell_nothing() -> None:
    member, points, _ = scanned("L", 2e-4)
    assert reach(points[:600], member) is None
    thin = replace(made("L", R=ASKEW, values={"a": 0.127, "b": 0.1, "t": 0.002}), seen={**dict.fromkeys(faces("L"), 1.0), "A_TOE": 0.0})
    local = member_points("L", thin.values(), 9000, MemberScanOptions(noise_m=5e-4, faces=tuple(f for f in faces("L") if f != "A_TOE"), seed=2))
    assert reach(local @ ASKEW.T, thin) is None
    noisy, far, _ = scanned("C", 0.012)
    assert reach(far, noisy) is None


def test_a_section_that_has_closed_up_tells_nothing() -> None:
    """Of a sheet that was fitted with next to no thickness no face is apart from another (a fault inside, once)."""
    sheet = made("rect", R=ASKEW, values={"b": 0.1, "t": 5e-5}, sigma=1e-3)
    points = member_points("rect", sheet.values(), 5000, MemberScanOptions(noise_m=1e-3, faces=("BOTTOM", "TOP", "LEFT"), seed=1)) @ ASKEW.T
    assert reach(points, replace(sheet, seen={**dict.fromkeys(faces("rect"), 1.0), "RIGHT": 0.0})) is None
    assert reach(points, replace(sheet, seen={**dict.fromkeys(faces("rect"), 1.0), "TOP": 0.0})) is None


def test_a_direction_in_which_no_face_was_seen_is_not_told() -> None:
    """Of a flat whose both wide faces are hidden the tilt is told by ends alone, and blurs them: 92.1 +- 0.5 was told for 89.7 mm."""
    member, points, _ = scanned("rect", 2e-4)
    narrow = points[np.abs(np.abs((points @ ASKEW)[:, 1]) - 0.02) < 1e-3]
    assert reach(narrow, replace(member, seen={**member.seen, "LEFT": 0.0})) is None
    assert reach(narrow, member) is not None


def test_the_inside_of_a_tube_holds_its_line_where_neither_side_was_seen() -> None:
    """Both ends of the faces beside are told then; with the inside hidden too nothing is."""
    true = made("RHS", values=SIZE["RHS"], R=ASKEW, sigma=2e-4)
    wrong = replace(true, parameters=tuple(replace(p, value_m=p.value_m + 0.002 * (p.name == "b")) for p in true.parameters))
    wrong = replace(wrong, T_world_member=rigid(ASKEW, ASKEW @ np.array([-0.001, 0.0, 0.0])))  # the inside that was seen stays
    for out, told in ((("LEFT_INNER",), {"LEFT_OUTER", "RIGHT_OUTER"}), (("LEFT_INNER", "RIGHT_INNER"), None)):
        seen = tuple(name for name in faces("RHS") if name not in ("LEFT_OUTER", "RIGHT_OUTER", *out))
        points = member_points("RHS", true.values(), 20_000, MemberScanOptions(noise_m=2e-4, faces=seen, clutter=0.02, seed=4)) @ ASKEW.T
        found = reach(points, replace(wrong, seen={name: float(name in seen) for name in faces("RHS")}))
        assert (found and set(found.faces)) == told
        if found is not None:
            assert abs(found.values[1] - true.values()["b"]) < 3 * np.sqrt(found.covariance[1, 1]) < 6e-4


@pytest.mark.parametrize("slope, told", [(0.0, True), (0.006, False)])
def test_a_cut_that_runs_askew_along_the_member_tells_nothing(slope, told) -> None:
    """A box cut by a plane 0.6 degrees off one of its faces had been a box 40 % smaller, with that face seen by nobody."""
    member, points, _ = scanned("rect", 2e-4)
    local = points @ ASKEW  # the hidden face lies at x = b / 2 of the true member
    keep = local[:, 0] < 0.03 + slope * (local[:, 2] - 0.5)
    shifted = replace(member, parameters=tuple(replace(p, value_m=0.08) if p.name == "b" else p for p in member.parameters))
    at = rigid(ASKEW, ASKEW @ np.array([-0.01, 0.0, 0.0]))
    assert (reach(points[keep], replace(shifted, T_world_member=at)) is not None) == told


def test_nothing_is_missing_or_only_one_neighbour_was_seen() -> None:
    member, points, _ = scanned("C", 2e-4)
    assert reach(points, replace(member, seen=dict.fromkeys(member.seen, 1.0))) is None
    assert reach(points, replace(member, seen={**member.seen, "TOP_OUTER": 0.0})) is None
    assert reach(points, replace(member, twist=np.array([0.01]))) is None
    assert reach(points, made("CHS")) is None


def test_it_moves_with_the_member_and_leaves_its_input_alone() -> None:
    member, points, _ = scanned("T", 2e-4)
    before, found = points.copy(), reach(points, member)
    T = rigid(rotation_about((-1, 2, 0.5), 0.4), np.array([3.0, -1.0, 2.0]))
    moved = reach(points @ T[:3, :3].T + T[:3, 3], replace(member, T_world_member=T @ np.asarray(member.T_world_member)))
    assert (points == before).all() and found is not None and moved is not None
    np.testing.assert_allclose(moved.values, found.values, atol=1e-9)
    np.testing.assert_allclose(moved.covariance, found.covariance, rtol=1e-4, atol=1e-14)


@pytest.mark.parametrize("family", ["C", "rect"])
def test_the_whole_fit_tells_the_face_and_builds_the_member(family) -> None:
    _, points, true = scanned(family, 2e-4, n=9000, clutter=0.05, caps=True)
    found = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions())
    member = found.member
    assert member.family == family and open_walls(member) == 0
    assert all(check.passed for check in member_checks(member, found.explains))
    assert len(member.reached) == 1
    for p in member.parameters:
        wanted = true.values()[p.name]
        assert p.std_m is not None and abs(p.value_m - wanted) < 4 * p.std_m, p


CORNER = ("BOTTOM_OUTER", "LEFT_OUTER")


def corner(step=0.0, sigma=2e-4, n=8_000, seed=3):
    """A tube of which one corner was scanned, and its points; with `step` they lie in rows along the member, in a scan moved by a third of it."""
    true = made("RHS", values=SIZE["RHS"], R=ASKEW, sigma=sigma)
    points = member_points("RHS", true.values(), n, MemberScanOptions(noise_m=0.0, faces=CORNER, seed=seed))
    if step:
        points[:, :2] = (np.round(points[:, :2] / step + 0.3) - 0.3) * step
        own = np.abs(points[:, 0] + SIZE["RHS"]["b"] / 2) < np.abs(points[:, 1] + SIZE["RHS"]["h"] / 2)
        points[own, 0], points[~own, 1] = -SIZE["RHS"]["b"] / 2, -SIZE["RHS"]["h"] / 2
        half = np.array([SIZE["RHS"]["b"], SIZE["RHS"]["h"]]) / 2
        points = points[(np.abs(points[:, :2]) <= half + 1e-9).all(axis=1)]
    points = points + sigma * np.random.default_rng(seed).standard_normal(points.shape)
    return replace(true, seen={name: float(name in CORNER) for name in faces("RHS")}), points @ ASKEW.T, true


def test_of_a_whole_scan_a_corner_tells_both_sizes_and_of_any_other_none() -> None:
    member, points, true = corner()
    assert reach(points, member) is None
    found = reach(points, member, whole=True)
    assert found is not None and set(found.faces) == {"RIGHT_OUTER", "TOP_OUTER"} and found.told == {"h", "b"}
    std = np.sqrt(np.diag(found.covariance))
    for name, value, sd in zip(("h", "b"), found.values, std, strict=False):
        assert abs(value - true.values()[name]) < 2 * sd < 2e-3, name


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_rows_along_the_member_leave_the_sizes_open_by_their_distance(seed) -> None:
    step = 0.009
    member, points, true = corner(step, seed=seed)
    found = reach(points, member, whole=True)
    assert found is not None
    std = np.sqrt(np.diag(found.covariance))
    for name, value, sd in zip(("h", "b"), found.values, std, strict=False):
        assert sd == pytest.approx(step / np.sqrt(3), rel=0.15) and abs(value - true.values()[name]) < 2 * sd, name


def test_what_is_held_stays_where_a_whole_scan_tells_the_rest() -> None:
    member, points, _ = corner()
    held = replace(member, parameters=tuple(replace(p, source="fixed") if p.name == "b" else p for p in member.parameters))
    found = reach(points, held, whole=True)
    assert found is not None and found.values[1] == SIZE["RHS"]["b"] and found.covariance[1, 1] == 0 < found.covariance[0, 0]


def test_the_wall_alone_is_given_and_a_whole_scan_of_a_corner_tells_the_rest() -> None:
    _, points, _ = corner()
    scan, options = Scan(cloud=PointCloud.of(points)), MemberOptions(family="RHS", whole=True)
    found = fit_member(scan, options, {"t": SIZE["RHS"]["t"]})
    assert found.explains and len(found.member.reached) == 2, found.reason
    sizes = {p.name: p for p in found.member.parameters}
    one, other = sorted((sizes["h"], sizes["b"]), key=lambda p: p.value_m)
    assert sizes["t"].source == "fixed" and all(c.passed for c in member_checks(found.member, found.explains, given=True))
    assert abs(one.value_m - SIZE["RHS"]["b"]) < 3 * one.std_m and abs(other.value_m - SIZE["RHS"]["h"]) < 3 * other.std_m
    blind = fit_member(scan, replace(options, whole=False), {"t": SIZE["RHS"]["t"]})
    assert not any(p.observable for p in blind.member.parameters if p.name in ("h", "b"))


def test_a_corner_seen_from_within_is_one_seen_from_outside() -> None:
    _, points, _ = corner()
    fit = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions(family="RHS"), {"t": SIZE["RHS"]["t"]}).section
    t = fit.value("t")
    within = replace(fit, values=fit.values + np.array([2 * t, 2 * t, 0.0]), seen={n: float(n in ("LEFT_INNER", "BOTTOM_INNER")) for n in fit.seen})
    turned = seen_from_outside(within)
    np.testing.assert_allclose(turned.values, fit.values)
    assert seen_from_outside(fit) is fit or set(fit.seen) == set(turned.seen)
    narrow = replace(within, values=np.array([3.9 * t, 0.1, t]))
    assert seen_from_outside(narrow) is narrow
    both = replace(within, seen={n: float(n in ("LEFT_INNER", "RIGHT_INNER")) for n in fit.seen})
    assert seen_from_outside(both) is both


def test_rows_across_a_whole_scan_leave_its_length_open() -> None:
    """Rows 20 mm apart: the ends are known to 20 mm / 3^(1/2) each; what was wider stays, what is held too."""
    member, points, _ = corner()
    local = points @ ASKEW
    local[:, 2] = np.round(local[:, 2] / 0.02) * 0.02
    rows = end_rows(local @ ASKEW.T, member)
    assert rows == pytest.approx(np.sqrt(2 / 3) * 0.02, rel=0.05) and rows > 4 * end_rows(points, member)
    wider = with_length_std(member, rows)
    assert wider.parameters[-1].std_m == rows and wider.covariance[-1, -1] == rows**2 and member.parameters[-1].std_m < rows
    assert with_length_std(wider, 0.5 * rows) is wider
    held = replace(member, parameters=(*member.parameters[:-1], replace(member.parameters[-1], std_m=None, source="fixed")))
    assert with_length_std(held, rows) is held


@pytest.mark.parametrize(("web", "is_told"), [(0.016, True), (0.0799, False)])
def test_toes_of_an_i_seen_from_one_side_are_no_channels_web(web, is_told) -> None:
    """Both flanges stop at one line behind the web: no section of the table has a web of half the flange's width, but an I has toes there."""
    member = made("C", values={"h": 0.45, "b": 0.152, "tw": web, "tf": 0.0108}, R=ASKEW, sigma=2e-4)
    seen = tuple(name for name in faces("C") if name != "WEB_OUTER")
    points = member_points("C", member.values(), 20_000, MemberScanOptions(noise_m=2e-4, faces=seen, seed=4)) @ ASKEW.T
    found = reach(points, replace(member, seen={name: float(name in seen) for name in faces("C")}))
    assert (found is not None) == is_told


def test_ends_that_make_no_section_are_none() -> None:
    """Stops of faces that would leave a channel's web no thickness, or its flanges more than the room, are of something else."""
    member, _, _ = scanned("C", 2e-4)
    seen = {name for name, share in member.seen.items() if share}
    wall = member.values()["tw"]
    assert solved(member, seen, {"WEB_OUTER": (-0.5 * wall, 1e-3)}, 20_000) is not None
    assert solved(member, seen, {"WEB_OUTER": (-1.5 * wall, 1e-3)}, 20_000) is None
