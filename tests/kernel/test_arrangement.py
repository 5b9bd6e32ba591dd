import numpy as np

from scan2fea.kernel.arrangement import Arrangement, boundary_facets

LOW, HIGH = -np.ones(3), np.ones(3)


def random_planes(n, seed=0):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    return normals / np.linalg.norm(normals, axis=1)[:, None], rng.uniform(-0.5, 0.5, n)


def arranged(normals, offsets, chosen=None):
    space = Arrangement(normals, offsets, LOW, HIGH)
    for k in range(len(offsets)):
        space.cut(k, range(space.n_cells) if chosen is None else chosen(space, k))
    return space


def signed_volumes(cells):
    """Of each cell, by the divergence theorem over its facets."""
    out = np.zeros(cells.n_cells)
    for loop, pair in zip(cells.loops, cells.cell, strict=True):
        p = cells.vertices[loop]
        part = np.einsum("ij,ij->i", np.cross(p[1:-1], p[2:]), np.broadcast_to(p[0], (len(p) - 2, 3))).sum() / 6.0
        for c, way in zip(pair, (-1.0, 1.0), strict=True):  # the normal leaves the cell behind the facet
            if c >= 0:
                out[c] += way * part
    return out


def test_three_planes_cut_a_box_into_eight():
    space = arranged(np.eye(3), np.array([0.0, 0.5, -0.5]))
    cells = space.cells()
    assert cells.n_cells == 8 and len(cells.vertices) == 27 and len(cells.loops) == 36
    assert np.allclose(np.sort(signed_volumes(cells)), np.sort([x * y * z for x in (1, 1) for y in (1.5, 0.5) for z in (0.5, 1.5)]))


def test_a_plane_through_an_edge_or_beside_the_box_cuts_nothing():
    slanted = np.array([[1.0, 1.0, 0.0]]) / np.sqrt(2)
    assert arranged(slanted, np.array([np.sqrt(2)])).n_cells == 1
    assert arranged(slanted, np.array([3.0])).n_cells == 1


def test_cells_are_those_of_equal_signs_and_fill_the_box():
    normals, offsets = random_planes(9)
    space = arranged(normals, offsets)
    cells = space.cells()
    volumes = signed_volumes(cells)
    assert (volumes > 0).all() and np.isclose(volumes.sum(), 8.0)
    points = np.random.default_rng(1).uniform(-1, 1, (3000, 3))
    cell, side = space.located(points), points @ normals.T > offsets
    for c in np.unique(cell):
        assert len(np.unique(side[cell == c], axis=0)) == 1
    assert np.allclose(np.bincount(cell, minlength=cells.n_cells) / len(points) * 8.0, volumes, atol=0.2)


def test_cutting_some_cells_only_keeps_facets_between_two_cells():
    normals, offsets = random_planes(12, 3)
    rng = np.random.default_rng(2)
    space = arranged(normals, offsets, lambda s, k: [c for c in range(s.n_cells) if rng.random() < 0.5])
    cells = space.cells()
    assert np.isclose(signed_volumes(cells).sum(), 8.0) and (signed_volumes(cells) > 0).all()
    inside = rng.random(cells.n_cells) < 0.5
    facets, along = boundary_facets(cells, inside)
    area = np.zeros(3)
    for f, way in zip(facets, along, strict=True):
        p = cells.vertices[cells.loops[f]]
        area += (1 if way else -1) * np.cross(p[1:-1] - p[0], p[2:] - p[0]).sum(axis=0)
    assert np.allclose(area, 0.0, atol=1e-12)  # a closed surface
