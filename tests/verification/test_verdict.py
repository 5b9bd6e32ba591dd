import math

import pytest

from scan2fea.types import Check
from scan2fea.verification.limits import above, at_least, at_most, limits
from scan2fea.verification.verdict import verdict


def check(passed, name="a", says="because"):
    return Check(name=name, value=1.0, limit=2.0, unit="m", passed=passed, says=says)


def test_conjunction_and_first_reason():
    assert verdict([check(True), check(True)]).name == "converted"
    found = verdict([check(True), check(False, "b", "first"), check(False, "c", "second")])
    assert (found.name, found.reason) == ("failed", "first")


def test_nothing_checked_or_missing_is_never_converted():
    assert verdict([]).name == "failed"
    assert verdict([check(True)], missing=["solid"]).name == "failed"
    assert verdict([check(True)], stopped="it stopped").reason == "it stopped"


@pytest.mark.parametrize(
    ("made", "passed"),
    [
        (at_most("tets.max_dihedral", 175.0), True),
        (at_most("tets.max_dihedral", 175.0001), False),
        (above("tets.min_dihedral", 5.0), False),
        (above("tets.min_dihedral", 5.0001), True),
        (at_least("shape.measured_area", 0.9), True),
        (at_least("shape.measured_area", 0.8999), False),
        (at_most("tets.max_dihedral", math.nan), False),
        (above("tets.min_dihedral", math.nan), False),
    ],
)
def test_on_the_threshold(made, passed):
    assert made.passed is passed


def test_every_limit_says_something_about_its_value():
    for name, row in limits().items():
        assert row["says"] and row["unit"], name
        assert "{value" in row["says"], name
