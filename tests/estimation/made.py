"""Members made by hand from the type, one size of every family."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.estimation.solid import solid_of
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.transforms import rigid
from scan2fea.types import Member, Parameter

SIZES = {
    "L": {"a": 0.127, "b": 0.1, "t": 0.00635},
    "I": {"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085},
    "C": {"h": 0.2, "b": 0.075, "tw": 0.0085, "tf": 0.0115},
    "T": {"h": 0.1, "b": 0.12, "tw": 0.01, "tf": 0.011},
    "RHS": {"h": 0.1, "b": 0.06, "t": 0.005},
    "CHS": {"d": 0.1143, "t": 0.006},
    "rect": {"b": 0.1, "t": 0.01},
    "round": {"d": 0.05},
}
N_FACES = {"L": 8, "I": 14, "C": 10, "T": 10, "RHS": 10, "CHS": 4, "rect": 6, "round": 3}


def closed_area(family, v):
    """Area in closed form."""
    if family == "L":
        return v["t"] * (v["a"] + v["b"] - v["t"])
    if family in "IC":
        return 2 * v["b"] * v["tf"] + v["tw"] * (v["h"] - 2 * v["tf"])
    if family == "T":
        return v["b"] * v["tf"] + v["tw"] * (v["h"] - v["tf"])
    if family == "RHS":
        return v["h"] * v["b"] - (v["h"] - 2 * v["t"]) * (v["b"] - 2 * v["t"])
    if family == "rect":
        return v["b"] * v["t"]
    inner = v["d"] - 2 * v["t"] if family == "CHS" else 0.0
    return math.pi / 4 * (v["d"] ** 2 - inner**2)


def made(family, length=1.0, values=None, *, R=None, shift=(0, 0, 0), bow=None, twist=(), normals=((0, 0, -1), (0, 0, 1)), sigma=0.0005, std=1e-4):
    values = {**(values or SIZES[family]), "length": length}
    parameters = tuple(Parameter(name=n, value_m=v, std_m=std, observable=True, source="fitted") for n, v in values.items())
    return Member(
        family=family,
        parameters=parameters,
        T_world_member=rigid(np.eye(3) if R is None else R, np.asarray(shift, float)),
        bow=np.zeros((2, 0)) if bow is None else np.asarray(bow, float),
        twist=np.asarray(twist, float),
        end_normals=np.asarray(normals, float),
        covariance=np.eye(len(parameters)) * std**2,
        sigma_m=sigma,
        noise="gaussian",
        outlier_share=0.0,
        seen={},
        families={family: 1.0},
    )


def scanned(member, n, sigma, seed, clutter=0.0, change=None):
    """(n, 3) noisy points of the member's surface; `change` moves them in the member's frame before the noise; clutter fills a box around."""
    points = sample_surface(solid_of(member).mesh, n, seed)[0]
    R, t = member.T_world_member[:3, :3], member.T_world_member[:3, 3]
    local = (points - t) @ R
    if change is not None:
        local = change(local)
    rng = np.random.default_rng(seed + 1000)
    local = local + sigma * rng.normal(size=local.shape)
    k = int(clutter * n)
    low, high = local.min(axis=0) - 0.1, local.max(axis=0) + 0.1
    local[:k] = low + (high - low) * rng.random((k, 3))
    return local @ R.T + t
