import numpy as np
import pytest
import scipy.sparse.linalg

from fea.bars import bar, l_bar
from scan2fea.errors import SolveError
from scan2fea.fea import FeaOptions, material
from scan2fea.fea.amg import Multigrid
from scan2fea.fea.assemble import assemble
from scan2fea.fea.cholesky import Cholesky
from scan2fea.fea.dissection import dissect, dissect_before, without
from scan2fea.fea.inner import InnerForces
from scan2fea.fea.lanczos import free_modes, largest
from scan2fea.fea.linear import TWO_LEVEL, Masked, Shared, StaticSolver, conjugate_gradients, inverses
from scan2fea.fea.modes import Products, first_guess, lobpcg, orthonormal
from scan2fea.fea.restrain import restrained, rigid_fields, three_points
from scan2fea.fea.strain import energies
from scan2fea.fea.surfaces import spread_force, surface
from scan2fea.fea.two_level import TwoLevel


@pytest.fixture(scope="module", params=["block", "angle"])
def case(request):
    mesh = bar((1.0, 0.9, 0.8), (5, 4, 4)) if request.param == "block" else l_bar(0.127, 0.00635, 1.0, 3, 16)
    system = assemble(mesh, material("S235"))
    nodes = np.array(mesh.nodes)
    held = nodes[:, 2] < 1e-9
    return system, nodes, held, dissect(nodes, np.array(system.indptr), np.array(system.indices))


def direct(system, held, right, shift=0.0):
    """The same equations by scipy's SuperLU."""
    k = system.stiffness_matrix().tocsc()
    m = system.mass_matrix().tocoo()
    if shift:
        rows, columns = (np.concatenate([3 * i + c for c in range(3)]) for i in (m.row, m.col))
        k = k + shift * scipy.sparse.csc_array((np.tile(m.data, 3), (rows, columns)), shape=k.shape)
    free = np.flatnonzero(np.repeat(~held, 3))
    x = np.zeros_like(right)
    x.reshape(-1, right.shape[2])[free] = scipy.sparse.linalg.splu(k[free][:, free].tocsc()).solve(right.reshape(-1, right.shape[2])[free])
    return x


def test_cholesky_is_the_inverse(case):
    system, nodes, held, tree = case
    right = np.random.default_rng(0).normal(size=(len(nodes), 3, 2))
    x = Cholesky(system, without(tree, held), 0.0).apply(right)
    exact = direct(system, held, right)
    assert (x[held] == 0).all()
    assert np.abs(x - exact).max() < 1e-8 * np.abs(exact).max()
    free = np.zeros(len(nodes), bool)
    shifted = Cholesky(system, tree, 1e5).apply(right)
    assert np.abs(shifted - direct(system, free, right, 1e5)).max() < 1e-8 * np.abs(shifted).max()


def test_single_precision_and_multigrid_reach_the_same_answer(case):
    system, nodes, held, tree = case
    force = np.random.default_rng(1).normal(size=(len(nodes), 3)) * ~held[:, None]
    k = system.stiffness_matrix()

    def product(x):
        return (k @ x.ravel()).reshape(-1, 3) * ~held[:, None]

    exact = direct(system, held, force[:, :, None])[:, :, 0]
    cycles = TwoLevel(system, held, 0.0, 100.0), Multigrid(system, rigid_fields(nodes), held, 0.0)
    for inverse in (Cholesky(system, without(tree, held), 0.0, np.float32), *cycles):
        x, residual, count = conjugate_gradients(product, inverse, force, 1e-8)
        assert residual <= 1e-8 and 1 <= count < 600
        assert np.abs(x - exact).max() < 1e-5 * np.abs(exact).max()


