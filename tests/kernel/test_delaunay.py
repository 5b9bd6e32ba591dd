import itertools

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay

from scan2fea.errors import ReconstructionError
from scan2fea.kernel import delaunay
from scan2fea.kernel.delaunay import FACETS, JITTER, crossed, depth_to, tet_at, tetrahedralise, walk_votes
from scan2fea.kernel.delaunay_insert import inserted


def graph(tetra):
    return tetra.points, tetra.tets, tetra.neighbors, *tetra.incidence


def cloud(n=300, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 3))


def lattice():
    """Coplanar, cospherical, the worst case of a Delaunay triangulation."""
    x = np.arange(6.0)
    return np.stack(np.meshgrid(x, x, x), -1).reshape(-1, 3)


def barycentric(tetra, t, x):
    corners = tetra.points[tetra.tets[t]]
    w = np.linalg.solve((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1), (x - corners[:, 0])[..., None])[..., 0]
    return np.column_stack([1 - w.sum(1), w])


CLOUDS = {"random": cloud(), "lattice": lattice(), "twice": np.vstack([lattice()] * 2), "small and far": cloud() * 1e-6 + 1e4, "large": cloud() * 1e5}


@pytest.mark.parametrize("name", CLOUDS)
def test_is_a_triangulation(name):
    points = CLOUDS[name]
    spread = np.ptp(points, axis=0).max() / 6
    tetra = tetrahedralise(points, spread, 0)
    assert tetra.n_input == len(points) and len(tetra.points) == len(points) + 8
    assert np.abs(tetra.points[: len(points)] - points).max() <= JITTER * spread * 1.001
    volume = tetra.volumes
    assert volume.min() > 0
    assert volume.sum() == pytest.approx(ConvexHull(tetra.points[-8:] - tetra.points[-8]).volume, rel=1e-6)
    for t, i in np.argwhere(tetra.neighbors >= 0)[::37]:  # the facet is shared, and turned
        other = tetra.neighbors[t, i]
        back = int(np.flatnonzero(tetra.neighbors[other] == t)[0])
        assert set(tetra.tets[t, FACETS[i]]) == set(tetra.tets[other, FACETS[back]])
    assert (tetra.is_box == (tetra.tets >= len(points)).any(1)).all()


def test_spheres_are_empty():
    tetra = tetrahedralise(cloud(120), 0.3, 0)
    distance = np.linalg.norm(tetra.circumcentre[:, None] - tetra.points[None], axis=2)
    assert (distance >= tetra.circumradius[:, None] * (1 - 1e-6)).all()
    touching = np.take_along_axis(distance, tetra.tets, 1)
    assert np.abs(touching / tetra.circumradius[:, None] - 1).max() < 1e-6


@pytest.mark.parametrize("name", CLOUDS)
def test_point_by_point_gives_the_tets_of_qhull(name):
    points = CLOUDS[name]
    tetra = tetrahedralise(points, np.ptp(points, axis=0).max() / 6, 0)
    local = (tetra.points - tetra.points.mean(0)) / np.ptp(tetra.points)
    expected = np.sort(Delaunay(local, qhull_options="Qbb Qc Qz Q12").simplices, axis=1)
    assert np.array_equal(np.unique(np.sort(tetra.tets, axis=1), axis=0), np.unique(expected, axis=0))


def test_where_points_cannot_be_inserted_qhull_answers(monkeypatch):
    """Two points in one place, which no tet parts: given up; a cloud that is given up comes from qhull."""
    points = np.vstack([cloud(30) * 0.1, cloud(30)[:1] * 0.1])
    box = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * (1 + 0.02 * np.random.default_rng(0).uniform(size=(8, 3)))
    tets, neighbors = delaunay._hull(box)
    assert inserted(np.vstack([points, box]), tets + len(points), neighbors, len(points), 0) is None
    monkeypatch.setattr(delaunay, "inserted", lambda *_: None)
    other = tetrahedralise(cloud(50), 0.3, 0)
    assert other.volumes.min() > 0 and other.n_input == 50


def test_incidence_is_brute_force():
    tetra = tetrahedralise(cloud(60), 0.3, 0)
    first, tets = tetra.incidence
    for v in range(len(tetra.points)):
        assert (tets[first[v] : first[v + 1]] == np.flatnonzero((tetra.tets == v).any(1))).all()


