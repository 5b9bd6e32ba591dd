"""Inside or outside, tet by tet: the minimum cut between what the sensors saw empty and what lies under the points.

Labatut, Pons, Keriven, "Robust and efficient surface reconstruction from range data", 2009, with directed sight-line costs, the tet that
holds the sensor as source, and the inward vote along the normal instead of along the ray (reference/reconstruction.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.delaunay import Tetrahedralisation, facet_vector, tet_at, walk_votes
from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

NEVER = 1e9  # capacity of what must not be cut
LEAST_DEPTH = 0.02  # of the spacing: the inward vote starts at least this deep
AREA_PRICE = 0.1  # of a facet of one square spacing, against the shape cost of a facet
WALL_SHARE = 0.45  # of the local thickness: the inward vote stays on its own side of the wall
HELD = 0.5  # share of inward votes the result must respect: below it the surface has collapsed
HALVINGS = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class Votes(Value):
    """capacity : (m, 4) price of tet t being outside and its neighbour i inside.   source, sink : (m,) votes for outside, inside."""

    capacity: FloatArray
    source: FloatArray
    sink: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Cut(Value):
    """inside : (m,) bool.   quality_weight : the one that was used, halved until the surface held.   held : share of inward votes respected."""

    inside: BoolArray
    votes: Votes
    quality_weight: float
    held: float


def gather_votes(
    tetra: Tetrahedralisation,
    normals: FloatArray,
    targets: FloatArray,
    softness_m: float,
    thickness_m: FloatArray,
    spacing_m: float,
    weight: FloatArray | None = None,
) -> Votes:
    """What each point says.

    normals : (n, 3) outward.   targets : (n, 3) its sensor or pseudo-sensor; a nan row gives no sight line, only the inward vote.
    thickness_m : (n,) local wall thickness, nan where there is none.   weight : (n,) of each point's votes, default 1.
    """
    n, m = tetra.n_input, len(tetra)
    weight = np.ones(n) if weight is None else np.asarray(weight, float)
    capacity, source, sink = np.zeros((m, 4)), np.zeros(m), np.zeros(m)
    first, incident = tetra.incidence
    seen = np.flatnonzero(np.isfinite(targets).all(axis=1))
    way = targets[seen] - tetra.points[seen]
    rise = np.abs(np.einsum("ij,ij->i", way, normals[seen])) / np.maximum(np.linalg.norm(way, axis=1), np.finfo(float).tiny)
    graph = (tetra.points, tetra.tets, tetra.neighbors, first, incident)
    walk_votes(*graph, tetra.is_box, seen, targets[seen], weight[seen], rise, float(softness_m), capacity, source)
    depth = np.maximum(np.fmin(2.0 * softness_m, WALL_SHARE * thickness_m), LEAST_DEPTH * spacing_m)
    under = tet_at(*graph, np.arange(n), np.ascontiguousarray(-normals), depth)
    np.add.at(sink, under[under >= 0], weight[under >= 0])
    sink[tetra.is_box] = 0.0
    return Votes(capacity=capacity, source=source, sink=sink)


@jit_ieee
def _facets(
    points: FloatArray, tets: IntArray, neighbors: IntArray, centre: FloatArray, radius: FloatArray, spacing: float
) -> tuple[IntArray, FloatArray]:
    """(k, 4) tet, its facet, the tet beyond and the facet as that counts it, of each facet between two tets; and what it costs (k,).

    1 - min(cos phi, cos psi) of the facet with the circumspheres on its two sides (Labatut 2009), 0 for large empty spheres, and AREA_PRICE of
    its area in square spacings, which keeps a single wrong vote from raising a spike.
    """
    cosine, area, n = np.empty((len(tets), 4)), np.empty((len(tets), 4)), 0
    for t in range(len(tets)):
        for i in range(4):
            ax, ay, az, nx, ny, nz = facet_vector(points, tets, t, i)
            twice = math.sqrt(nx * nx + ny * ny + nz * nz)
            height = (ax - centre[t, 0]) * nx + (ay - centre[t, 1]) * ny + (az - centre[t, 2]) * nz
            cosine[t, i], area[t, i] = min(max(height / (twice * radius[t]), -1.0), 1.0), 0.5 * twice
            n += neighbors[t, i] > t
    pairs, cost, k = np.empty((n, 4), np.int64), np.empty(n), 0
    for t in range(len(tets)):
        for i in range(4):
            other = neighbors[t, i]
            if other <= t:
                continue
            back = 0
            for j in range(4):
                if neighbors[other, j] == t:
                    back = j
            pairs[k, 0], pairs[k, 1], pairs[k, 2], pairs[k, 3] = t, i, other, back
            cost[k] = 1.0 - min(cosine[t, i], cosine[other, back]) + AREA_PRICE * area[t, i] / spacing**2
            k += 1
    return pairs, cost


def cut(
    tetra: Tetrahedralisation,
    votes: Votes,
    spacing_m: float,
    extra_source: FloatArray | None = None,
    quality_weight: float = 0.3,
) -> Cut:
    """The cheapest labelling of the tets; those of the box are outside.

    extra_source : (m,) further votes for outside, from whoever knows (a flood from the box).   quality_weight : price of a facet of cost 1
    against one vote; where so few votes meet that the surface would collapse it is halved.
    Raises ReconstructionError if nothing is inside at any weight.
    """
    source = votes.source + (0.0 if extra_source is None else extra_source)
    pairs, shape = _facets(tetra.points, tetra.tets, tetra.neighbors, tetra.circumcentre, tetra.circumradius, float(spacing_m))
    i, facet, j, back = pairs.T
    forward, reverse = votes.capacity[i, facet], votes.capacity[j, back]
    for _ in range(HALVINGS):
        price = quality_weight * shape
        inside = _minimum_cut(i, j, forward + price, reverse + price, np.where(tetra.is_box, NEVER, source), votes.sink)
        held = float(votes.sink[inside].sum() / max(votes.sink.sum(), 1e-300))
        if held >= HELD:
            return Cut(inside=inside, votes=votes, quality_weight=quality_weight, held=held)
        quality_weight *= 0.5
    says = "the sight lines leave nothing inside: is it an open sheet seen from one side, or are the normals or the sensor positions wrong?"
    require(inside.any(), ReconstructionError, says)
    return Cut(inside=inside, votes=votes, quality_weight=2.0 * quality_weight, held=held)


def _minimum_cut(i: IntArray, j: IntArray, forward: FloatArray, reverse: FloatArray, source: FloatArray, sink: FloatArray) -> BoolArray:
    """(m,) True on the sink side. `forward` is paid where i is on the source side and j is not."""
    import maxflow  # heavy: only where it is used

    graph = maxflow.GraphFloat(len(source), len(i))
    nodes = graph.add_nodes(len(source))
    graph.add_edges(i, j, forward, reverse)
    graph.add_grid_tedges(nodes, source, sink)
    graph.maxflow()
    return np.asarray(graph.get_grid_segments(nodes), bool)
