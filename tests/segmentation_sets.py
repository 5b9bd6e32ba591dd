"""The 2-D control sets of the source thesis's Table 3.1, as points in the plane z = 0 with their true labels."""

import numpy as np


def _flat(parts):
    points = np.concatenate(parts)
    return np.c_[points, np.zeros(len(points))], np.repeat(np.arange(len(parts)), [len(p) for p in parts])


def blobs(n=300, seed=0):
    rng = np.random.default_rng(seed)
    return _flat([np.array(at) + 0.35 * rng.standard_normal((n, 2)) for at in ((0, 0), (4, 0), (2, 3.5))])


def rings(n=400, seed=0):
    rng = np.random.default_rng(seed)
    angle = [2 * np.pi * rng.random(m) for m in (n, 2 * n)]
    return _flat([np.c_[r * np.cos(a), r * np.sin(a)] + 0.05 * rng.standard_normal((len(a), 2)) for r, a in zip((1.0, 2.0), angle, strict=True)])


def moons(n=400, seed=0):
    rng = np.random.default_rng(seed)
    a, b = np.pi * rng.random((2, n))
    upper, lower = np.c_[np.cos(a), np.sin(a)], np.c_[1 - np.cos(b), 0.5 - np.sin(b)]
    return _flat([half + 0.05 * rng.standard_normal((n, 2)) for half in (upper, lower)])


def lines(n=300, seed=0):
    rng = np.random.default_rng(seed)
    return _flat([np.c_[6 * rng.random(n), at + 0.05 * rng.standard_normal(n)] for at in (0.0, 0.7, 1.4)])


def uneven(n=600, seed=0):
    rng = np.random.default_rng(seed)
    return _flat([rng.standard_normal((n, 2)), [6, 0] + 0.15 * rng.standard_normal((n // 10, 2)), [0, 6] + 0.5 * rng.standard_normal((n // 4, 2))])


SETS = {"blobs": blobs, "rings": rings, "moons": moons, "lines": lines, "uneven": uneven}
