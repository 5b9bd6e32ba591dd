"""Cylinders in an arrangement of planes: each a prism whose section has the area of the circle, which parts a cell into within and without.

The pieces that lie without a prism are one cell for the cut that labels them, as far as they hang together: however many facets go round, a
cylinder is one face. A round end between two flats that touch it parts what lies before it from what lies behind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.arrangement import ON_PLANE, Arrangement, Cells
from scan2fea.kernel.surfaces import Surface
from scan2fea.reconstruction.plane_growing import Planes
from scan2fea.reconstruction.round_growing import Rounds
from scan2fea.types import FloatArray, IntArray, Value

MOST_CELLS = 5000  # pieces of space, a millisecond each: brackets and tubes need 200 to 800, cylinders laid through a dome a million
SAGITTA = 0.025  # spacings that the arc of a facet rises over its chord, and no more than the noise where that is larger still
LEAST_FACETS, MOST_FACETS = 20, 96  # 18 degrees from one to the next: sides that turn by 20 and more are remeshed as flats of their own


@dataclass(frozen=True, eq=False, kw_only=True)
class Shapes(Value):
    """planes : the planes, then the facets of cylinders, all with their points.   round_of : (p,) cylinder of each row, -1 a plane."""

    planes: Planes
    rounds: Rounds
    round_of: IntArray

    @property
    def n_flat(self) -> int:
        """How many rows are planes."""
        return int(np.sum(self.round_of < 0))

    def rows(self, number: int) -> IntArray:
        """Those of the facets of a cylinder, in their order round it."""
        return np.flatnonzero(self.round_of == number)

    @property
    def primitive(self) -> IntArray:
        """(p,) one number for each plane, and for all facets of a cylinder."""
        return np.where(self.round_of < 0, np.arange(len(self.round_of)), self.n_flat + self.round_of)


def shapes(points: FloatArray, planes: Planes, rounds: Rounds, spacing_m: float) -> Shapes:
    """Planes and cylinders as planes.   points : (n, 3) in the rows of both labels."""
    normal, offset, std, of = [planes.normal], [planes.offset], [planes.std_m], [np.full(len(planes), -1, np.int64)]
    label, first = planes.label.copy(), len(planes)
    for number, surface in enumerate(rounds.surfaces):
        ways, apothem = facets(surface, spacing_m)
        own = np.flatnonzero(rounds.label == number)
        label[own] = first + np.argmax((points[own] - surface.point) @ ways.T, axis=1)
        normal.append(surface.sense * ways)
        offset.append(surface.sense * (ways @ surface.point + apothem))
        std.append(np.full(len(ways), rounds.std_m[number]))
        of.append(np.full(len(ways), number))
        first += len(ways)
    every = Planes(normal=np.concatenate(normal), offset=np.concatenate(offset), label=label, std_m=np.concatenate(std))
    return Shapes(planes=every, rounds=rounds, round_of=np.concatenate(of))


def facets(surface: Surface, spacing_m: float) -> tuple[FloatArray, float]:
    """(n, 3) directions of the sides of a prism away from the axis, and how far these lie from it: its section has the area of the circle."""
    rise = min(SAGITTA * spacing_m, 0.5 * surface.radius)
    n = int(np.clip(math.ceil(math.pi / math.acos(1.0 - rise / surface.radius)), LEAST_FACETS, MOST_FACETS))
    angle = 2 * np.pi * (np.arange(n) + 0.5) / n
    ways = np.column_stack([np.cos(angle), np.sin(angle)]) @ surface.frame()
    return ways, surface.radius * math.sqrt(math.pi / (n * math.tan(math.pi / n)))


def cut_round(space: Arrangement, every: Shapes, number: int, cells: list[int], group: list[int]) -> list[int]:
    """Part cells by a cylinder. group : (n_cells,) number of the cell that each piece counts as; returned for the pieces of now.

    Raises ReconstructionError beyond MOST_CELLS.
    """
    rows, sense = every.rows(number), every.rounds.surfaces[number].sense
    out, new = list(group), dict[int, int]()
    for c in cells:
        sides = _sides_within(space, every, number, c)
        if sides is None:
            continue
        before, within = space.n_cells, [c]
        for row in rows[sides]:
            front, behind = space.cut(int(row), within)
            within = behind if sense > 0 else front
            says = f"flat and round faces would cut space into more than {MOST_CELLS} pieces: they are no solid of such faces"
            require(space.n_cells <= MOST_CELLS, ReconstructionError, says)
            if not within:
                break
        out += [out[c]] * (space.n_cells - before)
        if within:  # a piece that lies within whole goes with those that are cut
            number_within = new.setdefault(out[c], max(out) + 1)
            for k in within:
                out[k] = number_within
    return out


def _sides_within(space: Arrangement, every: Shapes, number: int, cell: int) -> IntArray | None:
    """Which sides of a prism pass through a cell, in the order in which they cut it: none where it lies within whole. None: it lies without.

    A plane goes on beyond its side, and would cut what lies without for nothing. Coarse to fine, few pieces reach far: those of the later sides
    lie between the prism and the earlier ones, where few other cylinders pass.
    """
    rows, surface = every.rows(number), every.rounds.surfaces[number]
    frame, near = surface.frame(), ON_PLANE * space.size
    ways = surface.sense * every.planes.normal[rows] @ frame.T
    apothem = surface.sense * (every.planes.offset[rows] - every.planes.normal[rows] @ surface.point)
    corners = np.array([space.vertices[v] for v in {v for f in space.facets[cell] for v in space.loops[f]}])
    seen = (corners - surface.point) @ frame.T  # along the axis the prism is a polygon
    height = seen @ ways.T - apothem
    if (height.min(axis=0) >= -near).any():
        return None
    if (height <= near).all():
        return np.zeros(0, np.int64)
    after = np.roll(ways, -1, axis=0)
    ends = (apothem / (1.0 + np.einsum("ij,ij->i", ways, after)))[:, None] * (ways + after)
    sides = _crossing(np.roll(ends, 1, axis=0), ends, seen, near)
    turn = sides + 1
    return sides[np.argsort(-(turn & -turn), kind="stable")] if len(sides) else None  # by the highest power of two that divides their number


def _crossing(start: FloatArray, end: FloatArray, corners: FloatArray, near: float) -> IntArray:
    """Those of the segments from start to end, (n, 2) each, that pass within the hull of corners (m, 2), by more than `near`: Cyrus, Beck 1978."""
    try:
        hull = ConvexHull(corners).equations
    except QhullError:  # thinner than figures tell: any may
        return np.arange(len(start))
    one, other = (ends @ hull[:, :2].T + hull[:, 2] + near for ends in (start, end))  # negative within
    share = one / np.where(one == other, 1.0, one - other)
    enters, leaves = np.where(one > 0.0, share, 0.0).max(axis=1), np.where(other > 0.0, share, 1.0).min(axis=1)
    return np.flatnonzero((enters < leaves) & ((one < 0.0) | (other < 0.0)).all(axis=1))


def hung_together(cells: Cells, group: IntArray) -> IntArray:
    """(n_cells,) group, parted where its pieces share no facet with each other. Facets between two pieces of one group are no faces."""
    pair = cells.cell[(cells.cell >= 0).all(axis=1)]
    pair = pair[group[pair[:, 0]] == group[pair[:, 1]]]
    graph = coo_array((np.ones(len(pair), np.int8), (pair[:, 0], pair[:, 1])), shape=(cells.n_cells, cells.n_cells))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)