def test_choice_follows_the_memory_that_the_factors_need(case):
    system, nodes, held, tree = case
    need = 8 * tree.peak_entries / 2**20

    def names(**options):
        return [name for name, _ in inverses(system, tree, rigid_fields(nodes), np.repeat(held[:, None], 3, axis=1), 0.0, FeaOptions(**options))]

    both = ["Cholesky (multifrontal, double precision)", TWO_LEVEL, "algebraic multigrid with conjugate gradients"]
    single = "Cholesky (multifrontal, single precision) with conjugate gradients"
    assert names(max_factor_mb=need) == both  # on the limit: it fits
    assert names(max_factor_mb=need * 0.999) == [single, *both[1:]]
    assert names(max_factor_mb=need / 2) == [single, *both[1:]]
    assert names(max_factor_mb=need * 0.499) == both[1:]
    assert names(max_factor_mb=need * 0.1, solver="direct") == both[:1]


def static(system, tree, mesh, held):
    held = np.repeat(held[:, None], 3, axis=1) if held.ndim == 1 else held
    return StaticSolver(system, Shared(system, tree, FeaOptions()), rigid_fields(mesh.nodes), held, InnerForces(mesh, material("S235")), FeaOptions())


def test_single_directions_can_be_held():
    """A block on rollers: pressed along x it grows across by Poisson's ratio, freely."""
    mesh = bar((1, 1, 1), (2, 2, 2))
    system = assemble(mesh, material("S235"))
    tree = dissect(np.array(mesh.nodes), np.array(system.indptr), np.array(system.indices))
    held = mesh.nodes < 1e-9
    end = surface(mesh.nodes, mesh.boundary[(mesh.nodes[mesh.boundary][:, :, 0] > 1 - 1e-9).all(axis=1)])
    force = end.nodal(spread_force(end, np.array([-210e6, 0, 0])), len(mesh.nodes))
    u = static(system, tree, mesh, held)(force, "press").displacement
    assert np.allclose(u, mesh.nodes * [-1e-3, 3e-4, 3e-4], rtol=0, atol=1e-15)


def test_rounding_does_not_eat_the_reaction_of_a_slender_bar():
    """1000 times as long as thick: residuals from the strains leave 1e-9, from the assembled matrix 1e-4."""
    mesh = bar((10.0, 0.01, 0.01), (400, 1, 1))
    steel = material("S235")
    system = assemble(mesh, steel)
    tree = dissect(np.array(mesh.nodes), np.array(system.indptr), np.array(system.indices))
    held = mesh.nodes[:, 0] < 1e-9
    force = np.asarray(system.mass_matrix().sum(axis=1))[:, None] * np.array([0, 0, -9.81])
    u = static(system, tree, mesh, held)(force, "weight").displacement
    reaction = (InnerForces(mesh, steel)(u) - force)[held].sum(axis=0)
    assert np.linalg.norm(reaction + force.sum(axis=0)) < 1e-9 * np.linalg.norm(force.sum(axis=0))


def test_a_part_that_nothing_holds_is_refused():
    mesh = bar((1, 1, 1), (2, 2, 2))
    system = assemble(mesh, material("S235"))
    tree = dissect(np.array(mesh.nodes), np.array(system.indptr), np.array(system.indices))
    held = np.zeros(len(mesh.nodes), bool)
    held[0] = True  # one point: it can still turn
    force = np.random.default_rng(0).normal(size=(len(mesh.nodes), 3))
    with pytest.raises(SolveError, match="self weight, 375 dof"):
        static(system, tree, mesh, held)(force, "self weight")


def test_no_force_no_motion(case):
    system, nodes, held, tree = case
    whole = np.repeat(held[:, None], 3, axis=1)
    shared = Shared(system, tree, FeaOptions())
    found = StaticSolver(system, shared, rigid_fields(nodes), whole, lambda u: u, FeaOptions())(np.zeros_like(nodes), "none")
    assert (found.displacement == 0).all() and found.residual == 0.0


def test_multigrid_leaves_the_global_generator_alone(case):
    system, nodes, held, _ = case
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    right = np.ones((len(nodes), 3, 1))
    first = Multigrid(system, rigid_fields(nodes), held, 0.0).apply(right)
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002
    assert first.tobytes() == Multigrid(system, rigid_fields(nodes), held, 0.0).apply(right).tobytes()


