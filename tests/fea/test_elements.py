import itertools
import math

import numpy as np
import pytest

from fea.bars import EDGES, bar, boundary_of
from scan2fea.fea.elements import FACES, quadrature, shape, shape_gradient, surface_volume


@pytest.mark.parametrize("degree", [1, 2, 5])
def test_quadrature_is_exact_to_its_degree(degree):
    points, weights = quadrature(degree)
    assert np.allclose(points.sum(axis=1), 1) and (weights > 0).all() and (points > 0).all()
    for powers in itertools.product(range(degree + 1), repeat=4):
        if sum(powers) <= degree:
            # integral of the monomial over the simplex, divided by its volume
            exact = 6 * math.prod(math.factorial(p) for p in powers) / math.factorial(sum(powers) + 3)
            assert weights @ np.prod(points ** np.array(powers), axis=1) == pytest.approx(exact, rel=1e-13)


@pytest.mark.parametrize("n_nodes", [4, 10])
def test_shape_functions_are_one_at_their_node_and_sum_to_one(n_nodes):
    corners = np.eye(4)
    nodes = np.concatenate([corners, [(corners[i] + corners[j]) / 2 for i, j in EDGES]])[:n_nodes]
    assert np.allclose(shape(nodes, n_nodes), np.eye(n_nodes))
    points, _ = quadrature(5)
    assert np.allclose(shape(points, n_nodes).sum(axis=1), 1)
    assert np.allclose(shape_gradient(points, n_nodes).sum(axis=1), 0)


@pytest.mark.parametrize("n_nodes", [4, 10])
def test_gradient_is_the_difference_quotient(n_nodes):
    points, _ = quadrature(2)
    for axis in range(3):
        step = np.zeros(4)
        step[0], step[axis + 1] = -1e-6, 1e-6
        numeric = (shape(points + step, n_nodes) - shape(points - step, n_nodes)) / 2e-6
        assert np.allclose(shape_gradient(points, n_nodes)[:, :, axis], numeric, atol=1e-8)


def test_faces_are_outward():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    for i, j, k in FACES:
        normal = np.cross(corners[j] - corners[i], corners[k] - corners[i])
        assert normal @ (corners[i] - corners.mean(axis=0)) < 0  # Abaqus lists S1..S4 inward; only the set of corners is used


@pytest.mark.parametrize("order", [1, 2])
def test_surface_volume_of_a_box_far_from_the_origin(order):
    mesh = bar((2.0, 0.5, 0.25), (3, 2, 2), order=order)
    assert surface_volume(mesh.nodes + 1000.0, mesh.boundary) == pytest.approx(0.25, rel=1e-12)


def test_surface_volume_of_curved_sides_is_that_of_the_elements():
    mesh = bar((1.0, 1.0, 1.0), (2, 2, 2))
    x = mesh.nodes + 0.05 * np.sin(3 * mesh.nodes[:, [1, 2, 0]])
    points, weights = quadrature(5)
    jacobian = np.einsum("mna,qnc->mqac", x[mesh.tets], shape_gradient(points, 10))
    exact = (np.linalg.det(jacobian) @ weights).sum() / 6
    assert surface_volume(x, boundary_of(mesh.tets)) == pytest.approx(exact, rel=1e-12)
