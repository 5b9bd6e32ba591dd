"""Does another object go on where the member ends, with the same section? Then it was cut there while objects were told apart, and ends elsewhere.

What only touches an end (a column's flange, an end plate, the chord that a brace is welded to) crosses the outline of the section, or lies beside it
elsewhere; what goes on keeps to it, directly behind the end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scan2fea.estimation.explain import TOLERANCE
from scan2fea.estimation.holes import on_faces
from scan2fea.estimation.outline import outline_distance
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.sections import section
from scan2fea.types import BoolArray, FloatArray, Member, Section

_ROWS = 3.0  # spacings before and behind an end (`segmentation.around` gives no more of the other bodies)
_SIGMAS = 4.0  # of noise, and mill tolerance: what lies nearer is on the outline
_BESIDE = 3.0  # times that: what crosses the outline lies there too, twice as often
_DENSE, _SHARE = 0.5, 0.75  # of the points before the end; of the outline that has points before it
_PURE = 0.9  # of the body's points lie on the outline, however far along
_LEAST = 8  # points of a face before the end


def going_on(points: FloatArray, member: Member, covers: Sequence[FloatArray], joined: tuple[bool, bool] = (False, False)) -> str:
    """Why the length is not told; "" where nothing goes on. points : (n, 3) of the member.   covers : (k, 3) of each other body around, m.

    joined : whether its low end and its high one lie on a neighbour that it was cut off.
    """
    shape, length, sweep = section(member.family, member.values()), member.values()["length"], sweep_of_member(member)
    reach = _SIGMAS * member.sigma_m + TOLERANCE * float(np.linalg.norm(np.ptp(np.concatenate(shape.loops), axis=0)))
    step = _ROWS * spacing(points)
    own = sweep.coordinates(points)
    for end, behind in ((0.0, -1.0), (length, 1.0)):
        if joined[int(end > 0)]:
            continue
        ahead = own[np.abs((own[:, 2] - end) * behind + step / 2) < step / 2]
        for body in covers:
            local = sweep.coordinates(body)
            beyond = local[np.abs((local[:, 2] - end) * behind - step / 2) < step / 2]
            is_pure = len(beyond) >= _LEAST and (np.abs(outline_distance(shape, local[:, :2])[0]) <= reach).mean() >= _PURE
            if is_pure and _keeps_to(shape, ahead, beyond, reach):
                at = ", ".join(f"{x:.4g}" for x in body[np.abs(local[:, 2] - end).argmin()])
                return (
                    f"another object goes on with the same section where the {member.family} member ends, around ({at}) m: one member, told apart "
                    "there; join the two in labels.csv, or say that it ends there (whole = true)"
                )
    return ""


def _keeps_to(shape: Section, ahead: FloatArray, beyond: FloatArray, reach: float) -> bool:
    """Whether points beyond an end (k, 3) lie on the faces that have points before it (m, 3), and not across them."""
    before, _ = _on(shape, ahead, reach)
    after, beside = _on(shape, beyond, reach)
    seen = {name: width for name, (n, width) in before.items() if n >= _LEAST}
    going = sum(width for name, width in seen.items() if after[name][0] >= _DENSE * before[name][0])
    return bool(seen) and going >= _SHARE * sum(seen.values()) and beside.sum() < _DENSE * sum(n for n, _ in after.values())


def _on(shape: Section, local: FloatArray, reach: float) -> tuple[dict[str, tuple[int, float]], BoolArray]:
    """Per face the number of points (n, 3) on it and its width; whether each lies beside the outline."""
    distance, edge, along = outline_distance(shape, local[:, :2])
    near = np.abs(distance) <= reach
    faces = {name: (len(rows), width) for name, rows, _, width in on_faces(shape, edge[near], along[near])}
    return faces, ~near & (np.abs(distance) <= _BESIDE * reach)
