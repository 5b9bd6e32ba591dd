"""Ends of parts that were scanned without any noise, and points that no section begins to fit."""

from __future__ import annotations

import numpy as np
import pytest

from scan2fea.errors import EstimationError
from scan2fea.estimation import candidates
from scan2fea.estimation.edge_fit import edge_fits
from scan2fea.estimation.fit import FitOptions, fit_section


def test_points_of_an_exactly_flat_end_tell_where_it_is():
    """Patches of such an end have no length along the axis: a division by it had ended parts in an internal fault."""
    fit = edge_fits(np.full(200, 0.25), 1e-6, 0.01, 0.25, [0.0], (0.0, 1.0))[0]
    assert abs(fit.edge - 0.25) < 4.0 * fit.std < 4e-4


def test_where_no_section_begins_to_fit_is_told(monkeypatch):
    monkeypatch.setattr(candidates, "starts", lambda *_: [])
    with pytest.raises(EstimationError, match="begins to fit"):
        fit_section(np.random.default_rng(0).random((500, 3)), FitOptions(families=("L", "I")))
