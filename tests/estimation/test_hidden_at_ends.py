"""A hidden face that shows near the ends alone, past the edge of a flange, is no end face."""

import numpy as np
import pytest

from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan

BEAM = {"h": 0.258, "b": 0.178, "tw": 0.0101, "tf": 0.0143, "length": 1.06}
SEEN = ("BOTTOM_OUTER", "BOTTOM_TOE_RIGHT", "BOTTOM_INNER_RIGHT", "WEB_RIGHT", "TOP_INNER_RIGHT", "TOP_TOE_RIGHT", "TOP_OUTER")
PAST = ("TOP_INNER_LEFT", "BOTTOM_INNER_LEFT", "WEB_LEFT")


@pytest.mark.parametrize("seed", [1, 2])
def test_length_is_that_of_the_faces_that_were_seen(seed):
    rng = np.random.default_rng(seed)
    sides = [member_points("I", BEAM, n, MemberScanOptions(faces=names, seed=seed)) for n, names in ((11_000, SEEN), (6_000, PAST))]
    deep = np.minimum(sides[1][:, 2], BEAM["length"] - sides[1][:, 2])
    points = np.concatenate([sides[0], sides[1][deep < 0.015 * rng.uniform(size=len(deep))]])
    points[:, :2] += 1.6e-3 * rng.normal(size=(len(points), 2))
    length = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions(family="I")).member.parameters[-1]
    assert length.observable and abs(length.value_m - BEAM["length"]) < 3 * length.std_m < 4e-3
