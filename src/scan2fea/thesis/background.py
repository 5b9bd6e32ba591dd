"""Chapter 2, first half: what sensors give, features, filters, thinning, occlusion (figures 2.4 to 2.9)."""

from __future__ import annotations

import numpy as np

from scan2fea.filtering import FilteringOptions, downsample, outliers
from scan2fea.filtering.disocclusion import disocclude
from scan2fea.filtering.range_image import range_image
from scan2fea.io import InputOptions, read_scan
from scan2fea.kernel.measures import volume
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.transforms import rigid
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.registration.descriptors import DIRECTIONS, descriptors
from scan2fea.registration.frame import right_handed
from scan2fea.registration.keypoints import keypoints, saliency
from scan2fea.report.colours import viridis
from scan2fea.simulation.laser_scanner import TerrestrialOptions, scan_terrestrial
from scan2fea.simulation.lidar import LidarOptions, scan_lidar
from scan2fea.simulation.sampling import SamplingOptions, sampled
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.canvas import BLUE, FAINT, GREEN, ORANGE, RED, Canvas, tiles
from scan2fea.thesis.clouds import METRES_PER_INCH, hdl_scans, lab, lab_scan
from scan2fea.thesis.experiment import Made
from scan2fea.thesis.pictures import cloud_picture
from scan2fea.types import FloatArray

INCH = METRES_PER_INCH


def block(
    pitch_m: float, seed: int = 0, legs_m: float = 10 * INCH, wall_m: float = 5 * INCH, length_m: float = 10 * INCH
) -> tuple[Solid, FloatArray]:
    """The L block of figures 2.7 and 2.8 and points on it, on a square grid. Its size is not printed; it is that of figure 3.6, 10 in long."""
    solid = placed("L", {"a": legs_m, "b": legs_m, "t": wall_m, "length": length_m}, np.eye(4))
    scan = sampled(Scene(name="block", solids=(solid,)), SamplingOptions(method="grid", spacing_m=pitch_m), seed)
    return solid, np.asarray(scan.cloud.points)


def placed(kind: str, values: dict[str, float], T: FloatArray, name: str = "block") -> Solid:
    """A solid of a kind of simulation, at a pose."""
    shape = KINDS[kind].build(values, 2e-4)
    mesh = posed(shape.mesh, T)
    return Solid(name=name, shape=shape, T_world_shape=T, mesh=mesh, volume_m3=volume(mesh))


def one_beam(bench: Bench) -> Made:
    """Figure 2.4: one turn of a single-beam LiDAR."""
    options = LidarOptions(positions_m=((1.7, -1.2, 0.9),), frames=1, rate_hz=0.5, firing_us=10_000.0, noise_m=0.01)
    scan = scan_lidar(lab(bench.options.seed), options, bench.options.seed)[0]
    p = scan.cloud.points[:, :2]
    canvas = Canvas(700, 420)
    low, high = np.minimum(p.min(axis=0), [1.6, -1.4]) - 0.1, p.max(axis=0) + 0.1
    panel = canvas.panel((60, 40, 680, 370), (low[0], high[0]), (low[1], high[1]), "One turn of one beam, in its plane", equal=True)
    panel.axes("x, m", "y, m")
    for q in p.tolist():
        panel.line([(1.7, -1.2), q], FAINT, 0.6)
    panel.dots(p, BLUE, 2.4)
    panel.dots([(1.7, -1.2)], RED, 4.0)
    rate, noise = 1e6 / options.firing_us, 1e3 * options.noise_m
    says = f"{len(p)} returns of {len(scan.rays or ())} shots of one turn at {rate:g} shots a second in the simulated lab; the red dot is the sensor."
    name = f"The thesis leaves the sensor's name open; this one is simulated: one beam, {options.rate_hz:g} turns a second, noise {noise:g} mm."
    return Made(picture=canvas.png(), says=(says, name))


