"""Is a solid of true faces that of the surface and of its points? Volume, distances both ways, points left out, holes that go through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.cad.live import as_splines, is_valid, joined_triangles, parts, tessellated, without_triangles
from scan2fea.cad.readback import volume_of
from scan2fea.kernel.coverage import STRAY_SPACINGS, is_unmeasured, largest_left_out
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.measures import volume as enclosed_volume
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.topology import surface_topology
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh
from scan2fea.units import MILLIMETRES_PER_METRE

FIT_POINTS = 60_000
LEFT_OUT = "a small face or step was lost"
LEAST_LOST = 6  # points: fewer lie side by side by chance
VOLUME_OFF = 0.03  # of the volume of the surface: reconstructions of thin walls are a little too thick or thin
BESIDE = 0.01  # of the points may lie to one side of their face: 0.24 % do at most where it is the right one
NEAR, ONE_FACE, BENT_SPACINGS = 18, 0.8, 0.1  # points; cosine; of the spacing
TO_SIGMA = 1.4826  # of the median distance, for normal noise
CHORD = 0.1  # of the tolerance: how closely the solid is cut into triangles to be compared


@dataclass(frozen=True, kw_only=True)
class Scale:
    """spacing_m of the points.   noise_m : left in the vertices."""

    spacing_m: float
    noise_m: float
    size_m: float

    @property
    def tolerance_m(self) -> float:
        """Three standard deviations, and what remeshing moves vertices along a curved surface."""
        return 3.0 * self.noise_m + 0.02 * self.spacing_m + 1e-6 * self.size_m

    @property
    def reach_m(self) -> float:
        """How far the rounding of a crease may lie from its surfaces."""
        return 1.5 * self.spacing_m + 9.0 * self.noise_m + 1e-6 * self.size_m

    @property
    def stray_m(self) -> float:
        """Farther from the solid than this lies no place that is on it: its noise, and what a surface cuts off between points."""
        return self.tolerance_m + STRAY_SPACINGS * self.spacing_m


@dataclass(frozen=True, kw_only=True)
class Compared:
    """problem : the first way in which the solid is not that of the surface, "" where there is none.

    holes : that go through the solid, and through the surface; these differ only where nobody measured what the surface has.
    """

    problem: str
    holes: tuple[int, int] = (0, 0)


def compared(solid: Any, mesh: TriangleMesh, points: FloatArray, middle: FloatArray, scale: Scale, within_m: float = 0.0) -> Compared:
    """The solid (millimetres around `middle`) against the surface and the measured points, metres.

    Where another number of holes goes through them, one of the two invents: a hole that nobody saw the wall of, or a skin over one. The surface
    does where it runs off the solid and not a point lies there: each true face has its points, and the surface has a face more. Else it stands.
    within_m : see `triangles_of`.
    """
    from OCP.TopAbs import TopAbs_SOLID

    if len(parts(solid, TopAbs_SOLID)) != 1 or not is_valid(solid):
        return Compared(problem="the faces close no valid solid")
    volume, wanted = volume_of(solid) / MILLIMETRES_PER_METRE**3, enclosed_volume(mesh)
    if abs(volume / wanted - 1) > VOLUME_OFF:
        return Compared(problem=f"the solid of true faces holds {volume / wanted - 1:+.1%} of the volume of the surface more")
    shown, _ = triangles_of(solid, middle, scale.tolerance_m, within_m)
    if not _closes(shown):  # no tets come of it
        return Compared(problem="the triangles of the true faces do not close")
    holes = surface_topology(shown).n_handles, surface_topology(mesh).n_handles
    off: FloatArray = PointToMesh(shown).nearest(mesh.vertices).distance
    if holes[0] != holes[1]:
        invented = _invented(mesh, points, np.asarray(off > scale.stray_m))
        if not invented.any():
            return Compared(problem=f"{holes[0]} holes go through the solid of true faces, {holes[1]} through the surface")
        off = off[~invented]
    back = PointToMesh(mesh).nearest(shown.vertices[np.unique(shown.faces)]).distance
    limit = 2 * scale.reach_m + 2 * scale.tolerance_m
    if np.percentile(off, 95) > 2 * scale.tolerance_m + 0.2 * scale.spacing_m or off.max() > limit or back.max() > 2 * limit:
        said = f"95 % of it within {np.percentile(off, 95) * 1e3:.3g} mm, at most {off.max() * 1e3:.3g} mm, corners {back.max() * 1e3:.3g} mm"
        return Compared(problem=f"the true faces lie off the surface: {said}")
    lost = points_lost(shown, mesh, points, scale)
    if lost:
        return Compared(problem=f"{lost} points side by side lie on the surface and off the true faces: {LEFT_OUT}")
    astray = beside_faces(shown, mesh, points, scale)
    if astray > BESIDE:
        return Compared(problem=f"{astray:.1%} of the points lie to one side of the true faces by more than their noise (limit {BESIDE:.0%})")
    return Compared(problem="", holes=holes)


def _invented(mesh: TriangleMesh, points: FloatArray, is_off: BoolArray) -> BoolArray:
    """(n,) vertices of the faces that run off the solid, where next to no point lies on these; none where points do, or none need lie there."""
    faces = np.asarray(is_off[mesh.faces].all(axis=1), bool)
    used = points[sampled_rows(len(points), FIT_POINTS, 0)]
    areas, own = face_areas(mesh), faces[PointToMesh(mesh).nearest(used).face]
    out = np.zeros(len(mesh.vertices), bool)
    if is_unmeasured(float(areas[faces].sum()), int(own.sum()), len(used) / float(areas.sum())):
        out[mesh.faces[faces]] = True
    return out


def points_lost(shown: TriangleMesh, mesh: TriangleMesh, points: FloatArray, scale: Scale) -> int:
    """How many points the largest part of the surface holds that the solid does not follow; 0 below what a face needs to be told from roundings.

    A point is off where it lies farther from the solid than from the surface by more than half a spacing and what surfaces may differ by. A face is
    told from two rounded creases beside each other where it is wider than both: as many points as lie on a square of that side, 9 without noise.
    """
    used = points[sampled_rows(len(points), FIT_POINTS, 0)]
    spacing = scale.spacing_m * (len(points) / len(used)) ** 0.5
    least = max(LEAST_LOST, round((2.0 * scale.reach_m / spacing) ** 2))
    lost = len(largest_left_out(used, PointToMesh(shown).nearest(used).distance, mesh, scale.stray_m, 2.0 * spacing))
    return lost if lost >= least else 0


def beside_faces(shown: TriangleMesh, mesh: TriangleMesh, points: FloatArray, scale: Scale) -> float:
    """Share of the points about which the mean of NEAR lies off the solid by more than the noise of one, and BENT_SPACINGS: a wavy face drawn flat.

    The noise is that about the surface, or of its vertices where these are the points. Asked away from creases, where every point near lies on a
    face that looks the same way, or the other way: the other side of a wall.
    """
    used = points[sampled_rows(len(points), FIT_POINTS, 0)]
    nearest = PointToMesh(shown).nearest(used)
    normals = face_normals(shown)[nearest.face]
    height = np.einsum("ij,ij->i", used - nearest.closest, normals)
    near = k_nearest(used, NEAR)[1]
    cosine = np.einsum("ij,ikj->ik", normals, normals[near])
    own = cosine > ONE_FACE
    mean = np.where(own, height[near], 0.0).sum(axis=1) / np.maximum(own.sum(axis=1), 1)
    is_asked = (own.sum(axis=1) >= LEAST_LOST) & (np.abs(cosine) > ONE_FACE).all(axis=1)
    sigma = max(scale.noise_m, TO_SIGMA * float(np.median(PointToMesh(mesh).nearest(used).distance)))
    spacing = scale.spacing_m * (len(points) / len(used)) ** 0.5
    return float(np.mean(is_asked & (np.abs(mean) > sigma + BENT_SPACINGS * spacing)))


def triangles_of(solid: Any, middle: FloatArray, tolerance_m: float, within_m: float = 0.0) -> tuple[TriangleMesh, IntArray]:
    """The solid's triangles in metres where they are, and the face of each. within_m : points so near to each other are one.

    Open Cascade leaves a cone without triangles in one of four positions, and a tip between two edges that nearly touch (a cylinder and a plane
    0.03 mm apart: a crack, and a hole fewer by Euler's count): then other chords are tried, and B-splines.
    """
    chord, within = max(CHORD * tolerance_m * MILLIMETRES_PER_METRE, 1e-3), within_m * MILLIMETRES_PER_METRE
    tessellated(solid, chord)
    first = mesh, face = joined_triangles(faces_of(solid), within)
    if not _is_whole(mesh, face, solid):
        splines = as_splines(solid)
        for shape, factor in ((solid, 2.0), (solid, 0.5), (splines, 1.0)):
            tessellated(without_triangles(shape), factor * chord)
            mesh, face = joined_triangles(faces_of(shape), within)
            if _is_whole(mesh, face, solid):
                break
        else:
            mesh, face = (mesh, face) if _is_missing(first[1], solid) else first
    return TriangleMesh(vertices=mesh.vertices / MILLIMETRES_PER_METRE + middle, faces=mesh.faces, face_region=face), face


def _is_whole(mesh: TriangleMesh, face: IntArray, solid: Any) -> bool:
    return not _is_missing(face, solid) and _closes(mesh)


def _closes(mesh: TriangleMesh) -> bool:
    found = surface_topology(mesh)
    return found.is_closed and found.is_manifold


def _is_missing(face: IntArray, solid: Any) -> bool:
    return len(np.unique(face)) < len(faces_of(solid))


def faces_of(solid: Any) -> list[Any]:
    from OCP.TopAbs import TopAbs_FACE

    return parts(solid, TopAbs_FACE)
