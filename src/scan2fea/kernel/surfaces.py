"""Planes, cylinders, cones, spheres and tori through noisy points: distances, their slopes, first guesses from normals, least squares fits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scan2fea.kernel import surface_fit
from scan2fea.kernel.surface_fit import descend, frame
from scan2fea.types import BoolArray, FloatArray, Value

PLANE, CYLINDER, CONE, SPHERE, TORUS = "plane", "cylinder", "cone", "sphere", "torus"
SIZES = {PLANE: 0, CYLINDER: 1, CONE: 2, SPHERE: 1, TORUS: 2}  # dimensions of each kind
FREEDOMS = {PLANE: 3, CYLINDER: 5, CONE: 6, SPHERE: 4, TORUS: 7}
_CODES = {
    PLANE: surface_fit.PLANE, CYLINDER: surface_fit.CYLINDER, CONE: surface_fit.CONE, SPHERE: surface_fit.SPHERE, TORUS: surface_fit.TORUS,
}  # fmt: skip
ROUNDS = 30
SMALL = 1e-12


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface(Value):
    """One surface of a solid.

    point : (3,) on the plane, on the axis, or the centre.   axis : (3,) unit; of a plane its outward normal; of a sphere without meaning.
    radius : of a cylinder or sphere; of a cone at `point`; of a torus the one from its axis to the middle of its tube.
    second : of a cone the half angle, radians, positive where it opens along the axis; of a torus the radius of the tube.
    sense : +1 where the solid lies on the side of the axis (a shaft), -1 where it lies beyond (a hole).   rms_m : of what it was fitted to.
    """

    kind: str
    point: FloatArray
    axis: FloatArray
    radius: float = 0.0
    second: float = 0.0
    sense: int = 1
    rms_m: float = 0.0

    def distance(self, points: FloatArray) -> FloatArray:
        """(n,) signed distance of (n, 3) points, positive outside of the solid."""
        return np.asarray(self.sense * _distance(self, points))

    def normals(self, points: FloatArray) -> FloatArray:
        """(n, 3) outward unit normals at the foot of each point."""
        if self.kind == PLANE:
            return np.broadcast_to(self.axis, points.shape).copy()
        q = points - self.point
        if self.kind == SPHERE:
            return np.asarray(self.sense * q / np.maximum(np.linalg.norm(q, axis=1), SMALL)[:, None])
        h, rho, out = _cylindric(self, points)
        if self.kind == CYLINDER:
            return np.asarray(self.sense * out)
        if self.kind == CONE:
            return np.asarray(self.sense * (np.cos(self.second) * out - np.sin(self.second) * self.axis))
        across = (rho - self.radius)[:, None] * out + h[:, None] * self.axis
        return np.asarray(self.sense * across / np.maximum(np.linalg.norm(across, axis=1), SMALL)[:, None])

    def projected(self, points: FloatArray) -> FloatArray:
        """(n, 3) the foot of each point."""
        return np.asarray(points - self.distance(points)[:, None] * self.normals(points))

    def packed(self) -> tuple[int, FloatArray]:
        """(code of the kind, (8,) point, axis, radius, second) for the kernels of `surface_fit`."""
        return _CODES[self.kind], np.array([*self.point, *self.axis, self.radius, self.second], float)

    def frame(self) -> FloatArray:
        """(2, 3) unit vectors across the axis; with it they are right-handed."""
        return frame(np.array(self.axis, float))


def _cylindric(surface: Surface, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(height along the axis, distance from it, unit vector away from it)."""
    q = points - surface.point
    h = q @ surface.axis
    across = q - h[:, None] * surface.axis
    rho = np.linalg.norm(across, axis=1)
    return h, rho, across / np.maximum(rho, SMALL)[:, None]


def _distance(surface: Surface, points: FloatArray) -> FloatArray:
    """Positive away from the axis or the centre; of a plane along its normal."""
    if surface.kind == PLANE:
        return np.asarray((points - surface.point) @ surface.axis)
    if surface.kind == SPHERE:
        return np.asarray(np.linalg.norm(points - surface.point, axis=1) - surface.radius)
    h, rho, _ = _cylindric(surface, points)
    if surface.kind == CYLINDER:
        return np.asarray(rho - surface.radius)
    if surface.kind == CONE:
        return np.asarray((rho - surface.radius) * np.cos(surface.second) - h * np.sin(surface.second))
    return np.asarray(np.hypot(rho - surface.radius, h) - surface.second)


