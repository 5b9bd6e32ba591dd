"""The radius of the root fillets of a rolled member, from the points near the corners that its sharp section leaves re-entrant.

In each corner the distances of the points to the two faces, and to the arc between them, are noise, about where the faces lie there; some points are
strays. How densely the points lie has no say: near corners one face shades the other, and a face that begins late would pass for a large arc.
All corners of a member share the radius (EN 10365, EN 10056-1 and EN 10055 state one). The inner corners of an angle's toes are rounded too. The
corners of square and rectangular tubes are looked at from outside: an arc between two faces, and the inner skin one wall behind it (EN 10210-2,
EN 10219-2: the outer radius is 1.5 to 3 walls).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtri

from scan2fea.estimation.observability import RESOLVED
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.outline import Slant, re_entrant, toe_corners
from scan2fea.kernel.sections import section, section_area
from scan2fea.types import FloatArray, IntArray, Member, Parameter, RootFillet, Value

TUBE = "RHS"
OPEN, WALLS = ("L", "I", "C", "T"), ("t", "tw", "tf")
LEAST = 0.1  # of the thicker wall: no rolled shape of sections.csv has less (W14X873: 0.107)
_OF_LEG, _OF_WALL = 0.45, 4.5  # at most, of the free leg and of the thinner wall (sections.csv: UPN 30 has 0.41, M3X2.9 4.1)
OF_SIDE = 0.35  # of the shorter side of a tube: its radius at most
OF_TOE = 0.75  # of the leg at most is round at its toe (EN 10056-1: half the root radius, up to 0.6)
_ROOT_AS = {"I": "tw", "C": "tf"}  # as large as it is the root radius of IPN and UPN
TOE_OF_ROOT = {"L": 0.5, "I": 0.6, "C": 0.5}  # radii of toes of angles, IPN and UPN (EN 10056-1, EN 10365)
_WINDOW, _OF_WINDOW = 1.6, 0.8  # times the largest radius, and of the free leg at most: some of both faces beyond the arc belongs to it
_SIGMAS = 4.0
_FLAT = 8.0  # standard deviations of the noise: shorter faces beside arcs do not tell where they lie well enough to ask for a radius
_APART, _APART_ROUND = 3.0, 4.0  # standard deviations between the skins of a tube; and where the inner arc is hardly rounder than the noise
_ROUND = 3.0  # standard deviations
_CORNER_POINTS, _FEW_POINTS, _FEWEST = 3_000, 400, 30
_CHANCE = 1e-6  # that points of a sharp corner are so much likelier under an arc
_CLEAR = 3.0  # standard deviations of the radius from none
_LEVER = (0.5 - 1 / math.pi) / (2 - 6 / math.pi)  # by how much the radius grows where one face lies deeper by one: least squares over the arc
_BULGE = (4 / math.pi - 1) / (2 - 6 / math.pi)  # and where the arc lies deeper by one
_SAGITTA = 1 - 1 / math.sqrt(2)  # of the radius: how deep an arc lies; less than the noise is no arc
_PARALLEL, _STEEPEST = 0.03, 0.2  # slopes: EN 10034 lets a flange lean by 2 % of its width, IPN have 14 %, UPN 5 and 8 %
_FEWEST_STRAYS, _MOST_STRAYS = 1e-3, 0.5
_RADII, _SETTLES, _TIMES, _FINER, _DOUBLINGS = 20, 6, 3, 1e-3, 12
FILLET = 1 - math.pi / 4  # of the square of the radius: the area of a fillet in a right angle
_NOTHING = 0.01  # of the section: fillets that add less are none
_FLOOR = 1e-3  # of the window: less noise tells no more


@dataclass(frozen=True, eq=False, kw_only=True)
class Roots(Value):
    """fillet : what the points tell of it.   places : (k, 2) rounded corners as the points beside them have it, in the section's frame.

    ways : (k, 2, 2) the directions along the two faces of each, away from it.   radii : (k,) metres.
    """

    fillet: RootFillet
    places: FloatArray
    ways: FloatArray
    radii: FloatArray


def roots_of(points: FloatArray, member: Member, seed: int = 0, slope: tuple[float, float] = (0.0, 0.0)) -> Roots:
    """The root radius that the points (n, 3), metres, are likeliest with, and that of the toes of an angle or of sloping flanges that have one.

    slope : of flanges, and its standard deviation; the points are as parallel ones would have them (`slopes.parallel`), where arcs of a radius end
    nearer to the corner. Members without re-entrant corners that are no tubes, or that change, have none.
    """
    found = _roots_of(points, member, seed, slope[0])
    times, own = 1 / _arc_length(slope[0]), found.fillet
    lengths = {name: times * getattr(own, name) for name in ("radius_m", "std_m", "most_m", "toe_m", "toe_std_m")}
    for name, std in (("radius_m", "std_m"), ("toe_m", "toe_std_m")):  # arcs between moved faces are circles to the second order of the slope
        lengths[std] = math.hypot(lengths[std], slope[0] ** 2 * lengths[name])
    return replace(found, fillet=replace(own, **lengths, slope=slope[0], slope_std=slope[1]))


def _arc_length(slope: float) -> float:
    """How far from its corner an arc of radius 1 begins, between faces of that slope."""
    return math.tan((math.pi / 2 - math.atan(slope)) / 2)


def _roots_of(points: FloatArray, member: Member, seed: int, slope: float) -> Roots:
    nothing = Roots(fillet=RootFillet(), places=np.zeros((0, 2)), ways=np.zeros((0, 2, 2)), radii=np.zeros(0))
    if member.family not in (*OPEN, TUBE) or member.change is not None:
        return nothing
    wall = min(p.value_m for p in member.parameters if p.name in WALLS)
    if wall <= RESOLVED * member.sigma_m:
        return nothing
    local = sweep_of_member(member).coordinates(points)
    margin = _SIGMAS * member.sigma_m
    xy = local[(local[:, 2] > margin) & (local[:, 2] < member.values()["length"] - margin), :2]
    blurred = replace(nothing, fillet=RootFillet(is_observable=False, most_m=math.inf))
    if member.family == TUBE and wall <= _APART * member.sigma_m:  # the arcs of both skins are one blur
        return blurred
    if member.family == TUBE:
        side = min(member.values()["h"], member.values()["b"])
        tube = _arcs(xy, member, _tube_frames(member), min(OF_SIDE * side, _OF_WALL * wall), side / 2, seed)
        if tube is not None and wall <= _APART_ROUND * member.sigma_m and tube.fillet.radius_m - wall < _ROUND * member.sigma_m:
            return blurred  # 16 mm were told as 10.7 +- 1.6, of 3.3 standard deviations of wall
        return nothing if tube is None else tube
    leg = _free_leg(member)
    found = _arcs(xy, member, _frames(member), min(_OF_LEG * leg, _OF_WALL * wall), leg, seed)
    if found is None:
        return nothing
    if slope and not found.fillet.radius_m:  # rolled as it is it has round corners
        usual = min(member.values()[_ROOT_AS[member.family]] * _arc_length(slope), _OF_LEG * leg)
        is_hidden = _SAGITTA * usual < 2 * member.sigma_m
        found = _arcs(xy, member, _frames(member), min(_OF_LEG * leg, _OF_WALL * wall), leg, seed, usual, is_hidden=is_hidden) or found
    if not (member.family == "L" or slope) or not found.fillet.radius_m:
        return found
    toe = _toe_thickness(member, slope)
    usual = min(TOE_OF_ROOT[member.family] * found.fillet.radius_m, OF_TOE * toe)
    toes = _arcs(xy, member, _toe_frames(member), OF_TOE * toe, toe, seed, usual)
    if toes is None or not toes.fillet.radius_m:
        return found
    fillet = replace(found.fillet, toe_m=toes.fillet.radius_m, toe_std_m=toes.fillet.std_m, toe_source=toes.fillet.source)
    places, ways, radii = (np.concatenate(both) for both in ((found.places, toes.places), (found.ways, toes.ways), (found.radii, toes.radii)))
    return Roots(fillet=fillet, places=places, ways=ways, radii=radii)


def _arcs(
    xy: FloatArray,
    member: Member,
    frames: tuple[FloatArray, FloatArray],
    largest: float,
    leg: float,
    seed: int,
    usual: float = 0.0,
    *,
    is_hidden: bool = False,
) -> Roots | None:
    """The radius up to the `largest` that all corners of the frames share; None where hardly a point lies there. leg : of their shortest face.

    usual : a radius that is taken wherever it goes with the points (three standard deviations); half of it is uncertain where they tell none.
    is_hidden : whether noise hides the arcs, and points are not asked.
    """
    walls = [p for p in member.parameters if p.name in WALLS]
    wall = min(p.value_m for p in walls)
    window = min(_WINDOW * largest + _SIGMAS * member.sigma_m, _OF_WINDOW * leg)
    places, ways = frames
    before = wall / 2 if member.family != TUBE else max(wall / 2, _SIGMAS * member.sigma_m)  # nothing lies before the faces of a tube
    near = _in_corners(xy, frames, window, before, seed)
    told = [k for k, uv in enumerate(near) if len(uv) >= _FEWEST]
    sigma, is_clear = max(member.sigma_m, _FLOOR * window), member.family == TUBE or wall > _SIGMAS * member.sigma_m
    deep = wall if member.family == TUBE else math.inf
    corners = [_Corner(uv=near[k], sigma=sigma, window=window, is_clear=is_clear, deep=deep) for k in told]
    if not corners:
        return None
    few = [corner.thinned() for corner in corners]
    radii = np.linspace(0.0, largest, _RADII + 1)
    best, step = float(radii[np.argmax([_score(few, r) for r in radii])]), largest / _RADII
    for _ in range(_TIMES):
        corners = [corner.settled_at(best) for corner in corners]
        best = _climbed(corners, max(best - step, 0.0), best + step)
    top, sharp = _score(corners, best), _score(corners, 0.0)
    best, top = (best, top) if top > sharp else (0.0, sharp)
    below, above, most = (_within(corners, best, top, limit) for limit in (-2.0, 2.0, _CLEAR**2 / 2))
    each = float(np.linalg.norm([corner.place_std for corner in corners])) / len(corners)
    noise = max(corner.sigma for corner in corners)
    narrowest = max(best, noise / _SAGITTA) if math.isinf(deep) else max(best - deep, noise)
    halved = _BULGE * noise**2 / (4 * narrowest)
    std = math.hypot((above - below) / 4, _LEVER * each, halved, *(_LEVER * _place_std(p, noise) for p in walls))
    least = max(_CLEAR * std, LEAST * max(p.value_m for p in walls), noise / _SAGITTA)
    slope = _slope(corners, ways[told], best)
    is_told = 2 * (top - sharp) > chdtri(1, _CHANCE) and best > least and slope <= _PARALLEL
    as_usual = [corner.settled_at(usual) for corner in corners] if usual else []
    is_hidden = is_hidden or leg - usual < _FLAT * noise  # what is flat beside the arc tells its own place no more
    is_usual = bool(as_usual) and (is_hidden or (2 * (top - _score(as_usual, usual)) < _CLEAR**2 and slope <= _PARALLEL))
    for k, corner in zip(told, as_usual if is_usual else corners, strict=True):
        places[k] += corner.shift @ ways[k]
    if is_usual:
        fillet = RootFillet(radius_m=usual, std_m=std if is_told and not is_hidden else usual / 2, source="assumed")
        return Roots(fillet=fillet, places=places, ways=ways, radii=np.full(len(places), usual))
    if is_told:
        std = max(std, abs(usual - best)) if usual else std  # faces this short tell it less well than they seem to
        fillet = RootFillet(radius_m=best, std_m=std, is_observable=True, most_m=most)
        return Roots(fillet=fillet, places=places, ways=ways, radii=np.full(len(places), best))
    most = max(most, least) if slope <= _PARALLEL else math.inf
    is_nothing = len(corners) * FILLET * most**2 < _NOTHING * section_area(section(member.family, member.values()))
    return Roots(fillet=RootFillet(is_observable=is_nothing, most_m=most), places=places, ways=ways, radii=np.zeros(len(places)))


def _place_std(wall: Parameter, noise: float) -> float:
    """How far a face of a wall may lie off, metres; two that noise joins to one hump are still known to half of that noise."""
    return wall.std_m or min(wall.spread_m or 0.0, noise / 2)


def squared(points: FloatArray, member: Member, roots: Roots) -> FloatArray:
    """(n, 3) the points as a scan of the same member with sharp corners would have them: each keeps its distance from the surface.

    What lies at an angle on an arc comes to lie on the nearer of its two faces, as far along as the angle has gone; all else stays where it is.
    """
    sweep = sweep_of_member(member)
    local = sweep.coordinates(points)
    wall = min(p.value_m for p in member.parameters if p.name in WALLS)
    moved = np.array(points)
    for place, ways, radius_m in zip(roots.places, roots.ways, roots.radii, strict=True):
        uv = (local[:, :2] - place) @ ways.T
        near = np.flatnonzero((uv > -wall / 2).all(axis=1) & (uv < radius_m).all(axis=1))
        left = radius_m - uv[near]
        off = radius_m - np.hypot(*left.T)  # towards the centre
        angle = np.arctan2(left.min(axis=1), left.max(axis=1)) / (math.pi / 4)  # 0 where the arc begins, 1 in its middle
        along = off + (radius_m - off) * (1 - angle)
        is_first = left[:, 0] < left[:, 1]  # near the face that runs along the first way
        to = np.where(is_first[:, None], np.stack([along, off], axis=1), np.stack([off, along], axis=1))
        moved[near] += sweep.in_world(local[near, 2], (to - uv[near]) @ ways)
    return moved


def _toe_thickness(member: Member, slope: float) -> float:
    """How thick a leg, or a flange of that slope, is at its toe, metres."""
    values, slant = member.values(), Slant.of(member.family, member.values(), slope)
    return values["t"] if slant is None else float(slant.thickness(np.array([slant.far]))[0])


def _free_leg(member: Member) -> float:
    """The shortest face beside a re-entrant corner, metres; of one with such a corner at either end, half."""
    shape = section(member.family, member.values()).loops[0]
    is_root = np.isin(np.arange(len(shape)), re_entrant(shape))
    length = np.linalg.norm(np.roll(shape, -1, axis=0) - shape, axis=1)
    ends = is_root.astype(int) + np.roll(is_root, -1)
    return float((length / np.maximum(ends, 1))[ends > 0].min())


def _frames(member: Member) -> tuple[FloatArray, FloatArray]:
    """Per re-entrant corner its place (k, 2) in the section and the directions (k, 2, 2) along its faces away from it."""
    loop = section(member.family, member.values()).loops[0]
    return _at_corners(loop, re_entrant(loop))


def _toe_frames(member: Member) -> tuple[FloatArray, FloatArray]:
    """The same for the inner corners of toes."""
    return _at_corners(section(member.family, member.values()).loops[0], toe_corners(member.family))


def _tube_frames(member: Member) -> tuple[FloatArray, FloatArray]:
    """The same for the outer corners of a tube: its faces are seen from behind."""
    loop = section(member.family, member.values()).loops[0]
    return _at_corners(loop, np.arange(len(loop)))


def _at_corners(loop: FloatArray, at: IntArray) -> tuple[FloatArray, FloatArray]:
    after = np.roll(loop, -1, axis=0) - loop
    after /= np.linalg.norm(after, axis=1)[:, None]
    before = np.roll(after, 1, axis=0)
    return loop[at], np.stack([-before[at], after[at]], axis=1)


def _in_corners(xy: FloatArray, frames: tuple[FloatArray, FloatArray], window: float, before: float, seed: int) -> list[FloatArray]:
    """Per corner the points (k, 2) along and off its faces, from so far before these to the window behind."""
    out = []
    for place, ways in zip(*frames, strict=True):
        uv = (xy - place) @ ways.T
        uv = uv[(uv > -before).all(axis=1) & (uv < window).all(axis=1)]
        out.append(uv[sampled_rows(len(uv), _CORNER_POINTS, seed)])
    return out


@dataclass(frozen=True, eq=False, kw_only=True)
class _Corner(Value):
    """uv : (k, 2) points.   sigma : noise.   strays : share of the points.   window : how far its faces are looked at.

    is_clear : whether its points may tell where its faces lie; of thin walls some are points of the other side.   shift : (2,) of the faces
    from where the section has them.   place_std : (2,) of that.   deep : how far behind the faces, and round the same centre, those of a tube's other
    skin lie.
    """

    uv: FloatArray
    sigma: float
    window: float
    is_clear: bool
    deep: float
    strays: float = 0.05
    shift: FloatArray = field(default_factory=lambda: np.zeros(2))
    place_std: FloatArray = field(default_factory=lambda: np.zeros(2))

    def thinned(self) -> _Corner:
        return replace(self, uv=self.uv[:: math.ceil(len(self.uv) / _FEW_POINTS)])

    def off(self, radius: float) -> FloatArray:
        """(skins, k) distance to the faces from where the arc of a radius begins, or to that arc; and of a tube to those of its other skin.

        Points of an arc lie farther from its centre than it does by sigma^2 / 2 r in the mean where noise is alike in all directions, by nothing
        where it acts along rays that strike head on: half of it is taken, and nothing where the arc is lost in the noise.
        """
        skins = (0.0,) if math.isinf(self.deep) else (0.0, self.deep)
        return np.stack([self._off_skin(deep, max(radius - deep, 0.0)) for deep in skins])

    def _off_skin(self, deep: float, radius: float) -> FloatArray:
        """deep : of the skin behind the faces.   radius : of its arc."""
        u, v = (self.uv - deep).T
        to_faces = np.minimum(np.hypot(np.minimum(u - radius, 0.0), v), np.hypot(np.minimum(v - radius, 0.0), u))
        if radius <= 0:
            return np.asarray(to_faces)
        is_within = (u < radius) & (v < radius)
        mean = radius + radius * self.sigma**2 / (4 * (radius**2 + self.sigma**2))
        return np.asarray(np.where(is_within, np.abs(np.hypot(radius - u, radius - v) - mean), to_faces))

    def densities(self, radius: float) -> tuple[FloatArray, FloatArray]:
        """((skins, k) across the surface, of the points of each skin, (k,) of strays), per m. Skins have as many points."""
        off = self.off(radius)
        own = (1 - self.strays) / (len(off) * self.sigma * math.sqrt(2 * math.pi)) * np.exp(-0.5 * np.square(off / self.sigma))
        return np.asarray(own), np.full(off.shape[1], self.strays / self.window)

    def log_likelihood(self, radius: float) -> float:
        own, stray = self.densities(radius)
        return float(np.log(own.sum(axis=0) + stray).sum())

    def settled_at(self, radius: float) -> _Corner:
        """The corner between its faces as they lie here, under the noise that its own points have about them and about the arc of a radius."""
        here = self
        for _ in range(_SETTLES):
            own, stray = here.densities(radius)
            skins = own / (own.sum(axis=0) + stray)
            sigma = max(math.sqrt(float((skins * np.square(here.off(radius))).sum()) / max(float(skins.sum()), 1e-300)), _FLOOR * self.window)
            whose = skins.sum(axis=0)
            here = replace(here, sigma=sigma, strays=float(np.clip(1 - whose.mean(), _FEWEST_STRAYS, _MOST_STRAYS)))
            if not self.is_clear:
                continue
            u, v = here.uv.T
            on = np.stack([skins[0] * ((v > radius) & (np.abs(u) < v)), skins[0] * ((u > radius) & (np.abs(v) < u))])
            n = np.maximum(on.sum(axis=1), 1.0)
            shift = (on * here.uv.T).sum(axis=1) / n
            here = replace(here, uv=here.uv - shift, shift=here.shift + shift, place_std=sigma / np.sqrt(n))
        return here


def _slope(corners: list[_Corner], ways: FloatArray, radius: float) -> float:
    """How much the faces along x, or those along y, lean at least on the side of the arc (three standard deviations), over all corners.

    ways : (k, 2, 2).
    """
    slopes: list[tuple[int, float, float]] = []
    for corner, way in zip(corners, ways, strict=True):
        for along, uv in enumerate((corner.uv, corner.uv[:, ::-1])):
            reach = np.minimum(_SIGMAS * corner.sigma + _STEEPEST * (uv[:, 0] - radius), corner.deep / 2)
            far = uv[(uv[:, 0] > radius) & (np.abs(uv[:, 1]) < reach)]
            if len(far) >= _FEWEST:
                x = far[:, 0] - far[:, 0].mean()
                slopes.append((int(np.abs(way[along]).argmax()), float(x @ far[:, 1] / (x @ x)), float(x @ x) / corner.sigma**2))
    leans = [0.0]
    for axis in (0, 1):
        own = np.array([row[1:] for row in slopes if row[0] == axis]).reshape(-1, 2)
        if len(own):
            leans.append(float(abs(own[:, 0] @ own[:, 1]) / own[:, 1].sum() - _CLEAR / math.sqrt(own[:, 1].sum())))
    return max(leans)


def _score(corners: list[_Corner], radius: float) -> float:
    return sum(corner.log_likelihood(radius) for corner in corners)


def _climbed(corners: list[_Corner], low: float, high: float) -> float:
    """The likeliest radius between two, by golden section."""
    golden = (math.sqrt(5) - 1) / 2
    x, y = high - golden * (high - low), low + golden * (high - low)
    fx, fy = _score(corners, x), _score(corners, y)
    finest = _FINER * high
    while high - low > finest:
        if fx > fy:
            high, y, fy = y, x, fx
            x = high - golden * (high - low)
            fx = _score(corners, x)
        else:
            low, x, fx = x, y, fy
            y = low + golden * (high - low)
            fy = _score(corners, y)
    return (low + high) / 2


def _within(corners: list[_Corner], best: float, top: float, limit: float) -> float:
    """How far the radius may go up (down for a limit < 0) until the log likelihood has lost the limit, as a radius; that of a parabola."""
    step = math.copysign(_FINER * max(best, corners[0].window / 10), limit)
    for _ in range(_DOUBLINGS):
        if best + step <= 0 or best + step >= corners[0].window:
            break
        lost = top - _score(corners, best + step)
        if lost >= abs(limit):
            return best + step * math.sqrt(abs(limit) / lost)
        step *= 2
    return best + step
