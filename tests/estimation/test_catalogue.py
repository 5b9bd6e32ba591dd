"""The catalogue: probabilities that leave room for sizes outside the table, priors that are named, tables of users."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import made
from scan2fea.errors import EstimationError, InputError, UsageError
from scan2fea.estimation.catalogue import ESTIMATE, OTHER, outer_sizes, posterior, prior_thickness, standard_odds
from scan2fea.estimation.catalogued import catalogued
from scan2fea.estimation.table import Table, parse_table, read_table, shipped_table, shipped_text
from scan2fea.kernel.outline import outline, outline_area
from scan2fea.kernel.section_likelihood import faces
from scan2fea.types import Parameter

TABLE = shipped_table()


def asked(family, values, std, hidden=()):
    covariance = np.diag(np.square(std))
    return posterior(family, values, covariance, {name: name not in hidden for name in values}, TABLE)


def test_shipped_table_is_sound():
    assert len(TABLE.shapes) == 2851
    assert {shape.family for shape in TABLE.shapes} == {"L", "I", "C", "T", "RHS", "CHS", "rect", "round"}
    assert len({shape.name for shape in TABLE.shapes}) == len(TABLE.shapes)
    assert len(parse_table(shipped_text(), "sections.csv").shapes) == len(TABLE.shapes)  # areas are checked here, and not in every run
    he = TABLE.named("he 140a")
    assert he is not None and dict(he.parameters) == pytest.approx({"h": 0.133, "b": 0.14, "tw": 0.0055, "tf": 0.0085})
    assert outline_area(outline("I", he.parameters, he.root_radius_m)) == pytest.approx(3141.6e-6, rel=1e-4)


def test_sizes_that_differ_by_walls_alone_are_pooled():
    """No wall was seen: a dozen angles share what leaves no doubt of the legs."""
    entries = asked("L", {"a": 0.1275, "b": 0.1262, "t": 0.012}, (1e-3, 1e-3, 1.0), hidden=("t",))
    outer, share = outer_sizes(entries)[0]
    assert outer == {"a": 0.127, "b": 0.127} and max(e.probability for e in entries) < 0.2 < 0.9 < share <= 1.0
    assert sum(share for _, share in outer_sizes(entries)) <= 1.0 and outer_sizes(()) == ()


def test_the_beam_of_the_thesis_is_not_snapped():
    """L5x5x1/4 is not in the table; L5X5X5/16 is its nearest."""
    entries = asked("L", {"a": 0.127, "b": 0.127, "t": 0.00635}, (1e-4, 1e-4, 1e-4))
    assert entries[0].name == "L 127 x 127, another thickness" and entries[0].probability > 0.98
    assert entries[0].parameters["t"] == 0.00635
    assert sum(e.probability for e in entries if e.name.startswith("L5X5X")) < 1e-3


@pytest.mark.parametrize("name", ["L5X3-1/2X1/4", "HE 140 A", "W8X31", "TRON 101x10", "UPN 140", "TCAR 100x10", "TEAE 80x9"])
def test_a_size_of_the_table_is_found_within_mill_tolerances(name):
    shape = TABLE.named(name)
    rng = np.random.default_rng(1)
    for _ in range(5):
        values = {k: v * (1 + 0.003 * rng.normal()) for k, v in shape.parameters.items()}
        entries = asked(shape.family, values, [1e-4] * len(values))
        assert shape.name in [e.name for e in entries[:3]]


HE140A_INWARD = {"h": 0.1312, "b": 0.1382, "tw": 0.0037, "tf": 0.0067}  # every face 0.9 mm within the steel


def test_faces_that_lie_off_together_are_told_from_another_size():
    """A scanner whose zero is 0.9 mm off shortens every dimension by 1.8 mm; HE 140 AA is shorter in each by other amounts."""
    known, covariance = dict.fromkeys(HE140A_INWARD, True), np.diag(np.square([2e-4, 2e-3, 2e-4, 2e-4]))
    strict = posterior("I", HE140A_INWARD, covariance, known, TABLE)
    assert "HE 140 A" not in [entry.name for entry in strict[:3]]
    entries = posterior("I", HE140A_INWARD, covariance, known, TABLE, 0.8e-3)
    assert entries[0].name == "HE 140 A" and entries[0].probability > 0.9
    assert sum(entry.probability for entry in entries) == pytest.approx(1.0, abs=1e-3)
    assert posterior("I", HE140A_INWARD, covariance, known, TABLE, 0.0)[0].probability == strict[0].probability
    assert entries[0].offset_m == pytest.approx(-0.9e-3, abs=5e-5) and all(entry.offset_m == 0.0 for entry in strict)


def test_offset_is_the_mean_over_all_offsets():
    """Against a sum over offsets: the odds of two sizes, and the offset told with each."""
    between = {"h": 0.1305, "b": 0.1392, "tw": 0.0044, "tf": 0.0067}
    covariance, offset = np.diag(np.square([5e-4, 2e-3, 6e-4, 6e-4])), 0.8e-3
    entries = posterior("I", between, covariance, dict.fromkeys(between, True), TABLE, offset)
    found = {entry.name: entry.probability for entry in entries}
    density = {}
    for name in ("HE 140 A", "HE 140 AA"):
        size = np.array(list(TABLE.named(name).parameters.values()))
        std = np.array([max(0.004 * size[0], 3e-4), max(0.004 * size[1], 3e-4), max(0.035 * size[2], 2e-4), max(0.035 * size[3], 2e-4)])
        shift = np.linspace(-8, 8, 4001)[:, None]
        off = np.array(list(between.values())) - size - 2 * offset * shift
        v = np.diag(covariance) + std**2
        weight = np.exp(-0.5 * (off**2 / v).sum(axis=1) - 0.5 * shift[:, 0] ** 2) / np.sqrt(v.prod())
        density[name] = float(weight.sum())
        mean = offset * float(weight @ shift[:, 0]) / density[name]
        assert next(entry for entry in entries if entry.name == name).offset_m == pytest.approx(mean, rel=1e-6)
    assert found["HE 140 AA"] / found["HE 140 A"] == pytest.approx(density["HE 140 AA"] / density["HE 140 A"], rel=1e-6)


def test_offset_is_of_no_account_where_a_wall_is_hidden():
    """Outer dimensions that are all a little long are another size as likely as a sensor's zero: what is built for the wall hangs on that."""
    known = {"h": True, "b": True, "tw": False, "tf": True}
    covariance = np.diag(np.square([2e-4] * 4))
    one = posterior("I", HE140A_INWARD, covariance, known, TABLE)
    other = posterior("I", HE140A_INWARD, covariance, known, TABLE, 0.8e-3)
    assert [(e.name, e.probability) for e in one] == [(e.name, e.probability) for e in other]


