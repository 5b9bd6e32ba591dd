"""Bodies around an object: those that reach into its box, of supports none."""

import numpy as np

from scan2fea.segmentation import bodies_around
from scan2fea.types import PointCloud, Segments


def test_bodies_in_the_box_and_a_little_beyond_it():
    rng = np.random.default_rng(0)
    own = rng.random((4000, 3)) * [0.2, 0.2, 1.0]
    on = own[:500] * [1.0, 0.2, 0.2] + [0.0, 0.205, 0.4]
    far = on + [0.0, 0.4, 0.0]
    floor = rng.random((500, 3)) * [1.0, 1.0, 0.0]
    points = np.concatenate([own, on, far, floor])
    labels = np.repeat([2, 0, 1, 3], [4000, 500, 500, 500])
    segments = Segments(labels=labels, kinds=("object", "clutter", "object", "support"), how={})
    (found,) = bodies_around(PointCloud.of(own), PointCloud.of(points), segments, 2)
    assert len(found) >= 100
    assert found[:, 1].min() >= 0.2
    assert bodies_around(PointCloud.of(far), PointCloud.of(points), segments, 1) == ()
