"""Chapter 3: the clouds, the LiDAR, concatenation, segmentation methods, scales, shape estimation (figures 3.1 to 3.6, tables 3.1 and 3.2)."""

from __future__ import annotations

import dataclasses

import numpy as np

from scan2fea.estimation.closest_point import closest_point
from scan2fea.estimation.fit import FitOptions, fit_section
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.thickness import median_thickness
from scan2fea.pipeline.simulate import with_sensor
from scan2fea.reconstruction.scale_space import smoothed, smoothing_radius
from scan2fea.report.camera import look_at
from scan2fea.report.colours import categories
from scan2fea.segmentation import METHODS, SegmentationOptions
from scan2fea.segmentation.metrics import agreement
from scan2fea.simulation.control_sets import CONTROL_SETS
from scan2fea.simulation.scene_names import lab_file
from scan2fea.thesis.background import block
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.canvas import BLUE, FAINT, GREEN, INK, ORANGE, RED, Canvas, Panel, tiles
from scan2fea.thesis.chain import outward, scale_space_mesh
from scan2fea.thesis.clouds import METRES_PER_INCH, SIGMA_M, beam_points, lab_scan
from scan2fea.thesis.experiment import Cell, Made, Table
from scan2fea.thesis.pictures import labelled_picture, mesh_picture
from scan2fea.thesis.published import shape_printed, stated
from scan2fea.types import PointCloud

TESTED = ("kmeans", "fuzzy_cmeans", "agglomerative", "euclidean")
SCALES = (0, 1, 2, 4, 8, 15)


def lab_zero(bench: Bench) -> Made:
    """Figure 3.1: the lab without noise."""
    cloud = lab_scan(bench).cloud
    label = np.asarray(cloud.label)
    says = f"{len(cloud):,} points on {len(np.unique(label))} objects (the thesis: {stated('lab_points'):,.0f} on {stated('lab_objects'):.0f})."
    return Made(picture=tiles([("coloured by object", labelled_picture(cloud.points, label - 1, 900))], 1), says=(says,))


def lab_noisy(bench: Bench) -> Made:
    """Figure 3.2: the lab with noise of 2 cm."""
    most = stated("noise_m")
    limit, third = f"{1e2 * most:g} cm", f"{1e3 * SIGMA_M:.1f} mm"
    readings = ((f"sigma {third}", SIGMA_M, "gaussian"), (f"evenly within {limit}", most, "uniform"), (f"sigma {limit}", most, "gaussian"))
    clean, pictures, says = lab_scan(bench).cloud, [], []
    for name, size, law in readings:
        cloud = lab_scan(bench, size, law).cloud
        away = np.linalg.norm(cloud.points - clean.points, axis=1)
        pictures.append((name, labelled_picture(cloud.points, np.asarray(cloud.label) - 1, 460)))
        says.append(f"{name}: points are moved by {1e3 * away.mean():.1f} mm in the mean, {1e3 * away.max():.1f} mm at most.")
    says.append("The text says Gaussian and 'up to 2 cm' at once; these are its three readings, the first is used in section 4.2.")
    return Made(picture=tiles(pictures, 3), says=tuple(says))


def lidar_fan(bench: Bench) -> Made:
    """Figure 3.3: how an HDL-32E works: 32 beams that turn."""
    given = with_sensor(lab_file(bench.options.seed), "hdl32e")
    options = dataclasses.replace(given.sensors[0].options, frames=1)
    angle = np.radians(np.sort(np.array(options.elevations_deg)))
    canvas = Canvas(900, 340)
    side = canvas.panel((50, 40, 440, 300), (0, 6), (-3.6, 1.4), "From the side", equal=True)
    for a in angle.tolist():
        side.line([(0, 0), (6, 6 * np.tan(a))], BLUE, 1)
    side.dots([(0, 0)], RED, 4)
    top = canvas.panel((480, 40, 880, 300), (-6, 6), (-4, 4), "From above", equal=True)
    step = 2 * np.pi * options.rate_hz * options.firing_us * 1e-6
    for a in np.arange(0, 2 * np.pi, 24 * step).tolist():
        top.line([(0, 0), (4 * np.cos(a), -4 * np.sin(a))], FAINT, 1)
    top.dots([(0, 0)], RED, 4)
    shots = round(2 * np.pi / step) * len(angle)
    rate = 1e6 * len(angle) / options.firing_us
    says = (
        f"{len(angle)} beams from {np.degrees(angle[0]):.2f} to {np.degrees(angle[-1]):.2f} degrees; {shots:,} shots a turn at "
        f"{options.rate_hz:g} Hz, {rate:,.0f} a second; every 24th firing is drawn from above."
    )
    printed, turns, each = stated("points_per_s"), stated("frame_rate_hz"), stated("frame_points")
    beside = f"The thesis prints {each:,.0f} points a frame at {turns:g} Hz and {printed:,.0f} a second: the latter give {printed / turns:,.0f}."
    return Made(picture=canvas.png(), says=(says, beside))


