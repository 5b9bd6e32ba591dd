"""What the thesis leaves open: the closed form of eq 2.20 against quadrature, and tables that tell what they say."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import Delaunay

from scan2fea.thesis import blanks
from scan2fea.thesis.bench import Bench, ThesisOptions


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return Bench(folder=tmp_path_factory.mktemp("kept"), options=ThesisOptions(quick=True))


def test_interpolation_error_is_that_of_quadrature():
    rng = np.random.default_rng(0)
    points = rng.random((9, 2))
    faces = Delaunay(points).simplices.astype(np.int64)
    # the midpoint rule of the edges is exact for quadratics
    total = 0.0
    for a, b, c in points[faces]:
        area = 0.5 * abs((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0])
        middles = [((p + q) / 2, (p @ p + q @ q) / 2) for p, q in ((a, b), (b, c), (c, a))]
        total += area / 3 * sum(flat - m @ m for m, flat in middles)
    assert blanks.interpolation_error(points, faces) == pytest.approx(total, rel=1e-12)
    moved = points + [5.0, -3.0]
    assert blanks.interpolation_error(moved, faces) == pytest.approx(total, rel=1e-9)  # |x|^2 of another origin differs by a linear function


def test_delaunay_is_the_least_of_the_two_ways_to_cut_a_quadrilateral():
    p = np.array([[0.0, 0.0], [1.0, 0.1], [1.2, 0.9], [0.1, 1.4]])
    one, other = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0, 1, 3], [1, 2, 3]])
    delaunay = {frozenset(face) for face in Delaunay(p).simplices.tolist()}
    best = min((one, other), key=lambda faces: blanks.interpolation_error(p, faces))
    assert {frozenset(face) for face in best.tolist()} == delaunay


def test_eq_2_20_falls_with_both_relaxations(bench):
    rows = blanks.eq_2_20(bench).table.rows
    for name in ("Lloyd", "ODT"):
        q = [row[2] for row in rows if row[0] == name]
        assert len(q) == 5 and all(b < a for a, b in pairwise(q))


def test_refinement_brings_the_patch_to_the_density_around(bench):
    before, plain, refined = blanks.refinement(bench).table.rows
    assert before[2] == pytest.approx(1.0, abs=0.05) and plain[3] > 3 > refined[3] and refined[4] > plain[4]
    assert plain[1] < refined[1] and plain[5] > refined[5] * 0.5 > 0
