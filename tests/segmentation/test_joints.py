"""Short members that meet: a tee of equal tubes of which one corner was seen, a knee; one tube stays one."""

import numpy as np
import pytest

from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation import joined_members
from welded import X, Y, Z, face, knee, tee


@pytest.mark.parametrize("shape", [tee, knee])
def test_members_that_meet_are_told_apart_and_share_the_joint(shape):
    one, other = shape(np.random.default_rng(3))
    points = np.concatenate([one, other]) @ random_rotation(3).T + [1.0, -2.0, 3.0]
    labels = joined_members(points)
    assert labels is not None
    assert labels.max() == 1
    assert (labels == np.repeat([0, 1], [len(one), len(other)])).mean() > 0.97


def test_one_tube_and_a_patch_are_not_taken_apart():
    rng = np.random.default_rng(4)
    assert joined_members(np.concatenate([face((0, 0, 0), 0.3 * X, 0.05 * Z, rng), face((0, 0, 0.05), 0.3 * X, 0.05 * Y, rng)])) is None
    assert joined_members(face((0, 0, 0), 0.2 * X, 0.15 * Z, rng)) is None
    assert joined_members(rng.random((50, 3))) is None
