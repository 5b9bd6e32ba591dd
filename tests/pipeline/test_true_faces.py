"""When the tets of true faces go the way of facets."""

import numpy as np
import pytest

from scan2fea.pipeline import true_faces
from scan2fea.pipeline.part import Made
from scan2fea.types import TetMesh


@pytest.mark.parametrize(("max_dof", "said"), [(30, "as flat as 0 deg"), (29, "30 degrees of freedom (fea.max_dof = 29)")])
def test_tets_that_the_solver_would_refuse_are_none(max_dof, said, monkeypatch):
    """The solver takes as many as its limit: then the next test speaks. A part with 344 facets on a wall of 40 mm failed, which facets convert."""
    nodes = np.random.default_rng(0).random((10, 3))
    tets = TetMesh(nodes=nodes, tets=np.arange(10)[None], boundary=np.zeros((0, 6), np.int64), face_tag=np.zeros(0, np.int64), face_names=())
    monkeypatch.setattr(true_faces, "worst_dihedral", lambda tets: 0.0)
    assert said in true_faces._problem(Made.__new__(Made), tets, max_dof)
