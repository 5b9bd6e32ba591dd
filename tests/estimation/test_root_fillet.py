"""The radius of root fillets from points, against members that have it."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import SIZES, made
from predicates import rotation
from scan2fea.estimation.corner_doubt import with_hidden_corners
from scan2fea.estimation.lacking import lacking
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.outline import outline_distance
from scan2fea.estimation.root_fillet import OPEN, roots_of, squared
from scan2fea.estimation.solid import SolidOptions, solid_of
from scan2fea.kernel.outline import outline
from scan2fea.kernel.sections import section
from scan2fea.types import PointCloud, RootFillet, Scan
from scan2fea.verification.member import relative_volume_std

HE_100_AA, ROOT = {"h": 0.091, "b": 0.1, "tw": 0.0042, "tf": 0.0055}, 0.012  # EN 10365
RADIUS = {"I": 0.012, "L": 0.011, "C": 0.0105, "T": 0.011}


def rolled(member, radius, n, sigma, seed, clutter=0.0, shape=None):
    """(n, 3) noisy points of the sides and ends of a member with root fillets, evenly over its true arcs; shape : its outline in place of these."""
    rng = np.random.default_rng(seed)
    values = member.values()
    edges = [edge for loop in (shape or outline(member.family, values, radius)).loops for edge in loop]
    length = [abs(e.turn) * e.radius if e.centre is not None else float(np.linalg.norm(e.end - e.start)) for e in edges]
    of, share = rng.choice(len(edges), n, p=np.array(length) / sum(length)), rng.random(n)
    xy = np.empty((n, 2))
    for i, (k, t) in enumerate(zip(of.tolist(), share.tolist(), strict=True)):
        e = edges[k]
        if e.centre is None:
            xy[i] = e.start + t * (e.end - e.start)
        else:
            c, s = np.cos(e.turn * t), np.sin(e.turn * t)
            xy[i] = e.centre + np.array([[c, -s], [s, c]]) @ (e.start - e.centre)
    local = np.column_stack([xy, rng.uniform(0, values["length"], n)])
    inner = np.stack([rng.uniform(*span, 40 * n) for span in zip(xy.min(0), xy.max(0), strict=True)], 1)
    inner = inner[outline_distance(section(member.family, values), inner)[0] < 0][: n // 50]  # the end faces
    local[: len(inner)] = np.column_stack([inner, values["length"] * (np.arange(len(inner)) % 2)])
    local += sigma * rng.normal(size=local.shape)
    k = int(clutter * n)
    local[len(inner) : len(inner) + k] = rng.uniform(local.min(0) - 0.05, local.max(0) + 0.05, (k, 3))
    return local @ member.T_world_member[:3, :3].T + member.T_world_member[:3, 3]


@pytest.mark.parametrize("family", OPEN)
@pytest.mark.parametrize(("sigma", "clutter"), [(0.0005, 0.0), (0.001, 0.1)])
def test_the_radius_is_told(family, sigma, clutter):
    member = made(family, R=rotation(4), shift=(1, 2, 3), sigma=sigma)
    found = roots_of(rolled(member, RADIUS[family], 9_000, sigma, 5, clutter), member).fillet
    assert found.is_observable and found.std_m < 0.0006
    assert abs(found.radius_m - RADIUS[family]) < 3 * found.std_m and found.most_m > found.radius_m


@pytest.mark.parametrize(("radius", "sigma"), [(0.0, 0.0008), (0.0075, 0.0004), (0.01, 0.0008), (0.015, 0.0012)])
def test_a_tube_with_round_corners_is_as_wide_as_it_is(radius, sigma):
    """EN 10210-2, EN 10219-2: outer radii of 1.5 to 3 walls. Tubes of 100 x 60 x 5 had been told as 99.4 +- 0.05 wide."""
    tube = made("RHS", R=rotation(5), shift=(1, 2, 3), sigma=sigma)
    found = fit_member(Scan(cloud=PointCloud.of(rolled(tube, radius, 12_000, sigma, 1))))
    root = found.member.root
    assert found.explains and found.member.family == "RHS"
    assert abs(root.radius_m - radius) <= 4 * root.std_m and root.is_observable
    for p in found.member.parameters[:3]:
        assert p.std_m is not None and abs(p.value_m - SIZES["RHS"][p.name]) < 3 * p.std_m < 0.0006, p.name
    names = set(solid_of(found.member).face_names)
    assert ({"CORNER_1", "CORNER_4"} <= names) == (radius > 0)


@pytest.mark.parametrize("sigma", [0.0003, 0.0012])
def test_an_angle_with_round_toes_is_as_wide_as_it_is(sigma):
    """EN 10056-1: L 100 x 10 has a root radius of 12 mm, toes of 6. Where noise hid the toes it had been told as 99.49 +- 0.10 wide."""
    true = made("L", 1.2, {"a": 0.1, "b": 0.1, "t": 0.01}, R=rotation(4), sigma=sigma)
    found = fit_member(Scan(cloud=PointCloud.of(rolled(true, 0.012, 15_000, sigma, 5, shape=outline("L", true.values(), 0.012, 0.006))))).member
    assert abs(found.root.toe_m - 0.006) < 0.0006 and (found.root.toe_source == "assumed" or sigma < 0.001)
    for p in found.parameters:
        assert abs(p.value_m - true.values()[p.name]) < min(2 * p.std_m, 0.001), p.name


def test_toes_that_the_points_show_otherwise_are_told_by_them():
    true = made("L", 1.2, {"a": 0.1, "b": 0.1, "t": 0.01}, R=rotation(4), sigma=0.0003)
    for toe in (0.0, 0.003):
        root = roots_of(rolled(true, 0.012, 15_000, 0.0003, 5, shape=outline("L", true.values(), 0.012, toe)), true).fillet
        assert root.toe_source == "fitted" and abs(root.toe_m - toe) < 0.0003


@pytest.mark.parametrize("sigma", [0.0002, 0.001])
def test_toes_are_rounded_no_more_than_they_are_thick(sigma):
    """A bent plate has a root radius of several walls, of which half is more than its toes have."""
    true = made("L", 1.0, {"a": 0.06, "b": 0.06, "t": 0.004}, R=rotation(4), sigma=sigma)
    root = roots_of(rolled(true, 0.012, 9_000, sigma, 5), true).fillet
    assert abs(root.radius_m - 0.012) < 0.001 and root.toe_m < 0.0031
    assert len(solid_of(replace(true, root=root)).face_names) == (11 if root.toe_m else 9)


def test_a_wall_thinner_than_its_noise_tells_no_corners_of_a_tube():
    tube = made("RHS", sigma=0.0018)
    found = roots_of(rolled(tube, 0.01, 12_000, 0.0018, 1), tube).fillet
    assert found == RootFillet(is_observable=False, most_m=np.inf)


@pytest.mark.parametrize("family", ["L", "RHS"])
def test_what_hidden_corners_have_moved_is_told_as_doubt(family):
    """L 60 x 6 had been told as 59.49 +- 0.10 with toes of 4 mm, RHS 100 x 60 x 5 as 99.43 +- 0.18 with corners of 10 mm taken for 7 +- 0.9."""
    sizes = {"L": {"a": 0.06, "b": 0.06, "t": 0.006}, "RHS": {"h": 0.1, "b": 0.06, "t": 0.005}}[family]
    sigma = 0.3 * sizes["t"]
    true = made(family, 1.2, sizes, R=rotation(4), sigma=sigma)
    shape = outline("L", true.values(), 0.008, 0.004) if family == "L" else outline("RHS", true.values(), 0.01)
    found = fit_member(Scan(cloud=PointCloud.of(rolled(true, 0.0, 15_000, sigma, 5, shape=shape))), MemberOptions(family=family)).member
    assert found.root.radius_m == 0
    for p in found.parameters[:3]:
        assert p.std_m is not None and abs(p.value_m - sizes[p.name]) < 2 * p.std_m < 0.002, p.name


@pytest.mark.parametrize("family", [*OPEN, "RHS"])
def test_points_that_rule_rounds_out_leave_no_doubt(family):
    member = replace(made(family, std=5e-5), root=RootFillet(most_m=0.001))
    for p in with_hidden_corners(member).parameters:
        assert p.std_m is None or p.std_m < 6.5e-5, p.name
    wide = with_hidden_corners(replace(member, root=RootFillet()))
    assert max(p.std_m or 0.0 for p in wide.parameters) > 1e-4 and np.linalg.eigvalsh(wide.covariance).min() > -1e-18


@pytest.mark.parametrize("family", OPEN)
def test_sharp_corners_have_none(family):
    for seed in range(2):
        member = made(family, sigma=0.0007)
        found = roots_of(rolled(member, 0.0, 8_000, 0.0007, seed), member).fillet
        assert found.radius_m == 0 and found.std_m == 0 and found.is_observable


def test_what_noise_hides_is_not_told():
    member = made("I", sigma=0.0025)
    found = roots_of(rolled(member, 0.006, 4_000, 0.0025, 1), member).fillet
    assert found.radius_m == 0 and not found.is_observable
    few = roots_of(rolled(made("I"), 0.012, 150, 0.0005, 1), made("I")).fillet
    assert few == RootFillet()
    assert roots_of(rolled(made("CHS"), 0.0, 3_000, 0.0005, 1), made("CHS")).fillet == RootFillet()


@pytest.mark.parametrize(("slope", "tells"), [(0.14, False), (0.08, False), (0.02, True)])
def test_flanges_that_slope_have_no_arc_between_faces_at_right_angles(slope, tells):
    """IPN 14 %, UPN 8 %; EN 10034 lets parallel flanges lean by 2 %."""
    member = made("I", sigma=0.0004)
    points = rolled(member, 0.012, 12_000, 0.0004, 6)
    x, y = np.abs(points[:, 0]), points[:, 1]
    inner = (np.abs(y) < 0.0955) & (np.abs(y) > 0.075) & (x > 0.0029)
    points[:, 1] -= inner * np.sign(y) * slope * np.clip(0.025 - x, -0.025, 0.025)
    assert (roots_of(points, member).fillet.radius_m > 0) == tells


@pytest.mark.parametrize("family", OPEN)
def test_points_of_arcs_are_moved_to_the_sharp_section(family):
    """Without noise onto its faces, and by no more than what lies between arc and corner; what lies off by d stays off by d."""
    member = made(family, R=rotation(2), sigma=1e-5, twist=(0.02,), bow=((0.003,), (0.001,)))
    straight = made(family)
    local = rolled(straight, RADIUS[family], 8_000, 0.0, 3)
    roots = roots_of(rolled(straight, RADIUS[family], 8_000, 1e-5, 3), replace(straight, sigma_m=1e-5))
    assert abs(roots.fillet.radius_m - RADIUS[family]) < 2e-5
    sure = replace(roots, fillet=replace(roots.fillet, radius_m=RADIUS[family]))
    moved = squared(local, straight, sure)
    off = outline_distance(section(family, straight.values()), moved[:, :2])[0]
    side = (local[:, 2] > 0) & (local[:, 2] < 1)
    assert np.abs(off[side]).max() < 1e-5
    assert np.linalg.norm((moved - local)[side], axis=1).max() < 0.42 * RADIUS[family]
    swept = solid_of(replace(member, root=sure.fillet)).mesh.vertices
    gone = np.linalg.norm(squared(swept, member, sure) - swept, axis=1)
    assert 0 < gone.max() < 0.42 * RADIUS[family] + 0.001


def test_a_beam_of_large_fillets_is_fitted_with_them():
    """HE 100 AA: its fillets are 8 % of the section; left out they widen web and flanges, and the section lacks material."""
    true = made("I", 0.8, HE_100_AA, R=rotation(5))
    points = rolled(true, ROOT, 3_000, 0.0004, 2)
    assert "fillets" in lacking(points, replace(true, sigma_m=0.0004))
    found = fit_member(Scan(cloud=PointCloud.of(points)))
    assert found.explains and found.member.family == "I"
    root = found.member.root
    assert abs(root.radius_m - ROOT) < 3 * root.std_m < 0.001
    for p in found.member.parameters[:4]:
        assert p.std_m is not None and abs(p.value_m - HE_100_AA[p.name]) < 3.5 * p.std_m, p.name
    v = found.member.values()
    area = 2 * v["b"] * v["tf"] + v["tw"] * (v["h"] - 2 * v["tf"]) + 4 * (1 - np.pi / 4) * root.radius_m**2
    assert area == pytest.approx(1560e-6, rel=0.01)  # the mill's table: 15.6 cm2


def test_the_radius_is_carried_into_the_solid_and_its_doubt():
    """The volume's variance is that of the area of four fillets where nothing else is uncertain."""
    member = replace(made("I", std=0.0), root=RootFillet(radius_m=0.012, std_m=0.001, is_observable=True))
    solid = solid_of(member)
    assert {"ROOT_1", "ROOT_2", "ROOT_3", "ROOT_4"} <= set(solid.face_names)
    assert "ROOT_1" not in solid_of(member, SolidOptions(root_radius_m=0.0)).face_names
    v = SIZES["I"]
    area = 2 * v["b"] * v["tf"] + v["tw"] * (v["h"] - 2 * v["tf"]) + 4 * (1 - np.pi / 4) * 0.012**2
    fillets = 4 * (1 - np.pi / 4) * (0.012**2 - 0.011**2)
    assert relative_volume_std(member) == pytest.approx(fillets / area, rel=1e-9)
