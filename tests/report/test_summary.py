"""The lines of the console."""

from __future__ import annotations

import copy

from report.fake_report import HOSTILE, fake_report
from scan2fea.report.summary import summary_lines


def test_one_line_per_object_and_the_sentence():
    report = fake_report()
    before = copy.deepcopy(report)
    assert summary_lines(report) == (
        "01 L-beam?: converted: 34 812 points, 0.4788 L, 304.8 \u00d7 127 \u00d7 127 mm, 3.758 kg, f1 412.5 Hz",
        "02 plate: failed: seen from one side only: 52 % of the skin would be invented (limit 30 %)",
        "03 sheet: failed: thinner than the scanner can tell: 1.1 mm at a noise of 0.5 mm",
        "1 of 3 objects converted; 2 failed: 1 seen from one side only, 1 thinner than the scanner can tell. 1 of 2 inputs could not be used.",
    )
    assert report == before


def test_no_object_and_sparse_records():
    assert len(summary_lines({})) == 1
    assert summary_lines({"objects": [{"id": 1, "verdict": "failed"}]})[0] == "01 object: failed: no reason given"
    assert summary_lines({"objects": [{"id": 1, "verdict": "converted", "n_points": 5}]})[0] == "01 object: converted: 5 points, \u2013"


def test_control_characters_do_not_reach_the_terminal():
    lines = summary_lines({"objects": [{"id": 1, "verdict": "failed", "reason": f"a\x1b[31m\n{HOSTILE}\u202eb"}]})
    assert all(line.isprintable() for line in lines)
