import numpy as np

from scan2fea.kernel.transforms import applied, random_rotation, rigid, rotated
from scan2fea.registration.descriptors import DIRECTIONS, N_BINS, descriptors, octahedral_directions, turned
from scan2fea.registration.frame import SIGNS, right_handed, sign_variants, toward
from scan2fea.registration.keypoints import saliency
from workpiece import workpiece

ROWS = np.arange(0, 400, 40)
RADIUS = 0.7


def framed(points):
    found = saliency(points, ROWS, 0.15, RADIUS)
    return right_handed(found.axes), found.weight


def test_the_octahedron_split_twice_has_66_vertices():
    assert [len(octahedral_directions(k)) for k in range(4)] == [6, 18, 66, 258]
    assert DIRECTIONS.shape == (N_BINS, 3)
    np.testing.assert_allclose(np.linalg.norm(DIRECTIONS, axis=1), 1.0)
    for signs in SIGNS:  # a turn by signs maps the set on itself
        assert sorted(np.argmax(DIRECTIONS @ (DIRECTIONS * signs).T, axis=1).tolist()) == list(range(N_BINS))


def test_features_are_the_definition():
    points, _ = workpiece(500)
    frames, weight = framed(points)
    found = descriptors(points, ROWS, frames, weight, RADIUS)
    for k, row in enumerate(ROWS):
        d = points - points[row]
        rho = np.linalg.norm(d, axis=1)
        near = (rho < RADIUS) & (rho > 0)
        bins = np.zeros(N_BINS)
        for j in np.flatnonzero(near):
            bins[np.argmax(DIRECTIONS @ (frames[k].T @ d[j]))] += weight[j] * rho[j]
        np.testing.assert_allclose(found[k], np.sqrt(bins / bins.sum()), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)


def test_features_do_not_change_under_a_rigid_motion_or_scale():
    points, _ = workpiece(500)
    frames, weight = framed(points)
    first = descriptors(points, ROWS, frames, weight, RADIUS)
    T = rigid(random_rotation(5), [3.0, 1.0, -2.0])
    again = descriptors(applied(T, points), ROWS, np.einsum("ij,njk->nik", T[:3, :3], frames), weight, RADIUS)
    np.testing.assert_allclose(again, first, atol=1e-9)
    np.testing.assert_allclose(descriptors(1e3 * points, ROWS, frames, weight, 1e3 * RADIUS), first, atol=1e-9)


def test_the_signs_of_a_frame_only_permute_the_partitions():
    points, _ = workpiece(500)
    frames, weight = framed(points)
    first = descriptors(points, ROWS, frames, weight, RADIUS)
    variants = sign_variants(frames)
    np.testing.assert_allclose(np.linalg.det(variants), 1.0)
    for v in range(4):
        np.testing.assert_allclose(descriptors(points, ROWS, variants[:, v], weight, RADIUS), turned(first, v), atol=1e-12)


def test_a_frame_found_anew_is_one_of_four():
    points, _ = workpiece(500)
    frames, _ = framed(points)
    T = rigid(random_rotation(9), np.zeros(3))
    found, _ = framed(applied(T, points))
    expected = sign_variants(np.einsum("ij,njk->nik", T[:3, :3], frames))
    assert np.abs(expected - found[:, None]).max(axis=(2, 3)).min(axis=1).max() < 1e-9


def test_a_frame_is_turned_to_the_seen_side():
    points, normals = workpiece(500)
    frames, _ = framed(points)
    seen = np.ones(len(ROWS), bool)
    out = toward(frames, normals[ROWS], seen)
    assert (np.einsum("nc,nc->n", out[:, :, 2], normals[ROWS]) >= 0).all()
    np.testing.assert_allclose(np.linalg.det(out), 1.0)
    np.testing.assert_array_equal(toward(frames, normals[ROWS], ~seen), frames)
    T = rigid(random_rotation(2), np.zeros(3))
    assert rotated(T, normals).shape == normals.shape


def test_a_lone_point_has_an_empty_feature():
    points = np.array([[0.0, 0, 0], [10.0, 0, 0]])
    assert not descriptors(points, np.array([0]), np.eye(3)[None], np.ones(2), 1.0).any()
