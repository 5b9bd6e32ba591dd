"""The clouds of chapter 4: the lab as it is, with noise, and as an HDL-32E sees it; filtered, thinned and clustered as the thesis says.

Its readings differ: "0.1 in" of voxel, "0.1 cm^2" of density and "0.1 in^3" of voxel are three spacings (thesis-notes, 3). The scene keeps the stated
114,808 points; the beam that is meshed has one point per 0.1 cm^2 (3.16 mm): with the spacing of the whole scene, 10.2 mm, nothing could tell its two
faces, 6.35 mm apart. Noise "up to 2 cm" is taken as a standard deviation of a third of that; there the voxel is 0.1 in^3, which fig 4.23 names.
The LiDAR's points are farther apart than the radius of 0.5 in, which would break the beam into crumbs: there the radius comes from the data.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from scan2fea.errors import SegmentationError, require
from scan2fea.filtering import FilteringOptions, clean_up
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.transforms import compose, rigid
from scan2fea.pipeline.simulate import scanned, with_sensor
from scan2fea.pipeline.simulate_logs import write_logs
from scan2fea.segmentation import SegmentationOptions
from scan2fea.segmentation.euclidean import euclidean
from scan2fea.simulation.lab17 import SPACING_M, lab17
from scan2fea.simulation.sampling import SamplingOptions, sampled
from scan2fea.simulation.scene_file import SceneFile
from scan2fea.simulation.scene_names import lab_file
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.published import stated
from scan2fea.types import FloatArray, IntArray, PointCloud, Scan, Value
from scan2fea.units import METRES_PER_UNIT

BEAM = 1  # label of the L-beam in the lab
METRES_PER_INCH = METRES_PER_UNIT["in"]
DENSE_M = (stated("density_cm2") * 1e-4) ** 0.5
VOXEL_M = stated("voxel_in") * METRES_PER_INCH
COARSE_M = stated("voxel_in") ** (1 / 3) * METRES_PER_INCH  # edge of a cell of 0.1 in^3: 11.8 mm
RADIUS_M = stated("cluster_radius_in") * METRES_PER_INCH
SIGMA_M = stated("noise_m") / 3
QUICK_LENGTH_M = 0.1
SCAN_S = stated("frames_joined") / stated("frame_rate_hz")
HDL = "hdl32e"
CASES = ("zero", "noise", "hdl")


@dataclass(frozen=True, eq=False, kw_only=True)
class Treated(Value):
    """A scene on its way to the beam.

    raw : (n, 3).   truth : (n,) solid of each, -1 none.   points : (m, 3) after filter and voxel.   true_label, labels : (m,) solid and cluster.
    beam : cluster that holds most of the beam, -1 where none does.   spacing_m : mean of the medians (kernel.noise) after it.
    """

    raw: FloatArray
    truth: IntArray
    points: FloatArray
    true_label: IntArray
    labels: IntArray
    beam: int
    n_filtered: int
    raw_spacing_m: float
    spacing_m: float


@lru_cache(maxsize=2)
def lab(seed: int) -> Scene:
    """`lab17`, made once: it is asked for by most experiments, and takes a second."""
    return lab17(seed)


def beam_solid(bench: Bench) -> Solid:
    """The L-beam of the lab; of a quick run a stretch of QUICK_LENGTH_M from its middle."""
    return middle_stretch(lab(bench.options.seed).solids[BEAM], QUICK_LENGTH_M) if bench.options.quick else lab(bench.options.seed).solids[BEAM]


def middle_stretch(beam: Solid, length_m: float) -> Solid:
    """The same section, shorter, where the middle of the beam is."""
    values = {**beam.shape.parameters, "length": length_m}
    shape = KINDS["L"].build(values, 0.0)
    T = compose(beam.T_world_shape, rigid(np.eye(3), np.array([0.0, 0.0, (beam.shape.parameters["length"] - length_m) / 2])))
    mesh = dataclasses.replace(shape.mesh, vertices=shape.mesh.vertices @ T[:3, :3].T + T[:3, 3])
    return dataclasses.replace(beam, shape=shape, T_world_shape=T, mesh=mesh, volume_m3=float(shape.exact.volume_m3))


def lab_scan(bench: Bench, noise_m: float = 0.0, law: str = "gaussian", method: str = "grid") -> Scan:
    """The 114,808 points of the lab; as many, but for a few, where they are not on a grid."""
    options = SamplingOptions(method=method, spacing_m=SPACING_M, noise=law, noise_m=noise_m)
    return bench.kept("lab", lambda: sampled(lab(bench.options.seed), options, bench.options.seed), noise_m, law, method)


def hdl_scans(bench: Bench, every: int) -> tuple[Scan, ...]:
    """The sweeps of an HDL-32E moved past the lab in 5 s (100 sweeps) on a table of fixed height, one in `every`; in the frame of the lab."""
    return bench.kept("hdl", lambda: tuple(scan for _, scan in scanned(hdl_sensor(bench, every), bench.options.seed)), every)


def hdl_sensor(bench: Bench, every: int) -> SceneFile:
    """The lab with the sensor of `hdl_scans`."""
    given = with_sensor(lab_file(bench.options.seed), HDL)
    sensor = given.sensors[0]
    changed = dataclasses.replace(sensor, options=dataclasses.replace(sensor.options, keep_every=every, times_s=(0.0, SCAN_S)))
    return dataclasses.replace(given, sensors=(changed,))


def capture(bench: Bench, every: int, folder: Path) -> Path:
    """The sweeps of `hdl_scans` as an HDL-32E writes them: a capture in `folder` that holds no pose."""
    files = write_logs(folder, "capture", HDL, hdl_sensor(bench, every).sensors[0].options, hdl_scans(bench, every), bench.options.seed)
    return next(path for path in files if path.suffix == ".pcap")


def joined_points(scans: tuple[Scan, ...]) -> tuple[FloatArray, IntArray]:
    """Points (n, 3) and solids (n,) of all."""
    labels = [np.full(len(s.cloud), -1, np.int64) if s.cloud.label is None else s.cloud.label for s in scans]
    return np.concatenate([s.cloud.points for s in scans]), np.concatenate(labels)


def treated(bench: Bench, case: str) -> Treated:
    """The scene of a case after filter, voxel and Euclidean clusters. Raises SegmentationError for a case that does not exist."""
    require(case in CASES, SegmentationError, f"no case {case!r}: it is one of {', '.join(CASES)}")
    voxel = VOXEL_M if case == "zero" else COARSE_M

    def make() -> Treated:
        if case == "hdl":
            points, truth = joined_points(hdl_scans(bench, 5))
        else:
            scan = lab_scan(bench, 0.0 if case == "zero" else SIGMA_M)
            points, truth = scan.cloud.points, np.asarray(scan.cloud.label)
        return _treated(points, truth, voxel, None if case == "hdl" else RADIUS_M)

    return bench.kept(f"treated {case}", make)


def filter_options(voxel_m: float | None) -> FilteringOptions:
    """Eq 2.3 as corrected: 15 neighbours within the mean plus one standard deviation of the distance to the 15th; then voxel means."""
    return FilteringOptions(outliers="density", neighbours=round(stated("filter_neighbours")), outlier_sd=1.0, voxel_m=voxel_m)


def _treated(raw: FloatArray, truth: IntArray, voxel_m: float, radius_m: float | None) -> Treated:
    kept = clean_up(Scan(cloud=PointCloud.of(raw, label=truth)), filter_options(None)).scan.cloud
    thin = clean_up(Scan(cloud=kept), FilteringOptions(outliers="none", voxel_m=voxel_m)).scan.cloud
    labels = euclidean(thin, clustering(min(len(thin), 30), radius_m=radius_m))
    true_label = np.asarray(thin.label)
    own = labels[(true_label == BEAM) & (labels >= 0)]
    return Treated(
        raw=raw, truth=truth, points=thin.points, true_label=true_label, labels=labels, beam=int(np.bincount(own).argmax()) if len(own) else -1,
        n_filtered=len(raw) - len(kept), raw_spacing_m=spacing(raw), spacing_m=spacing(thin.points),
    )  # fmt: skip


def clustering(min_points: int, max_points: int | None = None, radius_m: float | None = RADIUS_M) -> SegmentationOptions:
    """Euclidean clusters as the thesis has them."""
    return SegmentationOptions(method="euclidean", radius_m=radius_m, min_points=min_points, max_points=max_points, supports=False, members=False)


def beam_points(bench: Bench, case: str) -> FloatArray:
    """(n, 3) the cloud of the beam that is meshed. Raises SegmentationError where the beam is in no cluster."""
    if case == "hdl":
        found = treated(bench, case)
        require(found.beam >= 0, SegmentationError, "no cluster holds points of the beam")
        return np.asarray(found.points[found.labels == found.beam])
    noise = 0.0 if case == "zero" else SIGMA_M

    def make() -> FloatArray:
        scene = Scene(name="beam", solids=(beam_solid(bench),))
        scan = sampled(scene, SamplingOptions(method="grid", spacing_m=DENSE_M, noise_m=noise), bench.options.seed)
        if case == "zero":  # a filter would eat its edges, where a point has half the neighbours, and a voxel its even grid
            return np.asarray(scan.cloud.points)
        cloud = clean_up(Scan(cloud=scan.cloud), filter_options(COARSE_M)).scan.cloud
        return np.asarray(cloud.points)

    return bench.kept(f"beam {case}", make)
