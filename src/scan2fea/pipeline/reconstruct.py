"""Reconstruction alone: what `scan2fea reconstruct` writes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from scan2fea import __version__
from scan2fea.errors import EmptyScanError, UsageError, require
from scan2fea.io import RawScan, read_scan, write_mesh_ply, write_stl, write_text
from scan2fea.kernel.coverage import area_shares, deviation, face_origin
from scan2fea.kernel.measures import area, volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import surface_topology
from scan2fea.pipeline.config import Config, to_toml
from scan2fea.pipeline.fuse import require_no_fusion
from scan2fea.pipeline.results import finite_tree
from scan2fea.pipeline.scene import require_extent, shift_of, shifted
from scan2fea.pipeline.sheet import sheet_of
from scan2fea.reconstruction import Reconstruction, reconstruct
from scan2fea.types import Scan, TriangleMesh
from scan2fea.units import unit_system

RECONSTRUCT_SCHEMA = "scan2fea reconstruct 1"
FILES = ("surface.ply", "sheet.ply", "surface.stl", "report.json", "config.toml")


def reconstruct_file(path: Path, out: Path, config: Config) -> dict[str, Any]:
    """All points of a file as one closed surface: OUT gets surface.ply (with the origin of every face), surface.stl, report.json and config.toml;
    where a check fails also sheet.ply, what was measured.

    Returns the content of report.json. Raises UsageError for an OUT that holds other files, InputError for a file that cannot be used,
    ReconstructionError where no surface comes out.
    """
    require(not out.exists() or out.is_dir(), UsageError, f"{out}: is a file; give a folder with -o")
    if out.is_dir() and any(entry.name not in FILES for entry in out.iterdir()):
        raise UsageError(f"{out}: holds other files than those of `reconstruct`; give an empty or new folder with -o")
    require_no_fusion(config.fusion, "`reconstruct` takes one file as it lies")
    raw = read_scan(path, config.input)
    require(len(raw.scan.cloud), EmptyScanError, f"{path}: holds no usable point")
    require_extent(raw.scan.cloud.points)
    shift = shift_of(raw.scan.cloud.points)
    scan = shifted(raw.scan, shift)
    found = reconstruct(scan, config.reconstruction)
    origin = face_origin(found.mesh, scan.cloud.points, scan.cloud.is_inferred, found.spacing_m, found.sigma_m)
    mesh = replace(found.mesh, face_origin=origin)
    report = {**_head(raw, config), "frame": {"shift_m": shift.tolist()}, **_surface(mesh, found, scan)}
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out}: cannot be written ({error.strerror}); give another folder with -o") from error
    tree = dict(finite_tree(report))
    write_mesh_ply(out / "surface.ply", mesh)
    (out / "sheet.ply").unlink(missing_ok=True)
    sheet = None if report["passed"] else sheet_of(scan, mesh, found.spacing_m, found.sigma_m, config.reconstruction)
    if sheet is not None:
        write_mesh_ply(out / "sheet.ply", sheet)
    write_stl(out / "surface.stl", mesh, unit_system(config.export.units).length)
    write_text(out / "config.toml", to_toml(config))
    write_text(out / "report.json", json.dumps(tree, indent=1, allow_nan=False) + "\n")
    return tree


def _head(raw: RawScan, config: Config) -> dict[str, Any]:
    return {
        "schema": RECONSTRUCT_SCHEMA,
        "version": __version__,
        "seed": config.run.seed,
        "sha256": raw.sha256,
        "n_points": len(raw.scan.cloud),
        "unit": raw.unit,
        "unit_source": raw.unit_source,
    }


def _surface(mesh: TriangleMesh, found: Reconstruction, scan: Scan) -> dict[str, Any]:
    topology = surface_topology(mesh)
    far = deviation(mesh, scan.cloud.points, found.spacing_m, found.sigma_m, scan.cloud.is_inferred)
    against = [check for check in found.checks if not check.passed]
    return {
        "sensor": found.sensor,
        "how": dict(found.how),
        "surface": {
            "n_vertices": len(mesh.vertices),
            "n_faces": len(mesh.faces),
            "closed": topology.is_closed,
            "manifold": topology.is_manifold,
            "n_boundary_edges": topology.n_boundary_edges,
            "n_self_intersections": len(self_intersections(mesh)),
            "n_components": topology.n_components,
            "volume_m3": volume(mesh),
            "area_m2": area(mesh),
            "area_share": {} if mesh.face_origin is None else area_shares(mesh, mesh.face_origin),
        },
        "deviation": {"mean_m": far.mean_m, "rms_m": far.rms_m, "p95_m": far.p95_m, "max_m": far.max_m},
        "checks": [{"name": c.name, "value": c.value, "limit": c.limit, "unit": c.unit, "passed": c.passed} for c in found.checks],
        "passed": not against,
        "reason": "; ".join(check.says for check in against),
    }
