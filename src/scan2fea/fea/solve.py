"""The embedded solver: self weight on the support, and the modes of the free body."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.errors import SolveError, require
from scan2fea.fea.assemble import System, assemble
from scan2fea.fea.dissection import Tree, dissect, without
from scan2fea.fea.elements import surface_volume
from scan2fea.fea.linear import inverses, solve_static
from scan2fea.fea.modes import GUARD, Modes, Products, first_guess, from_strains, lobpcg, rigid_modes
from scan2fea.fea.options import FeaOptions
from scan2fea.fea.strain import energies, von_mises
from scan2fea.types import BoolArray, CaseResult, FEModel, FEResult, FloatArray

N_RIGID = 6
SHIFT = 0.1  # of the estimate of the first elastic eigenvalue
EIGEN_TOLERANCE = 1e-10  # relative, of an eigenvalue


def _relative(value: float, expected: float) -> float:
    return abs(value - expected) / abs(expected) if expected else math.inf


def _case(name: str, measure: str, unit: str, value: float, expected: float | None = None) -> CaseResult:
    if expected is None:
        return CaseResult(name=name, measure=measure, unit=unit, value=float(value))
    return CaseResult(
        name=name, measure=measure, unit=unit, value=float(value), expected=float(expected), relative_error=_relative(float(value), float(expected))
    )


def held_nodes(model: FEModel) -> BoolArray:
    """(n,) bool of the nodes of the support. Raises SolveError where there are fewer than three."""
    nodes = model.node_sets.get(model.support, np.zeros(0, np.int64))
    require(len(nodes) >= 3, SolveError, f"the support {model.support} has {len(nodes)} nodes: 3 that are not on a line are needed")
    held = np.zeros(len(model.mesh.nodes), bool)
    held[nodes] = True
    return held


def _self_weight(
    model: FEModel, system: System, tree: Tree | None, options: FeaOptions
) -> tuple[tuple[CaseResult, ...], FloatArray, FloatArray, FloatArray, str]:
    """(cases, displacement (n, 3), reaction (3,), applied (3,), solver) of the part that stands on its support."""
    mesh, material = model.mesh, model.material
    held = held_nodes(model)
    # consistent load: the integral of N_i rho a is row i of the mass times a
    force = np.asarray(system.mass_matrix().sum(axis=1))[:, None] * model.acceleration_m_s2
    u, residual, solver = solve_static(system, tree and without(tree, held), rigid_modes(mesh.nodes), held, force, options)
    applied = force.sum(axis=0)
    reaction = ((system.stiffness_matrix() @ u.ravel()).reshape(-1, 3) - force)[held].sum(axis=0)
    weight = material.density_kg_m3 * surface_volume(mesh.nodes, mesh.boundary) * float(np.linalg.norm(model.acceleration_m_s2))
    strain_energy = float(energies(mesh, material, u[None])[0, 0]) / 2
    stress, volume = von_mises(mesh, material, u)
    order = np.argsort(stress, kind="stable")
    below = np.cumsum(volume[order]) / volume.sum()
    name = "self_weight"
    cases = (
        _case(name, "displacement_max_m", "m", float(np.linalg.norm(u, axis=1).max())),
        _case(name, "reaction_n", "N", float(np.linalg.norm(reaction)), weight),
        _case(name, "strain_energy_j", "J", strain_energy, 0.5 * float(np.vdot(force, u))),
        _case(name, "stress_p99_pa", "Pa", float(stress[order][min(int(np.searchsorted(below, 0.99)), len(order) - 1)])),
        _case(name, "residual", "", residual),
    )
    return cases, u, reaction, applied, solver


def _free_modes(model: FEModel, system: System, tree: Tree | None, options: FeaOptions) -> tuple[Modes, str]:
    """The six rigid and the first elastic modes of the free body. Raises SolveError where no solver finds them."""
    nodes = model.mesh.nodes
    n_wanted = N_RIGID + options.n_modes
    require(3 * len(nodes) > 3 * (n_wanted + GUARD), SolveError, f"{3 * len(nodes)} dof are too few for {n_wanted} modes: mesh finer")
    start, bound = first_guess(system, nodes, n_wanted)
    free = np.zeros(len(nodes), bool)
    tried = []
    for name, make in inverses(system, tree, rigid_modes(nodes), free, SHIFT * bound, options):
        try:
            modes = lobpcg(system, make(), SHIFT * bound, start, n_wanted, EIGEN_TOLERANCE)
        except SolveError as error:
            tried.append(f"{name}: {error}")
            continue
        return modes, f"LOBPCG on {name.removesuffix(' with conjugate gradients')}, {modes.rounds} rounds"
    raise SolveError("; ".join(tried) or "no solver fits: set fea.solver to auto")


def _modal(model: FEModel, system: System, tree: Tree | None, options: FeaOptions) -> tuple[tuple[CaseResult, ...], FloatArray, FloatArray, str]:
    """(cases, frequencies (6 + k,), shapes (k, n, 3), solver) of the free body."""
    modes, solver = _free_modes(model, system, tree, options)
    again, shapes = from_strains(energies(model.mesh, model.material, modes.shapes), Products(system), modes.shapes)
    frequencies = np.sign(again) * np.sqrt(np.abs(again)) / (2 * np.pi)
    elastic = shapes[N_RIGID:]
    peak = np.abs(elastic).reshape(len(elastic), -1).argmax(axis=1)
    sign = np.sign(elastic.reshape(len(elastic), -1)[np.arange(len(elastic)), peak])
    length = np.linalg.norm(elastic, axis=2).max(axis=1)
    rigid = float(np.abs(frequencies[:N_RIGID]).max())
    share = rigid / float(frequencies[N_RIGID]) if frequencies[N_RIGID] > 0 else math.inf
    cases = (
        *(_case("modal", f"f{k + 1}_hz", "Hz", float(frequencies[k])) for k in range(N_RIGID, len(frequencies))),
        CaseResult(name="modal", measure="rigid_max_hz", unit="Hz", value=rigid, expected=0.0, relative_error=share),
        _case("modal", "residual", "", modes.error),
    )
    return cases, frequencies, elastic * (sign / length)[:, None, None], solver


def solve(model: FEModel, options: FeaOptions = FeaOptions()) -> FEResult:
    """Self weight on the support and the modes of the free body.

    Cases: `self_weight` (displacement_max_m; reaction_n against rho g times the volume inside the surface; strain_energy_j from the
    strains against half the work of the load; stress_p99_pa, the von Mises stress that 99 % of the volume stays below; residual),
    `modal` (f7_hz ...; rigid_max_hz against 0, relative to f7; residual) and `mass` (mass_kg against rho times that volume).

    Raises SolveError: too many degrees of freedom, inside-out elements, a part that nothing holds, no convergence.
    """
    mesh, material = model.mesh, model.material
    n_dof = 3 * len(mesh.nodes)
    require(
        n_dof <= options.max_dof, SolveError, f"{n_dof} degrees of freedom are above fea.max_dof = {options.max_dof}: mesh coarser or raise the limit"
    )
    system = assemble(mesh, material)
    tree = None if options.solver == "amg" else dissect(np.array(mesh.nodes), np.array(system.indptr), np.array(system.indices))
    weight_cases, displacement, reaction, applied, static_solver = _self_weight(model, system, tree, options)
    modal_cases, frequencies, shapes, modal_solver = _modal(model, system, tree, options)
    mass = _case("mass", "mass_kg", "kg", float(system.mass.sum()), material.density_kg_m3 * surface_volume(mesh.nodes, mesh.boundary))
    return FEResult(
        cases=(*weight_cases, *modal_cases, mass),
        displacement_m=displacement,
        mode_shapes=shapes,
        frequencies_hz=frequencies,
        reaction_n=reaction,
        applied_n=applied,
        n_dof=n_dof,
        solver=f"self weight: {static_solver}; modes: {modal_solver}",
    )
