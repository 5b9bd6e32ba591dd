"""Which of the places that were found for the frames can be true together, and whether another set of places can as well.

A box looks alike from two sides. Of two links that contradict each other a score tells nothing, since the wrong one may lie better: what tells is a
third frame that sees through what it would put there. So frames are put together from several first links on, each new one where most links agree and
nothing that a station saw empty is filled; the largest arrangement is kept. A frame that could stand elsewhere in it as well has no place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.transforms import inverse
from scan2fea.registration.pose_graph import rotation_vector
from scan2fea.registration.surface import Surface, sees_through
from scan2fea.registration.turns import turns
from scan2fea.types import FloatArray, Value

AT_MOST = 10  # arrangements that are tried
_ROUGH = 2.0  # edges: the middle of a face is told to half an edge, before anything is refined


@dataclass(frozen=True, eq=False, kw_only=True)
class Guess(Value):
    """A place of `source` against `target`, and what it is worth."""

    target: int
    source: int
    T_target_source: FloatArray
    score: float


@dataclass(frozen=True, eq=False, kw_only=True)
class World(Value):
    """T_world_frame of the frames that stand together, the sum of scores of the guesses that agree with it, and the frames that did not fit in."""

    poses: Mapping[int, FloatArray]
    score: float
    refused: frozenset[int]


class Arranger:
    """Puts frames together. What is seen through under a motion is looked at once. Never leaves `register`."""

    def __init__(self, surfaces: Sequence[Surface], tolerance_m: float) -> None:
        self.surfaces, self.tolerance_m = surfaces, tolerance_m
        self._centre = [s.points.mean(axis=0) if len(s) else np.zeros(3) for s in surfaces]
        self._size = [s.size_m() for s in surfaces]
        self._turns: dict[int, list[FloatArray]] = {}
        self._known: dict[tuple[int, int, bytes], bool] = {}

    def through(self, a: int, b: int, T_a_b: FloatArray) -> bool:
        """True where one of the two frames fills space that the other saw empty."""
        key = (a, b, np.round(T_a_b, 9).tobytes())
        if key not in self._known:
            self._known[key] = sees_through(self.surfaces[a], self.surfaces[b], T_a_b)
        return self._known[key]

    def apart(self, k: int, T_a: FloatArray, T_b: FloatArray) -> bool:
        """True where the two poses of frame k are different places."""
        c = np.append(self._centre[k], 1.0)
        off = inverse(T_a) @ T_b
        return float(np.hypot(np.linalg.norm(((T_a - T_b) @ c)[:3]), self._size[k] * np.linalg.norm(rotation_vector(off[:3, :3])))) > self.tolerance_m

    def fits(self, k: int, T: FloatArray, poses: Mapping[int, FloatArray]) -> bool:
        """True where frame k at T contradicts none of the others."""
        return not any(self.through(min(j, k), max(j, k), inverse(poses[j]) @ T if j < k else inverse(T) @ poses[j]) for j in poses if j != k)

    def support(self, k: int, T: FloatArray, poses: Mapping[int, FloatArray], guesses: Sequence[Guess]) -> float:
        """Sum of the scores of the guesses that put frame k there."""
        return sum(score for pose, score in _places(k, poses, guesses) if not self.apart(k, pose, T))

    def grown(self, roots: Mapping[int, FloatArray], first: Guess | None, guesses: Sequence[Guess]) -> World:
        """All frames that can be added to the roots, beginning with a guess."""
        poses, total, refused = dict(roots), 0.0, set()
        waiting = [first] if first is not None else list(guesses)
        dropped: list[tuple[int, FloatArray]] = []
        while waiting:
            ways = [(k, T) for g in waiting for k in (g.source, g.target) for T, _ in _places(k, poses, [g]) if k not in poses]
            ways = [(k, T) for k, T in ways if not any(j == k and not self.apart(k, T, M) for j, M in dropped)]
            if not ways:
                break
            worth = [self.support(k, T, poses, guesses) for k, T in ways]
            best = int(np.argmax(worth))
            k, T = ways[best]
            if self.fits(k, T, poses):
                poses[k], total = T, total + worth[best]
                waiting = list(guesses)
            else:
                dropped.append((k, T))
                refused.add(k)
        return World(poses=poses, score=total, refused=frozenset(refused - set(poses)))

    def worlds(self, roots: Mapping[int, FloatArray], guesses: Sequence[Guess]) -> list[World]:
        """Arrangements from different first guesses, the largest first."""
        found: list[World] = []
        for g in sorted(guesses, key=lambda g: -g.score):
            if len(found) == AT_MOST:
                break
            start = dict(roots) or {g.target: np.eye(4)}
            if not any(k in start for k in (g.source, g.target)) or any(self._holds(w, g) for w in found):
                continue
            world = self.grown(start, g, guesses)
            if len(world.poses) > len(start):
                found.append(world)
        return sorted(found, key=lambda w: (-len(w.poses), -w.score))

    def _holds(self, world: World, g: Guess) -> bool:
        p = world.poses
        return g.target in p and g.source in p and not self.apart(g.source, p[g.target] @ g.T_target_source, p[g.source])

    def elsewhere(self, best: World, others: Sequence[World], held: set[int]) -> set[int]:
        """Frames of the best arrangement that another one puts somewhere else, where they contradict nothing either."""
        doubtful: set[int] = set()
        for other in others:
            common = sorted(set(best.poses) & set(other.poses))
            if len(common) < 2:
                continue
            moved = {r: {k for k in common if self.apart(k, best.poses[r] @ inverse(other.poses[r]) @ other.poses[k], best.poses[k])} for r in common}
            r = min(common, key=lambda r: (len(moved[r]), r not in held, r))
            poses = dict(best.poses) | {k: best.poses[r] @ inverse(other.poses[r]) @ other.poses[k] for k in moved[r]}
            if moved[r] and all(self.fits(k, poses[k], poses) for k in moved[r]):
                doubtful |= moved[r]
        return doubtful - held

    def turned(self, best: World, lies: Callable[[int, int, FloatArray], bool], held: set[int]) -> set[int]:
        """Frames of the best arrangement that half a turn about a face of theirs puts where they contradict nothing either.

        lies : of target, source and motion, True where much of the one lies on the other. Nothing is refined: few of these places hold all motions.
        """
        poses, found = dict(best.poses), {-1}
        while found:  # one that may be turned says nothing of the others
            found = {k for k in sorted(set(poses) - held) if self._may_turn(k, poses, lies)}
            poses = {k: T for k, T in poses.items() if k not in found}
        return set(best.poses) - set(poses)

    def _may_turn(self, k: int, poses: Mapping[int, FloatArray], lies: Callable[[int, int, FloatArray], bool]) -> bool:
        others = sorted(set(poses) - {k})
        for T in (poses[k] @ H for H in self._turns_of(k)):
            motion = {j: inverse(poses[j]) @ T for j in others}
            if not self.apart(k, T, poses[k]) or any(sees_through(self.surfaces[j], self.surfaces[k], motion[j], _ROUGH) for j in others):
                continue
            if any(lies(j, k, motion[j]) for j in others):
                return True
        return False

    def _turns_of(self, k: int) -> list[FloatArray]:
        if k not in self._turns:
            self._turns[k] = turns(self.surfaces[k])
        return self._turns[k]


def _places(k: int, poses: Mapping[int, FloatArray], guesses: Sequence[Guess]) -> list[tuple[FloatArray, float]]:
    """Where the guesses put frame k against those that have a pose."""
    found = []
    for g in guesses:
        if g.source == k and g.target in poses:
            found.append((poses[g.target] @ g.T_target_source, g.score))
        elif g.target == k and g.source in poses:
            found.append((poses[g.source] @ inverse(g.T_target_source), g.score))
    return found
