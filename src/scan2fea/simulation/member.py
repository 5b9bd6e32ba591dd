"""Points on a prismatic member, for tests and benchmarks that need thousands of small scans: exact surface, chosen faces, noise, clutter.

The section is swept along +z of the member's frame (`kernel.sections`). A point (x, y) of the section at height z lies at
R(twist(z)) (x, y) + bow(z), where bow and twist are Legendre series of 2 z / length - 1 as in `types.Member`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from scan2fea.errors import InputError, require
from scan2fea.kernel.sections import ROUND, section, section_area
from scan2fea.options import option
from scan2fea.types import BoolArray, FloatArray, Section


@dataclass(frozen=True, kw_only=True)
class MemberScanOptions:
    """How the member is sampled."""

    noise_m: float = option(0.0, "Standard deviation of the noise in every coordinate", unit="m", minimum=0.0)
    noise: str = option("gaussian", "Its shape; uniform has half width sqrt(3) noise_m", choices=("gaussian", "uniform", "laplace"))
    faces: tuple[str, ...] = option((), "Faces that are seen; none: all")
    caps: bool = option(False, "Whether the two end faces are sampled too, as densely as the sides")
    clutter: float = option(0.0, "Share of the points that lie anywhere in the box around the member, widened by a quarter", minimum=0.0, maximum=0.9)
    seed: int = option(0, "Seed of everything that is drawn", minimum=0)


def member_points(
    family: str,
    values: Mapping[str, float],
    n: int,
    options: MemberScanOptions = MemberScanOptions(),
    bow: Sequence[Sequence[float]] = ((), ()),
    twist: Sequence[float] = (),
    end_slopes: Sequence[Sequence[float]] = ((0.0, 0.0), (0.0, 0.0)),
) -> FloatArray:
    """(n, 3) points in the member's frame, metres.

    end_slopes : (2, 2), dz/dx and dz/dy of the two end planes through (0, 0, 0) and (0, 0, length); square where zero.
    Raises UsageError for dimensions that make no section, InputError where no face of the given names exists.
    """
    rng = np.random.default_rng(options.seed)
    shape = section(family, values)
    length = values["length"]
    start, edge = _edges(shape, options.faces)
    sides = np.linalg.norm(edge, axis=1)
    cap = section_area(shape) * 2 if options.caps else 0.0
    n_clutter = round(options.clutter * n)
    n_cap = rng.binomial(n - n_clutter, cap / (cap + sides.sum() * length)) if cap > 0 else 0
    n_side = n - n_clutter - n_cap
    pick = rng.choice(len(sides), n_side, p=sides / sides.sum())
    flat = start[pick] + rng.random((n_side, 1)) * edge[pick]
    if family in ROUND:  # from the chord onto the circle
        flat *= (np.linalg.norm(start[pick], axis=1) / np.linalg.norm(flat, axis=1))[:, None]
    slopes = np.asarray(end_slopes, float)
    xy = np.concatenate([flat, _inside(shape, n_cap, rng)])
    low, high = xy @ slopes[0], length + xy @ slopes[1]
    share = np.concatenate([rng.random(n_side), rng.integers(0, 2, n_cap).astype(float)])
    points = swept(np.c_[xy, low + share * (high - low)], length, bow, twist) + _noise((n_side + n_cap, 3), options, rng)
    box_low, box_high = points.min(axis=0), points.max(axis=0)
    widened = 0.125 * (box_high - box_low)
    return np.concatenate([points, rng.uniform(box_low - widened, box_high + widened, (n_clutter, 3))])


def swept(points: FloatArray, length: float, bow: Sequence[Sequence[float]], twist: Sequence[float]) -> FloatArray:
    """(n, 3) points of the straight member moved with its twisted and bowed axis."""
    at = 2 * points[:, 2] / length - 1
    angle = legendre.legval(at, [0.0, *twist])
    cos, sin = np.cos(angle), np.sin(angle)
    x = cos * points[:, 0] - sin * points[:, 1] + legendre.legval(at, [0.0, 0.0, *bow[0]])
    y = sin * points[:, 0] + cos * points[:, 1] + legendre.legval(at, [0.0, 0.0, *bow[1]])
    return np.stack([x, y, points[:, 2]], 1)


def _edges(shape: Section, faces: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    start, edge = [], []
    for loop, names in zip(shape.loops, shape.face_names, strict=True):
        seen = np.array([not faces or name in faces for name in names])
        start.append(loop[seen])
        edge.append((np.roll(loop, -1, axis=0) - loop)[seen])
    require(sum(map(len, start)) > 0, InputError, f"section {shape.family} has none of the faces {', '.join(faces)}")
    return np.concatenate(start), np.concatenate(edge)


def _inside(shape: Section, n: int, rng: np.random.Generator) -> FloatArray:
    """(n, 2) points evenly inside the section, by rejection."""
    corners = np.concatenate(shape.loops)
    low, high = corners.min(axis=0), corners.max(axis=0)
    found: list[FloatArray] = [np.zeros((0, 2))]
    while sum(map(len, found)) < n:
        draw = rng.uniform(low, high, (4 * n + 64, 2))
        found.append(draw[_winding(shape, draw)])
    return np.concatenate(found)[:n]


def _winding(shape: Section, points: FloatArray) -> BoolArray:
    odd = np.zeros(len(points), bool)
    for loop in shape.loops:
        for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            if a[1] != b[1]:
                crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
                odd ^= crosses & (points[:, 0] < a[0] + (points[:, 1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1]))
    return odd


def _noise(shape: tuple[int, int], options: MemberScanOptions, rng: np.random.Generator) -> FloatArray:
    if options.noise == "uniform":
        return options.noise_m * rng.uniform(-(3**0.5), 3**0.5, shape)
    if options.noise == "laplace":
        return rng.laplace(0.0, options.noise_m / 2**0.5, shape)
    return options.noise_m * rng.standard_normal(shape)
