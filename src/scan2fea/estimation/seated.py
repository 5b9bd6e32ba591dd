"""A face that rests on a support: nobody sees it, but the plane of the support says where it is.

Only where the sides beside it come down to that plane. What is held above it on packers has a gap there, and points that lie nearer to the plane
than its own noise reaches went to the plane, whichever they are of: so the gap is read from the number of points, of the object and of the
plane together, that a side shows just above the plane, against as many as it shows farther up; what the plane itself shows so high is counted
beside it. The gap must be none within two standard deviations, and within three in every stretch of the member and on either side. How well it
is known is how well the face is, for a smaller gap than that would not have been found, nor one in which the plane's own points are too many.

A face just above the plane that looks down on it was not seen either, whatever the fit makes of the place where the plane has cut the sides off.
A channel on its toes and a tube look alike from outside: neither rests where nobody has looked into it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.estimation.anneal import walls
from scan2fea.estimation.caps import inside_of
from scan2fea.estimation.observability import RELATIVE, thickness_observable
from scan2fea.estimation.reach import Reach, solved
from scan2fea.estimation.straight import Face, straight_faces
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.pinned import SEEN, pinned
from scan2fea.kernel.sections import PARAMETERS, ROUND
from scan2fea.types import FloatArray, Footing, Member, Parameter, Value

_PARALLEL = math.cos(math.radians(3.0))  # a face and the plane it rests on
_BAND_SIGMAS, _BAND_SIZE = 4.0, 1e-3  # about a side: its points, exact ones too (of the section's size)
_TAKEN = 3.0  # bands of the plane, up to which points of the object may have gone to it
_LOWEST = (1.0, 2.0, 3.0)  # sigma of the plane, from where on points are counted: from the first where ...
_FLOOR = 0.1  # ... its own are so few of those expected
_LAYER, _ABOVE = 25, 50  # points of a side just above the plane at least, and farther up, where there is that much of it
_MOST_OF_SIDE = 0.9  # beyond is the corner with the next face
_SLICES, _SLICE_POINTS = 6, 25  # stretches along the member, and the points in the layer of one
_AGREE, _AGREE_WHOLE = 3.0, 2.0  # standard deviations, of a stretch or a side, and of them all
_LOOKED_INTO = {"LEFT_OUTER": "LEFT_INNER", "RIGHT_OUTER": "RIGHT_INNER", "TOP_OUTER": "TOP_INNER", "BOTTOM_OUTER": "BOTTOM_INNER"}  # of a tube
_ROUNDING = 1e-6  # of the section's size: exact points lie on either side
_EVEN = 12**-0.5  # standard deviation of what is even over 1


@dataclass(frozen=True, eq=False, kw_only=True)
class _Plane(Value):
    """A footing in the member's frame: height(points) above it; across which axis of the section, and on which side of it the member ends there.

    own, its : (n, 3), (k, 3) points of the object and of the plane, between the ends of the member.
    """

    normal: FloatArray
    offset_m: float
    axis: int
    outward: float
    length_m: float
    own: FloatArray
    its: FloatArray
    footing: Footing

    def height(self, local: FloatArray) -> FloatArray:
        """(n,) of points in the member's frame."""
        return np.asarray(local @ self.normal - self.offset_m)

    def place(self, face: Face) -> float:
        """Where the plane lies along its axis, in the middle of a face."""
        other = 1 - self.axis
        rest = self.offset_m - self.normal[2] * self.length_m / 2 - self.normal[other] * 0.5 * (face.low + face.high)
        return float(rest / self.normal[self.axis])

    def slope_m(self, face: Face) -> float:
        """Standard deviation of the plane's place over a face that is not quite parallel to it."""
        away = np.array([self.normal[2] * self.length_m, self.normal[1 - self.axis] * (face.high - face.low)])
        return float(_EVEN * np.linalg.norm(away / self.normal[self.axis]))


def seated(points: FloatArray, member: Member, footings: Sequence[Footing]) -> Member:
    """The member with the faces that rest on one of the planes, and what they tell of its section; without what the planes have cut off.

    points : (n, 3) metres, that it was fitted to. It comes back as it was where it is bent, or held by given dimensions.
    """
    is_held = any(p.source == "fixed" for p in member.parameters if p.name != "length")
    if member.family in ROUND or member.bow.any() or member.twist.any() or member.change is not None or is_held:
        return member
    known = {name for name, share in member.seen.items() if share >= SEEN} | set(member.reached)
    ends: dict[str, tuple[float, float]] = {}
    hidden: set[str] = set()
    for plane in _planes(points, member, footings):
        lowest = _outermost(member, plane)
        hidden |= {face.name for face in lowest if _is_cut(plane, face, member.sigma_m)}
        told = [face for face in lowest if (face.name in hidden or face.name not in known) and _is_known_inside(member, face, known)]
        gaps = {face.name: _gap(member, plane, face, known - hidden) for face in told}
        rests = {name: std for name, std in gaps.items() if std is not None}
        if all(std < math.inf for std in rests.values()):
            ends |= {face.name: (face.outward * (plane.place(face) - face.place), rests[face.name]) for face in lowest if face.name in rests}
    if not hidden and not ends:
        return member
    return _told(points, member, known - hidden, hidden, ends)


