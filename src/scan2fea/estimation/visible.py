"""Which faces of a section its sensors can see, itself in the way; and where no sensor is known, which sets of faces any sensors could have seen.

In the plane of the section a sensor is a point, or a direction where it stands far off. What it sees of a face is what no other face hides.
Sensors on one side of a member stand in an arc of directions around it, so without sensors the sets that are possible are those of the arcs:
some dozens for an I section, where every set of its twelve faces would be 4096. Fewer sets to choose from need less evidence to choose.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import EstimationError, UsageError, require
from scan2fea.estimation.face_weights import face_densities
from scan2fea.estimation.likelihood import SectionModel
from scan2fea.estimation.rays_of_member import inside_outline
from scan2fea.kernel.jit import jit
from scan2fea.kernel.section_likelihood import face_lengths, faces
from scan2fea.kernel.sections import PARAMETERS, ROUND, section
from scan2fea.types import BoolArray, FloatArray, Value

SAMPLES = 64  # places along each edge that are judged
N_DIRECTIONS = 72  # every 5 degrees
FLAT = math.sin(math.radians(10.0))  # a face seen at a flatter angle than 10 degrees gives no points worth counting
SEEN = 0.5  # of a face's length: less is not seen, where whole faces are told apart
FAR = 1e3  # sizes of the section at which a sensor is a direction


def seen_shares(family: str, values: Mapping[str, float], sensors: FloatArray) -> FloatArray:
    """(k, f) share of each face (order of `section_likelihood.faces`) that each sensor sees.

    sensors : (k, 2) metres in the frame of the section. Raises EstimationError for a sensor inside the section, UsageError for a bad section.
    """
    shape = section(family, values)
    sensors = np.asarray(sensors, float).reshape(-1, 2)
    inside = inside_outline(sensors, shape.loops[0])
    for hole in shape.loops[1:]:
        inside &= ~inside_outline(sensors, hole)
    if inside.any():
        at = sensors[inside][0]
        require(
            False, EstimationError, f"a sensor at ({at[0]:.4g}, {at[1]:.4g}) m in the section's frame lies inside the {family}: check its position"
        )
    start = np.concatenate(shape.loops)
    end = np.concatenate([np.roll(loop, -1, axis=0) for loop in shape.loops])
    names = [name for loop in shape.face_names for name in loop]
    along = (np.arange(SAMPLES) + 0.5) / SAMPLES
    places = start[:, None] + along[:, None] * (end - start)[:, None]  # (e, s, 2)
    edge = end - start
    length = np.linalg.norm(edge, axis=1)
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / length[:, None]
    order = faces(family)
    part = np.array([[length[i] if names[i] == name else 0.0 for i in range(len(names))] for name in order])
    part /= part.sum(axis=1, keepdims=True)
    shares = [part @ _sees(sensor, places, normal, start, edge).mean(axis=1) for sensor in sensors]
    return np.array(shares).reshape(len(sensors), len(order))


@jit
def _sees(sensor: FloatArray, places: FloatArray, normal: FloatArray, start: FloatArray, edge: FloatArray) -> BoolArray:
    """(e, s) True where a place on an edge is in the sensor's sight: it looks at the sensor, and no other edge crosses the line between them."""
    n_edges, n_places = places.shape[0], places.shape[1]
    seen = np.zeros((n_edges, n_places), np.bool_)
    for e in range(n_edges):
        for i in range(n_places):
            px, py = places[e, i, 0], places[e, i, 1]
            dx, dy = sensor[0] - px, sensor[1] - py
            if not dx * normal[e, 0] + dy * normal[e, 1] > FLAT * math.sqrt(dx * dx + dy * dy):
                continue
            is_seen = True
            for other in range(n_edges):
                cross = dx * edge[other, 1] - dy * edge[other, 0]
                if other == e or cross == 0:
                    continue
                wx, wy = start[other, 0] - px, start[other, 1] - py
                t = (wx * edge[other, 1] - wy * edge[other, 0]) / cross
                k = (wx * dy - wy * dx) / cross
                if 0 < t < 1 and 0 <= k <= 1:
                    is_seen = False
                    break
            seen[e, i] = is_seen
    return seen


