import dataclasses

import numpy as np
import pytest

from fea.bars import bar, l_bar, tagged
from scan2fea.errors import SolveError
from scan2fea.fea import FeaOptions, build_model, material, solve
from scan2fea.fea.assemble import assemble
from scan2fea.fea.dissection import dissect
from scan2fea.types import FEModel, TetMesh

STEEL = material("S235")
# no lateral contraction: the bar theory is then exact, supports included
SLACK = FeaOptions(poisson=0.0)


def figure(result, measure):
    return next(c for c in result.cases if c.measure == measure)


def moved(mesh, rotation=None, shift=0.0, scale=1.0):
    rotation = np.eye(3) if rotation is None else rotation
    return TetMesh(
        nodes=scale * mesh.nodes @ rotation.T + shift, tets=mesh.tets, boundary=mesh.boundary, face_tag=mesh.face_tag, face_names=mesh.face_names
    )


def on_end(mesh, axis, options, acceleration):
    """A model held at the low end of `axis`."""
    nodes = np.flatnonzero(mesh.nodes[:, axis] < 1e-9)
    model = build_model(mesh, options)
    sets = {**model.node_sets, "END": nodes}
    return dataclasses.replace(model, node_sets=sets, supports={"END": "xyz"}, acceleration_m_s2=np.asarray(acceleration, float))


@pytest.mark.parametrize("down", ["-z", "+z"])
def test_bar_standing_and_hanging(down):
    """u = rho g L^2 / 2E; standing on its lower end it is pressed, held at its upper end it is drawn."""
    mesh, length = bar((0.1, 0.1, 1.0), (2, 2, 8)), 1.0
    model = build_model(mesh, SLACK)
    if down == "+z":  # the support stays below, the load turns round: the bar hangs upside down
        model = dataclasses.replace(model, acceleration_m_s2=-model.acceleration_m_s2)
    result = solve(model, SLACK)
    exact = STEEL.density_kg_m3 * 9.80665 * length**2 / (2 * STEEL.youngs_pa)
    assert figure(result, "displacement_max_m").value == pytest.approx(exact, rel=1e-6)
    assert np.allclose(result.reaction_n, -result.applied_n, rtol=1e-9)
    assert np.linalg.norm(result.applied_n) == pytest.approx(7850 * 9.80665 * 0.01, rel=1e-12)
    work = figure(result, "strain_energy_j")
    # integral of (rho g A s)^2 / 2EA over the length
    assert work.value == pytest.approx((7850 * 9.80665) ** 2 * 0.01 / (6 * STEEL.youngs_pa), rel=1e-6)
    assert work.relative_error < 1e-9
    assert figure(result, "mass_kg").relative_error < 1e-12


def test_free_beam_frequencies():
    """f1 = 22.373 / (2 pi L^2) sqrt(EI / rho A), twice for a square section; shear takes a little off."""
    result = solve(build_model(bar((2.0, 0.05, 0.05), (24, 1, 1))))
    exact = 22.3733 / (2 * np.pi * 2.0**2) * np.sqrt(STEEL.youngs_pa * 0.05**2 / 12 / STEEL.density_kg_m3)
    assert result.frequencies_hz.shape == (10,) and result.mode_shapes.shape == (4, len(result.displacement_m), 3)
    assert result.frequencies_hz[6:8] == pytest.approx(exact, rel=0.01)
    assert (np.abs(result.frequencies_hz[:6]) < 1e-5 * result.frequencies_hz[6]).all()
    assert np.linalg.norm(result.mode_shapes, axis=2).max(axis=1) == pytest.approx(1.0)
    assert result.n_dof == 3 * len(result.displacement_m)
    plain = (float, type(None))
    assert all(type(x) in plain for c in result.cases for x in (c.value, c.expected, c.relative_error)), "the report writes them as JSON"


def test_longitudinal_mode_of_a_free_bar():
    """f = sqrt(E / rho) / 2L without contraction; it is far above bending, so that many modes must be found on the way."""
    options = FeaOptions(poisson=0.0, n_modes=12)
    result = solve(build_model(bar((1.0, 0.2, 0.15), (10, 2, 2)), options), options)
    exact = np.sqrt(STEEL.youngs_pa / STEEL.density_kg_m3) / 2
    assert np.abs(result.frequencies_hz / exact - 1).min() < 1e-3


def test_cantilever_converges():
    """Tip deflection under self weight over three refinements: the error falls at a steady rate towards the finest."""
    acceleration = (0, 0, -9.80665)
    tips = []
    for n in (1, 2, 4):
        mesh = bar((1.0, 0.1, 0.1), (4 * n, n, n))
        model = on_end(mesh, 0, SLACK, acceleration)
        tips.append(figure(solve(model, FeaOptions(poisson=0.0, n_modes=1)), "displacement_max_m").value)
    # rho A g L^4 / 8EI with the shear of Timoshenko, rho g L^2 / 2 k G, k = 5/6
    weight = STEEL.density_kg_m3 * 9.80665
    exact = weight * 12 / (8 * STEEL.youngs_pa * 0.1**2) + weight / (2 * 5 / 6 * STEEL.youngs_pa / 2)
    errors = np.abs(np.array(tips) / exact - 1)
    assert tips[0] < tips[1] < tips[2]  # stiff from below
    assert errors[2] < 0.003
    rate = np.log2((tips[1] - tips[0]) / (tips[2] - tips[1]))
    assert rate > 2


