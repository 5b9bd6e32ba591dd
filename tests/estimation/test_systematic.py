"""What more points do not cure, and what faces that were not seen cannot tell."""

from dataclasses import replace

import numpy as np
import pytest

import real_scans
from estimation.made import made
from scan2fea.estimation.ends import rough_ends
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.plausible import implausible_price
from scan2fea.estimation.systematic import even_spacing, face_error, thinned_spacing, widened
from scan2fea.estimation.table import shipped_table
from scan2fea.kernel.section_likelihood import face_lengths
from scan2fea.kernel.sections import PARAMETERS, section
from scan2fea.types import PointCloud, Scan

JOINT = real_scans.DATA / "structural" / "pc2beam" / "test_points.txt"


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
    full = replace(member, sigma_m=0.0)
    rows = sum(face_lengths("I", np.array([full.values()[name] for name in PARAMETERS["I"]]))) / 0.01
    wide = {p.name: p.std_m for p in widened(full, 0.01, (rows + 30, rows + 10)).parameters}
    assert wide["b"] == pytest.approx(np.hypot(1e-4, 0.0025))  # one edge that was not seen
    assert wide["length"] == pytest.approx(np.hypot(1e-4, 0.01 / np.sqrt(3)))  # one end, whose points may all be the last row along the outline
    assert wide["h"] == wide["tw"] == wide["tf"] == 1e-4
    hazy = {p.name: p.std_m for p in widened(replace(member, sigma_m=0.004), 0.01, (rows + 30, rows + 10)).parameters}
    # a toe of one row that noise mixes with the row beside it; noise hides which row is the last
    assert hazy["b"] == pytest.approx(np.sqrt(1e-8 + 0.0025**2 + (0.25 * 0.008) ** 2)) and hazy["length"] == pytest.approx(np.hypot(1e-4, 0.0025))
    off = {p.name: p.std_m for p in widened(member, 0.0, (0.0, 0.0), 5e-4).parameters}
    assert off["h"] == pytest.approx(np.sqrt(1e-8 + 2 * 25e-8)) and off["length"] == 1e-4


def raster(pitch, noise, length, width, kept, rng):
    """Points on a grid over a strip, each moved by noise, some lost."""
    z, x = (v.ravel() for v in np.meshgrid(np.arange(0, length, pitch), np.arange(0, width, pitch)))
    keep = rng.random(len(z)) < kept
    return z[keep] + noise * rng.standard_normal(keep.sum()), x[keep]


@pytest.mark.parametrize(("noise", "kept"), [(0.0002, 1.0), (0.003, 1.0), (0.0067, 1.0), (0.0067, 0.9), (0.012, 1.0)])
def test_rows_that_noise_hides_still_spread_too_evenly(noise, kept):
    rng = np.random.default_rng(3)
    z = raster(0.01016, noise, 3.0, 0.5, kept, rng)[0]
    spacing = even_spacing(z, (0.0, 3.0), noise, 3.0 * 0.5)
    assert spacing == pytest.approx(0.01016 / np.sqrt(kept), rel=0.02)


def test_points_at_random_and_uneven_ones_are_no_raster():
    rng = np.random.default_rng(4)
    found = [even_spacing(rng.random(n) * length, (0.0, length), 0.003, 1.0) for n in (300, 3_000) for length in (0.3, 3.0) for _ in range(100)]
    assert not any(found)
    z = rng.random(8_000) ** 1.3 * 2.0
    assert even_spacing(z, (0.0, 2.0), 0.003, 1.0) == 0.0
    assert even_spacing(raster(0.01, 0.0067, 0.12, 0.5, 1.0, rng)[0], (0.0, 0.12), 0.0067, 0.06) == 0.0  # too short to say


def test_a_gridded_angle_of_the_lab_lies_within_its_own_doubt():
    """127 x 127 x 6.35 mm on a grid of 10.16 mm: one row on a toe of 6.35 mm, the last row a spacing before the end. Before: legs +3.3 mm +- 0.5."""
    inch = 0.0254
    true = {"a": 5 * inch, "b": 5 * inch, "t": inch / 4, "length": 60 * inch}
    pitch, rng = 0.4 * inch, np.random.default_rng(0)
    corners = section("L", {name: true[name] for name in "abt"}).loops[0]
    rows = [
        start + (end - start) / np.linalg.norm(end - start) * s
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True)
        for s in np.arange(0, np.linalg.norm(end - start), pitch)
    ]
    z = np.arange(0, true["length"], pitch)
    exact = np.array([[*row, height] for row in rows for height in z])
    for noise in (0.0, 0.0067):
        found = fit_member(Scan(cloud=PointCloud.of(exact + noise * rng.standard_normal(exact.shape))), MemberOptions(family="L"))
        for p in found.member.parameters:
            if p.observable:
                assert abs(p.value_m - true[p.name]) < 3 * p.std_m + 1e-6, (noise, p)


def test_a_pattern_counts_where_it_is_neither_chance_nor_small():
    assert face_error(1e-4, 1e-9, 2e-4) == 1e-4
    assert face_error(1e-4, 0.049, 2e-4) == 1e-4 and face_error(1e-4, 0.05, 2e-4) == 0.0  # on the threshold
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


@real_scans.needs("structural", "pc2beam")
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
