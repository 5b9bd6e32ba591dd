"""The static answers of a member made of shells, beside those of its solid and of beam theory.

Shells of eight nodes with points at 2 x 2 places: solids degenerated to a middle surface whose fibres stay straight (Ahmad, Irons and Zienkiewicz
1970), integrated at fewer places so that thin ones do not lock (Zienkiewicz, Taylor and Too 1971); the element of `model_shell.inp`. Six unknowns
a node: three displacements and three turns, so that walls meet at any angle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import splu

from scan2fea.errors import SolveError, require
from scan2fea.fea.shell import ShellModel, end_arms, end_forces, shell_model
from scan2fea.fea.static import figure
from scan2fea.types import CaseResult, FloatArray, Material, Member

SHEAR = 5.0 / 6.0  # of the shear stiffness of an even stress across the wall
DRILL = 1e-6  # of E t A: holds turns about the normal, which stiffen nothing, where all walls of a node lie in one plane
PREFIX = "shell_"
_CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0)], float)  # as the nodes of `ShellModel.elements`
_AT = 1.0 / np.sqrt(3.0)
# components of the local gradient du_i / dx_j that make the strains 11, 22, 12, 13, 23
_STRAINS = ((0, 0, 0), (1, 1, 1), (2, 0, 1), (2, 1, 0), (3, 0, 2), (3, 2, 0), (4, 1, 2), (4, 2, 1))


def shells_beside(rows: Sequence[CaseResult], member: Member, material: Material, force_n: float) -> list[CaseResult]:
    """`shell_cases` of a member whose solid was solved for the same cases; none where its walls make no shells. Raises SolveError as that."""
    if not any(row.name == "tension" for row in rows):
        return []
    try:
        model = shell_model(member)
    except SolveError:  # bars and thick walls: they have no deck of shells either
        return []
    return shell_cases(model, material, force_n)


def shell_cases(model: ShellModel, material: Material, force_n: float) -> list[CaseResult]:
    """Of each case of a member what its last end does, named `shell_` and the case. Raises SolveError where nothing holds a part of it."""
    forces = end_forces(model, force_n)
    load = np.zeros((6 * len(model.nodes), len(forces)))
    for k, force in enumerate(forces.values()):
        load.reshape(-1, 6, len(forces))[model.last, :3, k] = force
    free = np.ones((len(model.nodes), 6), bool)
    free[model.first] = False
    rows = np.flatnonzero(free.ravel())
    moved = np.zeros_like(load)
    try:
        moved[rows] = splu(shell_stiffness(model, material)[rows][:, rows].tocsc()).solve(load[rows])
    except RuntimeError as error:  # scipy's word for a singular matrix
        raise SolveError(f"the shells of the member are not held: {error}") from error
    out: list[CaseResult] = []
    arm = end_arms(model)
    for k, name in enumerate(forces):
        u = moved[:, k].reshape(-1, 6)[model.last, :3]
        tip = model.axes.T @ (model.weight @ u)
        if name == "torsion":
            turn = float(model.weight @ np.einsum("ij,ij->i", arm, u) / (model.weight @ (arm**2).sum(axis=1)))
            out.append(figure(PREFIX + name, "twist_rad", "rad", turn))
        else:
            axis = {"tension": 2, "bend_x": 0, "bend_y": 1}[name]
            out.append(figure(PREFIX + name, f"tip_{'xyz'[axis]}_m", "m", float(tip[axis])))
    return out


def shell_stiffness(model: ShellModel, material: Material) -> csr_array:
    """(6 n, 6 n), N/m and the like; unknowns of a node: displacement, turn. Raises SolveError for an element that is turned inside out."""
    x, t = model.nodes[model.elements], model.thickness_m[model.wall]
    shape, slope = _shapes(_CORNERS)
    normal = _normals(np.einsum("akd,mkc->madc", slope, x))
    stiff = np.zeros((len(x), 48, 48))
    area = np.zeros(len(x))
    shape, slope = _shapes(np.array([(a, b) for a in (-_AT, _AT) for b in (-_AT, _AT)]))
    law = _law(material)
    for g in range(4):
        for height in (-_AT, _AT):
            strain, volume = _strains(shape[g], slope[g], height, x, normal, t)
            require(bool((volume > 0).all()), SolveError, "a shell of the member is turned inside out: its walls fold")
            stiff += np.einsum("m,mia,ij,mjb->mab", volume, strain, law, strain, optimize=True)
            area += volume / t
    drill = DRILL * material.youngs_pa * t * area / 8
    stiff.reshape(-1, 8, 6, 8, 6)[:, np.arange(8), 3:, np.arange(8), 3:] += np.einsum("m,mki,mkj->kmij", drill, normal, normal)
    dof = (6 * model.elements[:, :, None] + np.arange(6)).reshape(len(x), 48)
    n = 6 * len(model.nodes)
    return coo_array((stiff.ravel(), (np.repeat(dof, 48, axis=1).ravel(), np.tile(dof, (1, 48)).ravel())), shape=(n, n)).tocsr()


def _shapes(at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape functions (a, 8) and their slopes (a, 8, 2) at places (a, 2) of the square from -1 to 1."""
    s, r = at[:, None, 0], at[:, None, 1]
    a, b = _CORNERS[:, 0], _CORNERS[:, 1]
    corner = 0.25 * (1 + a * s) * (1 + b * r) * (a * s + b * r - 1)
    corner_s = 0.25 * a * (1 + b * r) * (2 * a * s + b * r)
    corner_r = 0.25 * b * (1 + a * s) * (a * s + 2 * b * r)
    across, along = 0.5 * (1 - s**2) * (1 + b * r), 0.5 * (1 + a * s) * (1 - r**2)
    is_corner, is_across = np.arange(8) < 4, a == 0
    n = np.where(is_corner, corner, np.where(is_across, across, along))
    n_s = np.where(is_corner, corner_s, np.where(is_across, -s * (1 + b * r), 0.5 * a * (1 - r**2)))
    n_r = np.where(is_corner, corner_r, np.where(is_across, 0.5 * b * (1 - s**2), -r * (1 + a * s)))
    return n, np.stack([n_s, n_r], axis=2)


