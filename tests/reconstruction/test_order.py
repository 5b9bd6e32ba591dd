"""Points on exact grids, or of few digits: no order but that of the file tells a camera, and what was rounded is told."""

from __future__ import annotations

import numpy as np
import pytest

from predicates import rotation
from scan2fea.reconstruction import reconstruct
from scan2fea.reconstruction.budget import ROUNDED
from scan2fea.reconstruction.coordinate_rounding import with_rounding
from scan2fea.simulation.shapes import box, bracket, l_beam, plate
from scan2fea.types import PointCloud, Scan
from scanned import scanned


def gridded(mesh, pitch):
    """Points of a grid on each triangle, in the order of their coordinates."""
    out = []
    for a, b, c in mesh.vertices[mesh.faces]:
        n = int(max(np.linalg.norm(b - a), np.linalg.norm(c - a)) / pitch) + 1
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
        i, j = i[i + j <= n] / n, j[i + j <= n] / n
        out.append(a + i[:, None] * (b - a) + j[:, None] * (c - a))
    return np.unique(np.round(np.concatenate(out), 9), axis=0)


@pytest.mark.parametrize("mesh", [box(0.2, 0.1, 0.05), plate(0.2, 0.02, 0.3), l_beam(0.1, 0.1, 0.02, 0.4)])
def test_exact_faces_in_the_order_of_a_space_filling_curve_were_seen_by_no_camera(mesh):
    """Rows in parallel planes, or of millions of pixels, had ended in internal faults."""
    assert reconstruct(Scan(cloud=PointCloud.of(gridded(mesh, 0.012)))).source == "outside flood"


def test_coordinates_of_few_digits_leave_the_thickness_of_a_plate_open():
    """A plate of 9.4 mm written in whole millimetres has 9 or 10; one that leans is rounded up and down along its faces."""
    mesh = bracket(0.09, 0.06, 0.0094, 0.06, [("a", 0.05, 0.03, 0.0055)], 2e-5)
    flat = scanned(mesh, 0.003, seed=2)[1] + 3e-4
    found = {check.name: check for check in reconstruct(Scan(cloud=PointCloud.of(np.round(flat, 3)))).checks}
    assert not found[ROUNDED].passed and "whole steps of 1 mm" in found[ROUNDED].says
    assert ROUNDED not in {check.name for check in reconstruct(Scan(cloud=PointCloud.of(flat))).checks}
    leaning = with_rounding(reconstruct(Scan(cloud=PointCloud.of(np.round(flat @ rotation(2).T, 3)))), 1e-3)
    assert {check.name: check for check in leaning.checks}[ROUNDED].passed
