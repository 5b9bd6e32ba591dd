"""Small symmetric matrices against LAPACK, products of vectors against numpy."""

import numpy as np
import pytest

from scan2fea.kernel.small_matrices import cross, eigh_3, solve_definite


def test_a_product_of_vectors_has_the_bits_of_numpys():
    for a, b in np.random.default_rng(0).normal(size=(200, 2, 3)):
        assert cross(a, b).tobytes() == np.cross(a, b).tobytes()


@pytest.mark.parametrize("seed", range(20))
def test_eigenvalues_and_axes_give_the_matrix_back(seed):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(6, 3)) * 10.0 ** rng.uniform(-6, 0, 3)
    matrix = rows.T @ rows
    values, axes = np.empty(3), np.empty((3, 3))
    eigh_3(matrix.copy(), values, axes)
    assert np.abs(values - np.linalg.eigvalsh(matrix)).max() < 1e-14 * np.trace(matrix)
    assert np.abs(axes * values @ axes.T - matrix).max() < 1e-14 * np.trace(matrix)
    assert np.abs(axes.T @ axes - np.eye(3)).max() < 1e-14
    assert (np.diff(values) >= 0).all()


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.eye(3), np.ones((3, 3)), np.diag([3.0, 1.0, 2.0])])
def test_equal_and_vanishing_eigenvalues(matrix):
    values, axes = np.empty(3), np.empty((3, 3))
    eigh_3(matrix.copy(), values, axes)
    assert np.allclose(values, np.linalg.eigvalsh(matrix), atol=1e-15)
    assert np.allclose(axes * values @ axes.T, matrix, atol=1e-15)


@pytest.mark.parametrize("n", [1, 2, 6])
def test_the_solution_solves_the_system(n):
    rng = np.random.default_rng(n)
    rows, right = rng.normal(size=(3 * n, n)), rng.normal(size=n)
    matrix, found = rows.T @ rows, right.copy()
    solve_definite(matrix.copy(), found)
    assert np.allclose(found, np.linalg.solve(matrix, right), rtol=1e-12)
