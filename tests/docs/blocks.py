"""The code of the pages: blocks (fenced or indented), command lines in them, and command lines within sentences."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.S | re.M)
_INDENTED = re.compile(r"(?:(?<=\n\n)|\A)((?:(?: {4}.*|)\n)+)")


@dataclass(frozen=True)
class Block:
    page: str
    language: str
    text: str

    @property
    def where(self) -> str:
        return f"{self.page}: {self.text.strip().splitlines()[0][:60]}"


def blocks_of(name: str, text: str) -> list[Block]:
    """Fenced blocks with their language; indented ones are "toml" where they begin as such, else without one."""
    found = [Block(name, match[1], match[2]) for match in _FENCE.finditer(text)]
    rest = _FENCE.sub("", text)
    for match in _INDENTED.finditer(rest):
        lines = [line[4:] for line in match[1].splitlines()]
        if any(lines):
            body = "\n".join(lines).strip("\n") + "\n"
            found.append(Block(name, "toml" if re.match(r"\[+\w|\w+ = ", body) else "", body))
    return found


def commands(text: str) -> Iterator[str]:
    """Command lines of a block: several may share a line, two spaces apart; a comment or a remark may follow."""
    for line in text.splitlines():
        for part in re.split(r"\s{2,}|\s#\s", line.strip()):
            if part.startswith("scan2fea ") and not re.match(r"scan2fea [a-z]+s (?!-)[a-z]", part):
                yield part


def spoken(text: str) -> Iterator[str]:
    """Command lines in backticks within sentences."""
    flowing = "\n".join(line for line in _FENCE.sub("", text).splitlines() if not line.startswith("    "))
    for match in re.finditer(r"`(scan2fea [^`]+)`", flowing):
        yield " ".join(match[1].split())


def every_block() -> list[Block]:
    return [block for page in PAGES for block in blocks_of(page.relative_to(ROOT).as_posix(), page.read_text(encoding="utf-8"))]
