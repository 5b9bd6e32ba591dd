import numpy as np
import pytest

from fea.bars import bar
from scan2fea.errors import SolveError
from scan2fea.fea import FeaOptions, build_model, solve
from scan2fea.fea.p_error import energy_of_error
from scan2fea.fea.restrain import held_unknowns


def estimated(mesh, **options):
    options = FeaOptions(poisson=0.3, n_modes=1, down="-x", **options)
    model = build_model(mesh, options)
    result = solve(model, options)
    body = np.tile(7850 * model.acceleration_m_s2, (1, len(mesh.nodes), 1))
    held = held_unknowns(model).all(axis=1)
    work = 2 * next(c.value for c in result.cases if c.measure == "strain_energy_j")
    return float(energy_of_error(mesh, model.material, result.displacement_m[None], body, held)[0]), work


def test_it_tells_what_a_finer_mesh_changes():
    """Beam lying on its side wall: the estimate is within a factor of 3 of the true gain of a mesh four times finer, and falls with it."""
    coarse, fine, finest = (bar((0.2, 1.0, 0.2), (n, 5 * n, n)) for n in (1, 2, 4))
    (e1, w1), (e2, w2), (_, w4) = (estimated(mesh) for mesh in (coarse, fine, finest))
    assert 1 / 3 < e1 / (w4 - w1) < 3 and 1 / 3 < e2 / (w4 - w2) < 4
    assert e2 < e1


def test_a_quadratic_answer_has_no_error():
    mesh = bar((1, 1, 1), (2, 2, 2))
    model = build_model(mesh, FeaOptions())
    u = mesh.nodes[:, [0]] ** 2 * [0, 1e-3, 0]  # u_y = c x^2 bends under a body force of -2 mu c along y and no shear on x = 0
    mu = model.material.youngs_pa / 2.6
    inside = np.zeros(len(mesh.nodes), bool)
    inside[np.unique(mesh.boundary)] = True  # boundary held: its tractions are not the question
    body = np.tile([0, -2 * mu * 1e-3, 0], (1, len(mesh.nodes), 1))
    assert energy_of_error(mesh, model.material, u[None], body, inside)[0] < 1e-18 * mu


def test_first_order_is_refused():
    mesh = bar((1, 1, 1), (1, 1, 1), order=1)
    with pytest.raises(SolveError, match="quadratic"):
        energy_of_error(mesh, build_model(mesh).material, np.zeros((1, 8, 3)), np.zeros((1, 8, 3)), np.zeros(8, bool))
