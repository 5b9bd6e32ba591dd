"""What a scan can tell of a member at best: the Cramer-Rao bound of each dimension, before any scan is made.

The section's dimensions from the information of one point around the section (kernel.section_likelihood; shape-estimation.md, "Limit"), the length
from the density along the axis: two edges blurred by the noise, and the points on the two end faces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import ndtr

from scan2fea.kernel.section_likelihood import face_lengths, faces, information
from scan2fea.kernel.sections import PARAMETERS, section, section_area
from scan2fea.simulation.section_faces import Located, located
from scan2fea.types import FloatArray

LEAST_NOISE_M = 1e-6  # of a sensor that states none: no instrument is better, and the bounds need a number
LEAST_POINTS = 20  # of a member, below which no bound is worth its name
_INV_SQRT_2PI = 1 / math.sqrt(2 * math.pi)


def member_bounds(
    family: str,
    parameters: Mapping[str, float],
    sigma_m: float,
    n_points: float,
    seen: Mapping[str, float] | None = None,
    cap_points: float | None = None,
    noise: str = "gaussian",
) -> dict[str, float]:
    """Smallest standard deviation of each dimension (metres) that any unbiased estimate can have; inf where the data do not tell.

    n_points : on the member's sides.   seen : points per metre of each face of the section, relative (None: all alike); their ratios are then
    unknown to the estimate, as in a real scan.   cap_points : on each end face (None: as densely as the sides).   noise : of kernel.noise_kernels.
    Raises UsageError for dimensions that make no section, or a sigma that is not positive.
    """
    values = np.array([parameters[name] for name in PARAMETERS[family]])
    weight = None if seen is None else np.array([seen.get(name, 0.0) for name in faces(family)])
    told = information(family, values, sigma_m, noise, weight, free_weights=weight is not None).sd(1)
    out = {name: told[name] / math.sqrt(n_points) for name in PARAMETERS[family]}
    if "length" in parameters:
        perimeter = float((face_lengths(family, values) * (1.0 if weight is None else weight > 0)).sum())
        caps = cap_points
        if caps is None:
            caps = n_points * section_area(section(family, parameters)) / (perimeter * parameters["length"])
        out["length"] = length_bound(parameters["length"], sigma_m, n_points, caps)
    return out


def length_bound(length: float, sigma_m: float, n_side: float, n_cap: float) -> float:
    """Of the distance between the ends of n_side points spread evenly along it and n_cap points on each of the two end faces.

    Both ends are unknown and, being far apart, independent. Near one end the points are a Poisson process of rate
    g(z) = n_side / length Phi(z / sigma) + n_cap phi(z / sigma) / sigma, whose information about the end is the integral of g'^2 / g.
    Without caps that is 0.903 rho / sigma (shape-estimation.md).
    """
    z = np.linspace(-8.0, 12.0, 4001)
    rho = n_side / length
    bell = _INV_SQRT_2PI * np.exp(-(z**2) / 2)
    rate = rho * ndtr(z) + n_cap / sigma_m * bell
    slope = (rho * bell - n_cap / sigma_m * z * bell) / sigma_m
    information_of_end = float(np.trapezoid(np.divide(slope**2, rate, out=np.zeros_like(rate), where=rate > 0), z * sigma_m))
    return math.sqrt(2 / information_of_end) if information_of_end > 0 else math.inf


def edge_information() -> float:
    """The constant of a density edge: integral of phi^2 / Phi."""
    return 2.0 / length_bound(1.0, 1e-3, 1e6, 0.0) ** 2 * 1e-3 / 1e6


WALLS = ("t", "tw", "tf")


def observable(bounds: Mapping[str, float], parameters: Mapping[str, float], sigma_m: float = 0.0) -> dict[str, bool]:
    """Which dimensions the data tell: the bound is below a quarter of the dimension, and a wall is thicker than two standard deviations of the noise.

    A thinner wall and the noise blur into one: without knowing the noise better than any instrument states it, the bound is not reached
    (shape-estimation.md, "Thickness gate").
    """
    return {name: bool(bound < parameters[name] / 4 and (name not in WALLS or parameters[name] > 2 * sigma_m)) for name, bound in bounds.items()}


def bounds_from_points(
    family: str,
    parameters: Mapping[str, float],
    points: FloatArray,
    sigma_m: float,
    n_points: float | None = None,
    along: FloatArray | None = None,
) -> dict[str, float]:
    """The bound of each dimension from exact points on the member, in its own frame, by the faces of the section and the ends they lie on.

    How densely each face was hit counts as unknown to the estimate, as in a real scan. Of two ends with different counts the smaller one is taken.
    n_points : the points stand for so many (None: for themselves).   along : (n, 3) unit rays in the member's frame if the noise is along them, None
    where it is the same in all directions. The density knows one sigma: each dimension then has its own, the root mean square of what it feels of the
    noise; a wall the part along the normals of the faces, a width, a diameter and the length the part along itself.
    """
    where = located(family, parameters, points)
    counts = where.counts(len(faces(family)))
    scale = 1.0 if n_points is None else n_points / max(len(points), 1)
    side = float(counts.sum()) * scale
    names = [name for name in (*PARAMETERS[family], "length") if name in parameters]
    if side < LEAST_POINTS:
        return dict.fromkeys(names, math.inf)
    values = np.array([parameters[name] for name in PARAMETERS[family]])
    seen = dict(zip(faces(family), (counts / face_lengths(family, values)).tolist(), strict=True))
    felt = dict.fromkeys(names, 1.0) if along is None else _felt(family, names, where, along)
    bounds: dict[float, dict[str, float]] = {}
    for share in set(felt.values()):
        bounds[share] = member_bounds(family, parameters, max(share * sigma_m, LEAST_NOISE_M), side, seen=seen, cap_points=min(where.n_ends) * scale)
    return {name: bounds[felt[name]][name] for name in names}


def _felt(family: str, names: Sequence[str], where: Located, along: FloatArray) -> dict[str, float]:
    """Root mean square of the part of a unit noise along the rays that each dimension feels: what goes through the faces that tell it.

    A face is mostly seen by rays that run into it, so that the mean over all faces would be too small for each. A dimension along x or y is told by
    the faces across it, the thickness of an angle or a tube by all. Where none of those faces is seen, by the ends of the others: the part along it.
    """
    side = where.face >= 0
    ray, normal = along[side], where.normal[side]
    through = (ray[:, :2] * normal).sum(axis=1) ** 2
    across = np.mean(ray**2, axis=0)
    felt = {"length": math.sqrt(across[2])}
    for name in PARAMETERS[family]:
        axis = _AXIS.get(family, {}).get(name)
        if axis is None:
            felt[name] = math.sqrt(np.mean(through))
        else:
            weight = normal[:, axis] ** 2
            felt[name] = math.sqrt(weight @ through / weight.sum() if weight.sum() >= LEAST_POINTS else across[axis])
    return {name: max(felt[name], _LEAST_FELT) for name in names}


_LEAST_FELT = 0.1  # of the noise: no scan is so square to everything
_AXIS: Mapping[str, Mapping[str, int]] = {  # of each width and wall: 0 along x, 1 along y (frame of kernel.sections)
    "L": {"a": 0, "b": 1},
    **{family: {"h": 1, "b": 0, "tw": 0, "tf": 1} for family in ("I", "C", "T")},
    "RHS": {"h": 1, "b": 0},
    "rect": {"b": 0, "t": 1},
}
