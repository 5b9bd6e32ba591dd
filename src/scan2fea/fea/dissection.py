"""Order of elimination: nested dissection of the nodes (George 1973), and the fronts that follow from it.

The nodes are halved again and again across their longest extent. The smallest set of nodes that covers every edge between the halves
separates them and is eliminated after both (smallest vertex cover from a largest matching: Koenig 1931; Pothen and Fan 1990). What a
half still knows when its own nodes are gone is a dense matrix over its separators: a front of the multifrontal method (Duff and Reid
1983). The sizes are known before a number is computed, and with them memory and time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import maximum_bipartite_matching

from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray

LEAF_NODES = 48  # below, dense arithmetic is cheaper than another cut
MOST_LAST = 2.0  # times the largest other separator: nodes that may be kept for the last front (measured: 20 to 50 % more work, where a second
# factorisation would be 100 %; a beam that lies on its whole side has ten times as many)
SMALL = 300  # nodes below which the smaller rim of the cut is good enough as a separator


@dataclass(frozen=True, eq=False, kw_only=True)
class Front:
    """A dense matrix over nodes. own : nodes eliminated here. rest : nodes left to ancestors. children : earlier fronts it gathers."""

    own: IntArray
    rest: IntArray
    children: tuple[int, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Tree:
    """Fronts, children before parents. order : (free,) nodes as they are eliminated; rank : (n,) place in it, -1 for held nodes.

    last : nodes that were asked to be eliminated together in the last front, rising; empty where none were.
    """

    fronts: tuple[Front, ...]
    order: IntArray
    rank: IntArray
    last: IntArray

    @property
    def factor_entries(self) -> int:
        """Numbers in the factor as it is stored: square diagonal blocks and what lies below them."""
        return sum(9 * len(f.own) * (len(f.own) + len(f.rest)) for f in self.fronts)

    @property
    def peak_entries(self) -> int:
        """Numbers alive at the worst moment: the factor so far and the dense matrices that wait for their parents."""
        live = peak = 0
        for f in self.fronts:
            a, b = 3 * len(f.own), 3 * len(f.rest)
            live += a * (a + b) + b * b
            peak = max(peak, live)
            live -= sum((3 * len(self.fronts[c].rest)) ** 2 for c in f.children)
        return peak

    @property
    def flops(self) -> float:
        """Multiplications and additions of the factorisation."""
        total = 0.0
        for f in self.fronts:
            a, b = 3.0 * len(f.own), 3.0 * len(f.rest)
            total += a**3 / 3 + a * a * b + a * b * b
        return total


@jit
def _crossing(nodes: IntArray, side: IntArray, indptr: IntArray, indices: IntArray) -> IntArray:
    """(e, 2) edges of the graph from a node of side 1 to one of side 2."""
    n = 0
    for i in nodes:
        if side[i] == 1:
            for k in range(indptr[i], indptr[i + 1]):
                if side[indices[k]] == 2:
                    n += 1
    edges = np.zeros((n, 2), np.int64)
    n = 0
    for i in nodes:
        if side[i] == 1:
            for k in range(indptr[i], indptr[i + 1]):
                if side[indices[k]] == 2:
                    edges[n, 0], edges[n, 1] = i, indices[k]
                    n += 1
    return edges


def smallest_cover(edges: IntArray) -> IntArray:
    """Fewest nodes that touch every edge (e, 2) between two disjoint sets: Koenig's theorem on a largest matching."""
    left, row = np.unique(edges[:, 0], return_inverse=True)
    right, column = np.unique(edges[:, 1], return_inverse=True)
    graph = sp.csr_array((np.ones(len(edges), np.int8), (row, column)), shape=(len(left), len(right)))
    mate = maximum_bipartite_matching(graph, perm_type="column")  # of each left node, -1 where single
    mate_of_right = np.full(len(right), -1, np.int64)
    mate_of_right[mate[mate >= 0]] = np.flatnonzero(mate >= 0)
    seen_left, seen_right = mate < 0, np.zeros(len(right), bool)
    new = np.flatnonzero(seen_left)
    while len(new):
        reached = np.unique(graph[new].indices)
        reached = reached[~seen_right[reached]]
        seen_right[reached] = True
        new = mate_of_right[reached]  # never -1: such a right node would end an augmenting path
        new = new[~seen_left[new]]
        seen_left[new] = True
    return np.concatenate([left[~seen_left], right[seen_right]])


def _smaller_rim(edges: IntArray) -> IntArray:
    """The smaller of the two sets of end nodes of the edges (e, 2)."""
    return min(np.unique(edges[:, 0]), np.unique(edges[:, 1]), key=len)