def concatenation(bench: Bench) -> Made:
    """Figure 3.4: how frames are joined."""
    motion = "T_0_k = T_0_(k-1) T_(k-1)_k"
    boxes = ("next frame k", "key points, features (ISS, 66 bins)", "RANSAC against frame k-1: T_(k-1)_k", motion, "frame k moved and added")
    says = (
        "Poses are multiplied, not added, as the thesis has it in words. Only neighbours are compared, so that errors add up along the chain.",
        "This program goes on: frames are also compared across the chain and all poses are adjusted together (docs/registration.md).",
    )
    return Made(picture=_flow(boxes), says=says)


def estimation_flow(bench: Bench) -> Made:
    """Figure 3.5: informed shape estimation."""
    near, walk = "nearest place on the section of matching normal (eq 3.2)", "step of eq 3.3 until it stands still"
    boxes = ("points of the beam", "long axis; points cut into slabs", near, "sum of distances (eq 3.1)", walk, "median of the slabs")
    says = ("The steps are those of estimation/closest_point.py, as corrected there: Newton on the gradient, since the sum has no zero with noise.",)
    return Made(picture=_flow(boxes), says=says)


def _flow(boxes: tuple[str, ...]) -> bytes:
    canvas = Canvas(560, 30 + 64 * len(boxes))
    panel: Panel = canvas.panel((0, 0, 560, 30 + 64 * len(boxes)), (0, 560), (30 + 64 * len(boxes), 0))
    for k, text in enumerate(boxes):
        top = 20 + 64 * k
        panel.polygon([(60, top), (500, top), (500, top + 40), (60, top + 40)], (226, 236, 243), INK)
        panel.words((280, top + 20), text, size=14)
        if k:
            panel.line([(280, top - 24), (280, top)], INK, 1.5)
            panel.polygon([(275, top - 8), (285, top - 8), (280, top)], INK)
    return canvas.png()


def shape_estimation(bench: Bench) -> Made:
    """Figure 3.6: the estimation on a block of 10 x 10 x 5 in."""
    true = {"a": 10 * METRES_PER_INCH, "b": 10 * METRES_PER_INCH, "t": 5 * METRES_PER_INCH}
    printed = shape_printed()
    _, points = block(0.25 * METRES_PER_INCH, bench.options.seed)
    points = points + SIGMA_M * np.random.default_rng(bench.options.seed).standard_normal(points.shape)
    start = {name: 0.9 * value for name, value in true.items()}
    near = closest_point(points, "L", start)
    fit = fit_section(points, FitOptions(families=("L",), seed=bench.options.seed))
    likely = {name: fit.value(name) for name in true}
    std = dict(zip(fit.names, fit.std.tolist(), strict=True))
    rows = []
    for name, size in true.items():
        found = (near.values[name] / METRES_PER_INCH, likely[name] / METRES_PER_INCH, std[name] / METRES_PER_INCH)
        rows.append((name, size / METRES_PER_INCH, printed[name], *found))
    head = ("dimension", "true, in", "published, in", "ours, same method, in", "ours, best route, in", "its standard deviation, in")
    canvas = Canvas(900, 400)
    for k, (name, sizes) in enumerate((("same method", near.values), ("best route", likely))):
        panel = canvas.panel((30 + 440 * k, 40, 440 + 440 * k, 385), (-0.05, 0.3), (-0.05, 0.3), name, equal=True)
        panel.dots(points[::7, :2], FAINT, 1.4)
        for values, colour in ((true, GREEN), (sizes, ORANGE)):
            a, b, t = values["a"], values["b"], values["t"]
            panel.line([(0, 0), (b, 0), (b, t), (t, t), (t, a), (0, a)], colour, 2, closed=True)
    says = (
        "10 x 10 x 5 in is read as an L with legs of 10 in, 5 in thick, and the noise, which is not stated, as sigma "
        f"{1e3 * SIGMA_M:.1f} mm; green: true, orange: found.",
        f"Closest points took {near.n_iterations} steps; their distances have an rms of {1e3 * near.rms_m:.2f} mm.",
    )
    return Made(picture=canvas.png(), table=Table(head=head, rows=tuple(rows)), says=says)


