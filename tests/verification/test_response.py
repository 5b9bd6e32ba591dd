import dataclasses

import numpy as np
import pytest

from fea.bars import bar, tagged
from scan2fea.fea import FeaOptions, build_model, solve
from scan2fea.types import CaseResult
from scan2fea.verification.limits import limits
from scan2fea.verification.response import MEMBER_CHECKS, response_checks


@pytest.fixture(scope="module")
def solved():
    model = build_model(bar((0.2, 0.2, 1.0), (1, 1, 5)))
    return model, solve(model)


def failed(model, result):
    return {c.name for c in response_checks(model, result) if not c.passed}


def with_case(result, measure, **changes):
    cases = tuple(dataclasses.replace(c, **changes) if c.measure == measure and c.name == "self_weight" else c for c in result.cases)
    return dataclasses.replace(result, cases=cases)


def test_a_sound_answer_passes_and_every_limit_is_used(solved):
    checks = response_checks(*solved)
    assert all(c.passed for c in checks)
    of_members = {name for name, *_ in MEMBER_CHECKS}
    assert {c.name for c in checks} == {name for name in limits() if name.startswith("response.")} - of_members - {"response.calculix"}
    assert of_members < set(limits())


def of_first(result, **changes):
    return dataclasses.replace(result, fields=(dataclasses.replace(result.fields[0], **changes), *result.fields[1:]))


@pytest.mark.parametrize(("name", "cases", "measures"), MEMBER_CHECKS)
def test_a_member_that_leaves_beam_theory_fails(solved, name, cases, measures):
    model, result = solved
    limit = limits()[name]["limit"]
    for factor, passes in ((0.99, True), (1.01, False)):
        kept = tuple(c for c in result.cases if (c.name, c.measure) != (cases[-1], measures[-1]))
        row = CaseResult(name=cases[-1], measure=measures[-1], unit="m", value=1.0, expected=1.0, relative_error=limit * factor)
        off = dataclasses.replace(result, cases=(*kept, row))
        assert (name not in failed(model, off)) == passes


@pytest.mark.parametrize(("factor", "fails"), [(0.99, False), (1.01, True)])
def test_on_the_limit(solved, factor, fails):
    model, result = solved
    limit = limits()["response.reaction"]["limit"]
    off = of_first(result, reaction_n=-result.applied_n - limit * factor * result.fields[0].load_n * np.array([0, 0, 1.0]))
    assert ("response.reaction" in failed(model, off)) == fails
    limit = limits()["response.energy"]["limit"]
    assert ("response.energy" in failed(model, with_case(result, "strain_energy_j", relative_error=limit * factor))) == fails
    limit = limits()["response.residual"]["limit"]
    assert ("response.residual" in failed(model, with_case(result, "residual", value=limit * factor))) == fails
    f = np.array(result.frequencies_hz)
    f[5] = limits()["response.rigid_modes"]["limit"] * f[6] * factor
    assert ("response.rigid_modes" in failed(model, dataclasses.replace(result, frequencies_hz=f))) == fails
    u = result.displacement_m / np.linalg.norm(result.displacement_m, axis=1).max() * 0.1 * factor  # the bar is 1 m long
    assert ("response.displacement" in failed(model, of_first(result, displacement_m=u))) == fails


def test_a_negative_rigid_mode_counts_by_its_size(solved):
    model, result = solved
    f = np.array(result.frequencies_hz)
    f[0] = -0.01 * f[6]
    assert failed(model, dataclasses.replace(result, frequencies_hz=f)) == {"response.rigid_modes"}


def test_two_pieces_do_not_pass():
    one = bar((0.2, 0.2, 1.0), (1, 1, 4))
    nodes = np.concatenate([one.nodes, one.nodes + np.array([0.5, 0, 0])])
    model = build_model(tagged(nodes, np.concatenate([one.tets, one.tets + len(one.nodes)])))
    assert "response.rigid_modes" in failed(model, solve(model))


def test_what_is_missing_or_not_a_number_fails(solved):
    model, result = solved
    empty = of_first(result, displacement_m=np.full_like(result.displacement_m, np.nan), applied_n=np.zeros(3), load_n=0.0)
    empty = dataclasses.replace(empty, cases=(), frequencies_hz=np.zeros(0))
    assert failed(model, empty) == {c.name for c in response_checks(model, result)}


def test_a_wrong_unit_shows(solved):
    """The same bar read in millimetres as if they were metres: a kilometre of soft steel collapses under its weight."""
    model, _ = solved
    soft = FeaOptions(youngs_pa=1e6)
    big = build_model(dataclasses.replace(model.mesh, nodes=1000 * model.mesh.nodes), soft)
    wrong = [c for c in response_checks(big, solve(big, soft)) if not c.passed]
    assert [c.name for c in wrong] == ["response.displacement"] and "check the unit" in wrong[0].says


def test_another_answer_of_calculix_fails(solved):
    model, result = solved
    for value, passes in ((1e-6, True), (2e-3, False), (float("nan"), False)):
        row = CaseResult(name="self_weight", measure="calculix_difference", unit="share", value=value)
        found = {c.name: c.passed for c in response_checks(model, dataclasses.replace(result, cases=(*result.cases, row)))}
        assert found["response.calculix"] is passes
