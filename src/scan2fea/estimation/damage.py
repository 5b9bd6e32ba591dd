"""Where the points leave the fitted member by more than chance: dents, losses, bulges, surfaces deep inside.

Every face is cut into cells. A cell is compared with the others of its own strip along the axis, so that what the section itself does not describe
(fillets, a biased wall, points of the far face taken for the near one) is no damage. The test counts points above and below the median of the strip
(sign test: clutter and the law of the noise hardly matter); its scale is taken from all cells (empirical null, Efron 2004), and the p-value is that
of the most extreme of all windows (Bonferroni): an undamaged member shows anything with probability LEVEL at most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erfc, gammainc

from scan2fea.errors import UsageError, require
from scan2fea.estimation.field import ResidualField, residual_field
from scan2fea.estimation.solid import Solid, solid_of
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.sweep import swept_points
from scan2fea.types import BoolArray, Damage, FloatArray, IntArray, Member, Value

LEVEL = 0.01  # probability of any false damage on an undamaged member
CELL_POINTS, LEAST_POINTS = 25, 8  # wanted in a cell of a seen face; fewer say nothing
CELL_SIGMAS = 2.0  # cells narrower than that mix with their neighbours
MAX_CELLS = 200  # along the member
WINDOWS = (1, 2, 4)  # cells a window spans along the axis and around
TRIM_SIGMAS, TRIM_WALLS, TRIM_CELLS = 4.0, 2.0, 0.25  # points farther outside than so many sigma, and walls or cells, belong to something else
DEEP_SIGMAS = 6.0  # points farther inside lie on a surface that should not be
THIN_SIGMAS = 2.0  # a wall thinner than that many sigma shows its far face through its near one: shifts within it are no evidence
LEAST_SIGMAS = 0.25  # shifts below that share of the noise are calibration, not damage
STRIP_CELLS = 8  # cells of a strip that were seen, at least: fewer make no reference
MISSING = 0.4  # share of the points to be expected below which a face counts as gone
MAX_POINTS = 400_000
MEDIAN_STD = math.sqrt(math.pi / 2)  # standard deviation of a median against that of a mean, Gaussian


@dataclass(frozen=True, eq=False, kw_only=True)
class _Cells(Value):
    """Points and their cells [strip, place along the member].

    strip, place, off_m : (n,) per point, off_m from the median of its strip.   count, balance, deep : per cell its points, those above less those
    below that median, and those deep inside.   scatter_m : (strips,) robust standard deviation.   face, edge : (strips,) face of the section and
    edge of the polygons under the middle of each strip.   around_m, width_m : (strips,).   z_m : (places + 1,) borders along the member.
    """

    strip: IntArray
    place: IntArray
    off_m: FloatArray
    count: IntArray
    balance: FloatArray
    deep: IntArray
    scatter_m: FloatArray
    face: IntArray
    edge: IntArray
    around_m: FloatArray
    width_m: FloatArray
    z_m: FloatArray


@dataclass(frozen=True, kw_only=True)
class _Hit(Value):
    strip: int
    n_strips: int
    place: int
    n_places: int
    depth_m: float
    std_m: float
    p_value: float


def damages(points: FloatArray, member: Member, sigma_m: float, seed: int = 0) -> tuple[Damage, ...]:
    """Significant places, the most significant first. points : (n, 3) of the member, metres. sigma_m : their noise across the surface.

    Raises UsageError unless sigma_m is finite and not negative. What has no points is no damage here: it may be hidden.
    """
    require(math.isfinite(sigma_m) and sigma_m >= 0, UsageError, f"the noise is {sigma_m} m; it must be 0 or more")
    solid = solid_of(member)
    field = residual_field(points[sampled_rows(len(points), MAX_POINTS, seed)], solid)
    floor = max(sigma_m, solid.chord_m, 1e-6 * solid.wall_m)
    cells = _cells(field, solid, floor)
    if cells is None:
        return ()
    hits = [*_shifts(cells), *_deep(cells)]
    least = solid.wall_m if solid.wall_m < THIN_SIGMAS * sigma_m else LEAST_SIGMAS * floor
    measured = [_measured(hit, cells) for hit in _apart(hits, cells)]
    return _told([hit for hit in measured if abs(hit.depth_m) >= max(least, 2 * hit.std_m)], cells, solid)


# ------------------------------------------------------------------ cells


def _cells(field: ResidualField, solid: Solid, sigma: float) -> _Cells | None:
    """The field gathered in cells; None where there are too few points to tell anything."""
    length = solid.sweep.length_m
    perimeter = sum(float(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum()) for p in solid.loops)
    n = int((np.abs(field.off_m) < TRIM_SIGMAS * sigma).sum())
    if n < STRIP_CELLS * CELL_POINTS or length <= 8 * sigma:
        return None
    size = max(math.sqrt(CELL_POINTS * perimeter * length / n), CELL_SIGMAS * sigma)
    n_places = int(min(round(length / size), MAX_CELLS))
    if n_places < STRIP_CELLS:
        return None
    trim = TRIM_SIGMAS * sigma + min(TRIM_WALLS * solid.wall_m, TRIM_CELLS * size)
    within = (field.z_m > 3 * sigma) & (field.z_m < length - 3 * sigma) & (field.off_m < trim)
    strip_of, face, width, around, edge = _strips(field, solid, size)
    strip, off = strip_of[within], field.off_m[within]
    place = np.minimum((field.z_m[within] / length * n_places).astype(np.int64), n_places - 1)
    is_deep = off < -(DEEP_SIGMAS * sigma + TRIM_CELLS * size)
    shape = (len(face), n_places)
    middle, scatter = np.zeros(len(face)), np.zeros(len(face))
    for k in range(len(face)):
        own = off[(strip == k) & ~is_deep]
        middle[k], scatter[k] = (float(np.median(own)), _robust_std(own)) if len(own) else (0.0, 0.0)
    off = off - middle[strip]
    cell = strip * n_places + place
    return _Cells(
        strip=strip,
        place=place,
        off_m=off,
        count=np.bincount(cell, minlength=shape[0] * shape[1]).reshape(shape),
        balance=np.asarray(np.bincount(cell, np.sign(off), shape[0] * shape[1]).reshape(shape), float),
        deep=np.bincount(cell[is_deep], minlength=shape[0] * shape[1]).reshape(shape),
        scatter_m=np.maximum(scatter, 1e-3 * sigma),
        face=face,
        edge=edge,
        around_m=around,
        width_m=width,
        z_m=np.linspace(0, length, n_places + 1),
    )


def _strips(field: ResidualField, solid: Solid, size: float) -> tuple[IntArray, IntArray, FloatArray, FloatArray, IntArray]:
    """Per point its strip; per strip its face, width, middle around the loop, and the edge of the polygons under its middle."""
    start, of_edge, lengths = [], [], []
    for points, names in zip(solid.loops, solid.loop_names, strict=True):
        long = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
        start.append(np.concatenate([[0.0], np.cumsum(long)[:-1]]))
        lengths.append(long)
        of_edge += [field.names.index(name) for name in names]
    first, long, owner = np.concatenate(start), np.concatenate(lengths), np.array(of_edge, np.int64)
    strip = np.zeros(len(field.face), np.int64)
    face: list[int] = []
    edge: list[int] = []
    width: list[float] = []
    around: list[float] = []
    for k in np.unique(owner):
        of = np.flatnonzero(owner == k)
        low, whole = first[of[0]], float(long[of].sum())
        n = max(1, round(whole / size))
        rows = field.face == k
        strip[rows] = len(face) + np.clip((field.around_m[rows] - low) / whole * n, 0, n - 1e-9).astype(np.int64)
        for i in range(n):
            middle = low + (i + 0.5) / n * whole
            face.append(int(k))
            width.append(whole / n)
            around.append(middle)
            edge.append(int(of[min(np.searchsorted(first[of], middle, side="right") - 1, len(of) - 1)]))
    return strip, np.array(face, np.int64), np.array(width), np.array(around), np.array(edge, np.int64)


def _robust_std(values: FloatArray) -> float:
    if len(values) < LEAST_POINTS:
        return 0.0
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


# ------------------------------------------------------------------ shifts


def _shifts(cells: _Cells) -> list[_Hit]:
    """Windows with too many points above or below the median of their strips."""
    enough = cells.count >= LEAST_POINTS
    usable = enough & (enough.sum(axis=1) >= STRIP_CELLS)[:, None]
    count, balance = np.where(usable, cells.count, 0), np.where(usable, cells.balance, 0.0)
    found: list[tuple[int, int, int, int, float]] = []
    scale: dict[int, float] = {}
    for span in WINDOWS:
        for first, n_strips in _groups(cells, span):
            rows = slice(first, first + n_strips)
            total, n = _window(balance[rows].sum(axis=0), span), _window(count[rows].sum(axis=0), span)
            found += [(first, n_strips, span, int(k), float(total[k] / math.sqrt(n[k]))) for k in np.flatnonzero(n >= LEAST_POINTS)]
        scores = np.array([row[4] for row in found if row[2] == span])
        scale[span] = max(1.0, _robust_std(scores))
    made = []
    for first, n_strips, span, place, score in found:
        p = min(1.0, len(found) * float(erfc(abs(score) / scale[span] / math.sqrt(2))))
        if p < LEVEL:
            made.append(_Hit(strip=first, n_strips=n_strips, place=place, n_places=span, depth_m=0.0, std_m=scale[span], p_value=p))
    return made


def _groups(cells: _Cells, span: int) -> list[tuple[int, int]]:
    """First strip and number of strips of each window around the section: neighbours of one face, fewer where the face has fewer."""
    out = []
    for face in np.unique(cells.face):
        rows = np.flatnonzero(cells.face == face)
        size = min(span, len(rows))
        out += [(int(rows[k]), size) for k in range(len(rows) - size + 1)]
    return out


def _window(values: FloatArray, span: int) -> FloatArray:
    """Sums of `span` places in a row."""
    whole = np.concatenate([[0.0], np.cumsum(values, dtype=float)])
    return np.asarray(whole[span:] - whole[:-span]) if len(values) >= span else np.zeros(0)


def _deep(cells: _Cells) -> list[_Hit]:
    """Cells with more points deep inside the member than its clutter puts there: a surface that should not be."""
    rate = np.array([np.sort(row)[: max(1, len(row) * 3 // 4)].mean() for row in cells.deep])  # damage is local: the lower three quarters
    expected = np.maximum(rate, max(float(cells.deep.mean()), 0.05))
    # gammainc(k, m): chance of k or more where Poisson expects m
    p = np.minimum(1.0, cells.deep.size * gammainc(cells.deep, expected[:, None]))
    places = zip(*np.nonzero((p < LEVEL) & (cells.deep >= LEAST_POINTS)), strict=True)
    return [_Hit(strip=int(i), n_strips=1, place=int(k), n_places=1, depth_m=0.0, std_m=1.0, p_value=float(p[i, k])) for i, k in places]


# ------------------------------------------------------------------ places


def _apart(hits: list[_Hit], cells: _Cells) -> list[_Hit]:
    """The most significant window of each place: others that overlap or touch it belong to it."""
    kept: list[_Hit] = []
    taken = np.zeros(cells.count.shape, bool)
    for hit in sorted(hits, key=lambda h: (h.p_value, h.n_places, h.strip, h.place)):
        if not taken[hit.strip : hit.strip + hit.n_strips, hit.place : hit.place + hit.n_places].any():
            kept.append(hit)
        low, high = max(0, hit.strip - 1), hit.strip + hit.n_strips + 1
        same = cells.face[low:high] == cells.face[hit.strip]
        taken[low:high, max(0, hit.place - 1) : hit.place + hit.n_places + 1] |= same[:, None]
    return kept


def _measured(hit: _Hit, cells: _Cells) -> _Hit:
    """With its depth and the standard deviation of that: of the part of the window that is surely deepest (median less twice its error)."""
    best = replace(hit, depth_m=0.0, std_m=math.inf)
    for span in (1, 2, 4):
        if span > max(hit.n_strips, hit.n_places):
            break
        rows, columns = min(span, hit.n_strips), min(span, hit.n_places)
        for strip in range(hit.strip, hit.strip + hit.n_strips - rows + 1):
            for place in range(hit.place, hit.place + hit.n_places - columns + 1):
                off = cells.off_m[_within(cells, strip, rows, place, columns)]
                if len(off) < LEAST_POINTS:
                    continue
                scatter = max(_robust_std(off), float(cells.scatter_m[strip]))
                depth, std = -float(np.median(off)), MEDIAN_STD * hit.std_m * scatter / math.sqrt(len(off))
                if best.std_m == math.inf or abs(depth) - 2 * std > abs(best.depth_m) - 2 * best.std_m:
                    best = replace(best, depth_m=depth, std_m=std)
    return best


def _within(cells: _Cells, strip: int, n_strips: int, place: int, n_places: int) -> BoolArray:
    own = (cells.strip >= strip) & (cells.strip < strip + n_strips)
    return np.asarray(own & (cells.place >= place) & (cells.place < place + n_places))


def _told(hits: list[_Hit], cells: _Cells, solid: Solid) -> tuple[Damage, ...]:
    """The hits as damage. A bulge across the wall from an inward shift, or from a face that is gone, is the other side of a dent."""
    told: list[Damage] = []
    partners = {id(hit): _across(hit, hits, cells, solid) for hit in hits}
    for hit in hits:
        other = partners[id(hit)]
        if hit.depth_m < 0 and other is not None:
            continue  # told with its partner
        gone = other is None and _is_gone_across(hit, cells, solid)
        bent = other is not None or (hit.depth_m < 0 and gone)
        kind = "dent" if bent else "bulge" if hit.depth_m < 0 else "loss"
        depth = max(abs(hit.depth_m), abs(other.depth_m) if other else 0.0) if bent else hit.depth_m
        if gone and not bent:
            depth = _worn_through(hit, cells, solid)
        section_at, share = _place(hit, cells, solid)
        position = swept_points(solid.sweep, section_at[None], np.array([share]))[0, 0]
        along = float(cells.z_m[hit.place + hit.n_places] - cells.z_m[hit.place])
        size = max(along, float(cells.width_m[hit.strip : hit.strip + hit.n_strips].sum()))
        told.append(Damage(kind=kind, position_m=position, size_m=size, depth_m=depth, std_m=hit.std_m, p_value=hit.p_value))
    return tuple(told)


def _worn_through(hit: _Hit, cells: _Cells, solid: Solid) -> float:
    """Depth of a loss that wore the far face of the wall down to nearer this one: wall less the distance of its points from here."""
    off = cells.off_m[_within(cells, hit.strip, hit.n_strips, hit.place, hit.n_places)]
    apart = off[off < -3 * cells.scatter_m[hit.strip]]
    if len(apart) < LEAST_POINTS:
        return hit.depth_m
    here, _ = _place(hit, cells, solid)
    wall = min(_thickness(here, cells.edge[k], solid) for k in _strips_across(hit, cells, solid))
    return wall + float(np.median(apart))


def _thickness(here: FloatArray, edge: int, solid: Solid) -> float:
    """Distance of a place of the section from the line of an edge."""
    start = np.concatenate(solid.loops)
    along = np.concatenate([np.roll(loop, -1, axis=0) for loop in solid.loops])[edge] - start[edge]
    away = here - start[edge]
    return float(abs(away[0] * along[1] - away[1] * along[0]) / np.linalg.norm(along))


def _place(hit: _Hit, cells: _Cells, solid: Solid) -> tuple[FloatArray, float]:
    """(2,) place in the section and share along the member of the middle of a window."""
    middle = (hit.place + hit.n_places / 2) / (len(cells.z_m) - 1)
    rows = range(hit.strip, hit.strip + hit.n_strips)
    return np.mean([_on_section(cells, solid, row) for row in rows], axis=0), float(middle)


def _on_section(cells: _Cells, solid: Solid, strip: int) -> FloatArray:
    """(2,) the middle of a strip."""
    start = np.concatenate(solid.loops)
    end = np.concatenate([np.roll(loop, -1, axis=0) for loop in solid.loops])
    first = np.concatenate([np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1))[:-1]]) for p in solid.loops])
    k = int(cells.edge[strip])
    part = (cells.around_m[strip] - first[k]) / np.linalg.norm(end[k] - start[k])
    return np.asarray(start[k] + np.clip(part, 0, 1) * (end[k] - start[k]))


def _strips_across(hit: _Hit, cells: _Cells, solid: Solid) -> list[int]:
    """The strips of other faces within a wall of the window."""
    here, _ = _place(hit, cells, solid)
    reach = 1.5 * solid.wall_m + float(cells.width_m[hit.strip]) / 2
    others = [k for k in range(len(cells.face)) if cells.face[k] != cells.face[hit.strip]]
    return [k for k in others if np.linalg.norm(_on_section(cells, solid, k) - here) <= reach and _faces_away(hit, k, cells, solid)]


def _faces_away(hit: _Hit, strip: int, cells: _Cells, solid: Solid) -> bool:
    """Is the face of the strip the other side of the wall (opposite normals), not the next face round a corner?"""
    start = np.concatenate(solid.loops)
    along = np.concatenate([np.roll(loop, -1, axis=0) for loop in solid.loops]) - start
    a, b = along[cells.edge[hit.strip]], along[cells.edge[strip]]
    return bool(a @ b < -0.7 * np.linalg.norm(a) * np.linalg.norm(b))


def _across(hit: _Hit, hits: list[_Hit], cells: _Cells, solid: Solid) -> _Hit | None:
    """The hit on the other side of the wall that moves the same way (inward here is outward there)."""
    strips = set(_strips_across(hit, cells, solid))
    for other in hits:
        overlap = other.place < hit.place + hit.n_places and hit.place < other.place + other.n_places
        if overlap and other.depth_m * hit.depth_m < 0 and strips & set(range(other.strip, other.strip + other.n_strips)):
            return other
    return None


def _is_gone_across(hit: _Hit, cells: _Cells, solid: Solid) -> bool:
    """Has the other side of the wall far fewer points there than elsewhere?"""
    strips = _strips_across(hit, cells, solid)
    if not strips:
        return False
    count = cells.count[strips].sum(axis=0)
    usual = float(np.median(count))
    return usual >= CELL_POINTS / 2 and float(count[hit.place : hit.place + hit.n_places].mean()) < MISSING * usual
