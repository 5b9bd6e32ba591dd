"""Key points of a surface with their frames and features: what `ransac.propose` matches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.options import option
from scan2fea.registration.descriptors import descriptors
from scan2fea.registration.frame import right_handed, toward, variants_left
from scan2fea.registration.keypoints import KeypointOptions, keypoints, saliency
from scan2fea.registration.ransac import Features
from scan2fea.registration.surface import Surface, spread_rows


@dataclass(frozen=True, kw_only=True)
class FeatureOptions:
    """Radii in edges of the voxels."""

    at: str = option("keypoints", "keypoints: ISS; stride: one point per voxel of `apart` edges", choices=("keypoints", "stride"))
    density_radius: float = option(2.0, "r_density of eq 2.1", unit="edges", minimum=1.0)
    saliency_radius: float = option(6.0, "r_frame of eq 2.2 where key points are sought", unit="edges", minimum=2.0)
    radius: float = option(15.0, "Reach of the feature and of its frame", unit="edges", minimum=3.0)
    apart: float = option(2.5, "Key points are farther apart than this", unit="edges", minimum=1.0)
    least: int = option(100, "With fewer key points than this, points at a stride are used as well", minimum=0)


def features(surface: Surface, options: FeatureOptions = FeatureOptions(), limits: KeypointOptions = KeypointOptions()) -> Features:
    """Features of a surface; none where it is empty."""
    edge, points = surface.edge_m, surface.points
    rows = np.zeros(0, np.int64)
    if options.at == "keypoints":
        rows = keypoints(points, options.density_radius * edge, options.saliency_radius * edge, options.apart * edge, limits)
    if options.at == "stride" or len(rows) < options.least:
        strided = spread_rows(points, 2 * options.apart * edge)
        rows = np.unique(np.concatenate([rows, strided]))[: 2 * limits.at_most]
    found = saliency(points, rows, options.density_radius * edge, options.radius * edge)
    seen = surface.is_seen[rows]
    frames = toward(right_handed(found.axes), surface.normals[rows], seen)
    values = descriptors(points, rows, frames, found.weight, options.radius * edge)
    return Features(points=points[rows], frames=frames, values=values, variants=variants_left(bool(seen.all() and len(seen) > 0)))
