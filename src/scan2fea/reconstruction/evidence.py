"""What a finished surface is judged on, and the words its checks share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scan2fea.kernel.distances import Nearest, PointToMesh
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.reconstruction.outside import Flood
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, TriangleMesh, Value

BY_FLOOD, BY_NORMALS = "outside flood", "given normals"  # what told the outside where no sight lines are known
KNOWN_WALL = 0.10  # share of points that must have a wall behind them before anything is said about its thickness
WALL_QUANTILE = 0.25  # the wall is judged by its thinner parts
PATCH, SAME_FACE, SAMPLES = 32, 0.8, 6000  # points about one, the cosine that its own face has at least, and where it is asked
SCATTER_MARGIN = 1.2  # the surface follows the points a little, so their distances are smaller than the noise


@dataclass(frozen=True, eq=False, kw_only=True)
class Ends(Value):
    """Ends of walls on which nothing was measured.

    shares : (s,) of the volume that may hide beyond each.   places : (k, 3) on them.   of : (k,) which of them each is on.
    """

    shares: FloatArray
    places: FloatArray
    of: IntArray

    @property
    def share(self) -> float:
        """Of all, at most 1."""
        return min(1.0, float(self.shares.sum()))


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence(Value):
    """A finished surface and the points it was made from.

    points : (n, 3) raw.   is_inferred : (n,) not measured, or None.   mesh : the closed surface.   smoothed, normals : (n, 3) denoised
    points and their outward normals.   thickness_m : (n,) to the other face, nan where there is none.   gap_m : (n,) to the next surface in
    front, nan likewise.   spacing_m, sigma_m : of the raw points.   n_hidden : of the last points, that only stand for places no ray has reached.
    sensors : (n, 3) where each point was seen from, nan rows where not known, or None.   ends_before : of walls, in other answers to the same points.
    frame : (n,) the scan of each point, negative for none, or None.   between_m : noise of the places of the scans, which is in sigma_m too.
    """

    points: FloatArray
    mesh: TriangleMesh
    smoothed: FloatArray
    normals: FloatArray
    thickness_m: FloatArray
    gap_m: FloatArray
    spacing_m: float
    sigma_m: float
    is_inferred: BoolArray | None = None
    n_hidden: int = 0
    sensors: FloatArray | None = None
    ends_before: tuple[Ends, ...] = ()
    frame: IntArray | None = None
    between_m: float = 0.0

    _ROWS = (("points", "smoothed", "normals", "thickness_m", "gap_m", "is_inferred", "sensors", "frame"),)

    @cached_property
    def nearest(self) -> Nearest:
        """The places of the mesh under the points."""
        return PointToMesh(self.mesh).nearest(self.points)

    @property
    def nearest_measured(self) -> Nearest:
        return self.nearest if self.is_inferred is None else self.nearest.of(~self.is_inferred)

    @property
    def nearest_backed(self) -> Nearest:
        return self.nearest.of(slice(len(self.points) - self.n_hidden)) if self.n_hidden else self.nearest

    @property
    def measured(self) -> FloatArray:
        """The points that no stage has put there."""
        return self.points if self.is_inferred is None else self.points[~self.is_inferred]

    @property
    def backed(self) -> FloatArray:
        """The points that something was seen for: measured, or inferred from a support."""
        return self.points[: len(self.points) - self.n_hidden]


@dataclass(frozen=True, eq=False, kw_only=True)
class Unseen(Value):
    """What is known besides where no sensor position is.

    signed : (n, 3) normals as their side was told first, zero rows where it was not.   flood : the answer that told it; None: the file did.
    polished : (n, 3) normals after the winding rounds.   held : share of the points under which the cut found the inside.   flood_inside : share of
    the volume inside that the ball had reached.
    """

    signed: FloatArray
    flood: Flood | None
    polished: FloatArray
    held: float
    flood_inside: float


def wall_m(evidence: Evidence) -> float:
    """Thickness of the thinner walls (lower quartile over the points), m; nan where fewer than 10 % of the points have one behind them."""
    known = _with_wall(evidence)
    return float(np.quantile(evidence.thickness_m[known], WALL_QUANTILE)) if len(known) else math.nan


def patch_wall_m(evidence: Evidence) -> float:
    """As `wall_m`, of the medians over the PATCH points about each point that face as it does.

    A noise of a third of the wall leaves a fifth of it in the thickness at one point: the thinner quarter of these is thinner than any wall.
    """
    known = _with_wall(evidence)
    if not len(known):
        return math.nan
    rows = known[sampled_rows(len(known), SAMPLES, 0)]
    near = known[k_nearest(evidence.smoothed[known], min(PATCH, len(known)), evidence.smoothed[rows])[1]]
    alike = np.einsum("nkc,nc->nk", evidence.normals[near], evidence.normals[rows]) >= SAME_FACE
    alike[:, 0] = True  # the point itself
    patch = np.nanmedian(np.where(alike, evidence.thickness_m[near], np.nan), axis=1)
    return float(np.quantile(patch, WALL_QUANTILE))


def _with_wall(evidence: Evidence) -> IntArray:
    """Rows of the points with a wall behind them; none where they are too few to speak of walls."""
    known = np.flatnonzero(np.isfinite(evidence.thickness_m))
    return known if len(known) >= max(1.0, KNOWN_WALL * len(evidence.points)) else known[:0]


def scatter_m(evidence: Evidence, distance: FloatArray) -> float:
    """The noise that distances are held against: the stated one, unless half of the points lie much nearer than it would put them.

    Where the noise could not be told it was guessed high, and would excuse anything.
    """
    return min(evidence.sigma_m, SCATTER_MARGIN * 1.4826 * float(np.median(distance)) if len(distance) else 0.0)


def at_most(name: str, value: float, limit: float, says: str, unit: str = "1") -> Check:
    """A check that passes ON its limit; a value that is not a number fails."""
    return Check(name=name, value=value, limit=limit, unit=unit, passed=bool(value <= limit), says=says)


def at_least(name: str, value: float, limit: float, says: str, unit: str = "1") -> Check:
    return Check(name=name, value=value, limit=limit, unit=unit, passed=bool(value >= limit), says=says)


def mm(metres: float) -> str:
    return f"{1e3 * metres:.3g} mm"


def around(points: FloatArray) -> str:
    """Where most of the points are, in words."""
    if not len(points):
        return ""
    x, y, z = np.median(points, axis=0)
    return f", around ({x:.4g}, {y:.4g}, {z:.4g}) m"
