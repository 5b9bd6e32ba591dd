"""What rests on a plane ends there: the scanner never sees that face, and points near the plane were taken for the plane's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.sections import section
from scan2fea.kernel.transforms import rigid
from scan2fea.types import FloatArray, Footing, Member

PARALLEL = math.cos(math.radians(3.0))  # a face and the plane it rests on
REACH_SPACINGS, REACH_SIGMAS = 6.0, 6.0  # how far above its plane the lowest points of a thing may have been cut off
_TAKEN = 3.0  # bands of a plane, up to which points of the object may have gone to it
_ASTRAY, _LEAST = 3.5, 8  # spacings beside an end (`segmentation.around` gives no more of the other bodies), and points there
END = "END"


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
    before = member.parameters[names.index(name)]
    std = member.sigma_m if before.std_m is None else before.std_m  # one point's noise where the edge alone told nothing
    moved = _grown(member, name, high - low + gap, std, shift)
    return _ended(moved, is_low, normal) if axis == 2 else moved


def standing(member: Member, footings: Sequence[Footing]) -> Member:
    """The member with each end that stands on a plane at that plane: the points of its foot went to the plane, and it came out short.

    What hovers by less than the plane took looks the same: the length may be off by as much as the end was moved, evenly spread. An end against
    another object stays where its points stop, and is known no better than how far that is from the face: either may have points of the other.
    """
    for footing in footings:
        length = member.parameters[-1]
        if member.bow.any() or member.twist.any() or member.change is not None or not length.observable or length.std_m is None:
            return member
        on = stands_on(member, footing)
        if on is None:
            continue
        is_low, gap, normal = on
        std = math.hypot(length.std_m, footing.std_m, gap / math.sqrt(3))
        if not footing.is_support:
            member = _grown(member, length.name, length.value_m, std, np.zeros(3))
            continue
        moved = _grown(member, length.name, length.value_m + gap, std, np.array([0.0, 0.0, -gap if is_low else 0.0]))
        member = replace(_ended(moved, is_low, normal), seated=(*(name for name in member.seated if name != END), END))
    return member


def abutting(member: Member, spacing_m: float, covers: Sequence[FloatArray], is_bare: tuple[bool, bool]) -> Member:
    """The member, its length less sure where others touch an end: it is known no better than how far their points are, as in `standing`.

    spacing_m : of its own points.   covers : (k, 3) points of each other body around, m.   is_bare : no face seen of the low end, of the high one.
    """
    length = member.parameters[-1]
    if length.std_m is None or not length.observable or length.source == "fixed" or not covers or not any(is_bare):
        return member
    corners = np.concatenate(section(member.family, member.values()).loops)
    local = sweep_of_member(member).coordinates(np.concatenate(covers))
    local = local[((local[:, :2] >= corners.min(axis=0)) & (local[:, :2] <= corners.max(axis=0))).all(axis=1)]
    variance = length.std_m**2
    for beyond in (b for b, bare in ((-local[:, 2], is_bare[0]), (local[:, 2] - length.value_m, is_bare[1])) if bare):
        near = np.abs(beyond) <= _ASTRAY * spacing_m + REACH_SIGMAS * member.sigma_m
        variance += float(np.median(beyond[near])) ** 2 / 3 if near.sum() >= _LEAST else 0.0
    return _grown(member, length.name, length.value_m, math.sqrt(variance), np.zeros(3)) if variance > length.std_m**2 else member


def stands_on(member: Member, footing: Footing) -> tuple[bool, float, FloatArray] | None:
    """Whether the low end is at that plane or the high one, its gap (m) and the plane's normal (3,) in the member's frame; None where neither is."""
    T, length = np.asarray(member.T_world_member), member.values()["length"]
    normal = footing.normal @ T[:3, :3]
    if abs(normal[2]) < PARALLEL:
        return None
    at = float(footing.offset_m - footing.normal @ T[:3, 3]) / float(normal[2])
    is_low = abs(at) < abs(at - length)
    gap = -at if is_low else at - length
    return (is_low, gap, normal) if -REACH_SIGMAS * member.sigma_m <= gap <= _TAKEN * footing.band_m + REACH_SIGMAS * member.sigma_m else None


def _grown(member: Member, name: str, value_m: float, std_m: float, shift: FloatArray) -> Member:
    """The member with one dimension made anew and told, and its frame moved by shift (3,) within itself."""
    k = [p.name for p in member.parameters].index(name)
    covariance = np.array(member.covariance)
    covariance[k, k] = std_m**2
    told = replace(member.parameters[k], value_m=float(value_m), std_m=std_m, observable=True)
    parameters = (*member.parameters[:k], told, *member.parameters[k + 1 :])
    moved = np.asarray(member.T_world_member) @ rigid(np.eye(3), shift)
    return replace(member, parameters=parameters, T_world_member=moved, covariance=covariance)


def _ended(member: Member, is_low: bool, normal: FloatArray) -> Member:
    """The member with one end along a plane of that normal (3,), either way, in the member's frame."""
    ends = np.array(member.end_normals)
    ends[0 if is_low else 1] = normal * (math.copysign(1.0, normal[2]) * (-1 if is_low else 1))
    return replace(member, end_normals=ends)
