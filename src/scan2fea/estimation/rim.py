"""The wall of a tube from its rim: an end face that was scanned reaches inward as far as the material does.

From outside a tube shows no wall. Where its end faces were scanned, their points lie evenly over the depth 0 .. t below the outer faces, blurred
by the noise: the inner edge is known as any edge is (`ends.py`). Near an end plane the depth is a mixture of the outer face (at 0), the rim, the
inner face (at t: one looks into a tube) and strays. The shares are profiled out; t is averaged over a flat prior and over how much of the noise
blurs it. What the same depths hold just beside the end plane is no rim: dents, fillets and strays are there too. The sides of the section must
tell the same wall, and nothing may lie farther in: how far a scan reaches is no edge, but it seldom ends at one depth all round.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping

import numpy as np

from scan2fea.estimation.observability import RELATIVE, RESOLVED
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.noise_kernels import kernel_at, kernel_parts
from scan2fea.types import FloatArray, Member, Value

BAR_OF = {"RHS": "rect", "CHS": "round"}  # what looks the same from outside
_THICKEST = 0.25  # of the smaller side: no wall is thicker (sections.csv: 0.18 at most)
_CORNER = 0.1  # of the smaller side: corners of real tubes are round
_DEEP = 4.0  # sigma on either side of a plane: one point in 30,000 lies beyond
_SURE = 0.05  # of the wall
_LEAST = 20  # points of the rim
_CAP, _EMPTY = 1 / 3, 0.1  # a rim that was scanned is at least that dense against the sides; what lies within it at most that against the rim
_BLURS = (1.0, 0.4, 0.1)  # of the noise: what blurs a rim that was seen head on lies along its rays, not across it
_GAIN = 15.0  # log units by which points without a rim must be unlikelier
_AGREE, _MILL = 4.0, 0.1  # standard deviations, and part of a wall, within which the sides of a section tell the same
_SIDE_POINTS = 8
_GRID, _ZOOMS, _ROUNDS, _DROP = 31, 4, 25, 14.0
_EDGE, _SPIKE, _PER_S = 1000, 500, 4  # noise is taken for at least that part of the depths, of edges and of faces; cells to a standard deviation


def with_rim(points: FloatArray, member: Member, spacing_m: float = 0.0) -> Member:
    """The member, a tube whose wall is not observable, with the wall that its rim shows; the member as it is where no rim does.

    The wall is observable where it is known to a twentieth (what a volume may be off by); else it is an estimate with a spread.

    points : (n, 3) metres.   spacing_m : of points that keep a distance from each other, 0 of points at random.
    """
    told = {p.name: p.observable for p in member.parameters}
    if member.family not in BAR_OF or told["t"] or not all(told[name] for name in told if name not in ("t", "length")):
        return member
    found = _rim_wall(_Rim.of(points, member))
    if found is None:
        return member
    wall, std = found
    outer = max((p.std_m or 0.0) / 2 for p in member.parameters if p.name not in ("t", "length"))
    std = math.sqrt(std**2 + outer**2 + spacing_m**2 / 3)
    if not std < RELATIVE * wall:
        return member
    at = next(k for k, p in enumerate(member.parameters) if p.name == "t")
    covariance = np.array(member.covariance, float)
    covariance[at], covariance[:, at] = 0.0, 0.0
    sure = std < _SURE * wall
    covariance[at, at] = std**2 if sure else 0.0
    seen = dataclasses.replace(
        member.parameters[at], value_m=wall, std_m=std if sure else None, observable=sure, source="fitted", spread_m=None if sure else std
    )
    parameters = (*member.parameters[:at], seen, *member.parameters[at + 1 :])
    return dataclasses.replace(member, covariance=covariance, parameters=parameters, families=hollow(member.family, member.families))


def hollow(tube: str, families: Mapping[str, float]) -> dict[str, float]:
    """The posterior of the families where the ends are seen to be open: the bar's is the tube's too."""
    own = dict(families)
    own[tube] = own.get(tube, 0.0) + own.pop(BAR_OF[tube], 0.0)
    return own


def is_unsure(member: Member) -> bool:
    """Whether a rim shows the wall of the tube, but not well enough to vouch for it."""
    return any(p.name == "t" and not p.observable for p in member.parameters)


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class _Rim(Value):
    """Depths (n,) below the outer faces of the points near the end planes, and which end and side each belongs to (0 .. 7).

    beside : the same of as much of the member just beside them.   inner, inner_beside : of points farther in than any wall, in as much space there.
    top : the greatest depth that is looked at.   length : of the sides that are looked at, one end, m; farther in than `flat` less, by `narrows` per
    metre of depth.   core : area farther in than any wall, m2.   density : of the sides, points per m2.
    """

    depth: FloatArray
    side: FloatArray
    beside: FloatArray
    beside_side: FloatArray
    inner: FloatArray
    inner_beside: FloatArray
    top: float
    length: float
    core: float
    density: float
    flat: float
    narrows: float
    sigma: float
    noise: str

    @classmethod
    def of(cls, points: FloatArray, member: Member) -> _Rim:
        values, sigma = member.values(), member.sigma_m
        local = sweep_of_member(member).coordinates(points)
        x, y = local[:, 0], local[:, 1]
        if member.family == "CHS":
            radius = values["d"] / 2
            top, side = _THICKEST * values["d"], (np.floor(2 * np.arctan2(y, x) / math.pi) % 4).astype(np.int64)
            depth, used = radius - np.hypot(x, y), np.ones(len(x), bool)
            length, core, outline, flat = 2 * math.pi * radius, math.pi * (radius - top) ** 2, 2 * math.pi * radius, 0.0
            narrows = 2 * math.pi
        else:
            b, h = values["b"], values["h"]
            top, flat, narrows = _THICKEST * min(b, h), _CORNER * min(b, h), 8.0
            across, up = b / 2 - np.abs(x), h / 2 - np.abs(y)
            flank = across < up
            depth, used = np.minimum(across, up), np.maximum(across, up) > flat
            side = np.where(flank, x > 0, 2 + (y > 0)).astype(np.int64)
            length, core, outline = 2 * (b + h) - 8 * flat, (b - 2 * top) * (h - 2 * top), 2 * (b + h)
        end_std = next(p.std_m or 0.0 for p in member.parameters if p.name == "length")
        reach = _DEEP * max(sigma, end_std)
        ends = zip((0.0, values["length"]), member.end_normals, strict=True)
        away = np.stack([(local - np.array([0.0, 0.0, z])) @ normal for z, normal in ends])
        end = np.argmin(np.abs(away), axis=0)
        near = np.abs(away).min(axis=0)
        within = away.max(axis=0) < -reach
        here, beside, twice = near < reach, within & (near < 2 * reach), within & (near < 3 * reach)  # half of `here` is within the member
        on_face = (np.abs(depth) < _DEEP * sigma) & within
        own = used & (depth > -_DEEP * sigma) & (depth < top)
        density = float(on_face.sum()) / (outline * max(values["length"] - 2 * reach, 1e-300))
        place = side + 4 * end
        return cls(
            depth=depth[here & own], side=place[here & own], beside=depth[beside & own], beside_side=place[beside & own],
            inner=place[here & (depth >= top)], inner_beside=place[twice & (depth >= top)], top=top, length=length, core=core, density=density,
            flat=flat, narrows=narrows, sigma=sigma, noise=member.noise,
        )  # fmt: skip

    def at(self, places: tuple[int, ...]) -> _Rim:
        """The same of some ends and sides."""
        own = {name: getattr(self, name)[np.isin(getattr(self, of), places)] for name, of in _PLACED}
        return dataclasses.replace(self, **own)

    def room(self, depth: FloatArray) -> FloatArray:
        """How much of the rim there is at a depth, of its length at the outer face."""
        return np.asarray(1 - self.narrows / self.length * np.maximum(depth - self.flat, 0.0))

    def width(self, depth: FloatArray) -> FloatArray:
        """The same summed from the outer face on, m."""
        return np.asarray(depth - self.narrows / (2 * self.length) * np.maximum(depth - self.flat, 0.0) ** 2)

    def beyond(self, depth: float) -> int:
        """Points deeper than that near the end planes, less those beside them."""
        return int((self.depth > depth).sum()) - int((self.beside > depth).sum())


_PLACED = (("depth", "side"), ("side", "side"), ("beside", "beside_side"), ("beside_side", "beside_side"), ("inner", "inner"),
           ("inner_beside", "inner_beside"))  # fmt: skip


def _rim_wall(rim: _Rim) -> tuple[float, float] | None:
    """Wall and its standard deviation (m) from the ends whose rim was seen; None where none was, or where its edge is in doubt."""
    skin = _DEEP * rim.sigma
    ends = [e for e in (0, 1) if rim.at(tuple(range(4 * e, 4 * e + 4))).beyond(min(skin, rim.top / 4)) >= _LEAST]
    if not ends:
        return None
    own = rim.at(tuple(4 * e + k for e in ends for k in range(4)))
    fit = _edge(own)
    if not (fit.std < RELATIVE * fit.wall and RESOLVED * rim.sigma < fit.wall < rim.top - skin and fit.gain > _GAIN):
        return None
    strip = len(ends) * rim.length * float(rim.width(np.array(fit.wall)))
    hollow = len(ends) * (rim.core + rim.length * max(rim.top - fit.wall - skin, 0.0))
    within = own.beyond(fit.wall + skin + _DEEP * fit.std) + len(own.inner) - len(own.inner_beside)
    dense = fit.n_rim / strip
    if fit.n_rim < _LEAST or dense < _CAP * rim.density or dense * hollow < _LEAST or within > _EMPTY * dense * hollow:
        return None
    sides = [one for one in (rim.at((4 * e + k,)) for e in ends for k in range(4)) if one.beyond(min(skin, fit.wall / 2)) >= _SIDE_POINTS]
    walls = [_edge(one) for one in sides]
    agree = sum(abs(w.wall - fit.wall) < _AGREE * math.hypot(w.std, fit.std) + _MILL * fit.wall for w in walls)
    return (fit.wall, fit.std) if agree == len(walls) > 1 else None


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Edge:
    """wall, std : mean and spread, m.   n_rim : points that lie on the rim.   gain : log units over no rim."""

    wall: float
    std: float
    n_rim: float
    gain: float


def _edge(rim: _Rim) -> _Edge:
    """The inner edge of the rim over a flat prior on 0 .. top, the shares of greatest likelihood at each place of it."""
    n = len(rim.depth)
    if not n:
        return _Edge(wall=0.0, std=math.inf, n_rim=0.0, gain=0.0)
    s = max(rim.sigma, rim.top / _EDGE)
    counts, bounds = np.histogram(rim.depth, math.ceil(_PER_S * np.ptp(rim.depth) / s) + 1)
    cells = _Cells(depth=((bounds[1:] + bounds[:-1]) / 2)[counts > 0], count=counts[counts > 0].astype(float))
    low, high = s, rim.top
    for zoom in range(_ZOOMS + 1):
        walls = np.linspace(low, high, _GRID)
        told = [_levels(cells, walls, rim, max(blur * rim.sigma, rim.top / _EDGE)) for blur in _BLURS]
        level, share = np.stack([one[0] for one in told]), np.stack([one[1] for one in told])
        step = walls[1] - walls[0]
        if zoom < _ZOOMS:
            likely = np.flatnonzero(level.max(axis=0) > level.max() - _DROP)
            low, high = max(walls[likely[0]] - step, s / 2), min(walls[likely[-1]] + step, rim.top)
    weight = np.exp(level - level.max())
    weight /= weight.sum()
    wall = float(weight.sum(axis=0) @ walls)
    std = math.sqrt(float(weight.sum(axis=0) @ (walls - wall) ** 2) + step**2 / 12)
    bare = _levels(cells, walls[:1], rim, s, with_rim=False)[0][0]
    return _Edge(wall=wall, std=std, n_rim=n * float((weight * share).sum()), gain=float(level.max() - bare))


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class _Cells(Value):
    """(c,) depths and how many points lie there."""

    depth: FloatArray
    count: FloatArray


def _levels(cells: _Cells, walls: FloatArray, rim: _Rim, blur_m: float, *, with_rim: bool = True) -> tuple[FloatArray, FloatArray]:
    """(g,) greatest log likelihood over the shares at each wall (g,), by EM (Dempster, Laird, Rubin 1977), and the share of the rim."""
    depth, inward = cells.depth, cells.depth - walls[:, None]
    edge = _Law(rim.noise, blur_m)
    face = _Law(rim.noise, max(rim.sigma, rim.top / min(float(cells.count.sum()), _SPIKE)))  # narrower it would be that of one point
    room = rim.room(depth)
    outer = np.broadcast_to(face.density(depth), inward.shape)
    stray = np.broadcast_to(room / (rim.top + _DEEP * rim.sigma), inward.shape)
    parts = np.stack([outer, stray])
    if with_rim:
        rims = room * (edge.mass(depth) - edge.mass(inward)) / rim.width(walls)[:, None]
        parts = np.stack([outer, stray, rims, face.density(inward)])
    share = np.full((len(parts), len(walls)), 1 / len(parts))
    for _ in range(_ROUNDS):
        own = share[:, :, None] * parts
        share = (own / np.maximum(own.sum(axis=0), 1e-300)) @ cells.count / cells.count.sum()
    level = np.log(np.maximum((share[:, :, None] * parts).sum(axis=0), 1e-300)) @ cells.count
    return level, share[2] if with_rim else share[0]


class _Law:
    """Density and mass below of the noise, of standard deviation s (m)."""

    def __init__(self, noise: str, s: float) -> None:
        self._at, self._density, self._mass = _table(noise)
        self._s = s

    def density(self, x: FloatArray) -> FloatArray:
        return np.asarray(np.interp(x / self._s, self._at, self._density) / self._s)

    def mass(self, x: FloatArray) -> FloatArray:
        return np.asarray(np.interp(x / self._s, self._at, self._mass))


@functools.lru_cache
def _table(noise: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The law of unit variance at steps of a hundredth."""
    at = np.linspace(-8.0, 8.0, 1601)
    told = np.array([[w * v for v in kernel_at(z, h, s)] for z in at for w, h, s in kernel_parts(noise)])
    density, _, tail = told.reshape(len(at), -1, 3).sum(axis=1).T
    return at, density, np.where(at < 0, tail, 1 - tail)
