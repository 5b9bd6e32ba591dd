"""Meshes and tables of sections 4.1 to 4.3: first meshes, each step of the optimisation, and their measures beside the printed ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from scan2fea.errors import Scan2FeaError, StageError, require
from scan2fea.kernel.measures import area, volume
from scan2fea.kernel.quality import TRIANGLE_LIMITS, triangle_quality
from scan2fea.kernel.topology import face_components
from scan2fea.reconstruction.scale_space import smoothing_radius
from scan2fea.repair.clean import taken, without_unused
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.best import KNOWN, STATED, Best, best, shown
from scan2fea.thesis.chain import STEPS, Step
from scan2fea.thesis.clouds import beam_points, beam_solid
from scan2fea.thesis.experiment import Cell, Made, Table
from scan2fea.thesis.measured import QUALITIES, Measured, measured
from scan2fea.thesis.meshes import QUICK_ITERATIONS, figures_of, first_mesh, half_edges_before, step, steps
from scan2fea.thesis.pictures import mesh_figure, views_of
from scan2fea.thesis.published import Printed, printed_tables, stated
from scan2fea.types import TriangleMesh

HEAD = (
    "mesh", "stage", "whose", *QUALITIES, "Q2 corrected", "bounded surfaces", "half edges", "crossings", "volume / true", "wall, mm", "converts",
    "reason",
)  # fmt: skip
SAME, HELD, BEST, PUBLISHED = "ours, same method", "ours, same steps, surface held", "ours, best route", "published"
SHADES = "faces by shape, 2 r / R: yellow equilateral, dark blue degenerate"
NAMES = {"AF": "advancing front", "SS2": "scale space 2", "SS4": "scale space 4", "SS15": "scale space 15"}


def mesh_picture_of(case: str, mesh: str, stage: str) -> Callable[[Bench], Made]:
    """The figure of one mesh after one step."""

    def make(bench: Bench) -> Made:
        points = beam_points(bench, case)
        views = views_of(points)
        if stage == "first":
            shown = first_mesh(bench, case, mesh)
            says = [f"{NAMES[mesh]}: {len(shown.faces):,} triangles on {len(points):,} points, {half_edges_before(bench, case, mesh):,} half edges."]
            if mesh != "AF":
                radius = smoothing_radius(points)
                says.append(f"Radius of smoothing {1e3 * radius:.2f} mm, wall {1e3 * stated('beam_thickness_m'):.2f} mm.")
        else:
            found = step(bench, case, mesh, stage)
            shown, says = found.mesh, [f"{NAMES[mesh]}, {stage}: {found.done}."]
            says += changed(step(bench, case, mesh, STEPS[STEPS.index(stage) - 1]), found)
            if stage in ("perturb", "exude") and not len(found.tets):
                says += _of_held_tets(bench, case, mesh, stage)
        return Made(picture=mesh_figure(shown, views, SHADES), says=(*says, *_quick(bench, case)))

    return make


def _quick(bench: Bench, case: str) -> tuple[str, ...]:
    """Where a quick run makes less: of the HDL-32E the beam is whole."""
    if not bench.options.quick:
        return ()
    length_m = beam_solid(bench).shape.parameters["length"]
    fewer = f"{QUICK_ITERATIONS} iterations of Lloyd and of ODT at most"
    return (f"Quick: {fewer}.",) if case == "hdl" else (f"Quick: a stretch of {length_m:g} m of the beam, {fewer}.",)


def _of_held_tets(bench: Bench, case: str, mesh: str, stage: str) -> list[str]:
    """What a step does to tets where the thesis's own surface holds none: on the surface that Lloyd and ODT have held; of a quick run AF alone."""
    held = {} if bench.options.quick and mesh != "AF" else steps(bench, case, mesh, held=True)
    if stage not in held or not len(held[stage].tets):
        return []
    return [f"Where Lloyd and ODT are held to the surface: {held[stage].done}.", *changed(held[STEPS[STEPS.index(stage) - 1]], held[stage])]


