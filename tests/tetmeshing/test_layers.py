"""Tets between copies of a section."""

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented
from scan2fea.errors import MeshingError
from scan2fea.kernel.boundary import boundary_surface
from scan2fea.kernel.measures import tet_volumes, volume
from scan2fea.tetmeshing.layers import layered

NAMES = ("SOUTH", "EAST", "NORTH", "WEST", "END_FIRST", "END_LAST")


def square_grid(n, rng=None):
    """n x n cells of the unit square in a random numbering, and its border with tags."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    number = np.arange((n + 1) ** 2) if rng is None else rng.permutation((n + 1) ** 2)
    at = lambda p, q: number[p * (n + 1) + q]  # noqa: E731
    triangles = np.concatenate([np.stack([at(i, j), at(i + 1, j), at(i + 1, j + 1)], 1), np.stack([at(i, j), at(i + 1, j + 1), at(i, j + 1)], 1)])
    k = np.arange(n)
    rim = [np.stack(pair, 1) for pair in ((at(k, 0), at(k + 1, 0)), (at(n, k), at(n, k + 1)), (at(k, n), at(k + 1, n)), (at(0, k), at(0, k + 1)))]
    xy = np.zeros(((n + 1) ** 2, 2))
    p, q = (a.ravel() for a in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    xy[at(p, q)] = np.stack([p, q], axis=1) / n
    return xy, triangles, np.concatenate(rim), np.repeat(np.arange(4), n)


def copies(xy, heights):
    return np.stack([np.column_stack([xy, np.full(len(xy), z)]) for z in heights])


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_whatever_the_numbering_tets_conform_and_fill(seed, order):
    xy, triangles, rim, tag = square_grid(3, None if seed is None else np.random.default_rng(seed))
    tets = layered(copies(xy, [0, 0.3, 1.0, 2.0]), triangles, rim, tag, NAMES, order)
    assert tets.order == order and len(tets.tets) == 3 * 18 * 3
    assert (tet_volumes(tets.nodes, tets.tets[:, :4]) > 0).all()
    surface = boundary_surface(tets)
    assert_closed_manifold_oriented(surface)
    assert volume(surface) == pytest.approx(2.0, rel=1e-13)


def test_tags_are_the_faces_that_the_border_sweeps():
    xy, triangles, rim, tag = square_grid(4, np.random.default_rng(3))
    tets = layered(copies(xy, [0, 1, 2]), triangles, rim, tag, NAMES)
    corner = tets.nodes[tets.boundary[:, :3]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    outward = np.array([[0, -1, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, -1], [0, 0, 1]])
    assert np.allclose(normal, outward[tets.face_tag])


def test_what_cannot_be_layered():
    xy, triangles, rim, tag = square_grid(2)
    with pytest.raises(MeshingError, match="two copies"):
        layered(copies(xy, [0]), triangles, rim, tag, NAMES)
    with pytest.raises(MeshingError, match="turned over"):
        layered(copies(xy, [0, 1, 0.5]), triangles, rim, tag, NAMES)
