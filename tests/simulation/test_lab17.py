"""The thesis's lab: what is stated there holds."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial import cKDTree

from scan2fea.kernel.measures import area
from scan2fea.simulation.lab17 import N_POINTS, SPACING_M, lab17
from scan2fea.simulation.sampling import SamplingOptions, sampled
from scan2fea.simulation.scene_checks import check_scene

GRID = SamplingOptions(method="grid", spacing_m=SPACING_M)
CLUSTERING_RADIUS_M = 0.5 * 0.0254


@pytest.fixture(scope="module")
def lab():
    scene = lab17(0)
    return scene, sampled(scene, GRID, 0).cloud


def test_seventeen_objects_and_their_points(lab):
    scene, cloud = lab
    assert len(scene.solids) == 17
    assert len(cloud) == N_POINTS == 114_808
    assert len({s.name for s in scene.solids}) == 17
    assert np.bincount(cloud.label, minlength=17).min() > 300
    for seed in (1, 17):
        assert len(sampled(lab17(seed), GRID, 0).cloud) == N_POINTS


def test_the_beam_is_the_thesis_beam(lab):
    beam = lab[0].solids[1]
    assert beam.shape.parameters == {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048}
    assert beam.volume_m3 == pytest.approx(4.7932e-3, rel=1e-4)
    assert area(beam.mesh) == pytest.approx(1.5515, rel=1e-4)


def test_only_the_beam_has_the_size_of_a_cluster_that_the_thesis_keeps(lab):
    """3,000 to 50,000 points; every object is one cluster at half an inch, and no two are joined."""
    scene, cloud = lab
    counts = np.bincount(cloud.label, minlength=17)
    kept = np.flatnonzero((counts >= 3000) & (counts <= 50_000))
    assert [scene.solids[k].name for k in kept] == ["l_beam"]
    trees = [cKDTree(cloud.points[cloud.label == k]) for k in range(17)]
    nearest = min(a.query(b.data)[0].min() for a, b in itertools.combinations(trees, 2))
    assert nearest > CLUSTERING_RADIUS_M
    for k, tree in enumerate(trees):
        pairs = tree.query_pairs(CLUSTERING_RADIUS_M, output_type="ndarray")
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        n = int(counts[k])
        graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
        labels = connected_components(graph, directed=False)[1]
        assert np.bincount(labels).max() > 0.99 * n, scene.solids[k].name


def test_nothing_overlaps_at_any_seed():
    for seed in range(3):
        check_scene(lab17(seed))


def test_the_seed_turns_the_others_alone(lab):
    other = lab17(1)
    for a, b in zip(lab[0].solids[:2], other.solids[:2], strict=True):
        assert a.mesh.vertices.tobytes() == b.mesh.vertices.tobytes()
    assert all(a.mesh.vertices.tobytes() != b.mesh.vertices.tobytes() for a, b in zip(lab[0].solids[2:], other.solids[2:], strict=True))
    again = lab17(0)
    assert all(a.mesh.vertices.tobytes() == b.mesh.vertices.tobytes() for a, b in zip(lab[0].solids, again.solids, strict=True))
