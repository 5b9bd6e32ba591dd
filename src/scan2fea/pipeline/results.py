"""From values to the rows of report.json (its schema is published in scan2fea.report). Numbers that are not known become null."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea import __version__
from scan2fea.cad import Snap
from scan2fea.fea.elements import surface_volume
from scan2fea.fea.surfaces import surface
from scan2fea.io import RawScan
from scan2fea.io.files import sha256_of
from scan2fea.kernel.coverage import area_shares
from scan2fea.kernel.measures import area, tet_volumes, volume
from scan2fea.kernel.pinned import SEEN
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.quality import summary, surface_quality, tet_quality
from scan2fea.kernel.topology import surface_topology
from scan2fea.pipeline.against import drawing_row, drawing_words
from scan2fea.pipeline.config import Config, known_keys
from scan2fea.pipeline.frames import registration_row
from scan2fea.pipeline.member_rows import changing, damaged, holed, member_row, rooted
from scan2fea.pipeline.part import Made
from scan2fea.pipeline.route import Estimate
from scan2fea.pipeline.scene import Scene
from scan2fea.segmentation import Selection
from scan2fea.types import Brep, Check, FEModel, FEResult, FloatArray, Member, Parameter, Segments, TetMesh, TriangleMesh
from scan2fea.verification.limits import limits
from scan2fea.verification.member import assumed_volume_std
from scan2fea.verification.tellable import smallest_hole_m, smallest_hole_of_member_m
from scan2fea.verification.verdict import verdict

SCHEMA = 1

MAX_NAMES = 500  # names of more CAD faces than this help nobody
_MANY_STRAYS = 0.05  # of the points: from there on the deviation told of 95 % of them is that of strays
_MUCH = 0.01  # of the section: what is asked of a volume
LIBRARIES = ("numpy", "scipy", "numba", "PyMaxflow", "gmsh", "cadquery-ocp-novtk", "pyamg")


def number(x: Any) -> Any:
    """A finite float or None."""
    return float(x) if x is not None and math.isfinite(float(x)) else None


def input_row(path: Path, raw: RawScan | None, reason: str | None) -> dict[str, Any]:
    """One entry of inputs[]; `reason` says why the file was left out."""
    if raw is None:
        return {
            "path": str(path),
            "sha256": _sha256(path),
            "n_points": 0,
            "used": False,
            "reason": reason,
            "unit": None,
            "unit_source": None,
            "sensor": None,
        }
    return {
        "path": str(path),
        "sha256": raw.sha256,
        "n_points": raw.n_points,
        "used": True,
        "reason": None,
        "unit": raw.unit,
        "unit_source": raw.unit_source,
        "sensor": raw.sensor,
    }


def _sha256(path: Path) -> str:
    try:
        return sha256_of(path)
    except OSError:
        return ""  # there is no such file, or it is a folder


def surface_row(mesh: TriangleMesh) -> dict[str, Any]:
    """objects[].surface."""
    topology = surface_topology(mesh)
    return {
        "n_vertices": len(mesh.vertices),
        "n_faces": len(mesh.faces),
        "closed": topology.is_closed,
        "manifold": topology.is_manifold,
        "n_boundary_edges": topology.n_boundary_edges,
        "n_self_intersections": len(self_intersections(mesh)),
        "n_components": topology.n_components,
        "volume_m3": number(volume(mesh)),
        "area_m2": number(area(mesh)),
        "area_share": area_shares(mesh, mesh.face_origin) if mesh.face_origin is not None else None,
        "quality": finite_tree(surface_quality(mesh)),
    }


def volume_row(tets: TetMesh, steps: Sequence[Mapping[str, Any]] = ()) -> dict[str, Any]:
    """objects[].volume; `steps` is the log of the optimisers of the tets."""
    quality = {name: summary(values) for name, values in tet_quality(tets.nodes, tets.tets).items()}
    used = len(np.unique(tets.tets))
    total = float(tet_volumes(tets.nodes, tets.tets).sum())
    row = {"n_nodes": used, "n_tets": len(tets.tets), "order": tets.order, "volume_m3": number(total), "quality": finite_tree(quality)}
    return {**row, "optimised": finite_tree(list(steps))} if steps else row


def cad_row(brep: Brep, tets: TetMesh | None, how: Mapping[str, Any], snaps: Sequence[Snap]) -> dict[str, Any]:
    """objects[].cad; the names are those of the sets of the deck. route, reason : true faces, or why they are facets; none of these for a member."""
    kinds = brep.face_kinds
    told = {"route": how.get("cad_route"), "reason": how.get("cad_reason") or None, "snaps": [_snap_row(s) for s in snaps]}
    return {
        "n_faces": len(kinds),
        "valid": brep.is_valid,
        "volume_m3": number(brep.volume_m3),
        "n_planar": sum(kind in ("plane", "facet") for kind in kinds),
        "n_cylindrical": kinds.count("cylinder"),
        "n_nurbs": kinds.count("nurbs") + kinds.count("patch"),
        "n_conical": kinds.count("cone"),
        "n_spherical": kinds.count("sphere"),
        "n_revolution": kinds.count("revolution"),
        "n_facets": kinds.count("facet"),
        **({key: value for key, value in told.items() if value is not None} if told["route"] else {}),
        **({"patches": finite_tree(how["cad_patches"])} if "cad_patches" in how else {}),
        **({"cylinders": finite_tree(how["cad_cylinders"])} if "cad_cylinders" in how else {}),
        "face_names": list(brep.face_names if tets is None else tets.face_names)[:MAX_NAMES],
    }


def _snap_row(snap: Snap) -> dict[str, Any]:
    """One tested relation between surfaces; `off` in radians for directions, else metres."""
    return {**dataclasses.asdict(snap), "unit": "rad" if snap.relation in ("parallel", "orthogonal") else "m"}


def fea_row(model: FEModel, result: FEResult) -> dict[str, Any]:
    """objects[].fea."""
    return {
        "elements": "C3D10" if model.mesh.order == 2 else "C3D4",
        "dof": result.n_dof,
        "solver": result.solver,
        "mass_kg": model.material.density_kg_m3 * surface_volume(np.asarray(model.mesh.nodes), np.asarray(model.mesh.boundary)),
        "frequencies_hz": [float(f) for f in result.frequencies_hz[6:]],
        "material": dataclasses.asdict(model.material),
        "cases": [dataclasses.asdict(case) for case in result.cases],
        "supports": dict(model.supports),
        "sets": _set_rows(model),
        "failed_cases": dict(result.failed),
        "n_singular_nodes": len(result.singular),
    }


def _set_rows(model: FEModel) -> list[dict[str, Any]]:
    """The faces that supports and loads can name: area, centroid and mean outward normal, to tell them apart."""
    rows = []
    for name, triangles in list(model.surfaces.items())[:MAX_NAMES]:
        on = surface(np.asarray(model.mesh.nodes), np.asarray(model.mesh.boundary[triangles]))
        area = float(on.area.sum())
        if area > 0:
            rows.append({"name": name, "area_m2": area, "centre_m": on.centroid, "normal": on.outward.sum(axis=(0, 1)) / area})
    return rows


def check_row(check: Check) -> dict[str, Any]:
    """One entry of checks[]."""
    value = check.value if not isinstance(check.value, float) else number(check.value)
    row = {"name": check.name, "value": value, "limit": check.limit, "unit": check.unit, "passed": check.passed}
    return row if check.passed else {**row, "says": check.says}


def object_row(made: Made, files: Sequence[str]) -> dict[str, Any]:
    """One entry of objects[]: what was made, what was checked, and the verdict."""
    missing = [name for name, value in (("tets", made.tets), ("solid", made.brep), ("model", made.model), ("solution", made.result)) if value is None]
    found = verdict(made.checks, made.stopped, missing)
    row: dict[str, Any] = {
        "id": made.part.id,
        "kind": made.part.kind,
        "route": made.route.name if made.route is not None else "reconstruction",
        "route_reason": made.route.reason if made.route is not None else "stopped before the route was chosen",
        "n_points": len(made.part.scan.cloud),
        "size_m": np.ptp(_extreme(made, found.name == "converted"), axis=0),
        "sensor": made.sensor,
        "spacing_m": number(made.spacing_m),
        "noise_m": number(made.sigma_m),
        "between_frames_m": number(max(made.part.doubt.between_m, made.estimate.apart_m if made.estimate is not None else 0.0)),
        "how": {key: value for key, value in made.how.items() if isinstance(value, str | int | float | bool)},
    }
    if made.member is not None:
        told = made.estimate
        row["member"] = member_row(made.member, told.p_fixed, told.given) if told is not None else member_row(made.member)
    if made.surface is not None and len(made.surface.faces):
        row["surface"] = surface_row(made.surface) | _narrowest(made)
    if made.tets is not None:
        row["volume"] = volume_row(made.tets, made.how.get("steps") or ())
    if made.brep is not None:
        row["cad"] = cad_row(made.brep, made.tets, made.how, made.snaps)
    if made.model is not None and made.result is not None:
        row["fea"] = fea_row(made.model, made.result)
    row["deviation"] = deviation_row(made)
    row["drawing"] = drawing_row(made)
    row["drift"] = made.drift
    row["checks"] = [check_row(check) for check in made.checks]
    row["files"] = list(files)
    row["verdict"], row["reason"] = found.name, found.reason
    if found.name == "converted" and made.member is not None:
        row["reason"] += assumed(made.member) + (claimed(made.member, made.estimate) + left_out(made.estimate) if made.estimate is not None else "")
    row["reason"] += _apart(made) + _narrow_holes(row) if found.name == "converted" else ""
    row["reason"] += drawing_words(made)
    if found.name == "converted" and made.supported_share > 0:
        row["supported_share"] = made.supported_share
        share = f"{made.supported_share:.0%}" if made.supported_share >= 0.01 else "less than 1 %"
        rests = ["rests on a plane that was"] if made.part.contact.any() else []
        follows = "follows from faces that were: from the thickness of a wall round about, or round the axis of a body of revolution"
        walls = [follows] if len(made.carried) else []
        row["reason"] += f"; {share} of the surface was not seen: it {' or '.join(rests + walls)}"
    if found.name == "converted" and "new_boundary" in made.how:
        row["reason"] += f"; the surface given could not be repaired ({made.how['new_boundary']}): it is the boundary that fTetWild found"
    if found.name == "converted" and "cad_holes" in made.how:
        holes = made.how["cad_holes"]
        row["reason"] += f"; {holes['solid']} holes go through, the surface had {holes['surface']}: where they differ no point was measured"
    if found.name == "converted" and made.tets is not None:
        row["reason"] += _budget(made.tets, made.how)
    if found.name == "converted" and made.result is not None:
        row["reason"] += _not_solved(made.result.failed)
    return dict(finite_tree({key: value for key, value in row.items() if value is not None}))


def _apart(made: Made) -> str:
    """How far the scans may lie off each other, for the verdict's line: by their poses, and by the points themselves."""
    doubt, measured = made.part.doubt.between_m, made.how.get("scans_apart_m")
    said = f"; points of different scans may lie {doubt:.2g} m off each other (one standard deviation of their poses)" if doubt > made.sigma_m else ""
    seen = "scans lie {:.2g} mm off each other where several saw the same (one standard deviation)"
    return said + ("; " + seen.format(measured * 1e3) if measured else "")


