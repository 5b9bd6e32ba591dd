"""How well shaped triangles and tets are: the measures of thesis table 2.1, and those that solvers use.

Q1..Q5 of the table, R and r circum- and inradius, l edge lengths, A area, V volume:

    Q1 = lmin / R     Q2 = r / lmin     Q3 = r / R     Q4 = lmin / lmax     Q5 = A / lmax^2 (triangle), V / lmax^3 (tet)

Q2 as printed rewards needles (r / lmin tends to 0.5): the corrected one is r / lmax. `normalised` divides each by its value for the
equilateral triangle or the regular tet, so that 1 is best; Q2 there is the corrected one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.measures import tet_volumes
from scan2fea.types import FloatArray, IntArray, TriangleMesh

TET_EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])  # in the order of the mid nodes 4..9
TET_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])  # outward, across from corner 0..3


@dataclass(frozen=True, kw_only=True)
class Limit:
    """What a measure may be. best: of the regular element. warn, fail: the worst element must not pass these; None where not a criterion."""

    best: float
    worst: float
    warn: float | None
    fail: float | None
    source: str


_TABLE = "thesis table 2.1; no threshold is stated there"
TRIANGLE_LIMITS: Mapping[str, Limit] = {
    "Q1": Limit(best=3**0.5, worst=0, warn=None, fail=None, source=_TABLE),
    "Q2": Limit(best=3**0.5 / 6, worst=0, warn=None, fail=None, source=_TABLE + "; not a quality: the supremum 0.5 is a needle"),
    "Q2_corrected": Limit(best=3**0.5 / 6, worst=0, warn=None, fail=None, source="r / lmax"),
    "Q3": Limit(best=0.5, worst=0, warn=None, fail=None, source=_TABLE),
    "Q4": Limit(best=1, worst=0, warn=None, fail=None, source=_TABLE),
    "Q5": Limit(best=3**0.5 / 4, worst=0, warn=None, fail=None, source=_TABLE),
    "min_angle_deg": Limit(best=60, worst=0, warn=20, fail=5, source="the mesher keeps boundary triangles: a tet there is no better"),
    "edge_ratio": Limit(best=1, worst=float("inf"), warn=None, fail=None, source="lmax / lmin, 1 / Q4"),
    "radius_ratio": Limit(best=1, worst=0, warn=None, fail=None, source="2 r / R, Q3 over its best"),
}
_REGULAR_DEG = float(np.degrees(np.arccos(1 / 3)))
_OPTISTRUCT = "OptiStruct CTETRA warns outside 15..165"
TET_LIMITS: Mapping[str, Limit] = {
    "Q1": Limit(best=8 / 24**0.5, worst=0, warn=None, fail=None, source=_TABLE),
    "Q2": Limit(best=6**0.5 / 12, worst=0, warn=None, fail=None, source=_TABLE + "; not a quality: the supremum 0.5 is a needle"),
    "Q2_corrected": Limit(best=6**0.5 / 12, worst=0, warn=None, fail=None, source="r / lmax"),
    "Q3": Limit(best=1 / 3, worst=0, warn=None, fail=None, source=_TABLE),
    "Q4": Limit(best=1, worst=0, warn=None, fail=None, source=_TABLE),
    "Q5": Limit(best=2**0.5 / 12, worst=0, warn=None, fail=None, source=_TABLE),
    "min_dihedral_deg": Limit(best=_REGULAR_DEG, worst=0, warn=15, fail=5, source=_OPTISTRUCT),
    "max_dihedral_deg": Limit(best=_REGULAR_DEG, worst=180, warn=165, fail=175, source=_OPTISTRUCT),
    "scaled_jacobian": Limit(best=1, worst=-1, warn=0.1, fail=0, source="CalculiX stops on a Jacobian that is not positive"),
    "aspect": Limit(best=1, worst=float("inf"), warn=100, fail=1000, source="OptiStruct CTETRA"),
    "edge_ratio": Limit(best=1, worst=float("inf"), warn=None, fail=None, source="lmax / lmin, 1 / Q4"),
    "radius_ratio": Limit(best=1, worst=0, warn=None, fail=None, source="3 r / R, Q3 over its best"),
    "min_face_angle_deg": Limit(best=60, worst=0, warn=5, fail=None, source="Autodesk Nastran TETFACEMINIATOL"),
    "max_face_angle_deg": Limit(best=60, worst=180, warn=170, fail=None, source="Autodesk Nastran TETFACEMAXIATOL"),
    "collapse": Limit(best=(8 / 3) ** 0.5 / 3**0.25, worst=0, warn=0.001, fail=0, source="OptiStruct CTETRA: least height over root of the face"),
}
FALLING = frozenset({"aspect", "edge_ratio", "max_dihedral_deg", "max_face_angle_deg"})  # measures that grow as elements get worse


def summary(values: FloatArray) -> dict[str, float]:
    """{min, p01, median, p99, max}; nan for no values."""
    names = ("min", "p01", "median", "p99", "max")
    if not len(values):
        return dict.fromkeys(names, float("nan"))
    low, high = float(values.min()), float(values.max())
    inner = np.percentile(values, [1, 50, 99], method="linear" if np.isfinite(high) else "nearest")
    return dict(zip(names, (low, *(float(x) for x in inner), high), strict=True))


def worst_element(name: str, values: FloatArray) -> int:
    """The row of the worst element by measure `name`; -1 for no values."""
    if not len(values):
        return -1
    return int(values.argmax() if name in FALLING else values.argmin())


def _over(a: FloatArray, b: FloatArray) -> FloatArray:
    """a / b, 0 where b is 0."""
    return np.asarray(np.divide(a, b, out=np.zeros(np.broadcast(a, b).shape), where=b > 0))


def triangle_quality(vertices: FloatArray, faces: IntArray) -> dict[str, FloatArray]:
    """(m,) arrays by name: Q1, Q2 (as printed), Q2_corrected, Q3, Q4, Q5, min_angle_deg, edge_ratio (lmax / lmin), radius_ratio (2 r / R).

    A face without area has 0 in all but Q4 and edge_ratio.
    """
    tri = vertices[faces]
    lengths = np.linalg.norm(tri - np.roll(tri, -1, axis=1), axis=2)
    low, high = lengths.min(1), lengths.max(1)
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1) / 2
    inradius = _over(2 * area, lengths.sum(1))
    over_circumradius = _over(4 * area, lengths.prod(1))  # 1 / R; 0 where R is infinite
    return {
        "Q1": low * over_circumradius,
        "Q2": _over(inradius, low),
        "Q2_corrected": _over(inradius, high),
        "Q3": inradius * over_circumradius,
        "Q4": _over(low, high),
        "Q5": _over(area, high**2),
        "min_angle_deg": np.degrees(triangle_angles(vertices, faces).min(1)) if len(faces) else np.zeros(0),
        "edge_ratio": np.divide(high, low, out=np.full(len(faces), np.inf), where=low > 0),
        "radius_ratio": 2 * inradius * over_circumradius,
    }


def triangle_angles(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m, 3) angles at the corners, radians."""
    tri = vertices[faces]
    out = np.zeros((len(faces), 3))
    for k in range(3):
        u, v = tri[:, (k + 1) % 3] - tri[:, k], tri[:, (k + 2) % 3] - tri[:, k]
        out[:, k] = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(1))
    return out


