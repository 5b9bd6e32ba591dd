"""Heads of vessels: where they begin, what nobody saw of them, and the solid that comes of it."""

import numpy as np
import pytest

from predicates import rotation
from scan2fea.cad import true_solid
from scan2fea.cad.heads import Head, _descended, _level, smoothed
from scan2fea.cad.meridian import Piece, _led_on, _turned_areas
from scan2fea.simulation.polyhedra import revolved
from scan2fea.types import TriangleMesh

R, WALL, LONG, SIGMA = 0.06, 0.006, 0.1, 1e-4
INNER = R - WALL


def head(radius, depth, n, start=0.0, end=1.0):
    """z and r of an ellipse from its widest place (z = 0) to its pole."""
    angle = np.linspace(start, end, n) * np.pi / 2
    return np.column_stack([depth * np.sin(angle), radius * np.cos(angle)])


def conic(radius, depth, z0=0.0, **more):
    c = -((radius / depth) ** 2)
    return Piece(kind="conic", values=np.array([radius**2 + c * z0**2, -2 * c * z0, c]), **more)


def test_an_exact_head_is_found_from_a_wrong_start():
    z0, c, std, c_std = _descended(head(R, 0.03, 50), R, 0.004, -3.0, (True, True))
    assert z0 == pytest.approx(0, abs=1e-10)
    assert c == pytest.approx(-4, rel=1e-8)
    assert std < 1e-9
    assert c_std < 1e-6


def test_the_deviation_of_a_heads_place_is_that_of_many_draws():
    found = []
    for seed in range(200):
        used = head(R, 0.03, 60, 0, 0.6) + SIGMA * np.random.default_rng(seed).standard_normal((60, 2))
        found.append(_descended(used, R, 0.0, -4.0, (True, True)))
    z0, c, std, c_std = np.array(found).T
    assert np.mean(std) == pytest.approx(np.std(z0), rel=0.15)
    assert np.mean(c_std) == pytest.approx(np.std(c), rel=0.15)


def a_head(z0, std, side=1, piece=0, radius=R):
    return Head(piece=piece, radius=radius, used=head(radius, radius / 2, 30) * [side, 1] + [z0, 0], z0=z0, std=std, c=-4.0, c_std=0.0)


@pytest.mark.parametrize(("off", "side", "one"), [(2.5, 1, True), (2.65, 1, False), (0.0, -1, False)])
def test_heads_begin_at_one_height_where_nothing_refuses_it(off, side, one):
    """2.576 standard deviations of the difference."""
    std = 1e-4
    found = _level([a_head(0.0, std), a_head(off * np.hypot(std, std), std, side, 1, INNER)])
    assert (found[0].z0 == found[1].z0) == (one or side < 0)
    if one:
        assert found[0].z0 == pytest.approx(off * np.hypot(std, std) / 2)
    elif side < 0:
        assert (found[0].c, found[1].c) == (-4.0, -4.0)


def test_a_head_keeps_the_radius_of_its_shell():
    samples = np.concatenate([head(R, 0.03, 60)[::-1], np.column_stack([np.linspace(0, -LONG, 60), np.full(60, R)])])
    owner = np.repeat(np.arange(120), 6)
    points = samples[owner] + SIGMA * np.random.default_rng(0).standard_normal((720, 2))
    pieces = [conic(R * 1.001, 0.0301, first=0, last=59), Piece(kind="line", values=np.array([1e-4, 1, R]), first=60, last=119)]
    found = smoothed(pieces, samples, points, owner, 1e-3, 1e-3)
    k0, k1, k2 = found[0].values
    assert np.sqrt(k0 - k1**2 / (4 * k2)) == pytest.approx(R, rel=1e-12)
    assert k2 == pytest.approx(-4, rel=5e-3)
    assert found[1].values.tolist() == [0, 1, R]


@pytest.mark.parametrize(("points_a_sample", "shift", "last"), [(0, 2e-4, 99), (6, 2e-4, 49), (0, 2e-3, 49)])
def test_what_nobody_measured_is_its_neighbour_led_on_within_reach(points_a_sample, shift, last):
    samples = head(R, 0.03, 100)
    samples[50:, 0] += shift
    owner = np.concatenate([np.repeat(np.arange(50), 6), np.repeat(np.arange(50, 100), points_a_sample)])
    pieces = [conic(R, 0.03, first=0, last=49), conic(R, 0.03, shift, first=50, last=99)]
    found = _led_on(pieces, samples, owner, 1e-3)
    assert found[0].last == last
    assert len(found) == (1 if last == 99 else 2)
    assert found[0].values.tolist() == pieces[0].values.tolist()


