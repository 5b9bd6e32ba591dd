"""A tube that was seen from outside and into its open ends: it has the outer faces of the bar that looks the same, and no point tells of its wall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.estimation.canonical import turned_weight
from scan2fea.estimation.fit import SectionFit
from scan2fea.estimation.plausible import usual_wall
from scan2fea.kernel.pinned import SEEN
from scan2fea.kernel.section_likelihood import faces

TUBE_OF = {"rect": "RHS", "round": "CHS"}
_OF_BAR = {"RHS": {"h": "b", "b": "t"}, "CHS": {"d": "d"}}  # dimension of the tube -> of the bar
_OPPOSITE = (("BOTTOM_INNER", "TOP_INNER"), ("LEFT_INNER", "RIGHT_INNER"))
_UNTOLD = "the points do not depend on it"


def seen_from_outside(fit: SectionFit) -> SectionFit:
    """The fit of a tube of which two adjacent inner faces were seen, as one of which these are the outer faces; any other fit as it is.

    A corner looks the same from both sides, and who looks into a tube sees opposite faces. Where both faces of those sides fit and the points do not
    tell them apart they are one, in the middle of both.
    """
    if fit.family != "RHS":
        return fit
    inner, outer = ({name for name, share in fit.seen.items() if share >= SEEN and name.endswith(side)} for side in ("INNER", "OUTER"))
    is_one = bool(outer) and not fit.observable["t"] and {name.replace("INNER", "OUTER") for name in inner} == outer
    if (outer and not is_one) or any(inner.issuperset(pair) for pair in _OPPOSITE):
        return fit
    t = fit.value("t")
    names = faces("RHS")
    swapped = [names.index(name.replace("INNER", "OUTER") if name.endswith("INNER") else name.replace("OUTER", "INNER")) for name in names]
    within = t if is_one else 2 * t
    values = np.array([value if name == "t" else value - within for name, value in zip(fit.names, fit.values.tolist(), strict=True)])
    if min(values[:2]) <= 2 * t:  # too narrow to be this from outside
        return fit
    weight = fit.face_weight[swapped]
    if is_one:
        weight = np.array([0.0 if name.endswith("INNER") else own + other for name, own, other in zip(names, fit.face_weight, weight, strict=True)])
        values = np.r_[values[:2], usual_wall(values[:2])]
    return replace(fit, values=values, face_weight=weight, seen=dict(zip(names, np.minimum(weight, 1.0).tolist(), strict=True)))


def tube_of(bar: SectionFit) -> SectionFit:
    """The fit of a bar as that of a tube of a usual wall, which is not observable. Its layout and theta stay the bar's.

    A flat bar's longer side is along x and a tube's along y: the section is turned by +90 degrees against the bar's frame.
    """
    family = TUBE_OF[bar.family]
    own = _OF_BAR[family]
    rows = [bar.names.index(name) for name in own.values()]
    n = len(rows)
    covariance = np.zeros((n + 1, n + 1))
    covariance[:n, :n] = bar.covariance[np.ix_(rows, rows)]
    outer = turned_weight(bar.family, bar.face_weight) if family == "RHS" else bar.face_weight
    weight = np.r_[outer, np.zeros(len(outer))]
    return replace(
        bar,
        family=family,
        names=(*own, "t"),
        values=np.r_[bar.values[rows], usual_wall(bar.values)],
        std=np.r_[bar.std[rows], 0.0],
        covariance=covariance,
        observable={**{name: bar.observable[other] for name, other in own.items()}, "t": False},
        why={**{name: bar.why[other] for name, other in own.items() if other in bar.why}, "t": _UNTOLD},
        face_weight=weight,
        seen=dict(zip(faces(family), np.minimum(weight, 1.0).tolist(), strict=True)),
    )
