import numpy as np
import pytest

from scan2fea.errors import EstimationError, InputError, UsageError
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.outline import outline_distance
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.sections import section
from scan2fea.kernel.transforms import random_rotation
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan

CASES = {
    "L": {"a": 0.16, "b": 0.1, "t": 0.012, "length": 2.0},
    "I": {"h": 0.22, "b": 0.11, "tw": 0.006, "tf": 0.0092, "length": 1.5},
    "C": {"h": 0.14, "b": 0.06, "tw": 0.007, "tf": 0.01, "length": 1.2},
    "T": {"h": 0.1, "b": 0.12, "tw": 0.008, "tf": 0.01, "length": 1.2},
    "RHS": {"h": 0.14, "b": 0.08, "t": 0.006, "length": 1.6},
    "CHS": {"d": 0.168, "t": 0.01, "length": 1.2},
    "rect": {"b": 0.1, "t": 0.02, "length": 0.9},
    "round": {"d": 0.05, "length": 0.6},
}


def fitted(points, options=MemberOptions(), fixed=None):
    return fit_member(Scan(cloud=PointCloud.of(points)), options, fixed)


def scan(family, n=4_000, *, values=None, bow=((), ()), twist=(), **options):
    return member_points(family, values or CASES[family], n, MemberScanOptions(**options), bow, twist)


def assert_right(found, family, values, z=4.5):
    assert found.explains, found.reason
    assert found.member.family == family
    for one in found.member.parameters:
        if one.observable:
            assert abs(one.value_m - values[one.name]) < z * one.std_m, one
    assert max(found.member.families, key=found.member.families.get) == family


