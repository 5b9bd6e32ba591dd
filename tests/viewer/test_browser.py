"""The page is found and handed to the browser; where there is none, the message says what to do."""

from __future__ import annotations

import webbrowser

import pytest

from scan2fea.errors import InputError
from scan2fea.viewer import open_report


@pytest.fixture
def opened(monkeypatch):
    calls: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda url, *a, **k: calls.append(url) or True)
    return calls


def test_opens_the_page(tmp_path, opened):
    folder = tmp_path / "out #1"
    folder.mkdir()
    page = folder / "report.html"
    page.write_text("x", encoding="utf-8")
    assert open_report(folder) == page.resolve()
    assert open_report(page) == page.resolve()
    assert opened == [page.resolve().as_uri()] * 2 and "%231" in opened[0]


def test_a_browser_that_does_not_open_is_no_fault(tmp_path, monkeypatch):
    (tmp_path / "report.html").write_text("x", encoding="utf-8")
    monkeypatch.setattr(webbrowser, "open", lambda url, *a, **k: False)
    assert open_report(tmp_path).name == "report.html"


def test_what_is_missing_is_told(tmp_path, opened):
    with pytest.raises(InputError, match="no such folder"):
        open_report(tmp_path / "none")
    with pytest.raises(InputError, match=r"holds no report\.html; give the folder"):
        open_report(tmp_path)
    (tmp_path / "report.json").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="--resume"):
        open_report(tmp_path)
    with pytest.raises(InputError, match="is not a report"):
        open_report(tmp_path / "report.json")
    assert opened == []
