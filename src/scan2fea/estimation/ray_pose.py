"""One way to write a member that has several: the longer leg or side first."""

from __future__ import annotations

import dataclasses

import numpy as np

from scan2fea.kernel.transforms import compose
from scan2fea.types import FloatArray, Member

_LONGER_FIRST = {"L": ("a", "b"), "RHS": ("h", "b"), "rect": ("b", "t")}
# new axes in the old frame: an L is turned about the line between its legs, so that x and y change places; the others turn by 90 degrees about z
_SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def canonical_member(member: Member) -> Member:
    """The same solid with a >= b (L), h >= b (RHS), b >= t (flat bar), dimensions renamed and the frame turned to match."""
    names = _LONGER_FIRST.get(member.family)
    values = member.values()
    if names is None or values[names[0]] >= values[names[1]]:
        return member
    old = [one.name for one in member.parameters]
    order = np.arange(len(old))
    i, j = old.index(names[0]), old.index(names[1])
    order[[i, j]] = j, i
    parameters = tuple(dataclasses.replace(member.parameters[k], name=name) for k, name in zip(order, old, strict=True))
    turned, new = np.eye(4), _SWAP if member.family == "L" else _QUARTER
    turned[:3, :3] = new
    bow: FloatArray = new[:2, :2].T @ member.bow
    twist, normals = member.twist, member.end_normals @ new
    if member.family == "L":
        turned[2, 3] = values["length"]  # the other end comes first
        bow = bow * (-1.0) ** np.arange(2, bow.shape[1] + 2)
        twist = -twist * (-1.0) ** np.arange(1, len(twist) + 1)
        normals = normals[::-1]
    return dataclasses.replace(
        member,
        parameters=parameters,
        T_world_member=compose(member.T_world_member, turned),
        bow=bow,
        twist=twist,
        end_normals=normals,
        covariance=member.covariance[np.ix_(order, order)],
    )
