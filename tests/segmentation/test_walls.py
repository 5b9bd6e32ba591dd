"""Walls that bound a room are supports, whatever leans on them; sides of containers and cabinets on the floor are not."""

import numpy as np
import pytest

from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation import segment_scene
from scan2fea.segmentation.planes import Plane
from scan2fea.segmentation.walls import _faces
from scan2fea.types import PointCloud, Scan

H = 0.03


def sheet(origin, u, v, seed):
    rng = np.random.default_rng(seed)
    u, v = np.array(u, float), np.array(v, float)
    n = int(np.linalg.norm(u) * np.linalg.norm(v) / H**2)
    return origin + rng.random((n, 1)) * u + rng.random((n, 1)) * v + 0.001 * rng.standard_normal((n, 3))


def box(origin, size, seed):
    """Top and four sides."""
    x, y, z = np.diag(np.array(size, float))
    o = np.array(origin, float)
    faces = ((o + z, x, y), (o, x, z), (o + y, x, z), (o, y, z), (o + x, y, z))
    return np.concatenate([sheet(*face, 10 * seed + k) for k, face in enumerate(faces)])


def room(walls):
    """A floor of 4 x 3 m, three boxes on it, one of which leans on the first wall."""
    floor = sheet([0, 0, 0], [4, 0, 0], [0, 3, 0], 1)
    return [floor, box([1.5, 1.2, 0], [0.5, 0.4, 0.4], 2), box([2.5, 0.0, 0], [0.4, 0.5, 0.6], 3), *walls, box([2.8, 1.9, 0], [0.5, 0.5, 0.5], 9)]


def labels_of(parts, seed):
    points = np.concatenate(parts) @ random_rotation(seed).T + seed
    return segment_scene(Scan(cloud=PointCloud.of(points))), np.repeat(np.arange(len(parts)), [len(p) for p in parts])


ONE_FACE = [sheet([0, 0, 0], [4, 0, 0], [0, 0, 2.2], 4), sheet([0, 0, 0], [0, 3, 0], [0, 0, 2.2], 5)]
TWO_FACES = [box([-0.1, -0.1, 0], [4.1, 0.1, 2.2], 6), box([-0.1, 0, 0], [0.1, 3, 2.2], 7)]


@pytest.mark.parametrize("walls", [ONE_FACE, TWO_FACES])
def test_two_walls_of_a_corner_leave_what_stands_before_them(walls):
    found, truth = labels_of(room(walls), 3)
    assert found.kinds.count("support") >= 3
    for k, role in ((0, "support"), (1, "object"), (2, "object"), (3, "support"), (4, "support")):
        label = np.bincount(found.labels[truth == k] + 1).argmax() - 1
        assert found.kinds[label] == role, k
        assert (found.labels[truth == k] == label).mean() > (0.78 if k == 2 else 0.98)  # the face that it leans with is the wall's
    assert found.labels[truth == 1][0] != found.labels[truth == 2][0]


def test_a_container_along_the_edge_of_the_floor_is_no_wall():
    found, truth = labels_of(room([box([0, 0, 0], [0.9, 3, 2.2], 8)]), 5)
    label = np.bincount(found.labels[truth == 3] + 1).argmax() - 1
    assert found.kinds[label] == "object"
    assert (found.labels[truth == 3] == label).mean() > 0.9


def test_a_plane_aslant_through_a_slab_becomes_its_outer_face():
    slab = np.concatenate([sheet([0, 0, 0], [4, 0, 0], [0, 0, 2], 1), sheet([0, 0.1, 0], [4, 0, 0], [0, 0, 2], 2)])
    tilt = np.arctan(0.1 / 4)
    normal = np.array([-np.sin(tilt), np.cos(tilt), 0.0])
    face, depth = _faces(Plane(normal=normal, offset=0.0, sigma_m=0.03, share=1.0), slab)
    assert face.normal @ [0, 1, 0] > 0.999999
    assert abs(face.offset) < 3e-4
    assert 0.1 < depth < 0.11
    one = slab[: len(slab) // 2]
    plane = Plane(normal=np.array([0.0, 1, 0]), offset=0.0, sigma_m=0.001, share=1.0)
    assert _faces(plane, one) == (plane, 0.0)
