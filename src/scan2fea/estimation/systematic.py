"""What more points do not cure: edges of regular clouds, and faces that lie off as a whole.

Clouds that were thinned, or sampled on a grid: their edges are known to a part of their spacing, however many points there are.

The likelihood takes points for drawn at random. Then the edge of a face that was sampled with rho points per metre is known to 1 / rho at worst.
Points that keep a distance from each other (thinned by a voxel grid or a least distance, a regular raster) do not come closer to an edge with their
number: their last row lies somewhere within a spacing of it, and where exactly, the same cause may have decided for the whole edge.

Real scans do not agree to their noise: stations, incidence and paint move whole patches of a face. The cells of `explain.py` show by how much the
surface as scanned departs from the member beyond noise; each face may be off by as much, and with it what is measured between two faces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.noise import sampled_rows
from scan2fea.types import FloatArray, Member

_POINTS = 5_000
_REGULAR = 0.6  # 5 % quantile of the distance to the nearest neighbour over its median: 0.27 for points at random on a surface
_EDGE = 0.25  # of the spacing: standard deviation of an edge; uniform over a spacing would be 0.29
_SEEN = 0.5  # of the length of a face that ends a dimension: from there on points on it measure it, not the edge beside it
_CAP_POINTS = 20
_CHANCE, _PATTERN = 1e-3, 0.15  # p-value and share of the noise; simulated members without such errors show up to 0.07 (4,000 to 40,000 points)

# Per dimension and side: the faces of which one measures that side.
_SIDES: Mapping[str, Mapping[str, tuple[tuple[str, ...], ...]]] = {
    "L": {"a": (("A_TOE",), ("B_OUTER", "B_INNER")), "b": (("B_TOE",), ("A_OUTER", "A_INNER"))},
    "I": {
        "b": (("BOTTOM_TOE_RIGHT", "TOP_TOE_RIGHT"), ("BOTTOM_TOE_LEFT", "TOP_TOE_LEFT")),
        "h": (("BOTTOM_OUTER", "BOTTOM_INNER_LEFT", "BOTTOM_INNER_RIGHT"), ("TOP_OUTER", "TOP_INNER_LEFT", "TOP_INNER_RIGHT")),
    },
    "C": {"b": (("BOTTOM_TOE", "TOP_TOE"), ("WEB_OUTER", "WEB_INNER")), "h": (("BOTTOM_OUTER", "BOTTOM_INNER"), ("TOP_OUTER", "TOP_INNER"))},
    "T": {"b": (("FLANGE_TOE_RIGHT",), ("FLANGE_TOE_LEFT",)), "h": (("WEB_TOE",), ("FLANGE_OUTER", "FLANGE_INNER_LEFT", "FLANGE_INNER_RIGHT"))},
    "RHS": {"b": (("RIGHT_OUTER",), ("LEFT_OUTER",)), "h": (("BOTTOM_OUTER",), ("TOP_OUTER",))},
    "rect": {"b": (("RIGHT",), ("LEFT",)), "t": (("BOTTOM",), ("TOP",))},
}


def thinned_spacing(points: FloatArray, seed: int = 0) -> float:
    """Median distance (m) to the nearest neighbour of points (n, 3) that keep a distance from each other; 0 of points at random."""
    some = points[sampled_rows(len(points), _POINTS, seed)]
    distance = np.asarray(cKDTree(points).query(some, k=2)[0])[:, 1]
    least, median = (float(x) for x in np.quantile(distance, (0.05, 0.5)))
    return median if least > _REGULAR * median else 0.0


def face_error(pattern_m: float, p_value: float, sigma_m: float) -> float:
    """By how much a face may be off as a whole (m): the pattern of the cells, where it is neither chance nor what dense clouds always show."""
    return pattern_m if p_value < _CHANCE and pattern_m > _PATTERN * sigma_m else 0.0


def widened(member: Member, spacing_m: float, cap_points: tuple[float, float], face_m: float = 0.0) -> Member:
    """The member with the standard deviations of dimensions widened by what the spacing leaves open at edges and by what faces may be off.

    spacing_m : of `thinned_spacing`.   cap_points : expected on the two end faces.   face_m : of `face_error`.
    """
    if not spacing_m > 0 and not face_m > 0:
        return member
    covariance, parameters = np.array(member.covariance, float), []
    for k, p in enumerate(member.parameters):
        sides = _SIDES.get(member.family, {}).get(p.name, ())
        n_edges = sum(max(member.seen.get(face, 0.0) for face in side) < _SEEN for side in sides)
        if p.name == "length":
            n_edges = sum(n < _CAP_POINTS for n in cap_points)
        n_faces = 0 if p.name == "length" else 2
        if p.std_m is None or not (n_edges * spacing_m or n_faces * face_m):
            parameters.append(p)
            continue
        covariance[k, k] += n_edges * (_EDGE * spacing_m) ** 2 + n_faces * face_m**2
        parameters.append(replace(p, std_m=float(np.sqrt(covariance[k, k]))))
    return replace(member, covariance=covariance, parameters=tuple(parameters))
