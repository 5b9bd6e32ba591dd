"""Holes of a member: empty places enclosed in a face that was seen all around. (What lies open to the rim of a face may simply be hidden.)

Where another body lies on the face (the leg of a bracket, the end of a beam on its column) nobody can see whether there is a hole: such a place is
none. It lies there if it comes as near to the face as its own points lie apart, over the whole of the empty place, and does not go on behind it: a
pipe through an opening does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from scan2fea.estimation.outline import edge_lengths, outline_distance
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.sections import section
from scan2fea.types import FloatArray, IntArray, Member, Section, Value

Covers = Sequence[FloatArray]  # (k, 3) points of each other body around a member, m
VOID_POINTS = 25.0  # points that the density around a hole foretells for it: none by chance in 1e-11
VOID_CELLS = 4
_NEAR = 3.5  # spacings of the other body: neighbours on one surface
_SIGMAS = 4.0
_OVER = 0.9  # of the hole's cells lie under the other body
_LEAST = 4  # points


@dataclass(frozen=True, eq=False, kw_only=True)
class Hole(Value):
    """places : (c, 2) its cells, m: how far along the face they lie, and along the member.   cell_m : their size."""

    face: str
    places: FloatArray
    cell_m: float


def occupied(
    shape: Section, edge: IntArray, along: FloatArray, z: FloatArray, length: float, sigma_m: float
) -> tuple[Mapping[str, float], tuple[Hole, ...]]:
    """Per face the share of its cells that hold points, and the holes.

    edge, along : (n,) the nearest edge of the section to each point on the sides, and the place along it.   z : (n,) along the member, m.
    sigma_m : noise. What lies within four of it from a corner may be of the face beyond, and encloses nothing: a hidden face is no hole.
    """
    alone = {loop[0] for loop in shape.face_names if len(set(loop)) == 1}  # round: it has no corner
    outline = float(edge_lengths(shape).sum())
    seen: dict[str, float] = {}
    holes: list[Hole] = []
    for name, rows, s, width in on_faces(shape, edge, along):
        margin = (0.0 if name in alone else _SIGMAS * sigma_m, _SIGMAS * sigma_m)
        seen[name], found = _face(name, s, z[rows], width, length, len(edge) * width / outline, margin)
        holes += found
    return seen, tuple(holes)


def on_faces(shape: Section, edge: IntArray, along: FloatArray) -> Iterator[tuple[str, IntArray, FloatArray, float]]:
    """Of each face its name, the rows of the places (edge, along) that lie on it, how far along it each is, and its width, m."""
    names = [name for loop in shape.face_names for name in loop]
    lengths = edge_lengths(shape)
    before = np.r_[0.0, np.cumsum(lengths)[:-1]]
    for name in dict.fromkeys(names):
        own = [i for i, other in enumerate(names) if other == name]
        rows = np.flatnonzero(np.isin(edge, own))
        yield name, rows, before[edge[rows]] + along[rows] - before[own[0]], float(lengths[own].sum())


def _face(
    name: str, s: FloatArray, z: FloatArray, width: float, length: float, expected: float, margin: tuple[float, float]
) -> tuple[float, list[Hole]]:
    if len(s) < 4:
        return 0.0, []
    count = max(min(expected, max(len(s), 0.1 * expected)) / 6, 1.0)  # six points a cell on average: an empty one is a chance of 1 in 400
    cell = max(math.sqrt(width * length / count), 1e-12)
    n_s, n_z = max(round(width / cell), 1), max(min(round(length / cell), 2000), 1)
    i = np.clip((s / width * n_s).astype(int), 0, n_s - 1)
    j = np.clip((z / length * n_z).astype(int), 0, n_z - 1)
    counts = np.bincount(i * n_z + j, minlength=n_s * n_z).reshape(n_s, n_z)
    share = float((counts > 0).mean())
    if min(n_s, n_z) < VOID_CELLS:
        return share, []
    own = (s > margin[0]) & (s < width - margin[0]) & (z > margin[1]) & (z < length - margin[1])
    counts = np.bincount(i[own] * n_z + j[own], minlength=n_s * n_z).reshape(n_s, n_z)
    label, n_regions = ndimage.label(counts == 0)
    rim = np.unique(np.r_[label[0], label[-1], label[:, 0], label[:, -1]])
    holes = []
    for region in range(1, n_regions + 1):
        if region in rim:
            continue
        inside = label == region
        around = ndimage.binary_dilation(inside, iterations=1) & ~inside
        if inside.sum() * float(counts[around].mean()) > VOID_POINTS and inside.sum() >= VOID_CELLS:
            places = (np.argwhere(inside) + 0.5) * [width / n_s, length / n_z]
            holes.append(Hole(face=name, places=places, cell_m=max(width / n_s, length / n_z)))
    return share, holes


def uncovered(holes: Sequence[Hole], member: Member, covers: Covers, sigma_m: float) -> tuple[Hole, ...]:
    """The holes on which no other body lies. sigma_m : noise."""
    left = list(holes)
    shape, sweep = section(member.family, member.values()), sweep_of_member(member)
    for points in covers if left else ():
        if len(points) < _LEAST:
            continue
        local = sweep.coordinates(points)
        reach = _NEAR * spacing(points) + _SIGMAS * sigma_m
        distance, edge, along = outline_distance(shape, local[:, :2])
        near = np.flatnonzero(np.abs(distance) <= reach)
        on = {name: (near[rows], s) for name, rows, s, _ in on_faces(shape, edge[near], along[near])}
        left = [hole for hole in left if not _lies_on(hole, shape, local, *on[hole.face], reach)]
    return tuple(left)


def _lies_on(hole: Hole, shape: Section, local: FloatArray, rows: IntArray, s: FloatArray, reach: float) -> bool:
    """Whether a body lies on a hole's face over the whole of it, and stays on that side.

    local : (k, 3) its points along the member.   rows : those near the face.   s : how far along the face these lie, m.
    """
    if len(rows) < _LEAST:
        return False
    try:
        sides = ConvexHull(np.stack([s, local[rows, 2]], 1)).equations
    except QhullError:  # all on one line
        return False
    under = (hole.places @ sides[:, :2].T + sides[:, 2]).max(axis=1) <= hole.cell_m
    return bool(under.mean() >= _OVER) and not _goes_through(hole, shape, local, reach)


def _goes_through(hole: Hole, shape: Section, local: FloatArray, reach: float) -> bool:
    """Whether points of the body lie behind the face, where the hole is."""
    start = np.concatenate(shape.loops)
    way = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops])
    lengths = np.linalg.norm(way, axis=1)
    own = [i for i, name in enumerate(name for loop in shape.face_names for name in loop) if name == hole.face]
    middle = hole.places.mean(axis=0)
    before = np.cumsum(lengths[own]) - lengths[own]
    edge = own[int(np.flatnonzero(before <= middle[0])[-1])]  # of a round face the chord at the middle of the hole
    along = way[edge] / lengths[edge]
    place = start[edge] + (middle[0] - before[own.index(edge)]) * along
    outward = np.array([along[1], -along[0]])
    step = 1e-3 * lengths[edge]
    if outline_distance(shape, (place + step * outward)[None])[0][0] < 0:
        outward = -outward
    half = (np.ptp(hole.places, axis=0) + hole.cell_m) / 2
    beside = np.abs((local[:, :2] - place) @ along) <= half[0]
    beside &= np.abs(local[:, 2] - middle[1]) <= half[1]
    return int((beside & ((local[:, :2] - place) @ outward < -reach)).sum()) >= _LEAST
