"""The deck for CalculiX and Abaqus: `ccx -i model` runs it as it is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

import scan2fea
from scan2fea.errors import InternalError, require
from scan2fea.fea.elements import FACES
from scan2fea.fea.model import ALL, LOWEST, face_sets
from scan2fea.types import FEModel, FloatArray, IntArray, TetMesh
from scan2fea.units import UNIT_SYSTEMS, UnitSystem

BODY, MATERIAL = "BODY", "MATERIAL"
PER_LINE = 12  # both solvers take 16 entries in a data line


def _rows(numbers: Sequence[int] | IntArray) -> list[str]:
    """Numbers in lines of `PER_LINE`; a line that goes on ends with a comma."""
    listed = [str(k) for k in np.asarray(numbers).tolist()]
    lines = [", ".join(listed[k : k + PER_LINE]) for k in range(0, len(listed), PER_LINE)]
    return [line + "," for line in lines[:-1]] + lines[-1:]


def element_faces(mesh: TetMesh) -> IntArray:
    """(k, 2) element (from 0) and its face (0 for S1 ... 3 for S4) of each boundary triangle.

    Raises InternalError where a boundary triangle is the face of no element.
    """
    n = len(mesh.nodes)
    corners = np.sort(mesh.tets[:, :4][:, np.array(FACES)].reshape(-1, 3), axis=1)
    wanted = np.sort(mesh.boundary[:, :3], axis=1)
    keys, sought = ((c[:, 0] * n + c[:, 1]) * n + c[:, 2] for c in (corners, wanted))
    order = np.argsort(keys, kind="stable")
    place = np.minimum(np.searchsorted(keys[order], sought), len(keys) - 1)
    found = order[place]
    require((keys[found] == sought).all(), InternalError, "a boundary triangle of the mesh is the face of no element")
    return np.stack([found // 4, found % 4], axis=1)


def header(model: FEModel, units: UnitSystem, comment: str, lines: Iterable[str]) -> list[str]:
    """Comment lines that both decks begin with."""
    base = {"m-N-Pa": "m, N, Pa, kg, s", "mm-N-MPa": "mm, N, MPa, t, s", "in-lbf-psi": "in, lbf, psi, lbf s2/in, s"}[units.name]
    mesh, material = model.mesh, model.material
    told = [
        f"scan2fea {scan2fea.__version__}",
        f"units: {units.name} ({base})",
        f"{len(mesh.nodes)} nodes, {len(mesh.tets)} tetrahedra of order {mesh.order}",
        f"material: {material.name}; {material.source}",
        f"support: node set {model.support} is held in x, y and z; load: self weight",
        *lines,
    ]
    return [f"{comment} {line}" for line in told]


def _mesh_lines(mesh: TetMesh, units: UnitSystem) -> list[str]:
    xyz = mesh.nodes * units.length
    lines = [f"*NODE, NSET={ALL}"]
    lines += [f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in enumerate(xyz.tolist(), start=1)]
    lines.append(f"*ELEMENT, TYPE={'C3D4' if mesh.order == 1 else 'C3D10'}, ELSET={BODY}")
    lines += [", ".join(map(str, row)) for row in np.c_[np.arange(1, len(mesh.tets) + 1), mesh.tets + 1].tolist()]
    return lines


def _set_lines(model: FEModel) -> list[str]:
    """Node sets, and one element surface for each CAD face."""
    lines = []
    for name, nodes in model.node_sets.items():
        if name != ALL:
            lines += [f"*NSET, NSET={name}", *_rows(nodes + 1)]
    names, number = face_sets(model.mesh)
    sides = element_faces(model.mesh) + 1
    for k, name in enumerate(names):
        lines.append(f"*SURFACE, NAME={name}, TYPE=ELEMENT")
        lines += [f"{element}, S{side}" for element, side in sides[number == k].tolist()]
    return lines


def _direction(acceleration: FloatArray) -> tuple[float, FloatArray]:
    size = float(np.linalg.norm(acceleration))
    return size, acceleration / size if size else np.array([0.0, 0.0, -1.0])


def write_inp(model: FEModel, units: UnitSystem = UNIT_SYSTEMS["m-N-Pa"], lines: Iterable[str] = (), n_modes: int = 4) -> str:
    """The deck as text: mesh, sets, material, support, self weight (step 1), supported modes (step 2).

    lines : further comment lines. Names are at most 80 characters, entries at most 20 (CalculiX reads no more), C3D10 in the order of
    `TetMesh`. The same model gives the same text. Raises InternalError where the boundary is not that of the elements.
    """
    material = model.material
    size, direction = _direction(model.acceleration_m_s2)
    dx, dy, dz = direction.tolist()
    text = header(model, units, "**", ("run: ccx -i model   (CalculiX 2.20 or later; Abaqus: abaqus job=model)", *lines))
    text += _mesh_lines(model.mesh, units)
    text += _set_lines(model)
    text += [
        f"*MATERIAL, NAME={MATERIAL}",
        "*ELASTIC",
        f"{material.youngs_pa * units.pressure:.10e}, {material.poisson:.10g}",
        "*DENSITY",
        f"{material.density_kg_m3 * units.density:.10e}",
        f"*SOLID SECTION, ELSET={BODY}, MATERIAL={MATERIAL}",
        "*BOUNDARY",
        f"{model.support}, 1, 3",
        "** step 1: self weight",
        "*STEP",
        "*STATIC",
        "*DLOAD",
        f"{BODY}, GRAV, {size * units.acceleration:.10e}, {dx:.10g}, {dy:.10g}, {dz:.10g}",
        "*NODE FILE",
        "U",
        "*EL FILE",
        "S",
        f"*NODE PRINT, NSET={LOWEST if LOWEST in model.node_sets else model.support}, TOTALS=ONLY",
        "RF",
        "*END STEP",
        "** step 2: modes of the supported part",
        "*STEP",
        "*FREQUENCY",
        f"{n_modes}",
        "*NODE FILE",
        "U",
        "*END STEP",
    ]
    return "\n".join(text) + "\n"
