"""Numbers of the page and the sentences made from verdicts."""

from __future__ import annotations

import math

import pytest

from report.fake_report import CONVERTED, check, fake_report
from scan2fea.report.words import (
    cause,
    check_name,
    count,
    dimensions,
    failed_first,
    first_frequency_hz,
    headline,
    mass_kg,
    measure_name,
    measured_share,
    number,
    number_of,
    percent,
    quantity,
    unobserved,
    used_share,
    volume,
    with_deviation,
    worst_check,
)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0, "0"),
        (-0.0, "0"),
        (1, "1"),
        (3.14159, "3.142"),
        (-3.14159, "\u22123.142"),
        (12345.6, "12\u202f350"),
        (999.96, "1\u202f000"),
        (9.9996, "10"),
        (0.0005, "0.0005"),
        (1e-5, "1\u00b710\u207b\u2075"),
        (2.1e11, "2.1\u00b710\u00b9\u00b9"),
        (9999999.0, "1\u00b710\u2077"),  # rounds up over the threshold
        (9999000.0, "9\u202f999\u202f000"),
        (math.nan, "\u2013"),
        (math.inf, "\u2013"),
        (None, "\u2013"),
    ],
)
def test_number(value, shown):
    assert number(value) == shown


def test_number_never_shows_more_than_four_digits():
    for k in range(-200, 200):
        digits = [c for c in number(1.23456789 * 10.0**k).split("\u00b7")[0] if c.isdigit()]
        assert len("".join(digits).strip("0")) <= 4


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [
        (127.2341, 0.42, "127.2 \u00b1 0.4"),
        (127.2341, 0.12, "127.23 \u00b1 0.12"),
        (3048.1, 12.3, "3\u202f048 \u00b1 12"),
        (3048.1, 42, "3\u202f050 \u00b1 40"),
        (-3.2, 0.05, "\u22123.20 \u00b1 0.05"),
        (5.0, None, "5"),
        (5.0, 0.0, "5"),
        (5.0, math.nan, "5"),
        (0.5, 1e-12, "0.5 \u00b1 1\u00b710\u207b\u00b9\u00b2"),
    ],
)
def test_digits_follow_the_standard_deviation(value, std, shown):
    assert with_deviation(value, std) == shown


def test_units_of_the_page():
    assert quantity(0.00104, "m") == "1.04 mm"
    assert quantity(2.35e8, "Pa") == "235 MPa"
    assert quantity(12.41, "deg") == "12.41\u00b0"
    assert quantity(0.05, "share") == "5 %"
    assert quantity(True) == "yes"
    assert quantity(None, "m") == "\u2013"
    assert quantity("open", "m") == "open"
    assert quantity(1234567, "edges") == "1\u202f234\u202f567 edges"
    assert quantity(0, "pairs") == "0 pairs"
    assert count(34812) == "34\u202f812"
    assert dimensions([0.3, 0.02, 0.001]) == "300 \u00d7 20 \u00d7 1 mm"
    assert [volume(v) for v in (1.0, 0.99, 1e-4, 9.9e-5, 1e-8, 9e-9, None)] == [
        "1 m\u00b3", "990 L", "0.1 L", "99 cm\u00b3", "0.01 cm\u00b3", "9 mm\u00b3", "\u2013",
    ]  # fmt: skip


def test_what_is_not_all_never_reads_100():
    assert percent(1.0) == "100 %"
    assert percent(0.99999) == "> 99.9 %"
    assert percent(0.0) == "0 %"
    assert percent(1e-7) == "< 0.01 %"
    assert percent(None) == "\u2013"


