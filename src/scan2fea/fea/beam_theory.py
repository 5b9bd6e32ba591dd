"""Closed forms of straight members: what the response of a solid model has to be.

The root section is held (it cannot warp), forces act at the centroid of the tip section unless said. x, y: axes of the section; displacements at the
centroid.
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.fea.beam import shear_modulus, twist_share
from scan2fea.fea.section_properties import SectionProperties
from scan2fea.types import FloatArray, Material

CANTILEVER_ROOTS = (1.875104068711961, 4.694091132974174, 7.854757438237613, 10.995540734875467, 14.13716839104647)
FREE_ROOTS = (4.730040744862704, 7.853204624095838, 10.995607838001671, 14.137165491257464, 17.27875965739948)


def tip_under_force(p: SectionProperties, material: Material, length_m: float, force_n: FloatArray) -> tuple[FloatArray, float]:
    """((2,) displacement of the tip's centroid, twist, rad) under a force (2,) at the centroid of the tip.

    Bending u = P L^3 / 3 E I^-1 e with the shear of Timoshenko, and twist about the shear centre, theta = P d L / G J, which moves the centroid on.
    """
    bend = np.linalg.solve(material.youngs_pa * p.inertia, force_n) * length_m**3 / 3
    sheared = p.shear @ force_n * length_m / shear_modulus(material)
    ex, ey = p.eccentricity
    torque = -ex * force_n[1] + ey * force_n[0]  # arm from the shear centre to the centroid is -e
    twist = tip_under_torque(p, material, length_m, torque)
    return np.asarray(bend + sheared + twist * np.array([ey, -ex])), twist


def tip_under_torque(p: SectionProperties, material: Material, length_m: float, torque_nm: float) -> float:
    """Twist of the tip, rad: T L / G J, less what the root takes that cannot warp."""
    return torque_nm * length_m / (shear_modulus(material) * p.j) * twist_share(p, material, length_m)


def tip_under_tension(p: SectionProperties, material: Material, length_m: float, force_n: float) -> float:
    """P L / E A."""
    return force_n * length_m / (material.youngs_pa * p.area)


def tip_under_weight(p: SectionProperties, material: Material, length_m: float, acceleration: FloatArray) -> tuple[FloatArray, float]:
    """((2,) displacement, twist) of the tip under its own weight, acceleration (2,) m/s2: q L^4 / 8 E I, q L^2 / 2 G A_s, m L^2 / 2 G J."""
    line = material.density_kg_m3 * p.area * np.asarray(acceleration, float)
    bend = np.linalg.solve(material.youngs_pa * p.inertia, line) * length_m**4 / 8
    sheared = p.shear @ line * length_m**2 / (2 * shear_modulus(material))
    ex, ey = p.eccentricity
    torque = -ex * line[1] + ey * line[0]
    twist = torque * length_m**2 / (2 * shear_modulus(material) * p.j) * _weight_twist_share(p, material, length_m)
    return np.asarray(bend + sheared + twist * np.array([ey, -ex])), twist


def _weight_twist_share(p: SectionProperties, material: Material, length_m: float) -> float:
    """Twist under an evenly spread torque with a root that cannot warp, over m L^2 / 2 G J: from E Cw th'''' - G J th'' = m (Vlasov 1961)."""
    if p.warping <= 0:
        return 1.0
    a = math.sqrt(shear_modulus(material) * p.j / (material.youngs_pa * p.warping)) * length_m
    # a > 300 is as good as 300: the root no longer counts
    cosh, sinh = math.cosh(min(a, 300.0)), math.sinh(min(a, 300.0))
    return 1 - 2 * (a * sinh - cosh + 1) / (a * a * cosh)


def middle_deflection(p: SectionProperties, material: Material, length_m: float, force_n: FloatArray) -> FloatArray:
    """(2,) of the middle against the ends under a force (2,) there, ends free to turn (three-point bending): P L^3 / 48 E I and P L / 4 G A_s."""
    bend = np.linalg.solve(material.youngs_pa * p.inertia, force_n) * length_m**3 / 48
    return np.asarray(bend + p.shear @ force_n * length_m / (4 * shear_modulus(material)))


def bending_frequency(inertia_m4: float, p: SectionProperties, material: Material, length_m: float, root: float) -> float:
    """lambda^2 / (2 pi L^2) sqrt(E I / rho A), Hz: about a principal axis of symmetry, slender (Bernoulli and Euler)."""
    return root**2 / (2 * math.pi * length_m**2) * math.sqrt(material.youngs_pa * inertia_m4 / (material.density_kg_m3 * p.area))


def torsional_frequency(p: SectionProperties, material: Material, length_m: float) -> float:
    """First of a cantilever that warps freely, uncoupled: sqrt(G J / rho I_0) / 4 L, Hz."""
    return math.sqrt(shear_modulus(material) * p.j / (material.density_kg_m3 * p.area * p.polar_radius_squared)) / (4 * length_m)


def buckling_loads(p: SectionProperties, material: Material, length_m: float, effective: float = 2.0) -> FloatArray:
    """(3,) N, rising: bending about both principal axes and twist, coupled by the shear centre (Timoshenko and Gere 1961, 5.7).

    effective : length factor, 2 of a cantilever, 1 of a member whose ends are pinned and warp freely.
    """
    k = math.pi / (effective * length_m)
    stiffness = np.zeros((3, 3))
    stiffness[:2, :2] = material.youngs_pa * p.inertia * k**2
    stiffness[2, 2] = material.youngs_pa * p.warping * k**2 + shear_modulus(material) * p.j
    ex, ey = p.eccentricity
    load = np.array([[1.0, 0.0, ey], [0.0, 1.0, -ex], [ey, -ex, p.polar_radius_squared]])
    scale = np.diag([1.0, 1.0, 1 / math.sqrt(p.polar_radius_squared)])
    lower = np.linalg.inv(np.linalg.cholesky(scale @ load @ scale))
    return np.asarray(np.linalg.eigvalsh(lower @ scale @ stiffness @ scale @ lower.T))
