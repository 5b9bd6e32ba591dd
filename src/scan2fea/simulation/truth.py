"""What is true of a simulated scan, as JSON: every object with every length in metres, its volume, inertia, pose and mesh file.

The form is that of the independent judge's cases where it fits, so that a folder of simulated scans can be judged as it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from scan2fea.kernel.measures import area, centroid, inertia
from scan2fea.simulation.bounds import LEAST_NOISE_M, member_bounds, observable
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.types import FloatArray

BACKGROUND = ("box", "table")  # kinds that are the room, not what is to be modelled


def truth_of(
    scene: Scene,
    *,
    identity: str,
    seed: int,
    files: Sequence[str],
    n_points: Sequence[int],
    seen: FloatArray,
    sensors: Sequence[str],
    noise: str,
    noise_m: float,
    noise_sd_m: float,
    bounds: Mapping[str, Mapping[str, float]],
    meshes: Mapping[str, str],
    steps: Mapping[str, Mapping[str, Any]],
) -> dict[str, Any]:
    """The tree that truth.json holds. n_points : per solid.   seen : (n,) share of each surface.

    bounds : Cramer-Rao, by name of solid.   meshes : file of each solid by name.   steps : its STEP: file, and what it holds.
    """
    even = not sensors  # sampled evenly over every surface
    objects = []
    for k, solid in enumerate(scene.solids):
        entry = _object(solid, n_points[k], float(seen[k]), meshes[solid.name], steps.get(solid.name))
        known = bounds.get(solid.name, {})
        told = observable(known, solid.shape.parameters, noise_sd_m)
        entry["unobservable"] = [name for name, is_told in told.items() if not is_told]
        entry["crb_m"] = {name: bound for name, bound in known.items() if told[name]} if even and noise == "gaussian" and noise_sd_m > 0 else {}
        objects.append(entry)
    total = int(sum(n_points))
    seen_area = sum(area(s.mesh) * share for s, share in zip(scene.solids, seen, strict=True))
    return {
        "id": identity,
        "title": f"{scene.name}: {len(objects)} objects, {', '.join(sensors) or 'surfaces sampled'}, noise {noise} {noise_m * 1e3:g} mm",
        "tags": ["room" if len(objects) > 1 else "member"],
        "quick": False,
        "seed": seed,
        "files": list(files),
        "sensors": list(sensors),
        "objects": objects,
        "unit": "m",
        "noise": "gauss" if noise == "gaussian" else noise,
        "sigma_m": noise_m,
        "noise_sd_m": noise_sd_m,
        "expect": "convert",
        "coverage": "full" if even else "partial",
        "n_points": total,
        "spacing_m": math.sqrt(seen_area / total) if total else None,
    }


def _object(solid: Solid, n_points: int, seen: float, mesh: str, step: Mapping[str, Any] | None) -> dict[str, Any]:
    T = solid.T_world_shape
    shape = solid.shape
    return {
        "name": solid.name,
        "kind": shape.kind,
        "family": shape.family,
        "target": shape.kind not in BACKGROUND,
        "params_m": dict(shape.parameters),
        "volume_m3": solid.volume_m3,
        "area_m2": area(solid.mesh),
        "centroid_m": centroid(solid.mesh).tolist(),
        "inertia_m5": inertia(solid.mesh).tolist(),
        "chord_m": solid.chord_m,
        "exact": None if solid.defects else _exact(solid),
        "bow_m": sum(numbers["depth"] for kind, numbers in solid.defects if kind == "sag"),
        "defects": [{"kind": kind, **numbers} for kind, numbers in solid.defects],
        "mesh": mesh,
        "step": step and step["file"],
        "step_holds": step and {key: value for key, value in step.items() if key != "file"},
        "n_points": n_points,
        "seen_fraction": seen,
        "unobservable": [],
        "n_cad_faces": shape.n_cad_faces,
        "rotation": T[:3, :3].tolist(),
        "origin": T[:3, 3].tolist(),
        "section": [loop.tolist() for loop in shape.section] or None,
        "probes": [[p.name, p.middle.tolist(), p.direction.tolist(), p.size_m] for p in solid.probes()],
    }


def _exact(solid: Solid) -> dict[str, Any]:
    """The closed forms, in the world."""
    moments = solid.shape.exact.moved(solid.T_world_shape)
    return {
        "volume_m3": moments.volume_m3,
        "area_m2": moments.area_m2,
        "centroid_m": moments.centroid.tolist(),
        "inertia_m5": moments.inertia.tolist(),
    }


def even_bounds(solid: Solid, sd_m: float, n_points: int) -> dict[str, float]:
    """The Cramer-Rao bounds of a whole member whose surface was sampled evenly, ends included; none of other objects."""
    if not has_bounds(solid) or n_points == 0:
        return {}
    shape = solid.shape
    caps = 2 * shape.exact.volume_m3 / shape.parameters["length"] / area(solid.mesh) * n_points
    return member_bounds(shape.family, shape.parameters, max(sd_m, LEAST_NOISE_M), n_points - caps, cap_points=caps / 2)


def has_bounds(solid: Solid) -> bool:
    """Members without defects and fillets: the density of kernel.section_likelihood is theirs."""
    return bool(solid.shape.section) and not solid.defects and "fillet" not in solid.shape.parameters
