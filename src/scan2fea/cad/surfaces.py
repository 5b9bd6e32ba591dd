"""The surfaces of a solid fitted to the measured points, and the relations between them that the data do not refuse.

A right angle, a parallel, a common axis, an equal radius: each is a hypothesis with a chi-square test from the covariance of the fits. Where its
p-value is above `ALPHA` the surfaces are made to obey it exactly and fitted again; where not they stay as measured. Every test is told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaincc

from scan2fea.kernel.surfaces import CYLINDER, FREEDOMS, PLANE, SPHERE, TORUS, Surface, covariance, fitted
from scan2fea.types import BoolArray, FloatArray, Value

ALPHA = 0.01  # a true relation is refused once in a hundred
CANDIDATE_RAD = float(np.radians(2.5))  # farther from parallel or square nobody would draw it so (reference recipe of issue 8)
CLIP = 3.5  # standard deviations: a point farther off belongs to something else
MIDDLE = float(np.cos(np.radians(45.0)))  # what looks the way of a round patch within this is its middle
AXES_ROUNDS, SINGULAR = 4, 1e-9  # of directions put at right angles; below that a right angle follows from others, or nothing tells a direction
SIGMA_FLOOR = 1e-9  # of the size: noise of data without any


@dataclass(frozen=True, eq=False, kw_only=True)
class Snap(Value):
    """One tested relation. relation : parallel, orthogonal, coplanar, concentric, equal radius.   first, second : numbers of the surfaces.

    off : by how much the fits depart from it, radians or metres.   applied : the data do not refuse it.
    """

    relation: str
    first: int
    second: int
    off: float
    p_value: float
    applied: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit(Value):
    """A surface with the points that it was fitted to, the noise of these, and the covariance of the steps of `kernel.surfaces.moved`."""

    surface: Surface
    points: FloatArray
    sigma_m: float
    covariance: FloatArray

    @property
    def tilt(self) -> FloatArray:
        """(2, 2) covariance of the axis in the frame of the surface."""
        k = _tilt(self.surface.kind)
        return self.covariance[k : k + 2, k : k + 2]


def _tilt(kind: str) -> int:
    """The first of the two steps that turn the axis."""
    return {PLANE: 1, SPHERE: 0, TORUS: 3}.get(kind, 2)


def fit_to_points(start: Surface, points: FloatArray, size_m: float) -> Fit | None:
    """Least squares on the points within `CLIP` standard deviations of the surface; the noise is what the fit leaves."""
    surface, used = start, points
    for _ in range(3):
        found = fitted(surface, used)
        if found is None:
            return None
        surface = found
        off = surface.distance(points)
        sigma = max(1.4826 * float(np.median(np.abs(off - np.median(off)))), SIGMA_FLOOR * size_m)
        keep = np.abs(off) <= CLIP * sigma + SIGMA_FLOOR * size_m
        if keep.sum() <= 2 * FREEDOMS[surface.kind]:
            return None
        used = points[keep]
    dof = max(len(used) - FREEDOMS[surface.kind], 1)
    sigma = max(float(np.sqrt((surface.distance(used) ** 2).sum() / dof)), SIGMA_FLOOR * size_m)
    return Fit(surface=surface, points=used, sigma_m=sigma, covariance=covariance(surface, used, sigma))


def simplest(start: Surface, points: FloatArray, size_m: float, square_to: Sequence[FloatArray] = ()) -> Fit | None:
    """`fit_to_points`, or a simpler surface where the points do not refuse it: the noise it leaves is within three standard deviations of a variance
    of what the rounder surface leaves. A plane (an edge rounded by the reconstruction bends a narrow face; the points on it do not bend); for a ball
    a cylinder along one of `square_to`, the normals of planes (of a short hole in a plate little is left between its rounded rims).
    """
    found = fit_to_points(start, points, size_m)
    if start.kind == PLANE:
        return found
    if start.kind == SPHERE and found is not None:
        return _bored(found, points, size_m, square_to)
    normal = start.normals(points)
    mean = normal.mean(0)
    length = float(np.linalg.norm(mean))
    if length < 0.5:
        return found  # turns by more than any plane
    plane = fit_to_points(Surface(kind=PLANE, point=points.mean(0), axis=mean / length), points, size_m)
    holds = plane is not None and len(plane.points) >= 0.9 * (len(points) if found is None else len(found.points))
    if found is None:  # the points bend so little that no radius comes out
        return plane if holds else None
    if plane is not None and holds and plane.sigma_m**2 <= found.sigma_m**2 * (1 + 3 * np.sqrt(2 / len(found.points))):
        return plane
    return _flat_middle(found, points[normal @ mean > MIDDLE * length], len(points), size_m)


def _bored(ball: Fit, points: FloatArray, size_m: float, square_to: Sequence[FloatArray]) -> Fit:
    """The cylinder that leaves least noise in the points of a ball, where that is no more than the ball leaves; else the ball."""
    surface, best = ball.surface, ball
    most = ball.sigma_m**2 * (1 + 3 * np.sqrt(2 / len(ball.points)))
    for axis in square_to:
        start = replace(surface, kind=CYLINDER, axis=axis)
        found = fit_to_points(start, points, size_m)
        if found is not None and len(found.points) >= 0.9 * len(ball.points) and found.sigma_m**2 <= most:
            best, most = found, found.sigma_m**2
    return best


def _flat_middle(found: Fit, middle: FloatArray, n: int, size_m: float) -> Fit:
    """A plane through the middle of a round patch, where the points there refuse the round surface and most lie there: of a narrow face between two
    creases the reconstruction leaves a half-round, whose sides belong to the faces beside it. Else what was found.
    """
    if len(middle) < max(0.5 * n, 2 * FREEDOMS[PLANE] + 1):
        return found
    normal = found.surface.normals(middle).mean(0)
    plane = fit_to_points(Surface(kind=PLANE, point=middle.mean(0), axis=normal / np.linalg.norm(normal)), middle, size_m)
    if plane is None or len(plane.points) < 0.9 * len(middle):
        return found
    left = float(np.mean(found.surface.distance(plane.points) ** 2))
    return plane if plane.sigma_m**2 * (1 + 3 * np.sqrt(2 / len(plane.points))) < left else found


def snapped(fits: Sequence[Fit], *, radii: bool = True) -> tuple[list[Fit], list[Snap]]:
    """The fits with all relations applied that the data do not refuse, and every relation that was tested.

    radii : those between radii, and between centres of balls, too. Without, what touches moves the surfaces yet: nothing is put on an axis that is
        known with its radius only (a quarter of a turn).
    """
    out, snaps = list(fits), []  # type: tuple[list[Fit], list[Snap]]
    groups, known = _directions(out, snaps)
    free = [np.ones(FREEDOMS[f.surface.kind], bool) for f in out]
    for members in groups:
        for k in members:
            _hold(free[k], out[k].surface.kind, "tilt")
            out[k] = _again(out[k], free[k])
    for members, of_axis in zip(groups, known, strict=True):
        _coplanar([k for k in members if out[k].surface.kind == PLANE], out, snaps, of_axis)
        _concentric([k for k in members if out[k].surface.kind != PLANE], out, free, snaps, is_last=radii)
    if radii:
        _one_centre([k for k, f in enumerate(out) if f.surface.kind == SPHERE], out, free, snaps)
        _equal_radii(out, free, snaps)
    return out, snaps


def _one_centre(members: list[int], out: list[Fit], free: list[BoolArray], snaps: list[Snap]) -> None:
    """Spheres about one centre."""
    known: list[int] = []
    for k in sorted(members, key=lambda k: (float(np.trace(out[k].covariance[:3, :3])), k)):
        for first in known:
            off = out[first].surface.point - out[k].surface.point
            gap = float(np.linalg.norm(off))
            if gap > 2 * CLIP * max(out[k].sigma_m, out[first].sigma_m):
                continue
            p = _p_value(float(off @ np.linalg.solve(out[k].covariance[:3, :3] + out[first].covariance[:3, :3], off)), 3)
            snaps.append(Snap(relation="concentric", first=first, second=k, off=gap, p_value=p, applied=p >= ALPHA))
            if p >= ALPHA:
                out[k] = replace(out[k], surface=replace(out[k].surface, point=out[first].surface.point))
                _hold(free[k], SPHERE, "shift")
                out[k] = _again(out[k], free[k])
                break
        else:
            known.append(k)


def _p_value(chi2: float, dof: int) -> float:
    return float(gammaincc(dof / 2, chi2 / 2))


def _hold(free: BoolArray, kind: str, what: str) -> None:
    if what == "tilt" and kind != SPHERE:
        k = _tilt(kind)
        free[k : k + 2] = False
    elif what == "shift":
        free[: 3 if kind == SPHERE else 2] = False
    elif what == "radius":
        free[{CYLINDER: 4, SPHERE: 3}[kind]] = False


def _again(fit: Fit, free: BoolArray) -> Fit:
    """The fit with only its free steps; held ones lose their covariance."""
    if not free.any():
        return replace(fit, covariance=np.zeros_like(fit.covariance))
    surface = fitted(fit.surface, fit.points, free=free) or fit.surface
    full = covariance(surface, fit.points, fit.sigma_m)
    keep = np.ix_(free, free)
    cov = np.zeros_like(full)
    cov[keep] = np.linalg.inv(np.linalg.inv(full)[keep]) if np.linalg.matrix_rank(full) == len(full) else full[keep]
    return replace(fit, surface=surface, covariance=cov)


def _directions(out: list[Fit], snaps: list[Snap]) -> tuple[list[list[int]], FloatArray]:
    """Groups of surfaces with one direction, the best known first, later groups square to earlier ones where the data let them; and the covariance
    of the axis of each, (groups, 3, 3). The axes are those that all members together ask for.
    """
    order = sorted((k for k, f in enumerate(out) if f.surface.kind != SPHERE), key=lambda k: (float(np.trace(out[k].tilt)), k))
    groups: list[list[int]] = []
    axes: list[FloatArray] = []
    square: list[tuple[int, int]] = []
    for k in order:
        home = next((g for g in range(len(groups)) if _is_parallel(out, k, groups[g][0], axes[g], snaps)), None)
        if home is None:
            axis, held = _squared(out, k, groups, axes, snaps)
            square += [(len(groups), g) for g in held]
            axes.append(axis)
            groups.append([k])
        else:
            groups[home].append(k)
    axes, covariances = _together(out, groups, axes, square)
    for axis, members in zip(axes, groups, strict=True):
        for k in members:
            surface = out[k].surface
            out[k] = replace(out[k], surface=replace(surface, axis=axis if surface.axis @ axis > 0 else -axis))
    return groups, covariances


def _together(
    out: Sequence[Fit], groups: Sequence[Sequence[int]], axes: Sequence[FloatArray], square: Sequence[tuple[int, int]]
) -> tuple[list[FloatArray], FloatArray]:
    """The axes of least chi-square of all members with the pairs `square` held at right angles, and the covariance of each: the direction of a long
    plane is told by what lies along it, not by the largest of its pieces (eight of a web 900 mm long: 0.2 mm off at its end, now 0.02).
    """
    axes, n = list(axes), 2 * len(groups)
    covariance = np.zeros((n, n))
    for _ in range(AXES_ROUNDS):
        frames = [Surface(kind=PLANE, point=np.zeros(3), axis=axis).frame() for axis in axes]
        weight, right = np.zeros((n, n)), np.zeros(n)
        for g, members in enumerate(groups):
            own = slice(2 * g, 2 * g + 2)
            for k in members:
                turned = frames[g] @ out[k].surface.frame().T
                information = np.linalg.pinv(turned @ out[k].tilt @ turned.T)
                axis = out[k].surface.axis
                weight[own, own] += information
                right[own] += information @ (frames[g] @ (axis if axis @ axes[g] > 0 else -axis))
        held = np.zeros((len(square), n))
        for row, (g, h) in enumerate(square):
            held[row, 2 * g : 2 * g + 2] = frames[g] @ axes[h]
            held[row, 2 * h : 2 * h + 2] = frames[h] @ axes[g]
        # of steps that keep right angles: the null space, after the step that makes them so
        _, values, turned = np.linalg.svd(held) if len(square) else (None, np.zeros(0), np.eye(n))
        free = turned[(values > SINGULAR).sum() :].T
        first = -np.linalg.pinv(held, rcond=SINGULAR) @ np.array([axes[g] @ axes[h] for g, h in square]) if square else np.zeros(n)
        inner = free.T @ weight @ free
        scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
        covariance = free @ (np.linalg.pinv(inner / np.outer(scale, scale), SINGULAR, hermitian=True) / np.outer(scale, scale)) @ free.T
        step = first + covariance @ (right - weight @ first)
        axes = [axis + step[2 * g : 2 * g + 2] @ frames[g] for g, axis in enumerate(axes)]
        axes = [axis / np.linalg.norm(axis) for axis in axes]
    frame = [Surface(kind=PLANE, point=np.zeros(3), axis=axis).frame() for axis in axes]
    return axes, np.array([e.T @ covariance[2 * g : 2 * g + 2, 2 * g : 2 * g + 2] @ e for g, e in enumerate(frame)]).reshape(-1, 3, 3)


def _candidate(variance: float) -> float:
    """By how much an angle of that variance may be off to be asked: one standard deviation more, and no more than twice, since what is known to no
    better may as well have been drawn askew.
    """
    return CANDIDATE_RAD + min(float(np.sqrt(max(variance, 0.0))), CANDIDATE_RAD)


def _is_parallel(out: list[Fit], k: int, other: int, axis: FloatArray, snaps: list[Snap]) -> bool:
    fit = out[k]
    sign = 1.0 if fit.surface.axis @ axis > 0 else -1.0
    off = fit.surface.frame() @ (sign * axis - fit.surface.axis)
    angle = float(np.linalg.norm(off))
    turned = fit.surface.frame() @ out[other].surface.frame().T
    total = fit.tilt + turned @ out[other].tilt @ turned.T
    if angle > _candidate(float(off @ total @ off) / max(angle**2, 1e-300)):
        return False
    p = _p_value(float(off @ np.linalg.solve(total, off)), 2)
    snaps.append(Snap(relation="parallel", first=other, second=k, off=angle, p_value=p, applied=p >= ALPHA))
    return p >= ALPHA


def _squared(
    out: list[Fit], k: int, groups: list[list[int]], axes: list[FloatArray], snaps: list[Snap],
) -> tuple[FloatArray, list[int]]:  # fmt: skip
    """The axis of a surface of a new direction, made square to the directions before it where the data do not refuse it; and the numbers of these."""
    fit = out[k]
    axis, held = fit.surface.axis, []  # type: tuple[FloatArray, list[int]]
    for g, members in enumerate(groups):
        sine = float(axis @ axes[g])
        across = fit.surface.frame() @ axes[g]
        other = out[members[0]]
        back = other.surface.frame() @ axis
        variance = float(across @ fit.tilt @ across + back @ other.tilt @ back)
        if abs(sine) > np.sin(_candidate(variance)) or len(held) == 2:
            continue
        p = _p_value(sine**2 / max(variance, 1e-300), 1)
        snaps.append(Snap(relation="orthogonal", first=members[0], second=k, off=abs(sine), p_value=p, applied=p >= ALPHA))
        if p >= ALPHA and all(abs(axes[g] @ axes[h]) < 1e-9 for h in held):
            held.append(g)
            for h in held:
                axis = axis - (axis @ axes[h]) * axes[h]
            axis = axis / np.linalg.norm(axis)
    return np.asarray(axis), held


def _coplanar(members: list[int], out: list[Fit], snaps: list[Snap], of_axis: FloatArray) -> None:
    """Planes of one direction and side at one height become one plane, at the weighted mean of their heights.

    of_axis : (3, 3) covariance of their direction: places far apart on one plane differ in height by what that is not known to.
    """
    known: list[list[int]] = []
    for k in sorted(members, key=lambda k: (float(out[k].covariance[0, 0]), k)):
        s = out[k].surface
        for group in known:
            first = out[group[0]].surface
            if s.axis @ first.axis < 0:
                continue
            weight = np.array([1 / max(float(out[j].covariance[0, 0]), 1e-300) for j in group])
            middle = weight @ np.array([out[j].surface.point for j in group]) / weight.sum()
            gap = float((s.point - middle) @ first.axis)
            if abs(gap) > CLIP * max(out[k].sigma_m, out[group[0]].sigma_m):
                continue
            variance = float(out[k].covariance[0, 0] + 1 / weight.sum() + (s.point - middle) @ of_axis @ (s.point - middle))
            p = _p_value(gap**2 / max(variance, 1e-300), 1)
            snaps.append(Snap(relation="coplanar", first=group[0], second=k, off=abs(gap), p_value=p, applied=p >= ALPHA))
            if p >= ALPHA:
                group.append(k)
                break
        else:
            known.append([k])
    for group in known:
        weight = np.array([1 / max(float(out[k].covariance[0, 0]), 1e-300) for k in group])
        middle = weight @ np.array([out[k].surface.point for k in group]) / weight.sum()
        for k in group if len(group) > 1 else []:
            s = out[k].surface
            out[k] = replace(out[k], surface=replace(s, point=s.point + ((middle - s.point) @ s.axis) * s.axis))


def _concentric(members: list[int], out: list[Fit], free: list[BoolArray], snaps: list[Snap], *, is_last: bool) -> None:
    """Round surfaces of one direction on one axis."""
    known: list[int] = []
    for k in sorted(members, key=lambda k: (float(np.trace(out[k].covariance[:2, :2])), k)):
        s = out[k].surface
        for first in known:
            o = out[first].surface
            off = s.frame() @ (o.point - s.point)
            gap = float(np.linalg.norm(off))
            if gap > 0.2 * min(s.radius, o.radius) or gap > 2 * CLIP * max(out[k].sigma_m, out[first].sigma_m):
                continue
            turned = s.frame() @ o.frame().T
            total = out[k].covariance[:2, :2] + turned @ out[first].covariance[:2, :2] @ turned.T
            p = _p_value(float(off @ np.linalg.solve(total, off)), 2)
            snaps.append(Snap(relation="concentric", first=first, second=k, off=gap, p_value=p, applied=p >= ALPHA))
            if p >= ALPHA:
                out[k] = replace(out[k], surface=replace(s, point=s.point + off @ s.frame()))
                _hold(free[k], s.kind, "shift")
                out[k] = _again(out[k], free[k])
                break
        else:
            known += [k] if is_last or not _hangs_on_radius(out[k]) else []


def _hangs_on_radius(fit: Fit) -> bool:
    """Would most of the variance of its radius go if the axis were known? Of three quarters of a turn a quarter would, of one quarter all."""
    if fit.surface.kind != CYLINDER:
        return False
    cov = fit.covariance[np.ix_((0, 1, 4), (0, 1, 4))]
    shared = cov[2, :2] @ np.linalg.pinv(cov[:2, :2]) @ cov[:2, 2]
    return bool(shared > cov[2, 2] / 2)


def _equal_radii(out: list[Fit], free: list[BoolArray], snaps: list[Snap]) -> None:
    """Cylinders of one side, and spheres of one side, with one radius: the weighted mean of those that pass against it."""
    for kind, row in ((CYLINDER, 4), (SPHERE, 3)):
        for sense in (1, -1):
            rest = [k for k, f in enumerate(out) if f.surface.kind == kind and f.surface.sense == sense and f.covariance[row, row] > 0]
            rest.sort(key=lambda k: (float(out[k].covariance[row, row]), k))
            while rest:
                group = [rest.pop(0)]
                for k in list(rest):
                    weight = np.array([1 / out[j].covariance[row, row] for j in group])
                    mean = float(weight @ [out[j].surface.radius for j in group] / weight.sum())
                    off = out[k].surface.radius - mean
                    if abs(off) > 2 * CLIP * out[k].sigma_m or abs(off) > 0.1 * mean:
                        continue
                    p = _p_value(off**2 / float(out[k].covariance[row, row] + 1 / weight.sum()), 1)
                    snaps.append(Snap(relation="equal radius", first=group[0], second=k, off=abs(off), p_value=p, applied=p >= ALPHA))
                    if p >= ALPHA:
                        group.append(k)
                        rest.remove(k)
                weight = np.array([1 / out[j].covariance[row, row] for j in group])
                mean = float(weight @ [out[j].surface.radius for j in group] / weight.sum())
                for k in group if len(group) > 1 else []:
                    out[k] = replace(out[k], surface=replace(out[k].surface, radius=mean))
                    _hold(free[k], kind, "radius")
                    out[k] = _again(out[k], free[k])
