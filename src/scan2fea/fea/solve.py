"""The embedded solver: static cases on the supports, the modes of the free body, and what a member has closed forms for."""

from __future__ import annotations

import itertools
import math

import numpy as np

from scan2fea.errors import SolveError, require
from scan2fea.fea.assemble import System, assemble
from scan2fea.fea.cholesky import Cholesky
from scan2fea.fea.dissection import Tree, dissect
from scan2fea.fea.elements import surface_volume
from scan2fea.fea.linear import inverses
from scan2fea.fea.member_cases import member_cases
from scan2fea.fea.modes import GUARD, Modes, Products, first_guess, from_strains, lobpcg
from scan2fea.fea.options import FeaOptions
from scan2fea.fea.p_error import energy_of_error
from scan2fea.fea.restrain import rigid_fields
from scan2fea.fea.static import Statics, figure, solve_cases
from scan2fea.fea.strain import energies
from scan2fea.types import BoolArray, CaseResult, FEModel, FEResult, FloatArray, Member
from scan2fea.units import BYTES_PER_MIB

N_RIGID = 6
SHIFT = 0.1  # of the estimate of the first elastic eigenvalue
ROUGH_FLOPS = 2e10  # of the factors: beyond, those of the modes are made in single precision first, which halves what they cost
EIGEN_TOLERANCE = 1e-10  # relative, of an eigenvalue


def _free_modes(model: FEModel, system: System, tree: Tree | None, options: FeaOptions) -> tuple[Modes, str]:
    """The six rigid and the first elastic modes of the free body. Raises SolveError where no solver finds them."""
    nodes = model.mesh.nodes
    n_wanted = N_RIGID + options.n_modes
    require(3 * len(nodes) > 3 * (n_wanted + GUARD), SolveError, f"{3 * len(nodes)} dof are too few for {n_wanted} modes: mesh finer")
    start, bound = first_guess(system, nodes, n_wanted)
    free = np.zeros(len(nodes), bool)
    tried = []
    ways = inverses(system, tree, rigid_fields(nodes), free, SHIFT * bound, options)
    if tree is not None and tree.flops > ROUGH_FLOPS and 4 * tree.peak_entries / BYTES_PER_MIB <= options.max_factor_mb:
        # it only steers: what the modes are worth is measured with the stiffness itself
        ways = itertools.chain([("Cholesky (multifrontal, single precision)", lambda: Cholesky(system, tree, SHIFT * bound, np.float32))], ways)
    for name, make in ways:
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


def solve(model: FEModel, options: FeaOptions = FeaOptions(), member: Member | None = None, root_radius_m: float = 0.0) -> FEResult:
    """Self weight and the user's cases on the supports, the modes of the free body, and of a member the cases that have closed forms.

    Cases: `self_weight` (displacement_max_m; reaction_n against rho g times the volume inside the surface; strain_energy_j from the strains against
    half the work of the load; stress_p99_pa, the von Mises stress that 99 % of the volume stays below; stress_peak_pa outside the elements at
    singular places, stress_peak_jump its difference to the mean at the nodes; residual), each case of the user alike, `modal` (f7_hz ...;
    rigid_max_hz against 0, relative to f7; residual), `mass` (mass_kg against rho times that volume), and see `member_cases`. `discretisation` and
    `f7_discretisation`: by how much a cubic solution on the same mesh would change the energy and f7 (`p_error`).

    Raises SolveError: too many degrees of freedom, inside-out elements, a part that nothing holds, no convergence of the self weight or the modes.
    """
    mesh, material = model.mesh, model.material
    n_dof = 3 * len(mesh.nodes)
    require(
        n_dof <= options.max_dof, SolveError, f"{n_dof} degrees of freedom are above fea.max_dof = {options.max_dof}: mesh coarser or raise the limit"
    )
    system = assemble(mesh, material)
    tree = None if options.solver == "amg" else dissect(np.array(mesh.nodes), np.array(system.indptr), np.array(system.indices))
    statics = Statics(model, system, tree, options)
    rows, fields, failed, static_solver = solve_cases(statics)
    singular, held = statics.singular.nodes, np.asarray(statics.held.all(axis=1))
    del statics  # its factors need memory that the modes want too
    modal, frequencies, shapes, modal_solver = _modal(model, system, tree, options)
    mass = figure("mass", "mass_kg", "kg", float(system.mass.sum()), material.density_kg_m3 * surface_volume(mesh.nodes, mesh.boundary))
    cases = [*rows, *modal, *_discretisation(model, fields[0].displacement_m, shapes[0], float(frequencies[N_RIGID]), held), mass]
    if member is not None:
        try:
            cases, more = member_cases(model, system, tree, member, root_radius_m, cases, options)
            fields += more
        except SolveError as error:
            failed["member"] = str(error)
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