def _circumradius(p: FloatArray, six_volumes: FloatArray) -> FloatArray:
    """R of (m, 4, 3) tets: |a^2 (b x c) + b^2 (c x a) + c^2 (a x b)| / (12 V), edges a, b, c from corner 0; inf where V is 0."""
    a, b, c = (p[:, k] - p[:, 0] for k in (1, 2, 3))
    top = (a**2).sum(1)[:, None] * np.cross(b, c) + (b**2).sum(1)[:, None] * np.cross(c, a) + (c**2).sum(1)[:, None] * np.cross(a, b)
    return np.asarray(np.divide(np.linalg.norm(top, axis=1), 2 * six_volumes, out=np.full(len(p), np.inf), where=six_volumes > 0))


def tet_dihedrals(nodes: FloatArray, tets: IntArray) -> FloatArray:
    """(m, 6) angles between the flat faces of the corner tets, degrees, over the edges 23, 13, 12, 03, 02, 01 (faces named by the corner across)."""
    p = nodes[tets[:, :4]]
    tri = p[:, TET_FACES]
    normal = np.cross(tri[:, :, 1] - tri[:, :, 0], tri[:, :, 2] - tri[:, :, 0])
    normal = normal / np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-300)
    pairs = [(i, j) for i in range(4) for j in range(i + 1, 4)]
    cosine = np.stack([-np.einsum("ij,ij->i", normal[:, i], normal[:, j]) for i, j in pairs], axis=1)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _jacobians(nodes: FloatArray, tets: IntArray) -> FloatArray:
    """(m, q) determinants of the map from the reference tet: one for TET4; at corners, mid nodes and the four Gauss points for TET10."""
    if tets.shape[1] == 4:
        return 6 * tet_volumes(nodes, tets)[:, None]
    near, far = (5 + 3 * 5**0.5) / 20, (5 - 5**0.5) / 20  # Gauss rule of degree 2
    at = np.concatenate([np.eye(4), np.eye(4)[TET_EDGES].mean(1), np.full((4, 4), far) + (near - far) * np.eye(4)])
    p = nodes[tets]
    out = np.zeros((len(tets), len(at)))
    for q, weight in enumerate(at):
        slope = np.zeros((10, 4))  # dN / dL of N_i = L_i (2 L_i - 1) and N_ij = 4 L_i L_j
        slope[range(4), range(4)] = 4 * weight - 1
        for row, (i, j) in enumerate(TET_EDGES, start=4):
            slope[row, i], slope[row, j] = 4 * weight[j], 4 * weight[i]
        columns = np.einsum("mnk,nl->mkl", p, slope[:, 1:] - slope[:, :1])  # L_0 = 1 - the others
        out[:, q] = np.einsum("mk,mk->m", np.cross(columns[:, :, 0], columns[:, :, 1]), columns[:, :, 2])
    return out


