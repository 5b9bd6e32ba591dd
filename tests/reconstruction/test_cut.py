import itertools

import numpy as np
import pytest

from scan2fea.errors import ReconstructionError
from scan2fea.kernel.delaunay import tetrahedralise
from scan2fea.reconstruction.cut import Votes, _minimum_cut, cut, gather_votes


def test_minimum_cut_is_brute_force():
    rng = np.random.default_rng(0)
    for _ in range(20):
        i, j = np.array(list(itertools.combinations(range(6), 2)), np.int64).T
        forward, reverse = rng.uniform(size=(2, len(i)))
        source, sink = 2 * rng.uniform(size=(2, 6))

        def price(label, i=i, j=j, forward=forward, reverse=reverse, source=source, sink=sink):
            inside = np.array(label, bool)
            crossing = forward[~inside[i] & inside[j]].sum() + reverse[inside[i] & ~inside[j]].sum()
            return crossing + source[inside].sum() + sink[~inside].sum()

        best = min(itertools.product((0, 1), repeat=6), key=price)
        assert price(_minimum_cut(i, j, forward, reverse, source, sink)) == pytest.approx(price(best))


@pytest.fixture(scope="module")
def ball():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(800, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    h = float(np.sqrt(4 * np.pi / 800))
    return tetrahedralise(normals, h, 0), normals, h


def test_a_ball_is_its_volume(ball):
    tetra, normals, h = ball
    votes = gather_votes(tetra, normals, 5 * normals, 0.02 * h, np.full(800, np.nan), h)
    found = cut(tetra, votes, h)
    assert tetra.volumes[found.inside].sum() == pytest.approx(4 / 3 * np.pi, rel=0.03)
    assert found.held > 0.99 and not (found.inside & tetra.is_box).any()


def test_points_without_a_sensor_vote_inward_only(ball):
    tetra, normals, h = ball
    votes = gather_votes(tetra, normals, np.full((800, 3), np.nan), 0.02 * h, np.full(800, np.nan), h)
    assert votes.capacity.sum() == votes.source.sum() == 0 and votes.sink.sum() == pytest.approx(800)


def test_the_inward_vote_stays_in_the_wall():
    """A plate of thickness 1: with noise 2 a vote at depth 4 would land beyond its far side; the local thickness keeps it inside."""
    x, y = (a.ravel().astype(float) for a in np.meshgrid(np.arange(12), np.arange(12)))
    points = np.vstack([np.column_stack([x, y, np.zeros(144)]), np.column_stack([x, y, np.ones(144)])])
    normals = np.repeat([[0.0, 0, -1], [0, 0, 1]], 144, axis=0)
    tetra = tetrahedralise(points, 1.0, 0)
    inner = ((points[:, :2] > 2) & (points[:, :2] < 9)).all(1)
    for thickness, share in ((1.0, 1.0), (np.nan, 0.0)):
        votes = gather_votes(tetra, normals, np.full_like(points, np.nan), 2.0, np.full(288, thickness), 1.0, weight=inner.astype(float))
        depth = tetra.points[tetra.tets].mean(1)[:, 2]
        between = (depth > 0) & (depth < 1)
        assert votes.sink[between].sum() == pytest.approx(share * inner.sum(), abs=1e-9)


def test_more_outside_votes_never_add_inside(ball):
    tetra, normals, h = ball
    votes = gather_votes(tetra, normals, 5 * normals, 0.02 * h, np.full(800, np.nan), h)
    one = cut(tetra, votes, h).inside
    upper = tetra.points[tetra.tets].mean(1)[:, 2] > 0.2
    two = cut(tetra, votes, h, extra_source=np.where(upper, 50.0, 0.0)).inside
    assert not (two & ~one).any() and tetra.volumes[two].sum() < 0.7 * tetra.volumes[one].sum()


def test_a_price_that_collapses_the_surface_is_halved(ball):
    tetra, normals, h = ball
    votes = gather_votes(tetra, normals, 5 * normals, 0.02 * h, np.full(800, np.nan), h)
    found = cut(tetra, votes, h, quality_weight=10.0)
    assert found.held >= 0.5 and found.quality_weight <= 10.0
    assert tetra.volumes[found.inside].sum() == pytest.approx(4 / 3 * np.pi, rel=0.1)


def test_no_inside_at_all_is_an_error(ball):
    tetra, _, h = ball
    empty = Votes(capacity=np.zeros((len(tetra), 4)), source=np.ones(len(tetra)), sink=np.zeros(len(tetra)))
    with pytest.raises(ReconstructionError, match="nothing inside"):
        cut(tetra, empty, h)
