"""What the page says of the optimisers."""

from report.fake_report import optimised
from scan2fea.report.charts import ridges
from scan2fea.report.optimised import optimised_block


def test_every_step_and_measure_is_shown_with_its_figures():
    done = {"iterations": 5, "flips": 1283, "energy": [1.0, 0.92]}
    steps = [optimised("filled", 4.2), optimised("odt", 9.5, done), optimised("exude", 9.5, {"undone": 1})]
    page = str(optimised_block(steps))
    for words in ("as filled", "ODT", "exudation", "4.2\u00b0", "9.5\u00b0", "5 iterations", "1\u202f283 flips", "energy to 92 %", "taken back"):
        assert words in page or words.replace("\u202f", ",") in page or words.replace("\u202f", " ") in page, words
    assert page.count("<svg") == 3
    assert page.index("min dihedral, degrees") < page.index("<details") < page.index("aspect")
    assert str(optimised_block([])) == ""


def test_ridges_draw_a_bar_per_count_that_is_not_zero():
    page = str(ridges([("one", [0, 4, 16], "a"), ("two", [1, 0, 0], "b")], low=0.0, high=3.0, axis="x", title="t"))
    assert page.count("<rect") == 3
    heights = sorted(float(part.split('"')[0]) for part in page.split('height="')[1:])
    assert heights[-1] == 2 * heights[-2] == 4 * heights[-3]  # roots of 16, 4, 1
    assert str(ridges([("one", [0, 0], "")], low=0.0, high=1.0, axis="", title="")) == ""
