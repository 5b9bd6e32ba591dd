"""The filters one after the other, as the pipeline runs them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.errors import EmptyScanError, require
from scan2fea.filtering.crop import crop
from scan2fea.filtering.downsample import downsample
from scan2fea.filtering.moving import moving
from scan2fea.filtering.options import FilteringOptions
from scan2fea.filtering.outliers import outliers
from scan2fea.kernel.noise import noise_sigma
from scan2fea.types import Scan


@dataclass(frozen=True, eq=False, kw_only=True)
class Cleaned:
    """scan : what is left, its rays untouched.   how : figures for the report.   notes : sentences for it."""

    scan: Scan
    how: Mapping[str, Any]
    notes: tuple[str, ...]


def clean_up(scan: Scan, options: FilteringOptions = FilteringOptions()) -> Cleaned:
    """What the crop leaves, without what moved.

    Outliers and duplicates go, then voxel means if asked for; a scan above `max_points` is thinned first, so that judging it stays cheap.

    Raises EmptyScanError if nothing is left.
    """
    cloud = scan.cloud
    how: dict[str, Any] = {}
    notes = []
    inside = crop(cloud.points, options)
    if not inside.all():
        says = "no point lies in what filtering.crop_box_m, crop_plane and crop_region_m leave; check their coordinates"
        require(inside.any(), EmptyScanError, says)
        notes.append(f"{int((~inside).sum())} of {len(cloud)} points lie outside the crop and were left out")
        cloud = cloud.take(inside)
    if options.moving:
        gone = moving(Scan(cloud=cloud, rays=scan.rays), float(np.nan_to_num(noise_sigma(cloud.points))))
        notes.append(f"{int(gone.sum())} points were left out because other inputs looked through them: they moved (filtering.moving)")
        cloud = cloud.take(~gone) if gone.any() else cloud
    if len(cloud) > options.max_points:
        thinned = downsample(cloud, options)
        cloud = thinned.cloud
        how |= thinned.how
    marked = outliers(cloud.points, options)
    how |= marked.how
    cloud = cloud if marked.is_good.all() else cloud.take(marked.is_good)
    if "voxel_m" not in how:
        thinned = downsample(cloud, options)
        cloud = thinned.cloud
        how |= thinned.how
    require(len(cloud) > 0, EmptyScanError, "no point is left after filtering; set filtering.outliers = none to keep all")
    if "n_before" in how:
        means = "where they are dense, each as it was measured" if how["voxel_m"] is None else f"by means over cells of {how['voxel_m']:.4g} m"
        notes.append(f"{how['n_before']} points thinned to {how['n_after']} {means}")
    if how["n_outliers"]:
        notes.append(f"{how['n_outliers']} outliers left out ({how['outliers']})")
    if how["n_duplicates"]:
        notes.append(f"{how['n_duplicates']} points that equal an earlier one left out")
    return Cleaned(scan=Scan(cloud=cloud, rays=scan.rays), how=how, notes=tuple(notes))
