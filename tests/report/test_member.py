"""The section about a fitted member: error bars to one scale, faces in their colours, hostile and broken records."""

import re

import pytest

from report.fake_report import HOSTILE
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.report.member import SEEN, UNSEEN, member_section, section_drawing
from scan2fea.report.schema import report_schema
from scan2fea.report.words import with_deviation

SIZES = {
    "L": {"a": 0.127, "b": 0.1, "t": 0.00635},
    "I": {"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085},
    "C": {"h": 0.2, "b": 0.075, "tw": 0.0085, "tf": 0.0115},
    "T": {"h": 0.1, "b": 0.12, "tw": 0.01, "tf": 0.011},
    "RHS": {"h": 0.1, "b": 0.06, "t": 0.005},
    "CHS": {"d": 0.1143, "t": 0.006},
    "rect": {"b": 0.1, "t": 0.01},
    "round": {"d": 0.05},
}


def member(family="L", **more):
    values = {**SIZES[family], "length": 3.0}
    row = {
        "family": family,
        "parameters": {n: {"value_m": v, "std_m": 1e-4, "observable": True, "source": "fitted"} for n, v in values.items()},
        "catalogue": [{"name": "one", "probability": 0.7}, {"name": "two", "probability": 0.3}],
        "residual": {"sigma_m": 0.002, "noise": "gaussian", "outlier_share": 0.05},
        "damage": [],
    }
    return {**row, **more}


def page(row):
    return str(member_section({"member": row}))


@pytest.mark.parametrize("family", PARAMETERS)
def test_every_family_is_drawn_to_scale(family):
    drawing = str(section_drawing(member(family)))
    numbers = [float(x) for x in re.findall(r"[-\d.]+", re.search(r'<path d="([^"]+)"', drawing)[1])]
    x, y = numbers[0::2], numbers[1::2]
    sizes = [v for n, v in SIZES[family].items() if n not in ("t", "tw", "tf")] + ([SIZES[family]["t"]] if family == "rect" else [])
    ratio = (max(x) - min(x)) / (max(y) - min(y))
    expected = {"L": 1.27, "I": 0.5, "C": 0.375, "T": 1.2, "RHS": 0.6, "rect": 10.0}.get(family, 1.0)
    assert ratio == pytest.approx(expected, rel=0.01)
    assert all(f"= {with_deviation(1e3 * size, 0.1)} mm" in drawing for size in sizes)


def test_fillets_toes_and_slopes_are_drawn_and_told():
    """A record whose corners do not fit is drawn sharp."""
    root = {"radius_m": 0.0085, "std_m": 1e-4, "toe_m": 0.0045, "toe_std_m": 2e-3, "toe_source": "assumed", "slope": 0.08, "slope_std": 0.002}
    sharp, round_ = (str(section_drawing(member("C", root=of))) for of in (None, root))
    assert round_.count("<line") > sharp.count("<line") + 10
    assert str(section_drawing(member("C", root={**root, "radius_m": 1.0}))) == sharp
    told = page(member("C", root=root))
    assert "assumed: the standards" in told and "Slope of its flanges" in told and "8.0" in told
    assert "Slope of its flanges" not in page(member("C", root={**root, "slope": 0}))


def test_every_wall_is_written_and_one_that_is_not_told_says_so():
    row = member("I")
    row["parameters"]["tw"].update(observable=False, source="catalogue", std_m=None)
    drawing = str(section_drawing(row))
    assert "tw = 5.6 mm (not observable)" in drawing and f"tf = {with_deviation(8.5, 0.1)} mm" in drawing


def test_faces_have_the_colour_of_what_was_seen():
    seen = {"A_OUTER": 1.0, "A_TOE": 0.8, "A_INNER": 0.5, "B_INNER": 0.1, "B_TOE": 0.05, "B_OUTER": 0.0}
    drawing = str(section_drawing(member(seen=seen)))
    assert drawing.count(f'stroke="{SEEN}"') == 4 and drawing.count(f'stroke="{UNSEEN}"') == 2  # a tenth counts as seen
    assert "4 of 6 faces were seen; not seen: b toe, b outer." in drawing
    assert "not recorded" in str(section_drawing(member()))


def test_error_bars_are_to_one_scale_and_missing_ones_are_dashed():
    row = member()
    row["parameters"]["length"]["std_m"] = 2e-4
    row["parameters"]["t"].update(observable=False, std_m=None, source="catalogue")
    told = page(row)
    halves = [float(b) - float(a) for a, b in re.findall(r'<line x1="([\d.]+)" x2="([\d.]+)" y1="7" y2="7" stroke="#22262b"', told)]
    assert len(halves) == 3
    assert halves[2] == pytest.approx(2 * halves[0], abs=0.3)
    assert "not observable: from the catalogue" in told and 'class="prior"' in told and "no standard deviation" in told
    assert "the longest 0.2 mm" in told


def test_damage_and_catalogue():
    place = {"kind": "dent", "position_m": [1.0, 2.0, 3.0], "size_m": 0.1, "depth_m": 0.003, "std_m": 0.0004, "p_value": 1e-6}
    told = page(member(damage=[place] * 10, catalogue=[{"name": f"size {k}", "probability": 0.1} for k in range(10)]))
    assert "3.0 \u00b1 0.4 mm" in told and "dent" in told and "2 more places" in told
    assert "size 7" in told and "size 8" not in told and "2 more hold 20 %" in told
    assert "Damage" not in page(member())


def test_hostile_and_broken_records():
    told = page(member(catalogue=[{"name": HOSTILE, "probability": 0.5}], damage=[{"kind": HOSTILE}], seen={HOSTILE: 1.0}))
    assert "<script" not in told and "&lt;script" in told
    broken = ({"family": "Z"}, {"parameters": None}, {"parameters": {"a": 3}}, {"residual": 0.1}, {"catalogue": "x"}, {"seen": 3}, {"damage": None})
    for part in broken:
        assert isinstance(page({**member(), **part}), str)
    assert member_section({}) == "" and member_section({"member": None}) == ""


def test_record_of_a_member_follows_the_schema():
    jsonschema = pytest.importorskip("jsonschema")
    schema = report_schema()
    validator = jsonschema.Draft202012Validator({"$ref": "#/$defs/member", "$defs": schema["$defs"]})
    place = {"kind": "dent", "position_m": [1.0, 2.0, 3.0], "size_m": 0.1, "depth_m": 0.003, "std_m": 0.0004, "p_value": 1e-6}
    validator.validate(member(damage=[place], seen={"A_OUTER": 1.0}, families={"L": 1.0}, p_fixed=None))
    for wrong in ({"family": "Z"}, {"seen": {"A": 1.5}}, {"damage": [{"kind": "dent"}]}, {"p_fixed": 2.0}):
        assert not validator.is_valid({**member(), **wrong}), wrong
