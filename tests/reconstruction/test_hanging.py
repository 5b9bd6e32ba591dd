import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.surfaces import CYLINDER, Surface
from scan2fea.reconstruction.hanging import Among


@pytest.mark.parametrize("sense", [1, -1])
def test_points_on_a_cylinder_that_hang_together_are_those_of_the_graph(sense):
    rng = np.random.default_rng(3)
    angle, height = rng.uniform(0, 2 * np.pi, 500), rng.uniform(0, 2, 500)
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(500)])
    points = out + np.column_stack([np.zeros((500, 2)), height]) + 0.1 * rng.normal(size=(500, 3))
    normals = sense * out + 0.5 * rng.normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    near, free = k_nearest(points, 5)[1], rng.random(500) < 0.8
    among, sizes = Among.of(points, normals, near), set()
    cylinder = Surface(kind=CYLINDER, point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), radius=1.0, sense=sense)
    graph = coo_array((np.ones(near.size), (np.repeat(np.arange(500), 5), near.ravel())), shape=(500, 500)).tocsr()
    for off, own_side in ((0.05, 0.5), (0.1, 0.9), (1.0, -1.0)):
        own = free & (np.abs(cylinder.distance(points)) <= off) & (np.einsum("ij,ij->i", cylinder.normals(points), normals) >= own_side)
        part = connected_components(graph[own][:, own], directed=False)[1]
        for seed in range(0, 500, 7):
            wanted = np.flatnonzero(own)[part == part[own[:seed].sum()]] if own[seed] else np.zeros(0)
            assert among.near_round(seed, free, cylinder, off, own_side).tolist() == wanted.tolist()
            sizes.add(len(wanted))
    assert len(sizes) > 5