def _narrowest(made: Made) -> dict[str, float]:
    """`smallest_hole_m` of what was made of points."""
    if made.part.mesh is not None or made.surface is None or not made.spacing_m > 0:
        return {}
    told = area(made.surface), made.spacing_m, made.sigma_m
    if made.member is None:
        return {"smallest_hole_m": smallest_hole_m(*told)}
    return {"smallest_hole_m": smallest_hole_of_member_m(*told, both_sides=min(made.member.seen.values(), default=0.0) >= SEEN)}


def _narrow_holes(row: Mapping[str, Any]) -> str:
    """The same for the verdict's line, of objects[]."""
    found = row.get("surface", {}).get("smallest_hole_m")
    return f"; holes of less than {float(f'{found * 1e3:.2g}'):g} mm across may have been closed unseen" if found else ""


def _not_solved(failed: Mapping[str, str]) -> str:
    """Cases without a result, for the verdict's line: each reason once."""
    whose: dict[str, list[str]] = {}
    for name, why in failed.items():
        whose.setdefault(why.removeprefix(f"case {name}: "), []).append(name)
    return "".join(f"; not solved: {', '.join(names)} ({why})" for why, names in whose.items())


# plates with a hole, 12 and 24 edges round it, against the closed form: benchmarks/holes.py, docs/fea.md
LOW_PEAKS = "peaks of stress at holes are 7 to 11 % low with 12, 4 to 7 % with 24"


