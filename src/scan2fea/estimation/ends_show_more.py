"""Do the end faces reach beyond a face that nobody saw? Then the section goes on there.

A tee of which only the flange's back and toes were seen is a flat whose hidden face its toes tell by where they stop. Its end faces show the web: a
few points, which may pass as strays, but all in the planes of the ends.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull
from scipy.special import pdtrc

from scan2fea.estimation.explain import TOLERANCE
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.sections import section
from scan2fea.types import FloatArray, Member

_SIGMAS = 4.0  # off the hull of the section, and off an end's plane
_LEAST = 8  # points: fewer show no face
_BY_CHANCE = 1e-3


def ends_show_more(points: FloatArray, member: Member) -> str:
    """Why the section is only part of what was scanned; "" where all its faces were seen or nothing lies beside it in the planes of its ends.

    points : (n, 3) metres. Strays are as many there as elsewhere along the member.
    """
    told = [*member.reached, *member.told_toes]
    if not told:
        return ""
    outer, length = section(member.family, member.values()).loops[0], member.values()["length"]
    reach = _SIGMAS * member.sigma_m + TOLERANCE * float(np.linalg.norm(np.ptp(outer, axis=0)))
    local = sweep_of_member(member).coordinates(points)
    sides = ConvexHull(outer).equations
    strays = local[(local[:, :2] @ sides[:, :2].T + sides[:, 2]).max(axis=1) > reach, 2]
    at_ends = int((np.minimum(np.abs(strays), np.abs(strays - length)) <= reach).sum())
    elsewhere = max(float(np.ptp(local[:, 2])) - 4 * reach, reach)
    expected = (len(strays) - at_ends + 1) * 4 * reach / elsewhere
    if at_ends < _LEAST or float(pdtrc(at_ends - 1, expected)) > _BY_CHANCE:
        return ""
    unseen = f"{', '.join(told)} {'was' if len(told) == 1 else 'were'} not seen"
    return (
        f"{at_ends} points in the planes of its ends lie beside the {member.family} member of which {unseen}: "
        "it is only part of what was scanned; scan that side too"
    )
