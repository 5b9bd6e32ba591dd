import dataclasses
import importlib
from types import SimpleNamespace

import numpy as np
import pytest

from predicates import box, moved, rotation
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals, volume
from scan2fea.reconstruction import advancing_front, visibility
from scan2fea.reconstruction.budget import WALL_ENDS
from scan2fea.reconstruction.evidence import Ends, Evidence
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.wall_ends import LIMIT, ON, _across_m, _spacing, _span, passed, stretches, unseen_ends, wall_ends
from scan2fea.simulation.shapes import chs
from scan2fea.types import PointCloud, Scan
from scanned import DENSITY

T = 0.006

SIZE = np.array([0.2, 0.15, T])


def sampled(mesh, spacing, seed=0):
    return sample_surface(mesh, int(DENSITY * area(mesh) / spacing**2), seed)[0]


def at_border(points):
    """Points of a plate that lie on its rim and on neither face."""
    return (points[:, 2] > 1e-9) & (points[:, 2] < T - 1e-9)


def evidence_without(gone, spacing=0.004, seed=0):
    """What the gate sees of a plate scanned but for `gone`: the surface is made of the points."""
    points = sampled(box(SIZE), spacing, seed)
    found = visibility(Scan(cloud=PointCloud.of(points[~gone(points)])))
    evidence = Evidence(
        points=points[~gone(points)],
        mesh=found.mesh,
        smoothed=found.points,
        normals=found.normals,
        thickness_m=found.thickness_m,
        gap_m=found.thickness_m,
        spacing_m=found.spacing_m,
        sigma_m=found.sigma_m,
    )
    return found, evidence


@pytest.fixture(scope="module")
def notch():
    return lambda points: np.linalg.norm(points[:, :2] - [0.1, 0.0], axis=1) < 0.04


def value(found):
    return {check.name: check for check in found.checks}[WALL_ENDS]


@pytest.mark.parametrize("seed", range(2))
def test_a_plate_seen_all_round_ends_where_it_ends(seed):
    found, evidence = evidence_without(lambda points: np.zeros(len(points), bool), seed=seed)
    assert value(found).passed and wall_ends(evidence).value == 0.0  # other answers may have had an end there
    assert stretches(evidence) == ([], [])


def test_a_notch_through_both_faces_is_no_end(notch):
    found, evidence = evidence_without(notch)
    ends, every = stretches(evidence)
    assert len(every) == len(ends) and all(np.isinf(end.slack_m).all() for end in ends)
    length = sum(end.length_m for end in ends)
    assert 0.9 * np.pi * 0.04 < length < 2.0 * np.pi * 0.04  # the half circle, rugged, and on to the next points seen on the true rim
    assert all(end.wall_m == pytest.approx(T, rel=0.05) for end in ends)
    middles = np.concatenate([found.mesh.vertices[found.mesh.faces[end.faces]].mean(axis=1) for end in ends])
    assert np.median(np.abs(np.linalg.norm(middles[:, :2] - [0.1, 0.0], axis=1) - 0.04)) < 0.004
    assert WALL_ENDS in [check.name for check in failed(found.checks)]
    assert "scan the edges too" in value(found).says and "around (0.09" in value(found).says


def test_a_bore_without_points_on_its_wall_may_be_none():
    hole = lambda points: np.linalg.norm(points[:, :2] - [0.1, 0.075], axis=1) < 0.03  # noqa: E731
    found, _ = evidence_without(hole)
    true = np.pi * 0.03**2 * T / volume(found.mesh)
    assert true < value(found).value < 6 * true and not value(found).passed


def test_beyond_an_end_that_was_not_seen_may_be_anything():
    cut = lambda points: points[:, 0] > 0.15  # noqa: E731
    assert value(evidence_without(cut)[0]).value == 1.0
    unseen_rim = lambda points: at_border(points) & (points[:, 0] > 0.2 - 1e-9)  # noqa: E731
    assert value(evidence_without(unseen_rim)[0]).value == 1.0


def test_half_of_a_tube():
    points = sampled(chs(0.1, 0.008, 0.2), 0.005)
    assert not value(visibility(Scan(cloud=PointCloud.of(points[points[:, 2] < 0.1])))).passed


