"""Segmentation alone: what `scan2fea segment` writes."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea import __version__
from scan2fea.errors import UsageError, require
from scan2fea.io import write_cloud_ply, write_text
from scan2fea.io.files import write_bytes
from scan2fea.pipeline.chosen import chosen_of
from scan2fea.pipeline.config import Config, to_toml
from scan2fea.pipeline.fuse import record_motion
from scan2fea.pipeline.kinds import kinds_of, names_of
from scan2fea.pipeline.labels import labels_text
from scan2fea.pipeline.record import Record
from scan2fea.pipeline.results import finite_tree
from scan2fea.pipeline.run import read_all
from scan2fea.pipeline.scene import Scene, clean, place_all, segment
from scan2fea.pipeline.segment_rows import segment_rows
from scan2fea.segmentation import Selection
from scan2fea.segmentation.metrics import agreement
from scan2fea.types import PointCloud, Segments

SEGMENT_SCHEMA = "scan2fea segment 1"
FILES = ("cloud.ply", "labels.csv", "segments.png", "report.json", "config.toml")
Picture = Callable[[PointCloud, Segments], bytes]


def segment_files(inputs: Sequence[Path], out: Path, config: Config, picture: Picture) -> dict[str, Any]:
    """One label per point of a scene: OUT gets cloud.ply (with its column label), labels.csv, segments.png, report.json and config.toml.

    picture : draws the PNG. Where the file carries labels of its own, the report says how well those found agree with them. Returns the content of
    report.json. Raises UsageError for an OUT that holds other files, InputError where no input is usable, SegmentationError where the method
    cannot run.
    """
    require(not out.exists() or out.is_dir(), UsageError, f"{out}: is a file; give a folder with -o")
    if out.is_dir() and any(path.name not in FILES for path in out.iterdir()):
        raise UsageError(f"{out}: holds other files than those of `segment`; give an empty or new folder with -o")
    with tempfile.TemporaryDirectory() as folder:
        record = Record(Path(folder), resume=False)
        raws, rows = read_all(inputs, config.input, record, config.acquisition)
        moved = record_motion(config.fusion, record, raws)
    motion = moved[0].value.trajectory if moved else None
    scene = place_all(tuple(raw.value for raw in raws), config.registration, names=[Path(raw.value.path).name for raw in raws], motion=motion)
    scene = clean(scene, config.filtering)
    segments = segment(scene, config.segmentation, config.repair.small_part)
    cloud = scene.scan.cloud
    kinds = kinds_of(scene, segments, config.segmentation)
    chosen = chosen_of(scene, segments, config.select, names_of(segments, kinds))
    listed = segment_rows(cloud, segments, chosen, kinds)
    report = dict(finite_tree(_report(rows, scene, segments, chosen, config, listed)))
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out}: cannot be written ({error.strerror}); give another folder with -o") from error
    write_cloud_ply(out / "cloud.ply", cloud, {"label": segments.labels.astype(np.int32)})
    write_text(out / "labels.csv", labels_text(segments, cloud.points))
    write_bytes(out / "segments.png", picture(cloud, segments))
    write_text(out / "config.toml", to_toml(config))
    write_text(out / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    return report


def _report(
    rows: Sequence[Mapping[str, Any]], scene: Scene, segments: Segments, chosen: Selection, config: Config, listed: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    cloud = scene.scan.cloud
    report = {
        "schema": SEGMENT_SCHEMA,
        "version": __version__,
        "seed": config.run.seed,
        "frame": {"shift_m": scene.shift_m},
        "inputs": list(rows),
        "spacing_m": scene.spacing_m,
        "n_points": len(cloud),
        "n_unlabelled": int((segments.labels < 0).sum()),
        "segmentation": dict(segments.how),
        "segments": list(listed),
        "warnings": [*scene.notes, *chosen.notes],
    }
    if cloud.label is not None and (cloud.label >= 0).any() and config.segmentation.method != "given":
        report["agreement"] = _agreement(cloud.label, segments)
    return report


def _agreement(truth: Any, segments: Segments) -> dict[str, Any]:
    """How well the labels agree with those of the file."""
    found = agreement(truth, segments.labels)
    columns = zip(found.objects, found.n_points, found.iou, found.over, found.under, strict=True)
    names = ("label", "n_points", "iou", "over_segmentation", "under_segmentation")
    figures = {name: getattr(found, name) for name in ("adjusted_rand", "mean_iou", "precision", "recall", "f1")}
    return {**figures, "objects": [dict(zip(names, row, strict=True)) for row in columns]}
