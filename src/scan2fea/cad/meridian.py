"""The meridian of a surface of revolution: the curve that half-planes through the axis cut out of it, in lines and conics.

In the half-plane (z along the axis, r from it) a plane, cylinder or cone is a line, and every quadric about the axis is r^2 = A + B z + C z^2:
spheres and the ellipsoidal heads of vessels among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.kernel.coverage import is_unmeasured
from scan2fea.kernel.polylines import evenly, length_of
from scan2fea.kernel.surfaces import Surface
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

ANGLES = 16  # half-planes tried
SMOOTH_DEG = 12.0  # pieces that meet at less are one smooth curve
LEAST_STEPS = 4.0  # spacings: a shorter piece is looked for between its neighbours
REFUSES = 2.576  # standard deviations: p = 0.01, two-sided
PARALLEL = 0.02  # sine between a line and the axis under which it is a cylinder
LEAST_POINTS = 12  # measured, to fit a piece to
INLIER = 0.25  # sine of the angle between a normal and its half-plane


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece(Value):
    """A line a z + b r = c (unit normal (a, b)), or the conic r^2 = A + B z + C z^2.   first, last : samples of the path that it was found on."""

    kind: str
    values: FloatArray
    first: int
    last: int

    def off(self, zr: FloatArray) -> FloatArray:
        """(n,) distance of points (n, 2), to first order for a conic."""
        z, r = zr.T
        if self.kind == "line":
            return np.asarray(self.values[0] * z + self.values[1] * r - self.values[2])
        a, b, c = self.values
        return np.asarray((r * r - a - b * z - c * z * z) / np.maximum(np.hypot(2 * r, b + 2 * c * z), 1e-12))

    def normal(self, zr: FloatArray) -> FloatArray:
        """(2,) unit normal at a point of it."""
        if self.kind == "line":
            return self.values[:2]
        found = np.array([-(self.values[1] + 2 * self.values[2] * zr[0]), 2 * zr[1]])
        return np.asarray(found / np.linalg.norm(found))


def half_plane(axis: Surface, points: FloatArray) -> FloatArray:
    """(n, 2) z, r of points about an axis."""
    q = points - axis.point
    z = q @ axis.axis
    return np.column_stack([z, np.linalg.norm(q - z[:, None] * axis.axis, axis=1)])


def turns_about(axis: Surface, points: FloatArray, normals: FloatArray) -> BoolArray:
    """(n,) whether a normal lies in the half-plane of its point."""
    q = points - axis.point
    around = np.cross(axis.axis, q)
    around /= np.maximum(np.linalg.norm(around, axis=1, keepdims=True), 1e-300)
    return np.asarray(np.abs((around * normals).sum(1)) < INLIER)


def path_of(mesh: TriangleMesh, axis: Surface, usable: BoolArray) -> FloatArray | None:
    """(k, 2) the cut of a half-plane that crosses only usable faces: from axis to axis, or a closed loop (its first point repeated)."""
    e = axis.frame()
    q = mesh.vertices - axis.point
    for k in range(ANGLES):
        angle = 2 * np.pi * (k + 0.37) / ANGLES
        forward = np.cos(angle) * e[0] + np.sin(angle) * e[1]
        side = q @ np.cross(axis.axis, forward)
        path = _chained(mesh.faces, side, q @ axis.axis, q @ forward, usable)
        if path is not None:
            return path
    return None


def _chained(faces: IntArray, side: FloatArray, z: FloatArray, r: FloatArray, usable: BoolArray) -> FloatArray | None:
    """The segments in which faces cross the plane side = 0 where r > 0, in order; None where they are no single path over usable faces."""
    above = side > 0
    cut = np.flatnonzero(above[faces].any(1) & ~above[faces].all(1))
    steps: dict[tuple[int, int], list[tuple[int, int]]] = {}
    place: dict[tuple[int, int], tuple[float, float]] = {}
    for f in cut.tolist():
        ends = []
        for i, j in ((0, 1), (1, 2), (2, 0)):
            u, v = int(faces[f, i]), int(faces[f, j])
            if above[u] != above[v]:
                t = side[u] / (side[u] - side[v])
                key = (min(u, v), max(u, v))
                place[key] = (z[u] + t * (z[v] - z[u]), r[u] + t * (r[v] - r[u]))
                ends.append(key)
        if max(place[ends[0]][1], place[ends[1]][1]) <= 0:
            continue
        if not usable[f]:
            return None
        for a, b in (ends, ends[::-1]):
            steps.setdefault(a, []).append(b)
    return _walked(steps, place)


def _walked(steps: dict[tuple[int, int], list[tuple[int, int]]], place: dict[tuple[int, int], tuple[float, float]]) -> FloatArray | None:
    loose = sorted(k for k, next_ in steps.items() if len(next_) == 1)
    if len(loose) not in (0, 2) or not steps:
        return None
    at = loose[0] if loose else min(steps)
    walked, seen = [at], {at}
    while True:
        ahead = [k for k in steps[at] if k not in seen]
        if not ahead:
            break
        at = ahead[0]
        walked.append(at)
        seen.add(at)
    if len(seen) != len(steps):
        return None
    path = np.array([place[k] for k in walked])
    if not loose:
        return np.vstack([path, path[:1]])
    path[[0, -1], 1] = 0.0  # both ends lie just beyond the axis
    return path


def resampled(path: FloatArray, step: float) -> FloatArray:
    """Points of even distance along a path; a closed one starts where it turns most."""
    if (path[0] == path[-1]).all():
        ring = _even(path, step)[:-1]
        reach = max(2, round(len(ring) / 100))
        a, b = ring - np.roll(ring, reach, axis=0), np.roll(ring, -reach, axis=0) - ring
        cosine = (a * b).sum(1) / np.maximum(np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1), 1e-300)
        start = int(cosine.argmin())
        return np.vstack([np.roll(ring, -start, axis=0), ring[start]])
    return _even(path, step)


def _even(path: FloatArray, step: float) -> FloatArray:
    return evenly(path, max(8, round(length_of(path) / step) + 1))


def pieces_of(samples: FloatArray, tolerance: float, least: int) -> list[Piece]:
    """The longest lines and conics of at least `least` samples, along the path; what lies between them is left for the joints."""
    out: list[Piece] = []
    start = 0
    while start + least <= len(samples):
        best: Piece | None = None
        for kind in ("line", "conic"):
            found = _longest(samples, start, kind, tolerance, least)
            if found is not None and (best is None or found.last > best.last + least // 2):
                best = found
        if best is None:
            start += 1
            continue
        out.append(best)
        start = best.last + 1
    return out


def _longest(samples: FloatArray, start: int, kind: str, tolerance: float, least: int) -> Piece | None:
    """Among lengths that grow by a fourth the longest that holds, led on. A short one may fail where longer ones hold: by the axis are few points."""
    good: Piece | None = None
    low, high = start + least - 1, len(samples) - 1
    lengths = [low]
    while lengths[-1] < high:
        lengths.append(min(high, lengths[-1] + max(1, (lengths[-1] - start) // 4)))
    for k in range(len(lengths) - 1, -1, -1):
        piece = _fit_piece(samples, start, lengths[k], kind)
        if piece is not None and _holds(piece, samples[start : lengths[k] + 1], tolerance):
            good, low, high = piece, lengths[k], lengths[min(k + 1, len(lengths) - 1)]
            break
    while good is not None and low < high:
        middle = (low + high + 1) // 2
        piece = _fit_piece(samples, start, middle, kind)
        if piece is not None and _holds(piece, samples[start : middle + 1], tolerance):
            good, low = piece, middle
        else:
            high = middle - 1
    return good


def _holds(piece: Piece, samples: FloatArray, tolerance: float) -> bool:
    """Nearly all samples within the tolerance: those by the axis rest on few points."""
    off = np.abs(piece.off(samples))
    return bool(np.percentile(off, 95) <= tolerance and off.max() <= 3 * tolerance)


def _fit_piece(samples: FloatArray, first: int, last: int, kind: str) -> Piece | None:
    values = fit_values(samples[first : last + 1], kind)
    return None if values is None else Piece(kind=kind, values=values, first=first, last=last)


def fit_values(zr: FloatArray, kind: str) -> FloatArray | None:
    """Total least squares of a line; of a conic least squares of the distances to first order, in three rounds."""
    middle = zr.mean(0)
    if kind == "line":
        normal = np.linalg.eigh((zr - middle).T @ (zr - middle))[1][:, 0]
        return np.array([*normal, normal @ middle])
    if len(zr) < 6:
        return None
    z, r = zr.T
    scale = max(float(np.ptp(z)), 1e-12)
    t = (z - middle[0]) / scale
    basis, target, weight = np.column_stack([np.ones_like(t), t, t * t]), r * r, np.ones_like(t)
    found = np.zeros(3)
    for _ in range(3):
        found = np.linalg.lstsq(basis * weight[:, None], target * weight, rcond=1e-10)[0]
        weight = 1 / np.maximum(np.hypot(2 * r, (found[1] + 2 * found[2] * t) / scale), 1e-3 * float(r.max()) + 1e-12)
    c = found[2] / scale**2
    b = found[1] / scale - 2 * c * middle[0]
    return np.array([found[0] - found[1] * middle[0] / scale + c * middle[0] ** 2, b, c])


def joined(pieces: Sequence[Piece], samples: FloatArray, points: FloatArray, owner: IntArray, reach: float, slack: float) -> list[Piece] | None:
    """The pieces in order, missing short ones put in, those that nobody measured led on; None where two do not meet within reach.

    points : (n, 2) measured.   owner : (n,) the sample each is nearest to.   slack : of the width where a head runs into a shell.
    """
    closed = bool((samples[0] == samples[-1]).all())
    full = _led_on(_united([_refitted(p, samples, points, owner, slack) for p in pieces], points, owner), samples, owner, reach)
    if len(full) < 2 and not (full and not closed):
        return None
    out: list[Piece] = []
    pairs = list(zip(full, [*full[1:], full[0]] if closed else [*full[1:], None], strict=True))
    for a, b in pairs:
        out.append(a)
        if b is None or is_smooth(a, b, samples[a.last], slack) or corner(a, b, samples[a.last], reach) is not None:
            continue
        between = _between(a, b, samples, points, owner, closed)
        if between is None or any(corner(x, y, samples[s], 2 * reach) is None for x, y, s in ((a, between, a.last), (between, b, b.first))):
            return None
        out.append(between)
    return out


def _led_on(pieces: Sequence[Piece], samples: FloatArray, owner: IntArray, reach: float) -> list[Piece]:
    """A piece that nobody measured is what its neighbour is, where that passes into it without an angle and stays within reach of it.

    What a reconstruction puts where nobody looked is a guess: a wall as thick as elsewhere is no ellipsoid inside where it is one outside.
    """
    areas = _turned_areas(samples)
    density = len(owner) / max(float(areas.sum()), 1e-300)
    count = np.bincount(owner, minlength=len(samples))
    bare = [is_unmeasured(float(areas[p.first : p.last + 1].sum()), int(count[p.first : p.last + 1].sum()), density) for p in pieces]
    of = list(range(len(pieces)))
    for k in [k for k, is_bare in enumerate(bare) if is_bare]:
        own = samples[pieces[k].first : pieces[k].last + 1]
        for j in (k - 1, k + 1):
            if not 0 <= j < len(pieces) or bare[j] or np.abs(pieces[j].off(own)).max() > reach:
                continue
            near = samples[pieces[max(j, k)].first]
            if abs(pieces[j].normal(near) @ pieces[k].normal(near)) > np.cos(np.radians(SMOOTH_DEG)):
                of[k] = j
                break
    groups = [[pieces[k] for k in range(len(of)) if of[k] == j] for j in dict.fromkeys(of)]
    return [replace(pieces[j], first=group[0].first, last=group[-1].last) for j, group in zip(dict.fromkeys(of), groups, strict=True)]


def _turned_areas(samples: FloatArray) -> FloatArray:
    """(n,) of the surface that each sample's half steps leave where they are turned."""
    step = np.linalg.norm(np.diff(samples, axis=0), axis=1) * np.pi * (samples[1:, 1] + samples[:-1, 1])
    return np.asarray((np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])) / 2)


