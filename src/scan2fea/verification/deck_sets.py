"""The sets of a deck: names to numbers of nodes and elements, and the directions in which the unknowns of a node point."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.types import BoolArray, FloatArray, IntArray, Value
from scan2fea.verification.cards import Card

TET_FACES = {"S1": (0, 1, 2), "S2": (0, 1, 3), "S3": (1, 2, 3), "S4": (0, 2, 3)}


@dataclass(frozen=True, eq=False, kw_only=True)
class DeckMesh(Value):
    """nodes : (n, 3), by rising `numbers` (n,).   cells : (kind, (m, k) rows of nodes) of each card *ELEMENT in order.   cell_numbers : theirs."""

    nodes: FloatArray
    numbers: IntArray
    cells: tuple[tuple[str, IntArray], ...]
    cell_numbers: tuple[IntArray, ...]

    def rows(self, numbers: IntArray) -> IntArray:
        """Of node numbers; those that are not there are left out."""
        place = np.minimum(np.searchsorted(self.numbers, numbers), len(self.numbers) - 1)
        return np.asarray(place[self.numbers[place] == numbers])

    def held_by(self, kinds: Container[str]) -> BoolArray:
        """(n,) nodes of elements of these kinds."""
        out = np.zeros(len(self.nodes), bool)
        for kind, rows in self.cells:
            if kind in kinds:
                out[rows.ravel()] = True
        return out


@dataclass(frozen=True, eq=False, kw_only=True)
class DeckSets(Value):
    """By upper-case name: rows of nodes of node sets and of surfaces (corners of tets; all nodes of shells and beams), numbers of elements."""

    mesh: DeckMesh
    nodes: Mapping[str, IntArray]
    elements: Mapping[str, IntArray]
    surfaces: Mapping[str, IntArray]

    def of_elements(self, numbers: IntArray) -> IntArray:
        """Rows of the nodes of these elements."""
        own = [rows[np.isin(block, numbers)].ravel() for (_, rows), block in zip(self.mesh.cells, self.mesh.cell_numbers, strict=True)]
        return np.unique(np.concatenate(own or [_none()]))

    def nodes_of(self, word: str) -> IntArray:
        """Rows of a node, of a node set or of a surface; none where it is not there."""
        if word.isdigit():
            return self.mesh.rows(np.array([int(word)]))
        name = _name(word)
        for named in (self.nodes, self.surfaces):
            if (found := _found(named, name)) is not None:
                return found
        return _none()


def sets_of(cards: Sequence[Card], mesh: DeckMesh) -> DeckSets:
    """Sets are read in the order of the cards; members of a set may be sets before it."""
    nodes: dict[str, list[IntArray]] = {}
    elements: dict[str, list[IntArray]] = {}
    surfaces: dict[str, list[IntArray]] = {}
    blocks = iter(mesh.cell_numbers)
    for card in cards:
        if card.word == "NODE" and "NSET" in card.options:
            own = np.array([int(float(row[0])) for row in card.data if row[0]], np.int64)
            nodes.setdefault(card.options["NSET"], []).append(mesh.rows(own))
        elif card.word == "ELEMENT":
            numbers = next(blocks)
            if "ELSET" in card.options:
                elements.setdefault(card.options["ELSET"], []).append(numbers)
        elif card.word in ("NSET", "ELSET", "SURFACE"):
            so_far = DeckSets(mesh=mesh, nodes=_joined(nodes), elements=_joined(elements), surfaces={})
            kind, read = {"NSET": (nodes, _node_set), "ELSET": (elements, _element_set), "SURFACE": (surfaces, _surface)}[card.word]
            kind.setdefault(card.options.get("NAME" if card.word == "SURFACE" else card.word, ""), []).append(read(card, so_far))
    return DeckSets(mesh=mesh, nodes=_joined(nodes), elements=_joined(elements), surfaces=_joined(surfaces))


def _joined(sets: Mapping[str, list[IntArray]]) -> dict[str, IntArray]:
    return {name: np.unique(np.concatenate(parts)) for name, parts in sets.items()}


def _none() -> IntArray:
    return np.zeros(0, np.int64)


def _name(word: str) -> str:
    return word.strip().strip('"').upper()


def _found(sets: Mapping[str, IntArray], name: str) -> IntArray | None:
    """Of an assembly's set of a part (PART-1.FOOT) the part's."""
    return sets.get(name, sets.get(name.rpartition(".")[2]))


def _members(card: Card, sets: Mapping[str, IntArray]) -> IntArray:
    """Numbers of a card *NSET or *ELSET: first, last, step where it says GENERATE, else numbers and names of sets."""
    if "GENERATE" in card.options:
        spans = [[int(word) for word in row if word] for row in card.data]
        return np.concatenate([np.arange(s[0], s[1] + 1, s[2] if len(s) > 2 else 1) for s in spans if len(s) > 1] or [_none()])
    words = [word.rpartition(".")[2] if word.rpartition(".")[2].isdigit() else word for row in card.data for word in row if word]
    numbers = np.array([int(word) for word in words if word.isdigit()], np.int64)
    named = [found for word in words if not word.isdigit() and (found := _found(sets, _name(word))) is not None]
    return np.concatenate([numbers, *named])


def _element_set(card: Card, sets: DeckSets) -> IntArray:
    return _members(card, sets.elements)


def _node_set(card: Card, sets: DeckSets) -> IntArray:
    if "ELSET" in card.options:
        found = _found(sets.elements, card.options["ELSET"])
        return _none() if found is None else sets.of_elements(found)
    named = {word for row in card.data for word in row if word and not word[0].isdigit()}
    known = {name: sets.mesh.numbers[rows] for name, rows in sets.nodes.items()} if named else {}
    return sets.mesh.rows(_members(card, known))


def _surface(card: Card, sets: DeckSets) -> IntArray:
    if card.options.get("TYPE", "ELEMENT") == "NODE":
        return np.concatenate([sets.nodes_of(row[0]) for row in card.data if row and row[0]] or [_none()])
    by_side: dict[str, list[IntArray]] = {}
    for row in card.data:
        found = np.array([int(row[0])]) if row[0].isdigit() else _found(sets.elements, _name(row[0]))
        if found is not None:
            by_side.setdefault(row[1].upper() if len(row) > 1 else "", []).append(found)
    out = [_none()]
    for side, parts in by_side.items():
        numbers = np.concatenate(parts)
        for (kind, rows), block in zip(sets.mesh.cells, sets.mesh.cell_numbers, strict=True):
            corners = rows[np.isin(block, numbers)]
            out.append((corners[:, TET_FACES[side]] if kind.startswith("tet") and side in TET_FACES else corners).ravel())
    return np.unique(np.concatenate(out))


def directions(cards: Sequence[Card], sets: DeckSets) -> FloatArray:
    """(n, 3, 3) rows: the directions 1, 2, 3 of each node's unknowns (*TRANSFORM: rectangular, cylindrical or spherical)."""
    nodes = sets.mesh.nodes
    out = np.tile(np.eye(3), (len(nodes), 1, 1))
    for card in cards:
        if card.word != "TRANSFORM" or not card.data:
            continue
        a, b = np.array([float(word) for word in card.data[0][:6]]).reshape(2, 3)
        rows = sets.nodes_of(card.options.get("NSET", ""))
        kind = card.options.get("TYPE", "R")
        if kind == "R":
            z = np.cross(a, b)
            out[rows] = _unit(np.stack([a, np.cross(z, a), z]))
            continue
        axis = _unit(b - a)
        away = nodes[rows] - a
        radial = away if kind == "S" else away - (away @ axis)[:, None] * axis
        around = np.cross(axis, radial)
        third = np.cross(radial, around)
        frame = _unit(np.stack([radial, around, third], axis=1))
        on_axis = np.linalg.norm(np.cross(away, axis), axis=1) < 1e-9 * np.linalg.norm(np.ptp(nodes, axis=0))
        out[rows[~on_axis]] = frame[~on_axis]  # there is no radius on the axis: as without *TRANSFORM
    return out


def _unit(v: FloatArray) -> FloatArray:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300))
