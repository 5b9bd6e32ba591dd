"""The two hypotheses (3.2) put to numbers: when the beam can be isolated, and what a cloud must meet to be converted.

The specimen is a stretch of the thesis's beam, so that spacing and noise are told in walls (6.35 mm). A success is a solid whose volume is within 5 %
of the true one, by the free form's own gates or, of a member, with every dimension told by the points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import Scan2FeaError
from scan2fea.estimation.member import MemberOptions
from scan2fea.filtering import clean_up
from scan2fea.kernel.measures import face_normals, volume
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.pipeline.route import RouteOptions, estimate
from scan2fea.reconstruction import ReconstructionOptions, reconstruct
from scan2fea.reconstruction.scale_space import smoothed, smoothing_radius
from scan2fea.report.colours import viridis
from scan2fea.segmentation.euclidean import euclidean
from scan2fea.segmentation.metrics import agreement
from scan2fea.simulation.sampling import SamplingOptions, sampled_solid
from scan2fea.simulation.solids import Solid
from scan2fea.thesis.bench import Bench, ThesisOptions
from scan2fea.thesis.canvas import FAINT, INK, RED, Canvas, Panel
from scan2fea.thesis.clouds import BEAM, VOXEL_M, clustering, filter_options, lab, lab_scan, middle_stretch
from scan2fea.thesis.experiment import Cell, Chore, Made, Table
from scan2fea.thesis.published import stated
from scan2fea.types import FloatArray, PointCloud, Scan

WALL_M = stated("beam_thickness_m")
AGREES = 0.05  # of the volume
SCALES = (1, 2, 4, 15)
LOST = 0.01  # of the wall
FREE_M, MEMBER_M = 0.12, 0.8  # lengths of the specimens
NOISES_MM = (0.0, 0.3, 1.0, 2.0, 6.0, 20.0)
SPACINGS_MM = (2.5, 4.0, 8.0)
VIEWS: Mapping[str, Sequence[str]] = {"all round": (), "without ends": ("ends",), "outer faces": ("ends", "inner", "toes"),
                                        "one leg": ("ends", "inner", "toes", "b")}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One specimen: share of its seeds that succeed, and the first reason why not."""

    success: float
    reason: str


def isolation(bench: Bench) -> Made:
    """Hypothesis 1: is the beam isolated, by noise?"""
    rows: list[tuple[Cell, ...]] = []
    for noise_mm in isolation_noises(bench.options):
        rows.append((noise_mm, *isolated(bench, noise_mm)))
    head = ("noise, mm", "overlap (IoU), radius 0.5 in as the thesis", "overlap (IoU), radius from the data")
    says = (
        "Overlap of the beam's points with the cluster that fits it best, after filter and voxels of 0.1 in; 1 is perfect, above 0.5 the beam "
        "is the cluster."
    )
    told = [f"{way}: {_told([row[k] for row in rows], [row[0] for row in rows])}" for k, way in ((1, "radius 0.5 in"), (2, "radius from the data"))]
    return Made(table=Table(head=head, rows=tuple(rows)), says=(says, f"The beam is isolated with {'; with '.join(told)}."))


def _told(overlap: Sequence[Cell], noises: Sequence[Cell]) -> str:
    """At which of the noises the beam is most of a cluster, and that most of the beam."""
    good = [f"{noise:g}" for share, noise in zip(overlap, noises, strict=True) if isinstance(share, float) and share > 0.5]
    return f"noise of {', '.join(good)} mm, of {len(overlap)} tried" if good else f"none of the {len(overlap)} noises tried"


def isolation_noises(options: ThesisOptions) -> tuple[float, ...]:
    """Standard deviations that are tried, mm."""
    return (0.0, 6.7, 20.0) if options.quick else (0.0, 2.0, 4.0, 6.7, 10.0, 15.0, 20.0)


def isolated(bench: Bench, noise_mm: float) -> tuple[float, float]:
    """Overlap of the beam with its cluster: with the thesis's radius, with one from the data."""
    return bench.kept("isolation", lambda: _isolated(lab_scan(bench, noise_mm * 1e-3)), noise_mm)