def test_scale_and_pose_change_nothing(notch):
    points = sampled(box(SIZE), 0.004)
    points = points[~notch(points)]
    turned = moved(box(SIZE), 39.37 * rotation(4), np.array([3.0, -2.0, 8.0]))  # inches
    first = visibility(Scan(cloud=PointCloud.of(points)))
    second = visibility(Scan(cloud=PointCloud.of(39.37 * points @ rotation(4).T + [3.0, -2.0, 8.0])))
    assert volume(turned) == pytest.approx(39.37**3 * volume(box(SIZE)))
    assert value(second).value == pytest.approx(value(first).value, rel=0.3)


def test_asked_of_every_surface_over_the_points(notch):
    points = sampled(box(SIZE), 0.004)
    assert not value(advancing_front(Scan(cloud=PointCloud.of(points[~notch(points)])))).passed


def test_the_limit_is_inclusive_and_nothing_is_said_without_a_wall(notch):
    _, evidence = evidence_without(notch)
    assert stretches(dataclasses.replace(evidence, thickness_m=np.full(len(evidence.points), np.nan))) == ([], [])
    assert wall_ends(evidence).limit == LIMIT


def test_a_line_of_sight_passes_a_place():
    origin, target = np.zeros((1, 3)), np.array([[4.0, 0.0, 0.0]])
    places = np.array([[1, 0.5, 0], [1, 0.5001, 0], [2.999, 0, 0], [3.0, 0, 0], [-1, 0, 0], [5, 0, 0]], float)
    assert passed(places, origin, target, 0.5).tolist() == [True, False, True, False, False, False]
    assert not passed(places, target, target, 0.5).any()


def test_lines_past_blocks_of_places_are_those_past_each():
    rng = np.random.default_rng(5)
    places, target = rng.uniform(-1, 1, (300, 3)), rng.uniform(-1, 1, (500, 3))
    origin, near = 3.0 * rng.normal(size=(4, 3))[rng.integers(0, 4, 500)], 0.03
    way, to = target - origin, places[:, None] - origin
    length = np.linalg.norm(way, axis=1)
    at = np.einsum("rc,prc->pr", way, to) / length
    off2 = (to**2).sum(axis=2) - at**2
    told = ((at > 0) & (at < length - 2 * near) & (off2 <= near**2)).any(axis=1)
    assert np.array_equal(passed(places, origin, target, near), told)
    assert 0.1 < told.mean() < 0.9


def test_what_is_seen_through_a_notch_is_empty(notch):
    _, evidence = evidence_without(notch)
    away = [0.0, 0.0, 10.0]
    below = np.stack(np.meshgrid(np.linspace(0.0, 0.2, 60), np.linspace(-0.05, 0.15, 60), [-0.5]), axis=-1).reshape(-1, 3)
    n, m = len(evidence.points), len(below)
    through = below[notch(below)]  # sight lines that reach a floor far below
    rows = lambda own, more: np.concatenate([own, more])  # noqa: E731
    seen = dataclasses.replace(
        evidence, points=rows(evidence.points, through), sensors=rows(evidence.points + away, through + away),
        smoothed=rows(evidence.smoothed, through),
        normals=rows(evidence.normals, np.tile([0.0, 0.0, 1.0], (len(through), 1))), gap_m=np.full(n + len(through), np.nan),
        thickness_m=rows(evidence.thickness_m, np.full(len(through), np.nan)),
    )  # fmt: skip
    assert m and wall_ends(evidence).value > LIMIT
    assert wall_ends(seen).value < 0.5 * wall_ends(evidence).value
    blind = dataclasses.replace(seen, sensors=np.full_like(seen.points, np.nan))
    assert wall_ends(blind).value == pytest.approx(wall_ends(evidence).value, rel=0.01)