@pytest.mark.parametrize("family", list(CASES))
def test_every_family_anywhere_with_clutter(family):
    R = random_rotation(np.random.default_rng(sum(map(ord, family))))
    caps = family in ("rect", "round")  # closed caps are what tells a bar from a tube
    points = scan(family, noise_m=0.001, clutter=0.1, seed=2, caps=caps) @ R.T + [3.0, -7.0, 11.0]
    kept = points.copy()
    found = fitted(points)
    assert_right(found, family, CASES[family])
    assert abs(abs(found.member.T_world_member[:3, 2] @ R[:, 2]) - 1) < 1e-5
    assert np.allclose(found.member.T_world_member[:3, :3] @ found.member.T_world_member[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(found.member.T_world_member[:3, :3]) == pytest.approx(1)
    assert all(one.observable for one in found.member.parameters)
    assert (points == kept).all()
    covariance = found.member.covariance
    assert np.allclose(np.sqrt(np.diag(covariance)), [one.std_m for one in found.member.parameters])
    assert np.linalg.eigvalsh(covariance).min() > -1e-15


def test_strays_beside_walls_within_the_noise_are_no_pattern():
    """Of even clutter more lies just outside a thin wall than within it: the cells' expected means must allow for that."""
    found = fitted(scan("C", 8_000, noise_m=0.03 * CASES["C"]["h"], clutter=0.15, seed=5), MemberOptions(family="C"))
    assert_right(found, "C", CASES["C"])
    assert found.explanation.pattern_share < 0.1


def test_the_member_lies_on_its_points():
    points = scan("I", noise_m=0.001, seed=1, bow=((0.01,), (-0.02,)), twist=(0.05,))
    found = fitted(points)
    member = found.member
    assert_right(found, "I", CASES["I"])
    assert member.bow.shape[1] >= 1 and len(member.twist) == 1
    local = sweep_of_member(member).coordinates(points)
    distance = outline_distance(section("I", member.values()), local[:, :2])[0]
    assert np.sqrt(np.mean(distance**2)) < 1.1e-3
    assert np.allclose(np.linalg.norm(member.end_normals, axis=1), 1)


def test_a_straight_member_is_exactly_straight_and_its_sag_comes_with_an_error():
    found = fitted(scan("L", noise_m=0.002, seed=4))
    assert found.member.bow.shape == (2, 0) and found.member.twist.shape == (0,)
    assert (np.abs(found.sag_m) < 4 * found.sag_std_m).all()
    bound = 3.354 * np.sqrt(2) * 0.002 / np.sqrt(4_000)  # shape-estimation.md; every point tells one of two directions
    assert (found.sag_std_m < 2 * bound).all() and (found.sag_std_m > 0.5 * bound).all()


def test_sag_is_that_of_the_whole_length():
    """The section is fitted without the ends, which the noise blurs; over what is left, the same curve sags by a tenth less."""
    found = fitted(scan("L", 20_000, noise_m=0.01, seed=2, bow=((-0.02,), (0.0,))))
    assert abs(np.linalg.norm(found.sag_m) - 0.03) < 4 * found.sag_std_m.max() < 0.003


def test_faces_that_were_not_seen_are_said_so():
    seen = ("TOP_OUTER", "TOP_INNER_LEFT", "WEB_LEFT", "BOTTOM_INNER_LEFT", "TOP_TOE_LEFT", "BOTTOM_TOE_LEFT")
    found = fitted(scan("I", 6_000, noise_m=0.001, seed=3, faces=seen))
    assert found.explains, found.reason
    outer = sorted((found.member.seen["TOP_OUTER"], found.member.seen["BOTTOM_OUTER"]))  # an I has no up and down
    assert outer[0] < 0.3 < 0.9 < outer[1]
    for one in found.member.parameters:
        assert not one.observable or abs(one.value_m - CASES["I"][one.name]) < 5 * one.std_m


def test_what_is_fixed_is_not_fitted_and_its_contradiction_is_found():
    points = scan("L", noise_m=0.002, seed=5)
    right = fitted(points, MemberOptions(family="L"), {"t": 0.012})
    wrong = fitted(points, MemberOptions(family="L"), {"t": 0.014})
    assert right.p_fixed > 0.001 > 1e-9 > wrong.p_fixed
    t = next(one for one in right.member.parameters if one.name == "t")
    assert (t.value_m, t.std_m, t.source) == (0.012, None, "fixed")
    with pytest.raises(UsageError, match="tw"):
        fitted(points, MemberOptions(family="L"), {"tw": 0.01})
    with pytest.raises(UsageError, match="positive"):
        fitted(points, MemberOptions(family="L"), {"t": -0.01})


def test_a_crate_is_a_bar_along_its_longest_side():
    values = {"b": 0.4, "t": 0.3, "length": 0.45}
    found = fitted(scan("rect", values=values, noise_m=0.001, caps=True, seed=1))
    assert_right(found, "rect", values)


def no_members():
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(4_000, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    noise = 0.001 * rng.standard_normal((4_000, 3))
    beam = scan("I", 4_000, noise_m=0.001, seed=6)
    other = scan("L", 4_000, noise_m=0.001, seed=7)
    yield "sphere", 0.2 * ball + noise
    yield "ellipsoid", ball * [0.1, 0.13, 0.4] + noise
    yield "stub", scan("L", 4_000, values={**CASES["L"], "length": 0.1}, noise_m=0.0005, seed=8)
    yield "two bodies", np.r_[beam, other + [0.5, 0.1, 0.0]]
    yield "in one line", np.r_[beam, beam + [0, 0, 2.0]]
    yield "holes", with_hole(scan("rect", 12_000, values={"b": 0.2, "t": 0.02, "length": 0.5}, noise_m=0.0005, seed=9))


def with_hole(points):
    return points[np.hypot(points[:, 0], points[:, 2] - 0.25) > 0.05]


@pytest.mark.parametrize(("what", "points"), list(no_members()), ids=lambda v: v if isinstance(v, str) else "")
def test_no_member_is_refused_with_a_reason(what, points):
    try:
        found = fitted(points)
    except EstimationError as error:
        assert "segment" in str(error) or "no member" in str(error)
        return
    assert not found.explains
    assert len(found.reason) > 20


def test_bad_input():
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="at least 50"):
        fitted(rng.random((49, 3)))
    with pytest.raises(EstimationError, match="one line"):
        fitted(np.c_[rng.random(200), np.zeros((200, 2))])
    with pytest.raises(InputError, match="finite"):
        fitted(np.where(rng.random((200, 3)) < 0.01, np.nan, 1.0))


def test_the_same_points_give_the_same_member():
    points = scan("C", noise_m=0.001, seed=2)
    one, two = fitted(points), fitted(points)
    assert one.member.values() == two.member.values()
    assert (one.member.covariance == two.member.covariance).all()
