"""The chain, in the order of docs/design.md: the only place that knows it.

read -> place -> clean -> segment -> (labels.csv) -> select -> each object in a process of its own (convert.py)
-> what was refused once more, as members that meet (joints.py) -> report.json
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from scan2fea.acquisition import AcquisitionOptions
from scan2fea.errors import InputError, UsageError, require
from scan2fea.fea import check_options
from scan2fea.io import InputOptions, RawScan, read_scan, write_cloud_ply, write_trajectory
from scan2fea.io.artifacts import fingerprint
from scan2fea.io.files import existing_file, sha256_of, write_bytes
from scan2fea.pipeline.acquire import NO_SCALE, WITHOUT_SCALE, Group, acquire, acquired_rows, grouped, raw_of, without_scale
from scan2fea.pipeline.asked import asked_in_vain
from scan2fea.pipeline.assigned import assigned, resolved
from scan2fea.pipeline.children import Workers
from scan2fea.pipeline.chosen import chosen_of
from scan2fea.pipeline.config import Config, to_toml
from scan2fea.pipeline.frames import trajectory_of_all
from scan2fea.pipeline.fuse import record_motion
from scan2fea.pipeline.joints import with_joined
from scan2fea.pipeline.kinds import kinds_of, n_kinds, names_of, with_kinds
from scan2fea.pipeline.labels import edited, labels_text, read_rows
from scan2fea.pipeline.objects import convert_all, drop_others, parts_of, refuse_all
from scan2fea.pipeline.outputs import write_assembly, write_members
from scan2fea.pipeline.part import Part
from scan2fea.pipeline.record import KEEP, Record, Say, Tracked, key_of
from scan2fea.pipeline.results import assumed_unit, finite_tree, input_row, run_report
from scan2fea.pipeline.route import known_section, table_of
from scan2fea.pipeline.scene import Scene, clean, place_all, segment
from scan2fea.pipeline.segment_rows import segment_rows
from scan2fea.types import Segments

MARKS = ("report.json", "config.toml", KEEP)  # what tells a folder of ours from somebody's


def run(
    inputs: Sequence[Path],
    out: Path,
    config: Config,
    *,
    resume: bool = False,
    say: Say | None = None,
    command: Sequence[str] = (),
    kind: type[Workers] = Workers,
) -> dict[str, Any]:
    """All inputs are one scene; everything made goes to `out`. Returns the content of report.json. `kind`: what converts the objects.

    Raises UsageError, and InputError where no input is usable; a failed object does not raise.
    """
    table = table_of(config.route)
    known_section(config.route, table)  # what is wrong with it is wrong before anything is read
    known = resolved(config.object, table, config.run.seed)
    check_options(config.fea)
    _prepare(out, resume)
    _write_text(out / "config.toml", to_toml(config))
    with _Log(out / "log.jsonl", say) as log, kind(config.run.jobs) as workers:
        record = Record(out / KEEP, resume=resume, say=log)
        raws, rows = read_all(inputs, config.input, record, config.acquisition)
        if not resume:  # else there may be nothing to do for them
            workers.begin()
        names = [Path(raw.value.path).name for raw in raws]
        motion = record_motion(config.fusion, record, raws)
        scene = record("place", _placing(names, len(motion)), *raws, *motion, options=config.registration, n_in=len(raws), count=_n_points)
        scene = record("clean", clean, scene, options=config.filtering, n_in=_n_points(scene.value), count=_n_points)
        small = {"small_part": config.repair.small_part}
        found = record("segment", segment, scene, options=config.segmentation, extra=small, n_in=_n_points(scene.value), count=lambda s: len(s.kinds))
        segments = _edited(out, found, scene.value, resume)
        named_by = Tracked(segments, key_of(found.key, fingerprint(segments)))
        kinds = record("kinds", kinds_of, scene, named_by, options=config.segmentation, count=n_kinds).value
        chosen = chosen_of(scene.value, segments, config.select, names_of(segments, kinds))
        parts = parts_of(scene.value, segments, chosen, config)
        named = assigned(known, {part.id: part.scan.cloud.points for part in parts}, scene.value.shift_m)
        _write_scene(out, rows, scene.value, segments)
        for text in (*assumed_unit(rows, scene.value), *scene.value.notes, *chosen.notes):
            log({"event": "note", "object": None, "text": text})
        if any(row["unit_source"] == NO_SCALE for row in rows):
            made = refuse_all(parts, out, WITHOUT_SCALE, log)
            stages: list[dict[str, Any]] = []
        else:
            own = replace(config, object=named)

            def convert(some: Sequence[Part], how: Config) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
                return convert_all(some, out, how, resume, log, workers)

            made, stages = convert(parts, own)
            made, more, chosen = with_joined(scene.value, segments, chosen, parts, made, own, convert)
            stages += more
        drop_others(out, made)
        objects = with_kinds(made, chosen, kinds)
        write_assembly(out, out / KEEP / "objects", objects)
        frame = write_members(out, out / KEEP / "objects", objects, config)
        listed = segment_rows(scene.value.scan.cloud, segments, chosen, kinds)
        report = run_report(config, command, rows, scene.value, segments, record.stages + stages, objects, chosen, listed)
        report["asked_in_vain"] = asked_in_vain(config.fea, objects)
        report["warnings"] += [f"asked in vain: {text}" for text in report["asked_in_vain"]]
        report |= {} if frame is None else {"frame_model": finite_tree(frame)}
        told = acquired_rows([raw.value for raw in raws])
        report |= {"acquisition": finite_tree(told)} if told else {}
        _write_text(out / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    return report


def _n_points(scene: Scene) -> int:
    return len(scene.scan.cloud)


def _placing(names: Sequence[str], n_motions: int) -> Any:
    def place_inputs(*values: Any) -> Scene:
        *raws, options = values
        motion = raws.pop().trajectory if n_motions else None
        return place_all(tuple(raws), options, names=names, motion=motion)

    return place_inputs


def _prepare(out: Path, resume: bool) -> None:
    """An empty or new folder, or one of ours. Raises UsageError: nobody's files are mixed with results."""
    require(not out.exists() or out.is_dir(), UsageError, f"{out}: is a file; give a folder with -o")
    if out.is_dir() and any(out.iterdir()) and not any((out / mark).exists() for mark in MARKS):
        raise UsageError(f"{out}: holds files that are not scan2fea's; give an empty or new folder with -o")
    require(not resume or (out / KEEP).is_dir(), UsageError, f"{out}: nothing to resume here; run once without --resume")
    try:
        (out / KEEP).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out}: cannot be written ({error.strerror}); give another folder with -o") from error
    if not resume:
        for old in [*out.glob("*.*"), *(out / "objects").glob("*/*")]:
            if old.is_file():
                old.unlink()


