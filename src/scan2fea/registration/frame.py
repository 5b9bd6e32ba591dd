"""The intrinsic frame of a key point: the axes of its scatter, whose signs are free (thesis 2.3.1)."""

from __future__ import annotations

import numpy as np

from scan2fea.types import FloatArray, IntArray

# the four right-handed frames that share their axes: half turns about e1, e2, e3
SIGNS = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])


def right_handed(axes: FloatArray) -> FloatArray:
    """(n, 3, 3) frames with columns e1, e2 and e3 = e1 x e2, from unit axes in columns."""
    frames = np.array(axes, float)
    frames[:, :, 2] = np.cross(frames[:, :, 0], frames[:, :, 1])
    return frames


def sign_variants(frames: FloatArray) -> FloatArray:
    """(n, 4, 3, 3): each frame in its four orientations."""
    turned: FloatArray = frames[:, None] * SIGNS[None, :, None, :]
    return turned


def toward(frames: FloatArray, normals: FloatArray, is_seen: np.ndarray) -> FloatArray:
    """The frames with e3 turned to the outward normal where that is known: two of the four orientations are left."""
    away = is_seen & (np.einsum("nc,nc->n", frames[:, :, 2], normals) < 0)
    return np.where(away[:, None, None], frames * SIGNS[1], frames)


def variants_left(is_seen: bool) -> IntArray:
    """Orientations that must be tried: all four, or the two that leave e3."""
    return np.array([0, 3] if is_seen else [0, 1, 2, 3])
