"""How the places of a section move when one of its dimensions grows: walls, flanges and fillets as rigid pieces, the stretch in between.

A member whose section changes along its axis is its least section swept, every place of it displaced by D(place) times what the dimension has grown
there. D is piecewise linear in one coordinate (or radial), exact for corners, and its inverse takes points back to the least section.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.types import FloatArray, Value

RADIAL = 2
_RIGID = (0.25, 0.75)  # of a leg or half a web: from its root and from its end, what moves as one piece (fillets and toes lie there)
CHANGING: Mapping[str, tuple[str, ...]] = {
    "L": ("a", "b"),
    "I": ("h", "b"),
    "C": ("h", "b"),
    "T": ("h", "b"),
    "RHS": ("h", "b"),
    "rect": ("b", "t"),
    "CHS": ("d",),
    "round": ("d",),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Stretch(Value):
    """axis : 0 (x), 1 (y) or 2 (radial): the coordinate that moves.   at (k,) rising, metres; shift (k,): displacement there for a growth of 1.

    Beyond the first and the last the shift stays.
    """

    axis: int
    at: FloatArray
    shift: FloatArray

    def moves(self, xy: FloatArray) -> FloatArray:
        """(n, 2) displacement of places (n, 2) of the least section for a growth of 1."""
        out = np.zeros_like(np.asarray(xy, float))
        if self.axis != RADIAL:
            out[:, self.axis] = np.interp(xy[:, self.axis], self.at, self.shift)
            return out
        r = np.linalg.norm(xy, axis=1)
        return np.asarray(xy * (np.interp(r, self.at, self.shift) / np.where(r > 0, r, 1.0))[:, None])

    def undone(self, xy: FloatArray, growth: FloatArray) -> FloatArray:
        """(n, 2) where the places (n, 2) of a section grown by growth (n,) lie in the least one."""
        return self.undone_with_density(xy, growth)[0]

    def undone_with_density(self, xy: FloatArray, growth: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As `undone`; and (n,) the logarithm of the area there over the area here, with its derivative by the growth."""
        u = np.linalg.norm(xy, axis=1) if self.axis == RADIAL else xy[:, self.axis]
        knots = self.at[None, :] + growth[:, None] * self.shift[None, :]
        k = np.clip((u[:, None] >= knots).sum(1) - 1, 0, len(self.at) - 2)
        rows = np.arange(len(u))
        low, high = knots[rows, k], knots[rows, k + 1]
        share = (u - low) / np.where(high > low, high - low, 1.0)
        inside = self.at[k] + share * (self.at[k + 1] - self.at[k])
        back = np.where(u <= knots[:, 0], u - knots[:, 0] + self.at[0], np.where(u >= knots[:, -1], u - knots[:, -1] + self.at[-1], inside))
        slope = np.where((u <= knots[:, 0]) | (u >= knots[:, -1]), 0.0, (np.diff(self.shift) / np.diff(self.at))[k])
        with np.errstate(invalid="ignore", divide="ignore"):  # a stretch that folds has no density: nan, and the step to it is refused
            density, by_growth = -np.log1p(growth * slope), -slope / (1 + growth * slope)
        if self.axis == RADIAL:
            ratio = back / np.where(u > 0, u, 1.0)
            moved = np.interp(back, self.at, self.shift) / (1 + growth * slope)
            density = density + np.log(np.maximum(ratio, 1e-12))
            by_growth = by_growth - moved / np.maximum(back, 1e-12)
            return np.asarray(xy * ratio[:, None]), density, by_growth
        out = np.array(xy, float)
        out[:, self.axis] = back
        return out, density, by_growth


def stretch_of(family: str, values: Mapping[str, float], dimension: str, side: int = 0) -> Stretch:
    """The stretch of a dimension of a family.

    side : for dimensions that lie centred in the section's frame, 1 or -1 keeps the face of larger or smaller coordinate where it is, 0 lets both
    move alike. Others grow away from the corner, back or flange they are measured from, and take 0. Raises UsageError for a dimension that cannot
    change.
    """
    walls = {"h": "tf" if family in ("I", "C", "T") else "t", "b": "tw" if family in ("I", "C", "T") else "t", "a": "t"}
    require(dimension in CHANGING.get(family, ()), UsageError, f"dimension {dimension!r} of a {family} cannot change along the member")
    size = values[dimension]
    if family == "round":
        return Stretch(axis=RADIAL, at=np.array([0.0, _RIGID[0] * size]), shift=np.array([0.0, 0.5]))
    if family == "CHS":
        return Stretch(axis=RADIAL, at=np.array([0.0, 1e-3 * size]), shift=np.array([0.5, 0.5]))
    if family == "rect":
        return _centred(0 if dimension == "b" else 1, size / 2, side)
    axis = 0 if dimension == "a" or (dimension == "b" and family != "L") else 1
    wall = values[walls[dimension]]
    if family == "L" or (family, dimension) == ("C", "b"):
        low, high = (wall + share * (size - wall) for share in _RIGID)
        return Stretch(axis=axis, at=np.array([low, high]), shift=np.array([0.0, 1.0]))
    if (family, dimension) == ("T", "h"):
        low, high = (wall + share * (size - wall) for share in _RIGID)
        return Stretch(axis=1, at=np.array([-high, -low]), shift=np.array([-1.0, 0.0]))
    if dimension == "b" and family in ("I", "T"):  # flanges grow on both sides of the web
        near, far = (wall / 2 + share * (size - wall) / 2 for share in _RIGID)
        return _sided(Stretch(axis=0, at=np.array([-far, -near, near, far]), shift=np.array([-0.5, 0.0, 0.0, 0.5])), side)
    return _centred(axis, size / 2 - wall, side)


def _centred(axis: int, half: float, side: int) -> Stretch:
    """Both halves move apart; between them the clear width is stretched."""
    reach = _RIGID[1] * half
    return _sided(Stretch(axis=axis, at=np.array([-reach, reach]), shift=np.array([-0.5, 0.5])), side)


def _sided(stretch: Stretch, side: int) -> Stretch:
    return stretch if not side else Stretch(axis=stretch.axis, at=stretch.at, shift=stretch.shift - 0.5 * side)
