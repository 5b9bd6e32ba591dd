"""The cards of a deck in the language of Abaqus and CalculiX."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from scan2fea.types import Value

MISSPELT = "MISSPELT"  # not a card: what a reader of another language found to be one, with its WORD and what is MEANT


@dataclass(frozen=True, kw_only=True)
class Card(Value):
    """word : upper case, without the star.   options : by upper-case name, values upper case.   data : its lines, split at commas."""

    word: str
    options: dict[str, str]
    data: tuple[tuple[str, ...], ...]


def cards_of(text: str) -> tuple[Card, ...]:
    """The cards of a deck in order; comments and empty lines are left out, card lines that end with a comma go on."""
    cards: list[tuple[str, list[tuple[str, ...]]]] = []
    for raw in text.splitlines():
        line = raw.strip()
        if not line or line.startswith("**"):
            continue
        if line.startswith("*"):
            cards.append((line, []))
        elif cards and cards[-1][0].endswith(",") and not cards[-1][1]:
            cards[-1] = (cards[-1][0] + line, [])
        elif cards:
            cards[-1][1].append(tuple(word.strip() for word in line.split(",")))
    return tuple(_card(head, data) for head, data in cards)


def _card(head: str, data: Sequence[tuple[str, ...]]) -> Card:
    words = [word.strip() for word in head[1:].split(",")]
    options = {}
    for word in words[1:]:
        key, _, value = word.partition("=")
        options[key.strip().upper()] = value.strip().strip('"').upper()
    return Card(word=re.sub(r"\s+", " ", words[0].upper()), options=options, data=tuple(data))


def is_near(word: str, name: str) -> bool:
    """Whether a name of four letters or more has one letter wrong, missing or too many, or two exchanged."""
    if abs(len(word) - len(name)) > 1 or len(name) < 4:
        return False
    at = next((k for k, (a, b) in enumerate(zip(word, name, strict=False)) if a != b), min(len(word), len(name)))
    a, b = word[at:], name[at:]
    return a[1:] == b[1:] or a[1:] == b or a == b[1:] or (a[:2] == b[1::-1] and a[2:] == b[2:])
