"""The embedded solver: static cases on the supports, the modes of the free body, and what a member has closed forms for."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.errors import SolveError, require
from scan2fea.fea.assemble import System, assemble
from scan2fea.fea.calculix import second_opinion
from scan2fea.fea.dissection import Tree, dissect_before, without
from scan2fea.fea.elements import surface_volume
from scan2fea.fea.lanczos import free_modes
from scan2fea.fea.linear import DIRECT, Masked, Shared, inverses
from scan2fea.fea.member_cases import FIRST, member_cases
from scan2fea.fea.modes import GUARD, Modes, Products, first_guess, from_strains, lobpcg
from scan2fea.fea.options import FeaOptions
from scan2fea.fea.p_error import energy_of_error
from scan2fea.fea.restrain import rigid_fields, three_points
from scan2fea.fea.shell_static import shells_beside
from scan2fea.fea.static import Statics, figure, solve_cases
from scan2fea.fea.strain import energies
from scan2fea.types import BoolArray, CaseResult, FEModel, FEResult, FloatArray, Member

N_RIGID = 6
SHIFT = 0.1  # of the estimate of the first elastic eigenvalue
EIGEN_TOLERANCE = 1e-10  # relative, of an eigenvalue


def _free_modes(model: FEModel, system: System, shared: Shared | None, options: FeaOptions) -> tuple[Modes, str]:
    """The six rigid and the first elastic modes of the free body. Raises SolveError where no solver finds them."""
    nodes = np.asarray(model.mesh.nodes)
    n_wanted = N_RIGID + options.n_modes
    require(3 * len(nodes) > 3 * (n_wanted + GUARD), SolveError, f"{3 * len(nodes)} dof are too few for {n_wanted} modes: mesh finer")
    start, bound = first_guess(system, nodes, n_wanted)
    tried = []
    held = three_points(nodes)
    if shared is not None and shared.holds(held):
        try:
            modes = free_modes(Products(system), Masked(shared.with_held(held), (~held).astype(float)), start, n_wanted, EIGEN_TOLERANCE)
            return modes, f"Lanczos on {DIRECT}, {modes.rounds} rounds"
        except SolveError as error:  # a mesh in pieces, most likely: below nothing is assumed of rigid motions
            tried.append(str(error))
    free = np.zeros((len(nodes), 3), bool)
    tree = None if shared is None else without(shared.tree, free[:, 0])
    for name, make in inverses(system, tree, rigid_fields(nodes), free, SHIFT * bound, options):
        try:
            modes = lobpcg(system, make(), SHIFT * bound, start, n_wanted, EIGEN_TOLERANCE)
        except SolveError as error:
            tried.append(f"{name}: {error}")
            continue
        return modes, f"LOBPCG on {name.removesuffix(' with conjugate gradients')}, {modes.rounds} rounds"
    raise SolveError("; ".join(tried) or "no solver fits: set fea.solver to auto")


def _modal(model: FEModel, system: System, shared: Shared | None, options: FeaOptions) -> tuple[tuple[CaseResult, ...], FloatArray, FloatArray, str]:
    """(cases, frequencies (6 + k,), shapes (k, n, 3), solver) of the free body."""
    modes, solver = _free_modes(model, system, shared, options)
    again, shapes = from_strains(energies(model.mesh, model.material, modes.shapes), Products(system), modes.shapes)
    frequencies = np.sign(again) * np.sqrt(np.abs(again)) / (2 * np.pi)
    elastic = shapes[N_RIGID:]
    peak = np.abs(elastic).reshape(len(elastic), -1).argmax(axis=1)
    sign = np.sign(elastic.reshape(len(elastic), -1)[np.arange(len(elastic)), peak])
    length = np.linalg.norm(elastic, axis=2).max(axis=1)
    rigid = float(np.abs(frequencies[:N_RIGID]).max())
    share = rigid / float(frequencies[N_RIGID]) if frequencies[N_RIGID] > 0 else math.inf
    cases = (
        *(figure("modal", f"f{k + 1}_hz", "Hz", float(frequencies[k])) for k in range(N_RIGID, len(frequencies))),
        CaseResult(name="modal", measure="rigid_max_hz", unit="Hz", value=rigid, expected=0.0, relative_error=share),
        figure("modal", "residual", "", modes.error),
    )
    return cases, frequencies, elastic * (sign / length)[:, None, None], solver


def _discretisation(model: FEModel, weight: FloatArray, mode: FloatArray, hertz: float, held: BoolArray) -> tuple[CaseResult, ...]:
    """What a cubic solution on the same mesh would change: of the energy of the self weight, of the first elastic frequency. None of first order."""
    mesh, material = model.mesh, model.material
    if mesh.order == 1 or not hertz > 0:
        return ()
    body = material.density_kg_m3 * model.acceleration_m_s2 * np.ones((1, len(mesh.nodes), 1))
    by_weight = float(energy_of_error(mesh, material, weight[None], body, held)[0])
    inertia = material.density_kg_m3 * (2 * np.pi * hertz) ** 2 * mode[None]
    by_mode = float(energy_of_error(mesh, material, mode[None], inertia, np.zeros_like(held))[0])
    total = np.diag(energies(mesh, material, np.stack([weight, mode])))
    return (
        figure("self_weight", "discretisation", "share", by_weight / total[0]),
        figure("modal", "f7_discretisation", "share", by_mode / (2 * total[1])),
    )


def _tree(model: FEModel, system: System, member: Member | None) -> Tree:
    """Fronts that leave for the end, where this costs little, what one or other case holds: then one factorisation serves all of them."""
    nodes = np.asarray(model.mesh.nodes)
    points = np.flatnonzero(three_points(nodes).any(axis=1))
    supports = [model.node_sets[name] for name in model.supports]
    end = [model.node_sets[FIRST]] if member is not None and FIRST in model.node_sets else []
    wanted = [np.unique(np.concatenate(sets)) for sets in ([points, *end, *supports], [points, *end], [points, *supports], [points])]
    return dissect_before(nodes, np.array(system.indptr), np.array(system.indices), wanted)


def solve(model: FEModel, options: FeaOptions = FeaOptions(), member: Member | None = None) -> FEResult:
    """Self weight and the user's cases on the supports, the modes of the free body, and of a member the cases that have closed forms.

    Cases: `self_weight` (displacement_max_m; reaction_n against rho g times the volume inside the surface; strain_energy_j from the strains against
    half the work of the load; stress_p99_pa, the von Mises stress that 99 % of the volume stays below; stress_peak_pa outside the elements at
    singular places, stress_peak_jump its difference to the mean at the nodes; residual), each case of the user alike, `modal` (f7_hz ...;
    rigid_max_hz against 0, relative to f7; residual), `mass` (mass_kg against rho times that volume), and see `member_cases`. `discretisation` and
    `f7_discretisation`: by how much a cubic solution on the same mesh would change the energy and f7 (`p_error`). Also see `calculix`.

    Raises SolveError: too many degrees of freedom, inside-out elements, a part that nothing holds, no convergence of the self weight or the modes.
    """
    mesh, material = model.mesh, model.material
    n_dof = 3 * len(mesh.nodes)
    require(
        n_dof <= options.max_dof, SolveError, f"{n_dof} degrees of freedom are above fea.max_dof = {options.max_dof}: mesh coarser or raise the limit"
    )
    system = assemble(mesh, material)
    shared = None if options.solver == "amg" else Shared(system, _tree(model, system, member), options)
    statics = Statics(model, system, shared, options)
    rows, fields, failed, static_solver = solve_cases(statics)
    singular, held = statics.singular.nodes, np.asarray(statics.held.all(axis=1))
    del statics  # factors of its own need memory that the modes want too
    modal, frequencies, shapes, modal_solver = _modal(model, system, shared, options)
    mass = figure("mass", "mass_kg", "kg", float(system.mass.sum()), material.density_kg_m3 * surface_volume(mesh.nodes, mesh.boundary))
    cases = [*rows, *modal, *_discretisation(model, fields[0].displacement_m, shapes[0], float(frequencies[N_RIGID]), held), mass]
    if options.solver == "calculix":
        try:
            cases += second_opinion(model, fields)
        except SolveError as error:
            failed["calculix"] = str(error)
    if member is not None:
        try:
            cases, more = member_cases(model, system, shared, member, cases, options, shapes)
            fields += more
        except SolveError as error:
            failed["member"] = str(error)
        try:
            cases += shells_beside(cases, member, material, options.test_force_n)
        except SolveError as error:
            failed["shells"] = str(error)
    return FEResult(
        cases=tuple(cases),
        fields=tuple(fields),
        mode_shapes=shapes,
        frequencies_hz=frequencies,
        n_dof=n_dof,
        solver=f"self weight: {static_solver}; modes: {modal_solver}",
        singular=singular,
        failed=failed,
    )
