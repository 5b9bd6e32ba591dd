"""`scan2fea fit`: the points of one file as one member. Exit 0 where it explains them, 4 where it does not.

A file that is no member may hold several: those that `run` would find in it are told too.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from scan2fea.cli.settings import config_of
from scan2fea.errors import EstimationError, require
from scan2fea.estimation.catalogue import outer_sizes
from scan2fea.estimation.given import SIGNIFICANT, Given
from scan2fea.pipeline.fit import FittedFile, FittedObject, fit_file, fit_objects, write_member
from scan2fea.pipeline.route import Estimate
from scan2fea.types import Bend, CatalogueEntry, Member, Parameter, RootFillet, RoundHole, SectionChange
from scan2fea.units import MILLIMETRES_PER_METRE

NOT_EXPLAINED = 4
SHOWN = 6  # lines of the catalogue and of the damage
SURE = 0.9995
LIKELY = 0.5  # more than all else together


def execute(given: argparse.Namespace) -> int:
    config, path = config_of(given), Path(given.file)
    fitted = fit_file(path, config)
    objects = () if fitted.found.explains else fit_objects(path, config)
    nothing = f"{path}: no member can be fitted: {fitted.found.reason}"
    require(fitted.member is not None or len(objects) > 0, EstimationError, nothing)
    print(given.file if fitted.member is not None else nothing)
    _print(fitted)
    _print_objects(objects)
    if given.out:
        write_member(Path(given.out), fitted, objects)
        print(f"\n  written: {given.out}")
    return 0 if fitted.found.explains else NOT_EXPLAINED


def _print(fitted: FittedFile) -> None:
    raw, found = fitted.raw, fitted.found
    print(f"  points        {len(raw.scan.cloud):,}, unit {raw.unit} ({raw.unit_source}), sensor position {raw.sensor}")
    if fitted.member is not None:
        _print_found(found, fitted.member)


def _print_objects(objects: Sequence[FittedObject]) -> None:
    if objects:
        print(f"\n  as one member it is not explained; {len(objects)} object{'s'[: len(objects) > 1]} found in it, each by itself:")
    for one in objects:
        print(f"\nobject {one.id}")
        print(f"  points        {one.n_points:,}")
        member = one.found.shown
        if member is None:
            print(f"  member        none: {one.found.reason}")
        else:
            _print_found(one.found, member)


def _print_found(found: Estimate, member: Member) -> None:
    print(f"  member        {member.family}, {'explains the points' if found.explains else 'does NOT explain the points'}: {found.reason}")
    if found.p_fixed is not None:
        print(f"  given sizes   p-value {found.p_fixed:.3g} {'(the points contradict them)' if found.p_fixed < 0.01 else ''}")
    for g in found.given:
        print(f"  {'held' if g.held else 'compared':<13} {_given(g)}")
    if found.likeliest is not None:
        print("  what follows is the likeliest section: how wide its faces are is how far the scan reaches")
    elif not found.explains:
        print("  what follows is the likeliest section of those that were tried, and not what these points are")
    print(f"\n  {'dimension':<12}{'value, mm':>12}{'std, mm':>10}  observable  from")
    for parameter in member.parameters:
        print(_line(parameter, is_told=parameter.observable and parameter.name not in found.untold))
    if member.root.radius_m or member.root.is_observable:
        print(_line(_root_row(member.root), is_told=member.root.is_observable))
    print()
    for key, text in _facts(member):
        print(f"  {key:<13} {text}")


def _given(g: Given) -> str:
    value = f"{g.name} = {g.value_m * MILLIMETRES_PER_METRE:.6g} mm"
    if g.measured_m is None or g.std_m is None or g.p_value is None:
        return f"{value}; the points do not tell it"
    measured = f"{g.measured_m * MILLIMETRES_PER_METRE:.6g} +- {g.std_m * MILLIMETRES_PER_METRE:.2g} mm"
    denied = "DENIED" if g.is_contradicted else "within mill tolerance" if g.p_value < SIGNIFICANT else "agreed"
    return f"{value}; the points say {measured}, p {g.p_value:.2g}: {denied}"


def _line(p: Parameter, *, is_told: bool) -> str:
    std = "-" if p.std_m is None else f"{p.std_m * MILLIMETRES_PER_METRE:.3g}"
    digits = 3 if p.std_m is None else max(0, min(6, 2 - int(f"{max(p.std_m * MILLIMETRES_PER_METRE, 1e-9):e}".split("e")[1])))
    sources = {"fitted": "the points", "fixed": "given", "catalogue": "the catalogue (assumed)", "estimate": "an estimate (assumed)"}
    off = "" if p.spread_m is None or p.observable else f", may be off by {p.spread_m * MILLIMETRES_PER_METRE:.2g} mm"
    is_likeliest = p.source == "fitted" and p.std_m is None and not is_told
    source = "likeliest" if is_likeliest else sources.get(p.source, p.source).replace("(assumed)", f"(assumed{off})")
    return f"  {p.name:<12}{p.value_m * MILLIMETRES_PER_METRE:>12.{digits}f}{std:>10}  {'yes' if is_told else 'NO':<10}  {source}"


def _root_row(root: RootFillet) -> Parameter:
    """The radius of the root fillets as the rows of dimensions have it."""
    std = root.std_m if root.std_m > 0 else None
    return Parameter(name="r (root)", value_m=root.radius_m, std_m=std, observable=root.is_observable, source=root.source)


def _facts(member: Member) -> list[tuple[str, str]]:
    noise = f"sigma {member.sigma_m * MILLIMETRES_PER_METRE:.3g} mm, {member.noise}"
    rows = [("noise", f"{noise}; {member.outlier_share:.1%} of the points belong to something else")]
    if member.root.slope:
        percent = f"{100 * member.root.slope:.3g} +- {100 * member.root.slope_std:.2g} %"
        rows.append(("flanges", f"slope by {percent}; tf is in the middle of what stands out"))
    rows.append(("axis", _axis(member)))
    rows += [("section", _change(member.change))] if member.change is not None else []
    rows += [("bends" if k == 0 else "", _bend(bend)) for k, bend in enumerate(member.bends)]
    rows += [("holes" if k == 0 else "", _hole(member, hole)) for k, hole in enumerate(member.holes)]
    families = sorted(member.families.items(), key=lambda item: -item[1])
    rows.append(("families", ", ".join(f"{name} {_probability(p)}" for name, p in families[:4] if p > 5e-4)))
    rows += [
        ("catalogue" if k == 0 else "", f"{_probability(e.probability):>6}  {_size(e, member.sigma_m)}")
        for k, e in enumerate(member.catalogue[:SHOWN])
    ]
    rows += _outer(member)
    unseen = [name for name, share in member.seen.items() if share <= 0]
    rows.append(("faces", f"{len(member.seen) - len(unseen)} of {len(member.seen)} seen" + (f"; not seen: {', '.join(unseen)}" if unseen else "")))
    if member.told_toes:
        rows.append(("", f"told by their mirror image: {', '.join(member.told_toes)}"))
    if member.reached:
        rows.append(("", f"told by where their neighbours stop: {', '.join(member.reached)}"))
    if member.inside == "unknown":
        rows.append(("inside", "solid or hollow: neither an inner face nor a cap was seen"))
    for k, d in enumerate(member.damage[:SHOWN]):
        at = ", ".join(f"{x:.3f}" for x in d.position_m)
        depth, std = d.depth_m * MILLIMETRES_PER_METRE, d.std_m * MILLIMETRES_PER_METRE
        told = f"{d.kind} at ({at}) m, {d.size_m * MILLIMETRES_PER_METRE:.0f} mm wide, {depth:.2g} +- {std:.2g} mm deep, p {d.p_value:.2g}"
        rows.append(("damage" if k == 0 else "", told))
    if not member.damage:
        rows.append(("damage", "none that is significant"))
    return rows


def _outer(member: Member) -> list[tuple[str, str]]:
    """Which outer dimensions the catalogue makes likely, where several of its sizes have them: those differ by walls alone."""
    if sum(entry.is_standard for entry in member.catalogue) < 2 or member.family == "rect":
        return []
    outer, share = outer_sizes(member.catalogue)[0]
    if share <= LIKELY:
        return []
    sides = " x ".join(f"{value * MILLIMETRES_PER_METRE:.4g}" for value in outer.values())
    return [("outer size", f"{_probability(share):>6}  {sides} mm of the catalogue, whatever the walls")]


def _size(entry: CatalogueEntry, sigma_m: float) -> str:
    """Its name, and how far off all faces would be together where that is more than half the noise."""
    if abs(entry.offset_m) <= 0.5 * sigma_m:
        return entry.name
    where = "outside" if entry.offset_m > 0 else "within"
    return f"{entry.name}, were all faces measured {abs(entry.offset_m) * MILLIMETRES_PER_METRE:.2g} mm {where} (sensor's zero, paint)"


def _change(change: SectionChange) -> str:
    places = ", ".join(
        f"{v * MILLIMETRES_PER_METRE:.4g} +- {s * MILLIMETRES_PER_METRE:.2g} mm at {z:.3f} m"
        for z, v, s in zip(change.z_m.tolist(), change.value_m.tolist(), change.std_m.tolist(), strict=True)
    )
    return f"{change.kind}: {change.dimension} is {places} from the first end"


def _bend(bend: Bend) -> str:
    radius, std = bend.radius_m * MILLIMETRES_PER_METRE, bend.radius_std_m * MILLIMETRES_PER_METRE
    turn = f"{math.degrees(bend.angle_rad):.2f} +- {math.degrees(bend.angle_std_rad):.2g} deg"
    return f"{turn}, radius of the axis {radius:.1f} +- {std:.2g} mm, {bend.start_m:.3f} m from the first end along the axis"


def _hole(member: Member, hole: RoundHole) -> str:
    across, std = 2 * hole.radius_m * MILLIMETRES_PER_METRE, 2 * hole.std_m * MILLIMETRES_PER_METRE
    along = float((hole.start - member.T_world_member[:3, 3]) @ member.T_world_member[:3, 2])
    return f"{across:.2f} +- {std:.2g} mm across, through {hole.face}, {along:.4f} m from the first end"


def _axis(member: Member) -> str:
    if member.bends:
        return f"{len(member.bends) + 1} straight runs; from ({', '.join(f'{x:.4f}' for x in member.T_world_member[:3, 3])}) m on"
    start, along = member.T_world_member[:3, 3], member.T_world_member[:3, 2]
    at, to = (", ".join(f"{x:.4f}" for x in v) for v in (start, start + along * member.values()["length"]))
    bent = float((member.bow**2).sum()) ** 0.5
    shape = f"bowed by {bent * MILLIMETRES_PER_METRE:.2g} mm (Legendre)" if bent > 0 else "straight"
    turned = f", twisted by {2 * member.twist[0] * 57.29578:.3g} deg" if len(member.twist) and member.twist[0] else ""
    return f"({at}) to ({to}) m, {shape}{turned}"


def _probability(p: float) -> str:
    return "> 99.9%" if SURE < p < 1 else f"{p:.1%}"
