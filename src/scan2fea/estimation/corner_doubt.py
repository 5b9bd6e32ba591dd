"""How much less sure the dimensions of a member are by what its points leave open of its rounded corners."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from scan2fea.estimation.root_fillet import FILLET, OF_SIDE, OF_TOE, OPEN, TOE_OF_ROOT, TUBE, WALLS
from scan2fea.types import FloatArray, Member

_OF_TUBE = 2.5  # walls: corners of tubes up to 10 mm thick are calculated with up to as many (EN 10219-2)
_OF_ROOT = 1.5  # of the thickest wall: hardly a rolled root is rounder (EN 10365, EN 10056-1)
_HIDDEN = 1 / math.sqrt(5)  # root mean square of the square of a radius, any up to the largest being as likely, in squares of that


def with_corners(member: Member, sharp: Member) -> Member:
    """The member, of a tube h, b and t less sure by what its corner radius is: arcs taken for too small leave points behind the faces.

    A radius larger by d takes 2 FILLET r d from each corner of a skin, a half of that from each face beside it, whose mean place this shifts.
    A section with round toes is less sure by as much of what these have moved it from the `sharp` one as their radius is not known.
    """
    if member.root.toe_m:
        before, share = sharp.values(), member.root.toe_std_m / member.root.toe_m
        return _widened(member, share * np.array([p.value_m - before[p.name] if p.std_m else 0.0 for p in member.parameters]))
    if member.family != TUBE or not member.root.std_m:
        return member
    values, r = member.values(), member.root.radius_m
    h, b, t = values["h"], values["b"], values["t"]
    between = r - max(r - t, 0.0)
    by = {"h": 4 * FILLET * r / b, "b": 4 * FILLET * r / h, "t": 4 * FILLET * between / (h + b)}
    return _by_name(member, {name: member.root.std_m * slope for name, slope in by.items()})


def with_hidden_corners(member: Member) -> Member:
    """The member built with sharp corners, less sure by how far rounds up to the largest that its points allow would have moved its faces.

    Those of roots thicken the walls beside them; toes of an angle, half as round (EN 10056-1), shorten its legs; a tube has all corners round.
    """
    if member.change is not None or member.family not in (*OPEN, TUBE):
        return member
    values, most = member.values(), member.root.most_m
    walls = {name: values[name] for name in WALLS if name in values}
    if member.family == TUBE:
        h, b, t = values["h"], values["b"], values["t"]
        outer = min(most, _OF_TUBE * t, OF_SIDE * min(h, b))
        between = outer**2 - max(outer - t, 0.0) ** 2
        by = {"h": 2 * outer**2 / b, "b": 2 * outer**2 / h, "t": 2 * between / (h + b)}
    else:
        squared = min(most, _OF_ROOT * max(walls.values())) ** 2
        by = {name: n * squared / length for name, (n, length) in _beside_roots(member.family, values).items()}
    if member.family == "L":
        by |= dict.fromkeys("ab", min(TOE_OF_ROOT["L"] * most, OF_TOE * values["t"]) ** 2 / values["t"])
    return _by_name(member, {name: _HIDDEN * FILLET * moved for name, moved in by.items()})


def _beside_roots(family: str, values: Mapping[str, float]) -> Mapping[str, tuple[float, float]]:
    """Wall -> how many fillets thicken it on its faces, halves of each going to two walls, and the length over which they do, metres."""
    if family == "L":
        return {"t": (1.0, values["a"] + values["b"] - 2 * values["t"])}
    flange, web = values["b"] - values["tw"], values["h"] - values["tf"] - (values["tf"] if family in ("I", "C") else 0.0)
    on_web, on_flange = {"I": (2.0, 1.0), "C": (1.0, 0.5), "T": (1.0, 1.0)}[family]
    return {"tw": (on_web, web), "tf": (on_flange, flange)}


def _by_name(member: Member, by: Mapping[str, float]) -> Member:
    return _widened(member, np.array([by.get(p.name, 0.0) if p.std_m else 0.0 for p in member.parameters]))


def _widened(member: Member, slope: FloatArray) -> Member:
    """slope : (k,) by how much one standard deviation of what is not known moves each parameter, metres."""
    parameters = tuple(replace(p, std_m=math.hypot(p.std_m, float(x)) if p.std_m else p.std_m) for p, x in zip(member.parameters, slope, strict=True))
    return replace(member, parameters=parameters, covariance=member.covariance + np.outer(slope, slope))
