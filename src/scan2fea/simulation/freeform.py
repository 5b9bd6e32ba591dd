"""Smooth bodies around a centre, r = radius(u) for a unit vector u: balls and blobs, as triangles of a divided icosahedron.

`radius` is a polynomial in u, so that volume and inertia have closed forms (closed_forms.star).
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.construction import Polynomial, Star, Stroke, Turned, evaluated, star_points
from scan2fea.simulation.closed_forms import ball, gradient, star
from scan2fea.simulation.solids import Probe, Shape
from scan2fea.types import FloatArray, IntArray, TriangleMesh

_LARGEST_DIVISION = 400  # 3.2 million triangles
_GOLDEN = (1 + 5**0.5) / 2
_CORNERS = np.array(
    [[-1, _GOLDEN, 0], [1, _GOLDEN, 0], [-1, -_GOLDEN, 0], [1, -_GOLDEN, 0], [0, -1, _GOLDEN], [0, 1, _GOLDEN],
     [0, -1, -_GOLDEN], [0, 1, -_GOLDEN], [_GOLDEN, 0, -1], [_GOLDEN, 0, 1], [-_GOLDEN, 0, -1], [-_GOLDEN, 0, 1]]
)  # fmt: skip
_FACES = np.array(
    [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8],
     [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]]
)  # fmt: skip


def sphere(radius: float, chord_m: float) -> Shape:
    """A ball about the origin."""
    require(math.isfinite(radius) and radius > 0, InputError, f"sphere: radius is {radius} m; it must be positive")
    probes = tuple(Probe(name="d", middle=np.zeros(3), direction=axis, size_m=2 * radius) for axis in np.eye(3))
    mesh = _meshed({(0, 0, 0): radius}, chord_m)
    return Shape(
        kind="sphere", family="free", parameters={"radius": radius, "d": 2 * radius}, mesh=mesh, exact=ball(radius), chord_m=chord_m, section=(),
        n_cad_faces=1, probes=probes, base=_ball(radius),
    )  # fmt: skip


def _ball(radius: float) -> Turned:
    half = Stroke(start=np.array([0.0, -radius]), end=np.array([0.0, radius]), centre=np.zeros(2), semi_axes=np.full(2, radius))
    return Turned(profile=(half,), names=("BALL",))


def blob(radius: float, wave: float, seed: int, chord_m: float) -> Shape:
    """A smooth body without symmetry: radius (1 + wave p(u)), p a polynomial of degree 3 drawn from `seed` whose largest magnitude is 1.

    wave : 0 up to, not including, 1.
    """
    require(math.isfinite(radius) and radius > 0, InputError, f"blob: radius is {radius} m; it must be positive")
    require(0 <= wave <= 0.5, InputError, f"blob: wave is {wave}; it must lie between 0 and 0.5")
    rng = np.random.default_rng(seed)
    exponents = [(a, b, c) for a in range(4) for b in range(4) for c in range(4) if 1 <= a + b + c <= 3]
    shape: Polynomial = {e: float(f) for e, f in zip(exponents, rng.standard_normal(len(exponents)), strict=True)}
    largest = float(np.abs(evaluated(shape, _directions(24)[0])).max())
    radial: dict[tuple[int, int, int], float] = {e: radius * wave * f / largest for e, f in shape.items()}
    radial[0, 0, 0] = radius
    exact = star(radial)
    mesh = _meshed(radial, chord_m)
    return Shape(
        kind="blob", family="free", parameters={"radius": radius}, mesh=mesh, exact=exact.with_area(star_area(radial)), chord_m=chord_m, section=(),
        n_cad_faces=6, probes=(), base=Star(radius=radial),
    )  # fmt: skip


def star_area(radius: Polynomial, n: int = 96) -> float:
    """Area of r = radius(u): the integral of r sqrt(r^2 + |tangential gradient|^2) over the sphere, by Gauss-Legendre in z and the trapezoid rule
    in the azimuth; both converge faster than any power for a smooth body, so n = 96 leaves rounding only.
    """
    z, weight = np.polynomial.legendre.leggauss(n)
    angle = 2 * np.pi * np.arange(2 * n) / (2 * n)
    zz, aa = (g.ravel() for g in np.meshgrid(z, angle, indexing="ij"))
    s = np.sqrt(1 - zz**2)
    u = np.stack([s * np.cos(aa), s * np.sin(aa), zz], axis=1)
    r, slope = evaluated(radius, u), gradient(radius, u)
    tangential = slope - np.einsum("ij,ij->i", slope, u)[:, None] * u
    density = r * np.sqrt(r**2 + (tangential**2).sum(axis=1))
    return float((np.repeat(weight, 2 * n) * density).sum() * 2 * np.pi / (2 * n))


def _meshed(radius: Polynomial, chord_m: float) -> TriangleMesh:
    """As fine as needed: the division is doubled until the middles of edges and faces lie within the chord tolerance of the surface."""
    require(math.isfinite(chord_m) and chord_m > 0, InputError, f"the chord tolerance is {chord_m} m; it must be positive")
    division = 4
    while True:
        u, faces = _directions(division)
        vertices = star_points(radius, u)
        off = _largest_gap(radius, vertices, faces)
        if off <= chord_m:
            return TriangleMesh(vertices=vertices, faces=faces)
        finer = max(division + 1, math.ceil(division * math.sqrt(off / chord_m)))
        says = f"a chord tolerance of {chord_m} m needs more than {20 * _LARGEST_DIVISION**2} triangles: state a larger one"
        require(finer <= _LARGEST_DIVISION, InputError, says)
        division = finer


def _largest_gap(radius: Polynomial, vertices: FloatArray, faces: IntArray) -> float:
    """How far the middles of faces and edges lie from the surface along their own direction: not less than the distance itself."""
    tri = vertices[faces]
    middles = np.concatenate([tri.mean(axis=1), *((tri[:, k] + tri[:, k - 1]) / 2 for k in range(3))])
    r = np.linalg.norm(middles, axis=1)
    return float(np.abs(evaluated(radius, middles / r[:, None]) - r).max())


def _directions(division: int) -> tuple[FloatArray, IntArray]:
    """Unit vectors (10 n^2 + 2, 3) and triangles (20 n^2, 3) of an icosahedron whose edges are cut in n."""
    corner = _CORNERS / np.linalg.norm(_CORNERS[0])
    n = division
    rows = [(i, j) for i in range(n + 1) for j in range(n + 1 - i)]
    number = {ij: k for k, ij in enumerate(rows)}
    weights = np.array([[n - i - j, i, j] for i, j in rows]) / n
    up = [[number[i, j], number[i + 1, j], number[i, j + 1]] for i in range(n) for j in range(n - i)]
    down = [[number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]] for i in range(n - 1) for j in range(n - 1 - i)]
    local = np.array(up + down)
    points = np.einsum("kw,fwc->fkc", weights, corner[_FACES]).reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    key = np.round(points * 2**30).astype(np.int64)  # equal corners of neighbouring faces differ by rounding only
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    faces = (local[None] + len(rows) * np.arange(len(_FACES))[:, None, None]).reshape(-1, 3)
    return points[first], inverse.reshape(-1)[faces].astype(np.int64)
