"""A thin-walled member as shells on the middles of its walls, and its deck (model_shell.inp): S8R, which CalculiX and Abaqus both have.

Walls meet in the lines where their middles cross; the thickness of each wall is that of the member. Held at its first end, under its own weight,
pulled, bent about both axes and twisted at its last, and its modes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import scan2fea
from scan2fea.errors import SolveError, require
from scan2fea.fea.materials import chosen_material
from scan2fea.fea.model import down_axis
from scan2fea.fea.options import FeaOptions
from scan2fea.kernel.sweep import sweep_of, swept_points
from scan2fea.types import FloatArray, IntArray, Member, Value
from scan2fea.units import UNIT_SYSTEMS, UnitSystem

FIRST, LAST = "END_FIRST", "END_LAST"
ACROSS = 2  # elements across the narrowest wall; a wider wall has as many as keep them about as wide
ROUND_ABOUT = 16  # elements round a tube
LONG = 3.0  # length of an element over its width: it bends little along the member
THIN = 4.0  # a wall is a shell where it is this many times wider than thick
SAME = 1e-9  # of the length: points of two walls that are one
EDGE_SHARES = np.array([1, 4, 1]) / 6  # of an even load on the edge of an element with a node in its middle


@dataclass(frozen=True, eq=False, kw_only=True)
class ShellModel(Value):
    """nodes : (n, 3) metres.   elements : (m, 8) corners, then the nodes between them.   wall : (m,) row of `thickness_m`.

    first, last : nodes of the ends.   weight : (len(last),) of each node of the last end, its share of the section's area.
    axes : (3, 3), columns x, y of the section and z along the member.
    """

    nodes: FloatArray
    elements: IntArray
    wall: IntArray
    thickness_m: FloatArray
    first: IntArray
    last: IntArray
    weight: FloatArray
    axes: FloatArray


def middle_lines(family: str, d: Mapping[str, float]) -> list[tuple[FloatArray, float]]:
    """((2, 2) ends of the middle of each wall in the frame of kernel.sections, its thickness); a wall is cut where another ends on it.

    Raises SolveError for families that have no walls (round bars) and for tubes, whose middle is a circle.
    """
    if family == "rect":
        parts = [((-d["b"] / 2, 0.0), (d["b"] / 2, 0.0), d["t"])]
    elif family == "L":
        c = d["t"] / 2
        parts = [((c, c), (d["a"], c), d["t"]), ((c, c), (c, d["b"]), d["t"])]
    elif family == "RHS":
        x, y = (d["b"] - d["t"]) / 2, (d["h"] - d["t"]) / 2
        corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
        parts = [(corners[k], corners[(k + 1) % 4], d["t"]) for k in range(4)]
    elif family == "C":
        x, y = d["tw"] / 2, (d["h"] - d["tf"]) / 2
        parts = [((x, -y), (x, y), d["tw"]), ((x, -y), (d["b"], -y), d["tf"]), ((x, y), (d["b"], y), d["tf"])]
    elif family in ("I", "T"):
        ends = ((d["h"] - d["tf"]) / 2, -(d["h"] - d["tf"]) / 2) if family == "I" else (-d["tf"] / 2, -d["h"])
        flanges = ends if family == "I" else ends[:1]
        parts = [((0.0, ends[0]), (0.0, ends[1]), d["tw"])]
        parts += [((0.0, y), (side * d["b"] / 2, y), d["tf"]) for y in flanges for side in (-1, 1)]
    else:
        raise SolveError(f"a member of family {family} has no flat walls")
    return [(np.array([a, b], float), float(t)) for a, b, t in parts]


def shell_model(member: Member) -> ShellModel:
    """The shells lie where the member does, bow, twist and end planes included.

    Raises SolveError where its section changes along its axis, or a wall is too thick for a shell.
    """
    require(member.change is None, SolveError, "a member whose section changes along its axis is not made of shells")
    require(not member.bends, SolveError, "a pipe with elbows is not made of shells")
    values = member.values()
    lines, thickness = _chains(member.family, values)
    widths = [float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines]
    thick = max(t / w for t, w in zip(thickness, widths, strict=True))
    require(thick * THIN <= 1, SolveError, f"a wall is {1 / thick:.2g} times as wide as thick, a shell at least {THIN:g} times")
    piece = min(w / ((len(line) - 1) // 2) for w, line in zip(widths, lines, strict=True))
    n_along = max(int(np.ceil(values["length"] / (LONG * piece))), 4)
    places: list[FloatArray] = []
    levels: list[int] = []
    elements: list[list[int]] = []
    wall: list[int] = []
    index: dict[tuple[int, ...], int] = {}

    def node(at: FloatArray, level: int) -> int:
        key = (*np.round(at / (SAME * values["length"])).astype(np.int64).tolist(), level)
        if key not in index:
            index[key] = len(places)
            places.append(at)
            levels.append(level)
        return index[key]

    shares: dict[int, float] = {}
    for number, line in enumerate(lines):
        for k in range(0, len(line) - 2, 2):
            a, m, b = line[k : k + 3]
            for j in range(0, 2 * n_along, 2):
                ring = [(a, j), (b, j), (b, j + 2), (a, j + 2), (m, j), (b, j + 1), (m, j + 2), (a, j + 1)]
                elements.append([node(*one) for one in ring])
                wall.append(number)
            area = thickness[number] * float(np.linalg.norm(m - a) + np.linalg.norm(b - m))
            for at, share in zip((a, m, b), EDGE_SHARES.tolist(), strict=True):
                end = node(at, 2 * n_along)
                shares[end] = shares.get(end, 0.0) + share * area
    last = np.array(sorted(shares), np.int64)
    weight = np.array([shares[k] for k in last.tolist()])
    section, row = np.unique(np.array(places), axis=0, return_inverse=True)
    level = np.array(levels)
    world = swept_points(sweep_of(member), section, np.linspace(0.0, 1.0, 2 * n_along + 1))
    return ShellModel(
        nodes=world[level, row.ravel()], elements=np.array(elements, np.int64), wall=np.array(wall, np.int64), thickness_m=np.array(thickness),
        first=np.flatnonzero(level == 0), last=last, weight=weight / weight.sum(), axes=np.asarray(member.T_world_member)[:3, :3],
    )  # fmt: skip


def _chains(family: str, d: Mapping[str, float]) -> tuple[list[FloatArray], list[float]]:
    """((2 k + 1, 2) points along the middle of each wall, two for each element, and its thickness)."""
    if family == "CHS":
        angle = np.linspace(0, 2 * np.pi, 2 * ROUND_ABOUT + 1)
        ring = (d["d"] - d["t"]) / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ring[-1] = ring[0]
        return [ring], [float(d["t"])]
    walls = middle_lines(family, d)
    narrow = min(float(np.linalg.norm(ends[1] - ends[0])) for ends, _ in walls) / ACROSS
    lines = []
    for ends, _ in walls:
        n = max(ACROSS, round(float(np.linalg.norm(ends[1] - ends[0])) / narrow))
        lines.append(ends[0] + np.linspace(0, 1, 2 * n + 1)[:, None] * (ends[1] - ends[0]))
    return lines, [t for _, t in walls]


def end_arms(model: ShellModel) -> FloatArray:
    """(len(last), 3) what a unit turn about the member moves the nodes of its last end by, round their middle."""
    at = model.nodes[model.last]
    return np.cross(model.axes[:, 2], at - model.weight @ at)


def end_forces(model: ShellModel, force_n: float) -> dict[str, FloatArray]:
    """Of each case of a member the forces (len(last), 3) on its last end: `force_n` along z, x, y of the section, and times 1 m about z."""
    x, y, z = model.axes.T
    arm = end_arms(model)
    turn = model.weight[:, None] * arm / float(model.weight @ (arm**2).sum(axis=1))
    even = {"tension": z, "bend_x": x, "bend_y": y}
    return {name: force_n * model.weight[:, None] * v for name, v in even.items()} | {"torsion": force_n * turn}


def write_shell_inp(member: Member, options: FeaOptions = FeaOptions(), units: UnitSystem = UNIT_SYSTEMS["m-N-Pa"]) -> str:
    """The deck as text; the same member gives the same text. Raises SolveError where the member makes no shells."""
    model, material = shell_model(member), chosen_material(options)
    lines = [
        f"** scan2fea {scan2fea.__version__}",
        f"** units: {units.name}",
        "** run: ccx -i model_shell   (or Abaqus)",
        f"** {member.family}, {len(model.elements)} shells on the middles of the walls; {FIRST} is held; corners of walls count as the middles cross",
        "*NODE, NSET=ALL",
    ]
    xyz = (model.nodes * units.length).tolist()
    lines += [f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in enumerate(xyz, start=1)]
    numbers = np.arange(1, len(model.elements) + 1)
    for wall in range(len(model.thickness_m)):
        lines.append(f"*ELEMENT, TYPE=S8R, ELSET=WALL_{wall + 1:02d}")
        rows = model.wall == wall
        lines += [", ".join(map(str, row)) for row in np.c_[numbers[rows], model.elements[rows] + 1].tolist()]
    for name, nodes in ((FIRST, model.first), (LAST, model.last)):
        lines += [f"*NSET, NSET={name}", *(f"{k + 1}," for k in nodes.tolist())]
    lines += ["*MATERIAL, NAME=MATERIAL", "*ELASTIC", f"{material.youngs_pa * units.pressure:.10e}, {material.poisson:.10g}"]
    lines += ["*DENSITY", f"{material.density_kg_m3 * units.density:.10e}"]
    for wall, t in enumerate(model.thickness_m.tolist(), start=1):
        lines += [f"*SHELL SECTION, ELSET=WALL_{wall:02d}, MATERIAL=MATERIAL", f"{t * units.length:.10e}"]
    lines += ["*BOUNDARY", f"{FIRST}, 1, 6"]
    dx, dy, dz = down_axis(options).tolist()
    g = options.gravity_m_s2 * units.acceleration
    lines += ["** step 1: self weight", "*STEP", "*STATIC", "*DLOAD"]
    lines += [f"WALL_{k:02d}, GRAV, {g:.10e}, {dx:.10g}, {dy:.10g}, {dz:.10g}" for k in range(1, len(model.thickness_m) + 1)]
    lines += ["*NODE FILE, OUTPUT=2D", "U", "*END STEP"]
    for number, (name, force) in enumerate(end_forces(model, options.test_force_n).items(), start=2):
        lines += [f"** step {number}: {name}", "*STEP", "*STATIC", "*DLOAD, OP=NEW", "*CLOAD, OP=NEW"]
        rows = force * units.force
        lines += [f"{model.last[k] + 1}, {axis + 1}, {rows[k, axis]:.10e}" for k, axis in np.argwhere(rows != 0).tolist()]
        lines += ["*NODE FILE, OUTPUT=2D", "U", "*END STEP"]
    lines += ["** step 6: modes of the held member", "*STEP", "*FREQUENCY", str(options.n_modes), "*NODE FILE, OUTPUT=2D", "U", "*END STEP"]
    return "\n".join(lines) + "\n"
