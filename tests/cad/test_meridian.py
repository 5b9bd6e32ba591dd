"""Pieces of a meridian: which are found, made simpler, made one, and the rims between them."""

import numpy as np
import pytest

from scan2fea.cad.meridian import LEAST_POINTS, Piece, _between, _longest, _refitted, _united

SIGMA = 1e-4


def along(a, b, n):
    return np.asarray(a, float) + np.linspace(0, 1, n)[:, None] * (np.asarray(b, float) - np.asarray(a, float))


def scattered(samples, k, seed=0):
    """k points about each sample, and the sample each belongs to."""
    rng = np.random.default_rng(seed)
    owner = np.repeat(np.arange(len(samples)), k)
    return samples[owner] + SIGMA * rng.standard_normal((len(owner), 2)), owner


def test_a_piece_that_is_worst_where_it_begins_is_found_all_the_same():
    z = np.linspace(-0.03, 0, 200)
    head = np.column_stack([z, 0.06 * np.sqrt(1 - (z / 0.03) ** 2)])
    head[:4, 0] += np.array([8e-4, -8e-4, 8e-4, -8e-4])  # by the axis: few points
    short = _longest(head[:16], 0, "conic", 3e-4, 16)
    found = _longest(head, 0, "conic", 3e-4, 16)
    assert short is None
    assert (found.first, found.last) == (0, 199)


def test_a_cylinder_that_was_taken_for_a_conic_is_a_line():
    samples = along((0, 0.06), (0.12, 0.06), 121)
    points, owner = scattered(samples, 6)
    piece = Piece(kind="conic", values=np.array([0.0036, 1e-6, -1e-4]), first=0, last=120)
    found = _refitted(piece, samples, points, owner, 5e-4)
    assert found.kind == "line"
    assert np.abs(found.values) == pytest.approx([0, 1, 0.06], abs=3e-5)


def test_an_ellipse_stays_a_conic():
    z = np.linspace(-0.02, 0, 100)
    samples = np.column_stack([z, 0.06 * np.sqrt(1 - (z / 0.03) ** 2)])
    points, owner = scattered(samples, 6)
    assert _refitted(Piece(kind="conic", values=np.array([0.0036, 0.0, -4.0]), first=0, last=99), samples, points, owner, 5e-4).kind == "conic"


def test_a_bottom_of_which_a_strip_was_measured_is_not_what_fits_the_strip():
    angle = np.linspace(0, np.pi / 2, 200)
    samples = np.column_stack([0.03 * np.sin(angle), 0.06 * np.cos(angle)])
    points, owner = scattered(samples, 6)
    strip = (owner >= 20) & (owner < 30)
    piece = Piece(kind="conic", values=np.array([0.0036, 0.0, -4.0]), first=0, last=199)
    assert _refitted(piece, samples, points[strip], owner[strip], 5e-4) is piece
    assert _refitted(piece, samples, points[strip], owner[strip], 1.0).kind == "line"


@pytest.mark.parametrize(("bend", "gap", "n"), [(0.0, 0, 1), (0.05, 0, 2), (0.0, 4, 2)])
def test_pieces_of_one_line_without_a_gap_are_one(bend, gap, n):
    samples = np.concatenate([along((0, 0.06), (0.06, 0.06), 60), along((0.06, 0.06), (0.12, 0.06 + 0.06 * bend), 60)])
    points, owner = scattered(samples, 6)
    line = np.array([0.0, 1.0, 0.06])
    pieces = [_refitted(Piece(kind="line", values=line, first=a, last=b), samples, points, owner, 5e-4) for a, b in ((0, 59 - gap), (60, 119))]
    assert len(_united(pieces, points, owner)) == n


def test_a_piece_with_too_few_points_is_not_joined():
    samples = along((0, 0.06), (0.12, 0.06), 120)
    points, owner = scattered(samples, 6)
    rows = (owner < 60) | (np.arange(len(owner)) % (6 * 60 // (LEAST_POINTS - 1)) == 0)
    line = Piece(kind="line", values=np.array([0.0, 1.0, 0.06]), first=0, last=59)
    assert len(_united([line, Piece(kind="line", values=line.values, first=60, last=119)], points[rows], owner[rows])) == 2


@pytest.mark.parametrize("seed", range(5))
def test_a_rim_that_shows_one_row_of_points_is_square(seed):
    inner, rim, outer = along((0, 0.05), (0.07, 0.05), 71), along((0.07, 0.051), (0.07, 0.059), 9), along((0.07, 0.06), (0, 0.06), 71)
    samples = np.concatenate([inner, rim, outer])
    rng = np.random.default_rng(seed)
    points, owner = scattered(samples, 4, seed)
    keep = (owner < 71) | (owner >= 80)
    row = np.column_stack([np.full(50, 0.07), np.full(50, 0.055)]) + SIGMA * rng.standard_normal((50, 2))
    points, owner = np.concatenate([points[keep], row]), np.concatenate([owner[keep], np.full(50, 75)])
    a, b = Piece(kind="line", values=np.array([0, 1, 0.05]), first=0, last=70), Piece(kind="line", values=np.array([0, 1, 0.06]), first=80, last=150)
    found = _between(a, b, samples, points, owner, False)
    assert found.values[1] == 0
    assert found.values[2] == pytest.approx(0.07, abs=5e-5)
