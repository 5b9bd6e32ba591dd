"""The thesis's own chain of meshes (3.3.6 and 3.3.7), from the methods of this program in their plain forms.

advancing front, or scale space S + pivoting ball + return to scale 0  ->  holes patched (Liepa)  ->  Lloyd  ->  ODT  ->  tets  ->  perturb  ->  exude
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import MeshingError, ReconstructionError, Scan2FeaError, require
from scan2fea.kernel.delaunay import tetrahedralise
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.quality import tet_dihedrals
from scan2fea.kernel.relaxation import Relaxed
from scan2fea.reconstruction.advancing_front import front
from scan2fea.reconstruction.ball_pivoting import PivotOptions, pivoted
from scan2fea.reconstruction.denoise import denoise
from scan2fea.reconstruction.outside import OutsideOptions, floods, prepare
from scan2fea.reconstruction.scale_space import smoothed, smoothing_radius
from scan2fea.reconstruction.winding import fitted, polish
from scan2fea.remeshing.lloyd import lloyd
from scan2fea.remeshing.odt import odt
from scan2fea.repair.clean import oriented, split_fans, without_duplicates, without_flat_faces, without_unused
from scan2fea.repair.holes import filled_free
from scan2fea.tetmeshing import FillOptions, fill
from scan2fea.tetmeshing.optimise import OptimiseOptions, optimised
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value

STEPS = ("first", "patched", "lloyd", "odt", "perturb", "exude")
TET_GROWTH = 0.4
ROUNDS = 5  # iterations between two looks at the clock, where that is the limit


@dataclass(frozen=True, eq=False, kw_only=True)
class Step(Value):
    """The surface after a step, and the tets inside where there are any (from perturbation on).

    done : what was done, in words.   dihedral_deg : smallest angle of the tets, nan without.
    """

    name: str
    mesh: TriangleMesh
    nodes: FloatArray
    tets: IntArray
    done: str
    dihedral_deg: float


@dataclass(frozen=True, kw_only=True)
class ChainOptions:
    """lloyd, odt : iterations.   clock_s : the thesis's limit of time of ODT, perturbation and exudation, instead of the limit of iterations.

    held : Lloyd and ODT keep the surface where it is; the thesis's own form lets it wander.
    """

    lloyd: int = 200
    odt: int = 200
    clock_s: float | None = None
    held: bool = False
    seed: int = 0


def advancing_front_mesh(points: FloatArray, seed: int = 0) -> TriangleMesh:
    """The plain front through points (n, 3): no normals, nothing denoised, as in the thesis. Raises ReconstructionError."""
    tetra = tetrahedralise(points, spacing(points, seed), seed)
    return _mesh(points, front(tetra).faces)


def outward(points: FloatArray, seed: int = 0) -> FloatArray:
    """(n, 3) outward normals, which the pivoting ball needs. Raises ReconstructionError."""
    setting = prepare(points, seed)
    first = next(floods(setting, OutsideOptions(seed=seed)))  # the likeliest answer; no surface is cut and no gate asked
    normals, sigma, _ = fitted(points, polish(points, first.signed, setting.spacing_m), setting.spacing_m)
    return denoise(points, normals, setting.spacing_m, sigma).normals


def scale_space_mesh(points: FloatArray, normals: FloatArray, scale: int, seed: int = 0, *, at_scale: bool = False) -> TriangleMesh:
    """Points (n, 3) smoothed `scale` times with all their neighbours, meshed there by the pivoting ball, and taken back unless `at_scale`."""
    moved = smoothed(points, smoothing_radius(points, seed), scale)
    gap = spacing(points, seed)
    tetra = tetrahedralise(moved, gap, seed)
    return _mesh(moved if at_scale else points, pivoted(tetra, normals, gap * np.array(PivotOptions().pivot_radii)).faces)


def _mesh(points: FloatArray, faces: IntArray) -> TriangleMesh:
    require(len(faces) > 0, ReconstructionError, "no triangle rests on the points: there is no surface")
    return TriangleMesh(vertices=np.asarray(points), faces=faces)


def patched(mesh: TriangleMesh) -> TriangleMesh:
    """Every border closed by triangles between its edges, refined and faired."""
    for clean in (without_duplicates, without_flat_faces, split_fans, oriented, split_fans, without_unused):
        mesh = clean(mesh)
    return without_unused(replace(filled_free(mesh).mesh, face_origin=None, face_region=None))


def chain(first: TriangleMesh, options: ChainOptions = ChainOptions()) -> tuple[Step, ...]:
    """All steps from a first mesh on; ends early, with the reason as the last step's `done`, where one cannot be made."""
    steps = [_surface("first", first, f"{len(first.faces):,} triangles")]
    makers: tuple[tuple[str, Callable[[TriangleMesh], tuple[TriangleMesh, str]]], ...] = (
        ("patched", lambda mesh: (patched(mesh), "holes patched")),
        ("lloyd", lambda mesh: _relaxed(lloyd, mesh, options.lloyd, None, options.held)),
        ("odt", lambda mesh: _relaxed(odt, mesh, options.odt, options.clock_s, options.held)),
    )
    for name, make in makers:
        try:
            mesh, done = make(steps[-1].mesh)
        except Scan2FeaError as error:
            return (*steps, _surface(name, steps[-1].mesh, f"not done: {error}"))
        steps.append(_surface(name, mesh, done))
    return (*steps, *_tets(steps[-1].mesh, options))


def _relaxed(
    method: Callable[..., tuple[TriangleMesh, Relaxed]], mesh: TriangleMesh, iterations: int, clock_s: float | None, held: bool
) -> tuple[TriangleMesh, str]:
    """Held: vertices slide on the surface, creases on their lines. Else, as the thesis has it, nothing is held and nothing put back."""
    began, count, why = time.monotonic(), 0, "iterations"
    while count < iterations:
        mesh, found = method(mesh, iterations if clock_s is None else ROUNDS, constrained=held)
        count, why = count + found.iterations, found.why
        if clock_s is None or why != "iterations" or time.monotonic() - began > clock_s:
            break
    return replace(mesh, face_region=None), f"{count} iterations, ended: {why}"


def _tets(mesh: TriangleMesh, options: ChainOptions) -> list[Step]:
    """Perturbation and exudation work on tets: the surface must bound a solid. It stays as it is."""
    try:
        wanted = FillOptions(route="surface", optimise="none", order=1, growth=TET_GROWTH, seed=options.seed, max_elements=200_000)
        solid = fill(mesh, None, wanted).tets
    except MeshingError as error:
        return [_surface(name, mesh, f"not done: the surface holds no tets: {error}") for name in ("perturb", "exude")]
    nodes, tets = np.asarray(solid.nodes), np.asarray(solid.tets[:, :4])
    steps = []
    for name in ("perturb", "exude"):
        before = float(tet_dihedrals(nodes, tets).min())
        found = optimised(nodes, tets, OptimiseOptions(optimise=name, optimise_time_s=options.clock_s, seed=options.seed))
        nodes, tets = found.nodes, found.tets
        angle = float(tet_dihedrals(nodes, tets).min())
        done = f"smallest dihedral angle {before:.2f} to {angle:.2f} degrees in {len(tets):,} tets"
        steps.append(Step(name=name, mesh=mesh, nodes=nodes, tets=tets, done=done, dihedral_deg=angle))
    return steps


def _surface(name: str, mesh: TriangleMesh, done: str) -> Step:
    return Step(name=name, mesh=mesh, nodes=np.zeros((0, 3)), tets=np.zeros((0, 4), np.int64), done=done, dihedral_deg=float("nan"))
