"""Pictures of a textured room corner with two boxes in it, rendered ray by ray: exact depths, exact cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.types import ByteArray, FloatArray

# axis-aligned boxes (low, high), metres; the first is the room, seen from within
ROOM = (np.array([-3.0, -2.0, -1.0]), np.array([3.0, 2.0, 5.0]))
BOXES = ((np.array([-1.1, -0.4, 2.9]), np.array([-0.2, 0.7, 3.6])), (np.array([0.3, -0.9, 3.3]), np.array([1.2, 0.5, 4.0])))
_OCTAVES = (3.0, 6.0, 12.0, 24.0)  # waves per metre


@dataclass(frozen=True, eq=False)
class View:
    """colour : (h, w, 3).   depth : (h, w) along the viewing axis.   T_world_camera : x right, y down, z ahead."""

    colour: ByteArray
    depth: FloatArray
    T_world_camera: FloatArray


def pose(position: tuple[float, float, float], target: tuple[float, float, float] = (0.0, 0.0, 3.5)) -> FloatArray:
    """A camera at `position` that looks at `target`; y points down as well as it can."""
    T = np.eye(4)
    z = np.subtract(target, position)
    z = z / np.linalg.norm(z)
    x = np.cross((0.0, 1.0, 0.0), z)
    x /= np.linalg.norm(x)
    T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    T[:3, 3] = position
    return T


def render(K: FloatArray, size: tuple[int, int], T_world_camera: FloatArray, *, noise: float = 1.0, seed: int = 0, fine: int = 2) -> View:
    """One picture of (width, height) pixels, `fine` x `fine` rays each."""
    width, height = size
    step = (np.arange(fine) + 0.5) / fine - 0.5
    total = np.zeros((height, width))
    for dy in step:
        for dx in step:
            total += _shade(*_cast(K, size, T_world_camera, dx, dy)[:2])
    grey = 128.0 + 90.0 * total / fine**2 + np.random.default_rng(seed).normal(0.0, noise, total.shape)
    colour = np.repeat(np.clip(np.rint(grey), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
    return View(colour=colour, depth=_cast(K, size, T_world_camera, 0.0, 0.0)[2], T_world_camera=T_world_camera)


def _cast(K: FloatArray, size: tuple[int, int], T: FloatArray, dx: float, dy: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where the rays meet (h, w, 3), number of the face (h, w), depth (h, w)."""
    x, y = np.meshgrid(np.arange(size[0]) + dx, np.arange(size[1]) + dy)
    local = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)], axis=2)
    way, eye = local @ T[:3, :3].T, T[:3, 3]
    best, face = np.full(x.shape, np.inf), np.zeros(x.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        for number, (low, high) in enumerate((ROOM, *BOXES)):
            a, b = (low - eye) / way, (high - eye) / way
            near, far = np.minimum(a, b), np.maximum(a, b)
            if number == 0:
                t, axis = far.min(axis=2), far.argmin(axis=2)
            else:
                enter, axis = near.max(axis=2), near.argmax(axis=2)
                t = np.where((enter <= far.min(axis=2)) & (enter > 0), enter, np.inf)
            face = np.where(t < best, 10.0 * number + axis, face)
            best = np.minimum(best, t)
    return eye + best[:, :, None] * way, face, best


def _shade(place: FloatArray, face: FloatArray) -> FloatArray:
    """-1 .. 1 on a surface: waves in many directions, others on each face."""
    rng = np.random.default_rng(7)
    total = np.zeros(face.shape)
    for octave in _OCTAVES:
        for _ in range(4):
            k = rng.standard_normal(3)
            k *= 2 * np.pi * octave * rng.uniform(0.7, 1.4) / np.linalg.norm(k)
            total += np.sin(place @ k + rng.uniform(0, 6.28) + 2.4 * face) / 4.0
    return np.tanh(total / 1.2)
