"""Poses multiplied along a chain: T_0_k = T_0_(k-1) T_(k-1)_k (thesis 2.3.1; multiplied, not "added")."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.kernel.transforms import compose
from scan2fea.types import FloatArray, IntArray


def concatenate(T_previous_next: Sequence[FloatArray], T_world_first: FloatArray | None = None) -> FloatArray:
    """(k + 1, 4, 4) poses of frames 0..k from the k motions between neighbours; the first is the identity unless given."""
    poses = [np.eye(4) if T_world_first is None else np.asarray(T_world_first, float)]
    for T in T_previous_next:
        poses.append(compose(poses[-1], T))
    return np.stack(poses)


def along_tree(
    n: int, pairs: IntArray, T_target_source: FloatArray, order: Sequence[int], root_poses: dict[int, FloatArray]
) -> dict[int, FloatArray]:
    """Poses reached from the roots along links, taken in `order` as often as one of its ends is known and the other is not.

    pairs : (m, 2) target, source.   T_target_source : (m, 4, 4). A link later in `order` is used only where no earlier one reaches.
    """
    require(all(0 <= k < n for k in root_poses), InternalError, "a root is no frame")
    poses = dict(root_poses)
    grown = True
    while grown:
        grown = False
        for link in order:
            target, source = int(pairs[link, 0]), int(pairs[link, 1])
            if target in poses and source not in poses:
                poses[source] = poses[target] @ T_target_source[link]
            elif source in poses and target not in poses:
                poses[target] = poses[source] @ np.linalg.inv(T_target_source[link])
            else:
                continue
            grown = True
            break
    return poses
