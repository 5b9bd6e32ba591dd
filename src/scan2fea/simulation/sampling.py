"""Points on the surface of solids without a sensor: evenly by area, evenly spaced, or on a regular grid as in the thesis's lab.

Thin walls get the points of both their faces. Every point lies on its triangle to rounding (1e-12 of the coordinates).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.jit import jit
from scan2fea.kernel.measures import area
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.options import option
from scan2fea.simulation.solids import Scene, Solid
from scan2fea.types import FloatArray, IntArray, PointCloud, Scan, TriangleMesh

METHODS = ("uniform", "blue_noise", "grid")
_CANDIDATES = 5  # drawn per point of blue noise that is kept
_MOST_POINTS = 100_000_000
_PHASE = 0.25  # of the pitch: where the grid starts
POISSON_DISC = 0.66  # of the spacing of a hexagonal lattice: gives the density asked for with so many candidates (0.7 at best: Lagae and Dutre 2008)


@dataclass(frozen=True, kw_only=True)
class SamplingOptions:
    """How surfaces are sampled where no sensor is asked for."""

    method: str = option("uniform", "uniform by area; blue_noise: uniform with even gaps; grid: a square grid on each face", choices=METHODS)
    spacing_m: float | None = option(None, "Spacing of the points; auto: that of each object", unit="m", minimum=1e-6)
    noise: str = option("gaussian", "Distribution of the noise, in x, y and z alike", choices=("gaussian", "uniform"))
    noise_m: float = option(0.0, "Standard deviation (gaussian) or half width (uniform) of the noise", unit="m", minimum=0.0)


def sampled(scene: Scene, options: SamplingOptions, seed: int) -> Scan:
    """Points on every solid, in the world, without rays; `cloud.label` is the number of the solid. Raises InputError for more than 1e8 points."""
    parts, labels = [], []
    for number, solid in enumerate(scene.solids):
        points, _ = sampled_solid(solid, options, seed + number)
        parts.append(points)
        labels.append(np.full(len(points), number, np.int64))
    points = np.concatenate(parts)
    if options.noise_m:
        rng = np.random.default_rng([seed, len(points)])
        drawn = rng.uniform(-1, 1, points.shape) if options.noise == "uniform" else rng.standard_normal(points.shape)
        points = points + options.noise_m * drawn
    sd = np.full(len(points), noise_sd(options.noise, options.noise_m))
    return Scan(cloud=PointCloud.of(points, label=np.concatenate(labels), sigma_along_m=sd, sigma_across_m=sd))


def noise_sd(noise: str, noise_m: float) -> float:
    """Standard deviation of a noise whose size is stated as a standard deviation (gaussian) or a half width (uniform)."""
    return noise_m / 3**0.5 if noise == "uniform" else noise_m


def sampled_solid(solid: Solid, options: SamplingOptions, seed: int) -> tuple[FloatArray, IntArray]:
    """(n, 3) points of one solid in the world and the (n,) faces of its mesh they lie on."""
    pitch = options.spacing_m or solid.spacing_m
    n = round(area(solid.mesh) / pitch**2)
    says = f"object {solid.name}: a spacing of {pitch} m makes {n:,} points, at most {_MOST_POINTS:,}: raise it"
    require(n <= _MOST_POINTS, InputError, says)
    if options.method == "uniform":
        return sample_surface(solid.mesh, max(n, 1), seed)
    if options.method == "blue_noise":
        return blue_noise(solid.mesh, pitch, seed)
    own = TriangleMesh(vertices=applied(inverse(solid.T_world_shape), solid.mesh.vertices), faces=solid.mesh.faces)
    points, face = on_grid(own, pitch)
    return applied(solid.T_world_shape, points), face


def blue_noise(mesh: TriangleMesh, spacing_m: float, seed: int) -> tuple[FloatArray, IntArray]:
    """Points of which no two are nearer than 0.66 of the spacing of a hexagonal lattice as dense: uniform candidates, thinned in order.

    Neighbours on the other face of a thin wall count as near only where they are: distances are straight lines, so a wall thinner than the gap
    is sampled sparser on each face; uniform or grid keep both.
    """
    n = max(1, round(_CANDIDATES * area(mesh) / spacing_m**2))
    points, face = sample_surface(mesh, n, seed)
    gap = POISSON_DISC * spacing_m * np.sqrt(2 / np.sqrt(3))
    keep = _thinned(points, gap)
    return points[keep], face[keep]


def _thinned(points: FloatArray, gap: float) -> IntArray:
    """Rows kept when each point is taken unless one taken before lies within the gap; by cells of the gap's size."""
    cell = np.floor((points - points.min(axis=0)) / gap).astype(np.int64)
    size = cell.max(axis=0) + 3
    key = ((cell[:, 0] + 1) * size[1] + cell[:, 1] + 1) * size[2] + cell[:, 2] + 1
    order = np.argsort(key, kind="stable")
    return np.flatnonzero(_taken(points, key, key[order], order, size, gap * gap))


