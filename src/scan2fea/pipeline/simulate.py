"""`scan2fea simulate`: a scene scanned by its sensors, written with everything that is true of it. Whole or not at all."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.cad.exact import BENT, EXACT, ExactSolid, exact_solid
from scan2fea.errors import CadError, InputError, UsageError, require
from scan2fea.io import write_mesh_ply, write_text
from scan2fea.io.files import write_bytes
from scan2fea.io.scan_writers import SCAN_WRITERS, write_ply
from scan2fea.kernel.construction import Bend
from scan2fea.kernel.measures import area
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.pipeline.simulate_logs import write_logs
from scan2fea.simulation.bounds import bounds_from_points
from scan2fea.simulation.photogrammetry import in_frame
from scan2fea.simulation.sampling import noise_sd, sampled
from scan2fea.simulation.scene_checks import check_scene, check_sensor
from scan2fea.simulation.scene_file import PlacedSensor, SceneFile, read_scene
from scan2fea.simulation.scene_names import SCENE_NAMES, lab_sensor
from scan2fea.simulation.sensors import SENSORS
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.simulation.truth import even_bounds, has_bounds, truth_of
from scan2fea.simulation.visibility import Seen, seen_from
from scan2fea.types import FloatArray, Scan

_MOST_PLACES = 48  # of a moving sensor, at which what it sees is worked out for truth.json
Picture = Callable[[Scene, Sequence[Scan]], bytes]


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulated:
    """What was written. files : of points, in order.   truth : the tree of truth.json."""

    out: Path
    files: tuple[Path, ...]
    truth: Mapping[str, Any]


def scene_named(name: str, seed: int) -> SceneFile:
    """One of the scenes that come with the program, or the scene of a file. Raises InputError."""
    require(seed >= 0, UsageError, f"--seed {seed}: it must not be negative")
    if name in SCENE_NAMES:
        return SCENE_NAMES[name](seed)
    require(
        not (Path(name).suffix == "" and not Path(name).exists()), InputError, f"{name}: no such scene; give a TOML file, or {', '.join(SCENE_NAMES)}"
    )
    return read_scene(Path(name))


def with_sensor(given: SceneFile, kind: str) -> SceneFile:
    """The scene scanned with `kind` alone: its own sensors of that kind, else one where the first sensor stands (the lab: along its table).

    "HDL-32E" is hdl32e. Raises UsageError for an unknown kind.
    """
    plain = {name.replace("_", ""): name for name in SENSORS}
    kind = plain.get(kind.lower().replace("-", "").replace("_", "").replace(" ", ""), kind)
    require(kind in SENSORS, UsageError, f"--sensor {kind}: unknown; it is one of {', '.join(SENSORS)}")
    own = tuple(s for s in given.sensors if s.kind == kind)
    if own:
        return dataclasses.replace(given, sensors=own, sampling=None)
    kinds = {f.name for f in dataclasses.fields(SENSORS[kind].options)}
    first = given.sensors[0].options if given.sensors else None
    path: dict[str, Any] = dict(lab_sensor(kind)) if first is None else {}
    for key in ("positions_m", "orientations_deg", "times_s"):
        if first is not None and hasattr(first, key) and key in kinds:
            path[key] = getattr(first, key)
    return dataclasses.replace(given, sensors=(PlacedSensor(kind=kind, options=SENSORS[kind].options(**path)),), sampling=None)


def with_noise(given: SceneFile, noise_m: float, law: str | None = None) -> SceneFile:
    """The scene with the noise of every sensor, and of sampling, set. Raises UsageError for noise that is negative."""
    require(noise_m >= 0, UsageError, f"--noise {noise_m}: it must not be negative")
    require(law in (None, "gaussian", "uniform"), UsageError, f"--noise {law}: unknown; write gaussian or uniform before the colon")

    def noisy(options: Any) -> Any:
        changes: dict[str, Any] = {"noise_m": noise_m}
        if law is not None:
            require(hasattr(options, "noise"), UsageError, f"--noise {law}: this sensor knows only Gaussian noise")
            changes["noise"] = law
        return dataclasses.replace(options, **changes)

    sensors = tuple(dataclasses.replace(s, options=noisy(s.options)) if hasattr(s.options, "noise_m") else s for s in given.sensors)
    return dataclasses.replace(given, sensors=sensors, sampling=None if given.sampling is None else noisy(given.sampling))


def simulate_scene(
    given: SceneFile, out: Path, *, seed: int = 0, formats: Sequence[str] = ("ply",), picture: Picture | None = None, step: bool = True
) -> Simulated:
    """Check the scene, scan it and write OUT: points (one file per scan and format), logs of moving sensors, truth.json, meshes of the objects
    and (unless `step` is off) their STEP, scene.png.

    The same scene, seed and formats give the same bytes. Raises InputError for what the scene asks for, UsageError for an unknown format or an
    OUT that cannot be written; OUT is then as it was.
    """
    for name in formats:
        require(name in SCAN_WRITERS, UsageError, f"--format {name}: unknown; it is one of {', '.join(SCAN_WRITERS)}")
    check_scene(given.scene)
    for sensor in given.sensors:
        positions = np.asarray(getattr(sensor.options, "positions_m", ()), float).reshape(-1, 3)
        require(len(positions) > 0, InputError, f"sensor {sensor.kind}: positions_m is empty: add where the sensor stands")
        check_sensor(given.scene, positions, sensor.kind)
    groups = _groups(given, seed)
    scans = _named(groups) + _sampled(given, seed)
    frames = _frames(groups)
    with _Whole(Path(out)) as folder:
        files = [folder / name for name in _points(folder, scans, formats, frames)]
        meshes, steps = _solids(folder, given.scene, step)
        truth = _truth(given, [scan for _, scan in scans], [f.name for f in files], meshes, steps, Path(out).name, seed)
        logs = [write_logs(folder / "logs", stem, s.kind, s.options, made, seed + k) for k, (stem, s, made) in enumerate(groups)]
        if frames:
            truth["unit"] = None  # of files in a scale of their own
            truth["frames"] = {
                f"{stem}.{suffix}": {"T_world_scan": T.tolist(), "lengths_per_m": scale} for stem, (T, scale) in frames.items() for suffix in formats
            }
        truth["logs"] = [str(path.relative_to(folder)) for paths in logs for path in paths]
        write_text(folder / "truth.json", json.dumps(truth, indent=1, allow_nan=False) + "\n")
        if picture is not None:
            write_bytes(folder / "scene.png", picture(given.scene, [scan for _, scan in scans]))
    return Simulated(out=Path(out), files=tuple(Path(out) / f.name for f in files), truth=truth)


def scanned(given: SceneFile, seed: int) -> list[tuple[str, Scan]]:
    """All scans of the scene with the stem of their files, sensor by sensor. Raises InputError where a sensor cannot scan."""
    return _named(_groups(given, seed)) + _sampled(given, seed)


def _sampled(given: SceneFile, seed: int) -> list[tuple[str, Scan]]:
    return [] if given.sampling is None else [("surface", sampled(given.scene, given.sampling, seed))]


def _groups(given: SceneFile, seed: int) -> list[tuple[str, PlacedSensor, tuple[Scan, ...]]]:
    """Stem, sensor and scans of each sensor."""
    groups = []
    for k, sensor in enumerate(given.sensors):
        made = SENSORS[sensor.kind].scan(given.scene, sensor.options, seed + k)
        says = f"sensor {sensor.kind}: positions_m: nothing comes into its reach: check where it stands and looks (orientations_deg), and its range"
        require(sum(len(scan.cloud) for scan in made) > 0, InputError, says)
        stem = sensor.kind if sum(s.kind == sensor.kind for s in given.sensors) == 1 else f"{sensor.kind}{k}"
        groups.append((stem, sensor, made))
    return groups


def _named(groups: Sequence[tuple[str, PlacedSensor, tuple[Scan, ...]]]) -> list[tuple[str, Scan]]:
    """The scans of all groups with the stems of their files."""
    scans = []
    for stem, _, made in groups:
        width = max(2, len(str(len(made) - 1)))
        scans += [(f"{stem}_{number:0{width}d}", scan) for number, scan in enumerate(made)]
    return scans


def _frames(groups: Sequence[tuple[str, PlacedSensor, tuple[Scan, ...]]]) -> dict[str, tuple[FloatArray, float]]:
    """Of the scans of sensors that know neither the world nor metres, by the stem of their files: pose of the frame, lengths per metre."""
    frames = {}
    for group in groups:
        frame = SENSORS[group[1].kind].frame
        if frame is not None:
            frames.update({stem: frame(group[1].options) for stem, _ in _named([group])})
    return frames


def _points(folder: Path, scans: Sequence[tuple[str, Scan]], formats: Sequence[str], frames: Mapping[str, tuple[FloatArray, float]]) -> list[str]:
    names = []
    for stem, world in scans:
        scan = in_frame(world, *frames[stem]) if stem in frames else world
        for suffix in formats:
            if suffix == "ply" and stem in frames:
                write_ply(folder / f"{stem}.ply", scan, lengths="scale unknown")
            else:
                SCAN_WRITERS[suffix](folder / f"{stem}.{suffix}", scan)
            names.append(f"{stem}.{suffix}")
    return names


def _solids(folder: Path, scene: Scene, with_step: bool) -> tuple[dict[str, str], dict[str, dict[str, Any]]]:
    """Exact mesh and STEP of each solid: their files, and what the STEP holds."""
    meshes: dict[str, str] = {}
    steps: dict[str, dict[str, Any]] = {}
    for number, solid in enumerate(scene.solids):
        stem = f"{number:02d}_{solid.name}"
        meshes[solid.name] = f"truth/{stem}.ply"
        write_mesh_ply(folder / meshes[solid.name], solid.mesh)
        if with_step:
            try:
                made = step_of_solid(solid)
            except CadError as error:
                steps[solid.name] = {"file": None, "note": str(error)}
                continue
            file = f"truth/{stem}.step"
            steps[solid.name] = {"file": file, "true_faces": made.is_true, "n_faces": made.n_faces, "volume_m3": made.volume_m3, "note": made.note}
            write_text(folder / file, made.step)
    return meshes, steps


def step_of_solid(solid: Solid) -> ExactSolid:
    """The solid with true faces, its volume held against the closed form; of one that lost matter, against its mesh within the chord tolerance."""
    shape = solid.shape
    volume_m3, limit = shape.exact.volume_m3, EXACT if not solid.changes else BENT
    if any(not isinstance(change, Bend) for change in solid.changes):
        volume_m3, limit = solid.volume_m3, EXACT + solid.chord_m * area(solid.mesh) / solid.volume_m3
    return exact_solid(shape.base, solid.changes, solid.T_world_shape, solid.mesh, volume_m3, limit)


def _truth(
    given: SceneFile, scans: Sequence[Scan], files: Sequence[str], meshes: Mapping[str, str], steps: Mapping[str, Mapping[str, Any]], name: str,
    seed: int
) -> dict[str, Any]:
    n = len(given.scene.solids)
    counts = sum((np.bincount(s.cloud.label[s.cloud.label >= 0], minlength=n)[:n] for s in scans if s.cloud.label is not None), np.zeros(n, np.int64))
    options = given.sensors[0].options if given.sensors else given.sampling
    law, size = getattr(options, "noise", "gaussian"), float(getattr(options, "noise_m", 0.0))
    sd = noise_sd(law, size)
    if given.sampling is not None:
        share = np.ones(n)
        bounds = {s.name: even_bounds(s, sd, int(c)) for s, c in zip(given.scene.solids, counts, strict=True)}
    else:
        seen = _seen(given, scans, seed)
        share = seen.union()
        bounds = {s.name: _bounds(s, k, seen, sd, int(counts[k])) for k, s in enumerate(given.scene.solids)}
    return truth_of(
        given.scene, identity=name, seed=seed, files=files, n_points=[int(c) for c in counts], seen=share, bounds=bounds,
        sensors=[s.kind for s in given.sensors], noise=law, noise_m=size, noise_sd_m=noise_sd(law, size), meshes=meshes, steps=steps,
    )  # fmt: skip


def _seen(given: SceneFile, scans: Sequence[Scan], seed: int) -> Seen:
    """What was in sight of the sensors; of a moving one from a sample of its places."""
    known = [s.rays.origin for s in scans if s.rays is not None and len(s.rays)]
    if not known:
        known = [np.asarray(s.options.positions_m, float).reshape(-1, 3) for s in given.sensors]
    origins = np.unique(np.concatenate(known), axis=0)
    rows = np.unique(np.linspace(0, len(origins) - 1, min(_MOST_PLACES, len(origins))).astype(int))
    return seen_from(given.scene, origins[rows], seed)


def _bounds(solid: Solid, k: int, seen: Seen, sd_m: float, n_points: int) -> dict[str, float]:
    """Of a scanned member: its points as if spread evenly over what was in sight."""
    rows = (seen.solid == k) & seen.seen.any(axis=1)
    if not has_bounds(solid) or n_points == 0 or not rows.any():
        return {}
    own = applied(inverse(solid.T_world_shape), seen.points[rows])
    return bounds_from_points(solid.shape.family, solid.shape.parameters, own, sd_m, n_points)


class _Whole:
    """A folder that appears under its name only when the block ends well. Where it is there already, files of the same name are replaced."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self.folder = out.with_name(f".{out.name}.{os.getpid()}.part")

    def __enter__(self) -> Path:
        try:
            require(not self.out.is_file(), UsageError, f"{self.out} is a file: give a folder with -o")
            self.folder.mkdir(parents=True)
        except OSError as error:
            raise UsageError(f"{self.out}: cannot be written ({error.strerror}): choose another folder with -o") from error
        return self.folder

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if kind is None:
            if self.out.exists():
                for path in sorted(self.folder.rglob("*")):
                    target = self.out / path.relative_to(self.folder)
                    if path.is_dir():
                        target.mkdir(exist_ok=True)
                    else:
                        os.replace(path, target)
            else:
                os.replace(self.folder, self.out)
        shutil.rmtree(self.folder, ignore_errors=True)
