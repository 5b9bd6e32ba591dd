"""An end of which no face was seen and that another object touches is known no better than how far that one is.

Either may have points of the other: those within noise of a beam's flange went to the beam, whoever they are of.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.sections import section
from scan2fea.types import FloatArray, Member

_ROWS, _SIGMAS = 3.5, 6.0  # spacings (`segmentation.around` gives no more of the other bodies) and noise, as far as points may have gone astray
_LEAST = 8  # points


def abutting(member: Member, spacing_m: float, covers: Sequence[FloatArray], is_bare: tuple[bool, bool]) -> Member:
    """The member, its length less sure where others touch an end: evenly spread up to where their points are.

    spacing_m : of its own points.   covers : (k, 3) points of each other body around, m.   is_bare : no face seen of the low end, of the high one.
    """
    length = member.parameters[-1]
    if length.std_m is None or not length.observable or not covers or not any(is_bare):
        return member
    sweep, corners = sweep_of_member(member), np.concatenate(section(member.family, member.values()).loops)
    local = sweep.coordinates(np.concatenate(covers))
    local = local[((local[:, :2] >= corners.min(axis=0)) & (local[:, :2] <= corners.max(axis=0))).all(axis=1)]
    beyond = np.stack([-local[:, 2], local[:, 2] - length.value_m])
    near = np.abs(beyond) <= _ROWS * spacing_m + _SIGMAS * member.sigma_m
    gaps = [float(np.median(b[n])) if bare and n.sum() >= _LEAST else 0.0 for b, n, bare in zip(beyond, near, is_bare, strict=True)]
    if not any(gaps):
        return member
    std = math.sqrt(length.std_m**2 + sum(gap**2 for gap in gaps) / 3)
    covariance = np.array(member.covariance)
    covariance[len(member.parameters) - 1, len(member.parameters) - 1] = std**2
    return replace(member, parameters=(*member.parameters[:-1], replace(length, std_m=std)), covariance=covariance)
