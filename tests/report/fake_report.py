"""A report.json such as the pipeline writes: one object converted, two failed for different reasons, hostile names."""

from __future__ import annotations

import copy
from typing import Any

HOSTILE = '<script>alert("x")</script>&\'.ply'


def spread(low: float, p01: float, median: float) -> dict[str, float]:
    return {"min": low, "p01": p01, "median": median}


def check(name: str, value: Any, limit: Any, unit: str, passed: bool, says: str = "") -> dict[str, Any]:
    return {"name": name, "value": value, "limit": limit, "unit": unit, "passed": passed, "says": says}


def optimised(step, least, done=None):
    measures = {"min_dihedral_deg": (least, 21.0, 48.3, 0.0, 70.5), "scaled_jacobian": (0.1, 0.3, 0.7, -1.0, 1.0), "aspect": (1.1, 1.3, 2.0, 1, 10)}
    keys = ("min", "p01", "median", "low", "high")
    rows = {name: {**dict(zip(keys, values, strict=True)), "counts": [0, 12, 14_000]} for name, values in measures.items()}
    return {"step": step, "n_tets": 14012, "measures": rows, **({"done": done} if done else {})}


def case(name: str, measure: str, unit: str, value: float, expected: float | None = None, std: float | None = None) -> dict[str, Any]:
    error = None if expected is None else abs(value / expected - 1)
    return {"name": name, "measure": measure, "unit": unit, "value": value, "expected": expected, "relative_error": error, "std": std}


CONVERTED: dict[str, Any] = {
    "id": 1,
    "kind": "L-beam?",
    "route": "reconstruction",
    "route_reason": "no family of members fits within the noise",
    "n_points": 34812,
    "size_m": [0.30481, 0.12703, 0.12696],
    "noise_m": 0.00051,
    "spacing_m": 0.0021,
    "assumptions": ["density and stiffness of structural steel S235"],
    "surface": {
        "n_vertices": 3120,
        "n_faces": 6236,
        "closed": True,
        "manifold": True,
        "n_boundary_edges": 0,
        "n_self_intersections": 0,
        "n_components": 1,
        "volume_m3": 0.00047876,
        "area_m2": 0.153642,
        "area_share": {"measured": 0.846, "interpolated": 0.121, "invented": 0.033},
        "quality": {f"Q{i}": spread(0.31, 0.52, 0.91) for i in range(1, 5)},
    },
    "volume": {
        "n_nodes": 24210,
        "n_tets": 14012,
        "order": 2,
        "volume_m3": 0.00047875,
        "quality": {
            **{f"Q{i}": spread(0.21, 0.42, 0.81) for i in range(1, 6)},
            "scaled_jacobian": spread(0.22, 0.35, 0.71),
            "min_dihedral_deg": spread(12.41, 21.0, 48.3),
        },
        "optimised": [
            optimised("filled", 4.2),
            optimised("odt", 9.0, {"iterations": 5, "energy": [1.0, 0.92]}),
            optimised("exude", 12.41, {"undone": 1}),
        ],
    },
    "cad": {"n_faces": 8, "valid": True, "volume_m3": 0.00047878, "n_planar": 8, "n_cylindrical": 0, "n_nurbs": 0},
    "fea": {
        "elements": "C3D10",
        "dof": 72630,
        "solver": "embedded, preconditioned conjugate gradients",
        "mass_kg": 3.7583,
        "frequencies_hz": [412.5, 431.2, 1044.0],
        "material": {"name": "steel S235", "youngs_pa": 2.1e11, "poisson": 0.3, "density_kg_m3": 7850.0, "yield_pa": 2.35e8, "source": "EN 10025-2"},
        "cases": [
            case("self weight", "reaction", "N", 36.87, 36.87),
            case("self weight", "largest displacement", "m", 3.12e-8, None, 2e-10),
            case("free-free modal", "rigid-body modes", "", 6, 6),
            case("free-free modal", "first elastic frequency", "Hz", 412.5),
        ],
    },
    "deviation": {"mean_m": 0.00001, "rms_m": 0.00053, "p95_m": 0.00104, "max_m": 0.0041, "measured_area_fraction": 0.846},
    "drift": [
        {"step": "reconstruction", "volume_m3": 0.000481, "thickness_m": 0.00642, "p95_m": 0.0009},
        {"step": "remeshing", "volume_m3": 0.0004788, "thickness_m": 0.00637, "p95_m": 0.00103},
        {"step": "tetmeshing", "volume_m3": 0.00047875, "thickness_m": None, "p95_m": 0.00104},
    ],
    "checks": [
        check("surface closed", True, True, "", True),
        check("crossing faces", 0, 0, "", True),
        check("smallest dihedral angle", 12.41, 5.0, "deg", True),
        check("volume: tets against surface", 2e-5, 0.005, "", True),
        check("points to surface, 95 %", 0.00104, 0.00153, "m", True),
        check("reaction against weight", 3e-9, 1e-6, "", True),
    ],
    "files": [
        "objects/01/cloud.ply",
        "objects/01/surface.ply",
        "objects/01/surface.stl",
        "objects/01/volume.vtu",
        "objects/01/model.step",
        "objects/01/model.inp",
    ],
    "verdict": "converted",
    "reason": "all 6 checks passed",
}

