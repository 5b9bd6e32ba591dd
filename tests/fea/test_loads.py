import dataclasses
import re

import numpy as np
import pytest

from fea.bars import bar
from fea.test_deck import block, calculix
from scan2fea.errors import SolveError, UsageError
from scan2fea.fea import FeaOptions, build_model, check_options, solve, write_bdf, write_inp
from scan2fea.fea.loads import parse_loads, parse_supports, surface_forces
from scan2fea.fea.restrain import free_motions
from scan2fea.fea.surfaces import surface
from scan2fea.types import LoadCase
from scan2fea.units import UNIT_SYSTEMS

MESH = bar((0.1, 0.1, 1.0), (1, 1, 6))
FOOT, TOP = (
    next(
        name
        for k, name in enumerate(MESH.face_names)
        if (np.abs(MESH.nodes[MESH.boundary[MESH.face_tag == k]][:, :, 2] - z) < 1e-9).all()
    )
    for z in (0.0, 1.0)
)


def figure(result, name, measure):
    return next(c for c in result.cases if (c.name, c.measure) == (name, measure))


def forces(line):
    model = build_model(MESH, FeaOptions(loads=(line,)))
    return surface_forces(model, model.cases[0]), model


def test_what_is_spread_adds_up():
    middle = np.array([0.05, 0.05, 1.0])
    f, _ = forces(f"{TOP} force 3 -2 7")
    assert f.sum(axis=0) == pytest.approx([3, -2, 7]) and np.cross(MESH.nodes - middle, f).sum(axis=0) == pytest.approx([0, 0, 0], abs=1e-12)
    f, _ = forces(f"{TOP} moment 1 2 3")
    assert f.sum(axis=0) == pytest.approx([0, 0, 0], abs=1e-9) and np.cross(MESH.nodes - middle, f).sum(axis=0) == pytest.approx([1, 2, 3])
    f, _ = forces(f"{TOP} pressure 2e5")
    assert f.sum(axis=0) == pytest.approx([0, 0, -2e3])
    # of second order the middles of the sides carry a third each and the corners nothing
    touched = np.flatnonzero(np.abs(f[:, 2]) > 1e-9)
    assert (np.abs(f[np.unique(MESH.boundary[:, :3]), 2]) < 1e-9).all() and len(touched) == 5


def test_mean_motion_of_a_face():
    end = surface(MESH.nodes, MESH.boundary[MESH.face_tag == MESH.face_names.index(TOP)])
    spin, shift = np.array([1e-3, -2e-3, 3e-3]), np.array([0.1, 0.2, 0.3])
    mean, turned = end.moved(shift + np.cross(spin, MESH.nodes - end.centroid))
    assert mean == pytest.approx(shift) and turned == pytest.approx(spin)
    assert end.centroid == pytest.approx([0.05, 0.05, 1.0]) and end.area.sum() == pytest.approx(0.01)


def test_cases_of_the_user():
    """A cantilever by its foot: P L^3 / 3 E I, pressure, a torque; two lines of one name act together."""
    options = FeaOptions(
        poisson=0.0, n_modes=1, supports=(FOOT,), loads=(f"bend: {TOP} force 1000 0 0", f"both: {TOP} force 500 0 0", f"both: {TOP} force 500 0 0")
    )
    result = solve(build_model(MESH, options), options)
    assert [f.name for f in result.fields] == ["self_weight", "bend", "both"]
    exact = 1000 / (3 * 210e9 * 0.1**4 / 12) + 1000 * 1.2 / (105e9 * 0.01)
    assert np.abs(result.fields[1].displacement_m[:, 0]).max() == pytest.approx(exact, rel=5e-3)
    assert np.allclose(result.fields[1].displacement_m, result.fields[2].displacement_m, rtol=1e-9, atol=1e-15)
    assert figure(result, "bend", "reaction_n").relative_error < 1e-9 and figure(result, "bend", "strain_energy_j").relative_error < 1e-9