def test_a_measured_piece_takes_what_nobody_measured_on_both_sides():
    samples = np.column_stack([np.linspace(0, 0.1, 90), np.full(90, R)])
    pieces = [Piece(kind="line", values=np.array([0, 1, R + d]), first=a, last=a + 29) for a, d in ((0, 1e-4), (30, 0), (60, 1e-4))]
    found = _led_on(pieces, samples, np.repeat(np.arange(30, 60), 6), 1e-3)
    assert [(p.first, p.last, p.values[2]) for p in found] == [(0, 89, R)]


def test_an_unmeasured_piece_at_an_angle_stays():
    samples = np.concatenate(
        [np.column_stack([np.linspace(0, 0.05, 50), np.full(50, R)]), np.column_stack([np.full(50, 0.05), np.linspace(R, 0, 50)])]
    )
    pieces = [Piece(kind="line", values=np.array([0, 1, R]), first=0, last=49), Piece(kind="line", values=np.array([1, 0, 0.05]), first=50, last=99)]
    assert len(_led_on(pieces, samples, np.repeat(np.arange(50), 6), 1.0)) == 2


def test_areas_of_a_meridian_are_those_of_the_body():
    ball = head(R, R, 400)
    assert _turned_areas(ball).sum() == pytest.approx(2 * np.pi * R**2, rel=1e-4)


def turned_places(meridian, n, rng):
    """n places on a meridian, as many as its surface is wide there."""
    areas = _turned_areas(meridian)
    return meridian[rng.choice(len(meridian), n, p=areas / areas.sum())]


def tank(seen, seed):
    """An open shell on an ellipsoidal bottom whose inside is guessed as a wall of even thickness; the points seen, and the true volume."""
    rng = np.random.default_rng([seed, 7])
    outer = head(R, R / 2, 25)[::-1] * [-1, 1]
    normal = outer / [(R / 2) ** 2, R**2]
    guess = outer - WALL * normal / np.linalg.norm(normal, axis=1)[:, None]
    along = np.linspace(0, LONG, 25)[1:]
    shell, inner_shell = np.column_stack([along, np.full(24, R)]), np.column_stack([along, np.full(24, INNER)])[::-1]
    profile = np.concatenate([outer, shell, [[LONG, R - WALL / 2]], inner_shell, guess[::-1]])
    profile[[0, -1], 1] = 0.0
    mesh = revolved(profile[:, ::-1], 90)
    zr = np.concatenate([
        turned_places(head(R, R / 2, 2000) * [-1, 1], 5000, rng), np.column_stack([rng.random(9000) * LONG, np.full(9000, R)]),
        np.column_stack([rng.random(8000) * LONG, np.full(8000, INNER)]), np.column_stack([np.full(700, LONG), rng.uniform(INNER, R, 700)]),
        turned_places(head(INNER, R / 2 - WALL, 2000, 0, seen) * [-1, 1], round(5000 * seen), rng),
    ])  # fmt: skip
    zr += SIGMA * rng.standard_normal(zr.shape)
    angle = rng.uniform(0, 2 * np.pi, len(zr))
    points = np.column_stack([zr[:, 1] * np.cos(angle), zr[:, 1] * np.sin(angle), zr[:, 0]])
    held = np.pi * LONG * (R**2 - INNER**2) + 2 / 3 * np.pi * (R**2 * R / 2 - INNER**2 * (R / 2 - WALL))
    turn = rotation(seed + 1)
    return TriangleMesh(vertices=mesh.vertices @ turn.T, faces=mesh.faces), points @ turn.T, held


@pytest.mark.parametrize("seed", range(3))
def test_a_tank_whose_bottom_nobody_saw_within_is_the_bottom_that_its_border_shows(seed):
    """The guess, a wall of even thickness, holds 1 % more; and its meridian, two conics that pass into each other, closed no solid."""
    mesh, points, held = tank(0.3, seed)
    found = true_solid(mesh, points, spacing_m=2e-3, noise_m=SIGMA)
    assert found.reason == ""
    assert len(found.brep.face_names) == 5
    assert found.brep.volume_m3 == pytest.approx(held, rel=3e-3)