ONE_SIDED: dict[str, Any] = {
    "id": 2,
    "kind": "plate",
    "route": "reconstruction",
    "route_reason": "free form",
    "n_points": 5121,
    "size_m": [0.6, 0.4, 0.002],
    "noise_m": 0.0005,
    "spacing_m": 0.003,
    "surface": None,
    "checks": [
        check("seen from both sides", 0.48, 0.3, "", False, "scan it from below as well: 52 % of its skin has not been seen"),
        check("points", 5121, 100, "", True),
    ],
    "files": ["objects/02/cloud.ply"],
    "verdict": "failed",
    "reason": "seen from one side only: 52 % of the skin would be invented (limit 30 %)",
}

THIN: dict[str, Any] = {
    **ONE_SIDED,
    "id": 3,
    "kind": "sheet",
    "checks": [check("thickness against noise", 0.0011, 0.0015, "m", False, "use a scanner with less than 0.3 mm noise")],
    "files": ["objects/03/cloud.ply"],
    "reason": "thinner than the scanner can tell: 1.1 mm at a noise of 0.5 mm",
}


def stage(name: str, seconds: float, n_in: int, n_out: int, **more: Any) -> dict[str, Any]:
    return {"name": name, "seconds": seconds, "peak_mb": 400.0, "n_in": n_in, "n_out": n_out, "options": {"voxel_m": None, "method": "auto"}, **more}


def fake_report() -> dict[str, Any]:
    """A fresh report every time."""
    report = {
        "schema": 1,
        "version": "0.1.0",
        "seed": 7,
        "command": ["scan2fea", "run", HOSTILE, "-o", "my out"],
        "frame": {"shift_m": [0.0, 0.0, 0.0]},
        "inputs": [
            {
                "path": HOSTILE,
                "sha256": "0" * 64,
                "n_points": 123456,
                "used": True,
                "reason": None,
                "unit": "m",
                "unit_source": "assumed",
                "sensor": "known",
                "date": "2021-05-04",
            },
            {
                "path": "empty.pcd",
                "sha256": "",
                "n_points": 0,
                "used": False,
                "reason": "empty.pcd: holds no point",
                "unit": None,
                "unit_source": None,
                "sensor": None,
            },
        ],
        "registration": {"mode": "auto", "frames": [], "links": []},
        "stages": [
            stage("input", 0.41, 1, 123456),
            stage("filtering", 1.9, 123456, 98012),
            stage("segmentation", 2.2, 98012, 3),
            stage("reconstruction", 9.0, 34812, 6236, object=1),
        ],
        "objects": [CONVERTED, ONE_SIDED, THIN],
        "noise_m": 0.0005,
        "spacing_m": 0.0021,
        "assumptions": ["the unit is metres: the file does not say"],
        "options_changed": {"filtering.voxel_m": {"value": 0.002, "default": None}},
    }
    return copy.deepcopy(report)
