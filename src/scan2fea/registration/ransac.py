"""A rigid motion from matched key points: three pairs at a time, drawn among those whose lengths agree (thesis 2.3.1).

Pairs (i, j) can both be right only if |s_i - s_j| = |t_i - t_j| within the tolerance and their frames turn alike. Triples are drawn from pairs
that agree mutually, so that most draws are all right or clearly wrong: with a share w of right matches a plain draw needs
log(1 - p) / log(1 - w^3) triples, 4603 at w = 0.1 and p = 0.99.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.transforms import rigid
from scan2fea.options import option
from scan2fea.registration.descriptors import turned
from scan2fea.registration.frame import SIGNS
from scan2fea.types import FloatArray, IntArray, Value


@dataclass(frozen=True, kw_only=True)
class RansacOptions:
    """How poses are proposed."""

    confidence: float = option(0.999, "Stop once three right pairs have been drawn with this probability.", minimum=0.5, maximum=0.999999)
    max_draws: int = option(4000, "Triples drawn at most.", minimum=1)
    proposals: int = option(12, "Different poses kept, those of the most matches.", minimum=1)
    max_turn_deg: float = option(40.0, "Frames of two matches may turn differently by this.", unit="deg", minimum=1.0, maximum=180.0)
    max_matches: int = option(1500, "Matches used, the closest features first.", minimum=3)


@dataclass(frozen=True, eq=False, kw_only=True)
class Features(Value):
    """points : (m, 3) key points.   frames : (m, 3, 3).   values : (m, 66).   variants : orientations of the frames that must be tried."""

    points: FloatArray
    frames: FloatArray
    values: FloatArray
    variants: IntArray

    _ROWS = (("points", "frames", "values"),)


@dataclass(frozen=True, eq=False, kw_only=True)
class Matches(Value):
    """source, target : (k,) rows of the features.   R : (k, 3, 3) rotation target from source that the two frames tell."""

    source: IntArray
    target: IntArray
    R: FloatArray

    _ROWS = (("source", "target", "R"),)


@dataclass(frozen=True, eq=False, kw_only=True)
class Proposal(Value):
    """T_target_source : (4, 4).   n_pairs : matches it explains."""

    T_target_source: FloatArray
    n_pairs: int


def matched(source: Features, target: Features, at_most: int) -> Matches:
    """Each feature with its nearest of the other frame, over all orientations; kept where either is among the two or the one nearest of the other."""
    rows_s, rows_t, R, far = [], [], [], []
    if len(source.points) and len(target.points):
        variants = target.variants if len(target.variants) > len(source.variants) else source.variants
        stacked = np.concatenate([turned(target.values, int(v)) for v in variants])
        n = len(target.points)
        distance, near = k_nearest(stacked, 2, source.values)
        for column in range(distance.shape[1]):
            rows_s.append(np.arange(len(source.points)))
            rows_t.append(near[:, column] % n)
            R.append(_rotation(source, target, rows_s[-1], rows_t[-1], variants[near[:, column] // n]))
            far.append(distance[:, column])
        distance, near = k_nearest(source.values, 1, stacked)
        best = np.argmin(distance.reshape(len(variants), n), axis=0)
        at = best * n + np.arange(n)
        rows_s.append(near[at, 0])
        rows_t.append(np.arange(n))
        R.append(_rotation(source, target, near[at, 0], np.arange(n), variants[best]))
        far.append(distance[at, 0])
    if not rows_s:
        return Matches(source=np.zeros(0, np.int64), target=np.zeros(0, np.int64), R=np.zeros((0, 3, 3)))
    s, t = np.concatenate(rows_s).astype(np.int64), np.concatenate(rows_t).astype(np.int64)
    _, once = np.unique(s * len(target.points) + t, return_index=True)
    chosen = once[np.argsort(np.concatenate(far)[once], kind="stable")][:at_most]
    return Matches(source=s[chosen], target=t[chosen], R=np.concatenate(R)[chosen])


def _rotation(source: Features, target: Features, s: IntArray, t: IntArray, variant: IntArray) -> FloatArray:
    turned_frames = target.frames[t] * SIGNS[variant][:, None, :]
    R: FloatArray = np.einsum("nij,nkj->nik", turned_frames, source.frames[s])
    return R


def kabsch(source: FloatArray, target: FloatArray) -> FloatArray:
    """(k, 4, 4) motions of least squares that take (k, m, 3) to (k, m, 3); proper rotations always (Kabsch 1976, sign of Umeyama 1991)."""
    cs, ct = source.mean(axis=1), target.mean(axis=1)
    H = np.einsum("kmi,kmj->kij", source - cs[:, None], target - ct[:, None])
    U, _, Vt = np.linalg.svd(H)
    sign = np.sign(np.linalg.det(np.einsum("kij,kjl->kil", U, Vt)))
    V = np.swapaxes(Vt, 1, 2).copy()
    V[:, :, 2] *= np.where(sign == 0, 1.0, sign)[:, None]
    T = np.tile(np.eye(4), (len(source), 1, 1))
    T[:, :3, :3] = np.einsum("kij,klj->kil", V, U)
    T[:, :3, 3] = ct - np.einsum("kij,kj->ki", T[:, :3, :3], cs)
    return T


def propose(
    source: Features, target: Features, tolerance_m: float, apart_m: float, options: RansacOptions = RansacOptions(), seed: int = 0
) -> tuple[Proposal, ...]:
    """Different motions that explain the most matches, best first; none where no three matches agree.

    tolerance_m : how far two right matches may disagree in length.   apart_m : matches nearer to each other say little and are not drawn
    together.
    """
    matches = matched(source, target, options.max_matches)
    if len(matches.source) < 3:
        return ()
    s, t = source.points[matches.source], target.points[matches.target]
    agree = _agree(s, t, matches.R, tolerance_m, apart_m, math.radians(options.max_turn_deg))
    support = agree * (agree @ agree)  # pairs that agree and whose partners agree too (second order, Chen 2022)
    T = _drawn(s, t, agree, support, tolerance_m, options, seed)
    return _different(T, s, t, tolerance_m, options)


def _agree(s: FloatArray, t: FloatArray, R: FloatArray, tolerance: float, apart: float, turn: float) -> FloatArray:
    """(k, k) 1 where two matches can both be right. float32: the products below are counts, exact up to 2^24."""
    ds = np.sqrt(np.maximum(_squared(s), 0.0))
    dt = np.sqrt(np.maximum(_squared(t), 0.0))
    flat = R.reshape(len(R), 9)
    alike = flat @ flat.T >= 1.0 + 2.0 * math.cos(turn)  # trace of R_i^T R_j
    found: FloatArray = ((np.abs(ds - dt) <= tolerance) & (np.minimum(ds, dt) >= apart) & alike).astype(np.float32)
    return found


def _squared(x: FloatArray) -> FloatArray:
    x = x - x.mean(axis=0)
    q = (x * x).sum(axis=1)
    return np.asarray(q[:, None] + q[None, :] - 2.0 * x @ x.T)


def _drawn(s: FloatArray, t: FloatArray, agree: FloatArray, support: FloatArray, tolerance: float, options: RansacOptions, seed: int) -> FloatArray:
    """(k, 4, 4) motions of triples, in batches until the stopping rule holds; each already refined on the matches it explains."""
    random = np.random.default_rng(seed)
    row_sum = support.sum(axis=1).astype(float)
    if not row_sum.any():
        return np.zeros((0, 4, 4))
    cumulated = np.cumsum(row_sum)
    kept, most, drawn = [], 3, 0
    batch = 200
    while drawn < options.max_draws:
        i = np.searchsorted(cumulated, random.random(batch) * cumulated[-1], side="right").clip(0, len(s) - 1)
        j = _one_of(support[i], random.random(batch))
        third = support[i] * agree[j]
        k = _one_of(third, random.random(batch))
        usable = (third.sum(axis=1) > 0) & (support[i].sum(axis=1) > 0)
        drawn += batch
        triple = np.stack([i, j, k], axis=1)[usable]
        if len(triple) == 0:
            continue
        T = kabsch(s[triple], t[triple])
        inside = _inside(T, s, t, tolerance)
        count = inside.sum(axis=1)
        best = np.argsort(-count, kind="stable")[: options.proposals]
        kept.append(_refined(T[best], inside[best], s, t, tolerance))
        most = max(most, int(count.max()))
        share = min(0.999, most / len(s))
        # what a draw among agreeing matches needs: the first is right with probability >= share, the others follow from it
        needed = math.log(1.0 - options.confidence) / math.log(1.0 - share)
        if drawn >= max(2 * batch, needed):
            break
    return np.concatenate(kept) if kept else np.zeros((0, 4, 4))


def _one_of(weight: FloatArray, u: FloatArray) -> IntArray:
    """(b,) a column of each row, drawn in proportion to its weight."""
    cumulated = np.cumsum(weight, axis=1, dtype=float)
    column = (cumulated <= (u * cumulated[:, -1])[:, None]).sum(axis=1)
    return np.asarray(np.minimum(column, weight.shape[1] - 1), np.int64)


def _inside(T: FloatArray, s: FloatArray, t: FloatArray, tolerance: float) -> np.ndarray:
    moved = np.einsum("kij,nj->kni", T[:, :3, :3], s) + T[:, None, :3, 3]
    return np.asarray(((moved - t) ** 2).sum(axis=2) <= tolerance**2)


def _refined(T: FloatArray, inside: np.ndarray, s: FloatArray, t: FloatArray, tolerance: float) -> FloatArray:
    refined = []
    for each, mask in zip(T, inside, strict=True):
        if mask.sum() >= 3:
            better = kabsch(s[mask][None], t[mask][None])[0]
            each = better if _inside(better[None], s, t, tolerance).sum() >= mask.sum() else each
        refined.append(each)
    return np.array(refined)


def _different(T: FloatArray, s: FloatArray, t: FloatArray, tolerance: float, options: RansacOptions) -> tuple[Proposal, ...]:
    if len(T) == 0:
        return ()
    count = _inside(T, s, t, tolerance).sum(axis=1)
    centre = s.mean(axis=0)
    size = float(np.sqrt(((s - centre) ** 2).sum(axis=1).mean()))
    chosen: list[int] = []
    for k in np.argsort(-count, kind="stable").tolist():
        apart = [
            np.linalg.norm((T[k] - T[c])[:3, :3] @ centre + (T[k] - T[c])[:3, 3]) + size * np.linalg.norm(T[k, :3, :3] - T[c, :3, :3]) for c in chosen
        ]
        if not apart or min(apart) > 3.0 * tolerance:
            chosen.append(k)
        if len(chosen) == options.proposals:
            break
    return tuple(Proposal(T_target_source=rigid(T[k, :3, :3], T[k, :3, 3]), n_pairs=int(count[k])) for k in chosen)