@pytest.mark.parametrize("levels", ["two", "algebraic"])
def test_a_cycle_is_one_symmetric_positive_operator_on_each_column(case, levels):
    """What conjugate gradients and LOBPCG ask of it: sweeps up are the transposes of those down; columns do not see each other."""
    system, nodes, held, _ = case
    cycle = TwoLevel(system, held, 0.0, 100.0) if levels == "two" else Multigrid(system, rigid_fields(nodes), held, 0.0)
    x = np.random.default_rng(2).normal(size=(len(nodes), 3, 4)) * ~held[:, None, None]
    y = cycle.apply(x)
    assert (y[held] == 0).all()
    alone = np.concatenate([cycle.apply(x[:, :, [c]]) for c in range(4)], axis=2)
    assert np.abs(y - alone).max() <= 1e-12 * np.abs(y).max()
    gram = np.einsum("nar,nas->rs", x, y)
    assert np.abs(gram - gram.T).max() <= 1e-10 * np.abs(gram).max() and np.linalg.eigvalsh((gram + gram.T) / 2)[0] > 0


def test_one_factorisation_serves_every_support_on_the_last_nodes(case):
    """Single directions too; a support elsewhere has factors of its own."""
    system, nodes, held, _ = case
    points = three_points(nodes)
    last = np.flatnonzero(held | points.any(axis=1))
    tree = dissect(nodes, np.array(system.indptr), np.array(system.indices), last)
    assert np.array_equal(np.sort(tree.fronts[-1].own), last) and np.array_equal(tree.last, last)
    shared = Shared(system, tree, FeaOptions())
    right = np.random.default_rng(3).normal(size=(len(nodes), 3, 2))
    exact = direct(system, held, right)
    found = shared.with_held(np.repeat(held[:, None], 3, axis=1)).apply(right)
    assert np.abs(found - exact)[~held].max() < 1e-7 * np.abs(exact).max()
    assert np.abs(found[held]).max() == 0
    other = Cholesky(restrained(system, points), without(tree, points.all(axis=1)), 0.0).apply(right * ~points[:, :, None]) * ~points[:, :, None]
    assert np.abs(shared.with_held(points).apply(right) * ~points[:, :, None] - other).max() < 1e-6 * np.abs(other).max()
    elsewhere = np.zeros((len(nodes), 3), bool)
    elsewhere[np.setdiff1d(np.arange(len(nodes)), last)[0]] = True
    assert shared.holds(points) and not shared.holds(elsewhere) and not shared.holds(points | elsewhere)
    assert not Shared(system, tree, FeaOptions(max_factor_mb=1.0)).holds(points)
    with pytest.raises(SolveError, match="not held"):
        shared.with_held(np.zeros((len(nodes), 3), bool))


def test_the_first_set_that_costs_little_is_left_for_the_end(case):
    system, nodes, held, _ = case
    graph = nodes, np.array(system.indptr), np.array(system.indices)
    all_but_few, few = np.arange(len(nodes) - 30), np.flatnonzero(held)[:4]
    assert np.array_equal(dissect_before(*graph, [all_but_few, few]).last, few)
    assert len(dissect_before(*graph, [all_but_few]).last) == 0


def test_loads_together_are_solved_as_one_by_one(case):
    system, nodes, held, tree = case
    mesh = bar((1.0, 0.9, 0.8), (5, 4, 4))
    if len(mesh.nodes) != len(nodes):
        mesh = l_bar(0.127, 0.00635, 1.0, 3, 16)
    solver = static(system, tree, mesh, held)
    rng = np.random.default_rng(4)
    forces = {f"case {k}": rng.normal(size=nodes.shape) for k in range(3)} | {"none": np.zeros_like(nodes)}
    together = solver.together(forces)
    assert list(together) == list(forces)
    for name, force in forces.items():
        alone = solver(force, name)
        assert together[name].residual <= 1e-10
        assert np.abs(together[name].displacement - alone.displacement).max() <= 1e-8 * np.abs(alone.displacement).max()


