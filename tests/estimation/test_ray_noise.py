"""Noise along rays: its bias is what a fit of many points is off by, and a member whose rays are known is freed of it."""

import dataclasses
import functools

import numpy as np
import pytest

from estimation.made import made
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.ray_noise import acts_along, bias_of, freed_of_ray_noise
from scan2fea.kernel.section_likelihood import face_lengths, lines_of
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.kernel.transforms import random_rotation
from scan2fea.types import PointCloud, Rays, Scan

T = {"h": 0.0641, "b": 0.029, "tw": 0.0024, "tf": 0.0038}
LENGTH, SIGMA = 0.45, 8e-4
ASLANT = np.radians([-50.0, -10.0, 30.0, 65.0])  # of rays to the normal of the face they hit, across the member
OUTWARD = {"T": (-1, 1, -1, 1, 1, -1, -1, -1)}  # of each face, along its axis


@functools.cache
def scanned(n, seed, *, along_rays=True):
    """A tee and the rays that hit it evenly on all faces, each with its own slant: noise along them, or alike in all directions."""
    rng, values = np.random.default_rng(seed), np.array([T[name] for name in PARAMETERS["T"]])
    axis, line, low, _ = lines_of("T")
    lengths = face_lengths("T", values)
    face = rng.choice(len(lengths), n, p=lengths / lengths.sum())
    place = (low @ values)[face] + rng.uniform(size=n) * lengths[face]
    points, way = np.empty((n, 3)), np.zeros((n, 3))
    points[:, 2] = rng.uniform(0, LENGTH, n)
    slant, rows = rng.choice(ASLANT, n), np.arange(n)
    points[rows, axis[face]], points[rows, 1 - axis[face]] = (line @ values)[face], place
    way[rows, axis[face]], way[rows, 1 - axis[face]] = -np.array(OUTWARD["T"])[face] * np.cos(slant), np.sin(slant)
    origin = points - 2.0 * way
    shift = SIGMA * rng.normal(size=(n, 1)) * way if along_rays else SIGMA * np.mean(np.cos(ASLANT)) * rng.normal(size=(n, 3)) * [1, 1, 0]
    rays = Rays(origin=origin, direction=way, range_m=np.linalg.norm(points + shift - origin, axis=1))
    return Scan(cloud=dataclasses.replace(PointCloud.of(points + shift), ray=np.arange(n)), rays=rays), way[:, :2], face, values


def test_bias_is_what_fits_are_off_by():
    _, way, face, values = scanned(4_000, 0)
    sigma = SIGMA * np.sqrt(np.mean(np.cos(ASLANT) ** 2))
    told = bias_of("T", values, sigma, "gaussian", np.ones(8), way, face)
    off = []
    for seed in range(1, 5):
        points = scanned(20_000, seed)[0]
        fit = fit_member(Scan(cloud=points.cloud), MemberOptions(family="T", noise="gaussian"))
        off.append([fit.member.values()[name] - T[name] for name in T])
        assert [p.observable for p in fit.member.parameters] == [True] * 5
    std = np.array([p.std_m for p in fit.member.parameters[:4]])
    assert told[1] < -std[1]  # edges sharper than the faces are rough: the flange is told narrow
    assert (np.abs(np.mean(off, axis=0) - told) < 3 * std / 2 + 0.25 * np.abs(told)).all()


def test_noise_across_rays_is_none():
    """Noise that is alike in all directions leaves a member as it was, whatever its rays."""
    rng = np.random.default_rng(5)
    off, facing = rng.normal(size=3_000), rng.uniform(0.3, 1.0, 3_000)
    assert not acts_along(off, facing)
    assert acts_along(off * facing, facing)
    scan, *_ = scanned(6_000, 7, along_rays=False)
    member = made("T", LENGTH, T, sigma=SIGMA, std=1e-4)
    assert freed_of_ray_noise(scan, member, None, 0) is member


def test_without_rays_and_round_members_stay():
    scan, *_ = scanned(6_000, 7)
    member = made("T", LENGTH, T, sigma=SIGMA, std=1e-4)
    assert freed_of_ray_noise(Scan(cloud=PointCloud.of(scan.cloud.points)), member, None, 0) is member
    bar = made("round", LENGTH, {"d": 0.05}, sigma=SIGMA, std=1e-4)
    assert freed_of_ray_noise(scan, bar, None, 0) is bar
    freed = freed_of_ray_noise(scan, member, None, 0)
    assert freed.parameters[-1] == member.parameters[-1]
    assert all(new.std_m >= old.std_m for new, old in zip(freed.parameters, member.parameters, strict=True))
    assert np.diag(freed.covariance)[:4] == pytest.approx([p.std_m**2 for p in freed.parameters[:4]])


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_member_is_right_where_rays_are_known(seed):
    scan, *_ = scanned(20_000, seed)
    R = random_rotation(np.random.default_rng(seed))
    rays = dataclasses.replace(scan.rays, origin=scan.rays.origin @ R.T, direction=scan.rays.direction @ R.T)
    turned = Scan(cloud=dataclasses.replace(scan.cloud, points=scan.cloud.points @ R.T), rays=rays)
    known = fit_member(turned, MemberOptions(family="T")).member
    away = {p.name: abs(p.value_m - T[p.name]) / p.std_m for p in known.parameters[:4]}
    assert max(away.values()) < 3