def _planes(points: FloatArray, member: Member, footings: Sequence[Footing]) -> Iterator[_Plane]:
    """The footings that lie along the member, parallel to a side of its section."""
    T, length = np.asarray(member.T_world_member), member.values()["length"]
    sweep = sweep_of_member(member)
    margin = max(_BAND_SIGMAS * member.sigma_m, 1e-3 * length)
    for footing in footings:
        normal = footing.normal @ T[:3, :3]
        axis = int(np.argmax(np.abs(normal)))
        if axis == 2 or abs(normal[axis]) < _PARALLEL:
            continue
        own, its = (sweep.coordinates(p) for p in (points, footing.points))
        own, its = (p[(p[:, 2] > margin) & (p[:, 2] < length - margin)] for p in (own, its))
        offset = footing.offset_m - float(footing.normal @ T[:3, 3])
        outward = -float(np.sign(normal[axis]))
        yield _Plane(normal=normal, offset_m=offset, axis=axis, outward=outward, length_m=length, own=own, its=its, footing=footing)


def _outermost(member: Member, plane: _Plane) -> list[Face]:
    """The faces of the section that look at the plane with nothing of it between: two flanges may rest on it."""
    faces = [face for face in straight_faces(member)[0] if face.axis == plane.axis and face.outward == plane.outward]
    last = max(face.outward * face.place for face in faces)
    size = max(member.values()[name] for name in PARAMETERS[member.family])
    return [face for face in faces if face.outward * face.place > last - _BAND_SIZE * size]


def _is_cut(plane: _Plane, face: Face, sigma_m: float) -> bool:
    """Whether the fit has a face where the plane has taken the points of the sides."""
    gap = face.outward * (plane.place(face) - face.place)
    return bool(gap < _TAKEN * plane.footing.band_m + _BAND_SIGMAS * sigma_m)


def _is_known_inside(member: Member, face: Face, known: Collection[str]) -> bool:
    """Whether the section may end with that face: of what may be closed there or not, the inside was seen."""
    if member.family == "RHS":
        return _LOOKED_INTO[face.name] in known
    is_open = "WEB_INNER" in known and any(p.name == "tw" and p.observable for p in member.parameters)
    return member.family != "C" or "TOE" not in face.name or is_open


def _gap(member: Member, plane: _Plane, face: Face, known: Collection[str]) -> float | None:
    """Standard deviation of the place of a face that rests on the plane; inf where there is a gap, None where no side beside it tells.

    known : faces that were seen.
    """
    loop = straight_faces(member)[0]
    i = [one.name for one in loop].index(face.name)
    sides = [_above(member, plane, side, face) for side in (loop[i - 1], loop[(i + 1) % len(loop)]) if side.name in known]
    found = [side for side in sides if side is not None]
    if not found:
        return None
    gap, std, low = np.array(found).T
    both = float((std**-2).sum() ** -0.5)
    if (gap > _AGREE * std).any() or float((gap / std**2).sum()) * both**2 > _AGREE_WHOLE * both:
        return math.inf
    return float(np.linalg.norm([both, low.max() / math.sqrt(3), plane.footing.std_m, plane.slope_m(face)]))


def _above(member: Member, plane: _Plane, side: Face, face: Face) -> tuple[float, float, float] | None:
    """How far above the plane a side ends, its standard deviation, and the height from where on points were counted, m; None where they are too few.

    inf where some stretch of the member ends above it.
    """
    size = max(member.values()[name] for name in PARAMETERS[member.family])
    away = [abs(other.place - side.place) for loop in straight_faces(member) for other in loop if other.axis == side.axis]
    half = 0.5 * min((one for one in away if one > _BAND_SIZE * size), default=size)
    band = min(max(_BAND_SIGMAS * member.sigma_m, _BAND_SIZE * size), half)
    far = side.low if face.outward > 0 else side.high
    most = _MOST_OF_SIDE * abs(plane.place(face) - far)
    taken = _TAKEN * plane.footing.band_m
    both = np.concatenate([plane.own, plane.its])
    out = side.outward * (both[:, side.axis] - side.place)
    height = plane.height(both)
    own = (np.abs(out) < band) & (height < most)
    above = np.sort(height[own & (height > taken)])
    if len(above) < _ABOVE + _LAYER or most < 2 * taken:
        return None
    top = float(above[_LAYER]) + taken - float(above[0])
    n_above = int((above > top).sum())
    rho = n_above / (most - top)
    floor = (out > band) & (out < 3 * band)  # as wide as the side's own band
    for low in (times * plane.footing.sigma_m for times in _LOWEST):
        layer = (height > low + _ROUNDING * size) & (height < top)
        expected = rho * (top - low)
        if expected >= _LAYER and (floor & layer).sum() <= _FLOOR * expected:
            off, std = _missing(both[own & layer, 2], both[floor & layer, 2], expected, n_above, plane.length_m)
            return off / rho, std / rho, low
    return None


