"""Where a member ends on a neighbour: a mitre that the fit took for square, a saddle, an end that nothing is near."""

import numpy as np

from estimation.made import made, scanned
from scan2fea.estimation.joined import ended_at, joints

S = np.sqrt(0.5)
SIZES = {"h": 0.08, "b": 0.06, "t": 0.004}


def test_a_mitre_is_found_where_the_sides_end():
    mitred = made("RHS", 0.4, SIZES, normals=((0, -S, -S), (0, 0, 1)))
    points = scanned(mitred, 12_000, 0.0005, 0)
    away = points @ [0.0, S, S]
    neighbour = points - 2 * away[:, None] * np.array([0.0, S, S])  # the other arm of the knee
    square = made("RHS", 0.44, SIZES, shift=(0, 0, -0.04))  # as far as any side reaches
    low, high = joints(points, square, [neighbour])
    assert high is None
    assert low.is_plane
    np.testing.assert_allclose(low.slope, [0, -1], atol=0.05)
    np.testing.assert_allclose(low.position_m, 0.04, atol=2 * low.std_m)
    found = ended_at(square, low, high, 1e-4)
    np.testing.assert_allclose(found.values()["length"], 0.4, atol=2 * low.std_m)
    np.testing.assert_allclose(found.end_normals, [[0, -S, -S], [0, 0, 1]], atol=0.03)
    np.testing.assert_allclose(found.T_world_member[:3, 3], 0.0, atol=2 * low.std_m)
    assert found.parameters[-1].std_m >= low.std_m


def test_a_saddle_is_no_plane():
    stub = made("CHS", 0.3, {"d": 0.06, "t": 0.004})
    points = scanned(stub, 8_000, 0.0003, 1)
    points = points[points[:, 2] > 0.04 - np.sqrt(0.04**2 - points[:, 0] ** 2)]  # down to a tube of 80 mm
    rim = points[points[:, 2] < 0.02]
    low, _ = joints(points, stub, [rim - [0, 0, 0.004]])
    assert low is not None
    assert not low.is_plane


def test_an_end_that_nothing_is_near_is_no_joint():
    stub = made("RHS", 0.3, SIZES)
    points = scanned(stub, 6_000, 0.0005, 2)
    assert joints(points, stub, []) == (None, None)
    assert joints(points, stub, [points + [0, 0, 1.0]]) == (None, None)
    assert joints(points, stub, [points[points[:, 0] > 0.029] + [0.002, 0, 0]]) == (None, None)  # lies along one side
