"""The deck for Nastran solvers: the same mesh, material, support and self weight (SOL 101; SOL 103 by one line)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from scan2fea.fea.deck import header
from scan2fea.fea.loads import gravity_of, surface_forces
from scan2fea.types import FEModel, LoadCase
from scan2fea.units import UNIT_SYSTEMS, UnitSystem

_PID, _MID, _SPC, _GRAV, _EIGRL = 1, 1, 1, 2, 3
_CASE = 100  # number of the first of the user's load cases; the next ones ten apart


def _small(*fields: object) -> str:
    """One line of fields of 8 characters."""
    return f"{fields[0]:<8}" + "".join(f"{field:>8}" for field in fields[1:])


def _large(name: str, *fields: object) -> str:
    """Two lines of fields of 16 characters: four, then the others."""
    cells = [f"{field:16.9E}" if isinstance(field, float) else f"{field!s:>16}" for field in fields]
    return f"{name + '*':<8}{''.join(cells[:4])}\n{'*':<8}{''.join(cells[4:])}".rstrip(" ")


def _listed(first: list[object], numbers: list[int]) -> list[str]:
    """A card whose list goes on over lines of 8 fields."""
    head = 9 - len(first)
    lines = [_small(*first, *numbers[:head])]
    return lines + [_small("", *numbers[k : k + 8]) for k in range(head, len(numbers), 8)]


def _case_lines(model: FEModel, case: LoadCase, number: int, units: UnitSystem) -> list[str]:
    """LOAD number of FORCE cards (number + 1) and GRAV (number + 2)."""
    force = surface_forces(model, case) * units.force
    lines, parts = [], []
    for node in np.flatnonzero(np.abs(force).max(axis=1) > 0).tolist():
        lines.append(_large("FORCE", number + 1, node + 1, 0, 1.0, *force[node].tolist()))
    parts += ["1.", number + 1] if lines else []
    acceleration = gravity_of(case)
    size = float(np.linalg.norm(acceleration))
    if size:
        lines.append(_large("GRAV", number + 2, 0, size * units.acceleration, *(acceleration / size).tolist()))
        parts += ["1.", number + 2]
    return [*lines, _small("LOAD", number, "1.", *parts)]


def write_bdf(model: FEModel, units: UnitSystem = UNIT_SYSTEMS["m-N-Pa"], lines: Iterable[str] = (), n_modes: int = 4) -> str:
    """The deck as text, in fixed fields (coordinates in large fields, 10 digits).

    CTETRA takes its middle nodes in the order 12 23 13 14 24 34, which is that of `TetMesh`. Node sets of CAD faces are SETs of the
    case control. The same model gives the same text.
    """
    mesh, material = model.mesh, model.material
    size = float(np.linalg.norm(model.acceleration_m_s2))
    direction = model.acceleration_m_s2 / size if size else np.array([0.0, 0.0, -1.0])
    text = header(model, units, "$", ("static: SOL 101 as it stands; modes of the supported part: put SOL 103", *lines))
    text += ["SOL 101", "CEND", "TITLE = SCAN2FEA", f"SPC = {_SPC}", f"LOAD = {_GRAV}", f"METHOD = {_EIGRL}", "DISPLACEMENT = ALL", "SPCFORCES = ALL"]
    cases = () if model.is_floating else model.cases
    if model.is_floating and model.cases:
        text.insert(text.index("SOL 101"), "$ the cases without supports are in model.inp alone: put PARAM,INREL,-2 here for them")
    for number, (name, nodes) in enumerate(((n, k) for n, k in model.node_sets.items() if n != "ALL"), start=1):
        rows = [str(k) for k in (nodes + 1).tolist()]
        cut = [", ".join(rows[k : k + 7]) for k in range(0, len(rows), 7)]
        text += [f"$ SET {number}: {name}", f"SET {number} = " + ",\n      ".join(cut)]
    if cases:
        text += ["SUBCASE 1", "  SUBTITLE = SELF_WEIGHT", f"  LOAD = {_GRAV}"]
        for k, case in enumerate(cases):
            text += [f"SUBCASE {k + 2}", f"  SUBTITLE = {case.name.upper()}", f"  LOAD = {_CASE + 10 * k}"]
    text += ["BEGIN BULK", "PARAM   POST    -1"]
    text += [_large("GRID", k, "", *xyz) for k, xyz in enumerate((mesh.nodes * units.length).tolist(), start=1)]
    for k, tet in enumerate((mesh.tets + 1).tolist(), start=1):
        text += _listed(["CTETRA", k, _PID], tet)
    text.append(_small("PSOLID", _PID, _MID))
    text.append(_large("MAT1", _MID, material.youngs_pa * units.pressure, "", float(material.poisson), material.density_kg_m3 * units.density))
    for name, directions in model.supports.items():
        text += _listed(["SPC1", _SPC, "".join(str("xyz".index(d) + 1) for d in directions)], (model.node_sets[name] + 1).tolist())
    text.append(_large("GRAV", _GRAV, 0, size * units.acceleration, *direction.tolist()))
    for k, case in enumerate(cases):
        text += _case_lines(model, case, _CASE + 10 * k, units)
    text.append(_small("EIGRL", _EIGRL, "", "", n_modes))
    text.append("ENDDATA")
    return "\n".join(text) + "\n"