def test_lines_are_for_all_objects_or_for_one():
    options = FeaOptions(loads=(f"2/{TOP} force 1 0 0", "ALL gravity 0 0 -1"), supports=(f"2/{TOP} z", FOOT))
    assert [len(build_model(MESH, options, number=k).cases[0].loads) for k in (1, 2)] == [1, 2]
    assert build_model(MESH, options, number=2).supports == {TOP: "z", FOOT: "xyz"} and build_model(MESH, options, number=1).supports == {FOOT: "xyz"}


def test_a_set_that_is_not_there_fails_its_case_alone():
    options = FeaOptions(n_modes=1, loads=(f"good: {TOP} force 0 0 -1", "bad: ROOF force 0 0 -1"))
    result = solve(build_model(MESH, options), options)
    assert list(result.failed) == ["bad"] and "no set ROOF" in result.failed["bad"] and FOOT in result.failed["bad"]
    assert [f.name for f in result.fields] == ["self_weight", "good"]
    wrong = build_model(MESH, FeaOptions(loads=(f"{TOP} force 0 0 -1",), supports=("FLOR",)))
    assert "fea.supports" in wrong.failed["load"] and wrong.supports == {"LOWEST": "xyz"}


def test_what_is_left_free_is_named():
    held = np.zeros((len(MESH.nodes), 3), bool)
    held[:, 2] = MESH.nodes[:, 2] == 0
    assert sorted(free_motions(MESH.nodes, held)) == ["moving along x", "moving along y", "turning about z"]
    options = FeaOptions(supports=(f"{FOOT} z",), loads=(f"{TOP} force 0 0 -1",))
    with pytest.raises(SolveError, match=f"not held against .*turning about z.*only {FOOT} in z"):
        solve(build_model(MESH, options), options)
    assert free_motions(MESH.nodes, np.ones_like(held)) == ()


def test_inertia_relief():
    """A free bar pushed at one end accelerates as a whole; the force along it falls evenly to nothing: (P / E A) L / 2 shorter."""
    options = FeaOptions(poisson=0.0, n_modes=1, supports=("none",), loads=(f"{TOP} force 0 0 -1e6",))
    result = solve(build_model(MESH, options), options)
    u = result.fields[1].displacement_m[:, 2]
    ends = [u[np.isclose(MESH.nodes[:, 2], z)].mean() for z in (0.0, 1.0)]
    assert ends[1] - ends[0] == pytest.approx(-1e6 / (2 * 210e9 * 0.01), rel=2e-2)
    assert np.linalg.norm(result.fields[1].reaction_n) < 1e-6 * 1e6 and "von" not in result.failed


def test_buckling_factor_of_a_column():
    """Euler's cantilever: pi^2 E I / 4 L^2, less a little shear."""
    options = FeaOptions(n_modes=1, poisson=0.0, supports=(FOOT,), loads=(f"press: {TOP} force 0 0 -1000",), buckling=True)
    factor = figure(solve(build_model(MESH, options), options), "press", "buckling_factor").value
    assert factor * 1000 == pytest.approx(np.pi**2 * 210e9 * 0.1**4 / 12 / 4, rel=0.02)


def test_the_deck_solves_the_same_cases(tmp_path):
    options = FeaOptions(
        supports=(FOOT,), loads=(f"push: {TOP} force 100 0 0", "push: ALL gravity 0 1 0", f"twist: {TOP} moment 0 0 50", f"press: {TOP} pressure 1e5")
    )
    model = build_model(MESH, options)
    steps, _ = calculix(write_inp(model), tmp_path)
    ours = solve(model, options)
    for step, field in zip(steps, ours.fields, strict=False):
        assert np.abs(step - field.displacement_m).max() < 2e-5 * np.abs(field.displacement_m).max(), field.name
    assert len(steps) == 4 + 4


def test_the_deck_of_a_floating_part(tmp_path):
    options = FeaOptions(supports=("none",), loads=(f"push: {TOP} force 100 0 0",))
    model = build_model(MESH, options)
    steps, _ = calculix(write_inp(model), tmp_path)
    field = solve(model, options).fields[1]
    assert np.abs(steps[1] - field.displacement_m).max() < 1e-4 * np.abs(field.displacement_m).max()