def _budget(tets: TetMesh, how: Mapping[str, Any]) -> str:
    """What the budget of elements did to the mesh, or the mesh to it."""
    said = f"; it took {len(tets.tets)} elements, tetmeshing.max_elements is {how['max_elements']}" if how.get("over_budget") else ""
    if "full_per_turn" in how:
        fewer = f"circles have {how['per_turn']:.3g} edges for {how['full_per_turn']:g}"
        said += f"; {fewer}: with more the mesh passes tetmeshing.max_elements or max_nodes; {LOW_PEAKS}"
    return said


def _extreme(made: Made, is_converted: bool) -> FloatArray:
    """(n, 3) what the size is taken of: the surface that was converted, else the points; noise and strays are no size of the part."""
    return made.surface.vertices[np.unique(made.surface.faces)] if is_converted and made.surface is not None else made.part.scan.cloud.points


def assumed(member: Member) -> str:
    """What the solid of a member rests on besides its points, for the verdict's line."""
    walls = [p for p in member.parameters if p.source in ("catalogue", "estimate")]
    said = ", ".join(f"{p.name} = {p.value_m * 1e3:.4g} mm from {_stand_in(member, p)}" for p in walls)
    prior = f"; not observable, built with {said}{_doubt(member)}" if walls else ""
    unseen = sum(share < SEEN for share in member.seen.values())
    rests = f"; {', '.join(member.seated)}: from the plane that it rests on" if member.seated else ""
    follow = f"; {unseen} of {len(member.seen)} faces of the section were not seen, they follow from the others" if unseen else ""
    return prior + changing(member) + holed(member) + damaged(member) + rooted(member) + rests + follow


