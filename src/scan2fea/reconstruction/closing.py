"""Triangles of any mesher through the points made the boundary of a solid.

A triangle with an empty ball through its corners is a facet of the Delaunay tets of the points: what the advancing front takes by construction, what
the pivoting ball takes by its emptiness. So every triangle can vote: the tet on the side its corners' normals point to is outside, the other one
inside. The minimum cut between the votes takes the triangles where they agree, and between them, over holes and rims, the cheapest facets. The
surface is closed, a manifold and free of crossings for every input; what it took and what it added is told.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.kernel.delaunay import FACETS, Tetrahedralisation, tetrahedralise
from scan2fea.kernel.topology import edge_table, face_components
from scan2fea.reconstruction.carve import gaps
from scan2fea.reconstruction.cut import Votes, cut
from scan2fea.reconstruction.gates import Evidence, gates_again
from scan2fea.reconstruction.singular import Resolved, boundary, resolve
from scan2fea.reconstruction.visibility import Reconstruction, VisibilityOptions, one_part, visibility
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, Scan, TriangleMesh, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Pieces(Value):
    """Triangles that are facets of the tets.

    faces : (k, 3) into the points.   tet, facet : (k,) where they are.   part : (k,) number of the piece each belongs to.
    """

    faces: IntArray
    tet: IntArray
    facet: IntArray
    part: IntArray

    _ROWS = (("faces", "tet", "facet", "part"),)

    @classmethod
    def of(cls, faces: IntArray, where: IntArray) -> Pieces:
        """where : (k, 2) tet and facet of each triangle."""
        return cls(faces=faces, tet=where[:, 0], facet=where[:, 1], part=face_components(faces)[1])

    @property
    def n_parts(self) -> int:
        return len(np.unique(self.part))

    @property
    def n_open_edges(self) -> int:
        """Edges that only one triangle has: what a mesher leaves open."""
        return int((edge_table(self.faces).count == 1).sum())


@dataclass(frozen=True, eq=False, kw_only=True)
class Closed(Value):
    """mesh : closed, manifold, outward.   kept : (k,) the triangles of the mesher that are in it.   resolved : parts dropped, voids filled."""

    mesh: TriangleMesh
    kept: BoolArray
    resolved: Resolved


def closed(tetra: Tetrahedralisation, pieces: Pieces, normals: FloatArray, spacing_m: float, quality_weight: float = 0.3) -> Closed:
    """The surface of the solid that the pieces lie on.

    normals : (n, 3) outward, of the points.   quality_weight : price of a facet of cost 1 against the vote of one triangle.
    Raises ReconstructionError where nothing is inside.
    """
    t, facet = pieces.tet, pieces.facet
    other = tetra.neighbors[t, facet]
    a, b, c = (tetra.points[tetra.tets[t, FACETS[facet, k]]] for k in range(3))
    out = np.cross(b - a, c - a)  # away from t
    out /= np.maximum(np.linalg.norm(out, axis=1), np.finfo(float).tiny)[:, None]
    toward = np.einsum("ij,ij->i", normals[pieces.faces].mean(axis=1), out)  # corners that face apart take each other's vote away
    inner, outer = np.where(toward > 0, t, other), np.where(toward > 0, other, t)
    source, sink = np.zeros(len(tetra)), np.zeros(len(tetra))
    np.add.at(sink, inner, np.abs(toward))
    np.add.at(source, outer, np.abs(toward))
    sink[tetra.is_box] = 0.0
    votes = Votes(capacity=np.zeros((len(tetra), 4)), source=source, sink=sink)
    labels = cut(tetra, votes, spacing_m, None, quality_weight)
    resolved = resolve(tetra, labels.inside, votes.capacity, source, sink, spacing_m)
    mesh, _ = boundary(tetra, resolved.inside)
    return Closed(mesh=mesh, kept=resolved.inside[inner] & ~resolved.inside[outer], resolved=resolved)


def closed_reconstruction(
    scan: Scan, options: VisibilityOptions, method: str, mesher: Callable[[Tetrahedralisation, FloatArray, float], Pieces]
) -> Reconstruction:
    """The surface that `mesher` finds through the denoised points, closed. It is given their tets, outward normals and spacing.

    Points, normals and the outside are those of `visibility`, and so are the checks that rest on them.
    Raises ReconstructionError.
    """
    first = visibility(scan, options)
    tetra = tetrahedralise(first.points, first.spacing_m, options.seed)
    pieces = mesher(tetra, first.normals, first.spacing_m)
    found = closed(tetra, pieces, first.normals, first.spacing_m, options.quality_weight)
    checks = checks_of(scan, first, found.mesh, found.resolved.n_parts)
    how: dict[str, float | str] = {
        **{key: value for key, value in first.how.items() if key in KEPT},
        "method": method,
        "n_triangles": len(pieces.faces),
        "n_pieces": pieces.n_parts,
        "n_open_edges_before": pieces.n_open_edges,
        "share_kept": float(found.kept.mean()) if len(found.kept) else 0.0,
        "n_faces_added": len(found.mesh.faces) - int(found.kept.sum()),
        "n_parts_dropped": found.resolved.n_dropped,
        "n_voids_filled": found.resolved.n_filled,
    }
    return replace(first, mesh=found.mesh, checks=checks, how=how)


def checks_of(scan: Scan, first: Reconstruction, mesh: TriangleMesh, n_parts: int) -> tuple[Check, ...]:
    """The gates of another surface through the points of `first`, of so many parts."""
    evidence = Evidence(
        points=scan.cloud.points,
        mesh=mesh,
        smoothed=first.points,
        normals=first.normals,
        thickness_m=first.thickness_m,
        gap_m=gaps(first.points, first.normals, first.spacing_m),
        spacing_m=first.spacing_m,
        sigma_m=first.sigma_m,
        is_inferred=scan.cloud.is_inferred,
        sensors=scan.sensors() if first.source == "sensors" else None,
    )
    before = tuple(check for check in first.checks if check.name != "parts")
    return (*gates_again(evidence, before, first.source == "sensors"), one_part(n_parts))


KEPT = ("source", "spacing_m", "sigma_m", "residual_m", "fit_radius_m", "wall_m", "wall_share", "rays_blocked", "ball_m", "leak_share", "n_images")
