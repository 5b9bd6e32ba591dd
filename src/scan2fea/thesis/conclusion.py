"""Section 4.4 and chapter 5, which the thesis left open: shape estimation on each data set, CAD faces, and finite elements beside the true beam."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from scan2fea.errors import Scan2FeaError
from scan2fea.estimation.layers import layers_of
from scan2fea.estimation.solid import solid_of
from scan2fea.fea import FeaOptions, build_model, solve
from scan2fea.fea.beam_theory import tip_under_force
from scan2fea.fea.materials import chosen_material
from scan2fea.fea.section_properties import properties_of
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area
from scan2fea.report.camera import Camera, framed, look_at
from scan2fea.report.colours import categories
from scan2fea.report.render import Shape, render
from scan2fea.tetmeshing import layered
from scan2fea.thesis.bench import Bench, ThesisOptions
from scan2fea.thesis.best import CASES, GIVEN, OF_CLOUD, STATED, Best, best
from scan2fea.thesis.canvas import tiles
from scan2fea.thesis.clouds import BEAM, DENSE_M, beam_points, lab, treated
from scan2fea.thesis.experiment import Cell, Made, Table
from scan2fea.thesis.meshes import first_mesh
from scan2fea.thesis.pictures import cloud_picture, mesh_picture
from scan2fea.thesis.published import stated
from scan2fea.types import CaseResult, FloatArray, Member, Parameter

SETS = ("zero", "noise", "hdl")
QUICK = ("zero", "noise", "hdl_known")
FIGURES = (
    ("bend_x", "tip_x_m", f"tip along the leg under {FeaOptions().test_force_n:g} N, mm", 1e3), ("bend_x", "tip_y_m", "tip across it, mm", 1e3),
    ("modal", "f7_hz", "f1, Hz", 1.0), ("modal", "f8_hz", "f2, Hz", 1.0), ("modal", "f9_hz", "f3, Hz", 1.0), ("mass", "mass_kg", "mass, kg", 1.0),
)  # fmt: skip
FEA_HEAD = ("beam", *(title for _, _, title, _ in FIGURES), "error of the tip, %")
_WIDE, _HIGH = 460, 300
SIZES = ("data set", "dimension", "true, mm", "found, mm", "standard deviation, mm", "told by the data", "error in standard deviations")
END = 0.08  # of the length, in the view of one end


def cases_of(options: ThesisOptions) -> tuple[str, ...]:
    """The data sets of a run; a quick one leaves readings of the noise out."""
    return QUICK if options.quick else tuple(CASES)


def _found(bench: Bench, says: list[str]) -> Iterator[tuple[str, Best]]:
    """Each data set and what the best route makes of it; one that it makes nothing of has its reason entered in `says`."""
    for case in cases_of(bench.options):
        try:
            found = best(bench, case)
        except Scan2FeaError as error:
            says.append(f"{CASES[case]}: {error}")
        else:
            yield case, found


def dimensions(bench: Bench) -> Made:
    """Section 4.4 as a table: what each data set tells of the beam."""
    volume = lab(bench.options.seed).solids[BEAM].volume_m3
    rows: list[tuple[Cell, ...]] = []
    says: list[str] = []
    for case, found in _found(bench, says):
        rows += _sizes(bench, found)
        ratio = None if found.volume_m3 is None else found.volume_m3 / volume
        told = "" if ratio is None else f", volume {ratio:.4f} of the true one"
        verdict = "converted" if found.converted else "failed"
        says.append(f"{CASES[case]}: {verdict}{told}: {found.reason}. Given beyond the scan: {GIVEN[case]}.")
        says += [*_posterior(found), *_assumed(bench, found), *_bound(found)]
    says.append("The best route is given noisy points that lie evenly at random: on the lab's grid a narrow toe has more than its share of them.")
    return Made(table=Table(head=SIZES, rows=tuple(rows)), says=tuple(says))


def _sizes(bench: Bench, found: Best) -> list[tuple[Cell, ...]]:
    """Rows of SIZES: the dimensions beside the true ones."""
    true = lab(bench.options.seed).solids[BEAM].shape.parameters
    rows: list[tuple[Cell, ...]] = []
    for name, (value, std, observable) in found.parameters().items():
        size = true.get(name)
        error_std = None if size is None or not std else (value - size) / std
        cells = (None if size is None else 1e3 * size, 1e3 * value, None if std is None else 1e3 * std, observable, error_std)
        rows.append((CASES[found.case], name, *cells))
    return rows


def _posterior(found: Best) -> list[str]:
    """What the catalogue says where the data do not tell a wall."""
    entries = (found.row.get("member") or {}).get("catalogue") or []
    hidden = [name for name, (_, _, observable) in found.parameters().items() if not observable]
    if not hidden or not entries:
        return []
    likeliest = "; ".join(f"{e['name']} {100 * e['probability']:.0f} %" for e in entries[:3])
    return [f"{CASES[found.case]}: not told by the points: {', '.join(hidden)}; the catalogue's posterior: {likeliest}."]


def _assumed(bench: Bench, found: Best) -> list[str]:
    """What was built where the points do not tell a wall, beside the truth and the doubt that the program states of it."""
    true, says = lab(bench.options.seed).solids[BEAM].shape.parameters, []
    for name, told in ((found.row.get("member") or {}).get("parameters") or {}).items():
        if told["observable"] or not told.get("spread_m") or name not in true or found.surface is None:
            continue
        value, spread, size = told["value_m"], told["spread_m"], true[name]
        off = f"{1e3 * (value - size):+.2f} mm off the true {1e3 * size:.2f}, {abs(value - size) / spread:.1f} times the doubt stated of it"
        says.append(f"{CASES[found.case]}: {name} was assumed, not measured: built with {1e3 * value:.2f} mm, {off} ({1e3 * spread:.2f} mm).")
    return says


def wall_bound(wall_m: float, sigma_m: float, n: int) -> float:
    """Standard deviation (m) below which no method tells a wall under wider Gaussian noise of known size, from n points (Cramer-Rao, t << sigma).

    Both faces together are one hump of variance v = sigma^2 + t^2 / 4; n points tell v to v sqrt(2 / n), and dt = 2 dv / t.
    """
    return 2 * (sigma_m**2 + wall_m**2 / 4) * math.sqrt(2 / n) / wall_m


def _bound(found: Best) -> list[str]:
    """What the points can tell of the wall at best, where Gaussian noise is stated and wider than it."""
    n, wall = int(found.row.get("n_points") or 0), stated("beam_thickness_m")
    law, sigma = STATED.get(found.case, ("", 0.0))
    if law != "gaussian" or n == 0 or sigma < wall:
        return []
    least = wall_bound(wall, sigma, n)
    at_best = f"the wall of {1e3 * wall:.2f} mm to {1e3 * least:.2f} mm at best ({100 * least / wall:.0f} %, one standard deviation)"
    return [f"{CASES[found.case]}: {n:,} points under noise of {1e3 * sigma:.1f} mm, known exactly, tell {at_best}, whatever the method."]


def four_pictures(case: str) -> Callable[[Bench], Made]:
    """Section 4.4 of one data set: the isolated beam, the first mesh, the estimated cloud and solid with its dimensions, the optimised mesh."""

    def make(bench: Bench) -> Made:
        points = beam_points(bench, case)
        scene = treated(bench, case)
        isolated = scene.points[scene.labels == scene.beam] if scene.beam >= 0 else points
        camera = look_at(points, width_px=_WIDE, height_px=_HIGH)
        wide = look_at(isolated, width_px=_WIDE, height_px=_HIGH)
        pictures = [("isolated beam", cloud_picture(isolated, camera=wide))]
        says = [f"{len(isolated):,} points in the beam's cluster."]
        try:
            pictures.append(("first mesh, advancing front", mesh_picture(first_mesh(bench, case, "AF"), camera)))
        except Scan2FeaError as error:
            says.append(f"No first mesh: {error}")
        found = best(bench, OF_CLOUD[case][0])
        if found.surface is not None:
            view = look_at(found.surface.vertices, width_px=_WIDE, height_px=_HIGH)
            close = _one_end(found.surface.vertices, view)
            cloud, _ = sample_surface(found.surface, round(area(found.surface) / DENSE_M**2), bench.options.seed)
            pictures.append((f"estimated cloud, {len(cloud):,} points", cloud_picture(cloud, camera=view)))
            pictures.append(("estimated solid", mesh_picture(found.surface, view)))
            pictures.append(("its mesh, one end", mesh_picture(found.surface, close, lines=True)))
        says.append(f"{CASES[found.case]}: {'converted' if found.converted else 'failed'}: {found.reason}.")
        table = Table(head=SIZES, rows=tuple(_sizes(bench, found)))
        return Made(picture=tiles(pictures, 3), table=table if table.rows else None, says=tuple(says))

    return make


def _one_end(vertices: FloatArray, view: Camera) -> Camera:
    along = vertices @ view.axes[0]
    return framed(vertices[along <= along.min() + END * float(np.ptp(along))], view.axes, _WIDE, _HIGH)


def boundary_representations(bench: Bench) -> Made:
    """Chapter 5: faces of the boundary representations, each in its own colour."""
    pictures, says = [], list[str]()
    for case, found in _found(bench, says):
        if found.surface is None:
            says.append(f"{CASES[case]}: no solid: {found.reason}")
            continue
        vertices, faces = np.asarray(found.surface.vertices), np.asarray(found.surface.faces)
        view = look_at(vertices, width_px=_WIDE, height_px=_HIGH)
        close = _one_end(vertices, view)
        region = np.zeros(len(faces), np.int64) if found.surface.face_region is None else np.asarray(found.surface.face_region)
        pictures.append((f"{case}, one end", render(close, (Shape(vertices=vertices, faces=faces, colours=categories(region), smooth=False),))))
        says.append(f"{CASES[case]}: {len(np.unique(region))} faces, {'converted' if found.converted else 'not converted'}.")
    if not pictures:
        return Made(failed="no data set gave a solid", says=tuple(says))
    return Made(picture=tiles(pictures, 3), says=tuple(says))


def finite_elements(bench: Bench) -> Made:
    """Chapter 5: what the converted beams do beside the true one."""
    true = bench.kept("true beam", lambda: true_response(bench))
    rows: list[tuple[Cell, ...]] = [("true beam, beam theory", *scaled(theory(bench)), None), ("true beam, finite elements", *scaled(true), None)]
    says: list[str] = []
    for case, found in _found(bench, says):
        if not found.converted:
            says.append(f"{CASES[case]}: not converted: {found.reason}.")
            continue
        values = {(name, measure): case_value[0] for name, measure, _, _ in FIGURES if (case_value := found.case_value(name, measure)) is not None}
        tip, reference = values.get(("bend_x", "tip_x_m")), true["bend_x tip_x_m"]
        rows.append((f"{CASES[case]}, {found.row.get('route')}", *scaled({f"{a} {b}": v for (a, b), v in values.items()}), error_of(tip, reference)))
    used = FeaOptions()
    load = f"{used.test_force_n:g} N at the centroid of the other along a leg"
    says.append(f"Held at one end, {load}; frequencies of the free beam. Steel {used.material}.")
    return Made(table=Table(head=FEA_HEAD, rows=tuple(rows)), says=tuple(says))


def error_of(value: float | None, reference: float) -> float | None:
    return None if value is None else 100 * (abs(value) / abs(reference) - 1)


def scaled(values: dict[str, float]) -> tuple[Cell, ...]:
    return tuple(abs(values[f"{a} {b}"]) * scale if f"{a} {b}" in values else None for a, b, _, scale in FIGURES)


def true_member() -> Member:
    """The beam as the thesis states it."""
    sizes = {"a": stated("beam_leg_m"), "b": stated("beam_leg_m"), "t": stated("beam_thickness_m"), "length": stated("beam_length_m")}
    parameters = tuple(Parameter(name=name, value_m=value, std_m=None, observable=True, source="fixed") for name, value in sizes.items())
    return Member(
        family="L", parameters=parameters, T_world_member=np.eye(4), bow=np.zeros((2, 0)), twist=np.zeros(0),
        end_normals=np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]), covariance=np.zeros((4, 4)), sigma_m=0.0, noise="gaussian", outlier_share=0.0,
        seen={}, families={"L": 1.0},
    )  # fmt: skip


def true_response(bench: Bench) -> dict[str, float]:
    """Figures of the finite element model of the true beam, meshed as a converted one is."""
    member, options = true_member(), FeaOptions()
    at = layers_of(solid_of(member))
    model = build_model(layered(at.points, at.triangles, at.rim, at.rim_tag, at.face_names), options)
    return wanted_of(solve(model, options, member).cases)


def wanted_of(cases: Iterable[CaseResult]) -> dict[str, float]:
    """Those of FIGURES, SI."""
    wanted = {(name, measure) for name, measure, _, _ in FIGURES}
    return {f"{case.name} {case.measure}": case.value for case in cases if (case.name, case.measure) in wanted}


def theory(bench: Bench) -> dict[str, float]:
    """Closed forms of the true beam: tip of the cantilever with shear and twist, and mass."""
    member, options = true_member(), FeaOptions()
    values, material = member.values(), chosen_material(options)
    p = properties_of("L", {name: values[name] for name in ("a", "b", "t")})
    moved, _ = tip_under_force(p, material, values["length"], np.array([options.test_force_n, 0.0]))
    return {
        "bend_x tip_x_m": float(moved[0]), "bend_x tip_y_m": float(moved[1]), "mass mass_kg": material.density_kg_m3 * p.area * values["length"],
    }  # fmt: skip