def left_out(found: Estimate) -> str:
    """What the points do not show of a member, for the verdict's line: ends without a face that was seen, a wall of which neither side was; how
    many points it leaves to nothing, where more than one in twenty, and how much of its section, where more than a hundredth.
    """
    share, bare = found.stray_share, ("", "one end", "both ends")[found.bare_ends]
    ends = f"; of {bare} no face was seen: the member is taken to end where its sides do" if bare else ""
    wall = found.bare_wall
    if wall is not None:
        where = f"between {wall.from_m:.3f} and {wall.to_m:.3f} m along it"
        ends += f"; {where} neither {wall.face} nor the side behind it was seen: the wall is taken to be there"
    if abs(found.lack) > _MUCH:
        ends += f"; its points lie off its faces by {found.lack:+.1%} of the section: roundings or slopes that the solid has not"
    return ends + (f"; {share:.0%} of the points lie off it, scattered, and were taken for strays" if share > _MANY_STRAYS else "")


def claimed(member: Member, found: Estimate) -> str:
    """What the solid of a member rests on because the user said so, for the verdict's line."""
    sizes = ", ".join(f"{name} = {member.values()[name] * 1e3:.4g} mm" for name in found.untold)
    said = f"; {sizes} as given, not measured: the points do not tell {'them' if len(found.untold) > 1 else 'it'}" if sizes else ""
    if found.whole and member.reached:
        faces = ", ".join(member.reached)
        said += f"; {faces} not seen, but told by where the scan of the next face ends, as nothing is said to have hidden it or to be cut off (whole)"
    return said


