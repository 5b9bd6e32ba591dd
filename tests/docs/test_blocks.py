"""Every code block of the pages: command lines are parsed by the real parser, their options looked up, TOML is loaded, Python is run."""

import argparse
import re
import shlex
import tomllib
import traceback

import pytest

from docs.blocks import PAGES, ROOT, blocks_of, commands, every_block, spoken
from scan2fea.cli.parser import parser
from scan2fea.cli.settings import config_of
from scan2fea.pipeline.config import Config, load_config
from scan2fea.simulation.scene_file import scene_of

BLOCKS = every_block()
SUB = next(action for action in parser()._actions if isinstance(action, argparse._SubParsersAction)).choices
LINES = sorted({(block.page, line) for block in BLOCKS for line in commands(block.text)})
SPOKEN = sorted({(page.name, line) for page in PAGES for line in spoken(page.read_text(encoding="utf-8"))})


def variants(line: str) -> list[str]:
    """Without what stands in brackets, and with it; `...` after a word means more of it, alone an input."""
    line = re.sub(r"\[\.\.\.\]|(?<=\w)\.\.\.|(?<=\])\.\.\.", "", line)
    bare, full = re.sub(r"\[[^\]]*\]", "", line), re.sub(r"[\[\]]", "", line)
    return [bare] if bare == full else [bare, full]


def raised(call, *given) -> str:
    """What a call raises, with its way there; "" where it ends well."""
    try:
        call(*given)
    except Exception:  # noqa: BLE001 - whatever a block raises is the failure to show
        return traceback.format_exc()
    return ""


def parsed(line: str) -> argparse.Namespace | None:
    words = shlex.split(line, comments=True)[1:]
    words = [word for k, word in enumerate(words) if word != "KEY=VALUE" and words[k : k + 2] != ["--set", "KEY=VALUE"]]
    words = ["1" if word == "N" else "30" if word == "S" else word for word in words]
    try:
        return parser().parse_args(words)
    except SystemExit:
        return None


@pytest.mark.parametrize(("page", "line"), LINES)
def test_command_lines_are_understood(page, line):
    for variant in variants(line):
        given = parsed(variant)
        assert given is not None, f"{page}: the parser refuses: {variant}"
        if hasattr(given, "settings") and not given.config:
            if getattr(given, "method", None) == "M":
                given.method = None
            assert raised(config_of, given) == "", f"{page}: no such configuration: {variant}"


@pytest.mark.parametrize(("page", "line"), SPOKEN)
def test_commands_and_options_in_sentences_exist(page, line):
    words = line.split()
    if words[1].startswith("-"):
        assert words[1] in {"--help", "--version"}
        return
    names = re.split(r"\W", words[1])[0]
    if names in {"COMMAND", ""}:
        return
    assert names in SUB, f"{page}: no command {words[1]}"
    known = {text for action in SUB[names]._actions for text in action.option_strings}
    assert {re.split(r"[^\w-]", word.lstrip("["))[0] for word in words[2:] if word.lstrip("[").startswith("--")} <= known


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "toml"], ids=lambda b: b.where)
def test_toml_is_a_scene_or_a_configuration(block, tmp_path):
    assert raised(tomllib.loads, block.text) == ""
    tree = tomllib.loads(block.text)
    if {"sensor", "sampling"} & set(tree):
        assert raised(scene_of, block.text) == ""
        return
    assert set(tree) <= set(Config.__dataclass_fields__), f"{block.page}: no such table of options"
    path = tmp_path / "options.toml"
    path.write_text(block.text, encoding="utf-8")
    assert raised(load_config, path) == ""


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "python" and b.page.startswith(("docs", "README"))], ids=lambda b: b.where)
def test_python_runs(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert raised(exec, compile(block.text, block.page, "exec"), {"__name__": "docs"}) == ""


def test_every_command_of_the_contract_is_there_and_the_readme_shows_every_command():
    contract = (ROOT / "docs" / "design.md").read_text(encoding="utf-8").split("## The contract")[1].split("Short forms")[0]
    alone = re.search(r"one stage alone: ([a-z |]+)", contract)[1].split("|")
    assert {line.split()[1] for page, line in LINES if page == "docs/design.md"} | {name.strip() for name in alone} <= set(SUB)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [name for name in SUB if f"scan2fea {name}" not in readme] == []


def test_there_is_something_to_test():
    assert len(LINES) > 25 and len(SPOKEN) > 10 and any(b.language == "toml" for b in BLOCKS)


def test_blocks_are_found():
    text = "a\n\n    scan2fea demo   # it\n    b\n\nc\n\n```python\nx = 1\n```\n\n    [fea]\n    material = \"S355\"\n"
    found = blocks_of("p", text)
    assert [(b.language, b.text) for b in found] == [("python", "x = 1\n"), ("", "scan2fea demo   # it\nb\n"), ("toml", '[fea]\nmaterial = "S355"\n')]
    assert list(commands(found[1].text)) == ["scan2fea demo"]
    assert variants("scan2fea run A... -o OUT [--seed 1]") == ["scan2fea run A -o OUT ", "scan2fea run A -o OUT --seed 1"]


def test_links_of_the_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if not re.match(r"[a-z]+:", target):
                assert (page.parent / target).exists(), f"{page.relative_to(ROOT)} links to {target}"
