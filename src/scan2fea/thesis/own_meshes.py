"""Chapter 5 for the thesis's own meshes: what those that bound one solid do under the loads of the true beam."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import partial

import numpy as np

from scan2fea.errors import Scan2FeaError
from scan2fea.fea import FeaOptions, build_model, solve
from scan2fea.kernel.measures import face_vectors
from scan2fea.kernel.noise import spacing
from scan2fea.remeshing import remesh
from scan2fea.tetmeshing import FillOptions, fill
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.clouds import SIGMA_M, beam_points, beam_solid
from scan2fea.thesis.conclusion import FEA_HEAD, error_of, scaled, true_member, true_response, wanted_of
from scan2fea.thesis.experiment import Cell, Made, Table
from scan2fea.thesis.meshes import figures_of, step, steps
from scan2fea.thesis.published import printed_tables
from scan2fea.thesis.results import HELD, NAMES, SAME
from scan2fea.types import FloatArray, TetMesh, TriangleMesh

OF_TABLE = {"T4.1": "zero", "T4.2": "zero", "T4.3": "noise", "T4.4": "noise", "T4.5": "hdl", "T4.6": "hdl"}
SIDES, FIRST, LAST = "SIDES", "END_FIRST", "END_LAST"
END_COS = 0.7  # a face looks along the axis where the cosine between is above this
END_SHARE = 0.02  # of the length, from the end inwards, in which its faces lie


def candidates(bench: Bench) -> Iterator[tuple[str, str, str, bool]]:
    """(case, mesh, stage, held) of the rows of tables 4.1 to 4.6 that convert, each once."""
    rows = dict.fromkeys((case, row.mesh, row.stage) for name, case in OF_TABLE.items() for row in printed_tables()[name].rows)
    for case, mesh, stage in rows:
        for held in (False, True) if stage == "optimised" else (False,):
            try:
                found, done = figures_of(bench, case, mesh, stage, held=held)
            except Scan2FeaError:
                continue  # its row in the table says why
            if found.converts and not (stage == "optimised" and done.done.startswith("not done")):
                yield case, mesh, stage, held


def thesis_meshes(bench: Bench) -> Made:
    """Chapter 5: the thesis's own meshes that convert, beside the true beam."""
    if bench.options.quick:
        return Made(says=("Left to a full run: a quick one meshes a stretch of the beam, which is too short to bend as a beam.",))
    true = bench.kept("true beam", lambda: true_response(bench))
    rows: list[tuple[Cell, ...]] = [("true beam, finite elements", *scaled(true), None)]
    says: list[str] = []
    for case, mesh, stage, held in candidates(bench):
        name = f"{case}: {NAMES[mesh]}, {stage}, {HELD if held else SAME}"
        kept = f"response {case} {mesh} {stage}{' held' * held}"
        try:
            found = bench.kept(kept, partial(_response, bench, case, mesh, stage, held))
        except Scan2FeaError as error:
            says.append(f"{name}: {error}")
            continue
        rows.append((name, *scaled(found), error_of(found.get("bend_x tip_x_m"), true["bend_x tip_x_m"])))
    says.append("Every surface of tables 4.1 to 4.6 that bounds one solid, with triangles of finite element size and quadratic tets inside.")
    return Made(table=Table(head=FEA_HEAD, rows=tuple(rows)), says=tuple(says))


def _response(bench: Bench, case: str, mesh: str, stage: str, held: bool) -> dict[str, float]:
    surface = step(bench, case, mesh, "patched").mesh if stage == "initial" else list(steps(bench, case, mesh, held=held).values())[-1].mesh
    gap, noise = spacing(beam_points(bench, case)), SIGMA_M if case == "noise" else 0.0
    return response(surface, beam_solid(bench).T_world_shape, gap, noise)


def response(surface: TriangleMesh, T_world_shape: FloatArray, spacing_m: float, sigma_m: float) -> dict[str, float]:
    """Figures of `conclusion.FIGURES` of a surface that bounds the beam, in the true beam's place. Raises MeshingError, SolveError."""
    member = dataclasses.replace(true_member(), T_world_member=T_world_shape)
    shape = remesh(surface, spacing_m=spacing_m, sigma_m=sigma_m).mesh
    tets = with_ends(fill(shape, None, FillOptions(route="surface")).tets, T_world_shape)
    options = FeaOptions()
    return wanted_of(solve(build_model(tets, options), options, member).cases)


def with_ends(tets: TetMesh, T_world_shape: FloatArray) -> TetMesh:
    """The same tets with faces SIDES, END_FIRST and END_LAST: what looks along the axis near either end, as the mesh itself has them."""
    faces, axis = np.asarray(tets.boundary[:, :3]), T_world_shape[:3, 2]
    z = (tets.nodes @ axis)[faces]
    outward = face_vectors(tets.nodes, faces)
    along = outward @ axis / np.linalg.norm(outward, axis=1)
    near = END_SHARE * float(np.ptp(z))
    tag = np.zeros(len(z), np.int64)
    tag[(along < -END_COS) & (z.max(axis=1) < z.min() + near)] = 1
    tag[(along > END_COS) & (z.min(axis=1) > z.max() - near)] = 2
    return dataclasses.replace(tets, face_tag=tag, face_names=(SIDES, FIRST, LAST))
