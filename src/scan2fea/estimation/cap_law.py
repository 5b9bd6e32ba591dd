"""Was the end face scanned? What the points say of it across the axis, and what both ends say together.

Along the axis a cap of c points is, to first order, the same as a member that is longer by c / rho: d(rho Phi)/de is -rho phi. Where the noise is
wider than area over perimeter nothing else can be read from z. Across the axis a cap fills the section where the sides lie on its outline; and a
scan that saw one end face has mostly seen the other, so that what is unknown of both ends is one unknown, whose two errors add up in the length.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from scan2fea.kernel.section_likelihood import log_density
from scan2fea.kernel.sections import PARAMETERS, ROUND, section, section_area
from scan2fea.types import FloatArray, Value

CAP_STEPS = (-2, -1, 1, 2, 3, 4, 5)  # other caps, as powers of two of the expected one: seen worse, seen better
_PRIOR = np.array([0.45, 0.45] + [0.1 / len(CAP_STEPS)] * len(CAP_STEPS))  # no cap, one as dense as the sides, others
_VAGUE = np.array([0.45] + [0.55 / (len(CAP_STEPS) + 1)] * (len(CAP_STEPS) + 1))  # where the area of a cap is not known
_SAME = 2 / 3  # belief that both ends were seen alike; else each end is a case of its own
_ROUNDS = 60
_TINY = 1e-30


def cap_ratios(unit: float) -> list[float]:
    """Points of the cap over points per metre (m) of every hypothesis, in the order of the prior. unit : of a cap as dense as the sides."""
    return [0.0, unit] + [unit * 2.0**k for k in CAP_STEPS]


def together(low: FloatArray, high: FloatArray, noises: FloatArray, *, vague: bool = False) -> FloatArray:
    """(k, c, k, c) posterior of noise and cap of the low end and of the high end, from the log evidence (k, c) of each.

    noises : (k,) prior of each noise along the axis, which is mostly one for both ends.
    vague : the area of a cap is a guess: that of a tube whose wall was not seen.
    """
    prior = np.log(_alike(noises / noises.sum()))[:, None, :, None] + np.log(_alike(_VAGUE if vague else _PRIOR))[None, :, None, :]
    level = np.multiply.outer(low, np.ones(high.shape)) + high + prior
    share = np.exp(level - level.max())
    return np.asarray(share / share.sum())


def _alike(one: FloatArray) -> FloatArray:
    """(n, n) prior of what the two ends are, from that of one."""
    return np.asarray(_SAME * np.diag(one) + (1 - _SAME) * np.outer(one, one))


@dataclass(frozen=True, eq=False, kw_only=True)
class Across(Value):
    """Densities (n,) per square metre of n points across the axis: if they lie on the sides, on a cap, or anywhere."""

    side: FloatArray
    cap: FloatArray
    stray: FloatArray

    def with_like_caps(self, share: float) -> Across:
        """The sides with that share of points that lie as a cap's would."""
        return replace(self, side=(1 - share) * self.side + share * self.cap)


def across(
    family: str, values: FloatArray, sigma_m: float, noise: str, face_weight: FloatArray, stray_area_m2: float, xy: FloatArray, *, share: float = 1.0
) -> Across:
    """Densities at xy (n, 2). values : in the order of PARAMETERS[family].   face_weight : of `faces`, points per metre, relative.

    share : of the section's area where points of a cap are looked for.
    """
    weight = face_weight if face_weight.any() else np.ones(len(face_weight))
    side = np.exp(log_density(xy, family, values, sigma_m, noise, weight).logp)
    return Across(side=side + _TINY / stray_area_m2, cap=_filled(family, values, sigma_m, xy) / share, stray=np.full(len(xy), 1 / stray_area_m2))


def _filled(family: str, values: FloatArray, sigma: float, xy: FloatArray) -> FloatArray:
    """(n,) density of points even over the section, blurred by Gauss's law: a sum over the edges along y, or over the circles."""
    shape = section(family, dict(zip(PARAMETERS[family], values.tolist(), strict=True)))
    area = section_area(shape)
    found = np.zeros(len(xy))
    if family in ROUND:
        radii = [float(np.hypot(*loop[0])) for loop in shape.loops]
        for radius, sign in zip(radii, (1.0, -1.0), strict=False):
            found += sign * ndtr((radius - np.hypot(*xy.T)) / sigma)
            area += sign * np.pi * sigma**2  # the plane has more room outside a circle than inside
        return found / area
    for loop in shape.loops:
        for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            if a[1] != b[1]:
                found += ndtr((a[0] - xy[:, 0]) / sigma) * (ndtr((b[1] - xy[:, 1]) / sigma) - ndtr((a[1] - xy[:, 1]) / sigma))
    return found / area


def share_like_caps(body: Across) -> float:
    """Of the points between the ends that are no strays, the share that lies across the axis as a cap's points would: fillets and dents do.

    Of greatest likelihood (EM), and at least half a point: what was not seen may yet be there.
    """
    densities = np.stack([body.side, body.cap, body.stray])
    if not densities.shape[1]:
        return 0.5
    share = np.array([0.9, 0.05, 0.05])
    for _ in range(_ROUNDS):
        parts = share[:, None] * densities
        share = (parts / parts.sum(axis=0)).mean(axis=1)
    return float(np.clip(share[1] / max(share[0] + share[1], _TINY), 0.5 / densities.shape[1], 0.5))


def told_across(side: FloatArray, cap: FloatArray, stray: float, at: Across) -> float:
    """Log evidence of rates from where points lie across the axis, over that if all were of the sides.

    side, cap : (n,) points per metre of each kind at each point's z;  stray : everywhere.
    """
    mixed = side * at.side + cap * at.cap + stray * at.stray
    return float(np.log(np.maximum(mixed / (side + cap + stray + _TINY), _TINY) / at.side).sum())
