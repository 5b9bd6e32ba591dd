import numpy as np
import pytest

from fea.bars import bar, l_bar, quadratic, tagged
from scan2fea.errors import SolveError
from scan2fea.fea import material
from scan2fea.fea.assemble import assemble
from scan2fea.fea.restrain import rigid_fields
from scan2fea.fea.strain import energies, von_mises
from scan2fea.types import TetMesh

STEEL = material("S235")


def warped(mesh, amount=0.03):
    """The same mesh with curved sides."""
    x = mesh.nodes + amount * np.sin(2 * mesh.nodes[:, [2, 0, 1]])
    return TetMesh(nodes=x, tets=mesh.tets, boundary=mesh.boundary, face_tag=mesh.face_tag, face_names=mesh.face_names)


@pytest.mark.parametrize("order", [1, 2])
def test_patch_test(order):
    """A linear displacement gives the constant stress of Hooke's law: interior nodes are in balance, the energy is exact."""
    mesh = bar((1.0, 0.7, 0.6), (3, 3, 3), order=order)
    x = np.array(mesh.nodes)
    inner = np.setdiff1d(np.arange(len(x)), np.unique(mesh.boundary))
    assert len(inner) >= 8
    h = 1e-3 * np.array([[1.0, 0.2, -0.3], [0.5, -0.4, 0.1], [0.2, 0.6, 0.7]])
    u = x @ h.T
    k = assemble(mesh, STEEL).stiffness_matrix()
    force = (k @ u.ravel()).reshape(-1, 3)
    assert np.abs(force[inner]).max() < 1e-9 * np.abs(force).max()
    e, nu = STEEL.youngs_pa, STEEL.poisson
    lam, mu = e * nu / (1 + nu) / (1 - 2 * nu), e / 2 / (1 + nu)
    strain = (h + h.T) / 2
    exact = (lam * np.trace(strain) ** 2 + 2 * mu * (strain**2).sum()) * 0.42
    assert u.ravel() @ k @ u.ravel() == pytest.approx(exact, rel=1e-9)
    assert energies(mesh, STEEL, u[None])[0, 0] == pytest.approx(exact, rel=1e-9)
    stress = lam * np.trace(strain) * np.eye(3) + 2 * mu * strain
    deviator = stress - np.trace(stress) / 3 * np.eye(3)
    assert np.allclose(von_mises(mesh, STEEL, u)[0], np.sqrt(1.5 * (deviator**2).sum()), rtol=1e-9)


@pytest.mark.parametrize("make", [lambda: bar((1, 1, 1), (2, 2, 2)), lambda: warped(bar((1, 1, 1), (2, 2, 2))), lambda: l_bar(0.1, 0.01, 0.5, 3, 4)])
def test_rigid_motion_costs_nothing_and_mass_is_exact(make):
    mesh = make()
    system = assemble(mesh, STEEL)
    k, rigid = system.stiffness_matrix(), rigid_fields(mesh.nodes).reshape(-1, 6)
    assert np.abs(k @ rigid).max() < 1e-12 * np.abs(k.data).max() * 60
    assert np.abs(energies(mesh, STEEL, rigid.T.reshape(6, -1, 3))).max() < 1e-20 * STEEL.youngs_pa
    from scan2fea.fea.elements import surface_volume

    assert system.mass.sum() == pytest.approx(7850 * surface_volume(mesh.nodes, mesh.boundary), rel=1e-12)
    dense = system.stiffness_matrix().toarray()
    assert np.abs(dense - dense.T).max() < 1e-9 * np.abs(dense).max()
    assert np.linalg.eigvalsh(system.mass_matrix().toarray()).min() > 0


def test_linear_tetrahedron_against_its_closed_form():
    """Stiffness V B'DB and mass rho V / 20 (1 + delta) of the 4-node tetrahedron (Zienkiewicz and Taylor)."""
    x = np.array([[0.0, 0, 0], [2, 0.1, 0], [0.3, 1.5, 0], [0.2, 0.4, 1.1]])
    mesh = tagged(x, np.array([[0, 1, 2, 3]]))
    system = assemble(mesh, STEEL)
    volume = np.linalg.det(x[1:] - x[0]) / 6
    gradient = np.linalg.inv(np.c_[np.ones(4), x])[1:].T
    b = np.zeros((6, 12))
    for a, (gx, gy, gz) in enumerate(gradient):
        b[:, 3 * a : 3 * a + 3] = [[gx, 0, 0], [0, gy, 0], [0, 0, gz], [gy, gx, 0], [0, gz, gy], [gz, 0, gx]]
    e, nu = STEEL.youngs_pa, STEEL.poisson
    lam, mu = e * nu / (1 + nu) / (1 - 2 * nu), e / 2 / (1 + nu)
    d = np.zeros((6, 6))
    d[:3, :3] = lam
    d[np.arange(6), np.arange(6)] += [2 * mu] * 3 + [mu] * 3
    assert np.allclose(system.stiffness_matrix().toarray(), volume * b.T @ d @ b, rtol=1e-12, atol=1e-3)
    assert np.allclose(system.mass_matrix().toarray(), 7850 * volume / 20 * (1 + np.eye(4)), rtol=1e-12)


def test_quadratic_mass_against_its_closed_form():
    """Straight TET10: the integrals of corner and middle functions over V are -V/20 and V/5."""
    x, tets = quadratic(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 1, 2, 3]]))
    system = assemble(tagged(x, tets), STEEL)
    row = system.mass_matrix().sum(axis=1)[tets[0]]
    assert np.allclose(row, 7850 / 6 * np.array([-1 / 20] * 4 + [1 / 5] * 6), rtol=1e-12)


def test_input_is_untouched_and_far_coordinates_lose_nothing():
    mesh = bar((1, 1, 1), (2, 1, 1))
    before = mesh.nodes.copy()
    near = assemble(mesh, STEEL)
    moved = TetMesh(nodes=mesh.nodes + 4096.0, tets=mesh.tets, boundary=mesh.boundary, face_tag=mesh.face_tag, face_names=mesh.face_names)
    far = assemble(moved, STEEL)
    assert (mesh.nodes == before).all()
    assert np.allclose(far.stiffness, near.stiffness, rtol=1e-9, atol=1e-9 * np.abs(near.stiffness).max())


def test_inside_out_elements_and_loose_nodes_are_named():
    mesh = bar((1, 1, 1), (1, 1, 1), order=1)
    turned = np.array(mesh.tets)
    turned[2] = turned[2][[1, 0, 2, 3]]
    with pytest.raises(SolveError, match="element 2 has a Jacobian"):
        assemble(TetMesh(nodes=mesh.nodes, tets=turned, boundary=mesh.boundary, face_tag=mesh.face_tag, face_names=mesh.face_names), STEEL)
    loose = np.concatenate([mesh.nodes, [[9.0, 9, 9]]])
    with pytest.raises(SolveError, match="1 of 9 nodes"):
        assemble(TetMesh(nodes=loose, tets=mesh.tets, boundary=mesh.boundary, face_tag=mesh.face_tag, face_names=mesh.face_names), STEEL)
