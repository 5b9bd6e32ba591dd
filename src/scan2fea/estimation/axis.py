"""The provisional axis of a member: principal directions, then the tilt, curve and twist that make the points seen along the axis sharpest.

A section swept along its axis projects onto the plane across it as a sharp outline, whatever part of its faces was seen: the mean of the
points may wander, the outline may not. Tilt, bow and twist are Legendre series of zeta = -1 .. 1; the density of the projected points is
estimated from themselves (a Gaussian kernel of falling width) and the series climb its logarithm by scoring. Nothing is assumed of the family.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from scan2fea.errors import EstimationError, require
from scan2fea.estimation.ends import rough_ends
from scan2fea.kernel.axis_scores import axis_scores
from scan2fea.kernel.blurred import grid_of, log_density_of
from scan2fea.kernel.noise import sampled_rows
from scan2fea.types import FloatArray, Value

_POINTS = 6_000
_SLENDER = 2.0  # shape-estimation.md, method 1: below this ratio of length to section every principal direction is tried
_WIDTHS = (0.2, 0.12, 0.07, 0.04, 0.025)  # of the kernel, in diameters of the section
_STEPS = 8  # at each width, at most
_STILL = 0.01  # of the width of the kernel: a step that is no step
_CAUTION = 0.3
_COLLINEAR = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Axis(Value):
    """A provisional member frame and the curve that was taken out.

    T_world_axis : (4, 4), z along the axis, origin in the middle of the points.   ends : z of the ends, roughly.   size_m : diameter of the section.
    bow : (2, k) metres and twist : (k,) radians, Legendre coefficients from degree 0 on (0 and 1 are zero in bow, 0 in twist) over `ends`.
    sharpness : mean log density of the points seen along the axis, per point, with the length's: comparable between axes of one cloud.
    """

    T_world_axis: FloatArray
    ends: tuple[float, float]
    size_m: float
    bow: FloatArray
    twist: FloatArray
    sharpness: float

    def zeta(self, z: FloatArray) -> FloatArray:
        return np.asarray((2 * z - self.ends[0] - self.ends[1]) / (self.ends[1] - self.ends[0]))

    def straightened(self, points: FloatArray) -> FloatArray:
        """(n, 3) world points in the frame of the axis, bow and twist taken out."""
        local = (points - self.T_world_axis[:3, 3]) @ self.T_world_axis[:3, :3]
        if not self.bow.any() and not self.twist.any():
            return np.asarray(local)
        return _unbent(local, self.zeta(local[:, 2]), self.bow, self.twist)


def axes_of(points: FloatArray, seed: int = 0, max_degree: int = 4) -> tuple[Axis, ...]:
    """The axes worth trying, most slender first: one for a long member, up to three where the length is below twice the section.

    points : (n, 3). Raises EstimationError where they lie on one line or at one place.
    """
    some = points[sampled_rows(len(points), _POINTS, seed)]
    middle = np.median(some, axis=0)
    centred = some - middle
    reach = np.linalg.norm(centred, axis=1)
    core = centred[reach <= 1.2 * np.quantile(reach, 0.95)]
    values, vectors = np.linalg.eigh(np.cov(core.T))
    require(values[2] > 0, EstimationError, f"all {len(points)} points lie at one place: there is no member")
    require(values[1] > (_COLLINEAR**2) * values[2], EstimationError, f"the {len(points)} points lie on one line: a member has a section")
    first = _along(some, middle, vectors[:, 2], max_degree)
    if first.ends[1] - first.ends[0] >= _SLENDER * first.size_m:
        return (first,)
    wide = [k for k in (1, 0) if values[k] > (_COLLINEAR**2) * values[2]]  # none runs square to a plane that has no thickness at all
    found = [first, *(_along(some, middle, vectors[:, k], max_degree) for k in wide)]
    order = sorted(range(len(found)), key=lambda k: (-found[k].sharpness, k))
    return tuple(found[k] for k in order)


def tilted(axis: Axis, points: FloatArray, slope: FloatArray, seed: int = 0) -> Axis:
    """The axis along (slope, 1) of its own frame, where a section that was fitted along it says that it runs. points : (n, 3), for the new ends."""
    R = _frame(axis.T_world_axis[:3, :3] @ np.array([slope[0], slope[1], 1.0]))
    R = R if R[:, 2] @ axis.T_world_axis[:3, 2] > 0 else R * np.array([1.0, -1.0, -1.0])
    T = axis.T_world_axis.copy()
    T[:3, :3] = R
    some = points[sampled_rows(len(points), _POINTS, seed)]
    low, high = rough_ends((some - T[:3, 3]) @ R[:, 2])
    return dataclasses.replace(axis, T_world_axis=T, ends=(low, high))


def turned(axis: Axis) -> Axis:
    """The same axis run the other way: a half turn about its x, (x, y, z) -> (x, -y, -z)."""
    odd = np.array([(-1.0) ** k for k in range(max(axis.bow.shape[1], len(axis.twist)))])
    return dataclasses.replace(
        axis,
        T_world_axis=axis.T_world_axis @ np.diag([1.0, -1.0, -1.0, 1.0]),
        ends=(-axis.ends[1], -axis.ends[0]),
        bow=axis.bow * odd[: axis.bow.shape[1]] * np.array([[1.0], [-1.0]]),
        twist=-axis.twist * odd[: len(axis.twist)],
    )


def _frame(direction: FloatArray) -> FloatArray:
    """(3, 3) rotation with z along the direction, whose largest component is made positive."""
    z = direction / np.linalg.norm(direction)
    z = z * (1.0 if z[np.abs(z).argmax()] > 0 else -1.0)
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], 1)


def _along(points: FloatArray, middle: FloatArray, direction: FloatArray, max_degree: int) -> Axis:
    R = _frame(direction)
    slender = False
    for _ in range(2):  # tilt first, in a frame turned onto it
        local = (points - middle) @ R
        low, high = rough_ends(local[:, 2])
        size = _size(local, low, high)
        slender = high - low >= _SLENDER * size
        bow, _ = _climb(_inside(local, low, high), (low, high), size, 1, 0)
        tilt = 2 * bow[:, 1] / (high - low)
        R = _frame(R @ np.array([tilt[0], tilt[1], 1.0]))
    local = (points - middle) @ R
    low, high = rough_ends(local[:, 2])
    size = _size(local, low, high)
    inside = _inside(local, low, high)
    zeta = (2 * inside[:, 2] - low - high) / (high - low)
    straight = np.zeros((2, max_degree + 1)), np.zeros(2)
    sharpness = _sharpness(inside, size) - math.log(max(high - low, 1e-300))
    if slender and max_degree > 1:
        bent = _bent(inside, (low, high), size, max_degree)
        gain = (_sharpness(_unbent(inside, zeta, *bent), size) - math.log(max(high - low, 1e-300)) - sharpness) * len(inside)
        if gain > 0.5 * (2 * max_degree - 1) * math.log(len(inside)):
            return _turned(middle, R, (low, high), size, bent, sharpness + gain / len(inside))
    return _turned(middle, R, (low, high), size, straight, sharpness)


def _turned(middle: FloatArray, R: FloatArray, ends: tuple[float, float], size: float, bent: tuple[FloatArray, FloatArray], sharpness: float) -> Axis:
    """The axis with what its bow holds of a tilt left in: the fit of the section takes it up."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, middle
    return Axis(T_world_axis=T, ends=ends, size_m=size, bow=bent[0], twist=bent[1], sharpness=sharpness)