def _isolated(scan: Scan) -> tuple[float, float]:
    cloud = clean_up(Scan(cloud=scan.cloud), filter_options(VOXEL_M)).scan.cloud
    truth = np.asarray(cloud.label)
    out = []
    for options in (clustering(30), clustering(30, radius_m=None)):
        found = agreement(truth, euclidean(PointCloud.of(cloud.points), options))
        out.append(float(found.iou[np.flatnonzero(found.objects == BEAM)[0]]))
    return out[0], out[1]


def specimen(bench: Bench, length_m: float) -> Solid:
    return middle_stretch(lab(bench.options.seed).solids[BEAM], length_m)


def seen_points(solid: Solid, spacing_m: float, noise_m: float, hidden: Sequence[str], seed: int) -> tuple[FloatArray, float]:
    """Points (n, 3) on the faces that are not hidden, with noise in x, y and z; and the share of the surface that they lie on."""
    points, face = sampled_solid(solid, SamplingOptions(method="blue_noise", spacing_m=spacing_m), seed)
    kind = _face_kinds(solid)
    shown = ~np.isin(kind[face], list(hidden))
    tri = solid.mesh.vertices[solid.mesh.faces]
    size = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    share = float(size[~np.isin(kind, list(hidden))].sum() / size.sum())
    rng = np.random.default_rng([seed, 7])
    kept = points[shown]
    return kept + noise_m * rng.standard_normal(kept.shape), share


def _face_kinds(solid: Solid) -> np.ndarray:
    """(m,) "ends", "toes", "inner", "a" or "b" of each face of the mesh of an L."""
    T = solid.T_world_shape
    normal = face_normals(solid.mesh) @ T[:3, :3]
    middle = (solid.mesh.vertices[solid.mesh.faces].mean(axis=1) - T[:3, 3]) @ T[:3, :3]
    out = np.full(len(normal), "inner", "U5")
    leg = solid.shape.parameters["a"]
    out[np.abs(normal[:, 2]) > 0.5] = "ends"
    for axis, name in ((0, "a"), (1, "b")):
        out[normal[:, axis] < -0.5] = name
        out[(normal[:, axis] > 0.5) & (middle[:, axis] > 0.99 * leg)] = "toes"
    return out


def free_trial(solid: Solid, spacing_m: float, noise_m: float, hidden: Sequence[str], seed: int) -> str:
    """Empty where the free form succeeds, else why not."""
    points, _ = seen_points(solid, spacing_m, noise_m, hidden, seed)
    try:
        found = reconstruct(Scan(cloud=PointCloud.of(points)), ReconstructionOptions(seed=seed))
    except Scan2FeaError as error:
        return str(error)
    bad = [check.says for check in found.checks if not check.passed]
    if bad:
        return bad[0]
    ratio = volume(found.mesh) / solid.volume_m3
    return "" if abs(ratio - 1) <= AGREES else f"accepted with {ratio:.3f} of the volume"


def member_trial(solid: Solid, spacing_m: float, noise_m: float, hidden: Sequence[str], seed: int) -> str:
    """Empty where the member is found with all its dimensions, else why not."""
    points, _ = seen_points(solid, spacing_m, noise_m, hidden, seed)
    found = estimate(Scan(cloud=PointCloud.of(points)), MemberOptions(), RouteOptions())
    if found.member is None or not found.explains:
        return found.reason
    if found.member.family != "L":
        return f"taken for {found.member.family}"
    sizes = {p.name: p for p in found.member.parameters}
    hidden_names = [name for name in PARAMETERS["L"] if not sizes[name].observable]
    if hidden_names:
        return f"not told by the points: {', '.join(hidden_names)}"
    a, b, t = (sizes[name].value_m for name in PARAMETERS["L"])
    true = solid.shape.parameters
    ratio = t * (a + b - t) / (true["t"] * (true["a"] + true["b"] - true["t"]))
    return "" if abs(ratio - 1) <= AGREES else f"accepted with {ratio:.3f} of the area"


def free_map(bench: Bench) -> Made:
    """Hypothesis 2: free form by spacing and noise."""
    return _map(bench, "free", *cells(bench.options, "free"), "spacing, mm", "Free form: share that converts")


