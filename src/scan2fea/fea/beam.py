"""Frames of beams: bending about any axes with shear, twist about the shear centre with warping, axial force; static, modal and buckling.

Two nodes, seven unknowns each: three displacements of the centroid, three rotations, and the rate of twist (Vlasov 1961). Stiffness in bending from
the end flexibility of a Timoshenko beam (Przemieniecki 1968), so that one element is exact under end loads; twist and mass by cubic shape functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from scan2fea.errors import SolveError, require
from scan2fea.fea.section_properties import SectionProperties
from scan2fea.types import BoolArray, FloatArray, IntArray, Material, Value

_LAYER = 0.02  # of the length of an element
_GAUSS, _WEIGHT = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False, kw_only=True)
class Beams(Value):
    """nodes : (n, 3) metres, on the centroids.   elements : (m, 2).   axes : (m, 3, 3), columns x, y of the section and z along each element.

    section : (m,) index into `sections`.   chain : (m,) elements of one number share the rate of twist where they meet; across chains it is free.
    """

    nodes: FloatArray
    elements: IntArray
    axes: FloatArray
    section: IntArray
    chain: IntArray
    sections: tuple[SectionProperties, ...]
    material: Material


@dataclass(frozen=True, eq=False, kw_only=True)
class BeamMatrices(Value):
    """stiffness, mass : (d, d).   dof : (m, 14) of each element. The first 6 n unknowns are those of the nodes, six each; rates of twist follow."""

    stiffness: FloatArray
    mass: FloatArray
    dof: IntArray


def straight(length_m: float, section: SectionProperties, material: Material, n_elements: int = 24) -> Beams:
    """One member along +z from the origin, its section in x and y, its centroid on the axis."""
    z = np.linspace(0.0, length_m, n_elements + 1)
    k = np.arange(n_elements)
    return Beams(
        nodes=np.stack([0 * z, 0 * z, z], axis=1),
        elements=np.stack([k, k + 1], axis=1),
        axes=np.tile(np.eye(3), (n_elements, 1, 1)),
        section=np.zeros(n_elements, np.int64),
        chain=np.zeros(n_elements, np.int64),
        sections=(section,),
        material=material,
    )


def assemble_beams(beams: Beams) -> BeamMatrices:
    """Stiffness and consistent mass of the frame. Raises SolveError where an element has no length."""
    dof, n_dof = _numbered(beams)
    stiffness, mass = np.zeros((n_dof, n_dof)), np.zeros((n_dof, n_dof))
    made: dict[tuple[int, float], tuple[FloatArray, FloatArray]] = {}
    for row, length in enumerate(_lengths(beams).tolist()):
        key = (int(beams.section[row]), round(length, 12))
        if key not in made:
            made[key] = beam_element(beams.sections[key[0]], beams.material, length)
        turn = _turn(beams.axes[row])
        at = np.ix_(dof[row], dof[row])
        stiffness[at] += turn.T @ made[key][0] @ turn
        mass[at] += turn.T @ made[key][1] @ turn
    return BeamMatrices(stiffness=stiffness, mass=mass, dof=dof)


def geometric(beams: Beams, force: FloatArray, dof: IntArray, n_dof: int) -> FloatArray:
    """(d, d) stiffness by axial forces (m,), tension positive: N times the squares of the slopes of all fibres (Timoshenko and Gere 1961, 5.7)."""
    total = np.zeros((n_dof, n_dof))
    for row, length in enumerate(_lengths(beams).tolist()):
        p = beams.sections[int(beams.section[row])]
        turn = _turn(beams.axes[row])
        inner = np.zeros((14, 14))
        for at, w in zip((_GAUSS + 1) / 2, _WEIGHT / 2, strict=True):
            slope = _fields(at, length, p, 1)
            weights = np.array([1.0, 1.0, (p.ixx + p.iyy) / p.area])
            inner += w * length * slope[:3].T @ (weights[:, None] * slope[:3])
        total[np.ix_(dof[row], dof[row])] += force[row] * turn.T @ inner @ turn
    return total


def solve_beams(matrices: BeamMatrices, held: BoolArray, load: FloatArray) -> FloatArray:
    """(d, r) unknowns under loads (d, r) with `held` (d,) at zero. Raises SolveError where the frame can move freely."""
    free = np.flatnonzero(~held)
    inner = matrices.stiffness[np.ix_(free, free)]
    scale = 1 / np.sqrt(np.diag(inner))  # lengths and angles in one matrix
    try:
        factor = scipy.linalg.cho_factor(inner * np.outer(scale, scale))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise SolveError(f"the frame of {len(held)} unknowns can move freely: hold more of it") from error
    out = np.zeros_like(load)
    out[free] = scale[:, None] * scipy.linalg.cho_solve(factor, scale[:, None] * load[free])
    return out


def frequencies(matrices: BeamMatrices, held: BoolArray, n_modes: int) -> tuple[FloatArray, FloatArray]:
    """(n_modes,) Hz and shapes (d, n_modes); without support the first six are zero."""
    free = np.flatnonzero(~held)
    k, m = (a[np.ix_(free, free)] for a in (matrices.stiffness, matrices.mass))
    scale = 1 / np.sqrt(np.diag(m))
    last = min(n_modes, len(free)) - 1
    values, vectors = scipy.linalg.eigh(k * np.outer(scale, scale), m * np.outer(scale, scale), subset_by_index=(0, last))
    shapes = np.zeros((len(held), last + 1))
    shapes[free] = scale[:, None] * vectors
    return np.sqrt(np.maximum(values, 0.0)) / (2 * np.pi), shapes


def buckling(matrices: BeamMatrices, held: BoolArray, geometry: FloatArray, n_modes: int = 1) -> FloatArray:
    """(k,) factors of the load at which the frame buckles, rising; none where the load presses nothing."""
    free = np.flatnonzero(~held)
    k, g = (a[np.ix_(free, free)] for a in (matrices.stiffness, -geometry))
    scale = 1 / np.sqrt(np.diag(k))
    values = scipy.linalg.eigh(g * np.outer(scale, scale), k * np.outer(scale, scale), eigvals_only=True)
    rising = values[::-1][:n_modes]
    return np.asarray(1 / rising[rising > 1e-12 * max(float(np.abs(values).max()), 1e-300)])


def clamped(beams: Beams, matrices: BeamMatrices, node: int) -> BoolArray:
    """(d,) unknowns held where a node is built in: displacements, rotations and, where its members warp, the rate of twist.

    A section whose warping dies away within a fiftieth of an element (a tube) is not hindered: the cubic would make far too much of it.
    """
    held = np.zeros(len(matrices.stiffness), bool)
    held[6 * node : 6 * node + 6] = True
    g = shear_modulus(beams.material)
    for row, end in np.argwhere(beams.elements == node).tolist():
        p = beams.sections[int(beams.section[row])]
        if beams.material.youngs_pa * p.warping > (_LAYER * _lengths(beams)[row]) ** 2 * g * p.j:
            held[matrices.dof[row, 6 + 7 * end]] = True
    return held


def axial_forces(beams: Beams, matrices: BeamMatrices, solution: FloatArray) -> FloatArray:
    """(m,) tension of each element, N, under the unknowns (d,)."""
    along = beams.axes[:, :, 2]
    ends = solution[: 6 * len(beams.nodes)].reshape(-1, 6)[beams.elements, :3]
    area = np.array([p.area for p in beams.sections])[beams.section]
    return np.asarray(beams.material.youngs_pa * area / _lengths(beams) * np.einsum("mc,mc->m", ends[:, 1] - ends[:, 0], along))


# ------------------------------------------------------------------ elements


def _lengths(beams: Beams) -> FloatArray:
    ends = beams.nodes[beams.elements]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    require((length > 0).all(), SolveError, f"{int((length <= 0).sum())} beam elements have no length")
    return np.asarray(length)


def _numbered(beams: Beams) -> tuple[IntArray, int]:
    """(m, 14) unknowns of each element: six of each node, and a rate of twist of its own for each chain through a node."""
    n = len(beams.nodes)
    key = beams.chain[:, None] * n + beams.elements
    _, rate = np.unique(key, return_inverse=True)
    rate = 6 * n + rate.reshape(-1, 2)
    six = 6 * beams.elements[:, :, None] + np.arange(6)
    return np.concatenate([six, rate[:, :, None]], axis=2).reshape(-1, 14), int(rate.max()) + 1


def _turn(axes: FloatArray) -> FloatArray:
    """(14, 14) from the frame's unknowns to those of the element."""
    out = np.eye(14)
    for k in (0, 3, 7, 10):
        out[k : k + 3, k : k + 3] = axes.T
    return out


