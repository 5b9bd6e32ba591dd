"""How much of each face was seen: points per metre of every face, relative, when the section is known.

The shares of the points among the faces are the proportions of a mixture: at a fixed section their likelihood has one maximum, and expectation
maximisation climbs to it (Dempster, Laird and Rubin 1977).
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.estimation.likelihood import SectionModel
from scan2fea.kernel.face_share import likeliest_share
from scan2fea.kernel.section_likelihood import face_lengths, faces, log_density
from scan2fea.types import FloatArray

_ROUNDS = 200
_STILL = 1e-4
_UNSEEN = 0.25  # of the typical density: a face below it counts as not seen when sets of whole faces are compared


def seen_weights(model: SectionModel, theta: FloatArray) -> FloatArray:
    """(f,) points per metre of each face at theta, of most likelihood, scaled so that the densest half of the outline (by points) averages 1."""
    lengths = face_lengths(model.layout.family, model.layout.values(theta))
    eps = model.layout.outlier_share(theta)
    density = face_densities(model, theta)
    stray = 1 / model.area_m2
    share = likeliest_share(np.ascontiguousarray(density), lengths / lengths.sum(), eps / (1 - eps) * stray, _ROUNDS, _STILL)
    weight = share / lengths
    return np.asarray(weight / _typical_density(weight, share))


def face_densities(model: SectionModel, theta: FloatArray) -> FloatArray:
    """(n, f) density of each point if it were of that face, per square metre."""
    layout = model.layout
    values = layout.values(theta)
    lengths = face_lengths(layout.family, values)
    d = log_density(model.in_section(theta), layout.family, values, layout.sigma(theta), model.noise, np.ones(len(lengths)))
    # the score by a face's log weight is (share of the point's density that the face has) - (share of the outline's length): by_face = their sum
    by_face = np.maximum(d.d_log_weight + lengths / lengths.sum(), 0) * np.exp(np.minimum(d.logp, 700))[:, None]
    return np.asarray(by_face / (lengths / lengths.sum()))


def _typical_density(weight: FloatArray, share: FloatArray) -> float:
    """Density of the face that the median point lies on."""
    order = np.argsort(weight)
    at = int(np.searchsorted(np.cumsum(share[order]), 0.5))
    return max(float(weight[order[min(at, len(order) - 1)]]), 1e-300)


def snapped(weight: FloatArray) -> FloatArray:
    """(f,) 1 for faces that were seen and 0 for those that were not."""
    return np.where(weight > _UNSEEN, 1.0, 0.0)


def free_faces(family: str, weight: FloatArray) -> tuple[str, ...]:
    """Faces whose weight is unknown when weights are free: all but the densest, which is the unit."""
    names = faces(family)
    unit = int(np.argmax(weight * 1.0))
    return tuple(name for i, name in enumerate(names) if i != unit)


def set_price(family: str) -> float:
    """Twice the log of the number of sets of faces: what choosing one by the data costs in BIC's units."""
    return 2 * len(faces(family)) * math.log(2)
