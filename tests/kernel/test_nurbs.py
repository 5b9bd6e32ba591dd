"""Rational B-splines against Open Cascade, the definition, and surfaces that are known exactly."""

import numpy as np
import pytest
from OCP.collections import Array1_double, Array1_int, Array2_double, Array2_gp_Pnt
from OCP.Geom import Geom_BSplineSurface
from OCP.gp import gp_Pnt, gp_Vec

from scan2fea.errors import InternalError
from scan2fea.kernel.nurbs import NurbsSurface, basis, basis_slopes, interpolated, uniform_knots


def knots_of(rng, n, degree):
    inner = np.sort(rng.random(n - degree - 1))
    if len(inner) > 2 and degree > 1:
        inner[1] = inner[0]  # a double knot
    return np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])


def surface(seed, shape=(7, 6), degrees=(3, 2)):
    rng = np.random.default_rng(seed)
    return NurbsSurface(points=rng.standard_normal((*shape, 3)), weights=rng.uniform(0.3, 3.0, shape),
                        knots_u=knots_of(rng, shape[0], degrees[0]), knots_v=knots_of(rng, shape[1], degrees[1]))  # fmt: skip


def in_occ(s):
    n, m = s.weights.shape
    poles, weights = Array2_gp_Pnt(1, n, 1, m), Array2_double(1, n, 1, m)
    for i in range(n):
        for j in range(m):
            poles.SetValue(i + 1, j + 1, gp_Pnt(*s.points[i, j].tolist()))
            weights.SetValue(i + 1, j + 1, float(s.weights[i, j]))
    lists = []
    for knots in (s.knots_u, s.knots_v):
        value, count = np.unique(knots, return_counts=True)
        values, counts = Array1_double(1, len(value)), Array1_int(1, len(value))
        for k in range(len(value)):
            values.SetValue(k + 1, float(value[k]))
            counts.SetValue(k + 1, int(count[k]))
        lists.append((values, counts))
    return Geom_BSplineSurface(poles, weights, lists[0][0], lists[1][0], lists[0][1], lists[1][1], *s.degrees)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("degrees", [(3, 2), (1, 4), (2, 2)])
def test_points_and_normals_are_those_of_open_cascade(seed, degrees):
    s = surface(seed, degrees=degrees)
    rng = np.random.default_rng(seed)
    u, v = np.concatenate([rng.random(30), [0, 1, 0, 1]]), np.concatenate([rng.random(30), [0, 0, 1, 1]])
    other, p, du, dv = in_occ(s), gp_Pnt(), gp_Vec(), gp_Vec()
    got, normals = s.at(u, v), s.normals(u, v)
    for k in range(len(u)):
        other.D1(float(u[k]), float(v[k]), p, du, dv)
        assert got[k] == pytest.approx([p.X(), p.Y(), p.Z()], abs=1e-12)
        cross = np.cross([du.X(), du.Y(), du.Z()], [dv.X(), dv.Y(), dv.Z()])
        assert normals[k] == pytest.approx(cross / np.linalg.norm(cross), abs=1e-9)


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 5])
def test_basis_functions_are_positive_and_add_up_to_one(degree):
    knots = knots_of(np.random.default_rng(1), 9, degree)
    u = np.concatenate([np.linspace(0, 1, 101), knots])
    values = basis(knots, degree, u)
    assert (values >= 0).all()
    assert values.sum(1) == pytest.approx(1.0, abs=1e-14)
    assert (np.count_nonzero(values, axis=1) <= degree + 1).all()


def test_slopes_are_those_of_differences():
    knots = knots_of(np.random.default_rng(2), 8, 3)
    u, h = np.linspace(0.05, 0.95, 37), 1e-6
    u = u[np.abs(u[:, None] - knots).min(1) > 1e-3]
    wanted = (basis(knots, 3, u + h) - basis(knots, 3, u - h)) / (2 * h)
    assert basis_slopes(knots, 3, u) == pytest.approx(wanted, abs=1e-6)


def test_a_quarter_of_a_cylinder_is_exact():
    root = np.sqrt(0.5)
    arc = np.array([[1.0, 0, 0], [1, 1, 0], [0, 1, 0]])
    s = NurbsSurface(points=np.stack([arc, arc + [0, 0, 2]], axis=1), weights=np.array([[1, 1], [root, root], [1, 1]]),
                     knots_u=np.array([0, 0, 0, 1, 1, 1.0]), knots_v=np.array([0, 0, 1, 1.0]))  # fmt: skip
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 5)))
    at = s.at(u, v)
    assert np.hypot(at[:, 0], at[:, 1]) == pytest.approx(1.0, abs=1e-14)
    assert s.normals(u, v)[:, :2] == pytest.approx(at[:, :2], abs=1e-12)


def test_interpolation_passes_through_its_points_and_neighbours_share_their_border():
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((9, 9, 3)), rng.standard_normal((9, 9, 3))
    b[0] = a[-1]
    first, second = interpolated(a), interpolated(b)
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9), indexing="ij"))
    assert first.at(u, v) == pytest.approx(a.reshape(-1, 3), abs=1e-12)
    assert first.points[-1] == pytest.approx(second.points[0], abs=1e-13)


def test_its_error_falls_with_the_fourth_power_of_the_spacing():
    errors = []
    for n in (9, 17, 33):
        g = np.linspace(0, 1, n)
        x, y = np.meshgrid(g, g, indexing="ij")
        s = interpolated(np.stack([x, y, np.sin(3 * x) * np.cos(2 * y)], axis=-1))
        u = np.random.default_rng(0).random((2, 400))
        at = s.at(u[0], u[1])
        errors.append(np.abs(at[:, 2] - np.sin(3 * at[:, 0]) * np.cos(2 * at[:, 1])).max())
    assert np.polyfit(np.log([1 / 8, 1 / 16, 1 / 32]), np.log(errors), 1)[0] > 3.5


def test_what_cannot_be_is_refused():
    with pytest.raises(InternalError, match="too few"):
        uniform_knots(3, 3)
    with pytest.raises(InternalError, match="outside"):
        basis(uniform_knots(6, 3), 3, np.array([1.1]))
    with pytest.raises(InternalError, match="knots"):
        basis(np.array([0, 1, 0.5, 2]), 1, np.array([0.5]))
