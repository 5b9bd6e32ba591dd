"""Control sets for clustering: points in the plane z = 0 whose groups are known.

The source thesis's Table 3.1 shows such sets as pictures without their numbers; these have the same kinds: round heaps, rings about one centre,
interlocked moons, parallel lines, and heaps of uneven size and density.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from scan2fea.types import FloatArray, IntArray

Labelled = tuple[FloatArray, IntArray]


def blobs(n: int = 300, seed: int = 0) -> Labelled:
    """Three round heaps of n points: points (3 n, 3), group (3 n,)."""
    rng = np.random.default_rng(seed)
    return _flat([np.array(at) + 0.35 * rng.standard_normal((n, 2)) for at in ((0.0, 0.0), (4.0, 0.0), (2.0, 3.5))])


def rings(n: int = 300, seed: int = 0) -> Labelled:
    """Two rings about one centre, of n and 2 n points."""
    rng = np.random.default_rng(seed)
    groups = []
    for radius, m in ((1.0, n), (2.0, 2 * n)):
        angle = 2 * np.pi * rng.random(m)
        groups.append(np.c_[radius * np.cos(angle), radius * np.sin(angle)] + 0.05 * rng.standard_normal((m, 2)))
    return _flat(groups)


def moons(n: int = 300, seed: int = 0) -> Labelled:
    """Two half circles of n points each, one reaching into the other."""
    rng = np.random.default_rng(seed)
    a, b = np.pi * rng.random((2, n))
    halves = (np.c_[np.cos(a), np.sin(a)], np.c_[1 - np.cos(b), 0.5 - np.sin(b)])
    return _flat([half + 0.05 * rng.standard_normal((n, 2)) for half in halves])


def lines(n: int = 300, seed: int = 0) -> Labelled:
    """Three parallel lines of n points each, nearer to each other than they are long."""
    rng = np.random.default_rng(seed)
    return _flat([np.c_[6 * rng.random(n), at + 0.05 * rng.standard_normal(n)] for at in (0.0, 0.7, 1.4)])


def uneven(n: int = 300, seed: int = 0) -> Labelled:
    """Three heaps of 2 n, n / 5 and n / 2 points and of very different width."""
    rng = np.random.default_rng(seed)
    sizes = ((2 * n, 1.0, (0.0, 0.0)), (n // 5, 0.15, (6.0, 0.0)), (n // 2, 0.5, (0.0, 6.0)))
    return _flat([np.array(at) + width * rng.standard_normal((m, 2)) for m, width, at in sizes])


def _flat(groups: Sequence[FloatArray]) -> Labelled:
    points = np.concatenate(groups)
    return np.c_[points, np.zeros(len(points))], np.repeat(np.arange(len(groups)), [len(group) for group in groups])


CONTROL_SETS: Mapping[str, Callable[[int, int], Labelled]] = {"blobs": blobs, "rings": rings, "moons": moons, "lines": lines, "uneven": uneven}
