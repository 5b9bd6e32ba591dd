"""Whether a member explains the points within their noise: not by the rms alone, which a wrong shape with wide noise also brings down.

Six figures, each with what it is measured against:

    pattern   The points are dealt to cells of the member's surface (stretches of the outline x stretches of the length). Noise averages out in a
              cell, a wrong shape does not. What the model itself would show in the same cell (walls as thin as the noise pull the nearest face
              about) is taken from points drawn from it.
    strays    Points off the surface by more than noise. Clutter is thin and anywhere; a second body, a stiffener or a dome is a crowd, and few of
              them are enough where they lie on a surface of their own (`attached.py`). Nobody sees into material: noise and clutter put no more
              of them inside the solid than as near to it outside.
    voids     Empty places enclosed in a face that was seen all around, and on which nothing else lies: holes (`holes.py`); narrow ones that both
              faces of a wall and its inside tell together (`bored.py`), or that make the points far likelier (`hole_fit.py`).
    cuts      Places where a wall was cut through, to the rim or not: its cut was seen (`cuts.py`).
    ends      They are planes (`end_faces.py`).
    noise     The scatter around the member against the scatter of neighbouring points around their own surface.

A departure that mill tolerances allow is none: 1 % of the section's size (EN 10034, EN 10056-2, EN 10210-2 allow that much and more).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtr, chdtrc

from scan2fea.estimation.attached import CHANCE, attached, sunk
from scan2fea.estimation.bored import bored, hole_of
from scan2fea.estimation.cuts import Cut, cuts
from scan2fea.estimation.end_faces import n_not_flat
from scan2fea.estimation.hole_fit import telling_holes
from scan2fea.estimation.holes import Covers, Hole, occupied, uncovered
from scan2fea.estimation.one_skin import is_one_skin
from scan2fea.estimation.outline import edge_lengths, outline_distance
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.noise import noise_sigma, sampled_rows
from scan2fea.kernel.section_likelihood import face_lengths, faces
from scan2fea.kernel.sections import PARAMETERS, section
from scan2fea.types import BoolArray, FloatArray, IntArray, Member, Section, Value

TOLERANCE = 0.01  # of the section's size: mill tolerances
MAX_OFF = 0.1  # share of the points in cells that are off: an unmodelled fillet or a dent, not another shape
MAX_CROWD = 0.05  # share of the points that crowd off the surface
MAX_ATTACHED = 0.01  # share of the points on surfaces of their own off the member: about their share of the volume, of which 1 % is asked
MAX_CLUTTER = 0.3  # share of the points off the surface altogether
MAX_EXCESS = 0.5  # of mill tolerance: noise of the member beyond that of its neighbours
MAX_PATTERN = 0.1  # of the noise, where neighbours do not tell it
MIN_SLENDER = 1.0  # length over the width of the section
_POINTS = 60_000
_MANY_POINTS = 400_000
_CELL_POINTS = 15
_STRAY = 4.0
_NEIGHBOURS = 50  # points: fewer tell no scatter
_FACES_OFF = 24  # stretches of the outline, about
_SE = 4.0
AGAIN = 8  # times that each ray measures the model
_LOCAL_DOUBT = 0.1  # relative: the scatter of neighbours comes out up to 8 % low where noise is 3 % of the section (simulated bars)
_STRAY_DRAWS = 20_000


@dataclass(frozen=True, eq=False, kw_only=True)
class ByRays(Value):
    """voids : holes that were shot through, None where rays do not tell.   again : (m, 2) where the rays of the data would measure the model, in the
    section, `AGAIN` times.   facing : |cosine| between rays and the surface that neighbours show, 0 where these lie in sheets of rays.
    """

    voids: int | None
    again: FloatArray
    facing: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Explanation(Value):
    """explains, reason : the verdict.   off_share : of the points in cells that are off.   pattern_m : rms of what is not noise, over the cells.
    p_value : of the cells' chi-square (strict: dense scans always fail it).   rms_m : of the distance to the surface, strays left out.
    stray_share, crowd_share, attached_share, sunk_share : of the points; the last of those inside the solid, beyond those as near to it outside.
    voids : number of holes.   noise_excess : fitted noise beyond the scatter of neighbours (root of the difference of squares) over mill tolerance,
    nan where neighbours do not tell.   pattern_share : pattern over noise.
    slenderness : length over the greater width of the section.   seen : face -> share of it that points support.
    cells : number of cells that were tested.   cuts : places where no side of a wall was seen, or where it was cut.
    local_sigma_m : scatter about neighbours, nan where these do not tell.
    """

    explains: bool
    reason: str
    off_share: float
    pattern_m: float
    p_value: float
    rms_m: float
    stray_share: float
    crowd_share: float
    attached_share: float
    sunk_share: float
    voids: int
    noise_excess: float
    pattern_share: float
    slenderness: float
    seen: Mapping[str, float]
    cells: int
    cuts: tuple[Cut, ...]
    local_sigma_m: float


def explanation(
    points: FloatArray,
    member: Member,
    sigma_m: float,
    seed: int = 0,
    *,
    along_rays: bool = False,
    by_rays: ByRays | None = None,
    covers: Covers = (),
    local_sigma_m: float | None = None,
) -> Explanation:
    """Test the member against the points (n, 3) it was fitted to.

    along_rays : sigma_m is the noise of the range: across a face seen aslant it is less, and the cells show that as a pattern.
    by_rays : what rays say of holes and of the points of the model; None: places without points are holes, noise is alike in all directions.
    covers : (k, 3) points of each other body around: where one lies on the member, nobody can see whether there is a hole.
    local_sigma_m : scatter about neighbours (nan: they do not tell), where another explanation of the same points has asked for it.
    """
    values = member.values()
    shape = section(member.family, values)
    corners = np.concatenate(shape.loops)
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    width = float(np.ptp(corners, axis=0).max())
    some = points[sampled_rows(len(points), _POINTS, seed)]
    local = sweep_of_member(member).coordinates(some)
    surface = _Surface.of(shape, member, local)
    reach = _STRAY * sigma_m + TOLERANCE * size
    stray = np.abs(surface.distance) > reach
    box = float(np.prod(np.maximum(np.ptp(local, axis=0), 1e-3 * size)))
    crowd = _crowd(local, stray, box)
    side = ~stray & ~surface.on_cap
    among = (local[:, 2] > 0) & (local[:, 2] < values["length"])
    clutter = _Clutter.of(shape, local[among, :2], int((stray & among).sum()), reach, seed)
    again = None if by_rays is None else by_rays.again
    cells = _cells(surface, side, shape, values["length"], sigma_m, size, clutter, seed, 1.0 if along_rays else 0.5, again)
    seen, holes = occupied(shape, surface.edge[side], surface.along[side], surface.z[side], values["length"], sigma_m)
    bare = len(uncovered(holes, member, covers, sigma_m))
    voids = bare if by_rays is None or by_rays.voids is None else by_rays.voids
    wide = face_lengths(member.family, np.array([values[name] for name in PARAMETERS[member.family]]))
    area = values["length"] * float(wide @ np.array([seen[name] for name in faces(member.family)]))
    apart = attached(local[stray], np.abs(surface.distance[stray]), sigma_m, size, float(side.sum()) / max(area, 1e-300), box)
    sunken = sunk(surface.distance, reach)
    if sunken > MAX_ATTACHED * len(some):
        even = np.random.default_rng(seed).uniform(local.min(axis=0), local.max(axis=0), (_POINTS, 3))
        sunken = sunk(surface.distance, reach, _Surface.of(shape, member, even).distance)
    near = some[~stray]
    asked = local_sigma_m is None and len(near) >= _NEIGHBOURS
    local_sigma = noise_sigma(near, seed=seed) if asked else math.nan if local_sigma_m is None else local_sigma_m
    rms = float(np.sqrt(np.mean(surface.distance[~stray] ** 2))) if (~stray).any() else math.nan
    facing = 1.0 if by_rays is None else by_rays.facing  # of noise along rays neighbours scatter by that share
    doubted = (1 + _LOCAL_DOUBT) * local_sigma / facing if facing > 0 else sigma_m
    excess = math.sqrt(max(sigma_m**2 - doubted**2, 0.0)) / (TOLERANCE * size) if math.isfinite(local_sigma) else math.nan
    figures = {
        "off_share": cells.off_share,
        "pattern_m": cells.pattern_m,
        "p_value": cells.p_value,
        "rms_m": rms,
        "stray_share": float(stray.mean()),
        "crowd_share": float(crowd.mean()),
        "attached_share": apart / len(some),
        "sunk_share": sunken / len(some),
        "noise_excess": excess,
        "pattern_share": cells.pattern_m / sigma_m,
        "slenderness": values["length"] / width,
    }
    flank = ~surface.on_cap
    bare_walls = cuts(member, surface.side[flank], surface.edge[flank], surface.along[flank], surface.z[flank], sigma_m)
    not_flat = n_not_flat(surface.side, surface.beyond, sigma_m, reach, values["length"])
    reason = _reason(figures, voids, not_flat, member, along_rays) or _cut(bare_walls, member)
    if not reason and len(shape.loops) > 1 and is_one_skin(local[side], surface.edge[side] >= len(shape.loops[0]), values["length"]):
        reason = (
            f"the {member.family} member would show its inner face where its outer face has no points, and that elsewhere: one skin, of two "
            "sections or an oval; leave it to reconstruction"
        )
    if not reason:  # all else explains the points: the narrow holes are asked for, of more of them
        many = points[sampled_rows(len(points), _MANY_POINTS, seed)]
        narrow = _narrow_holes(many, member, sigma_m, seed, faces_tell=by_rays is None or by_rays.voids is None)
        voids = len(uncovered(narrow, member, covers, sigma_m))
        reason = _reason(figures, voids, not_flat, member, along_rays)
    said = reason or _praise(figures, member, len(holes) - bare)
    return Explanation(explains=not reason, reason=said, voids=voids, seen=seen, cells=cells.n, cuts=bare_walls, local_sigma_m=local_sigma, **figures)


def _narrow_holes(points: FloatArray, member: Member, sigma_m: float, seed: int, *, faces_tell: bool) -> tuple[Hole, ...]:
    """Those that one face alone does not tell, by what walls lack and hold inside, or else by how much likelier the points are with them."""
    local = sweep_of_member(member).coordinates(points)
    narrow = bored(member, local, sigma_m, faces_tell=faces_tell)
    if narrow or not faces_tell:
        return narrow
    return tuple(hole_of(hole.wall, hole.place, hole.radius_m) for hole in telling_holes(member, local, sigma_m, seed))


def _reason(f: Mapping[str, float], voids: int, not_flat: int, member: Member, along_rays: bool) -> str:
    """Why the member does not explain the points; empty where it does."""
    what = f"the {member.family} member"
    if f["slenderness"] < MIN_SLENDER and member.family != "rect":
        return f"{what} would be shorter than its section is wide (length / width {f['slenderness']:.2f}): no member, or only a piece of one"
    if _is_degenerate(member):
        return f"the likeliest section, {what}, has one wall that fills it and one of no thickness: several bodies in one cluster? segment first"
    if f["crowd_share"] > MAX_CROWD:
        return (
            f"{100 * f['crowd_share']:.0f} % of the points crowd off {what} (limit {100 * MAX_CROWD:.0f} %): a second body in one cluster, "
            "or another shape; segment it, or leave it to reconstruction"
        )
    if f["attached_share"] > MAX_ATTACHED:
        return (
            f"{100 * f['attached_share']:.1f} % of the points (limit {100 * MAX_ATTACHED:g} %) lie off {what} on surfaces of their own, as close as "
            "on its faces: a plate in or on it, or a second body; segment it, or leave it to reconstruction"
        )
    if f["sunk_share"] > MAX_ATTACHED:
        return (
            f"{100 * f['sunk_share']:.1f} % of the points (limit {100 * MAX_ATTACHED:g} %) lie inside {what}, where nothing can be seen, and not as "
            "many as near to it outside: it has slots or hollows, or is another shape; leave it to reconstruction"
        )
    if f["stray_share"] > MAX_CLUTTER:
        return f"{100 * f['stray_share']:.0f} % of the points lie off {what} (limit {100 * MAX_CLUTTER:.0f} %)"
    if f["off_share"] > MAX_OFF:
        return (
            f"{100 * f['off_share']:.0f} % of the points (limit {100 * MAX_OFF:.0f} %) lie where the surface departs from {what} by more than noise "
            f"and mill tolerance; the pattern has an rms of {1e3 * f['pattern_m']:.3g} mm"
        )
    if f["noise_excess"] > MAX_EXCESS:
        return (
            f"the points scatter about {what} by more than about their neighbours: {f['noise_excess']:.2f} of mill tolerance "
            f"(limit {MAX_EXCESS:g}); it is another shape, or several"
        )
    max_pattern = MAX_PATTERN * (3 if along_rays else 1)
    if math.isnan(f["noise_excess"]) and f["pattern_share"] > max_pattern:
        return (
            f"the noise is too wide to be told from shape, and {100 * f['pattern_share']:.0f} % of it (limit {100 * max_pattern:.0f} %) "
            f"is pattern about {what}"
        )
    if not_flat:
        return f"{not_flat} end{'s' * (not_flat > 1)} of {what} would be no plane (dished, rounded, or a second body): leave it to reconstruction"
    if voids:
        return f"{voids} hole{'s' if voids > 1 else ''} in faces that were seen all around: {what} has none"
    return ""


def _cut(places: Sequence[Cut], member: Member) -> str:
    """Where the wall was cut through; empty where it was not."""
    cut = [place for place in places if place.is_cut]
    if not cut:
        return ""
    first = cut[0]
    return (
        f"a wall of the {member.family} member was cut through: {first.deep} points lie inside it ({first.by_chance:.2g} by chance) beside a place "
        f"between {first.from_m:.3f} and {first.to_m:.3f} m along it where neither {first.face} nor the side behind it was seen"
    )


def _is_degenerate(member: Member) -> bool:
    """Whether one wall of the section fills it while another has closed up: no section that is made, but what two members side by side show."""
    values = member.values()
    if member.family not in ("I", "C", "T"):
        return False
    fills = max(values["tw"] / values["b"], values["tf"] / values["h"])
    return fills > 0.5 and min(values["tw"], values["tf"]) < 0.05 * max(values["tw"], values["tf"])


def _praise(f: Mapping[str, float], member: Member, n_covered: int) -> str:
    covered = f"; at {n_covered} place{'s' * (n_covered > 1)} another body lies on it, and what is below was not seen" if n_covered else ""
    return (
        f"the {member.family} member explains {100 * (1 - f['stray_share']):.1f} % of the points with an rms of {1e3 * f['rms_m']:.3g} mm; "
        f"{100 * f['off_share']:.1f} % of them lie where it is off by more than noise and mill tolerance{covered}"
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Surface:
    """Per point: signed distance to the solid's surface, nearest edge and place along it, height; distance to the sides and beyond each end plane."""

    distance: FloatArray
    edge: IntArray
    along: FloatArray
    z: FloatArray
    side: FloatArray
    beyond: FloatArray

    @classmethod
    def of(cls, shape: Section, member: Member, local: FloatArray) -> _Surface:
        side, edge, along = outline_distance(shape, local[:, :2])
        ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, member.values()["length"]]])
        beyond = np.stack([(local - end) @ normal for end, normal in zip(ends, member.end_normals, strict=True)], 1)
        farther = beyond.max(axis=1)
        both = (side > 0) & (farther > 0)
        distance = np.where(both, np.hypot(side, farther), np.maximum(side, farther))
        return cls(distance=distance, edge=edge, along=along, z=local[:, 2], side=side, beyond=beyond)

    @property
    def on_cap(self) -> BoolArray:
        """Whether an end plane is nearer than the sides."""
        return np.asarray(self.beyond.max(axis=1) > self.side)


