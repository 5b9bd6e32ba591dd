"""OUT/labels.csv: one row per object that a person can edit; `--resume` runs on from it.

    label,kind,n_points,x_m,y_m,z_m,size_m,merge_into,split_radius_m

`kind`: object (is modelled), support, clutter or drop (are not); or what it is: I, L, C, T, plate, box, pipe, free form (objects), floor, wall
(supports). `merge_into`: the label to join. `split_radius_m`: cut the label into
parts that are farther apart than this.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.neighbors import radius_components
from scan2fea.segmentation.kinds import OBJECT_KINDS, SUPPORT_KINDS
from scan2fea.types import FloatArray, Segments

ROLES = ("object", "support", "clutter", "drop")
KINDS = (*ROLES, *(kind for kind in OBJECT_KINDS if kind not in ROLES), *SUPPORT_KINDS)
COLUMNS = ("label", "kind", "n_points", "x_m", "y_m", "z_m", "size_m", "merge_into", "split_radius_m")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One edited row."""

    label: int
    kind: str
    merge_into: int | None
    split_radius_m: float | None


def labels_text(segments: Segments, points: FloatArray) -> str:
    """The table of the segments of `points` (n, 3), as the text of a CSV file."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    for label, kind in enumerate(segments.kinds):
        own = points[segments.labels == label]
        centre = own.mean(axis=0) if len(own) else np.zeros(3)
        size = float(np.linalg.norm(np.ptp(own, axis=0))) if len(own) else 0.0
        table.writerow([label, kind, len(own), *(f"{x:.4f}" for x in centre), f"{size:.4f}", "", ""])
    return out.getvalue()


def read_rows(path: Path) -> tuple[Row, ...]:
    """The rows of an edited file. Raises InputError naming the line and what is wrong with it."""
    try:
        lines = list(csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read ({error})") from error
    rows = []
    for number, line in enumerate(lines, start=2):
        try:
            merge, split = (line.get("merge_into") or "").strip(), (line.get("split_radius_m") or "").strip()
            kind = (line["kind"] or "").strip()
            row = Row(label=int(line["label"]), kind=kind, merge_into=int(merge) if merge else None, split_radius_m=float(split) if split else None)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}, line {number}: {error}; the columns are {', '.join(COLUMNS)}") from error
        require(row.kind in KINDS, InputError, f"{path}, line {number}: kind {row.kind!r} is not one of {', '.join(KINDS)}")
        require(row.split_radius_m is None or row.split_radius_m > 0, InputError, f"{path}, line {number}: split_radius_m must be positive")
        rows.append(row)
    return tuple(rows)


def edited(segments: Segments, points: FloatArray, rows: Sequence[Row]) -> Segments:
    """The segments after the edits, relabelled without gaps. A label without a row keeps its kind; kind drop takes its points out.

    Raises InputError for a label that does not exist.
    """
    n = len(segments.kinds)
    kinds, named = list(segments.kinds), list(segments.named or ("",) * n)
    labels = segments.labels.copy()
    for row in rows:
        require(0 <= row.label < n, InputError, f"labels.csv: label {row.label} does not exist; there are 0 to {n - 1}")
        target = row.merge_into
        require(target is None or 0 <= target < n, InputError, f"labels.csv: merge_into {target} does not exist; there are 0 to {n - 1}")
        kinds[row.label] = row.kind if row.kind in ROLES else "support" if row.kind in SUPPORT_KINDS else "object"
        named[row.label] = "" if row.kind in ROLES else row.kind
    into = {row.label: row.merge_into for row in rows if row.merge_into is not None}
    for label in into:
        labels[segments.labels == label] = _target(label, into)
    for row in rows:
        own = np.flatnonzero(labels == row.label)
        if row.split_radius_m is None or not len(own):
            continue
        pieces = radius_components(points[own], row.split_radius_m)
        for piece in range(1, int(pieces.max()) + 1):
            labels[own[pieces == piece]] = len(kinds)
            kinds.append(kinds[row.label])
            named.append(named[row.label])
    labels[np.isin(labels, [k for k, kind in enumerate(kinds) if kind == "drop"])] = -1
    used, packed = np.unique(labels[labels >= 0], return_inverse=True)
    labels[labels >= 0] = packed
    how = {**segments.how, "edited": True}
    return Segments(labels=labels, kinds=tuple(kinds[k] for k in used), how=how, named=tuple(named[k] for k in used))


def _target(label: int, into: dict[int, int]) -> int:
    seen = {label}
    while label in into:
        label = into[label]
        require(label not in seen, InputError, f"labels.csv: merge_into runs in a circle at label {label}")
        seen.add(label)
    return label
