"""Planar regions: the grouping that CAD faces and boundary names come from."""

import numpy as np
import pytest

from predicates import box, l_beam, moved, rotation, sphere, subdivided
from scan2fea.errors import RepairError
from scan2fea.kernel.measures import extent
from scan2fea.kernel.planar_regions import PLANAR_TOLERANCE, edge_pairs, planar_regions
from scan2fea.types import TriangleMesh


def with_regions(mesh, region):
    return TriangleMesh(vertices=mesh.vertices, faces=mesh.faces, face_region=np.asarray(region, np.int64))


def by_plane(mesh):
    """Partition by brute force: triangles of equal normal and offset, exact coordinates."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    n /= np.linalg.norm(n, axis=1)[:, None]
    key = np.round(np.column_stack([n, (n * a).sum(1)]), 6)
    return np.unique(key, axis=0, return_inverse=True)[1].ravel()


def same_partition(a, b):
    pairs = np.unique(np.column_stack([a, b]), axis=0)
    return len(pairs) == len(np.unique(a)) == len(np.unique(b))


@pytest.mark.parametrize("solid", [box(pitch=0.25), l_beam(pitch=0.05), l_beam()])
def test_equals_brute_force(solid):
    found = planar_regions(solid)
    assert (found.label >= 0).all()
    assert same_partition(found.label, by_plane(solid))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 30.0])
def test_rigid_motion_scale_and_float32(scale):
    solid = moved(l_beam(pitch=0.05), rotation(1), np.array([1000.0, -500.0, 20.0]))
    solid = TriangleMesh(vertices=solid.vertices * scale, faces=solid.faces)
    assert len(planar_regions(solid).ids) == 8
    rounded = moved(l_beam(pitch=0.05), rotation(2), np.zeros(3))
    rounded = TriangleMesh(vertices=rounded.vertices.astype(np.float32).astype(float), faces=rounded.faces)
    assert len(planar_regions(rounded).ids) == 8


def test_order_of_faces_does_not_matter():
    solid = l_beam(pitch=0.05)
    order = np.random.default_rng(0).permutation(len(solid.faces))
    shuffled = TriangleMesh(vertices=solid.vertices, faces=solid.faces[order])
    assert same_partition(planar_regions(shuffled).label, planar_regions(solid).label[order])


def test_sphere_has_no_region():
    found = planar_regions(sphere(rounds=3))
    assert (found.label == -1).all()
    assert len(found.ids) == 0


def test_given_regions_keep_their_numbers_and_coplanar_ones_join():
    solid = box()
    label = by_plane(solid) + 10
    label[np.flatnonzero(label == 10)[0]] = 40  # two given regions in one plane
    found = planar_regions(with_regions(solid, label))
    assert found.ids.tolist() == [10, 11, 12, 13, 14, 15]
    assert found.n_not_planar == 0


def test_a_given_region_that_is_not_planar_is_not_believed():
    ball = sphere(rounds=2)
    found = planar_regions(with_regions(ball, np.where(ball.vertices[ball.faces].mean(1)[:, 2] > 0.5, 3, -1)))
    assert found.n_not_planar == 1
    assert (found.label == -1).all()


def test_the_pieces_of_a_given_region_are_regions_of_their_own():
    solid = box()
    label = by_plane(solid)
    found = planar_regions(with_regions(solid, np.where(label == label[0], 7, np.where(label == label[-1], 7, -1))))
    assert len(found.ids) == 6


@pytest.mark.parametrize(("share", "n_regions"), [(0.9, 6), (1.1, 5)])
def test_threshold_of_planarity(share, n_regions):
    """One inner vertex of the top lifted to just under and just over the tolerance."""
    solid = box(pitch=0.25)
    vertices = solid.vertices.copy()
    top = np.flatnonzero((vertices[:, 2] == 1) & (np.abs(vertices[:, :2] - 0.5) < 1e-9).all(1))[0]
    vertices[top, 2] += 2 * share * PLANAR_TOLERANCE * extent(vertices)  # the plane goes half-way between the extremes
    label = by_plane(solid)
    lifted = with_regions(TriangleMesh(vertices=vertices, faces=solid.faces), label)
    found = planar_regions(lifted)
    assert found.n_not_planar == 6 - n_regions
    assert found.deviation_m.max() <= PLANAR_TOLERANCE * extent(vertices)


def test_a_region_that_touches_itself_is_cut():
    """Two vertices beside an inner one are lifted: its flat triangles form two fans. Afterwards no border passes a vertex twice."""
    solid = box(pitch=0.25)
    vertices = solid.vertices.copy()
    x, y, z = vertices.T
    lifted = (z == 1) & (np.abs(y - 0.5) < 1e-9) & ((np.abs(x - 0.25) < 1e-9) | (np.abs(x - 0.75) < 1e-9))
    vertices[lifted, 2] += 0.05
    found = planar_regions(TriangleMesh(vertices=vertices, faces=solid.faces))
    pairs = edge_pairs(solid.faces, len(vertices))
    for region in found.ids:
        inside = found.label == region
        border = pairs[inside[pairs[:, 0]] != inside[pairs[:, 1]]]
        assert (np.bincount(border[:, 2:].ravel())[np.unique(border[:, 2:])] == 2).all()


def test_fine_cylinder_does_not_become_one_plane():
    """Neighbouring strips are coplanar within the tolerance, the whole is not: it is cut up, never one region."""
    n = 2000
    angle = 1e-4 * np.arange(n)  # a shallow arc of radius 1, sagitta between neighbours 5e-9
    arc = np.column_stack([np.sin(angle), np.cos(angle)])
    loop = np.vstack([[[0.0, 0.9]], arc[::-1][:1] * 0.9, arc[::-1]])
    ring = np.arange(len(loop))
    top = len(loop)
    vertices = np.vstack([np.column_stack([loop, np.zeros(top)]), np.column_stack([loop, np.full(top, 0.1)])])
    ahead = np.roll(ring, -1)
    sides = np.vstack([np.column_stack([ring, ahead, ahead + top]), np.column_stack([ring, ahead + top, ring + top])])
    fan = np.column_stack([np.zeros(top - 2, np.int64), ring[1:-1], ring[2:]])
    solid = TriangleMesh(vertices=vertices, faces=np.vstack([sides, fan[:, ::-1], fan + top]).astype(np.int64))
    found = planar_regions(solid)
    assert found.deviation_m.max() <= PLANAR_TOLERANCE * extent(vertices)
    assert 7 < len(found.ids) < n  # seeds take two or three strips to each side


def test_subdivision_changes_nothing():
    assert len(planar_regions(subdivided(l_beam(pitch=0.1))).ids) == 8


def test_open_surface_is_refused():
    solid = box()
    with pytest.raises(RepairError, match="3 edges are not used by exactly two triangles"):
        planar_regions(TriangleMesh(vertices=solid.vertices, faces=solid.faces[1:]))
