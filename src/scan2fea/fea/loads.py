"""Supports and loads as a person writes them, by the names of CAD faces; and the nodal forces that they mean.

    fea.supports = ["END_FIRST", "2/FOOT z"]                       set, or object/set, and the directions held (all without)
    fea.loads    = ["END_LAST force 0 0 -100", "wind: 2/WEB pressure 1500", "END_LAST moment 0 0 25", "ALL gravity 0 0 -9.81"]

Numbers are SI. Loads of one name (before the colon) act together; those without are the case "load".
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import SolveError, UsageError, require
from scan2fea.fea.assemble import System
from scan2fea.fea.surfaces import spread_force, spread_moment, spread_pressure, surface
from scan2fea.types import FEModel, FloatArray, IntArray, Load, LoadCase, Value

FLOATING = "none"  # the only entry of fea.supports: the body floats
KINDS: Mapping[str, int] = {"force": 3, "moment": 3, "pressure": 1, "gravity": 3}  # how many numbers follow
_SUPPORT = re.compile(r"^(?:(\d+)\s*/\s*)?([A-Za-z]\w*)(?:\s+([xyz]{1,3}))?$")
_LOAD = re.compile(r"^(?:([A-Za-z]\w*)\s*:\s*)?(?:(\d+)\s*/\s*)?([A-Za-z]\w*)\s+([a-z]+)\s+(.+)$")
_ZERO = 1e-12  # of the area: a surface whose normals cancel carries no even pressure, but an area of nothing carries nothing


@dataclass(frozen=True, kw_only=True)
class SupportLine(Value):
    """number : of the object it is for, None for all.   directions : of "xyz"."""

    number: int | None
    set_name: str
    directions: str


@dataclass(frozen=True, eq=False, kw_only=True)
class LoadLine(Value):
    """number : of the object it is for, None for all."""

    number: int | None
    case: str
    load: Load


def parse_supports(lines: Sequence[str]) -> tuple[SupportLine, ...] | None:
    """The lines of fea.supports; None where the body floats. Raises UsageError that quotes the line."""
    if [line.strip().lower() for line in lines] == [FLOATING]:
        return None
    out = []
    for line in lines:
        found = _SUPPORT.match(line.strip())
        if found is None or found[2].lower() == FLOATING:
            raise UsageError(f'fea.supports: {line!r} is not "[object/]SET [directions of xyz]", such as "END_FIRST" or "2/FOOT_01 z"; alone: "none"')
        directions = "".join(sorted(set(found[3] or "xyz")))
        out.append(SupportLine(number=int(found[1]) if found[1] else None, set_name=found[2].upper(), directions=directions))
    return tuple(out)


def parse_loads(lines: Sequence[str]) -> tuple[LoadLine, ...]:
    """The lines of fea.loads. Raises UsageError that quotes the line."""
    return tuple(_load_line(line) for line in lines)


def _load_line(line: str) -> LoadLine:
    says = f'fea.loads: {line!r} is not "[case:] [object/]SET force|moment|gravity X Y Z" or "... pressure P" (SI), such as "END_LAST force 0 0 -100"'
    found = _LOAD.match(line.strip())
    if found is None:
        raise UsageError(says)
    case, number, name, kind, rest = found.groups()
    near = difflib.get_close_matches(kind, KINDS, n=1)
    require(kind in KINDS, UsageError, f"{says}; {kind!r} is no load" + (f", did you mean {near[0]}?" if near else ""))
    try:
        values = [float(word) for word in rest.split()]
    except ValueError as error:
        raise UsageError(f"{says}: {error}") from error
    require(len(values) == KINDS[kind] and np.isfinite(values).all(), UsageError, f"{says}: {kind} takes {KINDS[kind]} finite numbers")
    require(any(values), UsageError, f"fea.loads: {line!r} loads nothing: its numbers are all zero")
    vector = np.array([*values, 0.0, 0.0][:3])
    return LoadLine(number=int(number) if number else None, case=(case or "load").lower(), load=Load(set_name=name.upper(), kind=kind, vector=vector))


def cases_of(lines: Iterable[LoadLine], number: int | None, known: Sequence[str]) -> tuple[tuple[LoadCase, ...], dict[str, str]]:
    """(cases of object `number` in the order of their first lines, why each of the others cannot be: a set that is not there)."""
    cases: dict[str, list[Load]] = {}
    failed: dict[str, str] = {}
    for line in lines:
        if line.number is None or line.number == number:
            loads = cases.setdefault(line.case, [])
            try:
                known_set("ALL" if line.load.kind == "gravity" else line.load.set_name, known, f"case {line.case}")
                loads.append(line.load)
            except SolveError as error:
                failed.setdefault(line.case, str(error))
    return tuple(LoadCase(name=name, loads=tuple(loads)) for name, loads in cases.items() if name not in failed), failed


def supports_of(lines: Iterable[SupportLine], number: int | None, known: Sequence[str]) -> dict[str, str]:
    """Set -> directions of object `number`. Raises SolveError for a set that is not there."""
    out: dict[str, str] = {}
    for line in lines:
        if line.number is None or line.number == number:
            known_set(line.set_name, known, "fea.supports")
            out[line.set_name] = "".join(sorted(set(out.get(line.set_name, "") + line.directions)))
    return out


def known_set(name: str, known: Sequence[str], where: str) -> None:
    """Raises SolveError that names the nearest set where `name` is none."""
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {near[0]}?" if near else ""
    listed = ", ".join(list(known)[:12]) + (", ..." if len(known) > 12 else "")
    require(name in known, SolveError, f"{where}: the model has no set {name}{hint} (it has {listed})")


def nodal_forces(model: FEModel, system: System, case: LoadCase) -> FloatArray:
    """(n, 3) consistent forces of a case, N. Raises SolveError for a load on an empty set."""
    return np.asarray(surface_forces(model, case) + np.asarray(system.mass_matrix().sum(axis=1))[:, None] * gravity_of(case))


def gravity_of(case: LoadCase) -> FloatArray:
    """(3,) m/s2, the sum of the loads on the whole body."""
    return np.asarray(np.sum([load.vector for load in case.loads if load.kind == "gravity"] or [np.zeros(3)], axis=0))


def surface_forces(model: FEModel, case: LoadCase) -> FloatArray:
    """(n, 3) consistent forces of the loads on faces, N. Raises SolveError for a load on an empty set."""
    n = len(model.mesh.nodes)
    total = np.zeros((n, 3))
    for load in case.loads:
        if load.kind == "gravity":
            continue
        on = surface(np.asarray(model.mesh.nodes), _triangles(model, load.set_name))
        require(on.area.sum() > 0, SolveError, f"the load on {load.set_name} has no area to act on")
        if load.kind == "force":
            traction = spread_force(on, load.vector)
        elif load.kind == "moment":
            traction = spread_moment(on, load.vector)
        else:
            traction = spread_pressure(on, float(load.vector[0]))
        total += on.nodal(traction, n)
    return total


def _triangles(model: FEModel, name: str) -> IntArray:
    rows = model.surfaces.get(name, np.zeros(0, np.int64))
    require(len(rows), SolveError, f"the load on {name} acts on nothing: the set has no faces of elements")
    return np.asarray(model.mesh.boundary[rows])
