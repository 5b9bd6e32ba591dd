"""Charts are well-formed, say what they show in words, and do not hide what lies beyond them."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from scan2fea.report.charts import Limit, bars, colour_bar, histogram, nice_step, swatches, ticks
from scan2fea.report.colours import diverging


@pytest.mark.parametrize(
    ("span", "n", "step"), [(1.0, 5, 0.2), (10, 5, 2), (0.3, 1, 0.5), (5, 1, 5), (5.0001, 1, 10), (0, 5, 1), (math.inf, 5, 1), (1e-12, 1, 1e-12)]
)
def test_nice_step(span, n, step):
    assert nice_step(span, n) == pytest.approx(step)


def test_ticks_are_round_and_within():
    assert ticks(-2.07, 2.07) == pytest.approx([-2, -1, 0, 1, 2])
    assert ticks(0.0, 1.0) == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1.0])


def heights(chart):
    return [float(rect.attrib["height"]) for rect in ET.fromstring(chart).iter("rect")]


def test_histogram_counts():
    values = np.array([0.05] * 3 + [0.95] * 6 + [5.0] * 6)
    chart = histogram(
        values, low=0, high=1, axis="x, mm", title="T", n_bins=10, limits=(Limit(at=0.5, label="limit"), Limit(at=3.0, label="outside"))
    )
    low, high = heights(chart)
    assert high / low == pytest.approx(4)  # 12 against 3: what lies beyond is counted in the last bar
    assert "40 % beyond the axis" in chart and ">limit<" in chart and "outside" not in chart
    assert "x, mm" in chart and "15 values, median 0.95" in chart


def test_histogram_without_values_is_left_out():
    assert histogram(np.array([np.nan]), low=0, high=1, axis="", title="") == ""
    assert histogram(np.zeros(0), low=0, high=1, axis="", title="") == ""
    assert histogram(np.zeros(3), low=0, high=0, axis="", title="") == ""


def test_histogram_takes_the_colours_of_the_map():
    chart = histogram(np.array([-0.9, 0.9]), low=-1, high=1, axis="", title="", n_bins=2, palette=lambda share: diverging(2 * share - 1))
    fills = [rect.attrib["fill"] for rect in ET.fromstring(chart).iter("rect")]
    assert int(fills[0][5:], 16) > int(fills[0][1:3], 16) and int(fills[1][1:3], 16) > int(fills[1][5:], 16)


def test_bars_and_hostile_labels():
    chart = bars([("<b>", 1.0, "1 mm"), ("long " * 20, 2.0, "2 mm")], title="<T>")
    assert ET.fromstring(chart).tag == "figure" and "&lt;b&gt;" in chart and chart.count("<b>") == 1
    one, two = (float(rect.attrib["width"]) for rect in ET.fromstring(chart).iter("rect"))
    assert two / one == pytest.approx(2)
    assert bars([], title="x") == "" and bars([("a", 0.0, "0")], title="x") == ""


def test_legends_speak():
    assert "0 mm" in colour_bar("red", "0 mm", "", "1 mm", "Displacement")
    made = swatches([("#fff", "measured <", False), ("#000", "invented", True)])
    assert "measured &lt;" in made and made.count("hatched") == 1