def test_an_end_that_another_answer_had_stays_where_the_surface_is_the_same(notch):
    _, evidence = evidence_without(lambda points: np.zeros(len(points), bool))
    h = evidence.spacing_m
    on = evidence.mesh.vertices[evidence.mesh.faces[:9]].mean(axis=1)
    normal = face_normals(evidence.mesh)[:9]
    ends = lambda shares, places, of: Ends(shares=np.array(shares), places=places, of=np.array(of, int))  # noqa: E731
    asked = lambda one, before: wall_ends(dataclasses.replace(one, ends_before=(before,)))  # noqa: E731
    told = lambda off, share=0.3: asked(evidence, ends([share], on + off * h * normal, 9 * [0]))  # noqa: E731
    assert told(0.0).value == 0.3 and not told(0.0).passed
    reach = ON + evidence.sigma_m / h
    assert not told(reach - 1e-9).passed and told(reach + 1e-6).passed
    assert told(0.0, 0.01).passed and told(0.0, 0.01).value == 0.01
    _, notched = evidence_without(notch)
    own = unseen_ends(notched)
    assert asked(notched, ends([0.01], own.places, len(own.places) * [0])).value == own.share
    assert asked(evidence, ends([], np.zeros((0, 3)), [])).passed
    # each end by itself, with the square of the length that is left of it
    left = np.concatenate([on, on[:3] + h * normal[:3]])
    assert asked(evidence, ends([0.01, 0.3], left, 9 * [0] + 3 * [1])).value == 0.01
    assert asked(evidence, ends([0.01, 0.3], left, 6 * [0] + 6 * [1])).value == pytest.approx(0.01 + 0.3 / 4)


def test_points_at_the_border_of_a_gap_count_as_dense_as_their_neighbours_where_sight_lines_are_known():
    places = np.concatenate([np.random.default_rng(0).random((4000, 2)), np.zeros((4000, 1))], axis=1)
    border = np.flatnonzero(places[:, 0] < 0.004)
    inner = np.flatnonzero((np.abs(places[:, :2] - 0.5) < 0.4).all(axis=1))
    rows = np.append(border, inner)
    known, blind = (_spacing(SimpleNamespace(smoothed=places, sensors=sensors), rows) for sensors in (places, None))
    dense = blind[inner].mean()
    assert np.isinf(np.delete(known, rows)).all() and np.isinf(np.delete(blind, rows)).all()
    assert known[inner].mean() == pytest.approx(dense, rel=0.08)
    assert blind[border].mean() > 1.4 * dense and known[border].mean() < 1.35 * dense


@pytest.mark.parametrize("turn", [np.eye(3), rotation(5)])
def test_how_far_a_face_leads_across_its_wall(turn):
    corners = np.array([[[0, 0, 0], [3, 1, T], [0, 5, T]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float) @ turn.T
    normal = np.tile([0.0, 0.0, 1.0], (2, 3, 1)) @ turn.T
    assert _span(corners, normal) == pytest.approx([T, 0.0], abs=1e-12)


def test_skins_nearer_than_a_spacing_are_no_wall():
    nan, areas = np.nan, np.array([1.0, 1.0, 3.0])
    thick = lambda *known: np.column_stack([np.tile(known, (3, 1)), [0.1, 0.2, 5.0]])  # noqa: E731
    assert _across_m(thick(2.0, 2.0, nan), areas, 1.0) == 2.0
    assert _across_m(thick(1.0, 1.0, 1.0), areas, 1.0) == 1.0  # on the threshold: a wall
    assert _across_m(thick(0.99, 0.99, nan), areas, 1.0) == 5.0  # three fifths of the area lead so far across
    assert _across_m(thick(nan, nan, nan), areas, 1.0) == 5.0
    assert _across_m(thick(nan, nan, nan), areas[[2, 1, 0]], 1.0) == 1.0  # most of it leads nowhere: at least a spacing


def test_points_put_opposite_prove_no_end_of_a_wall(monkeypatch):
    room = importlib.import_module("scan2fea.reconstruction.visibility")
    asked = {}

    def again(cloud, options, sensors, spacing_m, ends):
        asked[len(cloud)] = ends

    ends = (Ends(shares=np.array([0.3]), places=np.zeros((1, 3)), of=np.array([0])),)
    first = SimpleNamespace(checks=(SimpleNamespace(passed=False),), ends=ends)
    cloud = PointCloud.of(np.random.default_rng(0).random((30, 3)))
    more = lambda k: lambda cloud, evidence: PointCloud.of(np.concatenate([cloud.points, cloud.points[:k]]))  # noqa: E731
    monkeypatch.setattr(room, "_seen", again)
    monkeypatch.setattr(room, "UNSEEN_PLACES", dict(zip(room.UNSEEN_PLACES, (more(1), more(2)), strict=True)))
    assert room._with_unseen(cloud, room.VisibilityOptions(), cloud.points, 0.1, first, None) is first
    assert asked == {31: (), 32: ends}  # rims round an axis are put where sight lines prove them
