"""Sections that are rarely or never made: of one half seen, its body and the hollow of another look alike, and only this tells them apart.

Of 2,851 rolled shapes (sections.csv) no I has flanges thicker than 0.24 of its depth, no C than 0.15. What explains points with flanges that leave
only a slot between them has usually turned a section inside out: the slot is the web. Nor has any a web of more than 1.54 times its flange, or one
that takes up more than 0.27 of the flange's width: such a web is a place where something hid the rest of a face.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from scan2fea.estimation.likelihood import Layout
from scan2fea.types import FloatArray

_THICKEST = {"I": 0.3, "C": 0.3}  # tf / h
_THICKEST_WEB, _WIDEST_WEB = 3.0, 0.5  # tw / tf, tw / b: about twice the largest
_WALL_MEDIAN, _WALL_SPREAD = 0.045, 0.7  # of t / largest side in sections.csv, and of its log over all families of thin walls
WEB_MEDIAN, _WEB_SPREAD = 0.65, 0.5  # of tw / tf there, and of its log
_PRICE = 1e4  # BIC units: taken only where nothing else comes near


def implausible_price(family: str, values: Mapping[str, float]) -> float:
    """What a section that nobody makes costs in BIC units; 0 for all others."""
    if "tw" not in values:
        return 0.0
    is_none = values["tf"] > _THICKEST.get(family, math.inf) * values["h"]
    is_none |= values["tw"] > min(_THICKEST_WEB * values["tf"], _WIDEST_WEB * values["b"])
    return _PRICE if is_none else 0.0


def slenderness_price(layout: Layout, theta: FloatArray, names: Sequence[str]) -> float:
    """What implausible walls cost, in BIC units: log(t / largest side) of 2,600 rolled and hollow sections is 0.045 within a factor of two, and a web
    is 0.65 of its flange (990 rolled I, C and T: within a fifth; welded ones are let vary by half). Half an I is a C with a web of half its flange.

    names : the walls that the points tell of. One within the noise is judged at half a sigma: the data do not say that it is thinner.
    """
    if not names:
        return 0.0
    wall = {name: max(layout.get(theta, name), 0.5 * layout.sigma(theta)) for name in names}
    price = (math.log(min(wall.values()) / float(layout.values(theta).max()) / _WALL_MEDIAN) / _WALL_SPREAD) ** 2
    if "tw" in wall and "tf" in wall:
        price += (math.log(wall["tw"] / wall["tf"] / WEB_MEDIAN) / _WEB_SPREAD) ** 2
    return price


def usual_wall(outer: FloatArray) -> float:
    """Of a tube of those outer dimensions, m: where no point tells of it."""
    return min(_WALL_MEDIAN * float(outer.max()), 0.25 * float(outer.min()))
