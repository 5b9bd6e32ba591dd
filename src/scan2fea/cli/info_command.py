"""`scan2fea info`: what a file holds."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from scan2fea.io import InputOptions, read_scan
from scan2fea.kernel.noise import noise_sigma, spacing
from scan2fea.pipeline.requires import thinnest_wall


def execute(given: argparse.Namespace) -> int:
    raw = read_scan(Path(given.file), InputOptions(unit=given.unit) if given.unit else InputOptions())
    points = raw.scan.cloud.points
    low, high = points.min(axis=0), points.max(axis=0)
    rows = {
        "points in file": f"{raw.n_points:,}",
        "usable": f"{len(points):,}" + (f" ({raw.n_dropped:,} rows without finite coordinates dropped)" if raw.n_dropped else ""),
        "unit": f"{raw.unit} ({raw.unit_source})",
        "sensor position": raw.sensor,
        "columns": ", ".join(raw.columns),
        "from": "  ".join(f"{x:.4f}" for x in low) + "  m",
        "to": "  ".join(f"{x:.4f}" for x in high) + "  m",
        "size": "  ".join(f"{x:.4f}" for x in high - low) + "  m",
    }
    if raw.mesh is not None:
        rows["faces"] = f"{len(raw.mesh.faces):,}"
    if len(points) > 1 and np.any(high > low):
        rows["spacing"] = f"{1e3 * spacing(points):.3g} mm (median to the 6 nearest)"
        sigma = noise_sigma(points)
        wall = 1e3 * thinnest_wall(spacing(points), sigma)
        rows["walls"] = f"below {wall:.3g} mm will not convert as free form, as far as spacing and noise of the whole file tell; members may"
        rows["noise"] = f"{1e3 * sigma:.3g} mm (standard deviation across the surface, estimated)" if np.isfinite(sigma) else "not estimable"
    if raw.voxel_edge_m is not None:
        rows["thinned"] = f"to one point per cell of {1e3 * raw.voxel_edge_m:.3g} mm, to keep within the memory allowed"
    print(given.file)
    for key, text in rows.items():
        print(f"  {key:<16} {text}")
    for note in raw.notes:
        print(f"  note: {note}")
    return 0
