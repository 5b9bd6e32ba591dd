"""The gallery: every example has its chapter and picture, and the cheap ones are run as they stand."""

import sys

import pytest
from PIL import Image

from docs.blocks import ROOT

EXAMPLES = ROOT / "examples"
CHEAP = ("ex01_fit_a_beam", "ex06_figures_of_the_thesis")  # the others take up to a minute: `make gallery`


@pytest.fixture(scope="module")
def gallery():
    sys.path.insert(0, str(EXAMPLES))
    try:
        import make_gallery

        yield make_gallery
    finally:
        sys.path.remove(str(EXAMPLES))


@pytest.mark.parametrize("name", CHEAP)
def test_an_example_does_what_its_text_says(gallery, name, tmp_path):
    kit = gallery.made(name, tmp_path)
    chapter = gallery.chapter(name, kit)
    assert kit.picture.startswith(b"\x89PNG") and str(tmp_path) not in chapter
    assert all(f"    {command}\n" in chapter for command, _ in kit.steps if command)


def test_the_page_has_a_chapter_and_a_picture_of_each(gallery):
    page = gallery.PAGE.read_text(encoding="utf-8")
    told = [name for name in gallery.names() if f"This is `examples/{name}.py`." in page]
    assert set(CHEAP[:1]) <= set(told)
    for name in told:
        with Image.open(gallery.IMAGES / f"{name[:4]}.png") as picture:
            assert picture.size[0] >= 300


def test_many_files_are_told_as_a_shell_would(gallery):
    folded = sys.modules["kit"]._folded
    files = [f"a/{k}.ply" for k in range(5)]
    assert folded(["run", *files, "b/1.ply", "-o", "OUT"]) == ["run", "a/*.ply", "b/1.ply", "-o", "OUT"]
    assert folded(files[:3]) == files[:3] and folded([]) == []
