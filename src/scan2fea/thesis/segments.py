"""Clouds and clusters of chapter 4 (figures 4.1 to 4.4, 4.20 to 4.24, 4.36 to 4.39)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scan2fea.io import InputOptions, read_scan
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.report.colours import BACKDROP, categories
from scan2fea.report.colours import viridis as by_share
from scan2fea.segmentation import METHODS, SegmentationOptions
from scan2fea.segmentation.euclidean import euclidean
from scan2fea.segmentation.metrics import agreement
from scan2fea.simulation.lab17 import SPACING_M
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.canvas import RED, tiles
from scan2fea.thesis.clouds import BEAM, COARSE_M, RADIUS_M, SIGMA_M, VOXEL_M, Treated, clustering, hdl_scans, joined_points, lab_scan, treated
from scan2fea.thesis.experiment import Made, Table
from scan2fea.thesis.pictures import cloud_picture, labelled_picture
from scan2fea.thesis.published import stated
from scan2fea.types import IntArray, PointCloud

TESTED = ("kmeans", "fuzzy_cmeans", "agglomerative", "euclidean")
_WIDE = 900


def raw_cloud(case: str) -> Callable[[Bench], Made]:
    """Figures 4.1 and 4.22: the scene as given."""

    def make(bench: Bench) -> Made:
        cloud = lab_scan(bench, 0.0 if case == "zero" else SIGMA_M).cloud
        beam = cloud.points[np.asarray(cloud.label) == BEAM]
        gaps = f"{1e3 * spacing(cloud.points):.2f} mm, {len(beam):,} of them on the beam, there every {1e3 * spacing(beam):.2f} mm"
        says = [f"{len(cloud):,} points every {gaps} (the thesis left these open)."]
        if case == "noise":
            says.append(f"Noise with a standard deviation of {1e3 * SIGMA_M:.2f} mm along x, y and z.")
        return Made(picture=tiles([("coloured by object", labelled_picture(cloud.points, np.asarray(cloud.label) - 1, _WIDE))], 1), says=tuple(says))

    return make


def filtered_cloud(case: str) -> Callable[[Bench], Made]:
    """Figures 4.2, 4.23 and 4.38: after the filter and the voxels."""

    def make(bench: Bench) -> Made:
        found = treated(bench, case)
        voxel = VOXEL_M if case == "zero" else COARSE_M
        says = (
            f"{len(found.raw):,} points, {found.n_filtered:,} filtered away (15 neighbours, 1 standard deviation), {len(found.points):,} left "
            f"in voxels with an edge of {1e3 * voxel:.2f} mm; "
            f"their spacing {1e3 * found.raw_spacing_m:.2f} mm becomes {1e3 * found.spacing_m:.2f} mm.",
            f"In voxels of {1e3 * VOXEL_M:.2f} mm (0.1 in) the unfiltered cloud keeps {voxel_mean(found.raw, VOXEL_M).n_cells:,} points, of "
            f"{1e3 * COARSE_M:.2f} mm (0.1 in^3) {voxel_mean(found.raw, COARSE_M).n_cells:,}.",
        )
        return Made(picture=tiles([("coloured by object", labelled_picture(found.points, found.true_label - 1, _WIDE))], 1), says=says)

    return make


def clusterings(case: str) -> Callable[[Bench], Made]:
    """Figures 4.3 and 4.24: four methods, scored against the true objects."""

    def make(bench: Bench) -> Made:
        found = treated(bench, case)
        rows, pictures = [], []
        cloud = PointCloud.of(found.points)
        for name in TESTED:
            labels = found.labels if name == "euclidean" else _clusters(bench, cloud, name, case)
            score = agreement(found.true_label, labels)
            own = int(np.flatnonzero(score.objects == BEAM)[0])
            rows.append((name, int(labels.max()) + 1, score.adjusted_rand, score.mean_iou, float(score.iou[own])))
            pictures.append((f"{name}: beam {100 * float(score.iou[own]):.0f} %", labelled_picture(found.points, labels, 560)))
        head = ("method", "clusters", "adjusted Rand index", "mean overlap (IoU)", "overlap of the beam (IoU)")
        says = [f"{stated('clusters'):.0f} clusters asked for, Euclidean with a radius of {1e3 * RADIUS_M:.1f} mm."]
        says.append("Agglomerative is single linkage, cut at the right number: what Euclidean is without its radius. The thesis names no linkage.")
        if case == "noise":
            says.append("The radius stays 0.5 in; the thesis prints 0.5 cm here, and 'the same parameters'.")
        return Made(picture=tiles(pictures, 2), table=Table(head=head, rows=tuple(rows)), says=tuple(says))

    return make


def _clusters(bench: Bench, cloud: PointCloud, name: str, case: str) -> IntArray:
    options = SegmentationOptions(method=name, clusters=round(stated("clusters")), supports=False, members=False, restarts=2, seed=bench.options.seed)
    return bench.kept(f"clusters {case} {name}", lambda: METHODS[name](cloud, options))


def size_limits(bench: Bench) -> Made:
    """Figure 4.4: Euclidean clusters of 3,000 to 50,000 points."""
    found = treated(bench, "zero")
    least, most = round(stated("cluster_least")), round(stated("cluster_most"))
    labels = euclidean(PointCloud.of(found.points), clustering(3, None))
    size = np.bincount(labels[labels >= 0])
    keep = np.flatnonzero((size >= least) & (size <= most))
    shown = np.where(np.isin(labels, keep), labels, -1)
    kept = found.true_label[shown >= 0]
    says = (
        f"{len(size)} clusters, {len(keep)} of {least:,} to {most:,} points: {int((kept == BEAM).sum()):,} points of the beam of "
        f"{int((found.true_label == BEAM).sum()):,}, and {int((kept != BEAM).sum()):,} others.",
    )
    return Made(picture=tiles([("what is kept", labelled_picture(found.points, shown, _WIDE))], 1), says=says)


def hdl_cloud(every: int) -> Callable[[Bench], Made]:
    """Figures 4.20 and 4.21: the simulated HDL-32E, all sweeps or one in five, and its path."""

    def make(bench: Bench) -> Made:
        thin = 5 if bench.options.quick and every == 1 else every
        scans = hdl_scans(bench, thin)
        points, truth = joined_points(scans)
        once = voxel_mean(points, SPACING_M).n_cells
        printed = stated("hdl_points_all" if every == 1 else "hdl_points_fifth")
        rays = [s.rays for s in scans if s.rays is not None]
        path = np.concatenate([r.origin[:: max(1, len(r) // 4)] for r in rays])
        shown = np.concatenate([points, path])
        colours = np.concatenate([categories(truth - 1), np.tile(np.array(RED, np.uint8), (len(path), 1))])
        says = [
            f"{len(scans)} sweeps, {len(points):,} returns; in cells of the lab's own spacing ({1e3 * SPACING_M:.1f} mm) {once:,}. The thesis "
            f"has {printed:,.0f}: it picks points of the cloud and each once, ours casts rays on solids.",
        ]
        if thin != every:
            says.append("Quick: one sweep in five is drawn here too.")
        picture = cloud_picture(shown, colours, width=_WIDE)
        return Made(picture=tiles([("coloured by object, the sensor's path in red", picture)], 1), says=tuple(says))

    return make


def one_frame(bench: Bench) -> Made:
    """Figure 4.36: a single frame."""
    printed = stated("frame_points")
    if bench.options.real is not None:
        scan = read_scan(bench.options.real, InputOptions()).scan
        rays = scan.rays
        points = np.asarray(scan.cloud.points)
        if rays is not None and rays.time_s is not None:
            time = rays.time_s[scan.cloud.ray]
            points = points[time < time.min() + 0.1]
        says = f"The first tenth of a second of {bench.options.real.name}, a real HDL-32E: {len(points):,} points (thesis: {printed:,.0f} a frame)."
    else:
        scan = hdl_scans(bench, 5)[len(hdl_scans(bench, 5)) // 2]
        points = np.asarray(scan.cloud.points)
        says = (
            f"One simulated sweep: {len(scan.rays or ()):,} shots, {len(points):,} returns (thesis: {printed:,.0f} points a frame, in a room "
            "that returns every shot; ours has no walls). --real draws a real capture."
        )
    far = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    height = points[:, 2]
    colours = by_share((height - np.percentile(height, 2)) / max(float(np.ptp(np.percentile(height, [2, 98]))), 1e-9))
    near = far < np.percentile(far, 98)
    return Made(picture=tiles([("coloured by height", cloud_picture(points[near], colours[near], width=_WIDE))], 1), says=(says,))


def joined(bench: Bench) -> Made:
    """Figure 4.37: frames joined, before any filter."""
    scans = hdl_scans(bench, 5)
    points, truth = joined_points(scans)
    beam = points[truth == BEAM]
    says = (
        f"{len(scans)} simulated sweeps, poses known: {len(points):,} points, {len(beam):,} on the beam (thesis: {stated('frames_joined'):.0f} "
        "frames, joined without poses).",
    )
    return Made(picture=tiles([("coloured by object", labelled_picture(points, truth - 1, _WIDE))], 1), says=says)


def hdl_clusters(bench: Bench) -> Made:
    """Figure 4.39: Euclidean clusters of the LiDAR data."""
    found: Treated = treated(bench, "hdl")
    score = agreement(found.true_label, found.labels)
    own = np.flatnonzero(score.objects == BEAM)
    colours = categories(np.where(found.labels == found.beam, 0, -1))
    colours[found.labels != found.beam] = BACKDROP
    share = float(score.iou[own[0]]) if len(own) else 0.0
    says = (
        f"{int((found.labels == found.beam).sum()):,} points in the cluster of the beam, overlap with the beam (IoU) {share:.3f}. "
        f"The radius comes from the data: that of 0.5 in ({1e3 * RADIUS_M:.1f} mm) is below the spacing of {1e3 * found.spacing_m:.1f} mm."
    )
    return Made(picture=tiles([("the beam's cluster", cloud_picture(found.points, colours, width=_WIDE))], 1), says=(says,))
