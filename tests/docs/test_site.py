"""The site: it builds, every page is in the menu, every link leads somewhere, and the pages made from the program tell all of it."""

import importlib.util
import re

import pytest

from docs.blocks import ROOT
from scan2fea.pipeline.config import known_keys

pytest.importorskip("markdown_it")
spec = importlib.util.spec_from_file_location("make_site", ROOT / "docs" / "make_site.py")
site = importlib.util.module_from_spec(spec)
spec.loader.exec_module(site)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    assert site.build(folder)[0] == "index"
    return {path.stem: path.read_text(encoding="utf-8") for path in folder.glob("*.html")}


def test_every_page_is_there_and_fetches_nothing(built):
    assert set(built) == {page for pages in site.MENU.values() for page in pages}
    for text in built.values():
        assert not re.findall(r'<script|<link|src="https?:', text)
        assert text.count("<h1") == 1 and text.count("aria-current") == 2  # the rule of the style, and the page itself


def test_every_command_and_its_arguments_are_told(built):
    top = site.parser()
    actions = next(a for a in top._actions if isinstance(a, site.argparse._SubParsersAction))
    for name, command in actions.choices.items():
        assert f'<h2 id="{name}">' in built["commands"]
        own = built["commands"].split(f'<h2 id="{name}">')[1].split("<h2")[0]
        assert all(text in own for action in command._actions for text in action.option_strings)


def test_every_option_is_told(built):
    assert all(f"{key.rsplit('.', 1)[-1]} = " in built["options"] for key in known_keys() if not key.startswith("object"))


def test_tables_and_headings(built):
    assert '<th>what it is</th>' in built["commands"] and '<h2 id="conditions-hypothesis-2">' in built["thesis"]


@pytest.mark.parametrize(
    ("text", "says"), [("[x](none.md)", "no page"), ("[x](b.md#no)", "no heading"), ("![x](img/none.png)", "not there"), ("[x](#here)", "no heading")]
)
def test_what_leads_nowhere_is_told(text, says):
    bodies = {"a": site._body("a", f"# A\n\n{text}\n"), "b": site._body("b", "# B\n")}
    assert says in " ".join(site._faults("a", bodies["a"], bodies))


def test_what_leads_somewhere_is_not():
    bodies = {"a": site._body("a", "# A\n\n[b](b.md#b-c), [web](https://example.org), [own](#a)\n"), "b": site._body("b", "# B\n\n## B c\n")}
    assert not list(site._faults("a", bodies["a"], bodies))


def test_a_page_outside_the_menu_is_told(monkeypatch):
    monkeypatch.setattr(site, "MENU", {"Begin": ("index", "nowhere")})
    with pytest.raises(site.SiteError, match=r"not in the menu.*acquisition.*without a file: nowhere"):
        site.sources()
    with pytest.raises(site.SiteError, match="no heading"):
        site._title("p", "text")
