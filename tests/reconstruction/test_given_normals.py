"""Clouds whose file gives normals and no sensor positions: the normals tell the outside where no ball does."""

from __future__ import annotations

import numpy as np
import pytest

from predicates import sphere
from scan2fea.kernel.measures import volume
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import reconstruct
from scan2fea.reconstruction.evidence import BY_FLOOD, BY_NORMALS
from scan2fea.reconstruction.gates import failed
from scan2fea.types import PointCloud, Scan
from scanned import scanned

BALL = sphere(0.5)


@pytest.fixture(scope="module")
def pierced():
    """Points of a ball and their normals, 12 degrees off; a patch of four spacings' radius is missing, through which the flood runs in."""
    scan, places, normals = scanned(BALL, 0.05, seed=1)
    keep = np.linalg.norm(places - places[7], axis=1) > 0.2
    leaning = normals + 0.2 * np.random.default_rng(4).normal(size=normals.shape)
    return scan.cloud.points[keep], (leaning / np.linalg.norm(leaning, axis=1)[:, None])[keep]


def of(points, normals=None):
    return reconstruct(Scan(cloud=PointCloud.of(points, normals=normals)))


def test_the_balls_answer_is_refused_and_that_by_normals_passes(pierced):
    points, normals = pierced
    ball, given = of(points), of(points, normals)
    assert ball.source == BY_FLOOD and failed(ball.checks)
    assert given.source == BY_NORMALS and not failed(given.checks)
    assert volume(given.mesh) == pytest.approx(volume(BALL), rel=0.03) and surface_topology(given.mesh).n_handles == 0


def test_normals_that_all_look_inwards_are_turned(pierced):
    points, normals = pierced
    assert volume(of(points, -normals).mesh) == volume(of(points, normals).mesh)


def test_normals_without_a_side_are_not_believed(pierced):
    points, normals = pierced
    side = np.random.default_rng(1).choice([-1.0, 1.0], len(points))
    assert failed(of(points, side[:, None] * normals).checks)