def slopes(surface: Surface, points: FloatArray) -> FloatArray:
    """(n, freedoms) derivatives of the distance away from the axis, in the order of `moved`."""
    e = surface.frame()
    if surface.kind == PLANE:
        return np.column_stack([-np.ones(len(points)), (points - surface.point) @ e.T])
    q = points - surface.point
    if surface.kind == SPHERE:
        return np.column_stack([-q / np.maximum(np.linalg.norm(q, axis=1), SMALL)[:, None], -np.ones(len(points))])
    h, rho, out = _cylindric(surface, points)
    shift, tilt, lift = -out @ e.T, -h[:, None] * (out @ e.T), q @ e.T
    if surface.kind == CYLINDER:
        return np.column_stack([shift, tilt, -np.ones(len(points))])
    if surface.kind == CONE:
        c, s = np.cos(surface.second), np.sin(surface.second)
        return np.column_stack([c * shift, c * tilt - s * lift, np.full(len(points), -c), -s * (rho - surface.radius) - c * h])
    size = np.maximum(np.hypot(rho - surface.radius, h), SMALL)
    a, b = (rho - surface.radius) / size, h / size
    return np.column_stack([a[:, None] * shift, -b, a[:, None] * tilt + b[:, None] * lift, -a, -np.ones(len(points))])


def moved(surface: Surface, step: FloatArray) -> Surface:
    """The surface after a step.

    Plane (offset, tilt, tilt); cylinder (shift, shift, tilt, tilt, radius); cone also its angle; sphere (centre, radius);
    torus (shift, shift, along, tilt, tilt, radius, tube).
    """
    e = surface.frame()
    if surface.kind == PLANE:
        # the distance along a tilted normal grows by tilt . (p - point): the normal itself turns that way
        return replace(surface, point=surface.point + step[0] * surface.axis, axis=_unit(surface.axis + step[1:3] @ e))
    if surface.kind == SPHERE:
        return replace(surface, point=surface.point + step[:3], radius=surface.radius + step[3])
    point, rest = surface.point + step[:2] @ e, step[2:]
    if surface.kind == TORUS:
        point, rest = point + step[2] * surface.axis, step[3:]
    turned = replace(surface, point=point, axis=_unit(surface.axis + rest[:2] @ e), radius=surface.radius + float(rest[2]))
    return turned if surface.kind == CYLINDER else replace(turned, second=surface.second + float(rest[3]))


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))


def fitted(start: Surface, points: FloatArray, weights: FloatArray | None = None, free: BoolArray | None = None) -> Surface | None:
    """Least squares by damped Gauss-Newton steps from `start`; None where it does not settle or a dimension becomes absurd.

    weights : (n,) of the squares.   free : (freedoms,) bool of what may change; all without it.
    """
    w = np.ones(len(points)) if weights is None else weights
    may = np.ones(FREEDOMS[start.kind], bool) if free is None else free
    size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    code, first = replace(start, point=_near(start, points)).packed()
    x = np.array(points, float, order="C")  # kernels are compiled once, for arrays that may be written to
    found, cost = descend(code, first, x, np.array(w, float), np.array(may), size, ROUNDS)
    here = replace(start, point=found[:3], axis=found[3:6], radius=float(found[6]), second=float(found[7]))
    if not _is_sane(here, size):
        return None
    return replace(here, rms_m=float(np.sqrt(cost / max(w.sum(), 1e-300))))


def _near(surface: Surface, points: FloatArray) -> FloatArray:
    """The reference point moved along the axis (in the plane) to the middle of the points: tilt and shift are then hardly coupled."""
    middle = points.mean(0)
    if surface.kind == PLANE:
        return np.asarray(middle - ((middle - surface.point) @ surface.axis) * surface.axis)
    if surface.kind == CYLINDER:
        return np.asarray(surface.point + ((middle - surface.point) @ surface.axis) * surface.axis)
    return surface.point


