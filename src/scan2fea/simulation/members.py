"""Prismatic members as exact solids: the sections of `kernel.sections` swept along z, with root fillets where a rolled section has them.

Frame: that of the section in x and y, from z = 0 to the length. Fillets and circles are polygons with their corners on the true circle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from scan2fea.errors import InputError, UsageError, require
from scan2fea.kernel.construction import Swept
from scan2fea.kernel.sections import PARAMETERS, ROUND, check_section, chords_of, section
from scan2fea.simulation.closed_forms import Moments, block, rod, spandrel, together, without
from scan2fea.simulation.polyhedra import meshed, prism
from scan2fea.simulation.solids import Probe, Shape
from scan2fea.types import FloatArray

FILLETED = ("L", "I", "C", "T")  # families of rolled sections with root fillets
PROBE_STATIONS = np.linspace(0.08, 0.92, 9)  # shares of the length at which a dimension is measured again


def member(family: str, parameters: Mapping[str, float], chord_m: float) -> Shape:
    """The member of a family with its section's dimensions, `length`, and `fillet` (root radius, 0 for sharp corners).

    chord_m : largest distance of a chord from its circle. Raises InputError for dimensions that make no section, or a fillet that does not fit.
    """
    values = dict(parameters)
    length, fillet = values.pop("length"), values.pop("fillet", 0.0)
    try:
        check_section(family, values)
    except UsageError as error:
        raise InputError(str(error)) from error
    require(math.isfinite(length) and length > 0, InputError, f"section {family}: length is {length} m; it must be positive")
    loops = _loops(family, values, chord_m)
    exact = _members_moments(family, values, length)
    n_faces = 2 + (len(loops) if family in ROUND else sum(len(loop) for loop in loops))
    if fillet:
        corners = _roots(family, values, fillet)
        loops = (_rounded(loops[0], fillet, chord_m),)
        exact = _with_fillets(exact, corners, fillet, length)
        n_faces += len(corners)
    curved = chord_m if fillet or family in ROUND else 0.0
    named = {**values, "length": length, **({"fillet": fillet} if fillet else {})}
    return Shape(
        kind=family, family=family, parameters=named, mesh=meshed(prism(loops[0], length, loops[1:])), exact=exact, chord_m=curved, section=loops,
        n_cad_faces=n_faces, probes=_probes(family, values, length),
        base=Swept(family=family, values=values, fillet_m=fillet, length_m=length),
    )  # fmt: skip


def _loops(family: str, values: Mapping[str, float], chord_m: float) -> tuple[FloatArray, ...]:
    n_chords = chords_of(values["d"] / 2, chord_m) if family in ROUND else 96
    return section(family, values, n_chords).loops


def _members_moments(family: str, values: Mapping[str, float], length: float) -> Moments:
    """Sums of blocks and rods, from the dimensions alone."""
    v = dict(values)

    def plate(x0: float, y0: float, x1: float, y1: float) -> Moments:
        return block((x0, y0, 0.0), (x1, y1, length))

    if family in ROUND:
        outer = rod(v["d"] / 2, length)
        if family == "round":
            return outer
        inner = rod(v["d"] / 2 - v["t"], length)
        whole = without(outer, inner)
        return whole.with_area(2 * whole.volume_m3 / length + math.pi * (2 * v["d"] - 2 * v["t"]) * length)
    if family == "L":
        parts, perimeter = (plate(0, 0, v["a"], v["t"]), plate(0, v["t"], v["t"], v["b"])), 2 * (v["a"] + v["b"])
    elif family == "T":
        h, b, tw, tf = (v[k] for k in ("h", "b", "tw", "tf"))
        parts, perimeter = (plate(-b / 2, -tf, b / 2, 0), plate(-tw / 2, -h, tw / 2, -tf)), 2 * (b + h)
    elif family in ("I", "C"):
        h, b, tw, tf = (v[k] for k in ("h", "b", "tw", "tf"))
        x0, x1 = (-b / 2, b / 2) if family == "I" else (0.0, b)
        w0, w1 = (-tw / 2, tw / 2) if family == "I" else (0.0, tw)
        flanges = plate(x0, -h / 2, x1, -h / 2 + tf), plate(x0, h / 2 - tf, x1, h / 2)
        parts, perimeter = (*flanges, plate(w0, -h / 2 + tf, w1, h / 2 - tf)), 2 * h + 4 * b - 2 * tw  # type: ignore[assignment]
    elif family == "RHS":
        h, b, t = v["h"], v["b"], v["t"]
        hollow = without(plate(-b / 2, -h / 2, b / 2, h / 2), plate(t - b / 2, t - h / 2, b / 2 - t, h / 2 - t))
        parts, perimeter = (hollow,), 4 * (h + b) - 8 * t  # type: ignore[assignment]
    else:
        parts, perimeter = (plate(-v["b"] / 2, -v["t"] / 2, v["b"] / 2, v["t"] / 2),), 2 * (v["b"] + v["t"])  # type: ignore[assignment]
    whole = together(*parts)
    return whole.with_area(2 * whole.volume_m3 / length + perimeter * length)


def _roots(family: str, values: Mapping[str, float], radius: float) -> list[tuple[tuple[float, float], tuple[int, int]]]:
    """The re-entrant corners and the quadrant of air at each. Raises InputError where a fillet of this radius does not fit."""
    require(family in FILLETED, InputError, f"section {family} has no root fillet: leave `fillet` out")
    require(math.isfinite(radius) and radius > 0, InputError, f"section {family}: fillet is {radius} m; it must be positive")
    v = values
    if family == "L":
        room = min(v["a"], v["b"]) - v["t"]
        roots = [((v["t"], v["t"]), (1, 1))]
    elif family == "T":
        room = min((v["b"] - v["tw"]) / 2, v["h"] - v["tf"])
        roots = [((s * v["tw"] / 2, -v["tf"]), (s, -1)) for s in (-1, 1)]
    else:
        inner = v["h"] / 2 - v["tf"]
        room = min(inner, (v["b"] - v["tw"]) / 2 if family == "I" else v["b"] - v["tw"])
        sides = ((1, v["tw"] / 2), (-1, -v["tw"] / 2)) if family == "I" else ((1, v["tw"]),)
        roots = [((x, s * inner), (side, -s)) for side, x in sides for s in (-1, 1)]
    require(radius < room, InputError, f"section {family}: fillet is {radius} m; it must be less than {room:.6g} m, the room beside the web")
    return roots


def _with_fillets(exact: Moments, roots: list[tuple[tuple[float, float], tuple[int, int]]], radius: float, length: float) -> Moments:
    """Each root gains a spandrel: its ends add area, and an arc of pi r / 2 stands for two edges of r."""
    whole = together(exact, *(spandrel(corner, towards, radius, length) for corner, towards in roots))
    ends = 2 * (1 - math.pi / 4) * radius**2
    return whole.with_area(exact.area_m2 + len(roots) * (ends + (math.pi / 2 - 2) * radius * length))


def _rounded(loop: FloatArray, radius: float, chord_m: float) -> FloatArray:
    """The outline with each re-entrant corner replaced by an arc."""
    n = chords_of(radius, chord_m) // 4
    angle = np.linspace(0, np.pi / 2, n + 1)
    out: list[FloatArray] = []
    for k, corner in enumerate(loop):
        before, after = loop[k - 1] - corner, loop[(k + 1) % len(loop)] - corner
        if before[0] * after[1] - before[1] * after[0] < 0:  # the outline turns left at a convex corner, and there this is positive
            out.append(corner[None])
            continue
        p, q = before / np.linalg.norm(before), after / np.linalg.norm(after)
        centre = corner + radius * (p + q)
        out.append(centre - radius * (np.cos(angle)[:, None] * q + np.sin(angle)[:, None] * p))
    return np.concatenate(out)


def _probes(family: str, values: Mapping[str, float], length: float) -> tuple[Probe, ...]:
    """Each dimension on nine lines along the member, and the length along the middle of each wall."""
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    v = dict(values)
    lines: list[tuple[str, float, float, FloatArray]] = []  # name, middle in the section, direction
    if family == "L":
        a, b, t = v["a"], v["b"], v["t"]
        lines = [("a", a / 2, t / 2, x), ("b", t / 2, b / 2, y), ("t", (a + t) / 2, t / 2, y), ("t", t / 2, (b + t) / 2, x)]
    elif family in ("I", "C"):
        h, b, tw, tf = (v[k] for k in ("h", "b", "tw", "tf"))
        web = 0.0 if family == "I" else tw / 2
        middle = 0.0 if family == "I" else b / 2
        outer = [-(b + tw) / 4, (b + tw) / 4] if family == "I" else [(b + tw) / 2]
        at = (h - tf) / 2
        lines = [("h", web, 0.0, y), ("tw", web, 0.0, x), ("b", middle, -at, x), ("b", middle, at, x)]
        lines += [("tf", u, s * at, y) for u in outer for s in (-1, 1)]
    elif family == "T":
        h, b, tw, tf = (v[k] for k in ("h", "b", "tw", "tf"))
        lines = [("h", 0.0, -h / 2, y), ("tw", 0.0, -(h + tf) / 2, x), ("b", 0.0, -tf / 2, x)]
        lines += [("tf", s * (b + tw) / 4, -tf / 2, y) for s in (-1, 1)]
    elif family == "RHS":
        h, b, t = v["h"], v["b"], v["t"]
        lines = [("h", (b - t) / 2, 0.0, y), ("b", 0.0, (h - t) / 2, x)]
        lines += [("t", s * (b - t) / 2, 0.0, x) for s in (-1, 1)] + [("t", 0.0, s * (h - t) / 2, y) for s in (-1, 1)]
    elif family == "CHS":
        r = (v["d"] - v["t"]) / 2
        lines = [("t", s * r, 0.0, x) for s in (-1, 1)] + [("t", 0.0, s * r, y) for s in (-1, 1)]
    elif family == "round":
        lines = [("d", 0.0, 0.0, x), ("d", 0.0, 0.0, y)]
    else:
        lines = [("b", 0.0, 0.0, x), ("t", v["b"] / 4, 0.0, y), ("t", -v["b"] / 4, 0.0, y)]
    probes = [
        Probe(name=name, middle=np.array([p, q, share * length]), direction=direction, size_m=v[name])
        for name, p, q, direction in lines
        for share in PROBE_STATIONS
    ]
    if family == "CHS":  # the whole diameter runs through the hollow: outermost to outermost
        probes += [Probe(name="d*", middle=np.array([0, 0, s * length]), direction=d, size_m=v["d"]) for d in (x, y) for s in PROBE_STATIONS]
    along = {(p, q) for name, p, q, _ in lines if family != "RHS" or name == "t"}
    z = np.array([0.0, 0.0, 1.0])
    return (*probes, *(Probe(name="length", middle=np.array([p, q, length / 2]), direction=z, size_m=length) for p, q in sorted(along)))


def member_parameters(family: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the dimensions that must be given, and of those that may be."""
    return (*PARAMETERS[family], "length"), (("fillet",) if family in FILLETED else ())
