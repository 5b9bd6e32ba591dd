"""Points on exact grids: no order but that of the file tells a camera."""

from __future__ import annotations

import numpy as np
import pytest

from scan2fea.reconstruction import reconstruct
from scan2fea.simulation.shapes import box, l_beam, plate
from scan2fea.types import PointCloud, Scan


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
