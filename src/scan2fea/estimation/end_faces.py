"""Is a member cut off flat? A dished bottom or a rounded tip can lie within reach of an end plane and yet on no plane.

The tests of the sides leave out what is nearer to an end than to them, so this is asked by itself: of the points well inside the outline and near the
end plane, most lie off it on one side, more than noise and clutter explain. (Noise that is wider across an end than across the sides, as where a
scanner looks along the member, lies on both sides of it.)
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.types import FloatArray

INSIDE = 2.0  # sigma inside the outline: 2 % of the points of a side
OFF = 2.0  # sigma from the end plane
MOST_OFF = 0.5  # share of the points of an end, on one side of it: a broken corner leaves the rest of the cap on its plane
LEAST = 25.0  # points off it, beyond clutter and five standard deviations of that


def n_not_flat(side_m: FloatArray, beyond_m: FloatArray, sigma_m: float, reach_m: float, length_m: float) -> int:
    """How many of the two ends are no planes.

    side_m : (n,) signed distance to the outline.   beyond_m : (n, 2) to each end plane, positive outside.   reach_m : off which points are strays.
    What lies deep in the member, away from both ends, tells how many points get there by noise and clutter.
    """
    inside = side_m < -INSIDE * sigma_m
    deep = inside & (beyond_m.max(axis=1) < -2.0 * reach_m)
    per_metre = deep.sum() / max(length_m - 4.0 * reach_m, reach_m)
    count = 0
    for k in range(2):
        away = np.abs(beyond_m[:, k])
        is_cap = inside & (away < reach_m) & (beyond_m[:, k] > side_m)  # nearer to the end than to a side
        by_chance = per_metre * (reach_m - OFF * sigma_m)
        outside, within = (float((is_cap & (sign * beyond_m[:, k] > OFF * sigma_m)).sum()) for sign in (1.0, -1.0))
        off = max(outside, within) - by_chance
        count += int(off > LEAST + 5.0 * math.sqrt(by_chance) and off > MOST_OFF * float(is_cap.sum()))
    return count
