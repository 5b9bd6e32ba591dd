"""Members with round holes through one wall, for tests."""

import numpy as np

from estimation.made import made, scanned
from scan2fea.kernel.sections import section

LENGTH, RADIUS, SIGMA = 0.4, 0.009, 0.001
# family: the wall as (axis across it, its two faces), and the middles of its holes along the other axis and along the member
WALLS = {
    "L": (1, lambda t: (0.0, t), [(0.55, 0.1), (0.55, 0.3)]),
    "rect": (1, lambda t: (-t / 2, t / 2), [(0.0, 0.1), (0.2, 0.25)]),
}


def bolted(family, n, sigma, seed=0):
    """(points, member, holes): a member with round holes through one wall, the sides of the holes scanned like the rest."""
    member, rng = made(family, LENGTH), np.random.default_rng(seed)
    values = member.values()
    axis, faces, holes = WALLS[family]
    low, high = faces(values["t"])
    wide = values.get("a", values["b"])
    points = scanned(member, n, 0.0, seed)
    shape = section(family, values)
    area = sum(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).sum() for loop in shape.loops) * LENGTH
    for across, along in holes:
        middle = np.array([across * wide, along])
        on = (points[:, axis] > low - 1e-6) & (points[:, axis] < high + 1e-6)
        points = points[~on | (np.linalg.norm(points[:, [1 - axis, 2]] - middle, axis=1) > RADIUS)]
        m = rng.poisson(n / area * 2 * np.pi * RADIUS * (high - low))
        turn = rng.uniform(0, 2 * np.pi, m)
        side = np.empty((m, 3))
        side[:, 1 - axis], side[:, 2] = middle[0] + RADIUS * np.cos(turn), middle[1] + RADIUS * np.sin(turn)
        side[:, axis] = rng.uniform(low, high, m)
        points = np.concatenate([points, side])
    return points + sigma * rng.standard_normal(points.shape), member, len(holes)