@jit
def _taken(points: FloatArray, key: IntArray, sorted_key: IntArray, order: IntArray, size: IntArray, gap2: float) -> IntArray:
    n = len(points)
    taken = np.zeros(n, np.int64)
    for i in range(n):
        free = True
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                low = key[i] + (dx * size[1] + dy) * size[2] - 1
                at = np.searchsorted(sorted_key, low)
                while free and at < n and sorted_key[at] <= low + 2:
                    j = order[at]
                    if taken[j]:
                        r = 0.0
                        for k in range(3):
                            r += (points[i, k] - points[j, k]) ** 2
                        if r < gap2:
                            free = False
                    at += 1
        if free:
            taken[i] = 1
    return taken


def on_grid(mesh: TriangleMesh, pitch_m: float) -> tuple[FloatArray, IntArray]:
    """The points where the lines x, y = (i + 1/4, j + 1/4) pitch (and y, z; and z, x) pass the faces that face them most.

    On faces square to an axis of the mesh's frame this is a square grid of the pitch that starts a quarter of a pitch from the origin, so that
    the toe of a thin leg gets its row; on others it is that grid seen along the axis they face most. Every face of thin walls has its own points.
    """
    tri = np.ascontiguousarray(mesh.vertices[mesh.faces])
    counts = np.zeros(len(tri), np.int64)
    _grid_points(tri, pitch_m, counts, np.zeros((0, 3)), np.zeros(0, np.int64))
    points, face = np.zeros((int(counts.sum()), 3)), np.zeros(int(counts.sum()), np.int64)
    _grid_points(tri, pitch_m, counts, points, face)
    return points, face


@jit
def _covers(t: FloatArray, u: int, v: int, x: float, y: float, sign: float) -> bool:
    """Is (x, y) inside the triangle seen along an axis? Each edge is computed from its lower end, so that both faces on it agree whose it is."""
    for k in range(3):
        p, q = t[k], t[(k + 1) % 3]
        flip = p[u] > q[u] or (p[u] == q[u] and p[v] > q[v])
        a, b = (q, p) if flip else (p, q)
        turn = (b[u] - a[u]) * (y - a[v]) - (b[v] - a[v]) * (x - a[u])
        side = 1.0 if turn > 0 else -1.0
        if (-side if flip else side) * sign < 0:
            return False
    return True


@jit
def _grid_points(tri: FloatArray, pitch: float, counts: IntArray, points: FloatArray, face: IntArray) -> None:
    """Counts where `points` is empty, else fills."""
    fill = len(points) > 0
    done = 0
    for f in range(len(tri)):
        t = tri[f]
        normal = np.zeros(3)
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            normal[k] = (t[1, a] - t[0, a]) * (t[2, b] - t[0, b]) - (t[1, b] - t[0, b]) * (t[2, a] - t[0, a])
        axis = 0
        for k in range(1, 3):
            if abs(normal[k]) > abs(normal[axis]) * (1 + 1e-9):
                axis = k
        if normal[axis] == 0.0:
            continue
        u, v = (axis + 1) % 3, (axis + 2) % 3
        low_u, high_u = min(t[0, u], t[1, u], t[2, u]), max(t[0, u], t[1, u], t[2, u])
        low_v, high_v = min(t[0, v], t[1, v], t[2, v]), max(t[0, v], t[1, v], t[2, v])
        sign = 1.0 if normal[axis] > 0 else -1.0
        for i in range(int(np.floor(low_u / pitch - _PHASE)), int(np.ceil(high_u / pitch - _PHASE)) + 1):
            x = (i + _PHASE) * pitch
            for j in range(int(np.floor(low_v / pitch - _PHASE)), int(np.ceil(high_v / pitch - _PHASE)) + 1):
                y = (j + _PHASE) * pitch
                if not _covers(t, u, v, x, y, sign):
                    continue
                if fill:
                    points[done, u] = x
                    points[done, v] = y
                    points[done, axis] = t[0, axis] - (normal[u] * (x - t[0, u]) + normal[v] * (y - t[0, v])) / normal[axis]
                    face[done] = f
                else:
                    counts[f] += 1
                done += 1
