"""Points of pipes with elbows, drawn evenly over their skins and end faces; any pose."""

import dataclasses

import numpy as np

from scan2fea.kernel.bends import bent
from scan2fea.kernel.transforms import applied, random_rotation, rigid
from scan2fea.types import Bend


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pipe:
    """runs : lengths of the straight parts, one more than turns (angle, roll in radians).   radius : of the bends' axis.   Lengths in metres."""

    d: float
    t: float
    runs: tuple
    turns: tuple
    radius: float

    @property
    def bends(self):
        out, at = [], 0.0
        for run, (angle, roll) in zip(self.runs, self.turns, strict=False):
            out.append(Bend(start_m=at + run, angle_rad=angle, radius_m=self.radius, roll_rad=roll))
            at = out[-1].start_m + out[-1].length_m
        return tuple(out)

    @property
    def length(self):
        return sum(self.runs) + self.radius * sum(angle for angle, _ in self.turns)


def curvature(pipe, xy, z):
    """(n,) how far places across the axis lie towards the centre of the bend they are in, over its radius; 0 on runs."""
    out = np.zeros(len(z))
    for bend in pipe.bends:
        own = (z > bend.start_m) & (z < bend.start_m + bend.length_m)
        out[own] = xy[own] @ [np.cos(bend.roll_rad), np.sin(bend.roll_rad)] / bend.radius_m
    return out


def points_of(pipe, spacing, sigma=0.0, seed=0, inside=True, caps=True):
    """((n, 3) points, (4, 4) pose of the first end)."""
    rng = np.random.default_rng(seed)
    parts = []
    for r in (pipe.d / 2, *((pipe.d / 2 - pipe.t,) if inside else ())):
        n = int(2 * np.pi * r * pipe.length / spacing**2)
        angle, z = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, pipe.length, n)
        xy = r * np.column_stack([np.cos(angle), np.sin(angle)])
        area = 1 - curvature(pipe, xy, z)  # outside of a bend there is more of the skin
        kept = rng.uniform(0, 1 + r / pipe.radius, n) < area
        parts.append(np.column_stack([xy, z])[kept])
    for z in (0.0, pipe.length) if caps else ():
        n = int(np.pi * pipe.t * (pipe.d - pipe.t) / spacing**2)
        r, angle = np.sqrt(rng.uniform((pipe.d / 2 - pipe.t) ** 2, pipe.d**2 / 4, n)), rng.uniform(0, 2 * np.pi, n)
        parts.append(np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(n, z)]))
    T = rigid(random_rotation(seed), rng.uniform(-1, 1, 3))
    return applied(T, bent(pipe.bends, np.concatenate(parts))) + sigma * rng.standard_normal((sum(map(len, parts)), 3)), T
