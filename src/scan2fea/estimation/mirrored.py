"""Where a wall ends whose toe was not seen: a section that is its own mirror image says where, and both faces of the wall must end just there.

That a face ends somewhere is no evidence (the scan may end there). That both faces of a wall end where the toe across the mirror says they do is:
another section would have to be cut off there by chance. So the place must be known well: chance hits it with six standard deviations over the
width of the face, which may be at most a tenth. Where one of both faces was not seen either, the other must say alone what both would have said:
chance may hit its end a tenth as often as both together, and the end is that of a run of points (`ends.run_end`), which is known better.
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.estimation.ends import run_end
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.pinned import SEEN
from scan2fea.kernel.sections import corner_factors, edge_names
from scan2fea.types import FloatArray, Member

_AGREE = 3.0  # standard deviations
_BY_CHANCE = 0.1  # of the width of the face: what three of them on either side may cover
_MOST_BEYOND = 0.1  # density beyond the end over that before it: more is a face that goes on
_LEAST = 100  # points of the face that its density is taken from
_WINDOW_POINTS = 25  # in the window at the toe, which holds four sigma of the noise
_BODY = 0.9  # of the face, from the toe on: beyond is the corner with the next wall
_SWAPS = {"C": (("BOTTOM", "TOP"),), "T": (("LEFT", "RIGHT"),), "I": (("BOTTOM", "TOP"), ("LEFT", "RIGHT"))}


def told_toes(points: FloatArray, member: Member) -> tuple[str, ...]:
    """Names of the toes that were not seen and yet are known to be there. points : (n, 3) that the member was fitted to."""
    hidden = [name for name in _toes(member.family) if member.seen.get(name, 1.0) < SEEN]
    hidden = [name for name in hidden if any(member.seen.get(image, 1.0) >= SEEN for image in _images(member.family, name))]
    if not hidden:
        return ()
    local = sweep_of_member(member).coordinates(points)
    local = local[(local[:, 2] > 0) & (local[:, 2] < member.values()["length"])]
    return tuple(name for name in hidden if _ends_there(local[:, :2], member, name))


def _toes(family: str) -> tuple[str, ...]:
    """The toes that have a mirror image."""
    return tuple(name for name in edge_names(family)[0] if "TOE" in name and _images(family, name)) if family in _SWAPS else ()


def _images(family: str, name: str) -> set[str]:
    found = {name}
    for pair in _SWAPS[family]:
        for one, other in (pair, pair[::-1]):
            found |= {image.replace(one, other) for image in found if one in image}
    return found - {name}


def _ends_there(xy: FloatArray, member: Member, name: str) -> bool:
    """Whether both faces beside the toe, or the one that was seen, end at it, as well as chance would hardly have it."""
    values, names = member.values(), edge_names(member.family)[0]
    own = [p for p in member.parameters if p.name != "length"]
    factors = corner_factors(member.family)[0]
    corners = factors @ np.array([values[p.name] for p in own])
    i, n = names.index(name), len(names)
    across = 0 if np.array_equal(factors[i, 0], factors[(i + 1) % n, 0]) else 1
    told = [p.std_m for p, factor in zip(own, factors[i, across], strict=True) if factor]
    if None in told:
        return False
    start, end = corners[i], corners[(i + 1) % n]
    thick = float(np.linalg.norm(end - start))
    outward = np.array([end[1] - start[1], start[0] - end[0]]) / thick
    inward = 0.5 * thick
    doubt = math.hypot(*[std or 0.0 for std in told])
    beside = ((names[i - 1], start, start - end, corners[i - 1]), (names[(i + 1) % n], end, end - start, corners[(i + 2) % n]))
    seen = [one for one in beside if member.seen.get(one[0], 1.0) >= SEEN]
    for _, corner, away, far in seen:
        beyond = (xy - corner) @ outward
        off = (xy - corner) @ (away / thick)  # out of the wall
        near = (off < 4 * member.sigma_m + 1e-3 * thick) & (off > -min(4 * member.sigma_m + 1e-3 * thick, inward))
        told_by = _edge_at_zero if len(seen) == 2 else _run_to_zero
        if not told_by(beyond[near], float(np.linalg.norm(far - corner)), member.sigma_m, doubt):
            return False
    return bool(seen)


def _edge_at_zero(beyond: FloatArray, width: float, sigma_m: float, doubt_m: float) -> bool:
    """Whether points (n,) along a face, 0 at the toe and negative on the face, end at 0: counted in a window that the noise does not leave."""
    body = beyond[(beyond > -_BODY * width) & (beyond < 0)]
    if len(body) < _LEAST:
        return False
    window = max(4 * sigma_m, _WINDOW_POINTS * _BODY * width / len(body))
    rest = int((body < -window).sum())
    if rest < _LEAST / 2:
        return False
    density = rest / (_BODY * width - window)
    count = int((np.abs(beyond) < window).sum())
    std = math.hypot(math.sqrt(max(count, 1)) / density, window / math.sqrt(rest), doubt_m)
    return abs(count / density - window) < _AGREE * std and 2 * _AGREE * std < _BY_CHANCE * width


def _run_to_zero(beyond: FloatArray, width: float, sigma_m: float, doubt_m: float) -> bool:
    """As `_edge_at_zero`, of a face that says it alone."""
    run = beyond[(beyond > -_BODY * width) & (beyond < width)]
    if len(run) < _LEAST:
        return False
    end = run_end(run, sigma_m, -_BODY * width)
    std = math.hypot(end.std_m, doubt_m)
    return abs(end.edge_m) < _AGREE * std and 2 * _AGREE * std < _BY_CHANCE**2 * width and end.beyond < _MOST_BEYOND
