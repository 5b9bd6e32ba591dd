"""From the inputs to labelled points: the stages that see the whole scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import EmptyScanError, InputError, require
from scan2fea.filtering import FilteringOptions, clean_up, fill_behind
from scan2fea.io import RawScan
from scan2fea.kernel.noise import spacing
from scan2fea.pipeline.sweeps import SweepPath, unrolled
from scan2fea.registration import Link, RegistrationOptions, place, read_poses, read_trajectory
from scan2fea.repair import bodies
from scan2fea.segmentation import SegmentationOptions, segment_scene
from scan2fea.types import BoolArray, FloatArray, IntArray, PointCloud, Scan, Segments, Trajectory, TriangleMesh, Value

FAR_M = 10_000.0  # coordinates beyond this are shifted: float32 formats would lose millimetres
SHIFT_STEP_M = 1_000.0
ON_A_LINE = 1e-7  # of the length: what rounding leaves across a line


@dataclass(frozen=True, eq=False, kw_only=True)
class MeshInput(Value):
    """An input with faces; `frame` is its number among the inputs."""

    frame: int
    mesh: TriangleMesh


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene(Value):
    """All inputs in one frame. shift_m : (3,), every coordinate is input minus this, `trajectory` too.   agreement_m : (k,) median distance of each
    input to the others where they overlap, nan where they do not.   is_occluder : (n,) points that stand in the way of others, or None.
    paths : of scanners that moved while they scanned, in the frame of OUT.   smeared : per input, why its scanner's motion is in its points, or "".
    continues : (n,) of a point that nobody measured, a measured one whose surface it continues; -1 of measured ones; or None.
    """

    scan: Scan
    meshes: tuple[MeshInput, ...]
    trajectory: Trajectory
    shift_m: FloatArray
    spacing_m: float
    agreement_m: FloatArray
    std_m: FloatArray
    std_rad: FloatArray
    reasons: tuple[str, ...]
    links: tuple[Link, ...]
    notes: tuple[str, ...]
    names: tuple[str, ...] = ()
    is_occluder: BoolArray | None = None
    continues: IntArray | None = None
    paths: tuple[SweepPath, ...] = ()
    smeared: tuple[str, ...] = ()

    @property
    def is_filled(self) -> BoolArray:
        """(n,) points that nobody measured, put behind what stands in the way."""
        return np.zeros(len(self.scan.cloud), bool) if self.continues is None else np.asarray(self.continues >= 0)


def require_extent(points: FloatArray) -> None:
    """Raises EmptyScanError where points (n, 3) are one place or lie on one line: no surface can be made of them."""
    n = len(points)
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T)), 0.0)) if n > 1 else np.zeros(3)
    require(spread[2] > 0, EmptyScanError, f"the {n} points of the scan are at one place: a surface needs points that spread; export it again")
    flat = f"all {n} points of the scan lie on one line: a surface needs points across it; check the columns and the unit"
    require(spread[1] > ON_A_LINE * spread[2], EmptyScanError, flat)


def place_all(raws: tuple[RawScan, ...], options: RegistrationOptions, *, names: Sequence[str], motion: Trajectory | None = None) -> Scene:
    """The inputs where their files or `registration.poses` put them or where registration finds their place, near the origin.

    motion : of the scanner of the only input, a capture of many turns; told by other sensors (`--imu`). Raises InputError for a file of poses that
    cannot be read or names none of the inputs, and for a motion of inputs that have none.
    """
    raws, paths, smeared, poses = _unrolled(raws, options, names, motion)
    own, fixed = [raw.pose_given for raw in raws], [raw.mesh is not None for raw in raws]
    placed = place([raw.scan for raw in raws], poses, list(names), options, is_placed=own, is_fixed=fixed)
    shift = shift_of(placed.scan.cloud.points)
    meshes = []
    for frame, raw in enumerate(raws):
        if raw.mesh is not None:
            own = placed.scan.cloud.points[placed.scan.cloud.frame == frame]
            meshes.append(MeshInput(frame=frame, mesh=replace(raw.mesh, vertices=own - shift)))
    notes = tuple(f"{name}: {note}" for name, raw in zip(names, raws, strict=True) for note in raw.notes) + placed.notes
    scan = shifted(placed.scan, shift)
    require_extent(scan.cloud.points)
    return Scene(
        scan=scan,
        meshes=tuple(meshes),
        trajectory=_poses_shifted(placed.trajectory, shift),
        shift_m=shift,
        spacing_m=spacing(scan.cloud.points),
        agreement_m=placed.agreement_m,
        std_m=placed.std_m,
        std_rad=placed.std_rad,
        reasons=placed.reasons,
        links=placed.links,
        notes=notes,
        names=tuple(names),
        smeared=smeared,
        paths=tuple(
            replace(path, T_frame_scanner=_poses_in(path, placed.trajectory, shift)) for path in paths if placed.trajectory.placed[path.frame]
        ),
    )


def _unrolled(
    raws: tuple[RawScan, ...], options: RegistrationOptions, names: Sequence[str], motion: Trajectory | None
) -> tuple[tuple[RawScan, ...], list[SweepPath], tuple[str, ...], Sequence[FloatArray | None]]:
    """The inputs without motion within them, how their scanners moved or why that is not known, and the pose that `registration.poses` gives each."""
    calibration = Path(options.calibration) if options.calibration else None
    is_capture = len(raws) == 1 and raws[0].sweep is not None
    says = "--imu tells the motion of a scanner: it needs one capture of many turns whose shots have times (.pcap), alone"
    require(motion is None or is_capture, InputError, says)
    given = motion if motion is not None or not options.poses or not is_capture else read_trajectory(Path(options.poses))
    made = [unrolled(raw, frame, options, given) for frame, raw in enumerate(raws)]
    poses: Sequence[FloatArray | None] = [raw.T_world_frame for raw in raws]
    if options.poses or motion is not None:
        poses = [np.eye(4)] if given is not None else read_poses(Path(options.poses), list(names), calibration)
    paths = [path for _, path, _ in made if path is not None]
    return tuple(raw for raw, _, _ in made), paths, tuple(why for _, _, why in made), poses


def _poses_in(path: SweepPath, trajectory: Trajectory, shift: FloatArray) -> FloatArray:
    T = trajectory.T_world_frame[path.frame] @ path.T_frame_scanner
    T[:, :3, 3] -= shift
    return np.asarray(T)


def shift_of(points: FloatArray) -> FloatArray:
    """(3,) round numbers of metres that bring points (n, 3) near the origin; zero where no coordinate is beyond 10 km."""
    if not len(points) or max(float(points.max()), -float(points.min())) <= FAR_M:
        return np.zeros(3)
    return np.asarray(np.round(np.median(points, axis=0) / SHIFT_STEP_M) * SHIFT_STEP_M)


def shifted(scan: Scan, shift: FloatArray) -> Scan:
    """The scan minus `shift` (3,), rays included."""
    if not shift.any():
        return scan
    rays = None if scan.rays is None else replace(scan.rays, origin=scan.rays.origin - shift)
    return Scan(cloud=scan.cloud.replaced(points=scan.cloud.points - shift), rays=rays)


def _poses_shifted(trajectory: Trajectory, shift: FloatArray) -> Trajectory:
    """The poses that bring each input to where the cloud lies: minus `shift` (3,)."""
    T = np.array(trajectory.T_world_frame)
    T[:, :3, 3] -= shift
    return replace(trajectory, T_world_frame=T)


def clean(scene: Scene, options: FilteringOptions) -> Scene:
    """The scene without outliers and of workable size. Vertices of inputs with faces are left alone."""
    from_mesh = np.isin(scene.scan.cloud.frame, [m.frame for m in scene.meshes])
    if from_mesh.all():
        return scene
    cleaned = clean_up(Scan(cloud=scene.scan.cloud.take(~from_mesh), rays=scene.scan.rays), options)
    h = spacing(cleaned.scan.cloud.points) if not from_mesh.any() else None
    behind = fill_behind(cleaned.scan, scene.trajectory.T_world_frame, scene.names, options)
    cloud, n = behind.cloud, int(from_mesh.sum())
    if from_mesh.any():
        cloud = _joined(cloud, scene.scan.cloud.take(from_mesh))
    return replace(
        scene,
        scan=Scan(cloud=cloud, rays=scene.scan.rays),
        spacing_m=spacing(cloud.points) if h is None else h,
        notes=scene.notes + cleaned.notes + behind.notes,
        is_occluder=np.append(behind.is_occluder, np.zeros(n, bool)) if behind.is_occluder.any() else None,
        continues=np.append(behind.source, np.full(n, -1)) if (behind.source >= 0).any() else None,
    )


def segment(scene: Scene, options: SegmentationOptions, small_part: float) -> Segments:
    """One label per point; each input with faces is an object of its own, or as many as it has closed shells that stand apart, of which none has less
    than the share `small_part` of the largest one's area. A point that nobody measured has the label of what it continues.
    """
    cloud = scene.scan.cloud
    from_mesh, filled = np.isin(cloud.frame, [m.frame for m in scene.meshes]), scene.is_filled
    labels = np.full(len(cloud), -1, np.int64)
    kinds: tuple[str, ...] = ()
    how: dict[str, object] = {}
    if not from_mesh.all():
        found = segment_scene(Scan(cloud=cloud.take(~(from_mesh | filled)), rays=scene.scan.rays), options)
        labels[~(from_mesh | filled)], kinds, how = found.labels, found.kinds, dict(found.how)
        if scene.continues is not None:
            labels[filled] = labels[scene.continues[filled]]
    for given in scene.meshes:
        body = bodies(given.mesh, small_part)
        labels[cloud.frame == given.frame] = len(kinds) + body
        kinds = (*kinds, *["object"] * (int(body.max(initial=0)) + 1))
    return Segments(labels=labels, kinds=kinds, how=how)


def _joined(a: PointCloud, b: PointCloud) -> PointCloud:
    """Both clouds, a first. A column that only one of them has is dropped."""
    both: dict[str, Any] = {}
    for name in ("points", "ray", "frame", "raw_index", "normals", "sigma_along_m", "sigma_across_m", "is_inferred", "colour", "intensity", "label"):
        x, y = getattr(a, name), getattr(b, name)
        both[name] = None if x is None or y is None else np.concatenate([x, y])
    return PointCloud(**both)