def test_members_take_their_noise_for_what_faces_may_be_off_together():
    member = made("I", std=2e-4)
    sharp, hazy = (replace(member, sigma_m=sigma) for sigma in (1e-9, 2e-3))
    assert catalogued(sharp, TABLE).catalogue[0].probability > catalogued(hazy, TABLE).catalogue[0].probability


def test_order_of_legs_carries_nothing():
    std = (1e-4, 1e-4, 1e-4)
    one = asked("L", {"a": 0.127, "b": 0.0889, "t": 0.00635}, std)
    other = asked("L", {"a": 0.0889, "b": 0.127, "t": 0.00635}, std)
    assert one[0].name == other[0].name == "L5X3-1/2X1/4"
    assert one[0].probability == pytest.approx(other[0].probability, rel=1e-9)
    assert other[0].parameters["b"] == pytest.approx(0.127)


def test_probabilities_add_up_and_nothing_fits_an_odd_size():
    entries = asked("I", {"h": 0.2777, "b": 0.0555, "tw": 0.019, "tf": 0.004}, (1e-4,) * 4)
    assert entries[0].name == OTHER and entries[0].probability > 0.999
    for hidden in ((), ("tw",), ("tw", "tf")):
        entries = asked("I", {"h": 0.133, "b": 0.14, "tw": 0.0055, "tf": 0.0085}, (1e-3,) * 4, hidden)
        assert sum(e.probability for e in entries) == pytest.approx(1, abs=0.01)  # sizes under a thousandth are not listed


def test_hidden_thickness_leaves_all_siblings_alike():
    entries = asked("L", {"a": 0.127, "b": 0.127, "t": 0.0185}, (1e-3, 1e-3, 1e-4), hidden=("t",))
    siblings = [e.probability for e in entries if e.name.startswith("L5X5X")]
    assert len(siblings) == 7 and max(siblings) == pytest.approx(min(siblings), rel=1e-6)


def test_prior_is_the_middle_sibling_and_moves_the_legs():
    values, hidden = {"a": 0.127, "b": 0.127, "t": 0.02}, {"a": True, "b": True, "t": False}
    still = prior_thickness("L", values, np.diag([1e-6, 1e-6, 0.0]), hidden, TABLE)  # nothing is known of t
    assert still.name == "L5X5X1/2" and still.values["t"] == pytest.approx(0.0127)
    assert still.values["a"] == values["a"] and still.std_m["a"] == pytest.approx(1e-3)
    covariance = np.array([[1e-6, 0, 8e-7], [0, 1e-6, 0], [8e-7, 0, 1e-6]])
    moved = prior_thickness("L", values, covariance, hidden, TABLE)
    assert moved.values["t"] == pytest.approx(0.0191)
    assert moved.values["a"] == pytest.approx(0.127 + 0.8 * (0.0191 - 0.02))  # conditional Gaussian
    assert moved.std_m["a"] == pytest.approx(1e-3 * np.sqrt(1 - 0.64))
    assert moved.values["b"] == values["b"]


