import numpy as np
import pytest
import scipy.sparse.linalg

from fea.bars import bar, l_bar
from scan2fea.errors import SolveError
from scan2fea.fea import FeaOptions, material
from scan2fea.fea.amg import Multigrid
from scan2fea.fea.assemble import assemble
from scan2fea.fea.cholesky import Cholesky
from scan2fea.fea.dissection import dissect, without
from scan2fea.fea.inner import InnerForces
from scan2fea.fea.linear import StaticSolver, conjugate_gradients, inverses
from scan2fea.fea.restrain import rigid_fields
from scan2fea.fea.surfaces import spread_force, surface


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
    for inverse in (Cholesky(system, without(tree, held), 0.0, np.float32), Multigrid(system, rigid_fields(nodes), held, 0.0)):
        x, residual, count = conjugate_gradients(product, inverse, force, 1e-8)
        assert residual <= 1e-8 and 1 <= count < 600
        assert np.abs(x - exact).max() < 1e-5 * np.abs(exact).max()


def test_choice_follows_the_memory_that_the_factors_need(case):
    system, nodes, held, tree = case
    need = 8 * tree.peak_entries / 2**20

    def names(**options):
        return [name for name, _ in inverses(system, tree, rigid_fields(nodes), held, 0.0, FeaOptions(**options))]

    both = ["Cholesky (multifrontal, double precision)", "algebraic multigrid with conjugate gradients"]
    single = "Cholesky (multifrontal, single precision) with conjugate gradients"
    assert names(max_factor_mb=need) == both  # on the limit: it fits
    assert names(max_factor_mb=need * 0.999) == [single, both[1]]
    assert names(max_factor_mb=need / 2) == [single, both[1]]
    assert names(max_factor_mb=need * 0.499) == both[1:]
    assert names(max_factor_mb=need * 0.1, solver="direct") == both[:1]


def static(system, tree, mesh, held):
    held = np.repeat(held[:, None], 3, axis=1) if held.ndim == 1 else held
    return StaticSolver(system, tree, rigid_fields(mesh.nodes), held, InnerForces(mesh, material("S235")), FeaOptions())


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
    found = StaticSolver(system, tree, rigid_fields(nodes), whole, lambda u: u, FeaOptions())(np.zeros_like(nodes), "none")
    assert (found.displacement == 0).all() and found.residual == 0.0


def test_multigrid_leaves_the_global_generator_alone(case):
    system, nodes, held, _ = case
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    right = np.ones((len(nodes), 3, 1))
    first = Multigrid(system, rigid_fields(nodes), held, 0.0).apply(right)
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002
    assert first.tobytes() == Multigrid(system, rigid_fields(nodes), held, 0.0).apply(right).tobytes()