@dataclass(frozen=True, kw_only=True)
class _Cells:
    off_share: float
    pattern_m: float
    p_value: float
    n: int


def _stretches(shape: Section) -> tuple[FloatArray, IntArray]:
    """(edges,) stretches each edge is cut into, and the number of the first of each; the chords of a circle are taken together."""
    lengths = edge_lengths(shape)
    step = lengths.sum() / _FACES_OFF
    count = np.maximum(np.round(lengths / step), 1)
    if len(lengths) > 2 * _FACES_OFF:  # a circle: neighbouring chords share a stretch
        return np.ones(len(lengths)), np.floor(np.cumsum(lengths) / step - 1e-9).astype(np.int64)
    return count, np.r_[0, np.cumsum(count)[:-1]].astype(np.int64)


def _stretch_of(shape: Section, edge: IntArray, along: FloatArray) -> IntArray:
    lengths = edge_lengths(shape)
    count, first = _stretches(shape)
    part = np.minimum((along / lengths[edge] * count[edge]).astype(np.int64), count[edge].astype(np.int64) - 1)
    return np.asarray(first[edge] + part)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Clutter:
    """Strays that lie by chance within reach of the outline, where they pass for its points: per draw the nearest edge, the place along it, and the
    distance.   each : points of the cloud for which one draw stands.
    """

    edge: IntArray
    along: FloatArray
    distance: FloatArray
    each: float

    @classmethod
    def of(cls, shape: Section, xy: FloatArray, n_strays: int, reach: float, seed: int) -> _Clutter:
        """As even over the box of the points xy (n, 2) as the `n_strays` of them that lie out of reach."""
        rng = np.random.default_rng([seed, 8])
        low, high = (xy.min(axis=0), xy.max(axis=0)) if len(xy) else (np.zeros(2), np.zeros(2))
        distance, edge, along = outline_distance(shape, rng.uniform(low, high, (_STRAY_DRAWS, 2)))
        near = np.abs(distance) <= reach
        return cls(edge=edge[near], along=along[near], distance=distance[near], each=n_strays / max(int((~near).sum()), 1))


