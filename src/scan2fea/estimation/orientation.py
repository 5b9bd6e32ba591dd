"""Which side of the planes that were seen is steel: two planes that meet may be the outside of an angle or the inside of one.

The points alone cannot tell a sheet seen from one side from the sheet that lies on its other side. A sensor can: it stands outside, so every
face that it sees looks at it. Here the placements of a section that put other faces on the same planes are listed, and the one whose faces
look at the sensors is chosen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import EstimationError, require
from scan2fea.kernel.sections import section
from scan2fea.types import FloatArray, Value

SPREADS = 4.0  # median distances from the outline (2.7 sigma) within which a point is of a face
ROUNDING = 1e-9  # of the section's size
TELLING = 0.75  # share of the points that must look at their sensors; a placement with the steel on the wrong side has about none


@dataclass(frozen=True, eq=False, kw_only=True)
class Placement(Value):
    """A section in the plane: values (m), T_plane_section (3, 3) rigid, the share of points near a face that looks at
    their sensor, and the rms distance (m) from such faces.
    """

    values: Mapping[str, float]
    T_plane_section: FloatArray
    facing: float
    rms_m: float


def oriented(family: str, values: Mapping[str, float], T_plane_section: FloatArray, points: FloatArray, sensors: FloatArray) -> tuple[Placement, ...]:
    """The placement and its alternatives, best first: those whose faces look at the sensors, by how near the points lie to such faces.

    points : (n, 2) in the plane of the section.   sensors : (n, 2) where each was seen from, nan where not known.
    Raises EstimationError where no sensor is known, or where no placement has its faces towards the sensors.
    """
    known = np.isfinite(sensors).all(axis=1)
    require(known.any(), EstimationError, "no sensor position is known: convex and concave cannot be told apart; state where the sensor stood")
    points, sensors = points[known], sensors[known]
    placed = alternatives(family, values, T_plane_section)
    gaps = [_gaps(family, v, T, points, sensors) for v, T in placed]
    size = max(values.values())
    near = SPREADS * min(float(np.median(own)) for own, _ in gaps) + ROUNDING * size
    judged = []
    for (v, T), (_, seen) in zip(placed, gaps, strict=True):
        rms = float(np.sqrt(np.mean(np.square(np.minimum(seen, size)))))
        judged.append(Placement(values=v, T_plane_section=T, facing=float((seen <= near).mean()), rms_m=rms))
    judged.sort(key=lambda one: (one.facing < TELLING, one.rms_m))
    best = judged[0].facing
    says = (
        f"only {best:.0%} of the points lie on faces of the {family} that look at their sensors (at least {TELLING:.0%}): check the sensor positions"
    )
    require(best >= TELLING, EstimationError, says)
    return tuple(judged)


def alternatives(family: str, values: Mapping[str, float], T_plane_section: FloatArray) -> list[tuple[dict[str, float], FloatArray]]:
    """The placement itself first, then those that put the steel on the other side of planes that the first one has.

    L: its outer planes may be inner ones and the other way round. Flat bar: it may lie beyond either wide side. I, C, T, closed and round
    sections have faces on both sides of every plane, or no other side: they have no alternative.
    """
    v = {name: float(value) for name, value in values.items()}
    own = (v, np.asarray(T_plane_section, float))
    if family == "L":
        t = v["t"]
        out = [own]
        grown = {**v, "a": v["a"] + t, "b": v["b"] + t}
        out.append((grown, own[1] @ _shift(-t, -t)))  # the outer planes become the inner ones
        if min(v["a"], v["b"]) > 2 * t:
            out.append(({**v, "a": v["a"] - t, "b": v["b"] - t}, own[1] @ _shift(t, t)))  # the inner planes become the outer ones
        return out
    if family == "rect":
        return [own, (v, own[1] @ _shift(0.0, v["t"])), (v, own[1] @ _shift(0.0, -v["t"]))]
    return [own]


def _shift(x: float, y: float) -> FloatArray:
    T = np.eye(3)
    T[:2, 2] = x, y
    return T


def _gaps(family: str, values: Mapping[str, float], T: FloatArray, points: FloatArray, sensors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) distance of each point from the outline, and (n,) from that of its faces which the point's sensor stands before; inf without one."""
    shape = section(family, values)
    start = np.concatenate(shape.loops)
    edge = np.concatenate([np.roll(loop, -1, axis=0) for loop in shape.loops]) - start
    length = np.linalg.norm(edge, axis=1)
    back = np.linalg.inv(T)
    p, s = points @ back[:2, :2].T + back[:2, 2], sensors @ back[:2, :2].T + back[:2, 2]
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / length[:, None]
    before = np.einsum("nec,ec->ne", s[:, None] - start[None], normal) > ROUNDING * float(length.max())
    w = p[:, None] - start[None]
    along = np.clip(np.einsum("nec,ec->ne", w, edge) / length**2, 0, 1)
    gap = np.linalg.norm(w - along[..., None] * edge[None], axis=2)
    return gap.min(axis=1), np.where(before, gap, np.inf).min(axis=1)
