"""Text cannot become markup."""

from __future__ import annotations

import html

import pytest

from report.fake_report import HOSTILE
from scan2fea.report.markup import NOTHING, Html, figure_cell, joined, link, table, tag, text


def test_text_is_escaped_and_markup_is_not():
    assert text(HOSTILE) == html.escape(HOSTILE, quote=True)
    assert tag("p", HOSTILE, tag("b", 1)) == f"<p>{html.escape(HOSTILE)}<b>1</b></p>"
    assert tag("img", alt='"><script>') == '<img alt="&quot;&gt;&lt;script&gt;">'
    assert joined(["<", Html("<br>")], "&") == "&lt;&<br>"
    assert text(NOTHING) == ""


def test_characters_that_do_not_show_are_marked():
    assert text("a\x00\x1b\x9b\u202eb\n") == "a\ufffd\ufffd\ufffd\ufffdb\n"
    text(b"caf\xe9".decode("utf-8", "surrogateescape")).encode("utf-8")  # a file name that is not UTF-8 can be written


@pytest.mark.parametrize("path", ["javascript:alert(1)", "//host/x", "a b/c?d#e", '"><script>'])
def test_links_stay_beside_the_page(path):
    made = link(path, "x")
    assert made.startswith('<a href="./') and "<script" not in made and "?" not in made and "javascript:" not in made


def test_attributes():
    assert tag("a", class_="b", data_label="c", title=None) == '<a class="b" data-label="c"></a>'
    assert tag("meta", name="viewport", http_equiv="x") == '<meta name="viewport" http-equiv="x">'
    assert tag("rect", x=1) == '<rect x="1"/>'


def test_table_cells_know_their_column():
    made = table(("a", "b<"), [["x", figure_cell(1, "b<")]], row_classes=["bad-row"])
    assert '<td data-label="a">x</td><td class="n" data-label="b&lt;">1</td>' in made
    assert '<th scope="col" class="n">b&lt;</th>' in made and '<tr class="bad-row">' in made
    with pytest.raises(ValueError):
        table(("a",), [["x", "y"]])
