"""A face that was not seen, told by where its two neighbours stop.

That one face ends somewhere is no evidence: the scan may end there. That both neighbours of a hidden face end in one line along the member, and just
as far as each other, is: a cut or a shadow at any other angle to the section would end them at different places. So the angle at which a cut would
look the same must be small (`CHANCE` of all angles), which neighbours far apart or sharp ends give, and a plane across one of the file's own axes
tells nothing, for a box may have been cut out there. An end face that was scanned tells a hidden face too (`cap_runs.py`).
What stays open: something flat and square to the section that hides the end of a
wall on both sides, such as a slab that a web stands in.

Where the user says that nothing hid the object and nothing was cut off it (`whole`), any seen face ends where the section does. Rows of points that
run along the member leave such an edge open by their distance.

The place of such an end is that of a run of points (`ends.run_end`): rho of them per metre leave 1 / rho bare beyond the last one in the mean, noise
sigma blurs it to (sigma / 0.9 rho)^(1/2); both come out of one posterior, and no likelihood of the whole section is asked, which knows a
needle by its climb and not by its width. No such place is known better than to the spacing 1 / rho of the points along one face.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, gammaincc

from scan2fea.estimation.cap_runs import CHANCE, GAP, SQUARE, told_by_caps
from scan2fea.estimation.ends import RunEnd, run_end
from scan2fea.estimation.straight import Face, straight_faces
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.estimation.table import shipped_table
from scan2fea.kernel.pinned import SEEN, pinned
from scan2fea.kernel.section_likelihood import face_lengths, faces
from scan2fea.kernel.sections import PARAMETERS, ROUND, makes_section
from scan2fea.types import FloatArray, Member, Value

_AGREE = 3.0  # standard deviations
_BAND_SIGMAS, _BAND_SIZE = 4.0, 1e-3  # about a face: its points, exact ones too (of the section's size)
_LEAST_SIGMAS = 2.0  # from a face to the middle of its wall
_MOST_BEYOND = 0.1  # density beyond the end over that before it: more is a face that goes on
_CORNER = 0.1  # of a face, at its other end
_LEAST = 50  # points of a run
_SLICES, _SLICE_POINTS = 6, 60  # along the member
_ASKEW = 3.3  # standard deviations: by chance once in a thousand
_UNEVEN = 1e-3  # probability of slices that end so unlike each other
_LAST_ROW = 3**-0.5  # of the step between rows: root mean square of what the last is short of the edge, were it anything up to one
_WAVES = 1_000  # wave numbers that are asked at most
_BY_CHANCE = 1e-3  # of all of them together
_LEAST_ROWS = 2.0  # of a face


@dataclass(frozen=True, eq=False, kw_only=True)
class Reach(Value):
    """What hidden faces that are told make of a section.

    faces : their names.   values, covariance : (p,), (p, p) of the dimensions in the order of the family.   shift_m : (2,) of the section's origin,
    in its own frame.   told : dimensions that the faces told, and they alone, fix.
    """

    faces: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    shift_m: FloatArray
    told: frozenset[str]


def reach(points: FloatArray, member: Member, spacing_m: float = 0.0, *, whole: bool = False) -> Reach | None:
    """The section with the hidden faces that their neighbours or the ends tell; None where none is missing or none is told. points : (n, 3), metres.

    spacing_m : of points that keep a distance from each other, else 0.   whole : nothing hid the object and nothing was cut off it: one neighbour
    is enough.
    """
    if member.family in ROUND or member.twist.any():
        return None
    seen = {name for name, share in member.seen.items() if share >= SEEN}
    local = sweep_of_member(member).coordinates(points)
    margin = max(_BAND_SIGMAS * member.sigma_m, 1e-3 * member.values()["length"])
    local = local[(local[:, 2] > margin) & (local[:, 2] < member.values()["length"] - margin)]
    ends: dict[str, tuple[float, float]] = {}
    for before, face, after in _hidden(member, seen, whole):
        beside = [one for one in (before, after) if one.name in seen]
        end = _ended(local, member, beside, face) if whole else _told(local, member, before, face, after)
        if end is not None:
            ends[face.name] = end.edge_m, end.std_m
    if len(pinned(member.family, seen | set(ends))) < len(PARAMETERS[member.family]):
        both = {face.name for before, face, after in _hidden(member, seen, whole) if {before.name, after.name} <= seen}
        capped = told_by_caps(points, member, seen, spacing_m)
        ends = {**{name: end for name, end in capped.items() if name not in both}, **ends}  # two neighbours know better, also that it is none
    found = solved(member, seen, ends, len(local)) if ends else None
    return found if found is not None and _is_built_so(member.family, found) else None


def _is_built_so(family: str, found: Reach) -> bool:
    """Whether the walls that hidden faces tell are no thicker beside the others than in any section of the table.

    What stops there may be two toes and no face: an I seen from one side shows a channel whose web is as thick as half the flange is wide.
    """
    size = dict(zip(PARAMETERS[family], found.values, strict=True))
    for wall, other in (("tw", "tf"), ("tf", "tw")):
        if wall in found.told and other in size:
            most = max((shape.parameters[wall] / shape.parameters[other] for shape in shipped_table().of(family)), default=math.inf)
            if size[wall] > most * size[other]:
                return False
    return True


def end_rows(points: FloatArray, member: Member) -> float:
    """Standard deviation (m) that rows of points across a member leave to its length, or the widest that noise hides; both ends were seen alike."""
    length = member.values()["length"]
    local = sweep_of_member(member).coordinates(points)
    step = _step(_Run(out=local[:, 2] - length, z=local[:, 0], start=-length), member.sigma_m)
    return math.sqrt(2) * _LAST_ROW * min(step, length)


def _hidden(member: Member, seen: set[str], whole: bool) -> Iterator[tuple[Face, Face, Face]]:
    """Every face of the outline that was not seen though both its neighbours were (of a whole scan one), which it overtops at both corners.

    A face across the same axis was seen, of a tube also inside: else nothing but ends holds the member's line in that direction, and its tilt and bow
    blur them.
    """
    loops = straight_faces(member)
    loop, held = loops[0], {face.axis for one in loops for face in one if face.name in seen}
    for i, face in enumerate(loop):
        before, after = loop[i - 1], loop[(i + 1) % len(loop)]
        convex = before.outward == -after.outward and (after.place - before.place) * after.outward > 0
        n_seen = (before.name in seen) + (after.name in seen)
        if convex and face.axis in held and face.name not in seen and n_seen >= (1 if whole else 2):
            yield before, face, after


def _told(local: FloatArray, member: Member, before: Face, face: Face, after: Face) -> RunEnd | None:
    """Where the hidden face lies against where the fit has it, outward; None where its neighbours do not tell."""
    apart, sigma = abs(after.place - before.place), member.sigma_m
    one, two = (_run(local, member, neighbour, face) for neighbour in (before, after))
    ends = None if one is None or two is None else (_end(one, sigma), _end(two, sigma))
    if one is None or two is None or ends is None or ends[0] is None or ends[1] is None:
        return None
    doubt = _AGREE * math.hypot(ends[0].std_m, ends[1].std_m)
    if abs(ends[0].edge_m - ends[1].edge_m) > doubt or 4 * doubt / (math.pi * apart) > CHANCE:
        return None
    normal = np.asarray(member.T_world_member)[:3, face.axis]
    if np.abs(normal).max() > math.sqrt(1 - min(SQUARE + doubt / apart, 0.5) ** 2):
        return None
    both, start = np.r_[one.out, two.out], max(one.start, two.start)
    end = run_end(both[both > start], sigma, start)
    return replace(end, std_m=max(end.std_m, 1 / ends[0].rho, 1 / ends[1].rho))  # an exponential law's tail is longer than Gauss's


def _ended(local: FloatArray, member: Member, beside: list[Face], face: Face) -> RunEnd | None:
    """The same where the scan is whole, from the neighbours that were seen: to the distance of the rows of points along the edge."""
    runs = [run for run in (_run(local, member, neighbour, face) for neighbour in beside) if run is not None]
    ends = []
    for run in runs:
        step = _step(run, member.sigma_m)
        end = _end(run, math.hypot(member.sigma_m, 0.5 * step), step)  # rows must not look like ends
        if end is not None:
            ends.append(replace(end, std_m=max(end.std_m, 1 / end.rho, _LAST_ROW * step)))
    if not ends or max(abs(end.edge_m - ends[0].edge_m) / math.hypot(end.std_m, ends[0].std_m) for end in ends) > _AGREE:
        return None
    return min(ends, key=lambda end: end.std_m)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Run:
    """Points of a face: out (n,) m outward of where the fit has the hidden face, from `start` on; z (n,) along the member."""

    out: FloatArray
    z: FloatArray
    start: float


def _run(local: FloatArray, member: Member, neighbour: Face, face: Face) -> _Run | None:
    """The points of a neighbour, from near its other corner to as far beyond the hidden face; None where that leaves too little of it.

    Not those on the other side of the middle of its wall, whose own face ends elsewhere.
    """
    size = max(member.values()[name] for name in PARAMETERS[member.family])
    away = [abs(other.place - neighbour.place) for loop in straight_faces(member) for other in loop if other.axis == neighbour.axis]
    half = 0.5 * min((one for one in away if one > _BAND_SIZE * size), default=0.0)
    if half <= _LEAST_SIGMAS * member.sigma_m:  # none: a section that has closed up
        return None
    band = min(max(_BAND_SIGMAS * member.sigma_m, _BAND_SIZE * size), half)
    width = neighbour.high - neighbour.low
    start = max(_CORNER * width, _BAND_SIGMAS * member.sigma_m) - width
    if start > -0.5 * width:
        return None
    out = face.outward * (local[:, face.axis] - face.place)
    own = (np.abs(local[:, neighbour.axis] - neighbour.place) < band) & (out > start) & (out < width)
    return _Run(out=out[own], z=local[own, 2], start=start)


def _step(run: _Run, sigma_m: float) -> float:
    """Distance (m) between rows of points along the member, or the greatest that noise hides.

    Rows at a distance p, moved by s, have the power n exp(-(2 pi s / p)^2) at the wave number 1 / p (of n points, under a Hann window, which keeps
    the ends of the run and slow changes out of it); points at random 1 in the mean, exponential.
    """
    out = run.out[run.out <= 0]
    width = -run.start
    taper = np.sin(math.pi * np.clip(-out / width, 0.0, 1.0)) ** 2
    n = float(taper.sum() ** 2 / max(float((taper**2).sum()), 1e-300))
    needed = math.log(_WAVES) - math.log(_BY_CHANCE)
    hidden = 2 * math.pi * sigma_m / math.sqrt(max(math.log(max(n, 1.0) / needed), 1e-300)) if n > needed else math.inf
    finest = max(hidden, width * 4 / _WAVES)
    if finest >= width / _LEAST_ROWS:
        return finest
    waves = np.arange(_LEAST_ROWS / width, 1 / finest, 0.25 / width)
    power = np.array([abs(taper @ np.exp(2j * math.pi * k * out)) ** 2 for k in waves]) / max(float((taper**2).sum()), 1e-300)
    seen = np.flatnonzero(power > needed)
    return max(finest, 1 / float(waves[seen[np.argmax(power[seen])]])) if len(seen) else finest


def _end(run: _Run, sigma_m: float, step_m: float = 0.0) -> RunEnd | None:
    """Where a run ends outward: the same all along the member, densely up to there and empty beyond; None where it does not.

    step_m : between rows of points along the member: gaps and slices may be off by as much.
    """
    if len(run.out) < _LEAST:
        return None
    whole = run_end(run.out, sigma_m, run.start)
    inside = np.sort(run.out[run.out <= whole.edge_m])
    if whole.beyond > _MOST_BEYOND or len(inside) < _LEAST / 2:
        return None
    if float(np.diff(inside).max()) > max((math.log(len(inside)) + GAP) / whole.rho, 2 * step_m):
        return None
    return whole if _is_even(run, whole, sigma_m, step_m) else None


def _is_even(run: _Run, whole: RunEnd, sigma_m: float, step_m: float) -> bool:
    """Whether stretches of the member end alike: a shadow seldom runs along it."""
    n_slices = min(_SLICES, len(run.out) // _SLICE_POINTS)
    if n_slices < 2:
        return False
    low, high = float(run.z.min()), float(run.z.max())
    at = np.clip(((run.z - low) / (high - low) * n_slices).astype(int), 0, n_slices - 1)
    slices = [k for k in range(n_slices) if (at == k).sum() >= _SLICE_POINTS / 3]
    if len(slices) < 0.75 * n_slices:
        return False
    parts = [run_end(run.out[at == k], sigma_m, run.start) for k in slices]
    off = np.array([(part.edge_m - whole.edge_m) / math.hypot(part.std_m, _LAST_ROW * step_m) for part in parts])
    weight = np.array([1 / math.hypot(part.std_m, _LAST_ROW * step_m) for part in parts])
    if float(gammaincc(len(parts), float(np.abs(off).sum()))) <= _UNEVEN:  # what the last point leaves bare is exponential
        return False
    without = [np.arange(len(parts)) != k for k in range(len(parts))]  # one of them may be far off: the tail again
    return min(_trend(np.array(slices, float)[own], off[own], weight[own]) for own in without) < _ASKEW


def _trend(place: FloatArray, off: FloatArray, weight: FloatArray) -> float:
    """Slope, in standard deviations, of what lies off by `off` of them (each 1 / weight) at places (n,): of a cut askew along the member."""
    arm = weight * (place - np.average(place, weights=weight**2))
    return abs(float(arm @ off)) / max(float(np.linalg.norm(arm)), 1e-300)


def solved(member: Member, seen: set[str], ends: Mapping[str, tuple[float, float]], n_points: int) -> Reach | None:
    """Dimensions and place of the section of which the seen faces stay where they are and hidden ones lie where they are told to.

    ends : hidden face -> how far outward of where the fit has it, and the standard deviation of that.   n_points : of the sides.
    Weighted least squares; a seen face is known as well as the mean of its points. None where the told faces contradict what is known or each other:
    what makes no section (a wall of no thickness, or of more than there is room for) was no pair of faces.
    """
    names = PARAMETERS[member.family]
    values = np.array([member.values()[name] for name in names])
    length = dict(zip(faces(member.family), face_lengths(member.family, values), strict=True))
    total = sum(length[name] * share for name, share in member.seen.items())
    rows, aims, stds = [], [], []
    for face in (one for loop in straight_faces(member) for one in loop):
        if face.name in seen:
            n_own = max(n_points * length[face.name] * member.seen[face.name] / total, 1.0)
            aims.append(0.0)
            stds.append(max(member.sigma_m / math.sqrt(n_own), 1e-7 * float(values.max())))
        elif face.name in ends:
            aims.append(face.outward * ends[face.name][0])
            stds.append(ends[face.name][1])
        else:
            continue
        rows.append([*face.factors, float(face.axis == 0), float(face.axis == 1)])
    free = np.array([p.source != "fixed" for p in member.parameters if p.name in names] + [True, True])  # what is held stays
    weighted, aim = (np.array(rows) / np.array(stds)[:, None]) * free, np.array(aims) / np.array(stds)
    step = np.linalg.lstsq(weighted, aim, rcond=None)[0]
    left = len(aim) - int(np.linalg.matrix_rank(weighted))
    if left > 0 and chdtrc(left, float(((aim - weighted @ step) ** 2).sum())) < _UNEVEN:
        return None
    found = dict(zip(names, (values + step[: len(names)]).tolist(), strict=True))
    if not makes_section(member.family, found):
        return None
    covariance = np.linalg.pinv(weighted.T @ weighted)[: len(names), : len(names)]
    told = pinned(member.family, seen | set(ends)) - pinned(member.family, seen)
    return Reach(faces=tuple(ends), values=np.array(list(found.values())), covariance=covariance, shift_m=step[len(names) :], told=told)