def hdl_data(bench: Bench) -> Made:
    """Figure 2.5: what an HDL-32E gives."""
    if bench.options.real is not None:
        raw = read_scan(bench.options.real, InputOptions())
        points = np.asarray(raw.scan.cloud.points)
        near = points[np.linalg.norm(points - np.median(points, axis=0), axis=1) < 40.0]
        says = f"{len(points):,} points of {bench.options.real.name}, a real capture."
        return Made(picture=tiles([("within 40 m of the middle", cloud_picture(near, _by_height(near), width=900))], 1), says=(says,))
    scan = hdl_scans(bench, 5)[0]
    points = np.asarray(scan.cloud.points)
    says = (
        f"One simulated sweep of the lab: {len(points):,} of {len(scan.rays or ()):,} shots returned (noise 2 cm along the ray). "
        "A real capture is drawn where --real names one."
    )
    return Made(picture=tiles([("coloured by height", cloud_picture(points, _by_height(points), width=900))], 1), says=(says,))


def _by_height(points: FloatArray) -> np.ndarray:
    low, high = np.percentile(points[:, 2], [2, 98])
    return viridis((points[:, 2] - low) / max(high - low, 1e-9))


def feature(bench: Bench) -> Made:
    """Figure 2.6: the 66 bins of the intrinsic shape signature of one point (eq 2.1, 2.2)."""
    _, points = block(0.5 * INCH, bench.options.seed)
    edge = spacing(points)
    rows = keypoints(points, 2 * edge, 6 * edge, 2.5 * edge)[:1]
    found = saliency(points, rows, 2 * edge, 15 * edge)
    values = descriptors(points, rows, right_handed(found.axes), found.weight, 15 * edge)[0]
    canvas = Canvas(900, 380)
    left = canvas.panel((40, 50, 360, 350), (-1.1, 1.1), (-1.1, 1.1), "The 66 directions, size by value", equal=True)
    turn = np.array([[0.8, 0.6, 0.0], [-0.3, 0.4, 0.87]])
    order = np.argsort(DIRECTIONS @ np.cross(turn[0], turn[1]))
    for k in order.tolist():
        shade = viridis(np.array([values[k] / values.max()]))[0]
        left.dots((DIRECTIONS[k] @ turn.T)[None], shade[None], 2.5 + 9 * float(values[k] / values.max()))
    right = canvas.panel((430, 50, 880, 330), (0, 66), (0, float(values.max()) * 1.05), "Feature of the key point")
    right.axes("bin; height: root of the share of the weighted distances", "")
    for k, value in enumerate(values.tolist()):
        right.polygon([(k + 0.1, 0), (k + 0.9, 0), (k + 0.9, value), (k + 0.1, value)], BLUE)
    says = (
        f"A key point of the L block ({len(points):,} points): {int((values > 0).sum())} of 66 bins are filled. "
        "The thesis sums raw distances, which follow the density; ours weights each neighbour by eq 2.1 and has length 1."
    )
    return Made(picture=canvas.png(), says=(says,))


def noise_filter(bench: Bench) -> Made:
    """Figure 2.7: the filter on an L block with 10 % strays."""
    rng = np.random.default_rng(bench.options.seed)
    _, points = block(0.25 * INCH, bench.options.seed)
    low, high = points.min(axis=0), points.max(axis=0)
    n = round(0.1 * len(points))
    stray = rng.uniform(low - 0.1 * (high - low), high + 0.1 * (high - low), (n, 3))
    every = np.concatenate([points, stray])
    is_stray = np.arange(len(every)) >= len(points)
    colours = np.where(is_stray[:, None], np.array(RED, np.uint8), np.array(BLUE, np.uint8)).astype(np.uint8)
    pictures, says = [("before", cloud_picture(every, colours, width=460))], []
    for name in ("density", "isolated"):
        good = outliers(every, FilteringOptions(outliers=name, neighbours=15, outlier_sd=1.0)).is_good
        pictures.append((f"after {name}", cloud_picture(every[good], colours[good], width=460)))
        says.append(
            f"{name}: {int((is_stray & ~good).sum()):,} of {n:,} strays go, and {100 * float((~good[~is_stray]).mean()):.2f} % of the true points."
        )
    says.append("10 % noise is read as one stray point to ten; eq 2.3 is taken as corrected (density), ours is the program's default (isolated).")
    return Made(picture=tiles(pictures, 3), says=tuple(says))


