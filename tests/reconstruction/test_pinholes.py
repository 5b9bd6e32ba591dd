import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, moved, rotation
from scan2fea.kernel.delaunay import tetrahedralise
from scan2fea.kernel.measures import volume
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import visibility
from scan2fea.reconstruction.pinholes import _handles, _unlit
from scan2fea.reconstruction.singular import boundary, resolve
from scan2fea.simulation.shapes import bracket, chs
from scan2fea.types import PointCloud, Scan
from scanned import scan_of, scanned


@pytest.mark.parametrize("seed", [0, 2])
def test_gaps_of_a_random_sample_are_no_holes_through_a_wall(seed):
    wall = 0.004  # points 0.6 of it apart: the cut alone goes through it in several places
    truth = moved(chs(0.06, wall, 0.12, 0.0001), rotation(seed), np.array([1.0, 2.0, 3.0]))
    found = visibility(scanned(truth, 0.6 * wall, 0.0, seed=seed)[0])
    assert_closed_manifold_oriented(found.mesh)
    assert surface_topology(found.mesh).n_handles == 1  # its bore
    assert volume(found.mesh) == pytest.approx(volume(truth), rel=0.01)


@pytest.mark.parametrize("seed", [13, 17])
def test_bores_of_two_spacings_stay(seed):
    truth = moved(bracket(0.14, 0.12, 0.012, 0.1, [("a", 0.08, 0.05, 0.016), ("b", 0.07, 0.05, 0.014)], 0.0002), rotation(seed), np.zeros(3))
    found = visibility(scanned(truth, 0.007, 0.0, seed=seed)[0])
    assert surface_topology(found.mesh).n_handles == 2


@pytest.mark.parametrize("seed", [1, 2])
def test_gaps_in_a_wall_of_two_spacings_are_filled_and_its_bores_stay(seed):
    """No sensors, noise of a sixteenth of the wall: 6,000 points lie on each skin, and chance leaves gaps opposite each other."""
    holes = [("a", 0.12, 0.07, 0.009), ("b", 0.12, 0.06, 0.009)]
    truth = moved(bracket(0.25, 0.2, 0.008, 0.25, holes, 0.0002), rotation(seed), np.zeros(3))
    scan, _, _ = scanned(truth, 0.004, 0.0005, seed=seed)
    found = visibility(Scan(cloud=PointCloud.of(scan.cloud.points)))
    assert surface_topology(found.mesh).n_handles == 2


@pytest.mark.parametrize("radius", [1.8, 2.2])
def test_a_place_hidden_on_both_skins_is_no_hole_where_no_sight_line_passed(radius):
    wall, spacing = 0.004, 0.002
    truth = moved(chs(0.06, wall, 0.12, 0.0001), rotation(1), np.zeros(3))
    scan, places, _ = scanned(truth, spacing, 0.0, seed=1)
    middle = moved(chs(0.06, wall, 0.12, 0.0001), rotation(1), np.zeros(3)).vertices.mean(axis=0) + 0.028 * rotation(1)[:, 0]
    seen = np.linalg.norm(places - middle, axis=1) > np.hypot(radius * spacing, wall / 2)
    found = visibility(scan_of(scan.cloud.points[seen], scan.sensors()[seen]))
    assert surface_topology(found.mesh).n_handles == 1


def test_holes_are_counted_as_the_topology_of_the_surface_says():
    """Tubes laid side by side, a hole each, cut out of the tets between random points."""
    tetra = tetrahedralise(np.random.default_rng(0).random((4000, 3)), 0.05, 0)
    middle = tetra.points[tetra.tets].mean(axis=1)
    none = np.zeros((len(tetra), 4))
    for n in (1, 2, 3):
        away = np.hypot((middle[:, 0] * n) % 1 - 0.5, (middle[:, 1] - 0.5) * n) / n
        inside = ~tetra.is_box & (np.abs(middle - 0.5).max(axis=1) < 0.42) & (away > 0.12)
        found = resolve(tetra, inside, none, np.zeros(len(tetra)), inside.astype(float), 0.05)
        topology = surface_topology(boundary(tetra, found.inside)[0])
        assert topology.is_clean and _handles(tetra, found.inside) == topology.n_handles >= 1


def test_a_channel_is_unlit_where_no_tet_of_it_was_entered():
    tetra = tetrahedralise(np.random.default_rng(1).random((2000, 3)), 0.07, 0)
    middle = tetra.points[tetra.tets].mean(axis=1)
    hole = ~tetra.is_box & (np.hypot(middle[:, 0] - 0.5, middle[:, 1] - 0.5) < 0.15)
    inside = ~tetra.is_box & ~hole
    dark = np.ones(len(tetra), bool)
    chosen = _unlit(tetra, inside, 1.0, dark)
    assert chosen.sum() > 0.8 * hole.sum() and not (chosen & inside).any()
    dark[np.flatnonzero(chosen)[0]] = False
    assert not _unlit(tetra, inside, 1.0, dark).any()
    assert not _unlit(tetra, ~tetra.is_box, 1.0, np.ones(len(tetra), bool)).any()
