"""One section, one name: an L whose legs change places, a tube or a bar turned by a quarter are the same thing."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from scan2fea.estimation.likelihood import Layout
from scan2fea.kernel.section_likelihood import faces
from scan2fea.types import FloatArray

_PAIRS = {"L": ("a", "b"), "RHS": ("h", "b"), "rect": ("b", "t")}  # the first is the longer


def canonical(layout: Layout, theta: FloatArray, held: Collection[str] = ()) -> tuple[Layout, FloatArray, bool]:
    """The longer leg of an L as a, the longer side of RHS as h and of rect as b; True where they changed places.

    Dimensions that are `held` keep their names.
    An L changes them by a half turn of the frame about x: (x, y, z) -> (x, -y, -z), zeta -> -zeta. The others turn by a quarter about z.
    """
    out = theta.copy()
    place = layout.place
    if "roll" in place:
        out[place["roll"]] = math.remainder(theta[place["roll"]], 2 * math.pi)
    pair = _PAIRS.get(layout.family)
    if pair is None or any(name in held for name in pair) or layout.get(theta, pair[0]) >= layout.get(theta, pair[1]):
        return layout, out, False
    first, second = place[pair[0]], place[pair[1]]
    out[first], out[second] = theta[second], theta[first]
    turn = -theta[place["roll"]] - math.pi / 2 if layout.family == "L" else theta[place["roll"]] + math.pi / 2
    out[place["roll"]] = math.remainder(turn, 2 * math.pi)
    if layout.family == "L":
        for name, i in place.items():
            degree = 1 if name.startswith("tilt") else int(name[-1]) if name.startswith(("bow", "twist")) else 0
            odd = -1.0 if degree % 2 else 1.0
            if name == "cy" or name.startswith(("tilt_y", "bow_y", "twist")):
                out[i] = -odd * theta[i]
            elif name.startswith(("tilt_x", "bow_x")):
                out[i] = odd * theta[i]
    return _with_turned_faces(layout, out)


def _with_turned_faces(layout: Layout, theta: FloatArray) -> tuple[Layout, FloatArray, bool]:
    """The free weights under the new names of their faces, in the layout's order of faces."""
    names = faces(layout.family)
    before = [names[int(i)] for i in turned_weight(layout.family, np.arange(len(names), dtype=float))]
    pairs = [(new, old) for new, old in zip(names, before, strict=True) if old in layout.free_faces]
    turned = replace(layout, free_faces=tuple(new for new, _ in pairs))
    out = theta.copy()
    for new, old in pairs:
        out[turned.place[f"weight_{new}"]] = theta[layout.place[f"weight_{old}"]]
    return turned, out, True


def turned_weight(family: str, weight: FloatArray) -> FloatArray:
    """(f,) weights of the faces of a section whose sides have changed places (L, RHS, rect), to go with `canonical`."""
    if family == "L":  # A_OUTER A_TOE A_INNER B_INNER B_TOE B_OUTER: the mirror image runs backwards
        return weight[::-1].copy()
    if family == "rect":  # BOTTOM RIGHT TOP LEFT: the axes turn by +90 degrees, so what was RIGHT is now at the bottom
        return np.roll(weight, -1)
    return np.concatenate([np.roll(weight[:4], -1), np.roll(weight[4:], 1)])  # inner: LEFT TOP RIGHT BOTTOM
