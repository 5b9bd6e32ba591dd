"""What stands before something: runs of cells of one class that have farther ranges, of one surface, on both sides in their row."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.filtering.range_classes import classes
from scan2fea.filtering.range_image import RangeImage
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

GRAZING = math.radians(80.0)  # a surface seen flatter than this is not told from a step
SIGMAS = 6.0
ROUNDS = 4  # things before things before a wall
LEAST_SIDE = 5  # cells of background on each side that tell what is behind
MOST_SIDE = 60
AGREE = 3.0  # standard deviations by which the two sides may miss one plane; and the part of tau that their own roughness may be


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(Value):
    """Cells of one row that hide something.

    columns : (k,), those without return in between included. behind_m : (k,) the range of the plane that both sides lie on, or of the corner
    between them; nan where neither tells. beside : a column of that surface. scatter : of the sides about it, 1/m (inverse range).
    """

    row: int
    columns: IntArray
    beside: int
    behind_m: FloatArray
    scatter: float


def tau_of(image: RangeImage, sigma_m: float) -> FloatArray:
    """(rows, columns) what ranges of neighbouring cells of one surface differ by at most: noise, and a surface seen at up to 80 degrees."""
    r = np.nan_to_num(image.range_m, nan=0.0)
    return np.asarray(SIGMAS * sigma_m + r * image.step_rad * math.tan(GRAZING))


def occluders(image: RangeImage, sigma_m: float, tau_m: float | None = None, widest_rad: float = math.pi / 4) -> tuple[BoolArray, list[Run]]:
    """(rows, columns) cells that stand before a surface seen on both of their sides, and the runs of each row.

    sigma_m : noise of a range.   tau_m : how much farther the background must be; None: from the noise and the step.   widest_rad : wider things
    hide too much for what is behind them to be told.
    Peeled from the front: what is found is taken away, and what it split is looked at again.
    """
    tau = tau_of(image, sigma_m) if tau_m is None else np.full(image.range_m.shape, float(tau_m))
    label = classes(image, tau)
    mask = np.zeros(image.range_m.shape, bool)
    runs: list[Run] = []
    for row in range(len(label)):
        found = _row(image, row, label[row], tau[row], sigma_m, widest_rad)
        for run in found:
            mask[row, run.columns] = True
        runs += found
    return mask & np.isfinite(image.range_m), runs


def _row(image: RangeImage, row: int, label: IntArray, tau: FloatArray, sigma_m: float, widest_rad: float) -> list[Run]:
    r = image.range_m[row]
    n = len(r)
    gone = np.zeros(n, bool)
    kept: dict[int, Run] = {}
    for _ in range(ROUNDS):
        seen = np.flatnonzero(np.isfinite(r) & ~gone)
        new = [run for run in _candidates(image, row, seen, label, r, tau, sigma_m, widest_rad) if not gone[run.columns[0]]]
        if not new:
            break
        for run in new:
            for first in [k for k, old in kept.items() if np.isin(old.columns, run.columns).all()]:
                del kept[first]  # a thing before this one: the farther background is behind both
            kept[int(run.columns[0])] = run
            gone[run.columns] = True
    return [kept[k] for k in sorted(kept)]


def _candidates(
    image: RangeImage, row: int, seen: IntArray, label: IntArray, r: FloatArray, tau: FloatArray, sigma_m: float, widest_rad: float
) -> list[Run]:
    """Stretches of cells that follow each other without a step, with a step back on both sides, and one surface behind."""
    if len(seen) < 2 * LEAST_SIDE + 1:
        return []
    n = len(r)
    ranges = r[seen]
    step = np.diff(ranges, append=ranges[:1])
    other = np.append(label[seen][1:], label[seen][:1]) != label[seen]
    cut = (np.abs(step) > np.maximum(tau[seen], np.roll(tau[seen], -1))) | (other & (np.abs(step) > 0.5 * tau[seen]))
    if not image.is_closed:
        cut[-1] = True
    ends = np.flatnonzero(cut)  # a stretch ends after these
    if len(ends) < 2:
        return []
    found = []
    m = len(seen)
    for k in range(len(ends)):
        first, last = (int(ends[k - 1]) + 1) % m, int(ends[k])
        left, right = (first - 1) % m, (last + 1) % m
        if not image.is_closed and (first == 0 or last == m - 1):
            continue
        if ranges[left] - ranges[first] <= tau[seen[first]] or ranges[right] - ranges[last] <= tau[seen[last]]:
            continue
        start, width = int(seen[left]) + 1, (int(seen[right]) - int(seen[left]) - 1) % n
        if width * image.step_rad > widest_rad:
            continue
        found.append(_behind(image, row, seen, left, right, (start + np.arange(width)) % n, cut, sigma_m, tau))
    return found


def _behind(
    image: RangeImage, row: int, seen: IntArray, left: int, right: int, columns: IntArray, cut: BoolArray, sigma_m: float, tau: FloatArray
) -> Run:
    """The plane through both sides, or the corner of two; not told where the sides are too short, or do not lie on such.

    The inverse range of any plane is a cos(azimuth) + b sin(azimuth) + c along a ring, exactly: a straight interpolation of the range is not.
    """
    m = len(seen)
    want = int(np.clip(len(columns), LEAST_SIDE, MOST_SIDE))
    sides = [seen[_side(left, -1, want, cut, m)], seen[_side(right, 1, want, cut, m)]]
    untold = Run(row=row, columns=columns, beside=int(seen[left]), behind_m=np.full(len(columns), np.nan), scatter=math.nan)
    if min(len(side) for side in sides) < LEAST_SIDE:
        return untold
    middle = image.azimuth[columns[len(columns) // 2]]
    a = [_turned(image.azimuths(row, c) - middle) for c in (*sides, columns)]
    u = [1.0 / image.range_m[row, side] for side in sides]
    r = image.range_m[row, np.concatenate(sides)]
    rough = max(AGREE * sigma_m, float(tau[seen[[left, right]]].mean()) / AGREE, 1e-6 * float(r.max())) * float((1 / r**2).mean())
    fewest = min(len(side) for side in sides)
    found, scatter = _one_plane(np.concatenate(a[:2]), np.concatenate(u), a[2], fewest < 0.5 * len(columns))
    if scatter > rough:
        found, scatter = _corner(a, u)
    hit = image.range_m[row, columns]
    front = float((1.0 / hit[np.isfinite(hit)]).max())
    if scatter > rough or not bool((found > 0).all()) or float(found.max()) >= front:
        return untold
    return Run(row=row, columns=columns, beside=int(seen[left]), behind_m=1.0 / found, scatter=scatter)


def _turned(a: FloatArray) -> FloatArray:
    """Angles to -pi .. pi."""
    return np.asarray((a + math.pi) % (2 * math.pi) - math.pi)


def _fitted(basis: FloatArray, u: FloatArray) -> tuple[FloatArray, float]:
    x = np.asarray(np.linalg.lstsq(basis, u, rcond=None)[0], np.float64)
    return x, float(np.sqrt(((u - basis @ x) ** 2).sum() / max(len(u) - basis.shape[1], 1)))


def _one_plane(a: FloatArray, u: FloatArray, at: FloatArray, is_short: bool) -> tuple[FloatArray, float]:
    """Inverse ranges at azimuths `at` of the plane through both sides; sides too short to tell its bend are joined straight."""

    def basis(x: FloatArray) -> FloatArray:
        return np.stack([np.ones_like(x), x] if is_short else [np.ones_like(x), np.sin(x), 1.0 - np.cos(x)], axis=1)

    x, scatter = _fitted(basis(a), u)
    return basis(at) @ x, scatter


def _corner(a: list[FloatArray], u: list[FloatArray]) -> tuple[FloatArray, float]:
    """Inverse ranges where an upright or level plane of each side runs on to where they meet, within the run; else a scatter of inf."""
    sides: list[FloatArray] = []
    scatters: list[float] = []
    for k in range(2):
        upright = _fitted(np.stack([np.cos(a[k]), np.sin(a[k])], axis=1), u[k])
        level = _fitted(np.ones((len(u[k]), 1)), u[k])
        is_upright = upright[1] < 0.9 * level[1]  # the level one is the simpler
        basis = np.stack([np.cos(a[2]), np.sin(a[2])], axis=1) if is_upright else np.ones((len(a[2]), 1))
        sides.append(basis @ (upright if is_upright else level)[0])
        scatters.append((upright if is_upright else level)[1])
    left, right = sides
    meets = left[0] >= right[0] and right[-1] >= left[-1]
    return np.asarray(np.maximum(left, right), np.float64), max(scatters) if meets else math.inf


def _side(at: int, way: int, want: int, cut: BoolArray, m: int) -> IntArray:
    """Numbers of up to `want` cells from `at` outward, as far as no step parts them."""
    side = [at]
    while len(side) < want:
        border = side[-1] if way > 0 else (side[-1] - 1) % m
        if cut[border]:
            break
        side.append((side[-1] + way) % m)
    return np.array(side, np.int64)