def test_same_seed_same_bytes_and_input_untouched():
    points = cloud()
    before = points.copy()
    one, two = tetrahedralise(points, 0.3, 3), tetrahedralise(points, 0.3, 3)
    assert one.points.tobytes() == two.points.tobytes() and one.tets.tobytes() == two.tets.tobytes()
    assert (points == before).all()


def test_walks_find_the_tet_that_holds_the_place():
    tetra = tetrahedralise(cloud(), 0.3, 0)
    rng = np.random.default_rng(1)
    way = rng.normal(size=(300, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    rows = np.arange(300)
    for depth in (1e-6, 0.5, 2.0):
        found = tet_at(*graph(tetra), rows, way, np.full(300, depth))
        place = tetra.points[:300] + depth * way
        inside = (np.abs(place) < np.abs(tetra.points).max()).all(1)
        assert (found[inside] >= 0).all()
        assert barycentric(tetra, found[inside], place[inside]).min() > -1e-6


def test_depth_to_box_is_where_the_walk_enters_it():
    tetra = tetrahedralise(cloud(), 0.3, 0)
    rows, way = np.arange(300), np.tile([0.0, 0.6, 0.8], (300, 1))
    depth = depth_to(*graph(tetra), rows, way, tetra.is_box, np.inf)
    assert np.isfinite(depth).all()
    just_after = tet_at(*graph(tetra), rows, way, depth + 1e-9)
    just_before = tet_at(*graph(tetra), rows, way, depth - 1e-9)
    assert tetra.is_box[just_after].all()
    assert not tetra.is_box[just_before[depth > 0]].any()
    capped = depth_to(*graph(tetra), rows, way, tetra.is_box, 1.0)
    assert (np.isinf(capped) | (capped <= 1.0)).all() and (np.isfinite(capped) == (depth <= 1.0)).all()


def test_the_tets_that_rays_cross_are_those_between_their_ends():
    tetra = tetrahedralise(cloud(), 0.3, 0)
    rows, way = np.arange(300), np.tile([0.0, 0.6, 0.8], (300, 1))
    ray, tet = crossed(*graph(tetra), rows, way, 0.4)
    assert (np.diff(ray) >= 0).all() and len(np.unique(ray)) == 300
    follows = ray[1:] == ray[:-1]
    assert (tetra.neighbors[tet[:-1][follows]] == tet[1:][follows, None]).any(axis=1).all()
    for depth in (1e-9, 0.2, 0.4):
        at = tet_at(*graph(tetra), rows, way, np.full(300, depth))
        assert all(at[k] in tet[ray == k] for k in range(300))
    last = tet[np.r_[~follows, True]]
    assert (depth_to(*graph(tetra), rows, way, np.isin(np.arange(len(tetra)), last), 0.4) <= 0.4).all()


def test_votes_are_paid_on_the_sensors_side():
    tetra = tetrahedralise(cloud(), 0.3, 0)
    capacity, source = np.zeros((len(tetra), 4)), np.zeros(len(tetra))
    target = np.array([[0.5, 0.1, -0.2]])
    walk_votes(*graph(tetra), tetra.is_box, np.array([7]), target, np.array([2.0]), np.array([1.0]), 0.2, capacity, source)
    holder = int(source.argmax())
    assert source.sum() == source[holder] == 2.0 and barycentric(tetra, [holder], target).min() > -1e-9
    length = np.linalg.norm(target[0] - tetra.points[7])
    for t, i in np.argwhere(capacity > 0):
        corner = tetra.points[tetra.tets[t, FACETS[i]]]
        normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
        along = normal @ (target[0] - tetra.points[7]) / length
        s = normal @ (corner[0] - tetra.points[7]) / along
        assert along < 0  # outward normal of the tet on the sensor's side looks back at the point
        assert capacity[t, i] == pytest.approx(2.0 * (1 - np.exp(-0.5 * (s / 0.2) ** 2)), rel=1e-9)


def test_what_cannot_be_triangulated_says_so():
    with pytest.raises(ReconstructionError, match="at least 4"):
        tetrahedralise(cloud(3), 0.1, 0)
    with pytest.raises(ReconstructionError, match="not finite"):
        tetrahedralise(np.full((9, 3), np.nan), 0.1, 0)
    with pytest.raises(ReconstructionError, match="must be positive"):
        tetrahedralise(np.zeros((9, 3)), 0.0, 0)