def view_map(bench: Bench) -> Made:
    """Hypothesis 2: free form by what was seen."""
    return _map(bench, "views", *cells(bench.options, "views"), "seen", "Free form at a spacing of 4 mm: share that converts")


def member_map(bench: Bench) -> Made:
    """Hypothesis 2: the member's way by what was seen, and noise."""
    return _map(bench, "member", *cells(bench.options, "member"), "seen", "Member at a spacing of 8 mm: share that converts")


def cells(options: ThesisOptions, kind: str) -> tuple[Sequence[float], Sequence[str]]:
    """Noises (mm) and columns of a map: "free", "views" or "member"; a cell takes seconds: a quick run has four of each."""
    if kind == "views":
        return (0.3,) if options.quick else (0.0, 0.3), list(VIEWS)
    if kind == "member":
        return ((0.0, 6.0), ["all round", "outer faces"]) if options.quick else (NOISES_MM, list(VIEWS)[:3])
    return ((0.0, 1.0), [f"{s:g}" for s in SPACINGS_MM[1:]]) if options.quick else (NOISES_MM, [f"{s:g}" for s in SPACINGS_MM])


def chores_of(*kinds: str) -> Callable[[ThesisOptions], Sequence[Chore]]:
    """The cells of maps, the noisiest first: they take longest."""

    def needs(options: ThesisOptions) -> Sequence[Chore]:
        maps = [(kind, *cells(options, kind)) for kind in kinds]
        return [("trial", kind, f"{noise:g}", column) for kind, noises, columns in maps for noise in reversed(noises) for column in columns]

    return needs


def isolation_chores(options: ThesisOptions) -> Sequence[Chore]:
    return [("isolation", f"{noise:g}") for noise in isolation_noises(options)]


def trials(bench: Bench, kind: str, noise_mm: float, column: str) -> Trial:
    """One cell of a map."""

    def make() -> Trial:
        reasons = []
        for seed in range(1 if bench.options.quick else 3):
            if kind == "member":
                reasons.append(member_trial(specimen(bench, MEMBER_M), 8e-3, 1e-3 * noise_mm, VIEWS[column], seed))
            elif kind == "views":
                reasons.append(free_trial(specimen(bench, FREE_M), 4e-3, 1e-3 * noise_mm, VIEWS[column], seed))
            else:
                reasons.append(free_trial(specimen(bench, FREE_M), 1e-3 * float(column), 1e-3 * noise_mm, (), seed))
        return Trial(success=float(np.mean([not reason for reason in reasons])), reason=next((reason for reason in reasons if reason), ""))

    return bench.kept(f"trial {kind} {noise_mm:g} {column}", make)


def _map(bench: Bench, kind: str, noises: Sequence[float], columns: Sequence[str], x: str, title: str) -> Made:
    canvas = Canvas(140 + 170 * len(columns), 120 + 54 * len(noises))
    panel: Panel = canvas.panel((110, 50, 110 + 170 * len(columns), 50 + 54 * len(noises)), (0, len(columns)), (0, len(noises)), title)
    rows: list[tuple[Cell, ...]] = []
    for i, noise in enumerate(noises):
        for j, column in enumerate(columns):
            found = trials(bench, kind, noise, column)
            shade = tuple(int(v) for v in viridis(np.array([0.25 + 0.7 * found.success]))[0])
            panel.polygon([(j, i), (j + 1, i), (j + 1, i + 1), (j, i + 1)], shade, FAINT)  # type: ignore[arg-type]
            panel.words((j + 0.5, i + 0.5), f"{100 * found.success:.0f} %", INK if found.success > 0.5 else (250, 250, 250))
            if found.reason.startswith("accepted"):
                panel.words((j + 0.5, i + 0.25), "wrong volume", RED, size=10)
            rows.append((noise, noise / (1e3 * WALL_M), column, found.success, found.reason))
        canvas.words((100, 50 + 54 * (len(noises) - i - 0.5)), f"{noise:g} mm", 13, "rm")
    for j, column in enumerate(columns):
        canvas.words((110 + 170 * (j + 0.5), 58 + 54 * len(noises)), column, 13)
    canvas.words((110 + 85 * len(columns), 82 + 54 * len(noises)), f"{x}; upwards: noise", 13)
    wrong = sum(str(row[4]).startswith("accepted") for row in rows)
    seeds = "1 seed" if bench.options.quick else "3 seeds"
    accepted = f"{wrong} cells hold a solid that was accepted with a volume off by more than {100 * AGREES:g} %."
    says = f"Wall {1e3 * WALL_M:g} mm, {seeds} a cell. {accepted}"
    head = ("noise, mm", "noise / wall", x, "share that converts", "first reason")
    return Made(picture=canvas.png(), table=Table(head=head, rows=tuple(rows)), says=(says,))


