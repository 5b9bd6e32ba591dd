import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, box, l_beam, sphere
from scan2fea.kernel.measures import area, volume
from scan2fea.kernel.short_edges import with_short_edges
from scan2fea.kernel.topology import edge_table


@pytest.mark.parametrize("mesh", [box((1.0, 0.4, 0.01)), l_beam(0.08, 0.06, 0.006, 0.15), sphere(0.1, rounds=2)], ids=["plate", "L", "sphere"])
@pytest.mark.parametrize("longest", [0.03, 0.011])
def test_the_surface_stays_and_its_edges_are_short(mesh, longest):
    fine = with_short_edges(mesh, longest)
    assert_closed_manifold_oriented(fine)
    ends = fine.vertices[edge_table(fine.faces).edges]
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() <= longest
    assert area(fine) == pytest.approx(area(mesh), rel=1e-12) and volume(fine) == pytest.approx(volume(mesh), rel=1e-12)
    assert len(fine.faces) < 40 * area(mesh) / longest**2


def test_short_edges_are_left_alone():
    mesh = sphere(0.1, rounds=2)
    same = with_short_edges(mesh, 1.0)
    assert np.array_equal(same.faces, mesh.faces) and np.array_equal(same.vertices, mesh.vertices)
