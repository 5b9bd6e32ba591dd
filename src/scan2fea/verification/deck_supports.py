"""Do the supports of a deck hold it? Of each step that needs them: the rigid motions that supports, equations, couplings and ties leave."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.types import FloatArray, IntArray, Value
from scan2fea.verification import nastran
from scan2fea.verification.cards import Card
from scan2fea.verification.deck_sets import DeckMesh, DeckSets, directions, sets_of
from scan2fea.verification.rigid_motions import Parts, Rows, free_motions, parts_of

NEEDS = ("STATIC", "VISCO", "BUCKLE", "COUPLED TEMPERATURE-DISPLACEMENT")  # inertia holds the others
NAMED = {
    "ENCASTRE": (1, 2, 3, 4, 5, 6), "PINNED": (1, 2, 3), "XSYMM": (1, 5, 6), "YSYMM": (2, 4, 6), "ZSYMM": (3, 4, 5),
    "XASYMM": (2, 3, 4), "YASYMM": (1, 3, 5), "ZASYMM": (1, 2, 6),
}  # fmt: skip
MAY_HOLD = (
    "CONTACT", "CONTACT PAIR", "FOUNDATION", "EMBEDDED ELEMENT", "SHELL TO SOLID COUPLING", "CONNECTOR SECTION", "SPRING", "PRE-TENSION SECTION",
    "FASTENER", "CYCLIC SYMMETRY MODEL", "SUBMODEL", "NGEN", "NCOPY", "SYSTEM",
)  # fmt: skip
RIGID_MPC = ("BEAM", "TIE", "PIN")
PLANE, SPRINGS = ("CPS", "CPE", "CAX"), ("SPRING", "DASHPOT", "CONN", "GAP")
TURNING = {"triangle": 3, "triangle6": 6, "quad": 4, "quad8": 8, "line": 2, "line3": 3}
SOLID = ("tet", "tet10")
ALL = (*SOLID, *TURNING)
SHOWN = 4  # parts that are named


@dataclass(frozen=True, kw_only=True)
class Supports(Value):
    """free : what can move, in words.   unread : cards that may hold it all the same.   n_steps : those that need supports."""

    free: tuple[str, ...]
    unread: tuple[str, ...]
    n_steps: int


@dataclass(kw_only=True)
class _Conditions:
    """Rows as they are found, at nodes; `unread` cards."""

    row: list[int] = field(default_factory=list)
    node: list[int] = field(default_factory=list)
    moved_by: list[int] = field(default_factory=list)
    coefficients: list[FloatArray] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    count: int = 0

    def add(self, terms: Iterable[tuple[int, int, FloatArray]]) -> None:
        """Terms (node where, node that moves it, six coefficients) of one row."""
        for at, by, six in terms:
            self.row.append(self.count)
            self.node.append(at)
            self.moved_by.append(by)
            self.coefficients.append(six)
        self.count += 1


def supports_of(cards: Sequence[Card], mesh: DeckMesh) -> Supports:
    """Every step that needs supports, each with those that hold in it."""
    if sum(card.word == "ELEMENT" for card in cards) != len(mesh.cells):
        return Supports(free=(), unread=("*ELEMENT",), n_steps=0)
    sets = sets_of(cards, mesh)
    frames = directions(cards, sets)
    joins = _Conditions()
    lone = _joined(cards, sets, frames, joins)
    unread = [*joins.unread, *_unread(cards)]
    solids = np.concatenate([rows[:, :4] for kind, rows in mesh.cells if kind in SOLID] or [np.zeros((0, 4), np.int64)])
    turning = [rows[:, : TURNING[kind]] for kind, rows in mesh.cells if kind in TURNING]
    parts = parts_of(mesh.nodes, solids, turning, lone)
    order = [k for wanted in (SOLID, TURNING) for k, (kind, _) in enumerate(mesh.cells) if kind in wanted]
    numbers = np.concatenate([mesh.cell_numbers[k] for k in order] or [np.zeros(0, np.int64)])
    told: dict[str, list[int]] = {}
    n_steps = 0
    for number, held, needs in _steps(cards):
        if not needs:
            continue
        n_steps += 1
        for said in _free_in(held, sets, frames, joins, parts, numbers, unread):
            told.setdefault(said, []).append(number)
    free = tuple(f"step {', '.join(map(str, steps[:8]))}: {said}" for said, steps in told.items())
    return Supports(free=free, unread=tuple(dict.fromkeys(unread)), n_steps=n_steps)


def _unread(cards: Sequence[Card]) -> list[str]:
    """Cards that may hold or place parts in ways that are not read here."""
    out = [f"*{card.word}" for card in cards if card.word in MAY_HOLD]
    out += [card.word for card in cards if card.word in nastran.MAY_HOLD]
    kinds = [card.options.get("TYPE", "") for card in cards if card.word == "ELEMENT"]
    out += [f"*ELEMENT, TYPE={kind}" for kind in kinds if kind.startswith((*SPRINGS, *PLANE))]
    return out + ["*INSTANCE that is placed" for card in cards if card.word == "INSTANCE" and card.data]


def _steps(cards: Sequence[Card]) -> list[tuple[int, tuple[Card, ...], bool]]:
    """(number, the cards *BOUNDARY that hold in it, whether it needs them) of each step."""
    out: list[tuple[int, tuple[Card, ...], bool]] = []
    held: list[Card] = []
    in_step: list[Card] | None = None
    for card in cards:
        if card.word == "STEP":
            in_step = []
        elif card.word == "END STEP" and in_step is not None:
            if any(one.word == "BOUNDARY" and one.options.get("OP") == "NEW" for one in in_step):
                held = []
            held += [one for one in in_step if one.word == "BOUNDARY"]
            words = {one.word for one in in_step}
            out.append((len(out) + 1, tuple(held), bool(words & set(NEEDS)) and "INERTIA RELIEF" not in words))
            in_step = None
        elif in_step is not None:
            in_step.append(card)
        elif card.word == "BOUNDARY":
            held.append(card)
    return out


def _free_in(
    held: Sequence[Card], sets: DeckSets, frames: FloatArray, joins: _Conditions, parts: Parts, numbers: IntArray, unread: list[str]
) -> list[str]:
    node, six = _held(held, sets, frames, unread)
    row = np.concatenate([np.array(joins.row, np.int64), joins.count + np.arange(len(node))])
    at = np.concatenate([np.array(joins.node, np.int64), node])
    by = np.concatenate([np.array(joins.moved_by, np.int64), node])
    coefficients = np.concatenate([np.array(joins.coefficients).reshape(-1, 6), six])
    part = parts.of_node[by]
    solid = (part >= 0) & (parts.named[np.maximum(part, 0)] >= 0) & (parts.named[np.maximum(part, 0)] < _n_solids(sets))
    coefficients[np.ix_(solid, [3, 4, 5])] = 0.0  # nodes of solids do not turn
    known = part >= 0
    rows = Rows(row=row[known], part=part[known], at=sets.mesh.nodes[at[known]], coefficients=coefficients[known])
    found, untold = free_motions(sets.mesh.nodes, parts, rows)
    if untold.any():
        unread.append(f"{int(untold.sum())} parts joined to each other")
    several = int((parts.named >= 0).sum()) > 1
    said = [(f"the part of element {numbers[parts.named[part]]}: " if several else "") + ", ".join(words) for part, words in sorted(found.items())]
    return said if len(said) <= SHOWN else [*said[:SHOWN], f"{len(said) - SHOWN} other parts too"]


def _n_solids(sets: DeckSets) -> int:
    return sum(len(rows) for kind, rows in sets.mesh.cells if kind in SOLID)


def _held(cards: Sequence[Card], sets: DeckSets, frames: FloatArray, unread: list[str]) -> tuple[IntArray, FloatArray]:
    """Nodes (k,) and coefficients (k, 6) of the unknowns that are given."""
    pairs: dict[tuple[int, ...], list[IntArray]] = {}
    for card in cards:
        for words in card.data:
            if not words[0]:
                continue
            second = words[1] if len(words) > 1 else ""
            if second.isdigit():
                last = words[2] if len(words) > 2 and words[2].isdigit() else second
                unknowns = tuple(k for k in range(int(second), int(last) + 1) if k <= 6)
            elif second.upper() in NAMED:
                unknowns = NAMED[second.upper()]
            else:
                unread.append(f"*BOUNDARY, {second}")
                continue
            pairs.setdefault(unknowns, []).append(sets.nodes_of(words[0]))
    nodes, six = [np.zeros(0, np.int64)], [np.zeros((0, 6))]
    for unknowns, found in pairs.items():
        own = np.unique(np.concatenate(found))
        for k in unknowns:
            nodes.append(own)
            six.append(_along(frames[own], k))
    return np.concatenate(nodes), np.concatenate(six)


def _along(frames: FloatArray, unknown: int) -> FloatArray:
    """(..., 6) coefficients of an unknown, 1 to 6, of nodes with these directions (..., 3, 3)."""
    out = np.zeros((*frames.shape[:-2], 6))
    out[..., 3 * (unknown > 3) : 3 * (unknown > 3) + 3] = frames[..., (unknown - 1) % 3, :]
    return out


def _joined(cards: Sequence[Card], sets: DeckSets, frames: FloatArray, joins: _Conditions) -> IntArray:
    """Fills `joins`; nodes that are joined as bodies of their own: reference nodes, and those of no element."""
    lone: list[int] = []
    coupling: Card | None = None
    for card in cards:
        if card.word == "EQUATION":
            lone += _equations(card, sets, frames, joins)
        elif card.word == "MPC":
            lone += _mpcs(card, sets, joins)
        elif card.word == "TIE":
            _ties(card, sets, joins)
        elif card.word == "RIGID BODY":
            lone += _rigid_body(card, sets, joins)
        elif card.word == "KINEMATIC COUPLING":
            for words in card.data:
                lone += _follow(card, sets.nodes_of(words[0]), _span(words[1:]), sets, joins)
        elif card.word == "COUPLING":
            coupling = card
        elif card.word in ("KINEMATIC", "DISTRIBUTING") and coupling is not None:
            unknowns = sorted({k for words in card.data for k in _span(words)}) or list(range(1, 7))
            if "ORIENTATION" in coupling.options and not {1, 2, 3} <= set(unknowns):
                joins.unread.append("*COUPLING, ORIENTATION")
            lone += _follow(coupling, sets.nodes_of(coupling.options.get("SURFACE", "")), unknowns, sets, joins)
            coupling = None
    return np.array(sorted(set(lone)), np.int64)


def _span(words: Sequence[str]) -> list[int]:
    numbers = [int(word) for word in words[:2] if word.isdigit()]
    return [k for k in range(numbers[0], numbers[-1] + 1) if k <= 6] if numbers else list(range(1, 7))


def _equations(card: Card, sets: DeckSets, frames: FloatArray, joins: _Conditions) -> list[int]:
    words = [word for row in card.data for word in row if word]
    lone: list[int] = []
    bare = ~sets.mesh.held_by(ALL)
    while words:
        n = int(words[0])
        terms = [(sets.nodes_of(words[3 * k + 1]), int(words[3 * k + 2]), float(words[3 * k + 3])) for k in range(n)]
        words = words[3 * n + 1 :]
        for k in range(max(len(own) for own, _, _ in terms)):
            told = [(int(own[min(k, len(own) - 1)]), unknown, factor) for own, unknown, factor in terms if len(own)]
            joins.add((node, node, factor * _along(frames[node], unknown)) for node, unknown, factor in told if unknown <= 6)
            lone += [node for node, _, _ in told if bare[node]]
    return lone


def _mpcs(card: Card, sets: DeckSets, joins: _Conditions) -> list[int]:
    lone: list[int] = []
    for words in card.data:
        kind = words[0].upper()
        if kind not in RIGID_MPC or len(words) < 3:
            joins.unread.append(f"*MPC, {kind}")
            continue
        ends = sets.nodes_of(words[1]), sets.nodes_of(words[2])
        if len(ends[0]) and len(ends[1]):
            lone += _rigidly(ends[0], int(ends[1][0]), range(1, 4) if kind == "PIN" else range(1, 7), sets, joins, at_reference=kind != "BEAM")
    return lone


def _follow(card: Card, nodes: IntArray, unknowns: Iterable[int], sets: DeckSets, joins: _Conditions) -> list[int]:
    found = sets.nodes_of(card.options.get("REF NODE", ""))
    return _rigidly(nodes, int(found[0]), unknowns, sets, joins) if len(found) else []


def _rigid_body(card: Card, sets: DeckSets, joins: _Conditions) -> list[int]:
    """In CalculiX the rotations of the body are the displacements of a second node (ROT NODE)."""
    nodes = [sets.nodes_of(card.options[key]) for key in ("NSET", "TIE NSET", "PIN NSET") if key in card.options]
    if "ELSET" in card.options:
        nodes.append(sets.of_elements(sets.elements.get(card.options["ELSET"], np.zeros(0, np.int64))))
    reference = sets.nodes_of(card.options.get("REF NODE", ""))
    if not len(reference) or not nodes:
        joins.unread.append("*RIGID BODY")
        return []
    lone = _rigidly(np.unique(np.concatenate(nodes)), int(reference[0]), range(1, 7), sets, joins)
    for turned in sets.nodes_of(card.options.get("ROT NODE", "")).tolist():
        for k in range(3):
            joins.add([(int(reference[0]), int(reference[0]), np.eye(6)[3 + k]), (turned, turned, -np.eye(6)[k])])
        lone.append(turned)
    return lone


def _rigidly(
    nodes: IntArray, reference: int, unknowns: Iterable[int], sets: DeckSets, joins: _Conditions, *, at_reference: bool = False
) -> list[int]:
    """Nodes move in these unknowns as a body does that moves with the reference node; or (at_reference) as that node itself."""
    bare, turns = ~sets.mesh.held_by(ALL), sets.mesh.held_by(TURNING)
    for node in nodes.tolist():
        for k in unknowns:
            if node != reference and (k <= 3 or bare[node] or turns[node]):  # nodes of solids do not turn
                six = np.eye(6)[k - 1]
                joins.add([(node, node, six), (reference if at_reference else node, reference, -six)])
    return [reference, *nodes[bare[nodes]].tolist()]


def _ties(card: Card, sets: DeckSets, joins: _Conditions) -> None:
    """A node of the first surface moves with what is nearest to it of the second."""
    for words in card.data:
        ends = [sets.nodes_of(word) for word in words[:2]]
        if len(ends) < 2 or not len(ends[0]) or not len(ends[1]):
            joins.unread.append("*TIE")
            continue
        nearest = ends[1][cKDTree(sets.mesh.nodes[ends[1]]).query(sets.mesh.nodes[ends[0]])[1]]
        for node, master in zip(ends[0].tolist(), nearest.tolist(), strict=True):
            for k in range(3):
                joins.add([(node, node, np.eye(6)[k]), (node, master, -np.eye(6)[k])])