def test_headline_counts_and_groups():
    report = fake_report()
    text = headline(report)
    assert text == (
        "1 of 3 objects converted; 2 failed: 1 seen from one side only, 1 thinner than the scanner can tell. 1 of 2 inputs could not be used."
    )
    report["inputs"] = report["inputs"][:1]
    one, two, three = report["objects"]
    three["reason"] = two["reason"]
    assert headline(report) == "1 of 3 objects converted; 2 failed: 2 seen from one side only."
    report["objects"] = [two]
    assert headline(report) == "The one object could not be converted: seen from one side only."
    report["objects"] = [two, three]
    assert headline(report) == "None of 2 objects could be converted: 2 seen from one side only."
    report["objects"] = [one]
    assert headline(report) == "The one object was converted."
    report["objects"] = [one, one]
    assert headline(report) == "All 2 objects were converted."
    report["objects"] = []
    assert headline(report) == "No object was found in the scan, so nothing was converted."
    assert headline({}) == headline({"objects": []})


def test_a_dimension_from_the_catalogue_is_said_in_the_first_line():
    report = fake_report()
    item = report["objects"][0]
    item["member"] = {"family": "L", "parameters": {"t": {"value_m": 0.00635, "std_m": None, "observable": False}}, "catalogue": []}
    report["objects"] = [item]
    assert "from a catalogue" in headline(report)
    assert unobserved(item) == ("t",)


def test_known_checks_have_short_causes_and_others_speak_for_themselves():
    assert cause({"checks": [check("unmeasured area", 0.3, 0.1, "1", False)], "reason": "30 % of ..."}) == "not seen from all sides"
    assert cause({"checks": [check("my.own_check", 3, 1, "", False)], "reason": "3 of 7 are wrong"}) == "check \u201cmy: own check\u201d not passed"
    assert cause({"reason": "took too long: 600 s"}) == "took too long"
    assert cause({"reason": None}) == "no reason given"
    assert len(cause({"reason": "word " * 100})) <= 66
    assert check_name("shape.measured_area") == "shape: measured area"
    assert (measure_name("displacement_max_m"), measure_name("f7_hz"), measure_name("mean")) == ("displacement max", "f7", "mean")


def test_worst_check():
    near = check("near", 4.9, 5.0, "", True)
    lower = check("lower", 12.0, 5.0, "", True)  # a lower limit: 5/12 used
    equal = check("equal", 6, 6, "", True)  # has to be equal: nothing is used up
    failed = check("failed", 1.0, 5.0, "", False)
    assert worst_check([lower, near, equal]) == near
    assert worst_check([near, failed]) == failed
    assert worst_check([equal]) == equal
    assert worst_check([]) is None
    assert worst_check([near, dict(near, name="same")]) == near  # the first of equals
    assert used_share(check("text", "a", "b", "", True)) is None
    sure, share = check("member.family", 1.0, 0.95, "probability", True), check("shape.measured", 0.96, 0.95, "share", True)
    assert worst_check([sure, check("low", 1.0, 5.0, "", True)])["name"] == "low"  # nothing of it is used up
    assert worst_check([sure, near, share]) == near and used_share(share) == pytest.approx(0.8)
    assert quantity(1.0, "probability") == "100 %"
    assert failed_first([near, failed, equal]) == [failed, near, equal]


def test_mass_and_frequency_from_what_is_recorded():
    item = {**CONVERTED, "fea": {**CONVERTED["fea"]}}
    assert mass_kg(item) == 3.7583
    item["fea"].pop("mass_kg")
    assert mass_kg(item) == pytest.approx(7850 * 0.00047875)
    item["fea"]["cases"] = [{"name": "self weight", "measure": "mass", "value": 2.0}]
    assert mass_kg(item) == 2.0
    assert first_frequency_hz(item) == 412.5
    item["fea"].pop("frequencies_hz")
    assert first_frequency_hz(item) is None
    item["fea"]["cases"] = CONVERTED["fea"]["cases"]
    assert first_frequency_hz(item) == 412.5
    assert mass_kg({}) is None and first_frequency_hz({"fea": None}) is None
    assert measured_share(item) == 0.846
    assert measured_share({"deviation": {"measured_area_fraction": 0.5}}) == 0.5
    assert (number_of({"id": 3}), number_of({"id": "a"})) == ("03", "a")
