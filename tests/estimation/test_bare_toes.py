"""Toes that a fit counts as seen and on whose middle no point lies: a rim of the face beside them is none; whole ones are, under any law of noise.

Inner faces of tubes likewise: the rounded corners of a tube seen from outside are none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import made
from scan2fea.estimation.bare_toes import bare_toes, bare_walls
from scan2fea.estimation.member import fit_member
from scan2fea.estimation.straight import straight_faces
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan

TEE = {"h": 0.045, "b": 0.035, "tw": 0.007, "tf": 0.007}
THIN = {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048}
LENGTH, SIGMA, TOE = 0.36, 0.001, "FLANGE_TOE_LEFT"
EVEN = dict.fromkeys((face.name for face in straight_faces(made("T", LENGTH, TEE))[0]), 1.0)


def rimmed(n, seed, *, sigma=SIGMA, share=0.3):
    """A tee seen everywhere but at one toe, and at the flange's inner face beside it only along its outer rim; `share` of the density of the rest."""
    rng, member = np.random.default_rng(seed), made("T", LENGTH, TEE, sigma=sigma)
    toe = next(face for face in straight_faces(member)[0] if face.name == TOE)
    parts = []
    for face in straight_faces(member)[0]:
        if face.name == TOE:
            continue
        low, high, m = face.low, face.high, n
        if face.name == "FLANGE_INNER_LEFT":  # 3 mm of it, next to the toe
            low, high = sorted((toe.place, toe.place - 0.003 * toe.outward))
        m = round(n * (high - low) / TEE["b"] * (share if face.name == "FLANGE_INNER_LEFT" else 1.0))
        at = np.zeros((m, 3))
        at[:, face.axis], at[:, 1 - face.axis], at[:, 2] = face.place, rng.uniform(low, high, m), rng.uniform(0, LENGTH, m)
        parts.append(at)
    points = np.concatenate(parts)
    return member, points + sigma * rng.standard_normal(points.shape)


@pytest.mark.parametrize("seed", range(4))
def test_a_rim_beside_it_is_no_toe(seed) -> None:
    member, points = rimmed(4_000, seed)
    assert bare_toes(points, member, {**EVEN, "FLANGE_INNER_LEFT": 0.02, TOE: 0.3}) == {TOE}


@pytest.mark.parametrize("noise", ["gaussian", "uniform", "laplace"])
@pytest.mark.parametrize("n", [1_000, 8_000, 60_000])
def test_whole_ones_are_never_bare(noise, n) -> None:
    for seed in range(3):
        for ratio in (5.5, 7.0, 20.0):
            sigma = TEE["tw"] / ratio
            points = member_points("T", {**TEE, "length": LENGTH}, n, MemberScanOptions(noise_m=sigma, caps=True, seed=seed, noise=noise))
            member = made("T", LENGTH, TEE, sigma=sigma)
            assert bare_toes(points, member, EVEN) == frozenset()


def test_walls_that_noise_joins_few_points_and_round_ones_are_not_asked() -> None:
    member, points = rimmed(4_000, 1, sigma=TEE["tf"] / 4.9)
    claimed = {**EVEN, "FLANGE_INNER_LEFT": 0.02, TOE: 0.3}
    assert bare_toes(points, member, claimed) == frozenset()
    member, points = rimmed(4_000, 1)
    assert bare_toes(points[::100], member, claimed) == frozenset()
    assert bare_toes(points, made("CHS", LENGTH, sigma=SIGMA), {}) == bare_toes(points, made("RHS", LENGTH, sigma=SIGMA), {}) == frozenset()


def test_it_moves_with_the_member() -> None:
    member, points = rimmed(4_000, 2)
    T = rigid(rotation_about((1, 2, 3), 1.1), (4.0, 5.0, 6.0))
    moved = replace(member, T_world_member=T @ member.T_world_member)
    assert bare_toes(points @ T[:3, :3].T + T[:3, 3], moved, {**EVEN, "FLANGE_INNER_LEFT": 0.02, TOE: 0.3}) == {TOE}


def test_toes_of_exact_points_are_not_bare() -> None:
    for seed in range(2):
        found = fit_member(Scan(cloud=PointCloud.of(member_points("L", THIN, 3_000, MemberScanOptions(noise_m=0.0, caps=True, seed=seed)))))
        assert all(p.observable for p in found.member.parameters)


def box_tube(n, seed, *, inner, radius, sigma, wall=0.01):
    """Points of a tube of 200 x 120 mm: its outer outline with arcs at the corners, and `inner` per metre of its inner faces for one of the outer."""
    rng, parts = np.random.default_rng(seed), []
    for b, h, r, share in ((0.12, 0.2, radius, 1.0), (0.12 - 2 * wall, 0.2 - 2 * wall, max(radius - wall, 0.0), inner)):
        side, up, arc = b - 2 * r, h - 2 * r, np.pi / 2 * r
        m = round(share * n * (2 * (side + up) + 4 * arc))
        of = rng.choice(3, m, p=np.array([side, up, 2 * arc]) / (side + up + 2 * arc))
        turn, along = rng.uniform(0, np.pi / 2, m), rng.uniform(-0.5, 0.5, m)
        x = np.select([of == 0, of == 1], [along * side, np.full(m, b / 2)], b / 2 - r + r * np.cos(turn))
        y = np.select([of == 0, of == 1], [np.full(m, h / 2), along * up], h / 2 - r + r * np.sin(turn))
        parts.append(np.stack([x, y], 1) * rng.choice([-1.0, 1.0], (m, 2)))
    xy = np.concatenate(parts)
    return np.column_stack([xy, rng.uniform(0, 1.5, len(xy))]) + sigma * rng.standard_normal((len(xy), 3))


@pytest.mark.parametrize("seed", range(3))
def test_rounded_corners_seen_from_outside_are_no_inner_faces(seed) -> None:
    """A tube of 200 x 120 x 10 mm with corners of 20 mm, seen from outside, had come with a wall of 3.93 +- 0.14 mm."""
    sigma = 5e-4
    points = box_tube(20_000, seed, inner=0.0, radius=0.02, sigma=sigma)
    thin = made("RHS", 1.5, {"h": 0.2, "b": 0.12, "t": 0.0039}, sigma=sigma)
    inner = [face.name for face in straight_faces(thin)[1]]
    density = dict.fromkeys((face.name for face in straight_faces(thin)[0]), 1.0) | dict.fromkeys(inner, 0.08)
    assert bare_walls(points, thin, density) == set(inner)
    for radius in (0.0, 0.02):  # a wall that was seen
        points = box_tube(20_000, seed, inner=0.1, radius=radius, sigma=sigma)
        assert bare_walls(points, made("RHS", 1.5, {"h": 0.2, "b": 0.12, "t": 0.01}, sigma=sigma), {**density, **dict.fromkeys(inner, 0.1)}) == set()
    assert bare_walls(points, made("L", 1.5, {"a": 0.2, "b": 0.12, "t": 0.01}, sigma=sigma), {}) == set()
