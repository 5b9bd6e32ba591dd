"""What the thesis leaves open in chapters 2 and 3, from our own figures: sensors (2.1), fusion (2.2), refinement and eq 2.20 (2.5), and which
measures the optimisers improve (3.3.7).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from scan2fea.errors import InputError
from scan2fea.fusion import FusionOptions, complementary, kalman
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.quality import triangle_quality
from scan2fea.kernel.topology import edge_table
from scan2fea.kernel.trajectories import interpolated
from scan2fea.pipeline.simulate import scanned, with_sensor
from scan2fea.remeshing.lloyd import lloyd
from scan2fea.remeshing.odt import odt
from scan2fea.repair.holes import fill_holes
from scan2fea.simulation.motion import path_through
from scan2fea.simulation.sampling import SamplingOptions, sampled_solid
from scan2fea.simulation.scene_names import lab_file
from scan2fea.simulation.sensor_logs import LogOptions, SensorLogs, sensor_logs
from scan2fea.simulation.sensors import SENSORS
from scan2fea.thesis.background import block
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.chain import advancing_front_mesh
from scan2fea.thesis.clouds import BEAM, DENSE_M, METRES_PER_INCH, lab, middle_stretch
from scan2fea.thesis.drawings import square
from scan2fea.thesis.experiment import Cell, Made, Table
from scan2fea.thesis.measured import QUALITIES
from scan2fea.types import FloatArray, InertialLog, IntArray, PositionLog, Trajectory, TriangleMesh

SHOWN = ("stereo", "photogrammetry", "sfm", "planar", "hdl32e", "terrestrial", "line_laser", "ultrasonic")  # in the order of 2.1
STRETCH_M = 0.12
WAY_S = 40.0


def sensors(bench: Bench) -> Made:
    """Section 2.1: what each kind of sensor brings home from the lab, and how far from the beam its points lie."""
    beam = lab(bench.options.seed).solids[BEAM]
    surface = PointToMesh(beam.mesh)
    rows: list[tuple[Cell, ...]] = []
    says: list[str] = []
    for kind in SHOWN:
        try:
            scans = [scan for _, scan in scanned(with_sensor(lab_file(bench.options.seed), kind), bench.options.seed)]
        except InputError as error:  # a line laser reaches less far than the lab's table stands away
            rows.append((kind, SENSORS[kind].doc, 0, 0, 0, 0, None, None))
            says.append(f"{kind}: {error}.")
            continue
        points = np.concatenate([scan.cloud.points for scan in scans])
        labels = np.concatenate([np.full(len(s.cloud), -1) if s.cloud.label is None else s.cloud.label for s in scans])
        own = points[labels == BEAM]
        shots = sum(len(scan.rays) for scan in scans if scan.rays is not None)
        off = surface.nearest(own).distance if len(own) else np.zeros(0)
        gap = 1e3 * spacing(own) if len(own) > 1 else None
        rms = 1e3 * float(np.sqrt(np.mean(off**2))) if len(own) else None
        rows.append((kind, SENSORS[kind].doc, len(scans), shots, len(points), len(own), gap, rms))
    head = ("sensor", "what it is", "scans", "shots kept", "points", "on the beam", "spacing there, mm", "rms distance from the true beam, mm")
    says += [
        "Each sensor stands or travels in the lab as `scan2fea simulate lab --sensor` has it, with its default noise; see docs/simulation.md.",
        "Sensors whose silence says nothing (pictures, sound) keep only the rays that returned. Structure from motion has no length of its own; its "
        "points are shown in the true scale.",
    ]
    return Made(table=Table(head=head, rows=tuple(rows)), says=tuple(says))


def fusion(bench: Bench) -> Made:
    """Section 2.2: alpha compensator and Kalman filter on simulated logs of a carrier, beside the truth."""
    errors: dict[str, list[tuple[float, ...]]] = {}
    seeds = 2 if bench.options.quick else 8
    for seed in range(seeds):
        logs = _flight(bench.options.seed + seed)
        inertial = InertialLog(time_s=logs.imu.time_s, rate=logs.imu.rate, force=logs.imu.force, is_gap=np.zeros(len(logs.imu.time_s), bool))
        kept = np.isfinite(logs.gps.position).all(axis=1)
        fixes = PositionLog(time_s=logs.gps.time_s[kept], position=logs.gps.position[kept], sigma_m=logs.gps.sigma_m[kept])
        options = FusionOptions(rate_hz=20.0)
        both = kalman(inertial, fixes, None, None, options)
        for name, found in (
            ("alpha compensator (inclination alone)", complementary(inertial, options).trajectory),
            ("Kalman filter", both.filtered),
            ("Kalman filter, smoothed", both.trajectory),
            ("Kalman filter with odometry, smoothed", kalman(inertial, fixes, logs.odometry, None, options).trajectory),
        ):
            errors.setdefault(name, []).append(_errors(found, logs.truth))
    rows: list[tuple[Cell, ...]] = []
    for name, each in errors.items():
        place, tilt, heading = np.sqrt(np.mean(np.square(each), axis=0)).tolist()
        alone = name.startswith("alpha")
        rows.append((name, None if alone else 1e3 * place, tilt, None if alone else heading))
    head = ("method", "place, rms mm", "inclination, rms degrees", "heading, rms degrees")
    says = (
        f"{seeds} ways of {WAY_S:g} s, an inertial unit of the MEMS class and satellite positions of 2 cm (simulation/sensor_logs.py), after the "
        "first quarter of each way. The alpha compensator knows no place, and without a magnetometer no heading.",
        "The particle filter of the heading in 2.2 is `scan2fea fuse --method particle`; its figures are in docs/fusion.md.",
    )
    return Made(table=Table(head=head, rows=tuple(rows)), says=says)


def _flight(seed: int) -> SensorLogs:
    rng = np.random.default_rng(seed)
    n = int(WAY_S / 2) + 1
    place = np.cumsum(rng.normal(size=(n, 3)) * [2.0, 2.0, 0.3], axis=0)
    turn = np.c_[rng.uniform(-15, 15, (n, 2)), np.cumsum(rng.uniform(-30, 40, n))]
    return sensor_logs(path_through(np.linspace(0.0, WAY_S, n), place, turn), LogOptions(), seed)


def _errors(found: Trajectory, truth: Trajectory) -> tuple[float, float, float]:
    """Rms of place (m), inclination and heading (degrees) after the first quarter."""
    time, true_time = np.asarray(found.time_s), np.asarray(truth.time_s)
    late = time > true_time[0] + 0.25 * WAY_S
    right = interpolated(truth, np.clip(time[late], true_time[0], true_time[-1])).T_world_frame
    own = found.T_world_frame[late]
    place = float(np.sqrt(np.mean(np.sum((right[:, :3, 3] - own[:, :3, 3]) ** 2, axis=1))))
    up = np.einsum("ki,ki->k", right[:, 2, :3], own[:, 2, :3])  # the world's vertical in the axes of the carrier
    tilt = np.degrees(np.arccos(np.clip(up, -1, 1)))
    turned = (Rotation.from_matrix(right[:, :3, :3]) * Rotation.from_matrix(own[:, :3, :3]).inv()).as_rotvec(degrees=True)[:, 2]
    return place, float(np.sqrt(np.mean(tilt**2))), float(np.sqrt(np.mean(turned**2)))


def interpolation_error(points: FloatArray, faces: IntArray) -> float:
    """Eq 2.20 with p = 1, f = |x|^2: the volume between the paraboloid and its piecewise linear interpolant; of a triangle area / 12 x sum edges^2.

    points : (n, 2).   faces : (m, 3).
    """
    tri = points[faces]
    edges = tri - np.roll(tri, -1, axis=1)
    a, b = tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]
    area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return float((area * np.sum(edges**2, axis=(1, 2))).sum() / 12)


def eq_2_20(bench: Bench) -> Made:
    """Section 2.5.2: what eq 2.20 measures, and what Lloyd's and the ODT relaxation make of it."""
    start = square(bench.options.seed)
    rows: list[tuple[Cell, ...]] = []
    methods: Mapping[str, Callable[..., tuple[TriangleMesh, object]]] = {"Lloyd": lloyd, "ODT": odt}
    for name, method in methods.items():
        for iterations in (0, 1, 5, 15, 50):
            mesh = start if iterations == 0 else method(start, iterations, constrained=True)[0]
            quality = np.asarray(triangle_quality(mesh.vertices, mesh.faces)["Q3"])
            rows.append((name, iterations, interpolation_error(mesh.vertices[:, :2], mesh.faces), float(quality.min()), float(np.median(quality))))
    says = (
        "Eq 2.20 is the distance (here the volume, p = 1) between the paraboloid |x|^2 and the roof of flat triangles over the mesh. Over all meshes "
        "with as many vertices the least is the optimal Delaunay triangulation: with the vertices held it is the Delaunay triangulation, with the "
        "connections held each vertex goes to the mean of the circumcentres around it, by area.",
        "Lloyd lessens another energy (the moment of each cell about its vertex); both end near each other.",
    )
    return Made(table=Table(head=("relaxation", "iterations", "Q of eq 2.20", "least Q3", "median Q3"), rows=tuple(rows)), says=says)


