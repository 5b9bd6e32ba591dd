"""The cases of a member that have closed forms: held at its first end, pulled, bent about both axes, twisted and pressed at its last.

Displacements are means over the end face, turned into the axes of the section. Every figure stands beside that of beam theory and carries the
standard deviation that the dimensions leave it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import SolveError, require
from scan2fea.fea.assemble import System
from scan2fea.fea.beam import assemble_beams, clamped, geometric, solve_beams, straight
from scan2fea.fea.beam import axial_forces as beam_forces
from scan2fea.fea.beam import buckling as beam_buckling
from scan2fea.fea.beam_theory import tip_under_force, tip_under_tension, tip_under_torque
from scan2fea.fea.buckle import buckling_factors, stress_stiffness
from scan2fea.fea.budget import N_FREQUENCIES, Budget, beam_response, budget, std_of
from scan2fea.fea.inner import InnerForces
from scan2fea.fea.linear import Shared, StaticSolver
from scan2fea.fea.options import FeaOptions
from scan2fea.fea.restrain import rigid_fields
from scan2fea.fea.section_properties import SectionProperties, properties_of
from scan2fea.fea.static import figure
from scan2fea.fea.strain import at_nodes, von_mises
from scan2fea.fea.surfaces import Surface, distortion, spread_force, spread_moment, surface
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.types import CaseField, CaseResult, FEModel, FloatArray, Material, Member, Value

FIRST, LAST = "END_FIRST", "END_LAST"  # the names of the end faces of a swept member
SIDEWAYS = 0.02  # of the displacement: less across the load, or less twist at the rim, is not worth a line
N_ELEMENTS = 24
OWN_WALLS = 0.5  # of the motion of an end section: a mode that distorts it by more is one of its walls, which no beam has
# of the same: a section that changes its shape by a twentieth of how far it moves swings by about as much slower than theory, which holds it rigid
# (of eight thin C and I 5.7 to 7.2 times as long as their sections f7 lay 1.1 to 16.7 % low, the roots of their shares are 0.03 to 0.18)
KEEPS_SHAPE = 0.05**2
SLENDER = 5.0  # length over the size of the section below which beam theory says little of a solid: such members have no cases of their own


@dataclass(frozen=True, eq=False, kw_only=True)
class _Bench(Value):
    """A member held at its first end: what its cases share. axes : (3, 3), columns x, y of the section and z along.

    distorts : a box without diaphragms loses its rectangle where it is twisted by anything but the shear flow of Bredt: no theory of rigid sections
    foretells by how much (a tube of 140 x 80 x 6 mm, 1.6 m long, turns a third further).
    """

    model: FEModel
    properties: SectionProperties
    length_m: float
    axes: FloatArray
    tip: Surface
    force_n: float
    budget: Budget
    distorts: bool


def member_cases(
    model: FEModel,
    system: System,
    shared: Shared | None,
    member: Member,
    rows: Sequence[CaseResult],
    options: FeaOptions,
    shapes: FloatArray,
) -> tuple[list[CaseResult], list[CaseField]]:
    """(`rows` with expected figures and standard deviations where theory has them, and the member's own rows; fields of these).

    shapes : (k, n, 3) elastic modes of the free body.   Members shorter than SLENDER times their section get standard deviations alone; where the
    section changes along the axis theory and budget, which are of one section, say nothing.   Raises SolveError.
    """
    if member.change is not None:
        return list(rows), []
    values = member.values()
    p = properties_of(member.family, {n: values[n] for n in PARAMETERS[member.family]}, member.root)
    found = budget(member, model.material, options.test_force_n, options.n_samples, options.seed)
    is_slender = values["length"] >= SLENDER * 2 * float(p.reach.max())
    numbers = _beam_modes(model, np.asarray(member.T_world_member)[:3, :2], shapes)
    out = _with_theory(rows, p, model.material, values["length"], found, options.test_force_n, is_slender, numbers)
    if not (options.member_cases and is_slender):
        return out, []
    for name in (FIRST, LAST):
        require(len(model.surfaces.get(name, ())), SolveError, f"the cases of a member need its end faces, and the model has no set {name}")
    tip = surface(np.asarray(model.mesh.nodes), np.asarray(model.mesh.boundary[model.surfaces[LAST]]))
    bench = _Bench(
        model=model, properties=p, length_m=values["length"], axes=np.asarray(member.T_world_member)[:3, :3], tip=tip,
        force_n=options.test_force_n, budget=found, distorts=member.family == "RHS",
    )  # fmt: skip
    held = np.zeros((system.n_nodes, 3), bool)
    held[model.node_sets[FIRST]] = True
    exact = InnerForces(model.mesh, model.material)
    solver = StaticSolver(system, shared, rigid_fields(np.asarray(model.mesh.nodes)), held, exact, options)
    fields = []
    forces = {f"member, {name}": tip.nodal(traction, system.n_nodes) for name, traction in _tractions(bench)}
    for title, found_u in solver.together(forces).items():
        name, force, u = title.removeprefix("member, "), forces[title], found_u.displacement
        reaction = np.where(held, exact(u) - force, 0.0).sum(axis=0)
        stress = at_nodes(model.mesh, *von_mises(model.mesh, model.material, u))
        size = float(np.linalg.norm(force, axis=1).sum())
        fields.append(
            CaseField(name=name, displacement_m=u, von_mises_pa=stress, reaction_n=reaction, applied_n=force.sum(axis=0), load_n=size)
        )
        out += _rows(bench, name, u)
    press = stress_stiffness(model.mesh, model.material, system, -fields[0].displacement_m)
    bent_or_twisted = np.stack([field.displacement_m for field in fields[1:]])  # it buckles much like that
    factors, _ = buckling_factors(press, solver, held, bent_or_twisted)
    load = float(factors[0]) * bench.force_n if len(factors) else float("nan")
    out.append(figure("buckling", "buckling_n", "N", load, beam_buckling_load(p, model.material, bench.length_m), std_of(found, "buckling_n", load)))
    return out, fields


def _tractions(bench: _Bench) -> list[tuple[str, FloatArray]]:
    x, y, z = bench.axes.T
    force = bench.force_n
    return [
        ("tension", spread_force(bench.tip, force * z)),
        ("bend_x", spread_force(bench.tip, force * x)),
        ("bend_y", spread_force(bench.tip, force * y)),
        ("torsion", spread_moment(bench.tip, force * z)),  # force times 1 m
    ]


def _rows(bench: _Bench, name: str, u: FloatArray) -> list[CaseResult]:
    """What the tip does, beside beam theory."""
    p, material, length = bench.properties, bench.model.material, bench.length_m
    mean, turned = bench.tip.moved(u)
    moved, twist = bench.axes.T @ mean, float(bench.axes[:, 2] @ turned)
    if name == "tension":
        value = float(moved[2])
        return [figure(name, "tip_z_m", "m", value, tip_under_tension(p, material, length, bench.force_n), std_of(bench.budget, "tension", value))]
    if name == "torsion":
        expected = None if bench.distorts else tip_under_torque(p, material, length, bench.force_n)
        return [figure(name, "twist_rad", "rad", twist, expected, std_of(bench.budget, "twist", twist))]
    k = "xy".index(name[-1])
    expected_u, expected_twist = tip_under_force(p, material, length, bench.force_n * np.eye(2)[k])
    along = float(moved[k])
    rows = [figure(name, f"tip_{'xy'[k]}_m", "m", along, float(expected_u[k]), std_of(bench.budget, f"{name}_{'xy'[k]}", along))]
    other = 1 - k
    if abs(expected_u[other]) > SIDEWAYS * abs(expected_u[k]):
        across = float(moved[other])
        key = f"{name}_{'xy'[other]}"
        rows.append(figure(name, f"tip_{'xy'[other]}_m", "m", across, float(expected_u[other]), std_of(bench.budget, key, across)))
    if abs(expected_twist) * float(p.reach.max()) > SIDEWAYS * abs(expected_u[k]):
        rows.append(figure(name, "twist_rad", "rad", twist, expected_twist, std_of(bench.budget, f"{name}_twist", twist)))
    return rows


def _beam_modes(model: FEModel, across: FloatArray, shapes: FloatArray) -> dict[int, tuple[int, bool]]:
    """Elastic mode -> (the mode of a free beam that it is, both from 0; whether its section keeps its shape); thin walls may swing by themselves
    below these. across : (3, 2).
    """
    if not len(model.surfaces.get(LAST, ())):
        return {k: (k, True) for k in range(len(shapes))}
    end = surface(np.asarray(model.mesh.nodes), np.asarray(model.mesh.boundary[model.surfaces[LAST]]))
    bent = {k: share for k, shape in enumerate(shapes) if (share := distortion(end, across, shape)) <= OWN_WALLS}
    return {k: (n, share <= KEEPS_SHAPE) for n, (k, share) in enumerate(bent.items())}


def _with_theory(
    rows: Sequence[CaseResult],
    p: SectionProperties,
    material: Material,
    length_m: float,
    found: Budget,
    force_n: float,
    is_slender: bool,
    numbers: Mapping[int, tuple[int, bool]],
) -> list[CaseResult]:
    """Mass and the first free frequencies with their standard deviations, the frequencies of slender members beside those of a free beam.

    numbers : elastic mode -> (mode of the beam, whether its section keeps its shape), of those that a beam has; the others keep their value alone.
    """
    fine = beam_response(p, material, length_m, force_n, N_ELEMENTS)
    out = []
    for row in rows:
        if (row.name, row.measure) == ("mass", "mass_kg"):
            row = replace(row, std=std_of(found, "mass_kg", row.value))
        elif row.name == "modal" and row.measure in {f"f{k + 7}_hz" for k, (n, _) in numbers.items() if n < N_FREQUENCIES}:
            number, keeps = numbers[int(row.measure[1:-3]) - 7]
            key = f"f{number + 1}_hz"
            row = figure(row.name, row.measure, row.unit, row.value, fine[key] if is_slender and keeps else None, std_of(found, key, row.value))
        out.append(row)
    return out


def beam_buckling_load(p: SectionProperties, material: Material, length_m: float) -> float:
    """N, of a cantilever pressed at its tip, shear and warping included (beam elements)."""
    beams = straight(length_m, p, material, N_ELEMENTS)
    matrices = assemble_beams(beams)
    held = clamped(beams, matrices, 0)
    load = np.zeros((len(held), 1))
    load[6 * N_ELEMENTS + 2] = -1.0
    force = beam_forces(beams, matrices, solve_beams(matrices, held, load)[:, 0])
    return float(beam_buckling(matrices, held, geometric(beams, force, matrices.dof, len(held)))[0])
