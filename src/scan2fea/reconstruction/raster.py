"""Where a scan was seen from, told by the order of its points alone.

A range camera writes its image row by row. Its noise lies along the rays, so however noisy the points are, those of one row stay exactly on
one plane, all planes of one image meet in a line through the camera, and the steps along a row are equal: position, axes and pixel pitch of
the camera follow to the digits of the file. Nothing is assumed of the shape. Where the order is lost there are no such rows, and no answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from scan2fea.kernel.jit import jit
from scan2fea.kernel.normals import least_axis
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

DIGITS = 64 * 2.0**-24  # of the largest coordinate: how exactly a file of single precision keeps a row on its plane
FEWEST = 4  # points of a row that are needed to see that it is one
ROWS = 4  # rows of an image
PENCIL = 3e-5  # of the extent: how exactly the planes of an image meet in a line
ON_GRID = 0.02  # pixels
STEPS = 0.95  # share of the steps along rows that are whole numbers of pixels
PROBES, PROBED = 400, 0.5  # windows looked at first, and share of them that must lie on planes
TRIALS, TRIAL_STEPS = 300, 600
EXPLAINED = 0.97  # share of the points that must belong to images
SKIPPED = 4  # points in a row that may miss the grid before the image has ended
WIDEST = 2**14  # pixels of an image, either way: more than range cameras have
MARGIN = 2  # pixels of free view round an image
CUT_OFF = 0.5  # an outermost line with more than this share of the longest may be where the image was cut off


@dataclass(frozen=True, eq=False, kw_only=True)
class Images(Value):
    """The rays of all images: those that came back and those that did not.

    origin, direction : (m, 3).   range_m : (m,), nan: nothing came back.   point : (m,) the point of the ray, -1.   image : (m,) its image.
    pixel : (m, 2) column and row.   pitch_rad : of the pixels, the larger of the two.
    """

    origin: FloatArray
    direction: FloatArray
    range_m: FloatArray
    point: IntArray
    image: IntArray
    pixel: IntArray
    pitch_rad: float

    _ROWS = (("origin", "direction", "range_m", "point", "image", "pixel"),)

    @property
    def is_hit(self) -> BoolArray:
        return np.isfinite(self.range_m)

    @property
    def n_images(self) -> int:
        return int(self.image.max()) + 1 if len(self.image) else 0


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera(Value):
    """position : (3,).   axes : (3, 3) rows x (along image rows), y, z (view).   pitch : (2,) tangent of one pixel along x and y.   phase : (2,)
    pixels that the view axis lies off the grid.
    """

    position: FloatArray
    axes: FloatArray
    pitch: FloatArray
    phase: FloatArray

    def pixels(self, points: FloatArray) -> FloatArray:
        """(n, 2) column and row of points, nan behind the camera."""
        local = (points - self.position) @ self.axes.T
        depth = np.where(local[:, 2] > 0, local[:, 2], np.nan)
        return np.asarray(local[:, :2] / depth[:, None] / self.pitch - self.phase)

    def directions(self, pixel: IntArray) -> FloatArray:
        way = self.axes[2] + ((pixel + self.phase) * self.pitch) @ self.axes[:2]
        return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True))


def images_of(points: FloatArray, raw_index: IntArray) -> Images | None:
    """The images that `points`, in the order of their file, were taken in; None where the order does not tell.

    points : (n, 3).   raw_index : (n,) row in the file: where points in between are gone, a pixel without a point is not known to be empty.
    """
    if len(points) < PROBES:
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    unit = float((high - low).max())
    if not unit > 0:
        return None
    local = np.ascontiguousarray((points - 0.5 * (low + high)) / unit)
    tolerance = DIGITS * max(1.0, float(np.abs(points).max()) / unit)
    if tolerance > 1e-3 or _probed(local, tolerance) < PROBED:
        return None
    runs = _runs(local, tolerance)
    cameras, spans = [], []
    end = 0
    planes = np.array([_plane(local[a:b]) for a, b in runs]) if len(runs) else np.zeros((0, 4))
    for first, last in _pencils(planes):
        if runs[last - 1, 1] <= end:
            continue
        camera = _camera([local[a:b] for a, b in runs[first:last]], planes[first:last])
        if camera is None:
            continue
        start, stop = _span(camera, local, int(runs[first, 0]), int(runs[last - 1, 1]), end)
        cameras.append(camera)
        spans.append((start, stop))
        end = stop
    return _gathered(points, raw_index, local, cameras, spans, unit, 0.5 * (low + high))


def _probed(points: FloatArray, tolerance: float) -> float:
    """Share of windows of FEWEST + 1 points that lie on a plane, but not on a line."""
    width = FEWEST + 1
    rows = np.linspace(0, len(points) - width, PROBES).astype(np.int64)
    patch = points[rows[:, None] + np.arange(width)]
    size = np.linalg.svd(patch - patch.mean(axis=1, keepdims=True), compute_uv=False)
    return float(((size[:, 2] < tolerance) & (size[:, 1] > 10 * tolerance)).mean())


def _plane(row: FloatArray) -> FloatArray:
    """(4,) normal and minus offset of the plane of least squares, of either sign."""
    centre = row.mean(axis=0)
    normal = np.linalg.svd(row - centre, full_matrices=False)[2][2]
    return np.append(normal, -normal @ centre)


@jit
def _runs(points: FloatArray, tolerance: float) -> IntArray:
    """(k, 2) first and past-last of the longest runs of points that lie on one plane each."""
    out = np.zeros((len(points) // FEWEST + 1, 2), np.int64)
    k, i = 0, 0
    while i + FEWEST <= len(points):
        j = i
        n = 0.0
        s = np.zeros(3)
        m = np.zeros((3, 3))
        nx = ny = nz = offset = 0.0
        while j < len(points):
            d = points[j] - points[i]
            if j - i >= FEWEST and abs(nx * d[0] + ny * d[1] + nz * d[2] - offset) > tolerance:
                break
            n += 1.0
            s += d
            for a in range(3):
                for b in range(3):
                    m[a, b] += d[a] * d[b]
            j += 1
            if j - i >= FEWEST:
                c = s / n
                nx, ny, nz = least_axis(
                    m[0, 0] / n - c[0] * c[0], m[0, 1] / n - c[0] * c[1], m[0, 2] / n - c[0] * c[2],
                    m[1, 1] / n - c[1] * c[1], m[1, 2] / n - c[1] * c[2], m[2, 2] / n - c[2] * c[2],
                )  # fmt: skip
                offset = nx * c[0] + ny * c[1] + nz * c[2]
                if j - i == FEWEST:
                    worst = 0.0
                    for q in range(i, j):
                        e = points[q] - points[i]
                        worst = max(worst, abs(nx * e[0] + ny * e[1] + nz * e[2] - offset))
                    if worst > tolerance:
                        break
        if j - i > FEWEST:
            out[k, 0], out[k, 1] = i, j
            k += 1
            i = j
        else:
            i += 1
    return out[:k]


def _pencils(planes: FloatArray) -> list[tuple[int, int]]:
    """First and past-last of the runs of planes that meet in one line each: of rank two."""
    out, k = [], 0
    while k + ROWS <= len(planes):
        j = k + ROWS
        if np.linalg.svd(planes[k:j], compute_uv=False)[2] > PENCIL:
            k += 1
            continue
        missed = 0
        basis = np.linalg.svd(planes[k:j])[2][:2]
        while j < len(planes) and missed < 2:
            off = planes[j] - basis.T @ (basis @ planes[j])
            missed = 0 if np.linalg.norm(off) < PENCIL else missed + 1
            j += 1
            if not missed:
                basis = np.linalg.svd(planes[k:j])[2][:2]
        out.append((k, j - missed))
        k = j - missed
    return out


def _camera(rows: list[FloatArray], planes: FloatArray) -> Camera | None:
    """The camera of an image: on the line in which its row planes meet, where tangents along both axes step evenly."""
    basis = np.linalg.svd(planes)[2][:2]
    x = np.cross(basis[0, :3], basis[1, :3])
    if np.linalg.norm(x) <= PENCIL:  # parallel planes: they meet nowhere
        return None
    x /= np.linalg.norm(x)
    middle = np.concatenate(rows).mean(axis=0)
    foot = np.linalg.solve(np.vstack([basis[:, :3], x]), np.append(-basis[:, 3], x @ middle))  # of the line, nearest to the points
    view = middle - foot
    if np.linalg.norm(view) <= PENCIL:  # a line through the points, not through a camera before them
        return None
    view /= np.linalg.norm(view)
    up = np.cross(view, x)
    angle = np.array([np.arctan2((row.mean(axis=0) - foot) @ up, (row.mean(axis=0) - foot) @ view) for row in rows])
    step = float(np.median(np.diff(angle)))
    if step == 0.0:
        return None
    number = np.concatenate([[0.0], np.cumsum(np.round(np.diff(angle) / step))])

    def uneven(guess: FloatArray) -> FloatArray:
        return np.asarray((np.tan(angle - guess[0]) - guess[1] * step * number - guess[2]) / step)

    turn, stretch, _ = least_squares(uneven, [0.0, 1.0, np.tan(angle[0])], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    z, pitch_y = view * np.cos(turn) + up * np.sin(turn), abs(step * stretch)
    found = _along(rows, foot, x, z)
    if found is None:
        return None
    shift, pitch_x = found
    camera = Camera(position=foot + shift * x, axes=np.stack([x, np.cross(z, x), z]), pitch=np.array([pitch_x, pitch_y]), phase=np.zeros(2))
    return _on_phase(camera, np.concatenate(rows))


def _along(rows: list[FloatArray], foot: FloatArray, x: FloatArray, z: FloatArray) -> tuple[float, float] | None:
    """Where on the line through `foot` along x the steps of a row are whole numbers of one pitch: d(a / depth) - shift d(1 / depth) = k pitch.

    None where they are not, or points lie beside or behind the camera.
    """
    depth = [(row - foot) @ z for row in rows]
    if min(d.min() for d in depth) <= PENCIL:
        return None
    across = [((row - foot) @ x) / d for row, d in zip(rows, depth, strict=True)]
    inverse = [1.0 / d for d in depth]
    da, db = np.concatenate([np.diff(a) for a in across]), np.concatenate([np.diff(b) for b in inverse])
    rng = np.random.default_rng(0)
    some = rng.permutation(len(da))[:TRIAL_STEPS]
    best, answer = 0, (0.0, 1.0)
    for i, j in rng.integers(0, len(some), (TRIALS, 2)):
        i, j = some[i], some[j]
        if db[i] == db[j]:
            continue
        shift = (da[i] - da[j]) / (db[i] - db[j])
        pitch = da[i] - shift * db[i]
        if pitch == 0.0:
            continue
        n = int(_whole(da[some], db[some], shift, pitch).sum())
        if n > best:
            best, answer = n, (shift, pitch)
    for _ in range(2):
        shift, pitch = answer
        good = _whole(da, db, shift, pitch)
        if good.sum() < 3:
            return None
        k = np.round((da - shift * db) / pitch)
        solved = np.linalg.lstsq(np.stack([db[good], k[good]], axis=1), da[good], rcond=None)[0]
        answer = (float(solved[0]), float(solved[1]))
    return (answer[0], abs(answer[1])) if good.mean() >= STEPS else None


def _whole(da: FloatArray, db: FloatArray, shift: float, pitch: float) -> BoolArray:
    """Steps that are a whole number of pitches, but not none."""
    steps = (da - shift * db) / pitch
    return np.asarray((np.abs(steps - np.round(steps)) < ON_GRID) & (np.abs(np.round(steps)) >= 1))


def _on_phase(camera: Camera, points: FloatArray) -> Camera:
    """The camera with its grid moved so that the pixels of `points` are whole numbers."""
    phase = np.angle(np.exp(2j * np.pi * camera.pixels(points)).mean(axis=0)) / (2 * np.pi)
    return Camera(position=camera.position, axes=camera.axes, pitch=camera.pitch, phase=phase)


def _span(camera: Camera, points: FloatArray, first: int, last: int, least: int) -> tuple[int, int]:
    """The image reaches as far before and behind the rows that found it as points lie on its grid."""
    pixel = camera.pixels(points)
    on = (np.abs(pixel - np.round(pixel)) < ON_GRID).all(axis=1)
    off = np.flatnonzero(np.convolve(~on, np.ones(SKIPPED), "valid") >= SKIPPED)  # windows without any
    before, behind = off[off + SKIPPED <= first], off[off >= last]
    start = int(before[-1]) + SKIPPED if len(before) else 0
    stop = int(behind[0]) if len(behind) else len(points)
    return max(start, least), stop


def _gathered(
    points: FloatArray,
    raw_index: IntArray,
    local: FloatArray,
    cameras: list[Camera],
    spans: list[tuple[int, int]],
    unit: float,
    middle: FloatArray,
) -> Images | None:
    """All rays; None where too few points belong to an image."""
    origin, direction, length, row, image, pixel = [], [], [], [], [], []
    explained = 0
    for k, (camera, (start, stop)) in enumerate(zip(cameras, spans, strict=True)):
        place = camera.pixels(local[start:stop])
        on = (np.abs(place - np.round(place)) < ON_GRID).all(axis=1)
        mine = start + np.flatnonzero(on)
        if not len(mine):
            continue
        if np.ptp(place[on], axis=0).max() > WIDEST:
            continue
        grid = np.round(place[on]).astype(np.int64)
        explained += len(mine)
        empty = _empty(grid, mine, raw_index)
        eye = camera.position * unit + middle
        way = points[mine] - eye
        distance = np.linalg.norm(way, axis=1)
        origin.append(np.tile(eye, (len(mine) + len(empty), 1)))
        direction.append(np.concatenate([way / distance[:, None], camera.directions(empty)]))
        length.append(np.concatenate([distance, np.full(len(empty), np.nan)]))
        row.append(np.concatenate([mine, np.full(len(empty), -1)]))
        image.append(np.full(len(mine) + len(empty), k))
        pixel.append(np.concatenate([grid, empty]))
    if explained < EXPLAINED * len(points):
        return None
    return Images(
        origin=np.concatenate(origin),
        direction=np.concatenate(direction),
        range_m=np.concatenate(length),
        point=np.concatenate(row).astype(np.int64),
        image=np.concatenate(image).astype(np.int64),
        pixel=np.concatenate(pixel).astype(np.int64),
        pitch_rad=float(max(camera.pitch.max() for camera in cameras)),
    )


def _empty(grid: IntArray, mine: IntArray, raw_index: IntArray) -> IntArray:
    """(k, 2) pixels from which nothing came back, in the frame of the image and a margin round it.

    Left out: pixels between two points of the file that other points have been taken from, and the margin beyond an outermost line so long
    that the image may have been cut off there.
    """
    low, high = grid.min(axis=0), grid.max(axis=0)
    sides = []
    for axis in range(2):
        count = np.bincount(grid[:, axis] - low[axis])
        longest = count.max()
        sides.append((MARGIN if count[0] <= CUT_OFF * longest else 0, MARGIN if count[-1] <= CUT_OFF * longest else 0))
    columns = np.arange(low[0] - sides[0][0], high[0] + sides[0][1] + 1)
    rows = np.arange(low[1] - sides[1][0], high[1] + sides[1][1] + 1)
    wide = len(columns) + 2
    ways = np.sign([_trend(grid[:, 0], grid[:, 1]), float(grid[-1, 1] - grid[0, 1])])

    def order(pixel: IntArray) -> IntArray:
        """Place of a pixel in the order of the file."""
        return np.asarray(ways[1] * (pixel[:, 1] - low[1]) * 2 * wide + ways[0] * (pixel[:, 0] - low[0]), np.int64)

    every = np.stack(np.meshgrid(columns, rows, indexing="ij"), axis=-1).reshape(-1, 2)
    taken = {tuple(pixel) for pixel in grid.tolist()}
    free = every[np.array([tuple(pixel) not in taken for pixel in every.tolist()], bool)]
    rank = np.argsort(order(grid), kind="stable")
    raw = raw_index[mine][rank]
    after = np.searchsorted(order(grid)[rank], order(free))
    known = np.ones(len(free), bool)
    inner = (after > 0) & (after < len(raw))
    known[inner] = raw[after[inner]] - raw[after[inner] - 1] == 1
    first, last = int(mine[0]), int(mine[-1])
    known[after == 0] = (first == 0 and raw_index[0] == 0) or (first > 0 and raw_index[first] - raw_index[first - 1] == 1)
    known[after == len(raw)] = last == len(raw_index) - 1 or raw_index[last + 1] - raw_index[last] == 1
    return np.asarray(free[known])


def _trend(column: IntArray, row: IntArray) -> float:
    """Which way columns go along the rows of the file."""
    step = np.diff(column)[np.diff(row) == 0]
    return float(np.median(np.sign(step))) if len(step) else 1.0
