"""One file as one member: what `scan2fea fit` prints, and member.json; where it is none, the objects that `run` finds in it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import EmptyScanError, UsageError, require
from scan2fea.io import RawScan, read_scan, write_text
from scan2fea.pipeline.assigned import assigned, own_section, resolved
from scan2fea.pipeline.chosen import chosen_of
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.fuse import require_no_fusion
from scan2fea.pipeline.kinds import kinds_of, names_of
from scan2fea.pipeline.member_rows import member_row
from scan2fea.pipeline.objects import parts_of
from scan2fea.pipeline.results import finite_tree
from scan2fea.pipeline.route import Estimate, estimate, table_of
from scan2fea.pipeline.scene import Scene, clean, place_all, require_extent, segment, shift_of, shifted
from scan2fea.types import FloatArray, Member, Value

STUBS = 2.0  # lengths over widths of members that may meet in one object: below it nobody can tell along from across
MEMBER_SCHEMA = "scan2fea member 1"


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedFile(Value):
    """raw : the file as read.   found : what estimation says of all its points together.
    member : of `found`, or its likeliest; None where there is none.   shift_m : (3,), the frame of the member is the input's minus this.
    """

    raw: RawScan
    found: Estimate
    member: Member | None
    shift_m: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedObject(Value):
    """id : its number in `run`'s report.   n_points : of it.   found : what estimation says of them."""

    id: int
    n_points: int
    found: Estimate


def fit_file(path: Path, config: Config) -> FittedFile:
    """Fit all points of a file as one member; it is object 1 of the [[object]] tables.

    Raises InputError for a file that cannot be used, UsageError for a bad designation or table.
    """
    require_no_fusion(config.fusion, "`fit` takes one file as it lies")
    raw = read_scan(path, config.input)
    require(len(raw.scan.cloud), EmptyScanError, f"{path}: holds no usable point")
    require_extent(raw.scan.cloud.points)
    shift = shift_of(raw.scan.cloud.points)
    scan = shifted(raw.scan, shift)
    known = resolved(config.object, table_of(config.route), config.run.seed)
    drawings = [one.step for one in known if one.step and not one.family]
    require(not drawings, UsageError, f"{', '.join(drawings)}: is no drawing of a straight member; `run` compares the part with it")
    named = assigned(known, {1: scan.cloud.points}, shift)
    found = estimate(scan, config.estimation, config.route, own_section(named, 1), root_radius_m=config.solid.root_radius_m)
    return FittedFile(raw=raw, found=found, member=found.shown, shift_m=shift)


def fit_objects(path: Path, config: Config) -> tuple[FittedObject, ...]:
    """The objects that `run` finds in a file, each fitted as a member; none where all of the file is one object, or comes with faces.

    Where it is one object, those that it falls into where members as short as `STUBS` may meet (a welded node), if one of them is a member.
    """
    raw = read_scan(path, config.input)
    if raw.mesh is not None:
        return ()
    scene = clean(place_all((raw,), config.registration, names=[path.name]), config.filtering)
    found = _fitted(scene, config)
    if found or config.segmentation.slenderness <= STUBS:
        return found
    stubs = _fitted(scene, replace(config, segmentation=replace(config.segmentation, slenderness=STUBS)))
    return stubs if any(one.found.shown is not None for one in stubs) else ()


def _fitted(scene: Scene, config: Config) -> tuple[FittedObject, ...]:
    """The objects of a scene, each fitted as a member; none where it is one object."""
    segments = segment(scene, config.segmentation, config.repair.small_part)
    if len(segments.kinds) < 2:
        return ()
    chosen = chosen_of(scene, segments, config.select, names_of(segments, kinds_of(scene, segments, config.segmentation)))
    found = []
    for part in parts_of(scene, segments, chosen, config):
        known = own_section(config.object, part.id)
        around = (part.doubt, part.footings, part.strips, part.covers)
        own = estimate(part.scan, config.estimation, config.route, known, *around, root_radius_m=config.solid.root_radius_m)
        found.append(FittedObject(id=part.id, n_points=len(part.scan.cloud), found=own))
    return tuple(found)


def member_tree(fitted: FittedFile, objects: Sequence[FittedObject] = ()) -> dict[str, Any]:
    """member.json as plain values: the row of report.json, and what it was fitted to; of a file of several objects those as well."""
    head = {
        "schema": MEMBER_SCHEMA,
        "sha256": fitted.raw.sha256,
        "n_points": len(fitted.raw.scan.cloud),
        "unit": fitted.raw.unit,
        "unit_source": fitted.raw.unit_source,
        "sensor": fitted.raw.sensor,
        "shift_m": np.asarray(fitted.shift_m).tolist(),
        "explains": fitted.found.explains,
        "reason": fitted.found.reason,
    }
    tree = {**head, **({} if fitted.member is None else member_row(fitted.member, fitted.found.p_fixed, fitted.found.given))}
    tree |= {"objects": [_object_row(one) for one in objects]} if objects else {}
    return dict(finite_tree(tree))


def _object_row(one: FittedObject) -> dict[str, Any]:
    found, member = one.found, one.found.shown
    row = {} if member is None else member_row(member, found.p_fixed, found.given)
    return {"id": one.id, "n_points": one.n_points, "explains": found.explains, "reason": found.reason, **row}


def write_member(path: Path, fitted: FittedFile, objects: Sequence[FittedObject] = ()) -> None:
    """Write member.json."""
    write_text(path, json.dumps(member_tree(fitted, objects), indent=1, allow_nan=False) + "\n")
