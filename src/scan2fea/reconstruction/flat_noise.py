"""The noise of points on flat faces, by their planes: of small parts every neighbourhood reaches round an edge, and edges read as noise there."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.noise import sampled_rows
from scan2fea.reconstruction.plane_growing import Planes
from scan2fea.types import FloatArray

LEAST = 16  # points of a plane that tell
MOST = 400  # of them are asked
TRIPLES = 200  # of points, through each of which a plane is laid: half of them on one face, all but one in 10^11 times one triple is
LESS = 0.5  # of the noise that neighbourhoods tell: the least median of Gaussian noise is hardly ever less


def flat_noise_m(points: FloatArray, planes: Planes) -> float:
    """Scatter of points (n, 3) about their planes, m; nan where none has LEAST of them.

    Of each plane the least median of distances (Rousseeuw, Leroy, "Robust regression and outlier detection", 1987): up to half of its points may
    lie on other faces. Over the planes the median, by their points.
    """
    sizes, scatters = [0.0], [np.nan]
    for k in range(len(planes)):
        own = np.flatnonzero(planes.label == k)
        if len(own) >= LEAST:
            sizes.append(float(len(own)))
            scatters.append(_least_median_m(points[own[sampled_rows(len(own), MOST, k)]], k))
    order = np.argsort(scatters)  # nan last, and of no weight
    weight = np.cumsum(np.array(sizes)[order])
    return float(np.array(scatters)[order][np.searchsorted(weight, 0.5 * weight[-1])])


def _least_median_m(points: FloatArray, seed: int) -> float:
    """The scale of Gaussian noise whose least median this is."""
    corners = points[np.random.default_rng(seed).integers(len(points), size=(TRIPLES, 3))]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    wide = length > 0.1 * np.median(length)  # of three points in a row anything is the plane
    normal = normal[wide] / length[wide, None]
    distance = np.abs(points @ normal.T - np.einsum("ij,ij->i", corners[wide, 0], normal))
    return 1.4826 * (1.0 + 5.0 / (len(points) - 3)) * float(np.median(distance, axis=0).min())