def refinement(bench: Bench) -> Made:
    """Section 2.5: a hole patched, refined to the density around it, and faired: what each step does."""
    _, points = block(METRES_PER_INCH / 2, bench.options.seed)
    whole = advancing_front_mesh(points, bench.options.seed)
    middle = whole.vertices[whole.faces].mean(axis=1)
    corner = points[np.argmax(points @ np.array([1.0, 0.3, 0.2]))]
    drop = np.linalg.norm(middle - corner, axis=1) < 4 * METRES_PER_INCH
    mesh = dataclasses.replace(whole, faces=whole.faces[~drop])
    rim = float(np.median(_edges(mesh)))
    rows: list[tuple[Cell, ...]] = [("what stood there", int(drop.sum()), *_patch(whole.vertices, whole.faces[drop], rim), 0.0)]
    for name, smooth in (("patched (Liepa), its corners alone", False), ("refined and faired", True)):
        found = fill_holes(mesh, smooth=smooth)
        fill = found.mesh.faces[found.hole >= 0]
        places = np.concatenate([found.mesh.vertices[np.unique(fill)], found.mesh.vertices[fill].mean(axis=1)])
        off = PointToMesh(whole).nearest(places).distance
        rows.append((name, len(fill), *_patch(found.mesh.vertices, fill, rim), 1e3 * float(off.max())))
    head = ("step", "triangles", "median edge over that around", "longest edge over that around", "least Q3", "farthest from what stood there, mm")
    says = (
        "A ball of 4 in cut out at a corner of the L block. The thesis names refinement and leaves it empty: a triangle is split where its middle is "
        "farther from its corners than the density of the rim allows (factor sqrt 2), edges are flipped to Delaunay, and the patch is faired "
        "with the slope of the rim. No patch can know the corner that was cut off: the last column is what it cost.",
    )
    return Made(table=Table(head=head, rows=tuple(rows)), says=says)