def test_nastran_has_a_subcase_for_each():
    text = write_bdf(build_model(MESH, FeaOptions(loads=(f"push: {TOP} force 100 0 0", "push: ALL gravity 0 1 0"))), UNIT_SYSTEMS["mm-N-MPa"])
    assert "SUBCASE 2" in text and "SUBTITLE = PUSH" in text
    cards = [a + b[8:] for a, b in zip(text.splitlines(), text.splitlines()[1:], strict=False) if a.startswith("FORCE*")]
    total = sum(float(card[72:88]) for card in cards)
    assert total == pytest.approx(100.0) and re.search(r"LOAD +100 +1\. +1\. +101 +1\. +102", text)
    pynastran = pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran needs NumPy 1", exc_type=Exception)
    deck = pynastran.BDF(debug=False)
    deck.read_bdf(text.splitlines(), punch=False)
    assert len(deck.elements) == len(MESH.tets)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("TOP force 1 2", "takes 3"),
        ("TOP forse 1 2 3", "did you mean force"),
        ("TOP force 1 2 x", "x"),
        ("TOP force 0 0 0", "loads nothing"),
        ("TOP pressure 1 2", "takes 1"),
        ("TOP force 1 2 inf", "finite"),
        ("force 1 2 3", "is not"),
        ("", "is not"),
    ],
)
def test_bad_lines(line, says):
    with pytest.raises(UsageError, match=says):
        parse_loads((line,))
    with pytest.raises(UsageError, match=r"fea\.loads"):
        check_options(FeaOptions(loads=(line,)))


@pytest.mark.parametrize("line", ["TOP w", "TOP x y", "", "none z"])
def test_bad_supports(line):
    with pytest.raises(UsageError, match=r"fea\.supports"):
        parse_supports((line,))
    with pytest.raises(UsageError, match=r"fea\.supports"):
        parse_supports(("none", "TOP"))


def test_a_load_on_nothing():
    model = build_model(MESH, FeaOptions(loads=(f"{TOP} force 1 0 0",)))
    empty = dataclasses.replace(model, surfaces={**model.surfaces, TOP: np.zeros(0, np.int64)})
    with pytest.raises(SolveError, match=f"load on {TOP} acts on nothing"):
        surface_forces(empty, LoadCase(name="load", loads=model.cases[0].loads))
    assert len(block(write_inp(model), "*CLOAD")) > 3


def test_a_case_on_a_set_without_faces_fails_alone_and_is_in_no_deck():
    model = build_model(MESH, FeaOptions(loads=("bad: ALL pressure 5", f"good: {TOP} force 1 0 0")))
    assert [case.name for case in model.cases] == ["good"]
    assert model.failed == {"bad": "case bad: the load on ALL acts on nothing: the set has no faces of elements"}
    assert "good" in write_inp(model) and "bad" not in write_inp(model) and "BAD" not in write_bdf(model)


@pytest.mark.parametrize(("supports", "line"), [((FOOT,), f"{FOOT} force 0 0 -5"), (("none",), "ALL gravity 1 2 3")])
def test_a_case_that_deforms_nothing_fails_alone(supports, line):
    options = FeaOptions(supports=supports, loads=(f"idle: {line}", f"good: {TOP} force 1 0 0"))
    found = solve(build_model(MESH, options), options)
    assert [field.name for field in found.fields] == ["self_weight", "good"] and "deform nothing" in found.failed["idle"]


def test_a_load_that_buckles_nothing_keeps_its_displacements():
    options = FeaOptions(supports=(FOOT,), buckling=True, loads=(f"pull: {TOP} force 0 0 5", f"press: {TOP} force 0 0 -5"))
    found = solve(build_model(MESH, options), options)
    assert [field.name for field in found.fields] == ["self_weight", "pull", "press"] and figure(found, "press", "buckling_factor").value > 1e5
    assert all(name == "pull: buckling" for name in found.failed)