def beam_element(p: SectionProperties, material: Material, length: float) -> tuple[FloatArray, FloatArray]:
    """(stiffness, mass), both (14, 14), in the axes of the section about the centroid."""
    e = material.youngs_pa
    g = e / (2 * (1 + material.poisson))
    centre = _about_shear_centre(p)
    stiffness = np.zeros((14, 14))
    axial = e * p.area / length
    stiffness[np.ix_([2, 9], [2, 9])] = axial * np.array([[1, -1], [-1, 1]])
    stiffness += _bending(p, e, g, length) + _twist(p, e, g, length)
    mass = np.zeros((14, 14))
    rho = material.density_kg_m3
    for at, w in zip((_GAUSS + 1) / 2, _WEIGHT / 2, strict=True):
        field = _fields(at, length, p, 0)
        weights = rho * np.array([p.area, p.area, p.ixx + p.iyy, p.area])
        mass += w * length * field[:4].T @ (weights[:, None] * field[:4])
        slope = np.zeros((2, 14))
        slope[0, [4, 11]], slope[1, [3, 10]] = (1 - at, at), (at - 1, -at)
        mass += w * length * rho * slope.T @ p.inertia @ slope
    return centre.T @ stiffness @ centre, mass


def _about_shear_centre(p: SectionProperties) -> FloatArray:
    """(14, 14) from the centroid's displacements to those of the shear centre: U = u - theta e_y, V = v + theta e_x."""
    out = np.eye(14)
    ex, ey = p.eccentricity
    for k in (0, 7):
        out[k, k + 5], out[k + 1, k + 5] = -ey, ex
    return out