def _inside(local: FloatArray, low: float, high: float) -> FloatArray:
    margin = 0.02 * (high - low)
    return local[(local[:, 2] > low + margin) & (local[:, 2] < high - margin)]


def _size(local: FloatArray, low: float, high: float) -> float:
    """Diameter of the section: of the points without stray ones, from slices so that a bow does not count."""
    inside = _inside(local, low, high)
    if len(inside) < 10:
        return float(np.ptp(local[:, :2], axis=0).max())
    n_slices = int(np.clip(len(inside) // 100, 1, 12))
    slot = np.minimum(((inside[:, 2] - low) / (high - low) * n_slices).astype(int), n_slices - 1)
    sizes = []
    for k in range(n_slices):
        own = inside[slot == k, :2]
        if len(own) >= 5:
            sizes.append(2 * float(np.quantile(np.hypot(*(own - np.median(own, axis=0)).T), 0.9)))
    return max(float(np.median(sizes)) if sizes else 0.0, 1e-9 * (high - low))


def _unbent(local: FloatArray, zeta: FloatArray, bow: FloatArray, twist: FloatArray) -> FloatArray:
    x, y = local[:, 0] - legendre.legval(zeta, bow[0]), local[:, 1] - legendre.legval(zeta, bow[1])
    if not twist.any():
        return np.stack([x, y, local[:, 2]], 1)
    angle = legendre.legval(zeta, twist)
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x + s * y, c * y - s * x, local[:, 2]], 1)