def control_sets(bench: Bench) -> Made:
    """Table 3.1: four methods on sets of points in a plane."""
    n = 150 if bench.options.quick else 300
    rows: list[tuple[Cell, ...]] = []
    canvas = Canvas(40 + 220 * len(TESTED), 40 + 190 * len(CONTROL_SETS))
    for line, (name, make) in enumerate(CONTROL_SETS.items()):
        points, truth = make(n, bench.options.seed)
        k = int(truth.max()) + 1
        low, high = points[:, :2].min(axis=0) - 0.2, points[:, :2].max(axis=0) + 0.2
        scores: list[float] = []
        for column, method in enumerate(TESTED):
            clusters = None if method == "euclidean" else k
            options = SegmentationOptions(method=method, clusters=clusters, min_points=10, supports=False, members=False, linkage="ward")
            found = METHODS[method](PointCloud.of(points), options)
            scores.append(agreement(truth, found).adjusted_rand)
            box = (40 + 220 * column, 45 + 190 * line, 240 + 220 * column, 200 + 190 * line)
            panel = canvas.panel(box, (low[0], high[0]), (low[1], high[1]), f"{method}: {scores[-1]:.2f}", equal=True)
            panel.dots(points[:, :2], categories(found), 1.8)
        rows.append((name, len(points), k, *scores))
    says = ("Adjusted Rand index: 1 where the clusters are the true groups. The thesis prints pictures of such sets without their numbers.",)
    return Made(picture=canvas.png(), table=Table(head=("set", "points", "groups", *TESTED), rows=tuple(rows)), says=says)


def scales(bench: Bench) -> Made:
    """Table 3.2: what a growing scale does."""
    points = beam_points(bench, "zero")
    if not bench.options.quick:  # a stretch shows it
        along = points[:, 0]
        points = points[np.abs(along - np.median(along)) < 0.2]
    radius, gap = smoothing_radius(points), spacing(points)
    normals, wall = outward(points), stated("beam_thickness_m")
    camera = look_at(points, width_px=420, height_px=280)
    pictures, rows = [], []
    for scale in SCALES:
        mesh = scale_space_mesh(points, normals, scale, at_scale=True)
        moved = smoothed(points, radius, scale)
        away = np.linalg.norm(moved - points, axis=1)
        kept = median_thickness(mesh)
        pictures.append((f"S = {scale}", mesh_picture(mesh, camera)))
        rows.append((scale, 1e3 * float(away.mean()), 1e3 * float(away.max()), None if not np.isfinite(kept) else 1e3 * kept))
    head = ("scale S", "points moved, mean, mm", "points moved, most, mm", "wall there, mm")
    says = (
        f"Points every {1e3 * gap:.2f} mm, radius of smoothing {1e3 * radius:.2f} mm, wall {1e3 * wall:.2f} mm: "
        + ("the ball holds points of both faces, drawn onto each other." if radius > wall else "the ball holds points of one face: the wall stays."),
    )
    return Made(picture=tiles(pictures, 3), table=Table(head=head, rows=tuple(rows)), says=says)
