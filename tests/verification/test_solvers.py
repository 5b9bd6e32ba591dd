"""The table of solvers: what each says on, just inside and just beyond its limits."""

import numpy as np
import pytest

from scan2fea.kernel.quality import TET_LIMITS, tet_quality
from scan2fea.verification.limits import limits, solver_limits
from scan2fea.verification.solvers import judged, verdicts

GOOD = {name: np.full(5, limit.best) for name, limit in TET_LIMITS.items()}


def said(order, **values):
    quality = {name: (np.concatenate([GOOD[name], [values[name]]]) if name in values else GOOD[name]) for name in GOOD}
    return verdicts(judged(quality, order))


def test_every_row_names_a_measure_that_exists_and_a_source():
    quality = tet_quality(np.eye(4, 3), np.array([[3, 0, 1, 2]]))
    for rows in solver_limits().values():
        for row in rows:
            assert row["measure"] in quality and row["source"]
            assert "warn" in row or "fail" in row
    assert not any(name.startswith("solver") for name in limits())


def test_regular_tets_are_accepted_by_all():
    assert set(said(1).values()) == set(said(2).values()) == {"accepts"}


@pytest.mark.parametrize(
    ("order", "solver", "measure", "value", "says"),
    [
        (2, "calculix", "scaled_jacobian", 1e-9, "accepts"),
        (2, "calculix", "scaled_jacobian", 0.0, "refuses"),
        (2, "calculix", "scaled_jacobian", float("nan"), "refuses"),
        (1, "optistruct", "min_dihedral_deg", 15.0, "accepts"),
        (1, "optistruct", "min_dihedral_deg", 14.99, "warns"),
        (1, "optistruct", "min_dihedral_deg", 3.0, "refuses"),
        (2, "optistruct", "min_dihedral_deg", 3.0, "warns"),
        (1, "optistruct", "max_dihedral_deg", 165.01, "warns"),
        (1, "optistruct", "max_dihedral_deg", 177.0, "refuses"),
        (2, "optistruct", "edge_ratio", 100.1, "warns"),
        (2, "optistruct", "edge_ratio", 1000.0, "refuses"),
        (2, "nastran", "aspect", 100.0, "accepts"),
        (2, "nastran", "aspect", 101.0, "warns"),
        (2, "nastran", "min_face_angle_deg", 4.9, "warns"),
    ],
)
def test_limits_and_what_lies_on_them(order, solver, measure, value, says):
    assert said(order, **{measure: value})[solver] == says


def test_the_worst_element_is_named_and_those_beyond_counted():
    quality = {**GOOD, "scaled_jacobian": np.array([1.0, -0.2, 0.5, -0.1, 1.0])}
    row = next(row for row in judged(quality, 2) if row.solver == "calculix")
    assert (row.element, row.value, row.n_beyond, row.says) == (1, -0.2, 2, "refuses")
    assert judged({name: np.zeros(0) for name in GOOD}, 2)[0].element == -1