@pytest.mark.parametrize(
    ("t", "std", "built", "name"),
    [
        (0.0081, 0.0009, 0.00794, "L5X5X5/16"),  # a size is near
        (0.0100, 0.0009, 0.00953, "L5X5X3/8"),
        (0.0056, 0.0006, 0.0056, ESTIMATE),  # below the thinnest: the thesis's 6.35 mm must not become 7.94 or 12.7
        (0.0350, 0.0020, 0.0350, ESTIMATE),  # beyond the thickest
    ],
)
def test_a_wall_that_is_not_told_is_built_from_the_size_nearest_to_its_estimate_or_from_that(t, std, built, name):
    values, hidden = {"a": 0.127, "b": 0.127, "t": t}, {"a": True, "b": True, "t": False}
    prior = prior_thickness("L", values, np.diag([1e-7, 1e-7, std**2]), hidden, TABLE)
    assert prior.name == name and prior.values["t"] == pytest.approx(built, rel=0.03)
    assert prior.estimated == (frozenset({"t"}) if name == ESTIMATE else frozenset())
    assert prior.std_m["t"] > 0.7 * std


def test_an_estimate_without_worth_leaves_the_middle_of_the_sizes_possible():
    values, hidden = {"a": 0.127, "b": 0.127, "t": 2e-5}, {"a": True, "b": True, "t": False}
    blind = prior_thickness("L", values, np.diag([1e-7, 1e-7, 1.0]), hidden, TABLE)
    assert blind.name.startswith("L5X5X") and not blind.estimated
    assert blind.std_m["t"] > 0.004


def test_only_the_wall_with_an_estimate_is_taken_from_it():
    values, hidden = {"h": 0.2, "b": 0.1, "tw": 0.0030, "tf": 0.01}, {"h": True, "b": True, "tw": False, "tf": False}
    prior = prior_thickness("I", values, np.diag([1e-7, 1e-7, 9e-8, 0.0]), hidden, TABLE)
    assert prior.estimated == frozenset({"tw"}) and prior.values["tw"] == pytest.approx(0.0030, rel=0.05)
    assert prior.name.endswith(ESTIMATE) and 0.004 < prior.values["tf"] < 0.02


def test_prior_of_an_odd_size_is_scaled_and_says_so():
    prior = prior_thickness("CHS", {"d": 5.0, "t": 0.01}, np.diag([1e-8, 0.0]), {"d": True, "t": False}, TABLE)
    assert " times " in prior.name and 0.01 < prior.values["t"] < 0.5 and prior.values["d"] == 5.0


def test_member_takes_the_prior_and_an_entry_names_it():
    member = made("L", 3.0, {"a": 0.127, "b": 0.127, "t": 0.018})
    parameters = tuple(
        p if p.name != "t" else Parameter(name="t", value_m=0.018, std_m=None, observable=False, source="fitted") for p in member.parameters
    )
    hidden = type(member)(**{**vars(member), "parameters": parameters})
    done = catalogued(hidden, TABLE)
    t = next(p for p in done.parameters if p.name == "t")
    assert (t.source, t.std_m, t.observable) == ("catalogue", None, False)
    assert any(e.parameters["t"] == pytest.approx(t.value_m) and e.name == "L5X5X1/2" for e in done.catalogue)
    assert not done.covariance[2].any() and done.covariance[0, 0] > 0
    assert done.values()["length"] == 3.0
    seen = catalogued(member, TABLE)
    assert seen.parameters == member.parameters and seen.catalogue


HEAD = "family,name,a_mm,b_mm,t_mm\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("name,a_mm\nx,1\n", "column 'family' is missing"),
        ("family,name,a_mm,t_mm\nL,x,100,8\n", "line 2: section x of family L needs the column 'b_mm'"),
        (HEAD + "L,x,100,100,eight\n", "line 2: t_mm of x is 'eight', which is not a number"),
        (HEAD + "L,x,100,,8\n", "line 2: b_mm of x is '', which is not a number"),
        (HEAD + "L,x,100,100,-8\n", "must be positive"),
        (HEAD + "L,x,100,100,nan\n", "must be positive"),
        (HEAD + "Z,x,100,100,8\n", "family 'Z' is unknown"),
        (HEAD + "L,,100,100,8\n", "no name"),
        (HEAD + "L,x,100,100,120\n", "line 2: x is no section: section L: t is 0.12 m; it must be less than 0.1 m"),
        (HEAD + "L,x,5,5,0.3125\nL,y,4,4,0.25\n", "look like inches"),
        ("family,name,a_mm,b_mm,t_mm,area_mm2\nL,x,100,100,8,2.4\n", "1 of 1 areas do not fit"),
    ],
)
def test_bad_tables_are_refused_by_line_and_column(text, says):
    with pytest.raises(InputError, match=says):
        parse_table(text, "mine.csv")


