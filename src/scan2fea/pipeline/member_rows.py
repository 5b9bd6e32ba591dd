"""objects[].member of report.json: the dimensions of a fitted member, and how far to trust each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from scan2fea.estimation.given import Given
from scan2fea.estimation.root_fillet import OPEN, TUBE
from scan2fea.types import Member, RoundHole
from scan2fea.units import MILLIMETRES_PER_METRE


def member_row(member: Member, p_fixed: float | None = None, given: Sequence[Given] = ()) -> dict[str, Any]:
    """The row; every number is SI. What was given and the points do not tell is not observable, though nothing stands in for it."""
    untold = {g.name for g in given if g.held and g.measured_m is None}
    parameters = {
        p.name: {
            "value_m": p.value_m,
            "std_m": p.std_m,
            "observable": p.observable and p.name not in untold,
            "source": p.source,
            "spread_m": p.spread_m,
        }
        for p in member.parameters
    }
    return {
        "family": member.family,
        "families": dict(member.families),
        "parameters": parameters,
        "root": {
            "radius_m": member.root.radius_m,
            "std_m": member.root.std_m or None,
            "observable": member.root.is_observable,
            "source": member.root.source,
            "most_m": member.root.most_m,
            "toe_m": member.root.toe_m,
            "toe_std_m": member.root.toe_std_m or None,
            "toe_source": member.root.toe_source,
            "slope": member.root.slope,
            "slope_std": member.root.slope_std or None,
        },
        "covariance_m2": np.asarray(member.covariance).tolist(),
        "catalogue": [
            {"name": e.name, "probability": e.probability, "parameters_m": dict(e.parameters), "offset_m": e.offset_m} for e in member.catalogue
        ],
        "T_world_member": np.asarray(member.T_world_member).tolist(),
        "bow_m": np.asarray(member.bow).tolist(),
        "twist_rad": np.asarray(member.twist).tolist(),
        "change": change_row(member),
        "bends": [
            {
                "start_m": b.start_m,
                "angle_rad": b.angle_rad,
                "radius_m": b.radius_m,
                "roll_rad": b.roll_rad,
                "radius_std_m": b.radius_std_m,
                "angle_std_rad": b.angle_std_rad,
            }
            for b in member.bends
        ],
        "holes": [hole_row(member, hole) for hole in member.holes],
        "end_normals": np.asarray(member.end_normals).tolist(),
        "residual": {"sigma_m": member.sigma_m, "noise": member.noise, "outlier_share": member.outlier_share},
        "seen": dict(member.seen),
        "inside": member.inside,
        "told_toes": list(member.told_toes),
        "reached": list(member.reached),
        "seated": list(member.seated),
        "p_fixed": p_fixed,
        "given": [
            {
                "name": g.name,
                "value_m": g.value_m,
                "measured_m": g.measured_m,
                "std_m": g.std_m,
                "p_value": g.p_value,
                "tolerance_m": g.tolerance_m,
                "held": g.held,
                "contradicted": g.is_contradicted,
            }
            for g in given
        ],
        "damage": [
            {
                "kind": d.kind,
                "position_m": np.asarray(d.position_m).tolist(),
                "size_m": d.size_m,
                "depth_m": d.depth_m,
                "std_m": d.std_m,
                "p_value": d.p_value,
            }
            for d in member.damage
        ],
    }


def hole_row(member: Member, hole: RoundHole) -> dict[str, Any]:
    """A round hole; `along_m` is how far along the member it is, from its first end."""
    T = np.asarray(member.T_world_member)
    return {
        "face": hole.face,
        "radius_m": hole.radius_m,
        "std_m": hole.std_m,
        "start_m": np.asarray(hole.start).tolist(),
        "through_m": np.asarray(hole.through).tolist(),
        "along_m": float((hole.start - T[:3, 3]) @ T[:3, 2]),
        "place_std_m": hole.place_std_m,
        "n_points": hole.n_points,
    }


def holed(member: Member) -> str:
    """The round holes of a member, for the verdict's line."""
    if not member.holes:
        return ""
    sizes = [2 * hole.radius_m * MILLIMETRES_PER_METRE for hole in member.holes]
    low, high = f"{min(sizes):.4g}", f"{max(sizes):.4g}"
    across = f"{low} mm" if low == high else f"{low} to {high} mm"
    return f"; with {len(sizes)} round hole{'s' * (len(sizes) > 1)} of {across}, which its beams, shells and closed forms do not have"


def changing(member: Member) -> str:
    """The dimension that changes along the member, for the verdict's line."""
    change = member.change
    if change is None:
        return ""
    sizes = " to ".join(f"{x * MILLIMETRES_PER_METRE:.4g}" for x in change.value_m)
    return f"; {change.dimension} changes along it, {sizes} mm: no beam theory is held against the solid, and there are no beams of it"


def damaged(member: Member) -> str:
    """Where the points leave the member by more than chance, for the verdict's line: its solid is whole there."""
    if not member.damage:
        return ""
    worst = max(member.damage, key=lambda d: abs(d.depth_m))
    places = f"{len(member.damage)} places" if len(member.damage) > 1 else "one place"
    return f"; at {places} the points leave it, by up to {abs(worst.depth_m) * MILLIMETRES_PER_METRE:.2g} mm ({worst.kind}): the solid is whole there"


def rooted(member: Member) -> str:
    """The root fillets, or of a tube the round corners, that the solid has though no dimension of the section says so, or that it may lack."""
    root, what = member.root, "outer corner radii" if member.family == TUBE else "root fillets"
    if root.radius_m:
        std = f" +- {root.std_m * MILLIMETRES_PER_METRE:.2g}" if root.std_m else ""
        whence = {"fixed": " as given", "assumed": " (assumed)"}.get(root.source, "")
        sloping = f", flanges of slope {100 * root.slope:.2g} %, tf in their middle" if root.slope else ""
        return f"; with {what} of {root.radius_m * MILLIMETRES_PER_METRE:.4g}{std} mm{whence}{sloping}"
    if member.family not in (*OPEN, TUBE) or root.is_observable or root.source == "fixed":
        return ""
    most = f"; they have at most {root.most_m * MILLIMETRES_PER_METRE:.2g} mm" if math.isfinite(root.most_m) else ""
    return f"; {what} are not observable, built with sharp corners{most}"


def change_row(member: Member) -> dict[str, Any] | None:
    """The dimension that changes along the axis, at its knots."""
    change = member.change
    if change is None:
        return None
    return {
        "kind": change.kind,
        "dimension": change.dimension,
        "z_m": np.asarray(change.z_m).tolist(),
        "value_m": np.asarray(change.value_m).tolist(),
        "std_m": np.asarray(change.std_m).tolist(),
        "side": change.side,
    }