def _edges(mesh: TriangleMesh) -> FloatArray:
    ends = edge_table(mesh.faces).edges
    return np.asarray(np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1))


def _patch(vertices: FloatArray, faces: IntArray, rim: float) -> tuple[float, float, float]:
    length = _edges(TriangleMesh(vertices=vertices, faces=faces))
    return float(np.median(length)) / rim, float(length.max()) / rim, float(np.min(triangle_quality(vertices, faces)["Q3"]))


def improved(bench: Bench) -> Made:
    """Section 3.3.7: which measures Lloyd and ODT improve, on the first mesh of a stretch of the beam."""
    solid = middle_stretch(lab(bench.options.seed).solids[BEAM], STRETCH_M)
    points, _ = sampled_solid(solid, SamplingOptions(method="uniform", spacing_m=DENSE_M), bench.options.seed)
    first = advancing_front_mesh(points, bench.options.seed)
    made = {"first mesh": first}
    made["Lloyd, 200 iterations"] = lloyd(first, 200, constrained=True)[0]
    made["Lloyd, then ODT, 200 each"] = odt(made["Lloyd, 200 iterations"], 200, constrained=True)[0]
    rows: list[tuple[Cell, ...]] = []
    before: dict[str, FloatArray] = {}
    better: dict[str, list[str]] = {}
    for name, mesh in made.items():
        quality = triangle_quality(mesh.vertices, mesh.faces)
        for q in QUALITIES:
            told = np.array([np.min(quality[q]), np.quantile(quality[q], 0.01), np.median(quality[q])])
            rose = told > before.get(q, told)
            rows.append((name, q, *told.tolist(), *((None,) * 3 if q not in before else rose.tolist())))
            if q not in before:
                before[q] = told
            elif rose[:2].all():
                better.setdefault(name, []).append(q)
    head = ("mesh", "measure", "least", "1 % of the triangles below", "median", "least improved", "1 % improved", "median improved")
    said = [f"{name}: {', '.join(better.get(name, [])) or 'no measure'} improved in the least and in the worst hundredth." for name in list(made)[1:]]
    note = f"Points at random every {1e3 * DENSE_M:.2f} mm on {STRETCH_M:g} m of the beam, without noise; surface and creases held."
    return Made(table=Table(head=head, rows=tuple(rows)), says=(*said, note, "Q2 as printed rewards needles: where it falls, that is no loss."))