def thinning(bench: Bench) -> Made:
    """Figure 2.8: voxel means of an L block with points every 0.05 in."""
    pitch = 0.05 * INCH if not bench.options.quick else 0.1 * INCH
    _, points = block(pitch, bench.options.seed, 5 * INCH, 2.5 * INCH, 5 * INCH)
    edges = {"edge 0.25 in": 0.25 * INCH, "edge of 0.25 in^3": 0.25 ** (1 / 3) * INCH}
    pictures = [(f"{len(points):,} points", cloud_picture(points, width=460))]
    says = [f"An L block with legs of 5 in, a point every {pitch / INCH:g} in."]
    for name, edge in edges.items():
        mean = voxel_mean(points, edge).mean
        pictures.append((f"{name}: {len(mean):,} points", cloud_picture(mean, width=460)))
        says.append(f"{name} ({1e3 * edge:.2f} mm): spacing {1e3 * spacing(points):.2f} to {1e3 * spacing(mean):.2f} mm.")
    one = downsample(lab_scan(bench).cloud, FilteringOptions(voxel_m=0.25 * INCH)).cloud
    says.append(f"The lab of 114,808 points keeps {len(one):,} of them in cells of 0.25 in.")
    return Made(picture=tiles(pictures, 3), says=tuple(says))


def occlusion(bench: Bench) -> Made:
    """Figure 2.9: a wall behind a post, and what is filled in behind it (eq 2.5 to 2.7)."""
    wall = placed("box", {"x": 6.0, "y": 0.2, "z": 3.0}, rigid(np.eye(3), np.array([-3.0, 5.0, 0.0])), "wall")
    post = placed("box", {"x": 0.3, "y": 0.3, "z": 2.2}, rigid(np.eye(3), np.array([0.2, 2.6, 0.0])), "post")
    options = TerrestrialOptions(positions_m=((0.0, 0.0, 1.5),), step_deg=0.5, noise_m=0.005)
    scan = scan_terrestrial(Scene(name="wall", solids=(wall, post)), options, bench.options.seed)[0]
    points, label = np.asarray(scan.cloud.points), np.asarray(scan.cloud.label)
    ring = None if scan.rays is None or scan.rays.ring is None else scan.rays.ring[scan.cloud.ray]
    image = range_image(points, np.array([0.0, 0.0, 1.5]), ring)
    colours = np.where((label == 1)[:, None], np.array(ORANGE, np.uint8), np.array(BLUE, np.uint8)).astype(np.uint8)
    pictures, says = [("as scanned", cloud_picture(points, colours, width=460))], []
    for method in ("diffusion", "planes"):
        found = disocclude(image, 0.005, method)
        kept = points[~found.is_occluder]
        every = np.concatenate([kept, found.points])
        shown = np.concatenate([colours[~found.is_occluder], np.tile(np.array(GREEN, np.uint8), (len(found.points), 1))])
        away = np.abs(found.points[:, 1] - 5.0)
        pictures.append((f"{method}: {len(found.points):,} points made up", cloud_picture(every, shown, width=460)))
        told = f"{1e3 * float(np.sqrt(np.mean(away**2))):.1f} mm (rms) from the wall" if len(away) else "none to compare"
        marked = int(found.is_occluder[label == 1].sum())
        says.append(f"{method}: {marked} of {int((label == 1).sum())} points of the post are marked; points made up lie {told}.")
    says.append("diffusion is eq 2.7 for the range, in the mask alone; planes is the program's own way.")
    return Made(picture=tiles(pictures, 3), says=tuple(says))
