"""Disjoint sets in an array of parents: what joined parts, touching cells and merged classes all walk along (Tarjan 1975)."""

from __future__ import annotations

from scan2fea.kernel.jit import jit
from scan2fea.types import IntArray


@jit
def root(parent: IntArray, i: int) -> int:
    """Representative of the set of `i`; the way to it is halved (parent is written)."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@jit
def join(parent: IntArray, a: int, b: int) -> bool:
    """Make one set of those of `a` and `b`, named after its least member; False where they were one already."""
    a, b = root(parent, a), root(parent, b)
    parent[max(a, b)] = min(a, b)
    return a != b