def _stand_in(member: Member, wall: Parameter) -> str:
    """What a wall that the points do not tell was built with."""
    if wall.source == "estimate":
        return "the estimate of the points, which they cannot vouch for (no standard size is near it)"
    sizes = [e for e in member.catalogue if e.parameters.get(wall.name) == wall.value_m]
    named = sorted(sizes, key=lambda e: -e.is_standard)
    return f"the catalogue ({named[0].name})" if named else "the catalogue"


def _doubt(member: Member) -> str:
    """How uncertain the volume is for it, where that is more than a measured member may be."""
    share, allowed = assumed_volume_std(member), float(limits()["member.volume_std"]["limit"])
    if share <= allowed:
        return ""
    return f", so that the volume is uncertain by {share:.0%} (one standard deviation; of measured members at most {allowed:.0%})"


def deviation_row(made: Made) -> dict[str, Any] | None:
    """objects[].deviation. An input with faces is its own measurement: its vertices are the cloud."""
    found = made.deviation
    if found is None:
        return None
    return {name: number(getattr(found, name)) for name in ("mean_m", "rms_m", "p95_m", "max_m", "measured_area_fraction")}


def run_report(
    config: Config,
    command: Sequence[str],
    inputs: Sequence[Mapping[str, Any]],
    scene: Scene,
    segments: Segments,
    stages: Sequence[Mapping[str, Any]],
    objects: Sequence[Mapping[str, Any]],
    chosen: Selection,
    segment_list: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """The whole report.json; segment_list : its segments[]."""
    defaults = known_keys()
    changed = {k: {"value": v, "default": defaults[k]} for k, v in known_keys(config).items() if v != defaults[k]}
    report = {
        "schema": SCHEMA,
        "version": __version__,
        "versions": {name: metadata.version(name) for name in LIBRARIES},
        "seed": config.run.seed,
        "command": list(command),
        "frame": {"shift_m": [float(x) for x in scene.shift_m]},
        "inputs": list(inputs),
        "registration": registration_row(inputs, scene, config.registration.mode),
        "spacing_m": number(scene.spacing_m),
        "segmentation": dict(segments.how),
        "segments": list(segment_list),
        "stages": list(stages),
        "objects": list(objects),
        "assumptions": assumptions(inputs),
        "options_changed": changed,
        "warnings": [*scene.notes, *chosen.notes],
    }
    return dict(finite_tree(report))


def assumptions(inputs: Sequence[Mapping[str, Any]]) -> list[str]:
    """What was taken for granted, one sentence each."""
    assumed = [row["path"] for row in inputs if row["unit_source"] == "assumed"]
    told = [f"the unit of {Path(path).name} is metres: its format states none (--unit says otherwise)" for path in assumed[:3]]
    if len(assumed) > 3:
        told.append(f"the same holds for {len(assumed) - 3} more inputs")
    return [*told, "every object is solid and of one linear elastic material, see the deck"]


def assumed_unit(inputs: Sequence[Mapping[str, Any]], scene: Scene) -> tuple[str, ...]:
    """One line where a unit was assumed, with what it makes of the scene: thousands of metres are soon seen to be millimetres."""
    if not any(row["unit_source"] == "assumed" for row in inputs):
        return ()
    size = " x ".join(f"{length:.4g}" for length in np.ptp(scene.scan.cloud.points, axis=0))
    return (f"no unit stated: taken for metres, which makes the scene {size} m (--unit mm, in, ft, ... says otherwise)",)


def finite_tree(tree: Any) -> Any:
    """The tree in plain Python values, with None for every number that is not finite (JSON has no NaN)."""
    if dataclasses.is_dataclass(tree) and not isinstance(tree, type):
        tree = dataclasses.asdict(tree)
    if isinstance(tree, Mapping):
        return {str(key): finite_tree(value) for key, value in tree.items()}
    if isinstance(tree, tuple | list | np.ndarray):
        return [finite_tree(value) for value in tree]
    if isinstance(tree, np.generic):
        tree = tree.item()
    if isinstance(tree, float):
        return number(tree)
    return tree
