"""The members of a scene as ONE connected model of beams: built in where it stands, under its own weight; its deck (assembly_beam.inp)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import scan2fea
from scan2fea.errors import SolveError, require
from scan2fea.fea.beam import Beams, assemble_beams, frequencies, solve_beams
from scan2fea.fea.materials import chosen_material
from scan2fea.fea.model import down_axis
from scan2fea.fea.options import FeaOptions
from scan2fea.fea.section_properties import SectionProperties, properties_of
from scan2fea.types import FloatArray, IntArray, Value
from scan2fea.units import UNIT_SYSTEMS, UnitSystem

PARTS = 8  # beam elements of each stretch between joints
# short at both ends: CalculiX's beams (2.20) hold a thirtieth of an element beside a support or joint stiff (a cantilever of six even ones is
# 2.6 to 5.6 % stiffer than beam theory, one of these 0.8 to 2.5; the rest is shear, which its solids take as even, and the held root)
PLACES = (1 - np.cos(np.pi * np.arange(1, PARTS) / PARTS)) / 2
N_MODES = 6
MAX_UNKNOWNS = 6_000  # of a dense solution: some 800 beam elements
CALCULIX = ("rect", "round", "CHS", "RHS")  # sections that it has beams for; its element U1 bends about one axis alone (2.20) and twists by I11 + I22


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameModel(Value):
    """beams, and of each of their sections the family and dimensions.   held : nodes that are built in.   pieces : parts that nothing joins."""

    beams: Beams
    families: tuple[str, ...]
    dimensions: tuple[Mapping[str, float], ...]
    held: IntArray
    n_pieces: int
    acceleration_m_s2: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameResult(Value):
    """displacement_m : (n, 6) of the nodes, rotations last.   frequencies_hz : of the frame as it stands.   reaction_n, weight_n : (3,), and their
    sizes agree to rounding.
    """

    displacement_m: FloatArray
    frequencies_hz: FloatArray
    reaction_n: FloatArray
    weight_n: FloatArray
    n_dof: int


def frame_model(
    nodes: FloatArray,
    elements: IntArray,
    member: IntArray,
    up: FloatArray,
    sections: Sequence[tuple[str, Mapping[str, float]]],
    section_of_member: IntArray,
    options: FeaOptions,
) -> FrameModel:
    """Beams between the joints of a wireframe.

    nodes : (n, 3).   elements : (m, 2).   member : (m,) of each element.   up : (members, 3) y axis of its section.   sections : family, dimensions.
    Nodes within `support_band` of the height (and the reach of a section) above the lowest are built in, of every piece its lowest at least.
    """
    points, beams_of, chain, axes, kind = [*nodes], [], [], [], []
    for row, (a, b) in enumerate(elements.tolist()):
        along = nodes[b] - nodes[a]
        length = float(np.linalg.norm(along))
        require(length > 0, SolveError, f"stretch {row} of the frame has no length")
        frame = _axes(along / length, up[member[row]])
        inner = [len(points) + k for k in range(PARTS - 1)]
        points += [nodes[a] + along * t for t in PLACES]
        chainlet = [a, *inner, b]
        beams_of += list(itertools.pairwise(chainlet))
        chain += [int(member[row])] * PARTS
        axes += [frame] * PARTS
        kind += [int(section_of_member[member[row]])] * PARTS
    require(beams_of, SolveError, "the frame has no members")
    own = tuple(properties_of(family, values) for family, values in sections)
    down = down_axis(options)
    beams = Beams(
        nodes=np.array(points),
        elements=np.array(beams_of, np.int64),
        axes=np.array(axes),
        section=np.array(kind, np.int64),
        chain=np.array(chain, np.int64),
        sections=own,
        material=chosen_material(options),
    )
    held, n_pieces = _standing(beams, len(nodes), down, options.support_band)
    return FrameModel(
        beams=beams, families=tuple(f for f, _ in sections), dimensions=tuple(dict(v) for _, v in sections), held=held, n_pieces=n_pieces,
        acceleration_m_s2=options.gravity_m_s2 * down,
    )  # fmt: skip


def _axes(along: FloatArray, up: FloatArray) -> FloatArray:
    y = up - (up @ along) * along
    size = float(np.linalg.norm(y))
    if size < 1e-6:  # the section's y axis runs along the member: any will do
        y = np.eye(3)[int(np.argmin(np.abs(along)))]
        y = y - (y @ along) * along
        size = float(np.linalg.norm(y))
    y = y / size
    return np.stack([np.cross(y, along), y, along], axis=1)


def _standing(beams: Beams, n_joints: int, down: FloatArray, band: float) -> tuple[IntArray, int]:
    """(joints that are built in, number of pieces)."""
    root = np.arange(len(beams.nodes))

    def find(k: int) -> int:
        while root[k] != k:
            root[k] = root[root[k]]
            k = int(root[k])
        return k

    for a, b in beams.elements.tolist():
        low, high = sorted((find(a), find(b)))
        root[high] = low
    piece = np.array([find(k) for k in range(len(beams.nodes))])
    depth = beams.nodes @ down
    reach = max(float(p.reach.max()) for p in beams.sections)
    height = float(np.ptp(depth))
    held = []
    for k in np.unique(piece):
        own = np.flatnonzero((piece == k) & (np.arange(len(piece)) < n_joints))
        lowest = float(depth[own].max())
        held += own[depth[own] >= lowest - max(band * height, reach)].tolist()
    return np.array(sorted(held), np.int64), len(np.unique(piece))


def solve_frame(model: FrameModel) -> FrameResult:
    """The frame under its own weight, and its frequencies. Raises SolveError where it is too large or can move."""
    matrices = assemble_beams(model.beams)
    n_dof = len(matrices.stiffness)
    require(n_dof <= MAX_UNKNOWNS, SolveError, f"the frame has {n_dof} unknowns, at most {MAX_UNKNOWNS} are solved")
    held = np.zeros(n_dof, bool)
    held[(6 * model.held[:, None] + np.arange(6)).ravel()] = True
    field = np.zeros((n_dof, 1))
    six = field[: 6 * len(model.beams.nodes), 0].reshape(-1, 6)
    six[:, :3] = model.acceleration_m_s2
    force = matrices.mass @ field
    u = solve_beams(matrices, held, force)
    hertz = frequencies(matrices, held, N_MODES)[0]
    size = 6 * len(model.beams.nodes)
    reaction = ((matrices.stiffness @ u - force)[:size, 0] * held[:size]).reshape(-1, 6)[:, :3].sum(axis=0)
    return FrameResult(
        displacement_m=u[:size, 0].reshape(-1, 6),
        frequencies_hz=hertz,
        reaction_n=reaction,
        weight_n=force[:size, 0].reshape(-1, 6)[:, :3].sum(axis=0),
        n_dof=n_dof,
    )


def runs_in_calculix(model: FrameModel) -> bool:
    return all(family in CALCULIX for family in model.families)


def write_frame_inp(model: FrameModel, units: UnitSystem = UNIT_SYSTEMS["m-N-Pa"]) -> str:
    """The deck as text: B32R of the shapes that CalculiX and Abaqus both have, else *BEAM GENERAL SECTION, which Abaqus has.

    Elements have a node in their middle; the first is the joint's or the beam's own. The same model gives the same text.
    """
    both = runs_in_calculix(model)
    beams = model.beams
    material = beams.material
    told = "run: ccx -i JOB  (or Abaqus)" if both else "run: abaqus job=JOB"
    if both and "round" in model.families:
        told += "; round bars: CalculiX reads two diameters, for Abaqus put one radius in their place"
    if not both:
        told += "   (CalculiX has no beams of L, I, C and T sections: this frame is solved embedded)"
    stiffer = ["** CalculiX 2.20 is up to 4 % stiffer on it than beam theory: shear even over the section, a held root that cannot breathe"]
    lines = [
        f"** scan2fea {scan2fea.__version__}",
        f"** units: {units.name}",
        f"** {told}",
        *(stiffer if both else []),
        f"** {len(set(beams.chain.tolist()))} members in {model.n_pieces} pieces, {len(beams.elements)} elements; axes straight, joints rigid",
        "*NODE, NSET=ALL",
    ]
    middle = beams.nodes[beams.elements].mean(axis=1)
    places = np.concatenate([beams.nodes, middle]) * units.length
    lines += [f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in enumerate(places.tolist(), start=1)]
    groups: dict[tuple[int, int], list[int]] = {}
    for row, (member, kind) in enumerate(zip(beams.chain.tolist(), beams.section.tolist(), strict=True)):
        groups.setdefault((member, kind), []).append(row)
    stretches = _stretches(beams, groups)
    shape = "B32R" if both else "B32"  # CalculiX makes solids of beams: with full integration they are 8 % too stiff
    n = len(beams.nodes)
    for number, (_, rows) in enumerate(stretches, start=1):
        lines.append(f"*ELEMENT, TYPE={shape}, ELSET=MEMBER_{number:02d}")
        lines += [f"{row + 1}, {beams.elements[row, 0] + 1}, {n + row + 1}, {beams.elements[row, 1] + 1}" for row in rows]
    lines += ["*MATERIAL, NAME=MATERIAL", "*ELASTIC", f"{material.youngs_pa * units.pressure:.10e}, {material.poisson:.10g}"]
    lines += ["*DENSITY", f"{material.density_kg_m3 * units.density:.10e}"]
    for number, (kind, rows) in enumerate(stretches, start=1):
        x = beams.axes[rows[0], :, 0]
        direction = ", ".join(f"{c:.10g}" for c in x.tolist())
        name = f"ELSET=MEMBER_{number:02d}, MATERIAL=MATERIAL"
        values = {key: v * units.length for key, v in model.dimensions[kind].items()}
        section = _shape_lines(model.families[kind], values) if both else _general_lines(beams.sections[kind], units)
        general = f"*BEAM GENERAL SECTION, SECTION=GENERAL, {_named(number, material.density_kg_m3 * units.density)}"
        lines += [f"{section[0]}, {name}" if both else general]
        lines += [section[1], direction] if both else [section[1], direction, _elastic(material.youngs_pa, material.poisson, units)]
    lines += _turned_supports(model) if both else []
    lines += ["*BOUNDARY", *(f"{node + 1}, 1, 6" for node in model.held.tolist())]
    size = float(np.linalg.norm(model.acceleration_m_s2))
    dx, dy, dz = (model.acceleration_m_s2 / size).tolist()
    weight = [f"MEMBER_{k:02d}, GRAV, {size * units.acceleration:.10e}, {dx:.10g}, {dy:.10g}, {dz:.10g}" for k in range(1, len(stretches) + 1)]
    lines += ["** step 1: self weight", "*STEP", "*STATIC", "*DLOAD", *weight, "*NODE FILE, OUTPUT=2D" if both else "*NODE FILE", "U", "*END STEP"]
    lines += ["** step 2: modes", "*STEP", "*FREQUENCY", str(N_MODES), "*NODE FILE, OUTPUT=2D" if both else "*NODE FILE", "U", "*END STEP"]
    return "\n".join(lines) + "\n"


def _turned_supports(model: FrameModel) -> list[str]:
    """The directions of the supports along the member that ends there: about those of space CalculiX 2.20 holds the turns of a node of one beam
    softly (a tube that leans had a first frequency 7 % low, another 15 %, where they are all held). Nodes of several beams are rigid to it anyway.
    """
    beams = model.beams
    lines = []
    for node in model.held.tolist():
        rows = np.flatnonzero((beams.elements == node).any(axis=1))
        if len(rows) == 1:
            x, y = (", ".join(f"{c:.10g}" for c in beams.axes[rows[0], :, k].tolist()) for k in (0, 1))
            lines += [f"*NSET, NSET=HELD_{node + 1}", f"{node + 1}", f"*TRANSFORM, NSET=HELD_{node + 1}, TYPE=R", f"{x}, {y}"]
    return lines


def _stretches(beams: Beams, groups: Mapping[tuple[int, int], list[int]]) -> list[tuple[int, list[int]]]:
    """(section, rows) of elements that share a member, a section and axes."""
    out: list[tuple[int, list[int]]] = []
    for (_, kind), rows in groups.items():
        for row in rows:
            if out and out[-1][0] == kind and row - 1 == out[-1][1][-1] and np.allclose(beams.axes[row], beams.axes[out[-1][1][0]], atol=1e-9):
                out[-1][1].append(row)
            else:
                out.append((kind, [row]))
    return out


def _shape_lines(family: str, d: Mapping[str, float]) -> tuple[str, str]:
    """Keyword and dimensions; the first axis is x of the section."""
    if family == "rect":
        return "*BEAM SECTION, SECTION=RECT", f"{d['b']:.10e}, {d['t']:.10e}"
    if family == "round":
        return "*BEAM SECTION, SECTION=CIRC", f"{d['d']:.10e}, {d['d']:.10e}"  # CalculiX reads diameters, Abaqus one radius: the head says so
    if family == "CHS":
        return "*BEAM SECTION, SECTION=PIPE", f"{d['d'] / 2:.10e}, {d['t']:.10e}"
    return "*BEAM SECTION, SECTION=BOX", f"{d['b']:.10e}, {d['h']:.10e}, " + ", ".join([f"{d['t']:.10e}"] * 4)


def _general_lines(p: SectionProperties, units: UnitSystem) -> tuple[str, str]:
    """Area, moments about x and y of the section, torsion constant, sectorial moment (none), warping constant."""
    length = units.length
    figures = [p.area * length**2, p.ixx * length**4, p.ixy * length**4, p.iyy * length**4, p.j * length**4, 0.0, p.warping * length**6]
    return "", ", ".join(f"{f:.8e}" for f in figures)


def _named(number: int, density: float) -> str:
    return f"ELSET=MEMBER_{number:02d}, DENSITY={density:.8e}"


def _elastic(youngs_pa: float, poisson: float, units: UnitSystem) -> str:
    return f"{youngs_pa * units.pressure:.10e}, {youngs_pa * units.pressure / (2 * (1 + poisson)):.10e}"


def frame_result_rows(model: FrameModel, result: FrameResult) -> dict[str, Any]:
    """The frame in report.json."""
    size = np.linalg.norm(result.displacement_m[:, :3], axis=1)
    weight = float(np.linalg.norm(result.weight_n))
    return {
        "n_members": len(set(model.beams.chain.tolist())),
        "n_pieces": model.n_pieces,
        "n_elements": len(model.beams.elements),
        "dof": result.n_dof,
        "n_built_in": len(model.held),
        "displacement_max_m": float(size.max()),
        "reaction_n": float(np.linalg.norm(result.reaction_n)),
        "weight_n": weight,
        "unbalanced": float(np.linalg.norm(result.reaction_n + result.weight_n)) / weight if weight else math.nan,
        "frequencies_hz": [float(f) for f in result.frequencies_hz],
        "runs_in_calculix": runs_in_calculix(model),
    }
