"""From a mesh to a finite element model: named node sets, what holds it, what loads it."""

from __future__ import annotations

import re

import numpy as np

from scan2fea.errors import SolveError, UsageError, require
from scan2fea.fea.materials import chosen_material
from scan2fea.fea.options import FeaOptions
from scan2fea.types import BoolArray, FEModel, FloatArray, IntArray, TetMesh

ALL, LOWEST = "ALL", "LOWEST"
MAX_NAME = 80  # CalculiX and Abaqus allow 80 characters

_DOWN: dict[str, FloatArray] = {sign + name: (1.0 if sign == "+" else -1.0) * np.eye(3)[axis] for sign in "+-" for axis, name in enumerate("xyz")}
_FLAT = 1 - 1e-6  # a face is plane where its area vector is this share of its area
_STEEP_DEG = 10.0  # a plane face still carries while it is tilted by less than this
_LEAST_AREA = 0.01  # of the area seen from below: less does not carry but only touches


def down_axis(options: FeaOptions) -> FloatArray:
    """(3,) unit vector of the self weight. Raises UsageError."""
    require(options.down in _DOWN, UsageError, f"fea.down is {options.down!r}: use one of {', '.join(_DOWN)}")
    return np.array(_DOWN[options.down])


def set_name(name: str) -> str:
    """A name that every solver takes: upper case, letters, digits and underscores, a letter first, at most 80 characters."""
    clean = re.sub(r"[^A-Z0-9_]+", "_", name.upper()).strip("_") or "FACE"
    return (clean if clean[0].isalpha() else f"F_{clean}")[:MAX_NAME]


def face_sets(mesh: TetMesh) -> tuple[tuple[str, ...], IntArray]:
    """(names, number of the name of each boundary triangle (k,)).

    Single facets of a free form are taken together as FACETS: a deck with one set per triangle helps nobody. Names that become equal
    by `set_name`, or that are taken by ALL, LOWEST or BODY, get a number.
    """
    names: list[str] = []
    number: dict[str, int] = {}
    target = np.zeros(len(mesh.face_names), np.int64)
    for tag in np.unique(mesh.face_tag):
        raw = mesh.face_names[tag]
        name = "FACETS" if "FACET" in raw.upper() else set_name(raw)
        if name != "FACETS" or name not in number:
            base, count = name, 1
            while name in number or name in (ALL, LOWEST, "BODY"):
                count += 1
                name = f"{base[: MAX_NAME - 6]}_{count}"
            number[name] = len(names)
            names.append(name)
        target[tag] = number[name]
    return tuple(names), target[mesh.face_tag]


def _triangles(mesh: TetMesh) -> tuple[FloatArray, FloatArray]:
    """(corners (k, 3, 3), area vectors (k, 3), outward)."""
    p = mesh.nodes[mesh.boundary[:, :3]]
    return p, np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) / 2


def _lowest_faces(mesh: TetMesh, down: FloatArray, band: float) -> BoolArray:
    """(k,) triangles of the plane CAD faces that look down and reach into the lowest `band` of the height; none where too small."""
    corners, area = _triangles(mesh)
    depth = (corners @ down).max(axis=1)
    n = len(mesh.face_names)
    vector = np.stack([np.bincount(mesh.face_tag, area[:, c], n) for c in range(3)], axis=1)
    size = np.bincount(mesh.face_tag, np.linalg.norm(area, axis=1), n)
    deepest = np.full(n, -np.inf)
    np.maximum.at(deepest, mesh.face_tag, depth)
    height = np.ptp(mesh.nodes @ down)
    plane = np.linalg.norm(vector, axis=1) > _FLAT * size
    facing = vector @ down > np.cos(np.radians(_STEEP_DEG)) * size
    low = deepest >= (mesh.nodes @ down).max() - band * height
    chosen = (plane & facing & low & (size > 0))[mesh.face_tag]
    enough = (area[chosen] @ down).sum() >= _LEAST_AREA * _footprint(area, down)
    return np.asarray(chosen & enough)


def _footprint(area: FloatArray, down: FloatArray) -> float:
    """Area of what looks down, projected along `down`, m2."""
    return float(np.maximum(area @ down, 0.0).sum())


def _lowest_band(mesh: TetMesh, down: FloatArray, band: float) -> BoolArray:
    """(k,) triangles within the lowest `band` of the height, widened until they carry: 3 nodes not on a line, and area."""
    corners, area = _triangles(mesh)
    depth = corners @ down
    lowest, height = float((mesh.nodes @ down).max()), float(np.ptp(mesh.nodes @ down))
    while band < 1.0:
        chosen = np.asarray((depth >= lowest - band * height).all(axis=1))
        if chosen.any():
            p = corners[chosen].reshape(-1, 3)
            spread = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
            carries = spread[1] > 1e-3 * spread[0] and np.linalg.norm(area[chosen], axis=1).sum() >= _LEAST_AREA * _footprint(area, down)
            if carries:
                return chosen
        band *= 1.5
    raise SolveError("no part of the surface near its lowest point can carry the part: check that the mesh is closed and faces outward")


def build_model(tets: TetMesh, options: FeaOptions = FeaOptions()) -> FEModel:
    """The model of a part that stands on its lowest face under its own weight.

    Node sets: one per CAD face (upper case), ALL, and LOWEST: the plane CAD faces that look down (within 10 degrees) and reach into
    the lowest `support_band` of the height, or the surface within that band where there is no such face. LOWEST is held in x, y and z.
    Raises UsageError (material, axis) and SolveError (empty mesh, too many degrees of freedom, nothing that carries).
    """
    require(len(tets.tets), SolveError, "the mesh holds no tetrahedra")
    n_dof = 3 * len(tets.nodes)
    require(
        n_dof <= options.max_dof,
        SolveError,
        f"{n_dof} degrees of freedom are above fea.max_dof = {options.max_dof}: mesh coarser or raise the limit",
    )
    down = down_axis(options)
    names, number = face_sets(tets)
    sets = {name: np.unique(tets.boundary[number == k]) for k, name in enumerate(names)}
    lowest = _lowest_faces(tets, down, options.support_band)
    if not lowest.any():
        lowest = _lowest_band(tets, down, options.support_band)
    sets[ALL] = np.arange(len(tets.nodes), dtype=np.int64)
    sets[LOWEST] = np.unique(tets.boundary[lowest])
    return FEModel(mesh=tets, material=chosen_material(options), node_sets=sets, support=LOWEST, acceleration_m_s2=options.gravity_m_s2 * down)
