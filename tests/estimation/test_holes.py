"""Holes of a member: an empty place in a face is one, but not where another body lies on it."""

import numpy as np
import pytest

from scan2fea.estimation.holes import occupied
from scan2fea.estimation.member import fit_member
from scan2fea.estimation.outline import outline_distance
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area
from scan2fea.kernel.sections import section
from scan2fea.kernel.transforms import random_rotation
from scan2fea.simulation import shapes
from scan2fea.types import PointCloud, Scan

H, SIGMA = 0.012, 0.001
SIDE = 0.15
X, Z = (0.02, 0.13), (0.5, 0.68)  # where the leg of a bracket lies on the top face


def post():
    mesh = shapes.rhs(SIDE, SIDE, 0.008, 1.5)
    points = sample_surface(mesh, round(area(mesh) / H**2), 0)[0]
    hidden = (points[:, 1] > SIDE - 1e-6) & (points[:, 0] > X[0]) & (points[:, 0] < X[1]) & (points[:, 2] > Z[0]) & (points[:, 2] < Z[1])
    return points[~hidden]


def sheet(x, z, y, h=H, seed=1):
    """Points of a plate above the top face, y metres off it."""
    n = round((x[1] - x[0]) * (z[1] - z[0]) / h**2)
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(*x, n), np.full(n, SIDE + y), rng.uniform(*z, n)]


def pipe():
    """One that goes through the opening, with points in front of the face and behind it."""
    t, y = np.meshgrid(np.linspace(0, 2 * np.pi, 40, endpoint=False), np.arange(-0.05, 0.15, 0.01))
    middle = (np.mean(X), np.mean(Z))
    return np.c_[middle[0] + 0.055 * np.cos(t).ravel(), SIDE + y.ravel(), middle[1] + 0.09 * np.sin(t).ravel()]


def fitted(*covers):
    turn = random_rotation(5)
    points = post() + SIGMA * np.random.default_rng(2).standard_normal(post().shape)
    return fit_member(Scan(cloud=PointCloud.of(points @ turn.T + [1.0, 2.0, 3.0])), covers=[c @ turn.T + [1.0, 2.0, 3.0] for c in covers])


def test_what_lies_on_a_face_hides_whether_there_is_a_hole():
    bare = fitted()
    assert not bare.explains
    assert bare.explanation.voids == 1
    told = fitted(sheet(X, Z, 0.012))
    assert told.explains
    assert "at 1 place another body lies on it" in told.reason
    assert told.member.values()["h"] == pytest.approx(SIDE, abs=0.5e-3)


@pytest.mark.parametrize(
    "cover",
    [
        sheet(X, (Z[0], 0.6), 0.012),  # over half of it
        sheet(X, Z, 0.2),  # far in front
        sheet(X, (1.0, 1.3), 0.012),  # elsewhere
        sheet(X, Z, 0.012)[:3],  # too few to be a body
        np.c_[np.linspace(*X, 50), np.full(50, SIDE), np.full(50, 0.6)],  # a line
        pipe(),
    ],
)
def test_a_hole_stays_one_beside_what_does_not_lie_on_it(cover):
    told = fitted(cover)
    assert not told.explains
    assert told.explanation.voids == 1


def test_of_two_bodies_one_is_enough_and_both_halves_are_not():
    assert fitted(sheet(X, (1.0, 1.3), 0.012), sheet(X, Z, 0.012)).explains
    assert not fitted(sheet(X, (Z[0], 0.6), 0.012), sheet((X[0], 0.07), Z, 0.012)).explains


@pytest.mark.parametrize(("ring", "n_holes"), [(0.0, 0), (0.003, 0), (0.02, 1)])
def test_what_noise_brings_over_from_the_faces_beside_encloses_no_hole(ring, n_holes):
    """The wide face of a flat that nobody saw; only a ring of its own, wider than four of the noise, shows a hole."""
    rng, width, length = np.random.default_rng(0), 0.19, 1.24
    shape = section("rect", {"b": width, "t": 0.06})
    k = [name for loop in shape.face_names for name in loop].index("TOP")
    y = shape.loops[0][k, 1]
    sides = np.c_[np.repeat([-width / 2, width / 2], 4000), y + np.sign(y) * rng.uniform(-0.05, 0.003, 8000), rng.uniform(0, length, 8000)]
    sides[:, 0] += SIGMA * rng.standard_normal(8000)
    far = np.c_[rng.uniform(-width / 2, width / 2, 9000), np.full(9000, -y), rng.uniform(0, length, 9000)]
    cap = np.c_[rng.uniform(-width / 2, width / 2, 300), np.full(300, y), rng.choice([5e-4, length - 5e-4], 300)]
    own = np.c_[rng.uniform(-width / 2, width / 2, 20_000), np.full(20_000, y), rng.uniform(0, length, 20_000)]
    off_edge = np.minimum(width / 2 - np.abs(own[:, 0]), np.minimum(own[:, 2], length - own[:, 2]))
    points = np.concatenate([sides, far, cap, own[off_edge < ring]])
    _, edge, along = outline_distance(shape, points[:, :2])
    _, holes = occupied(shape, edge, along, points[:, 2], length, SIGMA)
    assert [hole.face for hole in holes] == ["TOP"] * n_holes