def scaled_jacobian(nodes: FloatArray, tets: IntArray) -> FloatArray:
    """(m,) sqrt(2) times the least Jacobian over the largest product of the three edges at a corner (Verdict); 1 for the regular tet.

    TET10: least over corners, mid nodes and Gauss points; the edges are those of the corner tet, so a straight TET10 equals its TET4.
    """
    p = nodes[tets[:, :4]]
    others = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]
    product = np.stack([np.linalg.norm(p[:, others[k]] - p[:, k : k + 1], axis=2).prod(1) for k in range(4)], axis=1).max(1)
    least = _jacobians(nodes, tets).min(1)
    return np.asarray(np.divide(2**0.5 * least, product, out=np.full(len(p), -1.0), where=product > 0))


def tet_quality(nodes: FloatArray, tets: IntArray) -> dict[str, FloatArray]:
    """(m,) arrays by name: Q1..Q5, Q2_corrected, min_dihedral_deg, max_dihedral_deg, scaled_jacobian, aspect, edge_ratio, radius_ratio,
    min_face_angle_deg, max_face_angle_deg, collapse.

    aspect: lmax over the least height, 1 is best; edge_ratio: lmax / lmin; radius_ratio: 3 r / R; collapse: least height over the root of its face.

    TET10 counts with its corners, but for scaled_jacobian. Flat and inverted tets have Q = 0.
    """
    p = nodes[tets[:, :4]]
    lengths = np.linalg.norm(p[:, TET_EDGES[:, 0]] - p[:, TET_EDGES[:, 1]], axis=2)
    low, high = lengths.min(1), lengths.max(1)
    vol = np.maximum(tet_volumes(nodes, tets), 0)
    tri = p[:, TET_FACES]
    areas = np.linalg.norm(np.cross(tri[:, :, 1] - tri[:, :, 0], tri[:, :, 2] - tri[:, :, 0]), axis=2) / 2
    inradius = _over(3 * vol, areas.sum(1))
    over_circumradius = 1 / np.maximum(_circumradius(p, 6 * vol), 1e-300)
    height = _over(3 * vol, areas.max(1))
    dihedral = tet_dihedrals(nodes, tets)
    aspect = np.divide(high, height, out=np.full(len(p), np.inf), where=height > 0) * (2 / 3) ** 0.5
    corner = np.degrees(triangle_angles(nodes, tets[:, :4][:, TET_FACES].reshape(-1, 3))).reshape(len(p), -1)
    return {
        "Q1": low * over_circumradius,
        "Q2": _over(inradius, low),
        "Q2_corrected": _over(inradius, high),
        "Q3": inradius * over_circumradius,
        "Q4": _over(low, high),
        "Q5": _over(vol, high**3),
        "min_dihedral_deg": dihedral.min(1),
        "max_dihedral_deg": dihedral.max(1),
        "scaled_jacobian": scaled_jacobian(nodes, tets),
        "aspect": aspect,
        "edge_ratio": np.divide(high, low, out=np.full(len(p), np.inf), where=low > 0),
        "radius_ratio": 3 * inradius * over_circumradius,
        "min_face_angle_deg": corner.min(1, initial=180.0),
        "max_face_angle_deg": corner.max(1, initial=0.0),
        "collapse": _over(3 * vol[:, None], areas**1.5).min(1, initial=np.inf),
    }


def normalised(values: FloatArray, limit: Limit) -> FloatArray:
    """Values over that of the regular element: 1 is best."""
    return values / limit.best


def surface_quality(mesh: TriangleMesh) -> dict[str, dict[str, float]]:
    """Summary of every triangle measure over a mesh, for the report."""
    return {name: summary(values) for name, values in triangle_quality(mesh.vertices, mesh.faces).items()}
