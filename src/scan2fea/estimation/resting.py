"""What rests on a plane ends there: the scanner never sees that face, and points near the plane were taken for the plane's."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from scan2fea.kernel.transforms import rigid
from scan2fea.types import FloatArray, Member

PARALLEL = math.cos(math.radians(3.0))  # a face and the plane it rests on
REACH_SPACINGS, REACH_SIGMAS = 6.0, 6.0  # how far above its plane the lowest points of a thing may have been cut off


def rested(member: Member, contact: FloatArray, spacing_m: float) -> Member:
    """The member up to the plane it rests on: an end of any straight member, or a side of a bar.

    contact : (n, 3) points of the face that rests, on the plane (`segmentation.contact`). The member comes back as it was where no face of it is
    parallel to the plane and near it. A dimension that reaches the plane is observed; its standard deviation
    stays that of the fitted edge, which is the larger.
    """
    if len(contact) < 3 or member.bow.any() or member.twist.any():
        return member
    T = np.asarray(member.T_world_member)
    local = (contact - T[:3, 3]) @ T[:3, :3]
    middle = local.mean(0)
    normal = np.linalg.svd(local - middle, full_matrices=False)[2][2]
    axis = int(np.argmax(np.abs(normal)))
    if abs(normal[axis]) < PARALLEL:
        return member
    names = [p.name for p in member.parameters]
    if axis == 2:
        name, low, high = "length", 0.0, member.values()["length"]
    elif member.family == "rect":
        name = ("b", "t")[axis]
        low, high = -member.values()[name] / 2, member.values()[name] / 2
    else:
        return member
    at, is_low = middle[axis], abs(middle[axis] - low) < abs(middle[axis] - high)
    gap = (low - at) if is_low else (at - high)
    if not -REACH_SIGMAS * member.sigma_m <= gap <= REACH_SPACINGS * spacing_m + REACH_SIGMAS * member.sigma_m:
        return member
    shift = np.zeros(3)
    shift[axis] = (-gap if is_low else 0.0) if axis == 2 else (-gap / 2 if is_low else gap / 2)
    moved = T @ rigid(np.eye(3), shift)
    k = names.index(name)
    before = member.parameters[k]
    std = member.sigma_m if before.std_m is None else before.std_m  # one point's noise where the edge alone told nothing
    covariance = np.array(member.covariance)
    covariance[k, k] = std**2
    grown = replace(before, value_m=float(high - low + gap), std_m=std, observable=True)
    ends = np.array(member.end_normals)
    if axis == 2:
        ends[0 if is_low else 1] = normal * (math.copysign(1.0, normal[2]) * (-1 if is_low else 1))
    parameters = (*member.parameters[:k], grown, *member.parameters[k + 1 :])
    return replace(member, parameters=parameters, T_world_member=moved, end_normals=ends, covariance=covariance)