def _bending(p: SectionProperties, e: float, g: float, length: float) -> FloatArray:
    """Of the displacements of the shear centre and the rotations, from the flexibility of the far end when the near one is held."""
    bend = np.linalg.inv(e * p.inertia)
    flexibility = np.zeros((4, 4))
    flexibility[:2, :2] = length**3 / 3 * bend + length / g * p.shear
    flexibility[:2, 2:] = flexibility[2:, :2] = length**2 / 2 * bend
    flexibility[2:, 2:] = length * bend
    far = np.linalg.inv(flexibility)
    # far end against near: U2 - U1 - L psi1, psi2 - psi1, with psi = (r_y, -r_x)
    relative = np.zeros((4, 14))
    relative[0, [7, 0, 4]] = 1, -1, -length
    relative[1, [8, 1, 3]] = 1, -1, length
    relative[2, [11, 4]] = 1, -1
    relative[3, [10, 3]] = -1, 1
    return np.asarray(relative.T @ far @ relative)


def _hermite(at: float, length: float, derivative: int) -> FloatArray:
    """(4,) cubic shape functions of value and slope at both ends, or their first or second derivatives."""
    x, h = at, length
    if derivative == 0:
        return np.array([1 - 3 * x**2 + 2 * x**3, h * (x - 2 * x**2 + x**3), 3 * x**2 - 2 * x**3, h * (x**3 - x**2)])
    if derivative == 1:
        return np.array([(6 * x**2 - 6 * x) / h, 1 - 4 * x + 3 * x**2, (6 * x - 6 * x**2) / h, 3 * x**2 - 2 * x])
    return np.array([(12 * x - 6) / h**2, (6 * x - 4) / h, (6 - 12 * x) / h**2, (6 * x - 2) / h])


_TWIST = [5, 6, 12, 13]


def _twist(p: SectionProperties, e: float, g: float, length: float) -> FloatArray:
    out = np.zeros((14, 14))
    for at, w in zip((_GAUSS + 1) / 2, _WEIGHT / 2, strict=True):
        first, second = _hermite(at, length, 1), _hermite(at, length, 2)
        out[np.ix_(_TWIST, _TWIST)] += w * length * (g * p.j * np.outer(first, first) + e * p.warping * np.outer(second, second))
    return out


def _fields(at: float, length: float, p: SectionProperties, derivative: int) -> FloatArray:
    """(4, 14) of the centroid's x, y, of the twist and of the axial displacement, or their derivatives along the element."""
    cubic, linear = _hermite(at, length, derivative), np.array([1 - at, at] if derivative == 0 else [-1 / length, 1 / length])
    shear_centre = np.zeros((2, 14))
    shear_centre[0, [0, 4, 7, 11]] = cubic
    shear_centre[1, [1, 3, 8, 10]] = cubic * np.array([1, -1, 1, -1])
    twist = np.zeros(14)
    twist[_TWIST] = cubic
    ex, ey = p.eccentricity
    moved = shear_centre @ _about_shear_centre(p)
    axial = np.zeros(14)
    axial[[2, 9]] = linear
    return np.stack([moved[0] + ey * twist, moved[1] - ex * twist, twist, axial])


def shear_modulus(material: Material) -> float:
    return material.youngs_pa / (2 * (1 + material.poisson))


def twist_share(p: SectionProperties, material: Material, length_m: float) -> float:
    """theta / (T L / G J) of a cantilever whose root cannot warp: 1 - tanh(k L) / (k L), k^2 = G J / E Cw (Vlasov 1961)."""
    if p.warping <= 0:
        return 1.0
    k = math.sqrt(shear_modulus(material) * p.j / (material.youngs_pa * p.warping)) * length_m
    return 1 - math.tanh(k) / k