def changed(before: Step, now: Step) -> list[str]:
    """What one step of the chain did to the mesh of the step before, in figures."""
    says = []
    if before.mesh.vertices.shape == now.mesh.vertices.shape:
        away = 1e3 * np.linalg.norm(now.mesh.vertices - before.mesh.vertices, axis=1)
        moved = f"{np.count_nonzero(away):,} of {len(away):,} vertices of the surface moved"
        says.append(moved + (f", by {np.median(away):.3g} mm in the median, {away.max():.3g} mm at most" if away.any() else ""))
    q3 = [np.asarray(triangle_quality(s.mesh.vertices, s.mesh.faces)["Q3"]) for s in (before, now)]
    if before.mesh is not now.mesh and not np.array_equal(q3[0], q3[1]):
        least, middle = (" to ".join(f"{pick(q):.3g}" for q in q3) for pick in (np.min, np.median))
        area_m2 = " to ".join(f"{area(s.mesh):.4g}" for s in (before, now))
        says.append(f"least Q3 {least}, its median {middle}, area {area_m2} m2")
    if len(before.tets) and len(now.tets):
        own, others = ({tuple(row) for row in np.sort(s.tets, axis=1).tolist()} for s in (now, before))
        inside = np.count_nonzero(np.any(now.nodes != before.nodes, axis=1)) if now.nodes.shape == before.nodes.shape else 0
        joined = f"{len(own - others):,} of {len(own):,} tets join other nodes than before"
        says.append(f"{inside:,} of {len(now.nodes):,} nodes of the tets moved, {joined}")
        if inside == 0:
            says.append("exudation changes which nodes are joined, not where they are: it turns no lip and smooths no pock-marks")
    elif len(now.tets):
        says.append("the tets were made anew inside; the vertices of the surface are held")
    return [f"Beside the step before: {'; '.join(says)}."] if says else []


def quality_table(name: str, case: str) -> Callable[[Bench], Made]:
    """Tables 4.1 to 4.6."""

    def make(bench: Bench) -> Made:
        rows: list[tuple[Cell, ...]] = []
        says: list[str] = []
        for printed in printed_tables()[name].rows:
            rows.append(_printed_row(printed))
            try:
                found, done = figures_of(bench, case, printed.mesh, printed.stage)
            except Scan2FeaError as error:
                rows.append((printed.mesh, printed.stage, SAME, *[None] * (len(HEAD) - 5), False, str(error)))
                says.append(f"{printed.mesh}, {printed.stage}: {error}")
                continue
            before = half_edges_before(bench, case, printed.mesh) if printed.stage == "initial" else found.n_half_edges
            reason = found.reason or (done.done if done.done.startswith("not done") and printed.stage == "optimised" else "")
            rows.append(_measured_row(bench, case, printed.mesh, printed.stage, SAME, found, before, reason))
            says += _why(bench, case, printed, found, reason)
            if printed.stage == "optimised" and (printed.mesh == "AF" or not bench.options.quick):
                rows.append(_held_row(bench, case, printed.mesh))
        rows += [_best_row(bench, name) for name in shown(case, quick=bench.options.quick)]
        return Made(table=Table(head=HEAD, rows=tuple(rows)), says=(*dict.fromkeys(says), *_quick(bench, case)))

    return make


def _held_row(bench: Bench, case: str, mesh: str) -> tuple[Cell, ...]:
    """The same steps with Lloyd and ODT held to the surface."""
    try:
        found, done = figures_of(bench, case, mesh, "optimised", held=True)
    except Scan2FeaError as error:
        return (mesh, "optimised", HELD, *[None] * (len(HEAD) - 5), False, str(error))
    reason = found.reason or (done.done if done.done.startswith("not done") else "")
    return _measured_row(bench, case, mesh, "optimised", HELD, found, found.n_half_edges, reason)


def _printed_row(p: Printed) -> tuple[Cell, ...]:
    return (p.mesh, p.stage, PUBLISHED, *p.measures(), None, None, p.shells, None, None, None, None, p.converts, "")


def _measured_row(bench: Bench, case: str, mesh: str, stage: str, whose: str, m: Measured, half_edges: int, reason: str) -> tuple[Cell, ...]:
    true = beam_solid(bench).volume_m3 if whose in (SAME, HELD) and case != "hdl" else _whole_volume(bench)
    ratio = None if m.volume_m3 is None else m.volume_m3 / true
    wall = None if m.wall_m is None or not np.isfinite(m.wall_m) else 1e3 * m.wall_m
    return (mesh, stage, whose, *m.q, m.q2_corrected, m.n_shells, half_edges, m.n_crossings, ratio, wall, not reason, reason)


def _whole_volume(bench: Bench) -> float:
    d = stated("beam_leg_m"), stated("beam_thickness_m")
    return d[1] * (2 * d[0] - d[1]) * stated("beam_length_m")


def _best_row(bench: Bench, case: str) -> tuple[Cell, ...]:
    try:
        found: Best = best(bench, case)
    except Scan2FeaError as error:
        return ("pipeline", "", BEST, *[None] * (len(HEAD) - 5), False, str(error))
    told = ", section known" if case in KNOWN else ", noise stated" if case in STATED else ""
    route = str(found.row.get("route") or "") + told
    if found.surface is None:
        return ("pipeline", route, BEST, *[None] * (len(HEAD) - 5), found.converted, found.reason)
    m = bench.kept(f"measured best {case}", lambda: measured(_required(found.surface)))
    return (*_measured_row(bench, case, "pipeline", route, BEST, m, m.n_half_edges, "")[:-2], found.converted, found.reason)


