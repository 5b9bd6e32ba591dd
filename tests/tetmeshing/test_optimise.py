"""ODT, Lloyd and the driver: closed forms, energies that never rise, and a result that is never worse."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial import Delaunay, cKDTree

from balls import ball
from predicates import rotation
from scan2fea.kernel.measures import tet_volumes
from scan2fea.kernel.quality import tet_dihedrals
from scan2fea.kernel.relaxation import relax
from scan2fea.tetmeshing.lloyd import Lloyd
from scan2fea.tetmeshing.odt import Odt
from scan2fea.tetmeshing.optimise import OptimiseOptions, optimised
from scan2fea.tetmeshing.tets import boundary_of, proved
from scan2fea.tetmeshing.work import opened

METHODS = (Odt, Lloyd)


def held_of(nodes, tets):
    return opened(nodes, tets).held[: len(nodes)].copy()


def method(kind, nodes, tets, floor=0.0):
    return kind(tets=tets, held=held_of(nodes, tets), floor=floor)


def star_about(centre, seed=0):
    """One free vertex in a ball of shell points."""
    nodes, tets = ball(30, 0, seed)
    nodes = np.vstack([nodes, centre])
    hull = boundary_of(tets)
    return nodes, np.column_stack([np.full(len(hull), 30), hull])


def test_odt_target_is_the_least_energy_of_a_closed_star():
    nodes, tets = star_about([0.2, -0.1, 0.15])
    tets = np.where((tet_volumes(nodes, tets) < 0)[:, None], tets[:, [1, 0, 2, 3]], tets)
    odt = method(Odt, nodes, tets)

    def energy(p):
        return odt.energy(np.vstack([nodes[:30], p]))

    best = minimize(energy, nodes[30], method="BFGS", options={"gtol": 1e-12}).x
    np.testing.assert_allclose(odt.targets(nodes)[30], best, atol=1e-6)


def test_odt_energy_is_the_error_of_the_interpolant():
    corner = np.array([[0, 0, 0], [1.0, 0.1, 0], [0.2, 1, 0.1], [0, 0.3, 0.8]])
    tets = np.array([[0, 1, 2, 3]])
    weights = np.random.default_rng(0).dirichlet(np.ones(4), 400_000)
    x = weights @ corner
    error = (weights @ (corner**2).sum(1) - (x**2).sum(1)).mean() * tet_volumes(corner, tets)[0]
    assert method(Odt, corner, tets).energy(corner) == pytest.approx(error, rel=5e-3)


def test_lloyd_cells_and_energy_against_drawn_points():
    nodes, tets = ball(200, 60, seed=4)
    lloyd = method(Lloyd, nodes, tets)
    x = np.random.default_rng(0).uniform(-0.5, 0.5, (200_000, 3))
    _, near = cKDTree(nodes).query(x)
    target = lloyd.targets(nodes)
    inner = np.flatnonzero(np.linalg.norm(nodes, axis=1) < 0.3)
    assert len(inner) >= 2
    for v in inner:
        np.testing.assert_allclose(target[v], x[near == v].mean(0), atol=0.01)
    box = np.random.default_rng(1).uniform(-1, 1, (400_000, 3))
    inside = Delaunay(nodes[:200]).find_simplex(box) >= 0
    distance, _ = cKDTree(nodes).query(box[inside])
    assert lloyd.energy(nodes) == pytest.approx((distance**2).sum() * 8 / len(box), rel=0.02)


def test_a_lattice_is_a_fixed_point_of_both():
    """A body-centred lattice: every star is symmetric."""
    n = 4
    grid = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    both = np.vstack([grid, grid[(grid < n - 1).all(1)] + 0.5])
    tets = Delaunay(both + np.random.default_rng(0).normal(0, 1e-9, both.shape)).simplices.astype(np.int64)
    tets = tets[np.abs(tet_volumes(both, tets)) > 1e-6]
    tets = np.where((tet_volumes(both, tets) < 0)[:, None], tets[:, [1, 0, 2, 3]], tets)
    inner = np.flatnonzero((np.abs(both - (n - 1) / 2) < 0.6).all(1))
    for kind in METHODS:
        target = method(kind, both, tets).targets(both)
        np.testing.assert_allclose(target[inner], both[inner], atol=1e-9)


@pytest.mark.parametrize("kind", METHODS)
@pytest.mark.parametrize("seed", range(3))
def test_energy_never_rises_and_the_boundary_never_moves(kind, seed):
    nodes, tets = ball(seed=seed)
    before = nodes.copy()
    found = relax(nodes, method(kind, nodes, tets), iterations=12)
    assert found.iterations >= 3
    assert (np.diff(found.energies) <= 0).all()
    assert found.energies[-1] < found.energies[0]
    assert found.energies[-1] == pytest.approx(method(kind, nodes, tets).energy(found.points), rel=1e-9)
    held = held_of(nodes, tets).astype(bool)
    assert np.array_equal(found.points[held], nodes[held])
    assert (tet_volumes(found.points, tets) > 0).all()
    assert np.array_equal(nodes, before)


@pytest.mark.parametrize("kind", METHODS)
def test_no_tet_falls_below_the_floor_or_what_it_was(kind):
    nodes, tets = ball(seed=9)
    floor = 1 - np.cos(np.radians(15))
    found = relax(nodes, method(kind, nodes, tets, floor), iterations=10)
    before, after = (tet_dihedrals(p, tets).min(1) for p in (nodes, found.points))
    assert (after >= np.minimum(before, 15) - 1e-9).all()


@pytest.mark.parametrize("kind", METHODS)
def test_relaxation_turns_with_the_mesh(kind):
    nodes, tets = ball(seed=2)
    turned = nodes @ rotation(1).T * 7 + 3
    one, two = (relax(p, method(kind, p, tets), iterations=4) for p in (nodes, turned))
    np.testing.assert_allclose(one.points @ rotation(1).T * 7 + 3, two.points, atol=1e-8)


@pytest.mark.parametrize("order", ["odt_first", "lloyd_first"])
@pytest.mark.parametrize("seed", range(3))
def test_driver_reaches_the_target_inside_the_same_boundary(order, seed):
    nodes, tets = ball(200, 250, seed)
    first = (nodes.copy(), tets.copy())
    found = optimised(nodes, tets, OptimiseOptions(optimise=order, target_deg=18.0))
    assert np.array_equal(nodes, first[0]) and np.array_equal(tets, first[1])
    assert tet_dihedrals(nodes, tets).min() < 3  # Delaunay tets hold slivers
    assert tet_dihedrals(found.nodes, found.tets).min() >= 12
    proved(found.nodes, found.tets, boundary_of(found.tets), tet_volumes(nodes, tets).sum())
    hull = boundary_of(tets)
    assert (found.row[hull] >= 0).all()
    assert np.array_equal(found.nodes[found.row[hull]], nodes[hull])
    assert {tuple(sorted(f)) for f in found.row[hull].tolist()} == {tuple(sorted(f)) for f in boundary_of(found.tets).tolist()}
    worst = [row["measures"]["min_dihedral_deg"]["min"] for row in found.log]
    assert worst == sorted(worst)
    assert worst[-1] == pytest.approx(tet_dihedrals(found.nodes, found.tets).min(), abs=1e-9)
    assert all(sum(measure["counts"]) == row["n_tets"] for row in found.log for measure in row["measures"].values())


def test_same_bytes_twice_and_nothing_to_do_changes_nothing():
    nodes, tets = ball(seed=3)
    one, two = optimised(nodes, tets), optimised(nodes, tets)
    assert one.nodes.tobytes() == two.nodes.tobytes() and one.tets.tobytes() == two.tets.tobytes()
    for options in (OptimiseOptions(optimise="none"), OptimiseOptions(target_deg=0.0)):
        same = optimised(nodes, tets, options)
        assert np.array_equal(same.nodes, nodes) and np.array_equal(same.row, np.arange(len(nodes)))
        assert np.array_equal(np.sort(same.tets, axis=1), np.sort(tets, axis=1))
        assert len(same.log) == 1


def test_no_time_is_no_step():
    nodes, tets = ball(seed=3)
    assert len(optimised(nodes, tets, OptimiseOptions(optimise_time_s=0.0)).log) == 1
