"""A wall of a tube of which one face was seen: whether that is its outer or its inner one is told by the walls beside it, not by the face."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.estimation.likelihood import Layout
from scan2fea.kernel.section_likelihood import faces
from scan2fea.types import BoolArray, FloatArray

_SIDES = {"RIGHT": ("b", 1, 0), "LEFT": ("b", -1, 0), "TOP": ("h", 0, 1), "BOTTOM": ("h", 0, -1)}  # dimension, and the way out
_LEAST = 3.0  # walls that a side is wide at least


def other_faces(layout: Layout, theta: FloatArray, seen: BoolArray) -> list[FloatArray]:
    """Unknowns of an RHS with one such wall taken for the other one: the tube a wall wider or narrower there, its other walls where they are.

    seen : (f,) in the order of `faces`.
    """
    is_seen = dict(zip(faces("RHS"), seen.tolist(), strict=True))
    wall, roll, turned = layout.get(theta, "t"), layout.get(theta, "roll"), []
    for side, (name, x, y) in _SIDES.items():
        if is_seen[f"{side}_OUTER"] == is_seen[f"{side}_INNER"]:
            continue
        grow = wall if is_seen[f"{side}_OUTER"] else -wall
        other = np.array(theta)
        other[layout.place[name]] = max(other[layout.place[name]] + grow, _LEAST * wall)
        other[layout.place["cx"]] += 0.5 * grow * (x * math.cos(roll) - y * math.sin(roll))
        other[layout.place["cy"]] += 0.5 * grow * (x * math.sin(roll) + y * math.cos(roll))
        turned.append(other)
    return turned
