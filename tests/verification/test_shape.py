"""A hole of the part that the final geometry has lost must be told, whatever the volume says."""

import numpy as np
import pytest

from predicates import box, sphere, torus
from scan2fea.kernel.coverage import deviation
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.topology import surface_topology
from scan2fea.simulation.shapes import bracket
from scan2fea.types import TriangleMesh
from scan2fea.verification.shape import deviation_checks, drift_checks, free_form_checks

H, SIGMA = 0.0025, 0.0003
BORED = bracket(0.1, 0.12, 0.01, 0.12, [("a", 0.055, 0.03, 0.012), ("b", 0.07, 0.06, 0.012)])
PLAIN = bracket(0.1, 0.12, 0.01, 0.12, [])


def _checks(mesh):
    rng = np.random.default_rng(0)
    points = sample_surface(BORED, 8000, 1)[0]
    found = deviation(mesh, points + SIGMA * rng.normal(size=points.shape), H, SIGMA)
    return {c.name: c for c in (*deviation_checks(found, H, SIGMA), *free_form_checks(found, 0.0))}


def test_points_of_a_lost_hole_are_stray():
    right, wrong = _checks(BORED), _checks(PLAIN)
    assert all(c.passed for c in right.values())
    assert wrong["shape.deviation_p95"].passed  # the bores are 3 % of the points: the percentile does not see them
    assert not wrong["shape.stray_points"].passed and "a hole or a part was lost" in wrong["shape.stray_points"].says


@pytest.mark.parametrize(("mesh", "handles"), [(sphere(), 0), (torus(), 1), (box(), 0), (BORED, 2), (PLAIN, 0)])
def test_handles_are_holes_that_go_through(mesh, handles):
    assert surface_topology(mesh).n_handles == handles
    two = TriangleMesh(vertices=np.vstack([mesh.vertices, mesh.vertices + 10]), faces=np.vstack([mesh.faces, mesh.faces + len(mesh.vertices)]))
    assert surface_topology(two).n_handles == 2 * handles


def test_a_hole_that_came_or_went_fails():
    for change, passed in ((0, True), (1, False), (-2, False)):
        check = next(c for c in drift_checks(1.0, 1.0, 0.0, change) if c.name == "shape.holes_changed")
        assert check.passed is passed
