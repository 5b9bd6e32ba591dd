"""The loop on methods whose answers are known: a spring, a boundary, a spoilt element, an energy that lies."""

import numpy as np
import pytest

from scan2fea.kernel.relaxation import relax


class Springs:
    """Each point is drawn to its own goal; the energy is the sum of squared distances."""

    def __init__(self, goals, *, overshoot=1.0, reach=1.0):
        self.goals, self.overshoot, self.limit = np.asarray(goals, float), overshoot, reach

    def targets(self, points):
        return points + self.overshoot * (self.goals - points)

    def reach(self, points):
        return np.broadcast_to(self.limit, len(points)).astype(float)

    def projected(self, points, trial):
        return trial

    def spoiled(self, points, trial):
        return np.zeros(len(points), bool)

    def energy(self, points):
        return float(((points - self.goals) ** 2).sum())

    def reconnected(self, points):
        return False


START, GOAL = np.zeros((3, 3)), np.array([[0.3, 0, 0], [0, 2, 0], [0, 0, -5.0]])


def test_steps_are_limited_and_end_at_the_goal():
    one = relax(START, Springs(GOAL), iterations=1)
    np.testing.assert_allclose(np.linalg.norm(one.points, axis=1), [0.3, 1, 1])
    assert one.why == "iterations" and one.iterations == 1
    end = relax(START, Springs(GOAL), iterations=20)
    np.testing.assert_allclose(end.points, GOAL, atol=1e-12)
    assert end.why == "settled" and end.iterations == 5
    assert (START == 0).all()


@pytest.mark.parametrize("overshoot", [1.9, 2.5, 30.0])
def test_a_method_that_overshoots_is_halved_until_the_energy_falls(overshoot):
    found = relax(START, Springs(GOAL, overshoot=overshoot, reach=100.0), iterations=30)
    assert (np.diff(found.energies) <= 0).all()
    assert found.energies[-1] < 0.05 * found.energies[0]


def test_uphill_is_never_gone():
    found = relax(START, Springs(GOAL, overshoot=-1.0), iterations=5)
    assert found.why == "stuck" and found.iterations == 0
    assert np.array_equal(found.points, START)


def test_held_points_stay_and_only_spoilt_ones_are_put_back():
    springs = Springs(GOAL, reach=[0.0, 10.0, 10.0])
    assert np.array_equal(relax(START, springs, iterations=5).points[0], START[0])
    springs = Springs(GOAL, reach=10.0)
    springs.spoiled = lambda points, trial: (trial[:, 2] < -1) & (trial != points).any(1)
    found = relax(START, springs, iterations=1)
    np.testing.assert_allclose(found.points, [*GOAL[:2], START[2]])


def test_projection_is_what_the_energy_sees():
    springs = Springs(GOAL, reach=10.0)
    springs.projected = lambda points, trial: trial * [1, 1, 0]  # a plane
    found = relax(START, springs, iterations=10)
    np.testing.assert_allclose(found.points, GOAL * [1, 1, 0], atol=1e-12)
    assert found.energies[-1] == pytest.approx(25)
    assert found.why == "flat"
