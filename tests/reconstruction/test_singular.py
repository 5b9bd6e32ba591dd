import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_no_crossing
from scan2fea.errors import ReconstructionError
from scan2fea.kernel.delaunay import tetrahedralise
from scan2fea.kernel.measures import volume
from scan2fea.kernel.topology import face_components
from scan2fea.reconstruction.singular import boundary, clean, resolve


def nothing(tetra):
    return np.zeros((len(tetra), 4)), np.zeros(len(tetra)), np.zeros(len(tetra))


@pytest.fixture(scope="module")
def tetra():
    return tetrahedralise(np.random.default_rng(0).uniform(size=(700, 3)), 0.1, 0)


def centres(tetra):
    return tetra.points[tetra.tets].mean(axis=1)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_any_labels_become_a_manifold(tetra, seed, share):
    """The promise: closed, manifold at edges and vertices, free of crossings, whatever the labels were; here they are noise."""
    inside = (np.random.default_rng(seed).uniform(size=len(tetra)) < share) & ~tetra.is_box
    found = resolve(tetra, inside, *nothing(tetra), 0.1)
    mesh, _ = boundary(tetra, found.inside)
    assert found.n_singular > 0
    assert_closed_manifold_oriented(mesh, n_components=face_components(mesh.faces)[0])
    assert volume(mesh) == pytest.approx(tetra.volumes[found.inside].sum())


def test_noise_does_not_cross(tetra):
    inside = (np.random.default_rng(0).uniform(size=len(tetra)) < 0.5) & ~tetra.is_box
    assert_no_crossing(boundary(tetra, resolve(tetra, inside, *nothing(tetra), 0.1).inside)[0])


def test_a_clean_ball_is_left_alone(tetra):
    inside = (np.linalg.norm(centres(tetra) - 0.5, axis=1) < 0.35) & ~tetra.is_box
    found = resolve(tetra, inside, *nothing(tetra), 0.1)
    assert (found.inside != inside).sum() <= 0.1 * inside.sum() and found.n_parts == 1


def test_two_balls_that_touch_in_one_vertex_part_or_join(tetra):
    apart = np.abs(centres(tetra)[:, 0] - 0.5) > 0.12
    inside = apart & ~tetra.is_box
    touching = inside.copy()
    pinch = int(np.abs(tetra.points[: tetra.n_input, 0] - 0.5).argmin())
    touching[(tetra.tets == pinch).any(1) & ~tetra.is_box] = True
    found = resolve(tetra, touching, *nothing(tetra), 0.1)
    assert_closed_manifold_oriented(boundary(tetra, found.inside)[0], n_components=face_components(boundary(tetra, found.inside)[0].faces)[0])


def test_specks_go_and_voids_are_filled_unless_seen(tetra):
    away = np.linalg.norm(centres(tetra) - 0.5, axis=1)
    ball = (away < 0.4) & ~tetra.is_box
    hollow = ball & (away > 0.15)
    capacity, source, _ = nothing(tetra)
    filled = clean(tetra, hollow, capacity, source)
    assert (filled[0] == ball).all() and filled[2] >= 1
    core = np.flatnonzero(ball & ~hollow)[0]
    source[core] = 3.0  # on the threshold: not enough
    assert clean(tetra, hollow, capacity, source)[0][core]
    source[core] = 3.1
    assert not clean(tetra, hollow, capacity, source)[0][core]
    speck = ball.copy()
    far = int((np.abs(centres(tetra) - 0.95).max(1) + 9 * tetra.is_box).argmin())
    speck[far] = True
    assert not clean(tetra, speck, *nothing(tetra)[:2])[0][far]


def test_the_cheaper_label_is_changed(tetra):
    """Two halves joined at one vertex: votes for the pinch decide whether it is filled or dug away; either way the input is untouched."""
    inside = (np.random.default_rng(1).uniform(size=len(tetra)) < 0.5) & ~tetra.is_box
    before = inside.copy()
    capacity, source, sink = nothing(tetra)
    more = resolve(tetra, inside, capacity, source, sink + 1e6 * inside, 0.1).inside
    less = resolve(tetra, inside, capacity, source + 1e6 * ~inside, sink, 0.1).inside
    assert tetra.volumes[more].sum() > tetra.volumes[less].sum()
    assert (inside == before).all()


def test_nothing_inside_is_an_error(tetra):
    with pytest.raises(ReconstructionError, match="nothing is left inside"):
        resolve(tetra, np.zeros(len(tetra), bool), *nothing(tetra), 0.1)