def _bent(inside: FloatArray, ends: tuple[float, float], size: float, degree: int) -> tuple[FloatArray, FloatArray]:
    """Bow and twist, from no bow and from the medians of slices: the sharper one."""
    zeta = (2 * inside[:, 2] - ends[0] - ends[1]) / (ends[1] - ends[0])
    slot = np.minimum(((zeta + 1) * 6).astype(int), 11)
    rows = [(zeta[slot == k].mean(), *np.median(inside[slot == k, :2], axis=0)) for k in range(12) if (slot == k).sum() >= 5]
    table = np.array(rows)
    tries = [_climb(inside, ends, size, degree, 1)]
    if len(table) > degree + 2:
        start = np.array(legendre.legfit(table[:, 0], table[:, 1:], degree).T, dtype=np.float64)
        start[:, 0] = 0.0
        if np.abs(start[:, 2:]).max() > 0.1 * size:
            tries.append(_climb(inside, ends, size, degree, 1, start))
    bow, twist = max(tries, key=lambda one: _sharpness(_unbent(inside, zeta, *one), size))
    return bow, twist


def _climb(
    inside: FloatArray, ends: tuple[float, float], size: float, degree: int, twist_degree: int, start: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Bow (2, degree + 1) and twist (twist_degree + 1,) of greatest sharpness near the start; degree 0 stays zero."""
    bow = np.zeros((2, degree + 1)) if start is None else start.copy()
    twist = np.zeros(twist_degree + 1)
    if len(inside) < 20:
        return bow, twist
    zeta = (2 * inside[:, 2] - ends[0] - ends[1]) / (ends[1] - ends[0])
    basis = np.ascontiguousarray(legendre.legvander(zeta, max(degree, twist_degree))[:, 1:], np.float64)
    for width in _WIDTHS:
        h = width * size
        limit = np.r_[np.full(2 * degree, h), np.full(twist_degree, width)]
        u = _unbent(inside, zeta, bow, twist)[:, :2]
        grid = grid_of(u, h)  # one for all steps: their values are compared
        level, slope = log_density_of(u, grid)
        caution = _CAUTION
        for _ in range(_STEPS):
            step = _step(u, slope, basis, twist, degree, h, caution)
            step = step * min(1.0, float((limit / np.maximum(np.abs(step), 1e-300)).min()))
            tried_bow, tried_twist = bow.copy(), twist.copy()
            tried_bow[:, 1:] += step[: 2 * degree].reshape(2, degree)
            tried_twist[1:] += step[2 * degree :]
            tried = _unbent(inside, zeta, tried_bow, tried_twist)[:, :2]
            found = log_density_of(tried, grid)
            is_up = float(found[0].sum()) > float(level.sum())
            caution *= 0.3 if is_up else 4.0
            if is_up:
                bow, twist, u, (level, slope) = tried_bow, tried_twist, tried, found
            if (np.abs(step) < _STILL * limit).all():
                break
    return bow, twist


def _step(u: FloatArray, slope: FloatArray, basis: FloatArray, twist: FloatArray, degree: int, h: float, caution: float) -> FloatArray:
    """A step of scoring for the coefficients of bow and twist, (2 degree + twists,). basis : (n, k) Legendre polynomials from degree 1 on.

    On a ridge sharper than the kernel slopes are small, and their products promise steps that are far too long: `caution` adds that share of the
    kernel's own curvature, 1 / h^2.
    """
    total, products, moved = axis_scores(u, slope, basis, twist, degree)
    information = products + np.diag(caution / h**2 * moved)
    unit = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    matrix = information * np.outer(unit, unit) + 1e-9 * np.eye(len(unit))
    return np.asarray(unit * np.linalg.solve(matrix, unit * total))


def _sharpness(local: FloatArray, size: float) -> float:
    """Mean log density of the points across the axis at a kernel of 4 % of the section."""
    return float(log_density_of(local[:, :2], grid_of(local[:, :2], 0.04 * size))[0].mean())
