"""What more points do not cure, and what faces that were not seen cannot tell."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimation.made import made
from scan2fea.estimation.ends import rough_ends
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.plausible import implausible_price
from scan2fea.estimation.systematic import face_error, thinned_spacing, widened
from scan2fea.estimation.table import shipped_table
from scan2fea.types import PointCloud, Scan

JOINT = Path(os.environ.get("SCAN2FEA_DATA", "none")) / "structural" / "pc2beam" / "test_points.txt"


def test_regular_clouds_are_told_from_random_ones():
    rng = np.random.default_rng(0)
    flat = np.c_[rng.random((4_000, 2)), np.zeros(4_000)]
    assert thinned_spacing(flat) == 0.0
    grid = np.stack(np.meshgrid(np.arange(40), np.arange(60)), -1).reshape(-1, 2) * 0.01
    grid = np.c_[grid + 0.001 * rng.normal(size=grid.shape), np.zeros(len(grid))]
    assert thinned_spacing(grid) == pytest.approx(0.0085, abs=0.0015)


def test_edges_of_regular_clouds_are_known_to_their_spacing():
    member = replace(made("I", std=1e-4), seen={"TOP_TOE_LEFT": 0.9, "TOP_OUTER": 1.0, "BOTTOM_OUTER": 1.0})
    same = widened(member, 0.0, (0.0, 0.0))
    assert same is member
    wide = {p.name: p.std_m for p in widened(member, 0.01, (100.0, 3.0)).parameters}
    assert wide["b"] == pytest.approx(np.hypot(1e-4, 0.0025)) and wide["length"] == pytest.approx(np.hypot(1e-4, 0.0025))  # one edge each
    assert wide["h"] == wide["tw"] == wide["tf"] == 1e-4
    off = {p.name: p.std_m for p in widened(member, 0.0, (0.0, 0.0), 5e-4).parameters}
    assert off["h"] == pytest.approx(np.sqrt(1e-8 + 2 * 25e-8)) and off["length"] == 1e-4


def test_a_pattern_counts_where_it_is_neither_chance_nor_small():
    assert face_error(1e-4, 1e-9, 2e-4) == 1e-4
    assert face_error(1e-4, 0.5, 2e-4) == 0.0 and face_error(1e-5, 1e-9, 2e-4) == 0.0


def test_no_rolled_section_is_implausible():
    assert not any(implausible_price(s.family, s.parameters) for s in shipped_table().shapes)
    assert implausible_price("C", {"h": 0.3, "b": 0.3, "tw": 0.1, "tf": 0.14}) > 0


def test_a_hidden_stretch_does_not_end_a_member():
    z = np.random.default_rng(1).random(4_000) * 1.2
    z = z[(z < 0.7) | (z > 0.85) | (np.arange(len(z)) % 10 == 0)]  # a tenth is left between
    low, high = rough_ends(z)
    assert low < 0.02 and high > 1.17
    assert rough_ends(z[(z < 0.7) | (z > 0.85)])[1] < 0.75  # nothing is left: two members in one line
    stray = np.r_[z[z < 0.7], 1.0 + 0.01 * np.random.default_rng(2).random(20)]
    assert rough_ends(stray)[1] < 0.75


@pytest.mark.skipif(not JOINT.exists(), reason="needs SCAN2FEA_DATA")
@pytest.mark.parametrize("which", ["brace", "girder"])
def test_a_real_joint(which):
    table = np.loadtxt(JOINT)
    found = fit_member(Scan(cloud=PointCloud.of(table[table[:, 6] == (which == "girder"), :3])), MemberOptions())
    told = {p.name: p for p in found.member.parameters}
    assert found.explains and found.member.family == "I"
    if which == "brace":
        for name, true in {"h": 0.133, "b": 0.139}.items():
            assert abs(told[name].value_m - true) < min(0.0055, 5 * told[name].std_m), told[name]
    else:
        assert not told["tf"].observable and not told["h"].observable and told["b"].observable
        assert told["length"].value_m == pytest.approx(1.2, abs=0.005) and abs(told["b"].value_m - 0.3) < 3 * told["b"].std_m