def _normals(tangents: FloatArray) -> FloatArray:
    """(..., 3) unit normals of tangents (..., 2, 3)."""
    across = np.cross(tangents[..., 0, :], tangents[..., 1, :])
    return np.asarray(across / np.linalg.norm(across, axis=-1, keepdims=True))


def _law(material: Material) -> FloatArray:
    """(5, 5) stress 11, 22, 12, 13, 23 of strain, none across the wall."""
    nu = material.poisson
    g = material.youngs_pa / (2 * (1 + nu))
    law = np.diag([0.0, 0.0, g, SHEAR * g, SHEAR * g])
    law[:2, :2] = material.youngs_pa / (1 - nu**2) * np.array([[1, nu], [nu, 1]])
    return law


def _strains(
    shape: FloatArray, slope: FloatArray, height: float, x: FloatArray, normal: FloatArray, t: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Strains (m, 5, 48) of the unknowns at one place and height (-1 to 1) of every element, and the volume (m,) that the place stands for."""
    fibre = 0.5 * t[:, None, None] * normal
    solid = x + height * fibre
    jacobian = np.stack([*np.einsum("kd,mkc->dmc", slope, solid), np.einsum("k,mkc->mc", shape, fibre)], axis=1)
    tangents = np.einsum("kd,mkc->mdc", slope, x)
    first = tangents[:, 0] / np.linalg.norm(tangents[:, 0], axis=1)[:, None]
    third = _normals(tangents)
    local = np.stack([first, np.cross(third, first), third], axis=1)  # rows: the axes of the wall
    to_local = local @ np.linalg.inv(jacobian)
    natural = np.zeros((len(x), 3, 3, 8, 6))  # natural direction, component, node, unknown
    turn = _turned(fibre)
    for d in range(3):
        n, own = (slope[:, d], height * slope[:, d]) if d < 2 else (np.zeros(8), shape)
        natural[:, d, :, :, :3] = n[None, None, :, None] * np.eye(3)[None, :, None, :]
        natural[:, d, :, :, 3:] = own[None, None, :, None] * turn.transpose(0, 2, 1, 3)
    gradient = np.einsum("mjd,mic,mdcab->mijab", to_local, local, natural, optimize=True).reshape(len(x), 3, 3, 48)
    strain = np.zeros((len(x), 5, 48))
    for row, i, j in _STRAINS:
        strain[:, row] += gradient[:, i, j]
    return strain, np.linalg.det(jacobian)


def _turned(fibre: FloatArray) -> FloatArray:
    """(m, 8, 3, 3) of fibres (m, 8, 3) the matrix that a small turn w moves their ends by: w x fibre."""
    out = np.zeros((*fibre.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i, j] = fibre[..., k]
        out[..., i, k] = -fibre[..., j]
    return out
