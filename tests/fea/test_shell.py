"""Members as shells: middles of walls against the areas of sections, the deck in CalculiX against beam theory."""

from dataclasses import replace

import numpy as np
import pytest

from fea.test_deck import calculix
from predicates import rotation
from scan2fea.errors import SolveError
from scan2fea.fea import FeaOptions, material
from scan2fea.fea.beam_theory import tip_under_force, tip_under_tension, tip_under_torque
from scan2fea.fea.section_properties import properties_of
from scan2fea.fea.shell import LAST, end_forces, shell_model, write_shell_inp
from scan2fea.fea.shell_static import shell_cases, shell_stiffness
from scan2fea.kernel.sections import PARAMETERS, section, section_area
from scan2fea.types import Member, Parameter
from scan2fea.units import UNIT_SYSTEMS

SHAPES = {
    "L": {"a": 0.127, "b": 0.1, "t": 0.00635},
    "I": {"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085},
    "C": {"h": 0.2, "b": 0.075, "tw": 0.0085, "tf": 0.0115},
    "T": {"h": 0.1, "b": 0.1, "tw": 0.008, "tf": 0.008},
    "RHS": {"h": 0.1, "b": 0.06, "t": 0.005},
    "CHS": {"d": 0.1143, "t": 0.006},
    "rect": {"b": 0.1, "t": 0.01},
}
LENGTH = 1.5


def member(family, placed=None, **more):
    values = {**SHAPES.get(family, {}), **more, "length": LENGTH}
    names = (*PARAMETERS[family], "length")
    told = tuple(Parameter(name=n, value_m=values[n], std_m=1e-4, observable=True, source="fitted") for n in names)
    return Member(
        family=family, parameters=told, T_world_member=np.eye(4) if placed is None else placed,
        bow=np.zeros((2, 0)), twist=np.zeros(0), end_normals=np.array([[0, 0, -1.0], [0, 0, 1.0]]), covariance=np.zeros((len(names),) * 2),
        sigma_m=1e-4, noise="gaussian", outlier_share=0.0, seen={}, families={family: 1.0},
    )  # fmt: skip


@pytest.mark.parametrize("family", SHAPES)
def test_walls_have_the_area_of_the_section_but_where_they_overlap(family):
    model = shell_model(member(family))
    corners = model.nodes[model.elements[:, [0, 4, 1]]]
    width = np.linalg.norm(np.diff(corners, axis=1), axis=2).sum(axis=1)
    foot = model.nodes[model.elements[:, 0], 2] == 0
    d = SHAPES[family]
    overlap = {"I": d.get("tw", 0) * d.get("tf", 0), "T": d.get("tw", 0) * d.get("tf", 0) / 2}.get(family, 0.0)
    exact = np.pi * (d["d"] - d["t"]) * d["t"] if family == "CHS" else section_area(section(family, d))
    made = float((width * model.thickness_m[model.wall])[foot].sum())
    assert made == pytest.approx(exact + overlap, rel=2e-3 if family == "CHS" else 1e-12)  # chords of 32 points on the circle
    assert model.weight.sum() == pytest.approx(1.0)
    assert len(np.unique(model.elements)) == len(model.nodes)
    assert len(model.first) == len(model.last)


def test_loads_on_the_end_are_what_they_say():
    model = shell_model(member("C"))
    forces = end_forces(model, 100.0)
    at = model.nodes[model.last]
    for name, axis in (("bend_x", 0), ("bend_y", 1), ("tension", 2)):
        np.testing.assert_allclose(forces[name].sum(axis=0), 100.0 * np.eye(3)[axis], atol=1e-12)
    np.testing.assert_allclose(forces["torsion"].sum(axis=0), 0.0, atol=1e-10)
    np.testing.assert_allclose(np.cross(at, forces["torsion"]).sum(axis=0), [0, 0, 100.0], atol=1e-10)


def test_the_deck_stands_where_the_member_stands_and_in_its_units():
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = rotation(2), [1.0, -2.0, 3.0]
    here, there = shell_model(member("L")), shell_model(member("L", placed))
    np.testing.assert_allclose(there.nodes, here.nodes @ placed[:3, :3].T + placed[:3, 3], atol=1e-12)
    text = write_shell_inp(member("L", placed))
    assert text == write_shell_inp(member("L", placed))
    assert "** units: m-N-Pa" in text and f"*NSET, NSET={LAST}" in text and text.count("*STEP") == 6
    assert "\n6.3500000000e+00\n" in write_shell_inp(member("L"), units=UNIT_SYSTEMS["mm-N-MPa"])


def test_shells_follow_the_bow_of_the_member():
    bent = replace(member("L"), bow=np.array([[-0.01], [0.0]]))
    off = shell_model(bent).nodes - shell_model(member("L")).nodes
    middle = np.isclose(shell_model(member("L")).nodes[:, 2], LENGTH / 2)
    assert middle.any()
    np.testing.assert_allclose(off[middle][:, 0], 0.005, atol=1e-12)  # -0.01 (3 t^2 - 1) / 2 at t = 0
    np.testing.assert_allclose(off[:, 1], 0.0, atol=1e-12)


def test_thick_walls_and_bars_are_no_shells():
    with pytest.raises(SolveError, match="3 times as wide as thick, a shell at least 4"):
        shell_model(member("rect", b=0.03))
    with pytest.raises(SolveError, match="family round has no flat walls"):
        shell_model(member("round", d=0.05))


@pytest.mark.parametrize("family", ["L", "C", "RHS", "CHS"])
def test_calculix_bends_and_twists_it_as_theory_says(family, tmp_path):
    model, steel = shell_model(member(family)), material("S235")
    steps, _ = calculix(write_shell_inp(member(family)), tmp_path)
    assert len(steps) == 1 + 4 + FeaOptions().n_modes
    p = properties_of(family, SHAPES[family])
    moved = [model.weight @ u[model.last] for u in steps[1:5]]
    assert moved[0][2] == pytest.approx(tip_under_tension(p, steel, LENGTH, 100.0), rel=0.01)
    for k in range(2):
        expected, _ = tip_under_force(p, steel, LENGTH, 100.0 * np.eye(2)[k])
        assert moved[1 + k][k] == pytest.approx(expected[k], rel=0.03)
    at = model.nodes[model.last] - model.weight @ model.nodes[model.last]
    arm = np.cross([0, 0, 1.0], at)
    u = steps[4][model.last] - moved[3]
    twist = float((model.weight[:, None] * arm * u).sum() / (model.weight[:, None] * arm**2).sum())
    # corners of thick walls hold more than lines that cross; a box without diaphragms loses its rectangle
    assert twist == pytest.approx(tip_under_torque(p, steel, LENGTH, 100.0), rel={"RHS": 0.25, "C": 0.09}.get(family, 0.03))
    ours = {row.name: row.value for row in shell_cases(model, steel, 100.0)}
    assert [ours["shell_tension"], ours["shell_bend_x"], ours["shell_bend_y"]] == pytest.approx([moved[0][2], moved[1][0], moved[2][1]], rel=0.01)
    assert ours["shell_torsion"] == pytest.approx(twist, rel=0.02)


@pytest.mark.parametrize("family", ["I", "CHS"])
def test_shells_that_move_as_one_are_not_strained_and_stand_anywhere(family):
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = rotation(2), [1.0, -2.0, 3.0]
    model, steel = shell_model(member(family)), material("S235")
    stiff = shell_stiffness(model, steel)
    assert abs(stiff - stiff.T).max() <= 1e-12 * abs(stiff).max()
    way, turn = np.array([0.3, -0.5, 0.8]), np.array([0.2, 0.4, -0.1])
    shift = np.c_[np.tile(way, (len(model.nodes), 1)), np.zeros_like(model.nodes)].ravel()
    spin = np.c_[np.cross(turn, model.nodes), np.tile(turn, (len(model.nodes), 1))].ravel()
    size = float(stiff.diagonal().max())
    assert abs(stiff @ shift).max() < 1e-9 * size
    assert spin @ (stiff @ spin) < 1e-6 * size * float(spin @ spin)  # the hair that holds turns about the normal
    here = [row.value for row in shell_cases(model, steel, 100.0)]
    there = [row.value for row in shell_cases(shell_model(member(family, placed)), steel, 100.0)]
    assert there == pytest.approx(here, rel=1e-6)


def test_a_plate_in_even_tension_stretches_evenly():
    """The patch test: a plate of skewed elements takes an even strain exactly."""
    model, steel = shell_model(member("rect")), material("S235")
    inner = np.setdiff1d(np.arange(len(model.nodes)), np.r_[model.first, model.last])
    skewed = model.nodes.copy()
    corner = np.unique(model.elements[:, :4])
    x = skewed[:, 0].copy()
    move = np.setdiff1d(np.intersect1d(inner, corner), np.flatnonzero(np.abs(np.abs(x) - 0.05) < 1e-9))
    skewed[move] += np.random.default_rng(0).uniform(-0.008, 0.008, (len(move), 3)) * [1, 0, 1]
    for a, m, b in ((0, 4, 1), (1, 5, 2), (2, 6, 3), (3, 7, 0)):
        skewed[model.elements[:, m]] = 0.5 * (skewed[model.elements[:, a]] + skewed[model.elements[:, b]])
    strain = 1e-4
    u = np.zeros((len(skewed), 6))
    u[:, 0], u[:, 2] = -steel.poisson * strain * skewed[:, 0], strain * skewed[:, 2]
    force = (shell_stiffness(replace(model, nodes=skewed), steel) @ u.ravel()).reshape(-1, 6)
    pull = steel.youngs_pa * strain * 0.1 * 0.01
    assert force[model.last, 2].sum() == pytest.approx(pull, rel=1e-9)
    assert np.abs(force[inner]).max() < 1e-9 * pull