def _is_sane(surface: Surface, size: float) -> bool:
    if surface.kind == PLANE:
        return True
    if not 0 < surface.radius < 50 * size:
        return False
    if surface.kind == CONE:
        return bool(abs(surface.second) < np.radians(85))
    return surface.kind != TORUS or 0 < surface.second < 50 * size


def covariance(surface: Surface, points: FloatArray, sigma_m: float) -> FloatArray:
    """(freedoms, freedoms) of `moved`'s steps for independent noise of `sigma_m`."""
    J = slopes(surface, points)
    A = J.T @ J
    scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
    return np.asarray(sigma_m**2 * np.linalg.pinv(A / np.outer(scale, scale), rcond=1e-12) / np.outer(scale, scale))


def first_plane(points: FloatArray, normals: FloatArray) -> Surface:
    """Through the mean of the points, square to the mean of their normals."""
    return Surface(kind=PLANE, point=points.mean(0), axis=_unit(normals.sum(0)))


def first_cylinder(points: FloatArray, normals: FloatArray) -> Surface | None:
    """The axis is the direction that the normals have least of; centre and radius from p - r n = c, a linear problem."""
    axis = np.linalg.eigh(normals.T @ normals)[1][:, 0]
    return about_axis(points, normals, axis)


def about_axis(points: FloatArray, normals: FloatArray, axis: FloatArray) -> Surface | None:
    blank = Surface(kind=CYLINDER, point=points.mean(0), axis=axis)
    e = blank.frame()
    p, n = (points - blank.point) @ e.T, normals @ e.T
    n = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), SMALL)
    found = _centre(p, n)
    if found is None:
        return None
    centre, radius = found
    return replace(blank, point=blank.point + centre @ e, radius=abs(radius), sense=1 if radius > 0 else -1)


def _centre(points: FloatArray, normals: FloatArray) -> tuple[FloatArray, float] | None:
    """Least squares of p = c + r n in any dimension."""
    p, n = points - points.mean(0), normals - normals.mean(0)
    spread = float((n * n).sum())
    if spread < 1e-9 * len(points):
        return None
    radius = float((p * n).sum()) / spread
    return points.mean(0) - radius * normals.mean(0), radius


def first_sphere(points: FloatArray, normals: FloatArray) -> Surface | None:
    """From p - r n = c."""
    found = _centre(points, normals)
    if found is None:
        return None
    return Surface(kind=SPHERE, point=found[0], axis=np.array([0.0, 0.0, 1.0]), radius=abs(found[1]), sense=1 if found[1] > 0 else -1)


def first_cone(points: FloatArray, normals: FloatArray) -> Surface | None:
    """All tangent planes pass through the apex: p . n = apex . n; the normals keep one angle with the axis."""
    centred = normals - normals.mean(0)
    axis = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    origin = points.mean(0)
    A, b = normals, ((points - origin) * normals).sum(1)
    apex, _, rank, values = np.linalg.lstsq(A, b, rcond=1e-6)
    if rank < 3 or values[-1] < 1e-4 * values[0]:
        return None
    apex = apex + origin
    if (origin - apex) @ axis < 0:
        axis = -axis
    h = (points - apex) @ axis
    if not (h > 0).mean() > 0.98:
        return None
    rho = np.linalg.norm(points - apex - h[:, None] * axis, axis=1)
    angle = float(np.arctan2(np.median(rho), np.median(h)))
    foot = apex + ((origin - apex) @ axis) * axis
    out = (points - apex) - h[:, None] * axis
    return Surface(
        kind=CONE, point=foot, axis=axis, radius=float(np.tan(angle) * ((origin - apex) @ axis)), second=angle,
        sense=1 if float((out * normals).sum()) > 0 else -1,
    )  # fmt: skip


FIRST = {PLANE: first_plane, CYLINDER: first_cylinder, CONE: first_cone, SPHERE: first_sphere}


def fit_surface(kind: str, points: FloatArray, normals: FloatArray, weights: FloatArray | None = None) -> Surface | None:
    """The surface of that kind through the points; normals (n, 3) outward. None where there is none."""
    start = FIRST[kind](points, normals)
    if start is None or not _is_sane(start, float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0):
        return None
    return fitted(start, points, weights)
