"""`scan2fea check FILE`: a mesh, a deck or a STEP file of any tool, measured."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from scan2fea.cad.readback import read_back
from scan2fea.errors import CadError, FormatError, InputError, require
from scan2fea.io import read_mesh
from scan2fea.io.bdf import read_bdf
from scan2fea.io.files import existing_file
from scan2fea.io.inp import read_inp
from scan2fea.io.volume import mesh_of, require_sound
from scan2fea.units import UNIT_SYSTEMS
from scan2fea.verification.cards import cards_of
from scan2fea.verification.deck import deck_checks
from scan2fea.verification.deck_sets import DeckMesh
from scan2fea.verification.inspect import Inspection, inspect
from scan2fea.verification.nastran import cards_of_nastran
from scan2fea.verification.step import step_checks
from scan2fea.verification.walls_and_bars import of_walls_and_bars

STEP_SUFFIXES, NASTRAN_SUFFIXES = (".step", ".stp"), (".bdf", ".nas")
LARGEST = 1 << 29  # bytes of a STEP file


def inspect_file(path: Path) -> Inspection:
    """Raises InputError in one line for a file that cannot be read."""
    suffix = path.suffix.lower()
    if suffix in STEP_SUFFIXES:
        return _of_step(path)
    return _of_deck(path) if suffix in (".inp", *NASTRAN_SUFFIXES) else inspect(read_mesh(path))


def _of_deck(path: Path) -> Inspection:
    """Of solids as their mesh; of shells and beams (no tets) what these have. In metres, unless our comment tells the units."""
    size = existing_file(path)
    nastran = read_bdf(path, size) if path.suffix.lower() in NASTRAN_SUFFIXES else None
    blocks = nastran.blocks if nastran else read_inp(path, size)
    text = path.read_text(encoding="utf-8", errors="replace")
    told = re.search(r"^(?:\*\*|\$) units: (\S+)", text, re.MULTILINE)
    metres = 1.0 / UNIT_SYSTEMS[told.group(1)].length if told and told.group(1) in UNIT_SYSTEMS else 1.0
    kinds = [kind for kind, _, _ in blocks.cells]
    thin = nastran or re.search(r"^\*(SHELL|BEAM)( GENERAL)? SECTION", text, re.IGNORECASE | re.MULTILINE)
    if thin and not any(kind.startswith("tet") for kind in kinds):
        require_sound(blocks)
        found = of_walls_and_bars(blocks.nodes * metres, [(kind, rows) for kind, rows, _ in blocks.cells])
    else:
        found = inspect(mesh_of(blocks, metres))
    cells = tuple((kind, rows) for kind, rows, _ in blocks.cells)
    mesh = DeckMesh(nodes=blocks.nodes, numbers=blocks.node_numbers, cells=cells, cell_numbers=blocks.cell_numbers)
    try:
        cards = cards_of_nastran(nastran.control, nastran.bulk, kinds) if nastran else cards_of(text)
        checks = deck_checks(cards, mesh)
    except (ValueError, IndexError) as error:  # a number or a word that is missing, or is none, in any of the cards that say what holds
        raise FormatError(f"{path}: a line of its supports, sets or conditions cannot be read ({error}): correct it") from error
    return replace(found, checks=(*found.checks, *checks))


def _of_step(path: Path) -> Inspection:
    size = existing_file(path)
    require(size <= LARGEST, InputError, f"{path} has {size} bytes, at most {LARGEST} are read")
    text = path.read_text(encoding="ascii", errors="replace")
    require("ISO-10303-21" in text[:2000], InputError, f"{path}: is no STEP file (ISO-10303-21 is missing at its head)")
    try:
        found = read_back(text.encode("ascii", "replace").decode("ascii"))
    except CadError as error:
        raise InputError(f"{path}: {error}") from error
    figures = {"solids": float(found.n_solids), "faces": float(len(found.face_area)), "volume_m3": found.volume_m3, "area_m2": found.area_m2}
    checks = step_checks(found.n_solids, found.is_valid, found.n_free_edges, found.volume_m3)
    return Inspection(figures=figures, quality={}, worst={}, limits={}, checks=checks)
