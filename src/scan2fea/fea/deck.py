"""The deck for CalculiX and Abaqus: `ccx -i model` runs it as it is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

import scan2fea
from scan2fea.errors import InternalError, require
from scan2fea.fea.assemble import assemble
from scan2fea.fea.elements import FACES
from scan2fea.fea.loads import gravity_of, nodal_forces, surface_forces
from scan2fea.fea.model import ALL, face_sets
from scan2fea.fea.restrain import inertia_balanced, three_points
from scan2fea.types import FEModel, FloatArray, IntArray, LoadCase, TetMesh
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
        f"supports: {', '.join(f'{name} held in {directions}' for name, directions in model.supports.items())}; load of the first step: self weight",
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


def _case_lines(model: FEModel, case: LoadCase, number: int, units: UnitSystem) -> list[str]:
    """A step of the user's: its loads are spread over faces, and stand here as the forces at the nodes that this means."""
    told = "; ".join(f"{load.kind} {' '.join(f'{v:g}' for v in load.vector.tolist())} on {load.set_name}" for load in case.loads)
    lines = [f"** step {number}: {case.name}: {told} (SI)", "*STEP", "*STATIC"]
    force = surface_forces(model, case)
    if model.is_floating:
        system = assemble(model.mesh, model.material)
        force = inertia_balanced(np.asarray(model.mesh.nodes), system, nodal_forces(model, system, case))
        lines += ["** nothing holds the part: its inertia balances the loads, three nodes fix its place", "*BOUNDARY, OP=NEW"]
        lines += [f"{node + 1}, {axis + 1}, {axis + 1}" for node, axis in np.argwhere(three_points(np.asarray(model.mesh.nodes))).tolist()]
    lines.append("*DLOAD, OP=NEW")
    size, direction = _direction(gravity_of(case))
    if size and not model.is_floating:
        dx, dy, dz = direction.tolist()
        lines.append(f"{BODY}, GRAV, {size * units.acceleration:.10e}, {dx:.10g}, {dy:.10g}, {dz:.10g}")
    rows, axes = np.nonzero(force)
    lines.append("*CLOAD, OP=NEW")
    lines += [f"{n + 1}, {a + 1}, {force[n, a] * units.force:.10e}" for n, a in zip(rows.tolist(), axes.tolist(), strict=True)]
    return [*lines, "*NODE FILE", "U", "*EL FILE", "S", "*END STEP"]


def _axes(directions: str) -> list[int]:
    """1, 2, 3 of the directions; of all of them the first alone, which stands for the range."""
    return [1] if directions == "xyz" else ["xyz".index(d) + 1 for d in directions]


def write_inp(model: FEModel, units: UnitSystem = UNIT_SYSTEMS["m-N-Pa"], lines: Iterable[str] = (), n_modes: int = 4) -> str:
    """The deck as text: mesh, sets, material, supports, self weight (step 1), the user's cases, supported modes (last step).

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
        *(f"{name}, {a}, {a}" if d != "xyz" else f"{name}, 1, 3" for name, d in model.supports.items() for a in _axes(d)),
        "** step 1: self weight",
        "*STEP",
        "*STATIC",
        "*DLOAD",
        f"{BODY}, GRAV, {size * units.acceleration:.10e}, {dx:.10g}, {dy:.10g}, {dz:.10g}",
        "*NODE FILE",
        "U",
        "*EL FILE",
        "S",
        f"*NODE PRINT, NSET={next(iter(model.supports))}, TOTALS=ONLY",
        "RF",
        "*END STEP",
    ]
    for number, case in enumerate(model.cases, start=2):
        text += _case_lines(model, case, number, units)
    text += [
        f"** step {len(model.cases) + 2}: modes of the supported part",
        "*STEP",
        "*FREQUENCY",
        f"{n_modes}",
        "*NODE FILE",
        "U",
        "*END STEP",
    ]
    return "\n".join(text) + "\n"
