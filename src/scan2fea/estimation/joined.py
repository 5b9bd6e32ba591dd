"""Where a member ends on a neighbour that it was cut off: no face of it could be seen there, and nothing was cut off by the scan.

Of a welded node each member is fitted by itself. Where one ends on another its face is inside the node, and its sides stop as the other's surface
runs: square to it, at a slant, or along a mitre. So the end is the plane through the last points of its sides; where they end along none (a saddle),
it is no member that can be built.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from scan2fea.estimation.outline import edge_lengths, outline_distance
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.sections import section
from scan2fea.types import BoolArray, FloatArray, Member

_LINK = 3.5  # spacings: neighbours on one surface
_SIGMAS = 4.0  # from the outline: points of the sides
_STRIP, _LEAST = 4.0, 8  # spacings wide along the outline, and points, of a strip whose end is asked for
_SHARE = 0.5  # of the strips, which end at the neighbour
_OFF_PLANE = 3.0  # standard deviations of the end of a strip
_ON_PLANE = 0.8  # of the strips
NO_PLANE = "its sides end on the neighbour along no plane (a saddle, or what is between them): leave it to reconstruction"
_PLANE = 4  # strips that make a plane, and one to doubt it


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Joint:
    """An end on a neighbour: z = position_m + slope . (x, y) in the member's frame.   std_m : of the position, no better than a spacing: either may
    have points of the other.   is_plane : whether it ends so.
    """

    position_m: float
    slope: FloatArray
    std_m: float
    is_plane: bool


def joints(points: FloatArray, member: Member, meets: Sequence[FloatArray]) -> tuple[Joint | None, Joint | None]:
    """The low end and the high one where they lie on a neighbour. points : (n, 3) of the member.   meets : (k, 3) of each neighbour."""
    if not len(meets) or member.bow.any() or member.twist.any() or member.change is not None:
        return None, None
    others, h, values = np.concatenate(meets), spacing(points), member.values()
    local = sweep_of_member(member).coordinates(points)
    shape = section(member.family, values)
    distance, edge, along = outline_distance(shape, local[:, :2])
    on = np.flatnonzero(np.abs(distance) < _SIGMAS * member.sigma_m + 1e-3 * max(values.values()))
    on = on[edge[on] < len(shape.loops[0])]  # inner faces are seen through the other end, and not to their own
    around = np.r_[0.0, np.cumsum(edge_lengths(shape))][edge[on]] + along[on]
    strip = np.floor(around / (_STRIP * h)).astype(np.int64)
    near = k_nearest(others, 1, points[on])[0][:, 0] <= _LINK * h + 2 * _SIGMAS * member.sigma_m
    low, high = (_joint(local[on] * np.array([1.0, 1.0, sign]), strip, near, h, member.sigma_m) for sign in (-1.0, 1.0))
    return (None if low is None else dataclasses.replace(low, position_m=-low.position_m, slope=-low.slope)), high


def _joint(local: FloatArray, strip: FloatArray, near: BoolArray, h: float, sigma_m: float) -> Joint | None:
    """The upper end of the sides in strips (n,) along their outline; None where most strips do not end near a neighbour."""
    ends, stds, at, is_near = [], [], [], []
    for number in np.unique(strip):
        rows = np.flatnonzero(strip == number)
        if len(rows) < _LEAST:
            continue
        z = local[rows, 2]
        last = rows[np.argsort(z)[-2:]]  # of a slanted end they lie on one side of the strip
        gap = float(np.ptp(z)) / len(rows)  # of evenly spread points the last one leaves as much bare, give or take as much
        ends.append(float(z.max()) + gap)
        stds.append(math.hypot(max(gap, h / 2), sigma_m))  # points went to either by the means of cells
        at.append(local[last[-1], :2])
        is_near.append(bool(near[last].all()))
    if len(ends) < _PLANE + 1 or np.mean(is_near) < _SHARE:
        return None
    one, design, width = np.array(ends), np.c_[np.ones(len(at)), np.array(at)], np.array(stds)
    keep = np.array(is_near)
    for _ in range(5):  # strips of which the last points were hidden fall out
        if keep.sum() < _PLANE:
            return Joint(position_m=float(one.max()), slope=np.zeros(2), std_m=math.inf, is_plane=False)
        x = np.linalg.lstsq(design[keep] / width[keep, None], one[keep] / width[keep], rcond=None)[0]
        keep = np.abs(one - design @ x) < _OFF_PLANE * width
    covariance = np.linalg.pinv((design[keep] / width[keep, None]).T @ (design[keep] / width[keep, None]))
    return Joint(position_m=float(x[0]), slope=x[1:], std_m=math.hypot(math.sqrt(covariance[0, 0]), h), is_plane=bool(keep.mean() >= _ON_PLANE))


def ended_at(member: Member, low: Joint | None, high: Joint | None, ends_std_m: float) -> Member:
    """The member with its ends at the joints and its length told. ends_std_m : of the length as it was."""
    length = member.parameters[-1]
    z0, z1 = 0.0 if low is None else low.position_m, length.value_m if high is None else high.position_m
    known = length.std_m if length.observable and length.std_m is not None else ends_std_m
    std = math.sqrt(known**2 + sum(joint.std_m**2 for joint in (low, high) if joint is not None))
    T, normals, covariance = np.array(member.T_world_member), np.array(member.end_normals), np.array(member.covariance)
    T[:3, 3] += T[:3, 2] * z0
    for k, joint in enumerate((low, high)):
        if joint is not None:
            normal = np.array([*(-joint.slope), 1.0]) * (1 if k else -1)
            normals[k] = normal / np.linalg.norm(normal)
    covariance[-1, -1] = std**2
    parameters = (*member.parameters[:-1], dataclasses.replace(length, value_m=z1 - z0, std_m=std, observable=True))
    return dataclasses.replace(member, T_world_member=T, end_normals=normals, covariance=covariance, parameters=parameters)
