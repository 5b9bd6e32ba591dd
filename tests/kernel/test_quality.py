"""Table 2.1 of the thesis: values of the regular elements, and what each measure sees of needle, cap and sliver."""

import numpy as np
import pytest

from scan2fea.kernel.quality import (
    TET_EDGES,
    TET_LIMITS,
    TRIANGLE_LIMITS,
    scaled_jacobian,
    summary,
    tet_dihedrals,
    tet_quality,
    triangle_quality,
    worst_element,
)

EQUILATERAL = np.array([[0, 0, 0], [1, 0, 0], [0.5, 3**0.5 / 2, 0]])
REGULAR = np.array([[1, -1, -1], [1, 1, 1], [-1, 1, -1], [-1, -1, 1]], float)
FACE, TET = np.array([[0, 1, 2]]), np.array([[0, 1, 2, 3]])


def quadratic(nodes):
    """The straight TET10 over a tet."""
    return np.concatenate([nodes, nodes[TET_EDGES].mean(1)]), np.arange(10)[None]


@pytest.mark.parametrize("name", ["Q1", "Q2", "Q2_corrected", "Q3", "Q4", "Q5"])
def test_regular_elements_have_the_printed_best(name):
    assert triangle_quality(EQUILATERAL, FACE)[name][0] == pytest.approx(TRIANGLE_LIMITS[name].best, rel=1e-12)
    assert tet_quality(REGULAR, TET)[name][0] == pytest.approx(TET_LIMITS[name].best, rel=1e-12)


def test_table_of_bad_shapes():
    needle, cap = np.array([[0, 0, 0], [1, 0, 0], [1, 0.01, 0]]), np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.01, 0]])
    q = triangle_quality(needle, FACE)
    assert q["Q1"][0] == pytest.approx(0.02, abs=1e-3) and q["Q2"][0] == pytest.approx(0.498, abs=1e-2)
    assert q["Q2_corrected"][0] < 0.01 and q["Q4"][0] == pytest.approx(0.01, abs=1e-4)
    q = triangle_quality(cap, FACE)
    assert q["Q4"][0] == pytest.approx(0.5, abs=1e-3)  # blind to caps
    assert q["Q1"][0] == pytest.approx(0.04, abs=1e-2) and q["Q3"][0] < 5e-4
    t = 1e-2
    sliver = np.array([[1, 0, t], [-1, 0, t], [0, 1, -t], [0, -1, -t]])
    sliver = sliver if np.linalg.det(sliver[1:] - sliver[0]) > 0 else sliver[[1, 0, 2, 3]]
    q = tet_quality(sliver, TET)
    assert q["Q1"][0] == pytest.approx(1.41, abs=1e-2) and q["Q4"][0] == pytest.approx(0.71, abs=1e-2)  # blind to slivers
    assert q["Q3"][0] < 0.02 and q["Q5"][0] < 0.01 and q["min_dihedral_deg"][0] < 2


@pytest.mark.parametrize("seed", range(3))
def test_relations_hold_on_random_elements(seed):
    p = np.random.default_rng(seed).normal(size=(200, 4, 3))
    p[np.linalg.det(p[:, 1:] - p[:, :1]) < 0] = p[np.linalg.det(p[:, 1:] - p[:, :1]) < 0][:, [1, 0, 2, 3]]
    nodes, tets = p.reshape(-1, 3), np.arange(800).reshape(-1, 4)
    for q in (tet_quality(nodes, tets), triangle_quality(nodes, tets[:, :3])):
        np.testing.assert_allclose(q["Q3"], q["Q1"] * q["Q2"], rtol=1e-9)
        assert (q["Q1"] <= 2 * q["Q4"] + 1e-12).all()
    q = tet_quality(nodes, tets)
    for name in ("Q1", "Q2_corrected", "Q3", "Q4", "Q5", "scaled_jacobian"):
        assert (q[name] <= TET_LIMITS[name].best + 1e-12).all()
    assert (q["aspect"] >= 1 - 1e-12).all()


def test_dihedral_and_jacobian_of_known_tets():
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    angles = np.sort(tet_dihedrals(corner, TET)[0])
    np.testing.assert_allclose(angles, [54.7356] * 3 + [90] * 3, atol=1e-3)
    assert tet_quality(REGULAR, TET)["min_dihedral_deg"][0] == pytest.approx(70.5288, abs=1e-4)
    assert scaled_jacobian(REGULAR, TET)[0] == pytest.approx(1)
    assert scaled_jacobian(corner, TET)[0] == pytest.approx(2**0.5 / 2)


def test_straight_tet10_equals_its_tet4_and_a_bad_mid_node_shows():
    corner = np.array([[0, 0, 0], [1, 0.2, 0], [0.1, 1, 0], [0, 0.3, 1]], float)
    nodes, tets = quadratic(corner)
    assert scaled_jacobian(nodes, tets)[0] == pytest.approx(scaled_jacobian(corner, TET)[0], rel=1e-12)
    nodes[4] += [0.6, 0, 0]
    assert scaled_jacobian(nodes, tets)[0] < 0


def test_inverted_and_flat_elements():
    assert scaled_jacobian(REGULAR, TET[:, [1, 0, 2, 3]])[0] == pytest.approx(-1)
    flat = REGULAR * [1, 1, 0]
    q = tet_quality(flat, TET)
    assert q["Q3"][0] == q["Q5"][0] == 0 and q["aspect"][0] == np.inf
    point = triangle_quality(np.zeros((3, 3)), FACE)
    assert point["Q1"][0] == point["min_angle_deg"][0] == 0


def test_ratios_and_face_angles_of_known_elements():
    for q, limits in ((triangle_quality(EQUILATERAL, FACE), TRIANGLE_LIMITS), (tet_quality(REGULAR, TET), TET_LIMITS)):
        for name in ("edge_ratio", "radius_ratio"):
            assert q[name][0] == pytest.approx(limits[name].best, rel=1e-12) == pytest.approx(1)
    q = tet_quality(REGULAR, TET)
    assert q["collapse"][0] == pytest.approx(TET_LIMITS["collapse"].best, rel=1e-12)
    assert q["min_face_angle_deg"][0] == pytest.approx(60) and q["max_face_angle_deg"][0] == pytest.approx(60)
    q = tet_quality(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float), TET)
    assert q["edge_ratio"][0] == pytest.approx(2**0.5)
    assert q["max_face_angle_deg"][0] == pytest.approx(90) and q["min_face_angle_deg"][0] == pytest.approx(45)
    assert q["collapse"][0] == pytest.approx(3**-0.5 / (3**0.5 / 2) ** 0.5)  # height over the long face
    assert triangle_quality(np.zeros((3, 3)), FACE)["edge_ratio"][0] == np.inf


def test_summary():
    assert summary(np.arange(101.0)) == {"min": 0.0, "p01": 1.0, "median": 50.0, "p99": 99.0, "max": 100.0}
    assert summary(np.array([1.0, 2.0, np.inf]))["max"] == np.inf
    assert worst_element("Q3", np.array([0.3, 0.1, 0.2])) == 1 and worst_element("aspect", np.array([1.0, 2.0, 9.0])) == 2
    assert worst_element("Q3", np.zeros(0)) == -1
    assert np.isnan(summary(np.zeros(0))["min"])
