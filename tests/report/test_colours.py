"""Palettes: ends, middle, monotone lightness, what is not known."""

from __future__ import annotations

import numpy as np

from scan2fea.report.colours import BACKDROP, CATEGORIES, DIVERGING, NO_DATA, ORIGIN_COLOURS, VIRIDIS, categories, css, diverging, gradient, viridis


def lightness(colours):
    return np.asarray(colours, float) @ [0.2126, 0.7152, 0.0722]


def test_viridis_grows_lighter_throughout_so_that_it_reads_in_grey():
    assert (np.diff(lightness(viridis(np.linspace(0, 1, 200)))) > -0.6).all()
    assert viridis(np.array([-5.0, 0.0, 1.0, 7.0])).tolist() == VIRIDIS[[0, 0, -1, -1]].tolist()


def test_diverging_is_white_at_zero_and_has_two_sides():
    assert diverging(np.array([0.0])).tolist() == [[255, 255, 255]]
    low, high = diverging(np.array([-0.5, 0.5]))
    assert low[2] > low[0] and high[0] > high[2]  # blue below, red above
    assert diverging(np.array([-2.0, -1.0, 1.0, 2.0])).tolist() == DIVERGING[[0, 0, -1, -1]].tolist()


def test_not_a_number_is_grey():
    for palette in (viridis, diverging):
        assert palette(np.array([np.nan, np.inf, 0.3]))[:2].tolist() == [NO_DATA.tolist()] * 2
        assert len(palette(np.zeros(0))) == 0


def test_categories():
    colours = categories(np.arange(-1, 3 * len(CATEGORIES)))
    assert colours[0].tolist() == BACKDROP.tolist()
    assert len({tuple(c) for c in colours[1:].tolist()}) == 3 * len(CATEGORIES)


def test_origins_differ_in_lightness_too():
    assert np.abs(np.diff(np.sort(lightness(ORIGIN_COLOURS)))).min() > 20


def test_css():
    assert css([0, 128, 255]) == "#0080ff"
    assert gradient(DIVERGING).startswith("linear-gradient(to right,#053061,") and gradient(DIVERGING).endswith("#67001f)")
