"""Points of welded nodes: tubes of one width of which one corner each was seen, their fronts in one plane."""

import numpy as np

H, SIGMA = 0.005, 0.0004
X, Y, Z = np.eye(3)


def face(corner, along, across, rng):
    """(n, 3) points about H apart on a rectangle."""
    n = round(np.linalg.norm(along) * np.linalg.norm(across) / H**2)
    return np.asarray(corner) + rng.random((n, 1)) * along + rng.random((n, 1)) * across + SIGMA * rng.standard_normal((n, 3))


def tee(rng):
    """A tube along x, front and top, and its stem along z, front and right side."""
    tops = [face((-0.08, 0, 0.05), 0.055 * X, 0.05 * Y, rng), face((0.025, 0, 0.05), 0.155 * X, 0.05 * Y, rng)]
    stem = [face((-0.025, 0, 0.05), 0.05 * X, 0.18 * Z, rng), face((0.025, 0, 0.05), 0.05 * Y, 0.18 * Z, rng)]
    return np.concatenate([face((-0.08, 0, 0), 0.26 * X, 0.05 * Z, rng), *tops]), np.concatenate(stem)


def knee(rng):
    """Two arms of which the outer sides reach the corner, the inner ones do not; the corner of the front is shared out as of a mitre."""
    one = [face((0, 0, 0), 0.3 * X, 0.05 * Y, rng), face((0.05, 0, 0.05), 0.25 * X, 0.05 * Y, rng), face((0.05, 0, 0), 0.25 * X, 0.05 * Z, rng)]
    other = [face((0, 0, 0), 0.28 * Z, 0.05 * Y, rng), face((0.05, 0, 0.05), 0.23 * Z, 0.05 * Y, rng), face((0, 0, 0.05), 0.05 * X, 0.23 * Z, rng)]
    corner = face((0, 0, 0), 0.05 * X, 0.05 * Z, rng)
    is_other = corner[:, 2] > corner[:, 0]
    return np.concatenate([*one, corner[~is_other]]), np.concatenate([*other, corner[is_other]])