def _cells(
    surface: _Surface,
    side: BoolArray,
    shape: Section,
    length: float,
    sigma: float,
    size: float,
    clutter: _Clutter,
    seed: int,
    allowed: float,
    again: FloatArray | None,
) -> _Cells:
    if side.sum() < 2 * _CELL_POINTS:
        return _Cells(off_share=1.0, pattern_m=math.nan, p_value=0.0, n=0)
    stretch = _stretch_of(shape, surface.edge[side], surface.along[side])
    count, first = _stretches(shape)
    n_stretch = int((first + count).max())
    n_z = int(np.clip(side.sum() / (n_stretch * 2 * _CELL_POINTS), 1, min(max(round(4 * length / size), 4), 24)))
    slot = np.clip((surface.z[side] / length * n_z).astype(np.int64), 0, n_z - 1)
    cell = stretch * n_z + slot
    distance = surface.distance[side]
    n = np.bincount(cell, minlength=n_stretch * n_z).astype(float)
    total = np.bincount(cell, distance, minlength=len(n))
    square = np.bincount(cell, distance**2, minlength=len(n))
    mean = total / np.maximum(n, 1)
    var = np.maximum(square / np.maximum(n, 1) - mean**2, 0.0) * n / np.maximum(n - 1, 1)
    if again is None:
        expected = _expected(shape, stretch, sigma, n_stretch, clutter, seed)
    else:
        expected = _among_strays(shape, again, np.full(len(again), 1 / AGAIN), n_stretch, clutter)
    away = mean - np.repeat(expected, n_z)
    good = n >= _CELL_POINTS
    if not good.any():
        return _Cells(off_share=0.0, pattern_m=0.0, p_value=1.0, n=0)
    se2 = np.maximum(var, 1e-24 + (1e-9 * size) ** 2)[good] / n[good]
    z2 = away[good] ** 2 / se2
    tolerance = max(TOLERANCE * size, allowed * sigma)
    off = (z2 > _SE**2) & (np.abs(away[good]) > tolerance)
    pattern = math.sqrt(max(float((n[good] * (away[good] ** 2 - se2)).sum() / n[good].sum()), 0.0))
    return _Cells(off_share=float(n[good][off].sum() / n[good].sum()), pattern_m=pattern, p_value=float(chdtrc(len(z2), z2.sum())), n=int(good.sum()))