def visible_sets(family: str, values: Mapping[str, float], sensors: FloatArray | None = None) -> tuple[tuple[str, ...], ...]:
    """Sets of faces that can have been seen, each in the order of `faces`, larger ones first; the whole outline (without holes) is always one.

    With sensors (k, 2), in the frame of the section: the one set they see together. Without: one set for every arc of directions, each also
    without the faces that lie in a plane on which the member rests or against which it stands.
    Of a round section it is the outside, all of it: an arc of it fixes the circle.
    """
    order = faces(family)
    if family in ROUND:
        return ((order[0],),)
    if sensors is not None:
        shares = seen_shares(family, values, sensors).max(axis=0)
        return (tuple(name for name, share in zip(order, shares, strict=True) if share >= SEEN),)
    angle = 2 * np.pi * (np.arange(N_DIRECTIONS) + 0.5) / N_DIRECTIONS
    size = max(values[name] for name in PARAMETERS[family])
    seen = seen_shares(family, values, FAR * size * np.stack([np.cos(angle), np.sin(angle)], axis=1)) >= SEEN
    bit = 1 << np.arange(len(order))
    each = seen @ bit  # the faces of every direction as a number
    arcs = np.zeros(N_DIRECTIONS, np.int64)
    found = {int(np.bitwise_or.reduce(each))}
    for step in range(N_DIRECTIONS):  # arcs from every direction, all longer by one
        arcs = arcs | np.roll(each, -step)
        found.update(arcs.tolist())
    covered = [int(mask @ bit) for mask in _against_planes(family, values, order)]
    found |= {one & ~mask for one in found for mask in covered}
    sets = [tuple(name for name, own in zip(order, bit.tolist(), strict=True) if one & own) for one in found if one]
    return tuple(sorted(sets, key=lambda one: (-len(one), one)))


def _against_planes(family: str, values: Mapping[str, float], order: tuple[str, ...]) -> list[BoolArray]:
    """(f,) masks: the faces that lie in one plane with all of the section on its other side, for the four planes along its axes."""
    shape = section(family, values)
    loop = shape.loops[0]
    after = np.roll(loop, -1, axis=0)
    tiny = 1e-9 * float(np.ptp(loop))
    masks = []
    for axis in (0, 1):
        for level in (loop[:, axis].min(), loop[:, axis].max()):
            flat = (np.abs(loop[:, axis] - level) < tiny) & (np.abs(after[:, axis] - level) < tiny)
            names = {name for name, lies in zip(shape.face_names[0], flat, strict=True) if lies}
            masks.append(np.array([name in names for name in order]))
    return [mask for mask in masks if mask.any()]


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenSet(Value):
    """faces : the likeliest set.   weight : (f,) points per metre, 1 or 0.   probability : of that set among those possible.

    bic : of every set, in their order.
    """

    faces: tuple[str, ...]
    weight: FloatArray
    probability: float
    bic: FloatArray


def likeliest_set(model: SectionModel, theta: FloatArray, sets: Sequence[tuple[str, ...]]) -> SeenSet:
    """The set of faces that explains the points of a fitted section, all its faces alike; the choice among n sets costs 2 log n.

    Raises UsageError without a set, or with an empty one.
    """
    require(len(sets) > 0 and all(sets), UsageError, "there is no set of faces to choose from: name at least one, none of them empty")
    order = faces(model.layout.family)
    length = face_lengths(model.layout.family, model.layout.values(theta))
    density = face_densities(model, theta)
    eps = model.layout.outlier_share(theta)
    bic = np.zeros(len(sets))
    for i, one in enumerate(sets):
        share = np.where([name in one for name in order], length, 0.0)
        p = (1 - eps) * density @ (share / share.sum()) + eps / model.area_m2
        bic[i] = -2 * float(np.log(p).sum()) + 2 * math.log(len(sets))
    best = int(np.argmin(bic))
    odds = np.exp(-0.5 * (bic - bic[best]))
    weight = np.where([name in sets[best] for name in order], 1.0, 0.0)
    return SeenSet(faces=tuple(sets[best]), weight=weight, probability=float(1 / odds.sum()), bic=bic)


def flux_weights(family: str, values: Mapping[str, float], sensors: FloatArray) -> FloatArray:
    """(f,) points per metre of each face, relative to the densest, if every sensor (k, 2) shoots evenly in angle: share seen, cosine, distance."""
    shape = section(family, values)
    shares = seen_shares(family, values, sensors)
    order = faces(family)
    total = np.zeros((len(np.atleast_2d(sensors)), len(order)))
    length = np.zeros(len(order))
    for loop, names in zip(shape.loops, shape.face_names, strict=True):
        for p, q, name in zip(loop, np.roll(loop, -1, axis=0), names, strict=True):
            i = order.index(name)
            to = np.asarray(sensors, float).reshape(-1, 2) - (p + q) / 2
            edge = q - p
            across = (to @ np.array([edge[1], -edge[0]])).clip(min=0.0)
            total[:, i] += across / np.einsum("kc,kc->k", to, to)
            length[i] += float(np.hypot(*edge))
    weight = (shares * total).sum(axis=0) / length
    return np.asarray(weight / max(float(weight.max()), 1e-300))
