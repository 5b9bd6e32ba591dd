"""From a mesh to a finite element model: named node sets, what holds it, what loads it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from scan2fea.errors import SolveError, UsageError, require
from scan2fea.fea.loads import cases_of, parse_loads, parse_supports, supports_of, surface_forces
from scan2fea.fea.materials import chosen_material
from scan2fea.fea.options import FeaOptions
from scan2fea.types import BoolArray, FEModel, FloatArray, IntArray, LoadCase, TetMesh

ALL, LOWEST = "ALL", "LOWEST"
MAX_NAME = 80  # CalculiX and Abaqus allow 80 characters

_DOWN: dict[str, FloatArray] = {sign + name: (1.0 if sign == "+" else -1.0) * np.eye(3)[axis] for sign in "+-" for axis, name in enumerate("xyz")}
_FLAT = 1 - 1e-6  # a face is plane where its area vector is this share of its area
_STEEP_DEG = 10.0  # a plane face still carries while it is tilted by less than this
_WIDEST = 0.3  # of the height: a wider band holds too much of the part to say that it stands on it
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


def _lowest_band(mesh: TetMesh, down: FloatArray, band: float) -> tuple[BoolArray, IntArray]:
    """((k,) triangles within the lowest `band` of the height, their nodes); the band is widened until it carries: 3 nodes not on a line, and area.

    Triangles of a member may run its whole length: none of these lies within a band of less than all of it. Then the nodes of the surface within the
    band are held, of whatever triangles, and no triangle is LOWEST.
    """
    corners, area = _triangles(mesh)
    depth = corners @ down
    lowest, height = float((mesh.nodes @ down).max()), float(np.ptp(mesh.nodes @ down))
    for width in _bands(band, _WIDEST):
        chosen = np.asarray((depth >= lowest - width * height).all(axis=1))
        enough = np.linalg.norm(area[chosen], axis=1).sum() >= _LEAST_AREA * _footprint(area, down)
        if enough and _spans_a_plane(corners[chosen].reshape(-1, 3)):
            return chosen, np.unique(mesh.boundary[chosen])
    rim = np.unique(mesh.boundary)
    for width in _bands(band, 1.0):
        nodes = rim[mesh.nodes[rim] @ down >= lowest - width * height]
        if _spans_a_plane(mesh.nodes[nodes]):
            return np.zeros(len(corners), bool), nodes
    raise SolveError("no part of the surface near its lowest point can carry the part: check that the mesh is closed and faces outward")


def _bands(first: float, last: float) -> Iterator[float]:
    while first <= last:
        yield first
        first *= 1.5


def _spans_a_plane(points: FloatArray) -> bool:
    """Are there three that are not on a line?"""
    if len(points) < 3:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 1e-3 * spread[0])


def check_options(options: FeaOptions) -> None:
    """Raises UsageError for a material, axis, support or load that no model could have, before anything is read."""
    chosen_material(options)
    down_axis(options)
    parse_supports(options.supports)
    parse_loads(options.loads)


def build_model(tets: TetMesh, options: FeaOptions = FeaOptions(), number: int | None = None) -> FEModel:
    """The model of a part under its own weight and the loads of the options, on the supports of the options or on its lowest face.

    Node sets: one per CAD face (upper case), ALL, and LOWEST: the plane CAD faces that look down (within 10 degrees) and reach into
    the lowest `support_band` of the height, or the surface within that band where there is no such face. LOWEST is held in x, y and z where the
    options name no other set. number : of the object, for lines of the options that are meant for one. A case that names a set which is not there
    fails alone (`failed`). Raises UsageError (material, axis, lines) and SolveError (empty mesh, too many unknowns, nothing that carries).
    """
    require(len(tets.tets), SolveError, "the mesh holds no tetrahedra")
    n_dof = 3 * len(tets.nodes)
    require(
        n_dof <= options.max_dof,
        SolveError,
        f"{n_dof} degrees of freedom are above fea.max_dof = {options.max_dof}: mesh coarser or raise the limit",
    )
    down = down_axis(options)
    names, number_of = face_sets(tets)
    sets = {name: np.unique(tets.boundary[number_of == k]) for k, name in enumerate(names)}
    lowest = _lowest_faces(tets, down, options.support_band)
    stands = np.unique(tets.boundary[lowest])
    if not len(stands):
        lowest, stands = _lowest_band(tets, down, options.support_band)
    sets[ALL] = np.arange(len(tets.nodes), dtype=np.int64)
    sets[LOWEST] = stands
    surfaces = {name: np.flatnonzero(number_of == k) for k, name in enumerate(names)}
    surfaces[LOWEST] = np.flatnonzero(lowest)
    asked, wanted = parse_supports(options.supports), parse_loads(options.loads)
    cases, failed = cases_of(wanted, number, tuple(sets))
    supports = {LOWEST: "xyz"}
    try:
        supports = supports_of(asked or (), number, tuple(surfaces)) or supports
    except SolveError as error:
        said = f"{error}; {LOWEST} is held instead"
        cases, failed = (), {**dict.fromkeys((line.case for line in wanted if line.number in (None, number)), said), **failed}
        failed = failed or {"supports": said}
    model = FEModel(
        mesh=tets,
        material=chosen_material(options),
        node_sets=sets,
        supports=supports,
        acceleration_m_s2=options.gravity_m_s2 * down,
        surfaces=surfaces,
        cases=cases,
        is_floating=asked is None,
        failed=failed,
    )
    none = {case.name: said for case in cases if (said := _acts_on_nothing(model, case))}
    return replace(model, cases=tuple(case for case in cases if case.name not in none), failed={**failed, **none})


def _acts_on_nothing(model: FEModel, case: LoadCase) -> str:
    """Why the loads of a case are none ("" where they are): a set of nodes alone has no faces. The decks hold the other cases."""
    try:
        surface_forces(model, case)
    except SolveError as error:
        return f"case {case.name}: {error}"
    return ""
