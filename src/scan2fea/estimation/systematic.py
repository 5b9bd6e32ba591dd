"""What more points do not cure: edges of regular clouds, and faces that lie off as a whole.

Clouds that were thinned, or sampled on a grid: their edges are known to a part of their spacing, however many points there are.

The likelihood takes points for drawn at random. Then the edge of a face that was sampled with rho points per metre is known to 1 / rho at worst.
Points that keep a distance from each other (thinned by a voxel grid or a least distance, a regular raster) do not come closer to an edge with their
number: their last row lies somewhere within a spacing of it, and where exactly, the same cause may have decided for the whole edge. Noise wider than
half a spacing hides the rows from the nearest neighbour, not from the sums: counts along the member still scatter less than those of points at
random.

Real scans do not agree to their noise: stations, incidence and paint move whole patches of a face. The cells of `explain.py` show by how much the
surface as scanned departs from the member beyond noise; each face may be off by as much, and with it what is measured between two faces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import gammainc

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.section_likelihood import face_lengths, faces
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.types import FloatArray, Member

_POINTS = 5_000
_REGULAR = 0.6  # 5 % quantile of the distance to the nearest neighbour over its median: 0.27 for points at random on a surface
_EDGE = 0.25  # of the spacing: standard deviation of an edge; uniform over a spacing would be 0.29
_LAST_ROW = 3**-0.5  # of the spacing: root mean square of what the last row is short of the end, were it anything up to a spacing
_ROWS = 0.25  # noise over spacing below which the last row itself is the end that is found
_FEW_ROWS = 3.0  # spacings: a face so short holds one row too many or too few
_EVEN_CHANCE = 1e-4
_BINS, _MOST, _LEAST = 4096, 30, 4  # waves along the member; the shortest is ten widths of the noise
_INNER = 0.9  # of the member's length, in which waves are counted
_SEEN = 0.5  # of the length of a face that ends a dimension: from there on points on it measure it, not the edge beside it
_CAP_POINTS = 20
# p-value (what is missed leaves an interval too narrow, what is taken in error a hardly wider one); share of the noise: simulated members without
# such errors show up to 0.07 (4,000 to 40,000 points)
_CHANCE, _PATTERN = 0.05, 0.15

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
    distance = k_nearest(points, 2, some)[0][:, 1]
    least, median = (float(x) for x in np.quantile(distance, (0.05, 0.5)))
    return median if least > _REGULAR * median else 0.0


def even_spacing(z: FloatArray, span: tuple[float, float], sigma_m: float, area_m2: float) -> float:
    """Spacing (m) of points at heights z (n,) that are spread more evenly along the member than at random; 0 where they are not.

    span : of the member.   area_m2 : of the faces they lie on.

    Of points at random every wave along the member has the power 1, of an even raster whose
    points were moved by sigma each (2 pi sigma / wavelength)^2 at most: the sum over the longest waves is that of Gamma, or far below.
    """
    margin = 0.5 * (1 - _INNER) * (span[1] - span[0])
    inner = z[(z > span[0] + margin) & (z < span[1] - margin)]
    length = span[1] - span[0] - 2 * margin
    n_waves = int(min(_MOST, length / (10 * sigma_m) if sigma_m > 0 else _MOST, len(inner) // 50))
    if n_waves < _LEAST or not area_m2 > 0:
        return 0.0
    counts = np.histogram(inner, _BINS, (span[0] + margin, span[1] - margin))[0]
    power = np.abs(np.fft.rfft(counts)[1 : n_waves + 1]) ** 2 / len(inner)
    return float(np.sqrt(area_m2 / len(z))) if gammainc(n_waves, float(power.sum())) < _EVEN_CHANCE else 0.0


def face_error(pattern_m: float, p_value: float, sigma_m: float) -> float:
    """By how much a face may be off as a whole (m): the pattern of the cells, where it is neither chance nor what dense clouds always show."""
    return pattern_m if p_value < _CHANCE and pattern_m > _PATTERN * sigma_m else 0.0


def widened(member: Member, spacing_m: float, cap_points: tuple[float, float], face_m: float = 0.0) -> Member:
    """The member with the standard deviations of dimensions widened by what the spacing leaves open at edges and by what faces may be off.

    spacing_m : of `thinned_spacing` or `even_spacing`.   cap_points : expected on the two end faces.   face_m : of `face_error`.
    """
    if not spacing_m > 0 and not face_m > 0:
        return member
    size = np.array([member.values()[name] for name in PARAMETERS[member.family]])
    long = dict(zip(faces(member.family), face_lengths(member.family, size), strict=True))
    covariance, parameters = np.array(member.covariance, float), []
    for k, p in enumerate(member.parameters):
        if p.name == "length":
            more = _of_ends(member, spacing_m, cap_points, sum(long.values()))
        else:
            sides = _SIDES.get(member.family, {}).get(p.name, ())
            more = sum(_of_edge(member, side, long, spacing_m) for side in sides) + 2 * face_m**2
        if p.std_m is None or not more > 0:
            parameters.append(p)
            continue
        covariance[k, k] += more
        parameters.append(replace(p, std_m=float(np.sqrt(covariance[k, k]))))
    return replace(member, covariance=covariance, parameters=tuple(parameters))


def _of_edge(member: Member, side: tuple[str, ...], long: Mapping[str, float], spacing_m: float) -> float:
    """Variance that the spacing adds to one side of a dimension: where no face was seen that ends it, or only one of few rows that noise mixes with
    the last of the face beside it.
    """
    seen = [face for face in side if member.seen.get(face, 0.0) >= _SEEN]
    if not seen:
        return (_EDGE * spacing_m) ** 2
    if max(long[face] for face in seen) > _FEW_ROWS * spacing_m:
        return 0.0
    return (_EDGE * min(spacing_m, 2 * member.sigma_m)) ** 2


def _of_ends(member: Member, spacing_m: float, cap_points: tuple[float, float], perimeter_m: float) -> float:
    """Variance that the spacing adds to the length: a cap was scanned where more points lie on it than in the last row along the outline."""
    if not spacing_m > 0:
        return 0.0
    open_ends = sum(n < _CAP_POINTS + perimeter_m / spacing_m for n in cap_points)
    return open_ends * ((_LAST_ROW if member.sigma_m < _ROWS * spacing_m else _EDGE) * spacing_m) ** 2
