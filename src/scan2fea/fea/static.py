"""Static cases on one set of supports: displacement, reaction, energy, stress, each with what it is held against."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.errors import SolveError, require
from scan2fea.fea.assemble import System
from scan2fea.fea.buckle import buckling_factors, stress_stiffness
from scan2fea.fea.elements import surface_volume
from scan2fea.fea.inner import InnerForces
from scan2fea.fea.linear import Shared, StaticSolver
from scan2fea.fea.loads import nodal_forces
from scan2fea.fea.options import FeaOptions
from scan2fea.fea.restrain import held_unknowns, inertia_balanced, rigid_fields, three_points
from scan2fea.fea.singular import outside_ring, singular_places
from scan2fea.fea.strain import at_nodes, energies, von_mises
from scan2fea.types import BoolArray, CaseField, CaseResult, FEModel, FloatArray, IntArray, LoadCase

SELF_WEIGHT = "self_weight"
ROUNDING = 1e-9  # of the largest force at a node
_QUANTILE = 0.99


def figure(name: str, measure: str, unit: str, value: float, expected: float | None = None, std: float | None = None) -> CaseResult:
    """One row of the results; the relative error is against `expected` where one is given."""
    if expected is None:
        return CaseResult(name=name, measure=measure, unit=unit, value=float(value), std=std)
    error = abs(value - expected) / abs(expected) if expected else math.inf
    return CaseResult(name=name, measure=measure, unit=unit, value=float(value), expected=float(expected), relative_error=float(error), std=std)


class Statics:
    """The static solver of a model and what its cases share."""

    def __init__(self, model: FEModel, system: System, shared: Shared | None, options: FeaOptions) -> None:
        self.model, self.system, self.options = model, system, options
        self.held = held_unknowns(model)
        self.failed: dict[str, str] = {}  # what a case that was solved lacks
        self._shared = shared
        self.solver = self._with(self.held)
        self._floating: StaticSolver | None = None
        self.singular = singular_places(model)
        self._clear = outside_ring(model.mesh, self.singular)

    def _with(self, held: BoolArray) -> StaticSolver:
        mesh = self.model.mesh
        rigid, exact = rigid_fields(np.asarray(mesh.nodes)), InnerForces(mesh, self.model.material)
        return StaticSolver(self.system, self._shared, rigid, held, exact, self.options)

    def self_weight(self) -> tuple[tuple[CaseResult, ...], CaseField, str]:
        # consistent load: the integral of N_i rho a is row i of the mass times a
        mesh = self.model.mesh
        force = np.asarray(self.system.mass_matrix().sum(axis=1))[:, None] * self.model.acceleration_m_s2
        size = float(np.linalg.norm(self.model.acceleration_m_s2))
        weight = self.model.material.density_kg_m3 * surface_volume(np.asarray(mesh.nodes), np.asarray(mesh.boundary)) * size
        return self._case(SELF_WEIGHT, force, self.solver, self.held, expected_reaction=weight)

    def user_case(self, case: LoadCase) -> tuple[tuple[CaseResult, ...], CaseField, str]:
        """Raises SolveError: no equilibrium, a load on nothing, or on what is held (of a floating part: one that its inertia balances everywhere)."""
        force = nodal_forces(self.model, self.system, case)
        if not self.model.is_floating:
            _require_moves(np.where(self.held, 0.0, force), force, case.name)
            return self._case(case.name, force, self.solver, self.held)
        nodes = np.asarray(self.model.mesh.nodes)
        held = three_points(nodes)
        if self._floating is None:
            self._floating = self._with(held)
        balanced = inertia_balanced(nodes, self.system, force)
        _require_moves(balanced, force, case.name)
        rows, field, solver = self._case(case.name, balanced, self._floating, held)
        return rows, field, f"{solver} (balanced by inertia)"

    def _case(
        self, name: str, force: FloatArray, solver: StaticSolver, held: BoolArray, expected_reaction: float | None = None
    ) -> tuple[tuple[CaseResult, ...], CaseField, str]:
        mesh, material = self.model.mesh, self.model.material
        title = name.replace("_", " ")
        found = solver.together({title: force})[title]
        u = found.displacement
        inner = InnerForces(mesh, material)(u)
        reaction = np.where(held, inner - force, 0.0).sum(axis=0)
        applied = force.sum(axis=0)
        stress, volume = von_mises(mesh, material, u)
        strain_energy = float(energies(mesh, material, u[None])[0, 0]) / 2
        averaged = at_nodes(mesh, stress, volume)
        reaction_size = float(np.linalg.norm(reaction))
        applied_size = expected_reaction if expected_reaction is not None else float(np.linalg.norm(applied))
        load = float(np.linalg.norm(force, axis=1).sum())
        carries = applied_size > 1e-6 * load
        rows = [
            figure(name, "displacement_max_m", "m", float(np.linalg.norm(u, axis=1).max())),
            figure(name, "reaction_n", "N", reaction_size, applied_size if carries else None),
            figure(name, "strain_energy_j", "J", strain_energy, 0.5 * float(np.vdot(force, u))),
            *_stress_rows(name, stress, volume, averaged, np.asarray(mesh.tets), self._clear),
            figure(name, "residual", "", found.residual),
        ]
        if self.options.buckling and name != SELF_WEIGHT and not self.model.is_floating:
            try:
                factors, _ = buckling_factors(stress_stiffness(mesh, material, self.system, u), solver, held, u[None])
                rows += [figure(name, "buckling_factor", "1", float(factors[0]))] if len(factors) else []
            except SolveError as error:  # of a load that pulls alone: its displacements stand
                self.failed[f"{name}: buckling"] = str(error)
        field = CaseField(name=name, displacement_m=u, von_mises_pa=averaged, reaction_n=reaction, applied_n=applied, load_n=load)
        return tuple(rows), field, found.solver


def _require_moves(left: FloatArray, force: FloatArray, name: str) -> None:
    """left : (n, 3) what of the loads (n, 3) deforms the part."""
    moves = float(np.abs(left).max()) > ROUNDING * float(np.abs(force).max())
    require(moves, SolveError, f"case {name}: its loads deform nothing: they act on what is held, or move the free part as a whole")


def _stress_rows(name: str, stress: FloatArray, volume: FloatArray, averaged: FloatArray, tets: IntArray, clear: BoolArray) -> list[CaseResult]:
    """What 99 % of the volume stay below; the peak outside the ring round singular places, and how far its element leaves its neighbours."""
    order = np.argsort(stress, kind="stable")
    below = np.cumsum(volume[order]) / volume.sum()
    rows = [figure(name, "stress_p99_pa", "Pa", float(stress[order][min(int(np.searchsorted(below, _QUANTILE)), len(order) - 1)]))]
    if clear.any():
        each = stress.reshape(len(tets), -1)
        place = int(np.where(clear, each.max(axis=1), -1.0).argmax())
        peak, smooth = float(each[place].max()), float(averaged[tets[place, :4]].max())
        rows.append(figure(name, "stress_peak_pa", "Pa", peak))
        if peak > 0:
            rows.append(figure(name, "stress_peak_jump", "share", abs(peak - smooth) / peak))
    return rows


def solve_cases(statics: Statics) -> tuple[list[CaseResult], list[CaseField], dict[str, str], str]:
    """(rows, fields, why cases have none, solver) of the self weight and the user's cases; one that fails fails alone."""
    rows, field, solver = statics.self_weight()
    found, fields, failed = list(rows), [field], dict(statics.model.failed)
    for case in statics.model.cases:
        try:
            rows, field, _ = statics.user_case(case)
        except SolveError as error:
            failed[case.name] = str(error)
            continue
        found += rows
        fields.append(field)
    return found, fields, {**failed, **statics.failed}, solver
