import numpy as np
import pytest

from predicates import moved, rotation
from scan2fea.kernel.measures import volume
from scan2fea.reconstruction import reconstruct
from scan2fea.reconstruction.flat_noise import flat_noise_m
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.plane_growing import Planes
from scan2fea.simulation.polyhedra import meshed, prism
from scanned import scanned


def planes(label):
    """As many planes as labels; where they lie is not asked."""
    n = int(np.max(label)) + 1
    return Planes(normal=np.tile([0.0, 0.0, 1.0], (n, 1)), offset=np.zeros(n), label=np.asarray(label), std_m=np.zeros(n))


def test_the_noise_of_a_face_is_told_though_points_of_others_are_taken_for_its_own():
    rng = np.random.default_rng(0)
    flat = np.c_[rng.uniform(-1, 1, (300, 2)), np.zeros(300)]
    other = np.c_[rng.uniform(-1, 1, (150, 2)), rng.uniform(0, 0.2, 150)]
    assert flat_noise_m(np.vstack([flat, other]), planes(np.zeros(450, int))) < 1e-12
    noisy = flat + 0.01 * rng.standard_normal(flat.shape)
    assert flat_noise_m(noisy, planes(np.zeros(300, int))) == pytest.approx(0.01, rel=0.25)
    few = planes(np.r_[np.zeros(10, int), np.ones(290, int)])
    assert flat_noise_m(np.vstack([noisy[:10] * [1, 1, 100], noisy[10:]]), few) == pytest.approx(0.01, rel=0.25)
    assert np.isnan(flat_noise_m(noisy[:10], planes(np.zeros(10, int))))


def test_a_small_part_whose_edges_read_as_noise_is_exact():
    """All neighbourhoods of 646 points on a frame reach round edges: 0.2 spacings were told, and it was refused, or passed without 5 % of its volume.

    What the cut says of the points is no matter where sight lines have labelled the cells.
    """
    opening = [[0.1, 0.1], [0.1, 0.7], [0.9, 0.7], [0.9, 0.1]]
    for seed in (2, 4):
        frame = moved(meshed(prism([[0, 0], [1, 0], [1, 0.8], [0, 0.8]], 0.09, [opening])), rotation(seed), np.zeros(3))
        scan, _, _ = scanned(frame, 0.04, seed=seed)
        found = reconstruct(scan)
        assert not failed(found.checks)
        assert volume(found.mesh) == pytest.approx(volume(frame), rel=1e-9)
