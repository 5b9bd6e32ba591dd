"""Is a member cut off flat, and by its maker? A dished bottom or a rounded tip can lie within reach of an end plane and yet on no plane.

The tests of the sides leave out what is nearer to an end than to them, so this is asked by itself: of the points well inside the outline and near the
end plane, most lie off it on one side, more than noise and clutter explain. (Noise that is wider across an end than across the sides, as where a
scanner looks along the member, lies on both sides of it.)

Where no point of an end face was seen, and the sides do not stop square to the member, it may be the scan that was cut off there.
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.estimation.ends import Ends
from scan2fea.types import FloatArray

INSIDE = 2.0  # sigma inside the outline: 2 % of the points of a side
OFF = 2.0  # sigma from the end plane
MOST_OFF = 0.5  # share of the points of an end, on one side of it: a broken corner leaves the rest of the cap on its plane
SQUARE = 0.01  # slope of an end that is meant to be square: EN 1090-2, squareness of ends, D / 100
SURE = 3.0  # standard deviations
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


def cut_askew(ends: Ends, family: str, joined: tuple[bool, bool] = (False, False)) -> str:
    """Why the scan may have been cut off, not the member: an end that is not square and of whose face nothing was seen; "" where there is none.

    A mitred end shows its face; of a member of which it does not, nobody can tell how far it goes on. joined : ends that lie on a neighbour.
    """
    for end in (end for end, is_joined in zip((ends.low, ends.high), joined, strict=True) if not is_joined):
        slope, std = np.asarray(end.slope), np.asarray(end.slope_std)
        tilt = float(np.hypot(*slope))
        if end.cap_points == 0 and tilt > SQUARE + SURE * float(np.hypot(*(slope * std))) / max(tilt, 1e-300):
            degrees = math.degrees(math.atan(tilt))
            return (
                f"the sides of the {family} member stop along a plane {degrees:.1f} degrees off square, and of the face there nothing was seen: "
                "the scan may have been cut off there, not the member; scan its end, or say that nothing was cut off (whole)"
            )
    return ""
