"""Toes at which the points stop more sharply than noise lets any toe: cut, whatever the wall; whole ones never, under any law of noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import made
from scan2fea.estimation.cut_toes import cut_toes
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.straight import straight_faces
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan
from scan2fea.verification.member import open_walls

TEE = {"h": 0.06, "b": 0.0552, "tw": 0.00472, "tf": 0.0064}
LENGTH, LONGER = 0.55, 0.03


def scanned(ratio, n, seed, noise="gaussian", *, cut=True):
    """A tee of which the web was cut 1.2 standard deviations within where a fit then has the toe, or a whole one. ratio : wall over noise."""
    sigma = TEE["tw"] / ratio
    options = MemberScanOptions(noise_m=sigma, caps=True, seed=seed, noise=noise)
    points = member_points("T", {**TEE, "h": TEE["h"] + LONGER * cut, "length": LENGTH}, n, options)
    web = made("T", LENGTH, TEE, sigma=sigma)
    if cut:
        other = made("T", LENGTH, {**TEE, "h": TEE["h"] + LONGER}, sigma=sigma)
        points = points + np.array([0.0, _top(web) - _top(other), 0.0])
        points = points[points[:, 1] > _top(web) - TEE["h"] + 1.2 * sigma]
    return web, points


def _top(member):
    return max(face.place for face in straight_faces(member)[0] if face.axis == 1)


@pytest.mark.parametrize("ratio", [3.0, 2.2, 1.5])
@pytest.mark.parametrize("noise", ["gaussian", "uniform", "laplace"])
def test_a_cut_web_is_told_and_a_whole_one_never(ratio, noise) -> None:
    told = [cut_toes(scanned(ratio, 20_000, seed, noise)[1], scanned(ratio, 20_000, seed, noise)[0]) for seed in range(5)]
    assert sum(found == {"WEB_TOE"} for found in told) >= 4
    for n in (3_000, 20_000, 60_000):
        for seed in range(5):
            web, points = scanned(ratio, n, seed, noise, cut=False)
            assert cut_toes(points, web) == frozenset()


def test_few_points_thick_walls_and_round_ones_are_not_asked() -> None:
    web, points = scanned(2.2, 20_000, 1)
    assert cut_toes(points[:300], web) == frozenset()
    web, points = scanned(6.0, 20_000, 1)
    assert cut_toes(points, web) == frozenset()
    assert cut_toes(points, made("CHS", LENGTH)) == frozenset() and cut_toes(points, made("RHS", LENGTH)) == frozenset()


def test_it_moves_with_the_member() -> None:
    web, points = scanned(2.2, 20_000, 3)
    T = rigid(rotation_about((1, 2, 3), 1.1), (4.0, 5.0, 6.0))
    moved = replace(web, T_world_member=T @ web.T_world_member)
    assert cut_toes(points @ T[:3, :3].T + T[:3, 3], moved) == cut_toes(points, web) == {"WEB_TOE"}


def test_toes_whose_own_points_alone_are_blurred_are_toes() -> None:
    """Noise along rays that cross the web leaves its ends sharp; the toe, scanned head on, is not."""
    rng, n = np.random.default_rng(4), 6_000
    web, sigma = made("T", LENGTH, TEE, sigma=TEE["tw"] / 2.2), TEE["tw"] / 2.2
    end = _top(web) - TEE["h"]
    sides = np.c_[rng.choice([-0.5, 0.5], n) * TEE["tw"], rng.uniform(end, end + TEE["h"], n), rng.uniform(0, LENGTH, n)]
    sides[:, 0] += sigma * rng.standard_normal(n)
    m = round(0.5 * n * TEE["tw"] / TEE["h"])
    toe = np.c_[rng.uniform(-0.5, 0.5, m) * TEE["tw"], end + sigma * rng.standard_normal(m), rng.uniform(0, LENGTH, m)]
    assert cut_toes(np.concatenate([sides, toe]), web) == frozenset()
    assert cut_toes(sides, web) == {"WEB_TOE"}  # nobody saw the toe, and nobody knows


def test_half_an_i_under_wide_noise_is_no_tee() -> None:
    sigma = TEE["tw"] / 2.2
    options = MemberScanOptions(noise_m=sigma, caps=True, seed=2)
    longer = member_points("T", {**TEE, "h": 0.09, "length": LENGTH}, 7_000, options)
    cut = fit_member(Scan(cloud=PointCloud.of(longer[longer[:, 1] > longer[:, 1].min() + 0.03])), MemberOptions()).member
    height = next(p for p in cut.parameters if p.name == "h")
    assert cut.family == "T" and cut.seen["WEB_TOE"] == 0 and not height.observable and open_walls(cut) == 1
    whole = fit_member(Scan(cloud=PointCloud.of(member_points("T", {**TEE, "length": LENGTH}, 7_000, options))), MemberOptions()).member
    height = next(p for p in whole.parameters if p.name == "h")
    assert whole.seen["WEB_TOE"] > 0.5 and height.observable and abs(height.value_m - TEE["h"]) < 4 * height.std_m