def read_all(
    inputs: Sequence[Path], options: InputOptions, record: Record, acquisition: AcquisitionOptions = AcquisitionOptions()
) -> tuple[list[Tracked[RawScan]], list[dict[str, Any]]]:
    """Every input that can be read, and one row of the report for each of all. Raises InputError if none can."""
    raws: list[Tracked[RawScan]] = []
    rows: list[dict[str, Any]] = []
    sizes = {path: path.stat().st_size if path.is_file() else 0 for path in inputs}
    for number, group in enumerate(grouped(inputs, acquisition)):
        path = group.paths[0]
        try:
            if group.kind == "scan":
                # the memory allowed is that of the scene: each file has the share of its size
                own = replace(options, memory_gib=options.memory_gib * sizes[path] / (sum(sizes.values()) or 1))
                existing_file(path)
                source = Tracked(path, key_of("file", sha256_of(path)))
                raw = record("read", read_scan, source, options=own, n_in=1, count=lambda r: len(r.scan.cloud), extra=None)
                raws.append(Tracked(raw.value, key_of(raw.key, number)))
                rows.append(input_row(path, raw.value, None))
            else:
                _acquired(group, options, acquisition, record, number, raws, rows)
        except InputError as error:
            rows.append(input_row(path, None, str(error)))
            record.event("note", text=f"left out: {error}")
    without_scale(raws, rows)
    if not raws:
        reasons = [str(row["reason"]) for row in rows]
        raise InputError("; ".join(reasons) if len(reasons) == 1 else f"none of the {len(inputs)} inputs can be used; the first: {reasons[0]}")
    return raws, rows


def _acquired(
    group: Group, options: InputOptions, acquisition: AcquisitionOptions, record: Record, number: int, raws: list[Tracked[RawScan]],
    rows: list[dict[str, Any]]
) -> None:
    """Add the frames that were made of pictures or logs, and their rows. Raises InputError where none can be used."""
    source = Tracked(group, key_of("files", [str(path) for path in group.paths], group.sha256(acquisition)))
    made = record(
        "acquire", acquire, source, options=acquisition, n_in=len(group.files()), count=lambda a: sum(len(f.scan.cloud) for f in a.frames),
        extra={"unit": options.unit}
    )  # fmt: skip
    first = True
    for k, frame in enumerate(made.value.frames):
        if frame.reason:
            rows.append(input_row(Path(frame.name), None, frame.reason))
            record.event("note", text=f"left out: {frame.reason}")
            continue
        raw = raw_of(frame, made.value, is_first=first, options=options)
        raws.append(Tracked(raw, key_of(made.key, number, k)))
        rows.append(input_row(Path(frame.name), raw, None))
        first = False


def _edited(out: Path, found: Tracked[Segments], scene: Scene, resume: bool) -> Segments:
    """The segments, with a person's edits of OUT/labels.csv where the run is resumed and the file is not as we wrote it."""
    path, text = out / "labels.csv", labels_text(found.value, scene.scan.cloud.points)
    if resume and path.exists() and path.read_text(encoding="utf-8") != text:
        return edited(found.value, scene.scan.cloud.points, read_rows(path))
    _write_text(path, text)
    return found.value


def _write_scene(out: Path, rows: Sequence[Mapping[str, Any]], scene: Scene, segments: Segments) -> None:
    cloud = scene.scan.cloud
    sigma = cloud.sigma_along_m if cloud.sigma_along_m is not None else np.full(len(cloud), np.nan)
    inferred = cloud.is_inferred if cloud.is_inferred is not None else np.zeros(len(cloud), bool)
    columns: dict[str, Any] = {"label": segments.labels.astype(np.int32), "is_inferred": inferred.astype(np.uint8), "sigma_m": sigma}
    if scene.is_occluder is not None:
        columns["is_occluder"] = scene.is_occluder.astype(np.uint8)
    write_cloud_ply(out / "cloud.ply", cloud, columns)
    write_trajectory(out / "trajectory.txt", trajectory_of_all(rows, scene))


def _write_text(path: Path, text: str) -> None:
    write_bytes(path, text.encode())


class _Log:
    """log.jsonl: one event a line, as it happens; passed on to whoever listens."""

    def __init__(self, path: Path, say: Say | None) -> None:
        self._path, self._say = path, say

    def __enter__(self) -> _Log:
        self._file = self._path.open("w", encoding="utf-8", newline="\n")
        return self

    def __call__(self, event: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(event) + "\n")
        self._file.flush()
        if self._say:
            self._say(event)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._file.close()
