"""How far the answers of a member are known, where its dimensions are measured and where one is assumed."""

import dataclasses
import math

import numpy as np
import pytest

from estimation.made import made
from scan2fea.fea.budget import budget
from scan2fea.types import Material

STEEL = Material(name="steel", youngs_pa=210e9, poisson=0.3, density_kg_m3=7850, yield_pa=None, source="EN 1993-1-1")
THIN = {"d": 0.2, "t": 0.002}


def assumed(member, name, spread_m):
    """`member` of which `name` stands for something that the points did not tell."""
    k = [p.name for p in member.parameters].index(name)
    unknown = dataclasses.replace(member.parameters[k], observable=False, std_m=None, source="catalogue", spread_m=spread_m)
    covariance = np.array(member.covariance)
    covariance[k], covariance[:, k] = 0.0, 0.0
    return dataclasses.replace(member, parameters=(*member.parameters[:k], unknown, *member.parameters[k + 1 :]), covariance=covariance)


def test_a_measured_rod_in_closed_form():
    """Extension 4 F L / (pi d^2 E): its relative variance is (2 dd / d)^2 + (dL / L)^2."""
    found = budget(made("round", 2.0, std=5e-4), STEEL, 1000.0, 400, 1)
    expected = math.hypot(2 * 5e-4 / 0.05, 5e-4 / 2.0)
    assert found.first_order_std["tension"] / found.value["tension"] == pytest.approx(expected, rel=1e-3)
    assert found.std["tension"] / found.value["tension"] == pytest.approx(expected, rel=0.12)  # 400 draws
    assert found.assumed == ()


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_an_assumed_wall_is_in_every_bar(share):
    """The mass of a thin tube goes with its wall, what gives way with one over it: log-normal draws give both the half width sinh(s)."""
    sure = made("CHS", 3.0, THIN, std=1e-9)
    found = budget(assumed(sure, "t", share * THIN["t"]), STEEL, 1000.0, 2000, 1)
    half = math.sinh(math.sqrt(math.log1p(share**2)))
    assert found.assumed == ("t",) and found.n_samples == 2000
    for name in ("mass_kg", "tension", "twist", "bend_x_x"):
        assert found.std[name] / found.value[name] == pytest.approx(half, rel=0.1), name
    assert budget(sure, STEEL, 1000.0, 50, 1).std["mass_kg"] < 1e-4 * found.std["mass_kg"]


def test_a_stand_in_of_which_nothing_is_known_adds_nothing_and_is_named():
    one = budget(assumed(made("CHS", 3.0, THIN), "t", None), STEEL, 1000.0, 50, 1)
    assert one.assumed == ("t",) and 0 < one.std["mass_kg"] < 0.01 * one.value["mass_kg"]
