"""Would a deck run? Cards that name what is not there: sets, materials, steps. For decks of any tool, as `cards`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from scan2fea.types import Check
from scan2fea.verification.cards import Card
from scan2fea.verification.deck_sets import DeckMesh
from scan2fea.verification.deck_supports import Supports, supports_of
from scan2fea.verification.limits import at_least, holds

_DEFINES = {
    **dict.fromkeys(("NSET", "NODE", "NGEN", "NFILL"), "NSET"),
    **dict.fromkeys(("ELSET", "ELEMENT", "ELGEN"), "ELSET"),
    "SURFACE": "NAME",
}
_NAME = r"[A-Za-z_][\w.\-]*"


def deck_checks(cards: Sequence[Card], mesh: DeckMesh) -> tuple[Check, ...]:
    """Steps, materials with what the steps need of them, sets that exist, supports that hold every part in each step that needs it."""
    missing = missing_sets(cards)
    weak = _materials_without(cards)
    return (
        at_least("deck.steps", sum(card.word == "STEP" for card in cards)),
        holds("deck.materials", not weak, "; ".join(weak) or "all defined"),
        holds("deck.sets", not missing, ", ".join(missing[:8]) or "all defined"),
        _held(supports_of(cards, mesh)),
    )


def _held(supports: Supports) -> Check:
    free = "; ".join(supports.free)
    if free and supports.unread:
        return holds("deck.unsupported", True, f"not told: {', '.join(supports.unread)} may hold it; without: {free}")
    told = holds("deck.unsupported", not free, free or ("all held" if supports.n_steps else "no step needs supports"))
    return told if told.passed else replace(told, value="free")


def missing_sets(cards: Sequence[Card]) -> list[str]:
    """`NAME (CARD)` of every set or surface that a card uses and none defines, or that is empty."""
    known = {"": "", **{name: name for name in _defined(cards)}}
    found = []
    for card in cards:
        defines = card.word in ("NSET", "ELSET", "NODE", "ELEMENT", "NGEN", "NFILL", "ELGEN")
        used = [] if defines else [card.options[key] for key in ("NSET", "ELSET", "SURFACE") if key in card.options]
        if card.word in ("BOUNDARY", "CLOAD", "DLOAD", "DSLOAD", "TEMPERATURE", "INITIAL CONDITIONS"):
            used += [row[0].upper() for row in card.data if row and re.fullmatch(_NAME, row[0])]
        found += [f"{name} (*{card.word})" for name in used if name not in known]
    return list(dict.fromkeys(found))


def _defined(cards: Sequence[Card]) -> set[str]:
    """Names of what holds something: a set without a line is none, unless it is read from a file or made of the nodes of elements."""
    names = set()
    for card in cards:
        key = _DEFINES.get(card.word)
        from_elsewhere = "INPUT" in card.options or (card.word == "NSET" and "ELSET" in card.options)
        if key is not None and key in card.options and (card.data or from_elsewhere):
            names.add(card.options[key])
    return names


def _materials_without(cards: Sequence[Card]) -> list[str]:
    """What the sections' materials lack, in words."""
    has: dict[str, set[str]] = {}
    current = ""
    for card in cards:
        if card.word == "MATERIAL":
            current = card.options.get("NAME", "")
            has.setdefault(current, set())
        elif card.word in ("ELASTIC", "DENSITY", "USER MATERIAL") and current:
            has[current].add(card.word)
        elif card.word in ("STEP", "SOLID SECTION", "SHELL SECTION", "BEAM SECTION"):
            current = ""
    heavy = any(card.word == "FREQUENCY" or any(len(row) > 1 and row[1].upper() == "GRAV" for row in card.data) for card in cards)
    out = []
    for card in cards:
        if card.word in ("SOLID SECTION", "SHELL SECTION", "BEAM SECTION"):
            name = card.options.get("MATERIAL", "")
            if name not in has:
                out.append(f"no material {name or '(no name)'}")
            elif not has[name] & {"ELASTIC", "USER MATERIAL"}:
                out.append(f"{name} is not elastic")
            elif heavy and "DENSITY" not in has[name]:
                out.append(f"{name} has no density")
        elif card.word == "BEAM GENERAL SECTION" and heavy and "DENSITY" not in card.options:  # it holds its own material
            out.append(f"the section of {card.options.get('ELSET', '(no set)')} has no density")
    if not any(card.word.endswith("SECTION") for card in cards):
        out.append("no section")
    return list(dict.fromkeys(out))
