"""Points that lie together far off the solid: a piece of the part that it lacks, a rib or the wall of a bore, however few of all points they are.

Strays lie anywhere. How many of n points that lie off the surface hang together by chance is a branching process: a point has a mean of m others
within reach, and k hang together with the chance exp(-m k) (m k)^(k - 1) / k! (Borel 1942; Otter 1949).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaln

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import area
from scan2fea.kernel.neighbors import radius_components
from scan2fea.reconstruction.evidence import around, at_most, mm
from scan2fea.types import Check, FloatArray, TriangleMesh

LOST_CROWDS = "points off the solid that lie together"
REACH = 2.0  # mean spacings between points that lie together: twelve others lie in that reach on a scanned face
CHANCE = 1e-3  # that strays have so large a crowd anywhere
LEAST = 5  # points may lie together at an edge or a corner that spacing has cut off


def lost_crowds(points: FloatArray, mesh: TriangleMesh, far_m: float) -> Check:
    """How many of the points (n, 3) farther than `far_m` off the solid hang together?"""
    off = points[PointToMesh(mesh).nearest(points).distance > far_m]
    crowd = off[:0]
    if len(off):
        label = radius_components(off, REACH * math.sqrt(area(mesh) / len(points)))
        crowd = off[label == np.bincount(label).argmax()]
    most = max(LEAST, largest_by_chance(len(off), math.pi * REACH**2 * len(off) / max(len(points), 1)))
    says = (
        f"{len(crowd)} points lie together farther than {mm(far_m)} off the solid (limit {most} of {len(off)} that do){around(crowd)}: "
        "a part of what was scanned was lost; scan it more densely, or split it off"
    )
    return at_most(LOST_CROWDS, float(len(crowd)), float(most), says)


def largest_by_chance(n: int, mean: float) -> int:
    """The largest crowd of n strays that chance leaves more often than CHANCE; any where each has a `mean` of 1 and more others within reach."""
    if mean >= 1.0:
        return n
    k = np.arange(1, n + 1)
    log = -mean * k + (k - 1) * np.log(max(mean, 1e-300) * k) - gammaln(k + 1)
    tail = np.cumsum(np.exp(log)[::-1])[::-1]
    return int(np.sum(n * tail >= CHANCE))
