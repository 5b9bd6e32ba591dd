"""How much material lies between the points and the faces of a member: what its section lacks, or has too much.

A face that slopes lies beside a parallel one by a little here and by more there: the fit takes the part that is flattest in its noise and leaves the
rest to the strays, few and near enough to pass. What is modelled is the volume, so that is asked: how far the points of each stretch of the outline
lie off it, in the median (clutter and what is damaged over less than half of the length have no say), times how long the stretch is.
"""

from __future__ import annotations

import numpy as np

from scan2fea.estimation.attached import CORNER
from scan2fea.estimation.outline import edge_lengths, outline_distance
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.sections import ROUND, section, section_area
from scan2fea.types import FloatArray, Member

LIMIT = 0.05  # of the section: as for the standard deviation of the volume, and what fillets may add to it
_SIGMAS = 4.0
_POINTS = 60_000
_A_STRETCH, _LEAST, _MOST = 60, 15, 40  # points of a stretch on average and at least, and stretches of an edge
_DENSITY = 0.25  # of all sides: fewer points are no face that was seen


def lacking(points: FloatArray, member: Member, seed: int = 0) -> str:
    """Why the section holds too little or too much; "" where it does not, or where that is not told. points : (n, 3) metres."""
    share = lack(points, member, seed)
    if abs(share) <= LIMIT:
        return ""
    return (
        f"the points lie off the faces of the {member.family} member by {100 * share:+.1f} % of its section (limit {100 * LIMIT:.0f} %): sloping "
        "flanges, large fillets, or another shape"
    )


def lack(points: FloatArray, member: Member, seed: int = 0) -> float:
    """What the points hold beyond the section, over its area, below 0 where it holds too much; 0 where a dimension is not observable, the section
    changes, or noise joins two faces. points : (n, 3) metres.
    """
    values, sigma = member.values(), member.sigma_m
    is_told = all(p.observable and p.value_m > _SIGMAS * sigma for p in member.parameters)
    if member.family in ROUND or member.change is not None or not is_told:
        return 0.0
    shape = section(member.family, values)
    long = edge_lengths(shape)
    reach = _SIGMAS * sigma + CORNER * float(np.linalg.norm(np.ptp(shape.loops[0], axis=0)))
    local = sweep_of_member(member).coordinates(points[sampled_rows(len(points), _POINTS, seed)])
    off, edge, along = outline_distance(shape, local[:, :2])
    of_sides = (np.abs(off) <= reach) & (local[:, 2] > _SIGMAS * sigma) & (local[:, 2] < values["length"] - _SIGMAS * sigma)
    off, edge, along = off[of_sides], edge[of_sides], along[of_sides]
    area = 0.0
    for k, width in enumerate(long.tolist()):
        own = edge == k
        n = min(int(own.sum() / _A_STRETCH), _MOST)
        if n == 0 or own.sum() / width < _DENSITY * len(off) / long.sum():
            continue
        stretch = np.clip((along[own] / width * n).astype(np.int64), 0, n - 1)
        for one in range(n):
            there = off[own][stretch == one]
            area += width / n * float(np.median(there)) if len(there) >= _LEAST else 0.0
    return area / section_area(shape)
