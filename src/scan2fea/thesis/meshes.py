"""The meshes of section 4 by the thesis's chain, kept: of each case (zero, noise, hdl) and each first mesh (AF, SS2, SS4, SS15)."""

from __future__ import annotations

import numpy as np

from scan2fea.errors import StageError, require
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.chain import ChainOptions, Step, advancing_front_mesh, chain, outward, scale_space_mesh
from scan2fea.thesis.clouds import beam_points
from scan2fea.thesis.measured import Measured, measured
from scan2fea.types import FloatArray, TriangleMesh

QUICK_ITERATIONS = 40  # of Lloyd and of ODT, in a quick run


def first_mesh(bench: Bench, case: str, mesh: str) -> TriangleMesh:
    """The first mesh, before holes are patched."""
    points, seed = beam_points(bench, case), bench.options.seed

    def make() -> TriangleMesh:
        if mesh == "AF":
            return advancing_front_mesh(points, seed)
        return scale_space_mesh(points, normals_of(bench, case), int(mesh.removeprefix("SS")), seed)

    return bench.kept(f"first {case} {mesh}", make)


def normals_of(bench: Bench, case: str) -> FloatArray:
    """(n, 3) outward normals of the beam's points."""
    return bench.kept(f"normals {case}", lambda: outward(beam_points(bench, case), bench.options.seed))


def steps(bench: Bench, case: str, mesh: str, *, held: bool = False) -> dict[str, Step]:
    """Every step of the chain that could be made, by name."""
    most = QUICK_ITERATIONS if bench.options.quick else ChainOptions.lloyd
    options = ChainOptions(lloyd=most, odt=most, clock_s=bench.options.clock_s, held=held, seed=bench.options.seed)
    found = bench.kept(f"chain {case} {mesh}{' held' * held}", lambda: chain(first_mesh(bench, case, mesh), options))
    return {step.name: step for step in found}


def step(bench: Bench, case: str, mesh: str, name: str) -> Step:
    """One step. Raises StageError, with the reason, where the chain ended before it."""
    found = steps(bench, case, mesh)
    last = list(found.values())[-1]
    require(name in found, StageError, f"{mesh}: the chain ended before: {last.name}: {last.done}")
    return found[name]


def figures_of(bench: Bench, case: str, mesh: str, stage: str, *, held: bool = False) -> tuple[Measured, Step]:
    """What tables 4.1 to 4.7 show: "initial" is the first mesh with its holes patched, "optimised" the surface after the last step."""
    found = steps(bench, case, mesh, held=held)
    name = "patched" if stage == "initial" else list(found)[-1]
    chosen = found.get(name, list(found.values())[-1])
    return bench.kept(f"measured {case} {mesh} {name}{' held' * held}", lambda: measured(chosen.mesh)), chosen


def half_edges_before(bench: Bench, case: str, mesh: str) -> int:
    """Half edges of the first mesh, before its holes are patched."""
    return bench.kept(f"measured {case} {mesh} first", lambda: measured(first_mesh(bench, case, mesh))).n_half_edges


def least_dihedral(step: Step) -> float | None:
    return None if np.isnan(step.dihedral_deg) else step.dihedral_deg