def _refitted(piece: Piece, samples: FloatArray, points: FloatArray, owner: IntArray, slack: float) -> Piece:
    """The piece through the measured points of its samples, away from its ends; a line where that leaves no more noise in them than a conic.

    slack : within which either must hold the samples. Of a bottom seen from above only the outermost strip is measured, which hardly bends.
    """
    used, own = _own(piece, points, owner), samples[piece.first : piece.last + 1]
    found = _through(piece, used, piece.kind) if len(used) >= LEAST_POINTS else None
    if found is None or not _holds(found, own, slack):
        return piece
    line = _through(piece, used, "line")
    return line if line is not None and _holds(line, own, slack) and _leaves_no_more(line, used, _left(found, used)) else found


def _through(piece: Piece, used: FloatArray, kind: str) -> Piece | None:
    values = fit_values(used, kind)
    if values is None:
        return None
    return replace(piece, kind=kind, values=_squared(values, used) if kind == "line" else values)


def _own(piece: Piece, points: FloatArray, owner: IntArray) -> FloatArray:
    """(k, 2) the measured points of a piece away from its ends."""
    margin = max(1, (piece.last - piece.first) // 20)
    return points[(owner >= piece.first + margin) & (owner <= piece.last - margin)]


def _left(piece: Piece, used: FloatArray) -> float:
    """Mean square of what a piece leaves in its points."""
    return float(np.mean(piece.off(used) ** 2))


def _leaves_no_more(piece: Piece, used: FloatArray, left: float) -> bool:
    """Whether a piece leaves no more in its points than noise of variance `left` would, three standard deviations of a variance allowed."""
    return bool(_left(piece, used) <= left * (1 + 3 * np.sqrt(2 / len(used))))


def _united(pieces: Sequence[Piece], points: FloatArray, owner: IntArray) -> list[Piece]:
    """Pieces that follow each other without a gap made one where one line or conic leaves no more in the points of both."""
    out: list[Piece] = []
    for piece in pieces:
        before = out[-1] if out else None
        if before is None or piece.first > before.last + 1:
            out.append(piece)
            continue
        parts = [_own(p, points, owner) for p in (before, piece)]
        used = np.concatenate(parts)
        left = sum(len(u) * _left(p, u) for p, u in zip((before, piece), parts, strict=True) if len(u)) / max(len(used), 1)
        both = replace(before, last=piece.last)
        one = [_through(both, used, kind) for kind in ("line", "conic")] if min(map(len, parts)) >= LEAST_POINTS else []
        held = [p for p in one if p is not None and _leaves_no_more(p, used, left)]
        if held:
            out[-1] = held[0]
        else:
            out.append(piece)
    return out


def _squared(values: FloatArray, used: FloatArray) -> FloatArray:
    """A line along the axis or square to it where its points do not refuse that (two-sided test of its slope, p > 0.01)."""
    normal, middle = values[:2], used.mean(0)
    off, along = (used - middle) @ normal, (used - middle) @ np.array([-normal[1], normal[0]])
    std = float(np.sqrt((off**2).sum() / max(len(used) - 2, 1) / max(float((along**2).sum()), 1e-300)))
    for k in (0, 1):
        if abs(normal[k]) <= REFUSES * std + 1e-9:
            axis = np.eye(2)[1 - k] * np.sign(normal[1 - k])
            return np.array([*axis, axis @ middle])
    return values


def _between(a: Piece, b: Piece, samples: FloatArray, points: FloatArray, owner: IntArray, closed: bool) -> Piece | None:
    """A short line between two pieces that do not meet: the rim of a shell. Fitted to the middle of what was measured there."""
    first, last = a.last, b.first
    if closed and last < first:
        last += len(samples) - 1
    third = max(1, (last - first) // 4)
    rows = np.arange(first + third, max(last - third, first + third + 1) + 1) % max(len(samples) - 1, 1)
    used = points[np.isin(owner, rows)]
    if len(used) < 8:
        used = samples[rows]
    values = fit_values(used, "line") if len(used) >= 2 else None
    if values is None:
        return None
    found = Piece(kind="line", values=_squared(values, used), first=int(rows[0]), last=int(rows[-1]))
    # of a narrow rim one row of points may be all: these tell where it lies and not how it leans
    long = int(np.abs(samples[b.first] - samples[a.last]).argmax())
    square = replace(found, values=np.array([*np.eye(2)[1 - long], used[:, 1 - long].mean()]))
    noise = [_left(p, own) for p in (a, b) if len(own := _own(p, points, owner))]
    return square if noise and _leaves_no_more(square, used, float(np.mean(noise))) else found


def is_smooth(a: Piece, b: Piece, near: FloatArray, slack: float = 1e-6) -> bool:
    """Do two pieces run into each other? A conic does so into a cylinder where it is as wide at its widest, to `slack`."""
    head, shell = (a, b) if a.kind == "conic" else (b, a)
    if head.kind == "conic" and shell.kind == "line" and abs(shell.values[0]) < PARALLEL and head.values[2] < 0:
        k0, k1, k2 = head.values
        widest = k0 - k1 * k1 / (4 * k2)
        return bool(widest > 0 and abs(np.sqrt(widest) - shell.values[2] / shell.values[1]) <= slack)
    gap = abs(float(a.off(near[None])[0])) + abs(float(b.off(near[None])[0]))
    return bool(gap <= 2 * slack and abs(a.normal(near) @ b.normal(near)) > np.cos(np.radians(SMOOTH_DEG)))


def corner(a: Piece, b: Piece, near: FloatArray, reach: float) -> FloatArray | None:
    """The place where two pieces cross at an angle nearest to `near` and within reach of it (0: anywhere); None where there is none."""
    if is_smooth(a, b, near):
        return None
    at = near.astype(float)
    for _ in range(30):
        N = np.stack([a.normal(at), b.normal(at)])
        step = np.linalg.lstsq(N, -np.array([float(a.off(at[None])[0]), float(b.off(at[None])[0])]), rcond=1e-3)[0]
        at = at + step
        if np.linalg.norm(step) < 1e-13:
            break
    crossed = abs(a.off(at[None])[0]) + abs(b.off(at[None])[0]) < 1e-9
    return at if crossed and (reach == 0 or np.linalg.norm(at - near) <= reach) else None
