"""The objects of a scene: cut out of it, converted each in a process of its own, and their rows collected in order."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.estimation.ray_voids import in_sheets
from scan2fea.io.artifacts import fingerprint, save
from scan2fea.io.files import sha256_of, write_bytes
from scan2fea.kernel.noise import noise_sigma
from scan2fea.kernel.threads import in_threads
from scan2fea.pipeline.children import Limits, Workers, run_children
from scan2fea.pipeline.config import Config, as_tree
from scan2fea.pipeline.outputs import write_object
from scan2fea.pipeline.part import Made, Part
from scan2fea.pipeline.pose_doubt import doubt_of, smeared_by
from scan2fea.pipeline.record import KEEP, RESULT, Say, key_of
from scan2fea.pipeline.results import object_row
from scan2fea.pipeline.scene import Scene
from scan2fea.repair import faces_among
from scan2fea.segmentation import Selection, bodies_around, contact_points, footings, strips_beside
from scan2fea.types import PointCloud, Rays, Scan, Segments

_AROUND = 0.5  # of the least extent of an object: how far off a ray still tells that it ends


def parts_of(scene: Scene, segments: Segments, chosen: Selection, config: Config) -> list[Part]:
    """One part per chosen label, numbered from 1 in the order of the selection."""
    meshes = {m.frame: m.mesh for m in scene.meshes}
    measured = ~scene.is_filled
    seen, labelled = scene.scan.cloud, segments
    if not measured.all():  # what nobody measured is no evidence of a support
        seen, labelled = seen.take(measured), replace(segments, labels=segments.labels[measured])

    def part_of(number: int) -> Part:
        label = chosen.labels[number - 1]
        rows = np.flatnonzero(segments.labels == label)
        own = scene.scan.cloud.take(rows)
        frame = int(own.frame[0])
        mesh = None if frame not in meshes else faces_among(meshes[frame], segments.labels[scene.scan.cloud.frame == frame] == label)
        doubt, smeared = doubt_of(scene, rows), smeared_by(scene, own.frame)
        strips = strips_beside(own, seen, labelled, int(label)) if mesh is None else ()
        covers = bodies_around(own, seen, labelled, int(label)) if mesh is None else ()
        under = footings(own, seen, labelled, int(label)) if mesh is None else ()
        if mesh is None:
            own = contact_points(own, seen, labelled, int(label))
        scan = _with_rays(own, scene.scan.rays)
        part = Part(id=number, kind=segments.kinds[label], scan=scan, mesh=mesh, doubt=doubt, smeared=smeared)
        return replace(part, footings=under, strips=strips, covers=covers)

    return in_threads(part_of, range(1, len(chosen.labels) + 1))


def _with_rays(own: PointCloud, rays: Rays | None) -> Scan:
    """The points with their own rays; with all that pass near where neighbours do not tell the noise: the points alone then tell too little."""
    alone = Scan(cloud=own, rays=rays).compact()
    if rays is None or not (np.isnan(noise_sigma(own.points)) or in_sheets(alone)):
        return alone
    low, high = own.points.min(axis=0), own.points.max(axis=0)
    around = _AROUND * float((high - low).min())
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = ((side - rays.origin) / rays.direction for side in (low - around, high + around))
    enter, leave = np.fmin(a, b).max(axis=1), np.fmax(a, b).min(axis=1)
    keep = (leave > np.maximum(enter, 0)) & ~(rays.range_m < enter)  # a ray without return has no range: it passes
    keep[own.ray[own.ray >= 0]] = True
    columns: dict[str, Any] = {f.name: getattr(rays, f.name) for f in dataclasses.fields(rays)}
    taken: dict[str, Any] = {name: None if column is None else column[keep] for name, column in columns.items()}
    place = np.cumsum(keep) - 1
    return Scan(cloud=own.replaced(ray=np.where(own.ray >= 0, place[own.ray], -1)), rays=Rays(**taken))


def with_faces(scene: Scene, segments: Segments) -> frozenset[int]:
    """Labels of the segments that came with faces."""
    labels = segments.labels[np.isin(scene.scan.cloud.frame, [m.frame for m in scene.meshes])]
    return frozenset(np.unique(labels[labels >= 0]).tolist())


def convert_all(
    parts: Sequence[Part], out: Path, config: Config, resume: bool, say: Say, workers: Workers
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Rows of objects[] and of stages[], in the order of the parts."""
    keep = out / KEEP / "objects"
    todo = []
    for part in parts:
        folder = keep / f"{part.id:02d}"
        own = replace(config, object=tuple(known for known in config.object if known.id == part.id))  # what is known of others is nothing to it
        key = key_of(fingerprint(part), as_tree(own), [sha256_of(Path(known.step)) for known in own.object if known.step])
        if resume and _is_done(folder, key):
            say({"event": "note", "object": str(part.id), "text": f"object {part.id}: unchanged, kept"})
            continue
        if not resume:
            shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / RESULT).unlink(missing_ok=True)
        save(part, folder / "part.npz")
        files = out / "objects" / f"{part.id:02d}"
        task = {"key": fingerprint(part), "config": as_tree(own), "resume": resume, "label": str(part.id), "out": str(files), "done": key}
        (folder / "task.json").write_text(json.dumps(task), encoding="utf-8")
        todo.append(folder)
    say({"event": "objects", "n": len(todo)})
    by_folder = {keep / f"{part.id:02d}": part for part in parts}

    def done(folder: Path, why: str) -> None:
        if why:
            _write_failed(by_folder[folder], folder, out, why)
        row = json.loads((folder / RESULT).read_text(encoding="utf-8"))["object"]
        say({"event": "verdict", "object": str(row["id"]), "verdict": row["verdict"], "reason": row["reason"]})

    run_children(todo, workers, Limits(seconds=config.run.object_seconds, gib=config.run.object_gib), say, done)
    results = [json.loads((folder / RESULT).read_text(encoding="utf-8")) for folder in by_folder]
    return [r["object"] for r in results], [stage for r in results for stage in r["stages"]]


