"""A member of which one end was cut off the scan does not come as a whole one; an end that could not be seen, or that sight lines pass, is one."""

from dataclasses import replace

import numpy as np
import pytest

from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.unseen_end import unseen_end
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.kernel.transforms import rotation_about
from scan2fea.pipeline.route import KnownSection, RouteOptions, estimate
from scan2fea.simulation.members import member as member_shape
from scan2fea.types import Footing, PointCloud, Rays, Scan

TURN = rotation_about((1.0, 2.0, -1.0), 0.9)
SIZES = {
    "I": {"h": 0.2, "b": 0.12, "tw": 0.01, "tf": 0.014, "length": 1.2},
    "RHS": {"h": 0.14, "b": 0.08, "t": 0.008, "length": 1.2},
    "round": {"d": 0.09, "length": 1.2},
}
CUT = 0.7


def points(family: str, keep=lambda p: np.ones(len(p), bool), sigma=0.0006) -> np.ndarray:
    own, _ = sample_surface(member_shape(family, SIZES[family], 1e-4).mesh, 30_000, 4)
    own = own[keep(own)]
    return (own + sigma * np.random.default_rng(4).standard_normal(own.shape)) @ TURN.T


def cut(p: np.ndarray) -> np.ndarray:
    return p[:, 2] < CUT


def scan_of(p: np.ndarray, rays: Rays | None = None) -> Scan:
    cloud = PointCloud.of(p)
    return Scan(cloud=cloud if rays is None else replace(cloud, ray=np.arange(len(p))), rays=rays)


def rays(origin: np.ndarray, to: np.ndarray) -> Rays:
    """To points, from one place."""
    away = to - origin
    far = np.linalg.norm(away, axis=1)
    return Rays(origin=np.broadcast_to(origin, to.shape).copy(), direction=away / far[:, None], range_m=far)


@pytest.mark.parametrize("family", SIZES)
def test_a_member_cut_across_tells_no_length_and_the_whole_one_does(family):
    half = estimate(scan_of(points(family, cut)), MemberOptions(), RouteOptions())
    assert half.explains and "nothing of the other's" in half.open_end
    assert half.member is not None and not half.member.parameters[-1].observable
    whole = estimate(scan_of(points(family)), MemberOptions(), RouteOptions())
    assert whole.explains and whole.open_end == "" and whole.member.parameters[-1].observable


def test_the_user_may_say_that_nothing_was_cut_off_it_or_how_long_it_is():
    half = scan_of(points("I", cut))
    assert estimate(half, MemberOptions(whole=True), RouteOptions()).open_end == ""
    assert estimate(half, MemberOptions(), RouteOptions(), KnownSection(fixed={"length": CUT})).open_end == ""


@pytest.fixture(scope="module")
def half():
    p = points("I", cut)
    return p, fit_member(scan_of(p))


def test_of_both_ends_without_a_face_nothing_is_said(half):
    p, fit = half
    assert fit.ends.alone[0] + fit.ends.alone[1] > 0.99
    assert unseen_end(scan_of(p), replace(fit.ends, alone=(0.0, 0.0)), fit.member) == ""
    bare = fit_member(scan_of(points("I", lambda q: cut(q) & (q[:, 2] > 1e-9))))
    assert max(bare.ends.alone) < 0.5


def test_a_scan_from_one_side_does_not_see_every_face(half):
    p, fit = half
    seen = {name: 0.0 if name.startswith("TOP") else share for name, share in fit.member.seen.items()}
    assert unseen_end(scan_of(p), fit.ends, replace(fit.member, seen=seen)) == ""


def seen_from(origin: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Those of the points that the whole member does not hide from a place."""
    mesh = member_shape("I", SIZES["I"], 1e-4).mesh
    lines = rays(origin @ TURN, p @ TURN)
    return p[first_hits(scene_of(mesh), lines.origin, lines.direction)[0] > lines.range_m - 0.004]


def test_what_no_sensor_looked_at_may_be_there_and_what_one_did_may_not(half):
    p, fit = half
    behind, before = (TURN @ np.array([0.3, 0.8, z]) for z in (-2.0, 3.0))
    for place, told in ((behind, False), (before, True)):
        own = seen_from(place, p)
        assert ("nothing of the other's" in unseen_end(scan_of(own, rays(place, own)), fit.ends, fit.member)) == told


def test_sight_lines_beyond_an_end_show_that_it_stops_there(half):
    p, fit = half
    origin = TURN @ np.array([0.3, 2.0, 1.5])
    wall = np.stack(np.meshgrid(np.linspace(-0.3, 0.3, 40), [-1.0], np.linspace(0.0, 1.2, 80)), -1).reshape(-1, 3) @ TURN.T
    of_wall = rays(origin, wall)
    p = seen_from(origin, p)
    own = rays(origin, p)
    both = Rays(**{name: np.concatenate([getattr(own, name), getattr(of_wall, name)]) for name in ("origin", "direction", "range_m")})
    assert unseen_end(scan_of(p, both), fit.ends, fit.member) == ""
    assert "nothing of the other's" in unseen_end(scan_of(p, own), fit.ends, fit.member)


def test_an_end_on_a_plane_is_not_seen(half):
    p, fit = half
    up = -TURN[:, 2]
    floor = Footing(normal=up, offset_m=float(up @ (TURN @ [0, 0, CUT])), sigma_m=6e-4, std_m=1e-5, band_m=2e-3, points=np.zeros((0, 3)))
    assert unseen_end(scan_of(p), fit.ends, fit.member, [floor]) == ""
    at_other = replace(floor, offset_m=0.0, normal=-up)
    assert "nothing of the other's" in unseen_end(scan_of(p), fit.ends, fit.member, [at_other])