def _required(mesh: TriangleMesh | None) -> TriangleMesh:
    require(mesh is not None, StageError, "the object has no surface")
    return mesh  # type: ignore[return-value]


def _why(bench: Bench, case: str, p: Printed, m: Measured, reason: str) -> Iterable[str]:
    """Sentences where our figures differ from the printed ones, each from its own rule."""
    label = f"{p.mesh}, {p.stage}"
    best_q3 = TRIANGLE_LIMITS["Q3"].best
    if p.q3 > best_q3:
        yield f"{label}: the printed Q3 {p.q3:g} is above {best_q3:g}, that of an equilateral triangle: a slip of the point ({p.q3 / 10:g}?)."
    if p.converts != (not reason):
        told = "converts in the thesis, not here" if p.converts else "fails in the thesis, converts here"
        yield f"{label}: {told}" + (f" ({reason})." if reason else ": the surface bounds one solid; the volume ratio tells whether the right one.")
    if p.mesh != "AF" and p.stage == "initial":
        radius, wall = smoothing_radius(beam_points(bench, case)), stated("beam_thickness_m")
        if radius > wall:
            yield f"{label}: the ball of smoothing ({1e3 * radius:.1f} mm) holds points of both faces of the wall ({1e3 * wall:.2f} mm)."
        if p.converts is False and not reason:
            yield f"{label}: its vertices are taken back to where they were measured (Algorithm 2): no thickness is lost; see table 3.2."
    ratio = max((a / b for a, b in zip(p.measures(), m.q, strict=False) if b > 0), default=0.0)
    if ratio > 10 or min(m.q[:4]) <= 0:
        yield (
            f"{label}: the least quality is of one triangle among {m.n_faces:,}, and follows the cloud's smallest gaps, which the thesis does "
            "not tell."
        )
    if p.shells != m.n_shells:
        yield f"{label}: {m.n_shells} shell{'s' * (m.n_shells != 1)} here, {p.shells} in the thesis."


def largest_part(mesh: TriangleMesh) -> tuple[TriangleMesh, int]:
    """The shell of the largest area, and how many others were cut off: what the thesis does by hand in figures 4.52 and 4.53."""
    n, label = face_components(mesh.faces)
    parts = [without_unused(taken(mesh, label == k)) for k in range(n)]
    return parts[int(np.argmax([area(part) for part in parts]))], n - 1


def cut_picture(mesh: str) -> Callable[[Bench], Made]:
    """Figures 4.52 and 4.53."""

    def make(bench: Bench) -> Made:
        found = step(bench, "hdl", mesh, "exude")
        kept, n_cut = largest_part(found.mesh)
        says = f"{n_cut} of {n_cut + 1} shells cut off automatically: all but the largest; {1e3 * abs(volume(kept)):.3f} l remain."
        beside = "; ".join(f"{title} {_in_brief(measured(shape))}" for title, shape in (("before the cut", found.mesh), ("after it", kept)))
        return Made(picture=mesh_figure(kept, views_of(beam_points(bench, "hdl")), SHADES), says=(says, f"{beside[0].upper()}{beside[1:]}."))

    return make


def _in_brief(m: Measured) -> str:
    return f"{m.n_faces:,} triangles, least Q3 {m.q[2]:.3g}, " + (f"no solid: {m.reason}" if m.reason else "one solid")


def cut_table(bench: Bench) -> Made:
    """Table 4.7."""
    rows: list[tuple[Cell, ...]] = []
    says: list[str] = []
    for printed in printed_tables()["T4.7"].rows:
        rows.append(_printed_row(printed))
        try:
            kept, n_cut = largest_part(step(bench, "hdl", printed.mesh, "exude").mesh)
        except Scan2FeaError as error:
            rows.append((printed.mesh, printed.stage, SAME, *[None] * (len(HEAD) - 5), False, str(error)))
            continue
        m = measured(kept)
        rows.append(_measured_row(bench, "hdl", printed.mesh, printed.stage, SAME, m, m.n_half_edges, m.reason))
        says += [f"{printed.mesh}: {n_cut} shells cut off.", *_why(bench, "hdl", printed, m, m.reason)]
    rows += [_best_row(bench, name) for name in shown("hdl", quick=bench.options.quick)]
    return Made(table=Table(head=HEAD, rows=tuple(rows)), says=tuple(says))