class _Builder:
    """State of the recursion: who is taken, and scratch marks."""

    def __init__(self, nodes: FloatArray, indptr: IntArray, indices: IntArray) -> None:
        self.nodes, self.indptr, self.indices = nodes, indptr, indices
        self.side = np.zeros(len(nodes), np.int64)
        self.fronts: list[Front] = []

    def split(self, part: IntArray) -> tuple[IntArray, IntArray, IntArray]:
        """(one half, other half, separator): the best of the cuts across the long principal axes."""
        x = self.nodes[part]
        x = x - x.mean(axis=0)
        spread, axes = np.linalg.eigh(x.T @ x)
        best: tuple[IntArray, IntArray, IntArray] | None = None
        for axis in axes.T[spread >= 0.5 * spread[-1]]:
            order = np.argsort(np.round(x @ axis / np.sqrt(spread[-1]), 9), kind="stable")
            self.side[part[order[: len(part) // 2]]] = 1
            self.side[part[order[len(part) // 2 :]]] = 2
            edges = _crossing(part, self.side, self.indptr, self.indices)
            cover = smallest_cover(edges) if len(part) > SMALL else _smaller_rim(edges)
            if best is None or len(cover) < len(best[2]):
                self.side[cover] = 3
                best = part[self.side[part] == 1], part[self.side[part] == 2], np.sort(cover)
            self.side[part] = 0
        return best if best is not None else (part, part[:0], part[:0])

    def cut(self, part: IntArray) -> tuple[int, ...]:
        """Make the fronts of these nodes; returns the fronts an ancestor must gather."""
        if len(part) <= LEAF_NODES:
            return self.close(part, ())
        first, second, shared = self.split(part)
        if not (len(first) or len(second)):
            return self.close(part, ())
        children = self.cut(first) + self.cut(second)
        return self.close(shared, children)

    def close(self, own: IntArray, children: tuple[int, ...]) -> tuple[int, ...]:
        if not len(own):
            return children
        self.fronts.append(Front(own=own, rest=own[:0], children=children))
        return (len(self.fronts) - 1,)


def _neighbours(own: IntArray, indptr: IntArray, indices: IntArray) -> IntArray:
    return np.concatenate([indices[indptr[i] : indptr[i + 1]] for i in own])


def dissect(nodes: FloatArray, indptr: IntArray, indices: IntArray, last: IntArray | None = None) -> Tree:
    """The fronts of the graph (indptr, indices) of nodes (n, 3). `last`: nodes that are eliminated together, after all others, in the last front."""
    builder = _Builder(nodes, indptr, indices)
    at_end = np.zeros(len(nodes), bool)
    at_end[np.zeros(0, np.int64) if last is None else last] = True
    builder.close(np.flatnonzero(at_end), builder.cut(np.flatnonzero(~at_end)))
    order = np.concatenate([f.own for f in builder.fronts])
    rank = np.empty(len(nodes), np.int64)
    rank[order] = np.arange(len(order))
    fronts: list[Front] = []
    for f in builder.fronts:
        # what is tied to the own nodes, or was to those below, and is eliminated later, in that order
        tied = [_neighbours(f.own, indptr, indices), *(fronts[c].rest for c in f.children)]
        later = np.unique(rank[np.concatenate(tied)])
        fronts.append(Front(own=f.own, rest=order[later[later > rank[f.own[-1]]]], children=f.children))
    return Tree(fronts=tuple(fronts), order=order, rank=rank, last=np.flatnonzero(at_end))


def dissect_before(nodes: FloatArray, indptr: IntArray, indices: IntArray, wanted: Sequence[IntArray]) -> Tree:
    """The fronts with the first of the `wanted` sets of nodes eliminated last that costs little: MOST_LAST times the largest other separator."""
    for last in wanted:
        tree = dissect(nodes, indptr, indices, last)
        if len(tree.last) <= MOST_LAST * max((len(f.own) for f in tree.fronts[:-1]), default=0):
            return tree
    return dissect(nodes, indptr, indices)


def without(tree: Tree, held: BoolArray) -> Tree:
    """The fronts when the `held` nodes (n,) bool do not move: the same cuts, fewer nodes."""
    fronts: list[Front] = []
    gathers: list[tuple[int, ...]] = []  # of each old front: the new fronts that its parent must gather
    for f in tree.fronts:
        children = tuple(new for c in f.children for new in gathers[c])
        own = f.own[~held[f.own]]
        if len(own):
            fronts.append(Front(own=own, rest=f.rest[~held[f.rest]], children=children))
            children = (len(fronts) - 1,)
        gathers.append(children)
    order = tree.order[~held[tree.order]]
    rank = np.full(len(held), -1, np.int64)
    rank[order] = np.arange(len(order))
    return Tree(fronts=tuple(fronts), order=order, rank=rank, last=np.zeros(0, np.int64))
