"""Would a deck run? Cards that name what is not there: sets, materials, steps; cards whose names are misspelt. For decks of any tool, as `cards`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scan2fea.types import Check
from scan2fea.verification.cards import MISSPELT, Card, is_near
from scan2fea.verification.deck_sets import DeckMesh, sets_of
from scan2fea.verification.deck_supports import SOLID, TURNING, Supports, supports_of
from scan2fea.verification.limits import at_least, holds

_DEFINES = {
    **dict.fromkeys(("NSET", "NODE", "NGEN", "NFILL"), "NSET"),
    **dict.fromkeys(("ELSET", "ELEMENT", "ELGEN"), "ELSET"),
    "SURFACE": "NAME",
}
_NAME = r"[A-Za-z_][\w.\-]*"
_SECTIONED = (*SOLID, *TURNING)
# Cards without which a deck is solved otherwise than it was meant; and what other programs call cards that one letter would make of these.
_SPELT = (
    "NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "MATERIAL", "ELASTIC", "DENSITY", "SOLID SECTION", "SHELL SECTION", "BEAM SECTION", "STEP",
    "STATIC", "FREQUENCY", "BUCKLE", "BOUNDARY", "CLOAD", "DLOAD", "DSLOAD", "EQUATION", "COUPLING", "KINEMATIC", "RIGID BODY", "END STEP",
)  # fmt: skip
_OTHERS = ("PLASTIC",)


def deck_checks(cards: Sequence[Card], mesh: DeckMesh) -> tuple[Check, ...]:
    """Steps, materials with what the steps need of them, sets that exist, supports that hold every part in each step that needs it."""
    missing = missing_sets(cards) + _missing_nodes(cards, mesh)
    weak = [*_materials_without(cards), *_bad_numbers(cards), *_without_section(cards, mesh)]
    wrong = _misspelt(cards) + [f"{card.options['WORD']}: is {card.options['MEANT']} meant?" for card in cards if card.word == MISSPELT]
    n_steps, n_ends = (sum(card.word == word for card in cards) for word in ("STEP", "END STEP"))
    return (
        at_least("deck.steps", n_steps),
        holds("deck.cards", not wrong and n_steps == n_ends, "; ".join(wrong) or f"{n_steps} *STEP, {n_ends} *END STEP"),
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


def _missing_nodes(cards: Sequence[Card], mesh: DeckMesh) -> list[str]:
    """`node NUMBER (CARD)` of loads on nodes that are not there."""
    asked = list(dict.fromkeys(row[0] for card in cards if card.word == "CLOAD" for row in card.data if row and row[0].isdigit()))
    numbers = np.array([int(word) for word in asked], np.int64)
    return [f"node {number} (*CLOAD)" for number in numbers[~np.isin(numbers, mesh.numbers)].tolist()]


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


def _bad_numbers(cards: Sequence[Card]) -> list[str]:
    """Stiffness and density of isotropic materials that no solver takes, in words."""
    out = []
    current = ""
    for card in cards:
        if card.word == "MATERIAL":
            current = card.options.get("NAME", "")
        elif card.word == "DENSITY" and card.data:
            if not _number(card.data[0][0]) > 0:
                out.append(f"{current} has a density of {card.data[0][0] or 'nothing'}")
        elif card.word == "ELASTIC" and card.data and card.options.get("TYPE", "ISOTROPIC").startswith("ISO"):
            youngs, poisson = (*card.data[0], "", "")[:2]
            if not _number(youngs) > 0:
                out.append(f"{current} has a Young's modulus of {youngs or 'nothing'}")
            if not -1 < _number(poisson or "0") < 0.5:
                out.append(f"{current} has a Poisson's ratio of {poisson}")
    return out


def _number(word: str) -> float:
    """nan where it is none."""
    try:
        return float(re.sub(r"(?i)d", "e", word))  # 2.1D11
    except ValueError:
        return float("nan")


def _without_section(cards: Sequence[Card], mesh: DeckMesh) -> list[str]:
    """Elements that no card *... SECTION names: without a material a solver stops. Not of decks whose sections name no set (Nastran)."""
    kinds = [card.options.get("TYPE", "") for card in cards if card.word == "ELEMENT"]
    named = [card.options["ELSET"] for card in cards if card.word.endswith("SECTION") and "ELSET" in card.options]
    from_elsewhere = any(card.word == "ELSET" and "INPUT" in card.options for card in cards)
    if not named or from_elsewhere or len(kinds) != len(mesh.cells):
        return []
    rigid = [card.options["ELSET"] for card in cards if card.word == "RIGID BODY" and "ELSET" in card.options]
    elements = sets_of(cards, mesh).elements
    served = np.concatenate([elements[name] for name in (*named, *rigid) if name in elements] or [np.zeros(0, np.int64)])
    pairs = zip(kinds, mesh.cells, mesh.cell_numbers, strict=True)
    asked = np.concatenate([numbers for kind, (shape, _), numbers in pairs if shape in _SECTIONED and kind != "R3D3"] or [np.zeros(0, np.int64)])
    bare = np.setdiff1d(asked, served)
    return [f"{len(bare)} elements have no section, the first is {bare[0]}"] if len(bare) and len(served) else []


def _misspelt(cards: Sequence[Card]) -> list[str]:
    """Cards that are one letter from one that matters, or have two of its letters exchanged: solvers pass over them with a warning at most."""
    words = dict.fromkeys(card.word for card in cards if card.word not in _SPELT and card.word not in _OTHERS)
    return [f"*{word}: is *{meant} meant?" for word in words for meant in [next((name for name in _SPELT if is_near(word, name)), "")] if meant]
