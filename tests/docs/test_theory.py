"""The page of equations: every number of the thesis stands in it once, and every file that it names is there."""

import re

from docs.blocks import ROOT

PAGE = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
NUMBERED = [f"2.{k}" for k in range(1, 21)] + ["3.1", "3.2", "3.3"]


def test_every_equation_of_the_thesis_is_there_once():
    assert sorted(re.findall(r"^\| ([23]\.\d+)\b", PAGE, re.M)) == sorted(NUMBERED)


def test_the_files_exist_and_name_their_equation():
    rows = re.findall(r"^\| (.+?) \|.*\| ((?:`[a-z0-9_/]+\.py`(?:, )?)+) \|", PAGE, re.M)
    assert len(rows) > 60
    for what, files in rows:
        texts = [(ROOT / "src" / "scan2fea" / name).read_text(encoding="utf-8") for name in re.findall(r"`([^`]+)`", files)]
        if number := re.match(r"([23])\.(\d+)", what):
            assert any(numbers_of(text) & {(int(number[1]), int(number[2]))} for text in texts), f"{what}: no file of {files} names it"


def numbers_of(text):
    """Equations that a file names: "2.16", "eq 2.8-2.12", "eq 2.16 to 2.18"."""
    found = {(int(a), int(b)) for a, b in re.findall(r"\b([23])\.(\d+)\b", text)}
    for a, b, c, d in re.findall(r"\b([23])\.(\d+)(?:-| to )([23])\.(\d+)\b", text):
        found |= {(int(a), k) for k in range(int(b), int(d) + 1) if a == c}
    return found