def scale_limits(bench: Bench) -> Made:
    """Hypothesis 2: how far smoothing may go: what is left of the wall by scale and radius."""
    rows: list[tuple[Cell, ...]] = []
    solid = specimen(bench, FREE_M)
    normals = face_normals(solid.mesh)
    for spacing_mm in (1.5, 2.5, 3.16, 4.0, 6.35):
        points, face = sampled_solid(solid, SamplingOptions(method="grid", spacing_m=1e-3 * spacing_mm), bench.options.seed)
        radius, out = smoothing_radius(points), normals[face]
        inside = _leg_middle(solid, points)
        kept = []
        for scale in SCALES:
            moved = smoothed(points, radius, scale)
            inward = -np.einsum("ij,ij->i", moved - points, out)[inside]
            kept.append(max(0.0, 1 - 2 * float(np.median(inward)) / WALL_M))
        rows.append((spacing_mm, 1e3 * spacing(points), 1e3 * radius, radius / WALL_M, *kept))
    head = ("grid, mm", "spacing, mm", "radius of smoothing, mm", "radius / wall", *(f"wall left at S = {s}" for s in SCALES))
    ratio, last = np.array([row[3] for row in rows], float), np.array([row[-1] for row in rows], float)
    whole, gone = ratio[last >= 1 - LOST].tolist(), ratio[last <= LOST].tolist()
    kept_to = f"all of the wall is left at radii up to {max(whole):.2f} walls" if whole else "some of the wall is lost at every radius"
    closed = f"none at {min(gone):.2f} walls and more" if gone else "some is left at all of them"
    says = f"Plain scale space on points without noise; after {SCALES[-1]} steps {kept_to}, {closed} (to {100 * LOST:g} %)."
    return Made(table=Table(head=head, rows=tuple(rows)), says=(says,))


def _leg_middle(solid: Solid, points: FloatArray) -> np.ndarray:
    """(n,) True for points in the middle of a leg, away from heel, toe and ends."""
    own = (points - solid.T_world_shape[:3, 3]) @ solid.T_world_shape[:3, :3]
    d = solid.shape.parameters
    along = (own[:, 2] > 0.3 * d["length"]) & (own[:, 2] < 0.7 * d["length"])
    first = (own[:, 0] > 0.35 * d["a"]) & (own[:, 0] < 0.65 * d["a"])
    second = (own[:, 1] > 0.35 * d["b"]) & (own[:, 1] < 0.65 * d["b"])
    return np.asarray(along & (first | second))


def limits(bench: Bench) -> Made:
    """Hypothesis 2: the conditions, in walls, read off the maps."""
    rows: list[tuple[Cell, ...]] = []
    noises, columns = cells(bench.options, "free")
    for column in columns:
        good = [n for n in noises if trials(bench, "free", n, column).success == 1]
        rows.append(("free form", f"spacing {float(column) / (1e3 * WALL_M):.2f} walls", None if not good else max(good) / (1e3 * WALL_M)))
    tried, views = cells(bench.options, "member")
    for view in views:
        good = [n for n in tried if trials(bench, "member", n, view).success == 1]
        rows.append(("member", f"{view}, spacing {8 / (1e3 * WALL_M):.2f} walls", None if not good else max(good) / (1e3 * WALL_M)))
    head = ("way", "condition", "most noise that converts, in walls")
    says = (
        "The largest noise of the maps at which every seed converts with the right volume; the next larger one fails. Nothing: none of those "
        "tried converts."
    )
    return Made(table=Table(head=head, rows=tuple(rows)), says=(says,))