def test_linear_elements_are_too_stiff():
    mesh4, mesh10 = (bar((1.0, 0.1, 0.1), (10, 1, 1), order=order) for order in (1, 2))
    u4, u10 = (figure(solve(on_end(m, 0, SLACK, (0, 0, -9.8)), SLACK), "displacement_max_m").value for m in (mesh4, mesh10))
    assert u4 < 0.5 * u10


def test_rigid_motion_and_scale():
    mesh = l_bar(0.1, 0.01, 0.5, 3, 8)
    base = solve(build_model(mesh))
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # z to x
    options = FeaOptions(down="-x")
    turned = solve(build_model(moved(mesh, turn, shift=50.0), options), options)
    assert np.allclose(turned.displacement_m, base.displacement_m @ turn.T, rtol=0, atol=1e-6 * np.abs(base.displacement_m).max())
    assert turned.frequencies_hz[6:] == pytest.approx(base.frequencies_hz[6:], rel=1e-7)
    for scale in (1e-3, 1e2):
        scaled = solve(build_model(moved(mesh, scale=scale)))
        assert scaled.frequencies_hz[6:] * scale == pytest.approx(base.frequencies_hz[6:], rel=1e-7)
        assert figure(scaled, "displacement_max_m").value / scale**2 == pytest.approx(figure(base, "displacement_max_m").value, rel=1e-7)


def test_every_solver_gives_the_same():
    model = build_model(bar((0.3, 0.3, 0.3), (4, 4, 4)))
    system = assemble(model.mesh, model.material)
    need = 8 * dissect(np.array(model.mesh.nodes), np.array(system.indptr), np.array(system.indices)).peak_entries / 2**20
    # the supported part needs a little less than the free one
    results = [solve(model, FeaOptions(solver=s, max_factor_mb=max(1, mb))) for s, mb in (("direct", 1400), ("auto", 0.8 * need), ("amg", 1400))]
    for words, result in zip(("double", "single", "multigrid"), results, strict=True):
        assert result.solver.count(words) == 2
        assert np.allclose(result.displacement_m, results[0].displacement_m, rtol=0, atol=1e-8 * np.abs(results[0].displacement_m).max())
        assert result.frequencies_hz[6:] == pytest.approx(results[0].frequencies_hz[6:], rel=1e-6)


def test_a_mesh_in_two_pieces_shows_twelve_zero_modes():
    first = bar((1.0, 0.2, 0.2), (6, 1, 1))
    nodes = np.concatenate([first.nodes, first.nodes + np.array([0, 0.5, 0])])
    both = tagged(nodes, np.concatenate([first.tets, first.tets + len(first.nodes)]))
    result = solve(build_model(both, FeaOptions(n_modes=8)), FeaOptions(n_modes=8))
    assert np.abs(result.frequencies_hz[:12]).max() < 1e-4 * result.frequencies_hz[12]


def test_two_runs_give_the_same_bytes():
    model = build_model(l_bar(0.1, 0.01, 0.5, 3, 8))
    first, second = solve(model), solve(model)
    assert first.displacement_m.tobytes() == second.displacement_m.tobytes()
    assert first.mode_shapes.tobytes() == second.mode_shapes.tobytes()
    assert first.cases == second.cases


def test_limits_are_named():
    mesh = bar((1, 1, 1), (2, 2, 2))
    model = build_model(mesh, FeaOptions(max_dof=375))  # on the limit
    with pytest.raises(SolveError, match=r"375 degrees of freedom are above fea\.max_dof = 374"):
        solve(model, FeaOptions(max_dof=374))
    thin = FEModel(mesh=mesh, material=STEEL, node_sets={"A": np.array([0, 1])}, supports={"A": "xyz"}, acceleration_m_s2=np.zeros(3))
    with pytest.raises(SolveError, match="not held against turning about z"):
        solve(thin)
    with pytest.raises(SolveError, match="are too few"):
        solve(build_model(bar((1, 1, 1), (1, 1, 1), order=1)), FeaOptions(n_modes=4))


def test_a_very_slender_rod():
    """Length 400 times the thickness: the rounding of the displacements alone is felt, and stays below every limit."""
    mesh = bar((4.0, 0.01, 0.01), (160, 1, 1))
    result = solve(on_end(mesh, 0, SLACK, (0, 0, -9.80665)), SLACK)
    exact = STEEL.density_kg_m3 * 9.80665 * 12 * 4.0**4 / (8 * STEEL.youngs_pa * 0.01**2)
    assert figure(result, "displacement_max_m").value == pytest.approx(exact, rel=2e-3)
    assert figure(result, "strain_energy_j").relative_error < 1e-5
    assert np.linalg.norm(result.reaction_n + result.applied_n) < 1e-5 * np.linalg.norm(result.applied_n)
    assert figure(result, "residual").value < 1e-5
    assert np.abs(result.frequencies_hz[:6]).max() < 1e-5 * result.frequencies_hz[6]