def refuse_all(parts: Sequence[Part], out: Path, why: str, say: Say) -> list[dict[str, Any]]:
    """Rows of objects[] of which nothing is made: their cloud is kept, `why` is their reason."""
    rows = []
    for part in parts:
        folder = out / KEEP / "objects" / f"{part.id:02d}"
        folder.mkdir(parents=True, exist_ok=True)
        _write_failed(part, folder, out, why)
        rows.append(json.loads((folder / RESULT).read_text(encoding="utf-8"))["object"])
        say({"event": "verdict", "object": str(part.id), "verdict": rows[-1]["verdict"], "reason": why})
    return rows


def _is_done(folder: Path, key: str) -> bool:
    """Whether the object was made from the same part and options, and not stopped on the way."""
    try:
        task = json.loads((folder / "task.json").read_text(encoding="utf-8"))
        result = json.loads((folder / RESULT).read_text(encoding="utf-8"))
        return bool(task["done"] == key and not result["lacks"])
    except (OSError, ValueError, KeyError):
        return False


def drop_others(out: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Objects that are not in objects[]: of an earlier run, or tried and given up. Their files would look like results."""
    names = {f"{row['id']:02d}" for row in rows}
    for folder in [*(out / "objects").glob("*"), *(out / KEEP / "objects").glob("*")]:
        if folder.is_dir() and folder.name not in names:
            shutil.rmtree(folder)


def _write_failed(part: Part, folder: Path, out: Path, why: str) -> None:
    """Cloud and row of an object of which nothing else could be saved."""
    files = out / "objects" / f"{part.id:02d}"
    made = Made(part=part, stopped=why)
    row = object_row(made, write_object(made, files, Config()))
    write_bytes(folder / RESULT, json.dumps({"object": row, "stages": [], "lacks": "everything"}, allow_nan=False).encode())
