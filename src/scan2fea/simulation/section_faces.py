"""Which face of a member's section a point lies on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.sections import PARAMETERS, ROUND, section
from scan2fea.types import FloatArray, IntArray, Value

_ON_END = 1e-6  # of the length: a point so near to an end plane, inside the outline, lies on the end
_ON_FACE = 1e-6  # of the size of the section
_CHORDS = 1e-3  # of the diameter: chords stray from their circle


@dataclass(frozen=True, eq=False, kw_only=True)
class Located(Value):
    """face : (n,) in the order of kernel.section_likelihood.faces, -1 for points on an end.   normal : (n, 2) outward, of the face.

    n_ends : points on the two ends.
    """

    face: IntArray
    normal: FloatArray
    n_ends: tuple[int, int]

    def counts(self, n_faces: int) -> IntArray:
        """(f,) points per face."""
        return np.bincount(self.face[self.face >= 0], minlength=n_faces).astype(np.int64)


def located(family: str, parameters: Mapping[str, float], points: FloatArray) -> Located:
    """The faces of (n, 3) exact points on a member, in its own frame. Points on fillets count to the nearest face."""
    length, z = parameters["length"], points[:, 2]
    if family in ROUND:
        radii = [parameters["d"] / 2] + ([parameters["d"] / 2 - parameters["t"]] if "t" in PARAMETERS[family] else [])
        r = np.hypot(points[:, 0], points[:, 1])
        off = np.abs(r[:, None] - np.array(radii))
        on_face = off.min(axis=1) <= _CHORDS * parameters["d"]
        face = off.argmin(axis=1)
        normal = points[:, :2] / np.where(r > 0, r, 1.0)[:, None] * np.where(face == 0, 1.0, -1.0)[:, None]
    else:
        loops = section(family, parameters).loops
        start, end = np.concatenate(loops), np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
        off = np.stack([_to_segment(points[:, :2], a, b) for a, b in zip(start, end, strict=True)], axis=1)
        on_face = off.min(axis=1) <= _ON_FACE * float(np.ptp(start, axis=0).max())
        face = off.argmin(axis=1)
        along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1)[face]
    low, high = (z <= _ON_END * length) & ~on_face, (z >= (1 - _ON_END) * length) & ~on_face
    return Located(face=np.where(low | high, -1, face).astype(np.int64), normal=normal, n_ends=(int(low.sum()), int(high.sum())))


def _to_segment(p: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """(n,) distances of (n, 2) points to the segment ab."""
    along = b - a
    share = np.clip((p - a) @ along / (along @ along), 0, 1)
    return np.asarray(np.linalg.norm(p - a - share[:, None] * along, axis=1))