def _expected(shape: Section, stretch: IntArray, sigma: float, n_stretch: int, clutter: _Clutter, seed: int) -> FloatArray:
    """(n_stretch,) mean distance that points of the model itself show in each stretch: seen as the data were, scattered by sigma, among strays.

    The strays near a wall count too: they reach far outward and hardly inward.
    """
    rng = np.random.default_rng([seed, 7])
    start = np.concatenate(shape.loops)
    way = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops])
    lengths = np.linalg.norm(way, axis=1)
    n = 400 * n_stretch
    edge = rng.choice(len(lengths), n, p=lengths / lengths.sum())
    t = rng.random(n)
    true = _stretch_of(shape, edge, t * lengths[edge])
    strays = np.bincount(_stretch_of(shape, clutter.edge, clutter.along), minlength=n_stretch) * clutter.each
    own = np.maximum(np.bincount(stretch, minlength=n_stretch) - strays, 0.0)
    weight = own / np.maximum(np.bincount(true, minlength=n_stretch), 1)
    return _among_strays(shape, start[edge] + t[:, None] * way[edge] + sigma * rng.standard_normal((n, 2)), weight[true], n_stretch, clutter)


def _among_strays(shape: Section, xy: FloatArray, weight: FloatArray, n_stretch: int, clutter: _Clutter) -> FloatArray:
    """(n_stretch,) mean distance that points (m, 2) of the model show in each stretch. weight : (m,) points for which each stands."""
    distance, edge, along = outline_distance(shape, xy)
    shown = np.r_[_stretch_of(shape, edge, along), _stretch_of(shape, clutter.edge, clutter.along)]
    w = np.r_[weight, np.full(len(clutter.edge), clutter.each)]
    mass = np.bincount(shown, w, minlength=n_stretch)
    return np.asarray(np.bincount(shown, w * np.r_[distance, clutter.distance], minlength=n_stretch) / np.maximum(mass, 1e-300))


def _crowd(local: FloatArray, stray: BoolArray, box: float) -> BoolArray:
    """Strays with far more strays about them than the same number spread evenly over the box (m3) of all points would give them."""
    crowd = np.zeros(len(local), bool)
    rows = np.flatnonzero(stray)
    if len(rows) < 10:
        return crowd
    k = 8
    tree = cKDTree(local[rows])
    distance = np.asarray(tree.query(local[rows], k=min(k + 1, len(rows)))[0])[:, -1]
    expected = len(rows) * (4 / 3 * math.pi * distance**3) / box
    crowd[rows] = chdtr(2 * k, 2 * expected) < CHANCE
    return crowd
