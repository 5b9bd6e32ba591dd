"""Patches that hold two surfaces come apart; free form that one surface explains, and those beside it do not, is a patch."""

from __future__ import annotations

import numpy as np

from scan2fea.cad.mixed import unmixed
from scan2fea.cad.patches import Near
from scan2fea.kernel.surfaces import CONE, CYLINDER, SPHERE, Surface, fit_surface
from scan2fea.types import IntArray, TriangleMesh

RADIUS, HALF, STEP, NOISE = 10.0, 12.0, 2.0, 0.1  # mm: of the capsule, half of its cylinder, an edge, the vertices
TOLERANCE = 3 * NOISE + 0.02 * STEP  # as bodies are segmented


def capsule(seed: int, noise: float = NOISE) -> tuple[Near, IntArray]:
    """A cylinder with a half ball at either end, noise in its vertices; the true part of each face: 0 cylinder, 1 and 2 balls."""
    n = int(2 * np.pi * RADIUS / STEP)
    quarter = int(np.pi / 2 * RADIUS / STEP)
    angle = np.linspace(0.0, np.pi / 2, quarter + 1)[1:]
    low = np.stack([RADIUS * np.sin(angle), -HALF - RADIUS * np.cos(angle)], axis=1)
    side = np.stack([np.full(11, RADIUS), np.linspace(-HALF, HALF, 13)[1:-1]], axis=1)
    profile = np.concatenate([low, side, low[::-1] * [1.0, -1.0]])  # (rings, 2): radius, height
    turn = 2 * np.pi * (np.arange(n)[None] + 0.5 * (np.arange(len(profile)) % 2)[:, None]) / n
    rings = np.stack([profile[:, :1] * np.cos(turn), profile[:, :1] * np.sin(turn), np.repeat(profile[:, 1:], n, axis=1)], axis=2).reshape(-1, 3)
    poles = np.array([[0.0, 0.0, -HALF - RADIUS], [0.0, 0.0, HALF + RADIUS]])
    first, last = len(rings), len(rings) + 1
    at, beside = np.arange(n), np.roll(np.arange(n), -1)
    faces = [np.stack([np.full(n, first), beside, at], axis=1)]
    for k in range(len(profile) - 1):
        a, b, c, d = k * n + at, k * n + beside, (k + 1) * n + at, (k + 1) * n + beside
        two = (np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)) if k % 2 == 0 else (np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1))
        faces += list(two)
    top = (len(profile) - 1) * n
    faces.append(np.stack([top + at, top + beside, np.full(n, last)], axis=1))
    exact, faces_all = np.concatenate([rings, poles]), np.concatenate(faces)
    height = exact[faces_all].mean(1)[:, 2]
    truth = np.where(height < -HALF, 1, np.where(height > HALF, 2, 0))
    noisy = exact + noise * np.random.default_rng(seed).standard_normal(exact.shape)
    return Near(TriangleMesh(vertices=noisy, faces=faces_all)), truth


def fit(near: Near, rows: IntArray, kind: str) -> Surface:
    used = np.unique(near.mesh.faces[rows])
    at = near.mesh.vertices[used]
    axis_off = at * [1.0, 1.0, 0.0] if kind != SPHERE else at - at.mean(0)
    found = fit_surface(kind, at, axis_off / np.linalg.norm(axis_off, axis=1, keepdims=True))
    assert found is not None
    return found


def told(label: IntArray, truth: IntArray, surfaces: list[Surface]) -> dict[str, float]:
    """Of each kind, in the order of the truth, the share of its faces that it has."""
    out = {}
    for part in range(3):
        names, counts = np.unique(label[truth == part], return_counts=True)
        best = int(np.argmax(counts))
        out[f"{part} {surfaces[names[best]].kind}"] = float(counts[best]) / float((truth == part).sum())
    return out


def test_a_cylinder_over_two_balls_comes_apart() -> None:
    near, truth = capsule(0)
    whole = fit(near, np.flatnonzero(truth == 0), CYLINDER)
    label, surfaces = unmixed(near, np.where(truth == 2, 1, 0), [whole, fit(near, np.flatnonzero(truth == 2), SPHERE)], TOLERANCE)
    found = told(label, truth, surfaces)
    assert set(found) == {"0 cylinder", "1 sphere", "2 sphere"}
    assert min(found.values()) > 0.9
    assert all(abs(surfaces[k].radius - RADIUS) < 0.1 for k in np.unique(label))


def test_a_free_ball_is_a_patch_and_what_is_right_stays() -> None:
    near, truth = capsule(3)
    kinds = (CYLINDER, SPHERE, SPHERE)
    surfaces = [fit(near, np.flatnonzero(truth == k), kind) for k, kind in enumerate(kinds)]
    label, same = unmixed(near, truth, surfaces, TOLERANCE)
    assert (label == truth).all() and len(same) == 3
    label, found = unmixed(near, np.where(truth == 2, -1, truth), surfaces[:2], TOLERANCE)
    assert told(label, truth, found)["2 sphere"] > 0.9
    assert CONE not in [found[k].kind for k in np.unique(label)]


def test_without_patches_nothing_is_known_of_the_noise() -> None:
    near, _ = capsule(0)
    assert (unmixed(near, np.full(len(near.areas), -1), [], TOLERANCE)[0] == -1).all()


def test_what_is_exact_stays() -> None:
    near, truth = capsule(0, 0.0)
    surfaces = [fit(near, np.flatnonzero(truth == k), kind) for k, kind in enumerate((CYLINDER, SPHERE, SPHERE))]
    label, same = unmixed(near, truth, surfaces, 0.02 * STEP)
    assert (label == truth).all() and len(same) == 3