def _missing(z: FloatArray, floor_z: FloatArray, expected: float, n_above: int, length_m: float) -> tuple[float, float]:
    """Points of the side that a layer lacks, and their standard deviation; inf where a stretch of the member lacks them.

    z : (n,) of the points in the layer, floor_z of those beside it: of these half may lie in it, for the other half of it is under the member.
    """

    def gap(n: int, n_floor: int, wanted: float) -> tuple[float, float]:
        std = math.sqrt(max(n, wanted) + n_floor / 4 + (_EVEN * n_floor) ** 2 + wanted**2 / n_above)
        return wanted - (n - n_floor / 2), std

    n_slices = int(np.clip(expected / _SLICE_POINTS, 1, _SLICES))
    at, floor_at = (np.clip((one / length_m * n_slices).astype(int), 0, n_slices - 1) for one in (z, floor_z))
    for k in range(n_slices):
        off, std = gap(int((at == k).sum()), int((floor_at == k).sum()), expected / n_slices)
        if off > _AGREE * std:
            return math.inf, std
    return gap(len(z), len(floor_z), expected)


def _told(points: FloatArray, member: Member, known: set[str], hidden: set[str], ends: dict[str, tuple[float, float]]) -> Member:
    """The member with the faces told by planes, and without the dimensions that only `hidden` ones fixed."""
    std = max((p.std_m for p in member.parameters if p.std_m is not None and p.name != "length"), default=member.sigma_m)
    places = {**{name: (0.0, std) for name in member.reached if name in known}, **ends}
    seen = known - set(member.reached)
    found = solved(member, seen, places, len(points)) if ends else None
    rests = () if found is None else tuple(ends)
    fixed = pinned(member.family, known | set(rests))
    told = fixed - pinned(member.family, known)
    member = replace(
        member,
        seen={name: 0.0 if name in hidden else share for name, share in member.seen.items()},
        reached=tuple(name for name in member.reached if name in known),
        seated=rests,
    )
    if found is not None:
        member = _moved(member, found, told)
    loose = [k for k, p in enumerate(member.parameters) if p.name != "length" and p.name not in fixed]
    covariance = np.array(member.covariance)
    covariance[loose, :] = covariance[:, loose] = 0.0
    parameters = tuple(
        replace(p, std_m=None, observable=False, spread_m=None) if k in loose and p.observable else p for k, p in enumerate(member.parameters)
    )
    member = replace(member, parameters=parameters, covariance=covariance)
    return replace(member, inside=inside_of(points, member)) if rests else member


def _moved(member: Member, found: Reach, told: frozenset[str]) -> Member:
    """The member with its section solved anew; what seen faces told before keeps its standard deviation where that is wider."""
    n = len(found.values)
    own = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    std = np.array([sd if p.name in told else max(sd, p.std_m or 0.0) for p, sd in zip(member.parameters, own, strict=False)])
    section = [
        _by_plane(member, p, float(value), float(sd)) if p.name in told else replace(p, value_m=float(value))
        for p, value, sd in zip(member.parameters, found.values, std, strict=False)
    ]
    is_told = np.array([p.observable for p in section], float)
    covariance = np.array(member.covariance)
    covariance[:n, :] = covariance[:, :n] = 0.0
    covariance[:n, :n] = found.covariance * np.outer(*[is_told * std / np.where(own > 0, own, 1.0)] * 2)
    T = np.array(member.T_world_member)
    T[:3, 3] += T[:3, :2] @ found.shift_m
    return replace(member, parameters=(*section, *member.parameters[n:]), covariance=covariance, T_world_member=T)


def _by_plane(member: Member, p: Parameter, value: float, std: float) -> Parameter:
    """A dimension that a plane tells."""
    is_wall = p.name in walls(member.family)
    ok = thickness_observable(value, std, member.sigma_m)[0] if is_wall else 0 < std < RELATIVE * value
    return replace(p, value_m=value, std_m=std if ok else None, observable=bool(ok), spread_m=None if ok or not std > 0 else std)
