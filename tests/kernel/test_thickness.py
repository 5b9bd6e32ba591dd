import numpy as np
import pytest

from scan2fea.kernel.thickness import places_on, thickness_at
from scan2fea.simulation.shapes import box


def test_box_is_as_thick_as_its_sides():
    mesh = box(0.3, 0.2, 0.1)
    places = places_on(mesh, seed=1, n=600)
    found = thickness_at(mesh, places)
    assert np.isfinite(found).all()
    assert sorted({round(float(t), 6) for t in found}) == pytest.approx([0.1, 0.2, 0.3])


def test_places_follow_each_wall():
    thin, thick = box(0.3, 0.2, 0.1), box(0.3, 0.2, 0.11)
    places = places_on(thin, seed=2, n=400)
    before, after = thickness_at(thin, places), thickness_at(thick, places)
    for wall, change in ((0.1, 1.1), (0.2, 1.0), (0.3, 1.0)):
        own = np.isclose(before, wall)
        assert np.median(after[own] / before[own]) == pytest.approx(change)