def test_inches_are_read_where_they_are_marked(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("family,name,a_in,b_in,t_in\nL,L5x5x1/4,5,5,0.25\n", encoding="utf-8")
    table = read_table(path)
    assert dict(table.shapes[0].parameters) == pytest.approx({"a": 0.127, "b": 0.127, "t": 0.00635})
    entries = posterior("L", {"a": 0.127, "b": 0.127, "t": 0.00635}, np.eye(3) * 1e-8, {}, table)
    assert entries[0].name == "L5x5x1/4" and entries[0].probability > 0.9
    assert posterior("I", {"h": 0.2, "b": 0.1, "tw": 0.005, "tf": 0.008}, np.eye(4), {}, table)[0].name == OTHER
    with pytest.raises(InputError, match=r"none\.csv"):
        read_table(tmp_path / "none.csv")


def test_bad_questions():
    with pytest.raises(UsageError, match="'b' of the L is missing"):
        posterior("L", {"a": 0.1, "t": 0.01}, np.eye(2), {}, TABLE)
    with pytest.raises(UsageError, match=r"covariance is \(2, 2\)"):
        posterior("L", {"a": 0.1, "b": 0.1, "t": 0.01}, np.eye(2), {}, TABLE)
    with pytest.raises(UsageError, match="no dimension of the L was observed"):
        prior_thickness("L", {"a": 0.1, "b": 0.1, "t": 0.01}, np.eye(3), dict.fromkeys("abt", False), TABLE)


def test_standard_outer_dimensions_speak_for_the_family():
    """L5x5 is in the table: its dimensions are likelier for an angle than for anything; others are a little less likely than without a table."""
    inch = 0.0254
    assert standard_odds("L", {"a": 5 * inch, "b": 5 * inch, "t": 0.001}, 5e-4) > 20
    assert standard_odds("L", {"a": 0.1311, "b": 0.0573, "t": 0.001}, 2e-4) == pytest.approx(0.4, abs=0.05)
    assert standard_odds("L", {"b": 5 * inch, "t": 0.05, "a": 5 * inch}, 5e-4) == standard_odds("L", {"a": 5 * inch, "b": 5 * inch, "t": 0.001}, 5e-4)
    assert standard_odds("round", {"d": 0.05}, 1e-4, Table(shapes=(), source="none")) == 1.0


def test_walls_of_the_table_that_leave_no_section_are_not_built():
    # half of a T looked like this channel, 2.3 mm high: every size of the table has flanges that would meet
    member = made("C", 0.4, {"h": 0.0023, "b": 0.02, "tw": 0.0005, "tf": 0.0002})
    parameters = tuple(replace(p, observable=p.name in ("h", "length"), std_m=1e-5 if p.name in ("h", "length") else None) for p in member.parameters)
    covariance = np.diag([1e-10, 0, 0, 0, 1e-10])
    hidden = replace(member, parameters=parameters, covariance=covariance)
    flat = Table(shapes=tuple(replace(s, parameters={**s.parameters, "tf": 0.6 * s.parameters["h"]}) for s in TABLE.of("C")[:3]), source="flat")
    with pytest.raises(EstimationError, match="no size of the table goes with what was seen of the C member"):
        catalogued(hidden, flat)


def test_no_size_stands_in_that_ends_short_of_what_was_seen():
    """An I of which the depth alone is told, its flanges seen to 210 mm without a toe: most beams of that depth are narrower."""
    member = made("I", 2.0, {"h": 0.2, "b": 0.21, "tw": 0.006, "tf": 0.01})
    told = tuple(replace(p, observable=p.name in ("h", "length"), std_m=1e-5 if p.name in ("h", "length") else None) for p in member.parameters)
    seen = {name: float("TOE" not in name) for name in faces("I")}
    hidden = replace(member, parameters=told, covariance=np.diag([1e-10, 0, 0, 0, 1e-10]), seen=seen, sigma_m=1e-4)
    free = catalogued(replace(hidden, seen=dict.fromkeys(seen, 0.0)), TABLE).values()
    built = catalogued(hidden, TABLE).values()
    assert free["b"] < 0.2 < 0.209 < built["b"]
    assert catalogued(replace(hidden, parameters=tuple(replace(p, value_m=0.9) if p.name == "b" else p for p in told)), TABLE).values()["b"] > 0.89