def test_lanczos_finds_what_a_dense_solution_finds():
    """Also double values, and a space that ends before they are all found."""
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.normal(size=(60, 60)))[0]
    exact = np.sort(np.concatenate([[9.0, 9.0, 7.0, 5.0], rng.uniform(-1, 4, 56)]))[::-1]
    mass = np.diag(rng.uniform(1, 2, 60))
    root = np.sqrt(np.diag(mass))
    matrix = (turn * exact) @ turn.T  # of root x
    fixed = turn[:, :1] / root[:, None]
    for skip, k in ((0, 4), (1, 3)):
        kept = fixed[:, :skip]
        start = orthonormal(rng.normal(size=(60, 4)), lambda x: mass @ x, kept, mass @ kept)
        values, shapes, error, _ = largest(
            lambda x: mass @ x, lambda x: (matrix @ (x * root[:, None])) / root[:, None], start, k, 1e-14, kept, of_inner=False
        )
        assert values == pytest.approx(exact[skip : skip + k], rel=1e-9)
        assert error <= 1e-14
        assert shapes.T @ mass @ shapes == pytest.approx(np.eye(k), abs=1e-9)
    few = largest(lambda x: x, lambda x: 2.0 * x, np.eye(60)[:, :2], 5, 1e-12, np.zeros((60, 0)), of_inner=False)
    assert few[0] == pytest.approx([2.0, 2.0])


def test_free_modes_are_those_of_lobpcg(case):
    system, nodes, _, _ = case
    start, bound = first_guess(system, nodes, 10)
    points, free = three_points(nodes), np.zeros(len(nodes), bool)
    tree = dissect(nodes, np.array(system.indptr), np.array(system.indices), np.flatnonzero(points.any(axis=1)))
    inverse = Masked(Shared(system, tree, FeaOptions()).with_held(points), (~points).astype(float))
    ours = free_modes(Products(system), inverse, start, 10, 1e-10)
    other = lobpcg(system, Cholesky(system, without(tree, free), 0.1 * bound), 0.1 * bound, start, 10, 1e-12)
    assert ours.eigenvalues[6:] == pytest.approx(other.eigenvalues[6:], rel=1e-6)
    assert (ours.eigenvalues[:6] == 0).all()


def test_energy_is_that_of_the_matrix(case):
    system, nodes, _, _ = case
    mesh = bar((1.0, 0.9, 0.8), (5, 4, 4))
    if len(mesh.nodes) != len(nodes):
        mesh = l_bar(0.127, 0.00635, 1.0, 3, 16)
    fields = np.random.default_rng(6).normal(size=(3, *nodes.shape))
    flat = fields.reshape(3, -1)
    assert energies(mesh, material("S235"), fields) == pytest.approx(flat @ (system.stiffness_matrix() @ flat.T), rel=1e-10)
    assert energies(mesh, material("S235"), np.ones((1, *nodes.shape)))[0, 0] == 0  # a translation strains nothing


def test_two_levels_never_overshoot(case):
    """It stays below the exact inverse in energy; a memory that is too small is told."""
    system, nodes, held, tree = case
    free = np.zeros(len(nodes), bool)
    cycle = TwoLevel(system, free, 1e5, 100.0)
    right = np.random.default_rng(3).normal(size=(len(nodes), 3, 1))
    exact = Cholesky(system, tree, 1e5).apply(right)
    assert np.vdot(right, cycle.apply(right)) <= np.vdot(right, exact) * (1 + 1e-12)  # the cycle never overshoots in energy
    with pytest.raises(SolveError, match=r"corners need .* MiB, fea\.max_factor_mb = 0\.001"):
        TwoLevel(system, held, 0.0, 0.001)
