"""The schema accepts what the pipeline promises and refuses each mistake it was made to catch."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import jsonschema
import pytest

from report.fake_report import fake_report
from scan2fea.errors import FormatError, InputError
from scan2fea.report.schema import parse_report, read_report, report_schema

VALIDATOR = jsonschema.Draft202012Validator(report_schema())
Spoil = Callable[[dict[str, Any]], object]


def test_schema_is_itself_valid():
    assert list(jsonschema.Draft202012Validator(jsonschema.Draft202012Validator.META_SCHEMA).iter_errors(report_schema())) == []


def test_good_report_is_accepted():
    assert list(VALIDATOR.iter_errors(fake_report())) == []


def test_more_keys_are_allowed():
    report = fake_report()
    report["note"] = "x"
    report["objects"][0]["surface"]["genus"] = 0
    assert list(VALIDATOR.iter_errors(report)) == []


def test_empty_run_is_accepted():
    report = fake_report()
    report.update(objects=[], stages=[], registration=None)
    assert list(VALIDATOR.iter_errors(report)) == []


@pytest.mark.parametrize(
    "spoil",
    [
        lambda r: r.pop("seed"),
        lambda r: r.update(seed="7"),
        lambda r: r.update(schema=2),
        lambda r: r["frame"].update(shift_m=[0, 0]),
        lambda r: r["inputs"][0].update(unit_source="guessed"),
        lambda r: r["inputs"][0].update(sha256="abc"),
        lambda r: r["inputs"][1].update(reason=None),
        lambda r: r["stages"][0].update(seconds=None),
        lambda r: r["stages"][0].update(n_in=1.5),
        lambda r: r["objects"][0].update(verdict="maybe"),
        lambda r: r["objects"][0].update(route="guess"),
        lambda r: r["objects"][0].pop("surface"),
        lambda r: r["objects"][0].update(volume=None),
        lambda r: r["objects"][0].pop("cad"),
        lambda r: r["objects"][0].pop("fea"),
        lambda r: r["objects"][0].update(deviation=None),
        lambda r: r["objects"][0]["deviation"].update(p95_m=None),
        lambda r: r["objects"][0]["deviation"].update(p95_m=float("inf")),
        lambda r: r["objects"][0]["surface"].update(closed=False),
        lambda r: r["objects"][0]["surface"].update(n_self_intersections=1),
        lambda r: r["objects"][0]["surface"].update(volume_m3=0),
        lambda r: r["objects"][0]["surface"].pop("area_m2"),
        lambda r: r["objects"][0]["volume"]["quality"].pop("Q5"),
        lambda r: r["objects"][0]["volume"]["quality"]["Q1"].pop("p01"),
        lambda r: r["objects"][0]["checks"][0].update(passed=False),
        lambda r: r["objects"][0]["checks"][0].update(passed=None),
        lambda r: r["objects"][0].update(checks=[]),
        lambda r: r["objects"][0]["fea"]["cases"][0].update(value=None),
        lambda r: r["objects"][0]["fea"].update(cases=[]),
        lambda r: r["objects"][0].update(route="estimation"),  # without a member
        lambda r: r["objects"][0].update(files=["../x"]),
        lambda r: r["objects"][1].update(reason=""),
        lambda r: r["objects"][1].update(reason=None),
        lambda r: r["objects"][1]["checks"][0].pop("unit"),
    ],
)
def test_each_mistake_is_refused(spoil: Spoil):
    report = fake_report()
    spoil(report)
    assert not VALIDATOR.is_valid(report)


@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity"])
def test_numbers_that_json_does_not_have_are_refused(word: str):
    with pytest.raises(FormatError, match="write null"):
        parse_report(f'{{"seed": {word}}}')


def test_damaged_and_missing_reports_are_told(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_report(tmp_path)
    (tmp_path / "report.json").write_text('{"a": ', encoding="utf-8")
    with pytest.raises(FormatError, match="is not JSON"):
        read_report(tmp_path)
    (tmp_path / "report.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="cannot be read"):
        read_report(tmp_path)
    with pytest.raises(FormatError, match="list"):
        parse_report("[]")
    (tmp_path / "report.json").write_text(json.dumps(fake_report()), encoding="utf-8")
    assert read_report(tmp_path) == fake_report()
