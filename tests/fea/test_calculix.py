import shutil
from dataclasses import replace

import numpy as np
import pytest

from fea.bars import bar
from scan2fea.errors import SolveError
from scan2fea.fea import FeaOptions, build_model, calculix, solve
from scan2fea.fea.calculix import second_opinion

BAR = bar((0.1, 0.1, 0.4), (1, 1, 3))
OPTIONS = FeaOptions(solver="calculix", loads=("push: ALL gravity 3 0 0",))
MODEL = build_model(BAR, OPTIONS)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_calculix_agrees_in_every_case():
    cases = solve(MODEL, OPTIONS).cases
    found = {c.name: c.value for c in cases if c.measure == "calculix_difference"}
    assert set(found) == {"self_weight", "push"} and max(found.values()) < 2e-6  # its file has six digits
    fields = solve(MODEL, FeaOptions(loads=OPTIONS.loads)).fields
    wrong = tuple(replace(f, displacement_m=f.displacement_m * np.array([1.0, 1.0, 1.01])) for f in fields)
    assert max(c.value for c in second_opinion(MODEL, wrong)) > 1e-3


@pytest.mark.parametrize(
    ("program", "says"), [("", "there is no program"), ("echo '*ERROR: no licence'; exit 3", "exit code 3: .ERROR: no licence"), ("true", "0 of 2")]
)
def test_without_an_answer_the_second_opinion_fails_alone(program, says, tmp_path, monkeypatch):
    path = tmp_path / "other"
    if program:
        path.write_text(f"#!/bin/sh\n{program}\n")
        path.chmod(0o755)
    monkeypatch.setattr(calculix, "PROGRAM", str(path))
    found = solve(MODEL, OPTIONS)
    assert set(found.failed) == {"calculix"} and len(found.fields) == 2
    with pytest.raises(SolveError, match=says):
        second_opinion(MODEL, found.fields)


def test_a_limit_of_time(tmp_path, monkeypatch):
    path = tmp_path / "slow"
    path.write_text("#!/bin/sh\nsleep 30\n")
    path.chmod(0o755)
    monkeypatch.setattr(calculix, "PROGRAM", str(path))
    with pytest.raises(SolveError, match="stopped after"):
        second_opinion(MODEL, (), limit_s=0.05)
