"""Thin triangles are taken out where the shape lets them, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from predicates import box, sphere
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import extent, face_areas, volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.quality import triangle_angles
from scan2fea.kernel.topology import surface_topology
from scan2fea.remeshing.thin import THIN_DEG, without_thin
from scan2fea.types import TriangleMesh


def least_deg(mesh: TriangleMesh) -> float:
    return float(np.degrees(triangle_angles(mesh.vertices, mesh.faces)).min())


def with_cap(mesh: TriangleMesh, face: int, share: float) -> TriangleMesh:
    """A vertex put into a face, `share` of the way from the middle of one of its sides to the far corner: a cap at that side."""
    a, b, c = mesh.faces[face]
    new = len(mesh.vertices)
    place = (1 - share) * (mesh.vertices[a] + mesh.vertices[b]) / 2 + share * mesh.vertices[c]
    faces = np.concatenate([np.delete(mesh.faces, face, axis=0), [[a, b, new], [b, c, new], [c, a, new]]])
    region = None if mesh.face_region is None else np.concatenate([np.delete(mesh.face_region, face), np.repeat(mesh.face_region[face], 3)])
    return replace(mesh, vertices=np.concatenate([mesh.vertices, [place]]), faces=faces, face_region=region)


def with_needle(mesh: TriangleMesh, edge: float) -> TriangleMesh:
    """A vertex put on the side of face 0 close to its end: two needles."""
    a, b, _ = mesh.faces[0]
    new = len(mesh.vertices)
    at = [k for k, f in enumerate(mesh.faces.tolist()) if a in f and b in f]
    faces = np.delete(mesh.faces, at, axis=0).tolist()
    for k in at:
        row = mesh.faces[k].tolist()
        faces += [[new if v == a else v for v in row], [new if v == b else v for v in row]]
    place = mesh.vertices[a] + edge * (mesh.vertices[b] - mesh.vertices[a])
    return TriangleMesh(vertices=np.concatenate([mesh.vertices, [place]]), faces=np.array(faces))


@pytest.mark.parametrize("spoilt", [lambda m: with_cap(m, 5, 0.02), lambda m: with_needle(m, 0.05)], ids=["cap", "needle"])
def test_a_cap_and_a_needle_go(spoilt):
    ball = sphere(rounds=2)
    given = spoilt(ball)
    assert least_deg(given) < 6
    before = given.vertices.copy(), given.faces.copy()
    give = 0.05 * float(np.linalg.norm(ball.vertices[ball.faces[0, 0]] - ball.vertices[ball.faces[0, 1]]))
    found = without_thin(given, give)
    assert least_deg(found) >= THIN_DEG
    assert surface_topology(found).is_clean and not len(self_intersections(found))
    assert abs(volume(found) / volume(given) - 1) < 5e-3
    assert PointToMesh(found).nearest(given.vertices).distance.max() <= give * (1 + 1e-9)
    assert (given.vertices == before[0]).all() and (given.faces == before[1]).all()


def test_nothing_moves_farther_than_it_may():
    """The needle's vertex is lifted off its edge by more than the surface may move: it stays."""
    given = with_needle(sphere(rounds=2), 0.05)
    lifted = given.vertices.copy()
    lifted[-1] *= 1.02
    given = replace(given, vertices=lifted)
    assert without_thin(given, 1e-6 * extent(lifted)) is given


def test_planes_stay_planes_and_edges_stay_edges():
    block = box()
    region = np.abs(np.cross(*(block.vertices[block.faces[:, k]] - block.vertices[block.faces[:, 0]] for k in (1, 2)))).argmax(axis=1)
    side = block.vertices[block.faces].mean(axis=1)[np.arange(len(region)), region] > block.vertices.mean(axis=0)[region]
    given = with_cap(replace(block, face_region=2 * region + side), 0, 0.02)
    found = without_thin(given, 0.01 * extent(block.vertices))
    assert least_deg(found) >= THIN_DEG > least_deg(given)
    assert volume(found) == pytest.approx(volume(block), rel=1e-12)
    assert found.face_region is not None and given.face_region is not None
    for k in np.unique(given.face_region):
        areas = [face_areas(m)[m.face_region == k].sum() for m in (found, given)]
        assert areas[0] == pytest.approx(areas[1], rel=1e-12)


def test_without_thin_faces_and_with_crossings_it_is_as_it_was():
    ball = sphere(rounds=2)
    assert without_thin(ball, 1.0) is ball
    pair = np.concatenate([ball.faces, ball.faces + len(ball.vertices)])
    crossing = TriangleMesh(vertices=np.concatenate([ball.vertices, ball.vertices + [1.0, 0, 0]]), faces=pair)
    assert without_thin(crossing, 1.0) is crossing


def test_scale_and_place_do_not_matter():
    given = with_cap(sphere(rounds=2), 5, 0.02)
    here = without_thin(given, 0.02)
    there = without_thin(replace(given, vertices=0.25 * given.vertices + [3.0, 0, -7.0]), 0.005)
    assert (here.faces == there.faces).all()
    assert np.allclose(0.25 * here.vertices + [3.0, 0, -7.0], there.vertices, atol=1e-12)
