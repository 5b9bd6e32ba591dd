"""The only place where a kind of object becomes a shape: one line per kind, read by scene files, the docs and the lab."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from scan2fea.kernel.sections import PARAMETERS
from scan2fea.simulation import freeform, parts
from scan2fea.simulation.members import member, member_parameters
from scan2fea.simulation.solids import Shape


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of object. lengths : dimensions that must be given.   maybe : lengths that may be.   counts, numbers : further keys with their defaults.

    has_holes : takes `holes`.   build : dimensions by name (lengths in metres, numbers as they are, holes), chord tolerance -> shape.
    """

    doc: str
    lengths: tuple[str, ...]
    build: Callable[[Mapping[str, Any], float], Shape]
    maybe: tuple[str, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)
    has_holes: bool = False


def _member_kind(family: str, doc: str) -> Kind:
    lengths, maybe = member_parameters(family)
    return Kind(doc=doc, lengths=lengths, maybe=maybe, build=lambda v, chord: member(family, v, chord))


_MEMBERS = {
    "L": "angle, leg a along x, leg b along y",
    "I": "I or H section, web along y",
    "C": "channel, open towards x",
    "T": "tee, flange on top",
    "RHS": "rectangular tube, h along y",
    "CHS": "round tube",
    "rect": "flat bar or plate, b along x, t along y",
    "round": "round bar",
}

KINDS: Mapping[str, Kind] = {
    **{family: _member_kind(family, _MEMBERS[family]) for family in PARAMETERS},
    "plate": _member_kind("rect", "flat plate: b along x, t along y, length along z"),
    "box": Kind(doc="block from the origin", lengths=("x", "y", "z"), build=lambda v, chord: parts.box(v["x"], v["y"], v["z"])),
    "cylinder": Kind(doc="drum about z", lengths=("d", "length"), build=lambda v, chord: parts.cylinder(v["d"] / 2, v["length"], chord)),
    "sphere": Kind(doc="ball about the origin", lengths=("d",), build=lambda v, chord: freeform.sphere(v["d"] / 2, chord)),
    "blob": Kind(
        doc="smooth body of mean radius d / 2, its bumps drawn from `shape_seed`, their height wave times the radius",
        lengths=("d",), counts={"shape_seed": 0}, numbers={"wave": 0.2},
        build=lambda v, chord: freeform.blob(v["d"] / 2, v["wave"], v["shape_seed"], chord),
    ),
    "bracket": Kind(
        doc="angle plate, leg a along y, b along x, width along z, with round holes", lengths=("a", "b", "t", "width"), has_holes=True,
        build=lambda v, chord: parts.bracket(v["a"], v["b"], v["t"], v["width"], v["holes"], chord),
    ),
    "tank": Kind(
        doc="open vessel about z on a 2:1 bottom", lengths=("d", "height", "t"),
        build=lambda v, chord: parts.tank(v["d"] / 2, v["height"], v["t"], chord),
    ),
    "vessel": Kind(doc="solid drum with 2:1 heads", lengths=("d", "length"), build=lambda v, chord: parts.vessel(v["d"] / 2, v["length"], chord)),
    "girder": Kind(
        doc="welded I along z with pairs of stiffeners ts thick and bs wide", lengths=("h", "b", "tw", "tf", "length", "ts", "bs"),
        counts={"n_stiffeners": 2},
        build=lambda v, chord: parts.girder(v["h"], v["b"], v["tw"], v["tf"], v["length"], v["ts"], v["bs"], v["n_stiffeners"]),
    ),
    "table": Kind(
        doc="a top on four legs", lengths=("x", "y", "height", "top", "leg", "inset"),
        build=lambda v, chord: parts.table(v["x"], v["y"], v["height"], v["top"], v["leg"], v["inset"]),
    ),
}  # fmt: skip
